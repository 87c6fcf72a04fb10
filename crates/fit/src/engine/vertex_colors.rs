//! A fitted surface as colours of vertices: what is written in place of textures.
//!
//! The colours are those whose linear interpolation over the triangles is nearest to the maps, in the mean square over the
//! surface: `sum over samples of area |sum of w_k c_k - map|^2` with barycentric weights `w` ([`VertexFit`]). Everything else
//! of a material is the mean over its surface.

use super::light_asset::LightAsset;
use crate::candidate::Candidate;
use photofit_geometry::{Mesh, VertexFit};
use photofit_image::{psnr_from_mse, srgb_encode};
use photofit_raster::deferred::SAMPLER;
use photofit_raster::texture::{lookup, sample};
use photofit_raster::{CHANNELS, channel};
use photofit_scalar::{Vec2f, Vec3f, vec3, vec4};
use photofit_scene::{AlphaMode, Instance, Material, Primitive, Scene};
use photofit_shading::Sides;
use std::collections::BTreeMap;

/// Most sample points along a side of a triangle.
const MOST: usize = 64;
/// Weight of the mean colour around a vertex against that of its surface: what no sample sees has a colour, too.
const TOWARDS_MEAN: f64 = 1e-4;
/// Steps of the solver, and the residual relative to the right side at which it ends.
const STEPS: usize = 200;
const RESIDUAL: f64 = 1e-7;
/// Emission below this is none.
const DARK: f64 = 1e-4;

/// A surface with colours of vertices.
#[derive(Clone, Debug)]
pub struct Colored {
    /// One primitive and material for each class, without textures.
    pub scene: Scene,
    /// How near the colours are to the base colour of the maps: PSNR of sRGB values over the surface, decibels.
    pub psnr: f64,
}

/// A sample of the maps in a triangle.
struct Sample {
    weights: [f64; 3],
    area: f64,
    color: [f64; 4],
}

/// Turns a candidate into a scene whose surface is told by colours of vertices.
pub fn colored(candidate: &Candidate, light: &LightAsset) -> Colored {
    let mesh = candidate.mesh();
    // Vertices at one place and of one class have one colour: atlas and creases do not show.
    let mut ids = BTreeMap::new();
    let corners: Vec<[u32; 3]> = candidate
        .triangles
        .iter()
        .zip(&candidate.class)
        .map(|(t, class)| {
            t.map(|v| {
                let next = ids.len() as u32;
                *ids.entry((candidate.weld.ids[v as usize], *class)).or_insert(next)
            })
        })
        .collect();
    let samples: Vec<Vec<Sample>> = (0..corners.len()).map(|t| samples(candidate, &mesh, light, t)).collect();
    let colors = solve(&corners, &samples, ids.len());
    let psnr = psnr(&corners, &colors, &samples);
    let mut scene = Scene { name: light.name.clone(), ..Scene::default() };
    for class in 0..light.classes.len() {
        let part = part(candidate, &mesh, light, class, &corners, &colors);
        if part.triangles.is_empty() {
            continue;
        }
        scene.materials.push(material(candidate, &mesh, light, class));
        let primitive = scene.primitives.len();
        scene.primitives.push(Primitive { mesh: part, material: scene.materials.len() - 1 });
        scene.instances.push(Instance { primitive, transform: glam::Affine3A::IDENTITY });
    }
    Colored { scene, psnr }
}

/// The maps at texture coordinates, on their finest level.
fn texel(candidate: &Candidate, uv: Vec2f) -> [f32; CHANNELS] {
    sample(&candidate.maps, &lookup(&candidate.maps, uv, None, &SAMPLER))
}

/// Visits evenly spread points of triangle `t`, about one for each of its texels: barycentric weights, area, and texel.
fn visit(candidate: &Candidate, mesh: &Mesh, t: usize, mut each: impl FnMut([f64; 3], f64, [f32; CHANNELS])) {
    let base = &candidate.maps.levels[0];
    let uv = candidate.triangles[t].map(|v| candidate.uvs[v as usize]);
    let (e, f) = (uv[1] - uv[0], uv[2] - uv[0]);
    let texels = 0.5 * f64::from((e.x * f.y - e.y * f.x).abs()) * (base.width * base.height) as f64;
    let n = (texels.sqrt().ceil() as usize).clamp(2, MOST);
    let [a, b, c] = mesh.corners(t);
    let area = 0.5 * f64::from((b - a).cross(c - a).length()) / (n * n) as f64;
    // The centres of the n^2 equal triangles that it divides into.
    for i in 0..n {
        for j in 0..n - i {
            for turned in [false, true] {
                if turned && i + j + 2 > n {
                    continue;
                }
                let shift = if turned { 2.0 / 3.0 } else { 1.0 / 3.0 };
                let (v, w) = ((i as f64 + shift) / n as f64, (j as f64 + shift) / n as f64);
                let at = uv[0] + e * v as f32 + f * w as f32;
                each([1.0 - v - w, v, w], area, texel(candidate, at));
            }
        }
    }
}

fn samples(candidate: &Candidate, mesh: &Mesh, light: &LightAsset, t: usize) -> Vec<Sample> {
    let class = &light.classes[candidate.class[t] as usize];
    // Unlit surfaces are drawn as emission; glass with less alpha than it has.
    let first = if class.unlit { channel::EMISSIVE } else { channel::BASE_COLOR };
    let opaque = class.written == AlphaMode::Opaque;
    let mut out = Vec::new();
    visit(candidate, mesh, t, |weights, area, x| {
        let alpha = if opaque { 1.0 } else { f64::from(class.written_alpha(x[channel::ALPHA])) };
        let [r, g, b] = [0, 1, 2].map(|k| f64::from(x[first + k]));
        out.push(Sample { weights, area, color: [r, g, b, alpha] });
    });
    out
}

/// The colours of `count` vertices, in [0, 1]; `corners` are their numbers, and `samples` those of each triangle.
fn solve(corners: &[[u32; 3]], samples: &[Vec<Sample>], count: usize) -> Vec<[f64; 4]> {
    let mut fit = VertexFit::new(corners.to_vec(), count);
    let mut right: [Vec<f64>; 4] = std::array::from_fn(|_| vec![0.0; count]);
    for (t, (ids, samples)) in corners.iter().zip(samples).enumerate() {
        let (mut area, mut sum) = (0.0, [0.0; 4]);
        for s in samples {
            fit.add(t, s.weights, s.area);
            area += s.area;
            for (c, total) in sum.iter_mut().enumerate() {
                *total += s.area * s.color[c];
                fit.spread(&mut right[c], t, s.weights, s.area * s.color[c]);
            }
        }
        // A triangle without area still has colours.
        let (least, n) = (TOWARDS_MEAN * area.max(1e-12), samples.len().max(1) as f64);
        for id in ids.map(|id| id as usize) {
            fit.hold(id, least);
            for (c, total) in sum.iter().enumerate() {
                let mean = if area > 0.0 {
                    total / area
                } else {
                    samples.iter().map(|s| s.color[c]).sum::<f64>() / n
                };
                right[c][id] += least * mean;
            }
        }
    }
    let channels = right.map(|right| fit.solve(&right, STEPS, RESIDUAL));
    (0..count).map(|v| [0, 1, 2, 3].map(|c: usize| channels[c][v].clamp(0.0, 1.0))).collect()
}

/// PSNR of the interpolated colours, sRGB.
fn psnr(corners: &[[u32; 3]], colors: &[[f64; 4]], samples: &[Vec<Sample>]) -> f64 {
    let srgb = |x: f64| f64::from(srgb_encode(x.clamp(0.0, 1.0) as f32));
    let (mut sum, mut area) = (0.0, 0.0);
    for (ids, samples) in corners.iter().zip(samples) {
        for s in samples {
            for c in 0..3 {
                let shown: f64 = ids.iter().zip(s.weights).map(|(i, w)| w * colors[*i as usize][c]).sum();
                sum += s.area * (srgb(shown) - srgb(s.color[c])).powi(2);
            }
            area += 3.0 * s.area;
        }
    }
    psnr_from_mse((sum / f64::max(area, f64::MIN_POSITIVE)).max(1e-10))
}

/// A colour in [0, 1] as 16 bits hold it: half of the bytes of a float in the file.
fn in_16_bits(x: f32) -> f32 {
    (x * 65535.0).round() / 65535.0
}

/// The triangles of a class with their colours, in the frame of the asset.
fn part(
    candidate: &Candidate,
    mesh: &Mesh,
    light: &LightAsset,
    class: usize,
    corners: &[[u32; 3]],
    colors: &[[f64; 4]],
) -> Mesh {
    let mut out = Mesh::default();
    let mut known = BTreeMap::new();
    for (t, _) in candidate.class.iter().enumerate().filter(|(_, c)| **c as usize == class) {
        let triangle: [u32; 3] = std::array::from_fn(|k| {
            let v = candidate.triangles[t][k] as usize;
            let normal = mesh.normals[v];
            let up: Vec3f = vec3(0.0, 1.0, 0.0);
            let normal = if normal.length_squared() > 0.5 { normal } else { up };
            let key = (candidate.weld.ids[v], normal.to_array().map(f32::to_bits));
            *known.entry(key).or_insert_with(|| {
                out.positions.push(light.frame.to_world(mesh.positions[v]));
                out.normals.push(normal);
                let [r, g, b, a] = colors[corners[t][k] as usize].map(|x| in_16_bits(x as f32));
                out.colors.push(vec4(r, g, b, a));
                out.positions.len() as u32 - 1
            })
        });
        out.triangles.push(triangle);
    }
    out
}

/// The material of a class: means over its surface.
fn material(candidate: &Candidate, mesh: &Mesh, light: &LightAsset, class: usize) -> Material {
    let (mut sum, mut total) = ([0.0; CHANNELS], 0.0);
    for (t, _) in candidate.class.iter().enumerate().filter(|(_, c)| **c as usize == class) {
        visit(candidate, mesh, t, |_, area, x| {
            total += area;
            sum.iter_mut().zip(x).for_each(|(s, x)| *s += area * f64::from(x));
        });
    }
    let mean = |c: usize| sum[c] / f64::max(total, f64::MIN_POSITIVE);
    let kind = &light.classes[class];
    let emitted = [0, 1, 2].map(|k| mean(channel::EMISSIVE + k));
    let emits = !kind.unlit && emitted.iter().any(|e| *e > DARK);
    Material {
        name: kind.name.clone(),
        roughness: mean(channel::ROUGHNESS) as f32,
        metallic: mean(channel::METALLIC) as f32,
        emissive: if emits { emitted.map(|e| e as f32) } else { [0.0; 3] },
        alpha_mode: kind.written,
        double_sided: kind.sides == Sides::Both,
        unlit: kind.unlit,
        extensions: kind.extensions.clone(),
        ..Material::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simplify::{Appearance, Normalised, SimplifyOptions, simplify};
    use crate::{Progress, Silent};
    use photofit_geometry::decimate::Target;
    use photofit_geometry::shapes::uv_sphere;
    use photofit_scene::{TextureImage, TextureSlot};
    use std::sync::Mutex;

    /// A sphere with a texture.
    fn sphere(texel: impl Fn(usize, usize) -> [u8; 4]) -> Scene {
        let slot = |image| Some(TextureSlot::new(image));
        let texels = (0..64 * 64).map(|k| texel(k % 64, k / 64)).collect();
        let image = TextureImage { width: 64, height: 64, texels, ..TextureImage::default() };
        let flat = TextureImage { width: 1, height: 1, texels: vec![[255, 51, 204, 255]], ..image.clone() };
        let mut material = Material { base_color_texture: slot(0), ..Material::clay() };
        (material.metallic_roughness_texture, material.roughness, material.metallic) = (slot(1), 1.0, 1.0);
        Scene {
            primitives: vec![Primitive { mesh: uv_sphere(40, 20), material: 0 }],
            instances: vec![Instance { primitive: 0, transform: glam::Affine3A::IDENTITY }],
            materials: vec![material],
            images: vec![image, flat],
            ..Scene::default()
        }
    }

    #[derive(Default)]
    struct Heard(Mutex<String>);

    impl Progress for Heard {
        fn report(&self, _: &'static str, _: u64, _: u64, _: &str) {}
        fn warn(&self, text: &str) {
            self.0.lock().unwrap().push_str(text);
        }
        fn is_cancelled(&self) -> bool {
            false
        }
    }

    fn options() -> SimplifyOptions {
        SimplifyOptions {
            target: Target::Triangles(500),
            appearance: Appearance::VertexColors,
            resolution: 64,
            texture_size: 128,
            report_views: 2,
            steps: 0,
            ..SimplifyOptions::default()
        }
    }

    #[test]
    fn a_smooth_gradient_lives_in_vertices_and_detail_is_told() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.glb");
        let wave =
            |x: usize, k: f64| (128.0 + 100.0 * (k * x as f64 / 64.0 * std::f64::consts::TAU).sin()) as u8;
        let smooth = sphere(|x, y| [wave(x, 1.0), 60 + 2 * y as u8, 90, 255]);
        let heard = Heard::default();
        let made = simplify(&smooth, &path, &options(), &heard).unwrap();
        let n = Normalised::new(&smooth).unwrap();
        let psnr = colored(&made.candidate, &n.light_asset).psnr;
        assert!(psnr > 35.0 && heard.0.lock().unwrap().is_empty(), "{psnr}: {:?}", heard.0);
        let light = photofit_scene::load(&path).unwrap();
        assert!(light.images.is_empty() && light.primitives[0].mesh.uvs.is_empty());
        let mesh = &light.primitives[0].mesh;
        assert_eq!(mesh.colors.len(), mesh.positions.len());
        let m = &light.materials[0];
        assert!((m.roughness - 0.2).abs() < 0.02 && (m.metallic - 0.8).abs() < 0.02, "{m:?}");
        let shown = made.shipped().unwrap().psnr;
        assert!(shown > 30.0, "judged like everything else: {shown} dB");

        let noise = sphere(|x, y| [[20, 90, 200, 255], [240, 160, 30, 255]][(x / 4 + y / 4) & 1]);
        simplify(&noise, &path, &options(), &heard).unwrap();
        assert!(heard.0.lock().unwrap().contains("more detail than vertices"), "{:?}", heard.0);
    }

    #[test]
    fn least_squares_is_nearer_than_texels_at_the_vertices() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.glb");
        let spots =
            sphere(|x, y| if (x / 6 + y / 6) % 2 == 0 { [230, 200, 40, 255] } else { [40, 60, 90, 255] });
        let made = simplify(&spots, &path, &options(), &Silent).unwrap();
        let (candidate, n) = (&made.candidate, Normalised::new(&spots).unwrap());
        let (mesh, light) = (candidate.mesh(), &n.light_asset);
        let corners: Vec<[u32; 3]> =
            candidate.triangles.iter().map(|t| t.map(|v| candidate.weld.ids[v as usize])).collect();
        let samples: Vec<Vec<Sample>> =
            (0..corners.len()).map(|t| samples(candidate, &mesh, light, t)).collect();
        let area: f64 = samples.iter().flatten().map(|s| s.area).sum();
        let own: f64 = (0..corners.len())
            .map(|t| mesh.corners(t))
            .map(|[a, b, c]| 0.5 * f64::from((b - a).cross(c - a).length()))
            .sum();
        assert!((area / own - 1.0).abs() < 1e-6, "samples stand for the whole surface");
        let mut points = vec![[0.0; 4]; candidate.positions.len()];
        for (v, uv) in candidate.uvs.iter().enumerate() {
            let x = texel(candidate, *uv);
            points[candidate.weld.ids[v] as usize] = [0, 1, 2, 3].map(|k| f64::from(x[k]));
        }
        let fitted = psnr(&corners, &solve(&corners, &samples, points.len()), &samples);
        let sampled = psnr(&corners, &points, &samples);
        assert!(fitted > sampled + 0.3, "{fitted} against {sampled} dB");
    }
}
