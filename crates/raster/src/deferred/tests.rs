//! The whole chain against central differences of the rendered image.

use super::*;
use crate::maps::{CHANNELS, Maps, channel};
use crate::project::project;
use crate::rasterize::{NONE, TILE, rasterize};
use crate::texture::{MipAdjoint, Pyramid, Scatter};
use photofit_gradcheck::{Uniform, check, max_relative_error};
use photofit_scalar::wide::Width;
use photofit_scalar::{Real, vec2, vec3, vec4};
use photofit_shading::{Environment, Yaw};
use tile::{Strip, StripGradients, StripSpans};

const SIZE: usize = 20;
const TRIANGLES: [[u32; 3]; 4] = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]];
const OPPOSITE: [[u32; 3]; 4] = [[NONE, 2, 3], [NONE, 3, 0], [NONE, 0, 1], [NONE, 1, 2]];
const NEIGHBOUR: [[u32; 3]; 4] = [[NONE, 1, 3], [NONE, 2, 0], [NONE, 3, 1], [NONE, 0, 2]];

/// A pyramid-shaped patch with random attributes.
pub(super) struct Patch {
    positions: Vec<f64>,
    normals: Vec<f64>,
    tangents: Vec<f64>,
    uvs: Vec<Vec2<f64>>,
    texels: Vec<f64>,
    alpha: Vec<AlphaMode>,
    size: usize,
    /// Samples per axis of a pixel.
    samples: usize,
    shade_per_pixel: bool,
    pub(super) lod_bias: f64,
    lights: Lights,
    passes: Passes,
}

/// What falls on the patch.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Lights {
    None,
    /// A point and ambient light.
    Lamp,
    /// A sun and an environment.
    Sky,
}

impl Patch {
    pub(super) fn new(size: usize, seed: u64) -> Self {
        let mut rng = Uniform::new(seed);
        let flat = [[-0.83, -0.71], [0.77, -0.69], [0.74, 0.81], [-0.79, 0.76], [0.03, 0.05]];
        let mut positions = vec![];
        for p in flat {
            positions.extend([p[0], p[1], rng.range(-0.2, 0.2)]);
        }
        let normals = (0..5).flat_map(|_| [rng.range(-0.3, 0.3), rng.range(-0.3, 0.3), 1.0]).collect();
        let tangents = (0..5).flat_map(|_| [1.0, rng.range(-0.3, 0.3), rng.range(-0.3, 0.3)]).collect();
        let uvs = flat.iter().map(|p| vec2(p[0] * 0.55 + 0.5, 0.5 - p[1] * 0.55)).collect();
        let mut texels = vec![0.0; size * size * CHANNELS];
        for t in texels.chunks_mut(CHANNELS) {
            t.copy_from_slice(&rng.vec(CHANNELS, 0.2, 0.8));
            t[channel::NORMAL] = rng.range(-0.3, 0.3);
            t[channel::NORMAL + 1] = rng.range(-0.3, 0.3);
            t[channel::NORMAL + 2] = 0.9;
        }
        Self {
            positions,
            normals,
            tangents,
            uvs,
            texels,
            alpha: vec![],
            size,
            samples: 1,
            shade_per_pixel: false,
            lod_bias: -8.0,
            lights: Lights::Lamp,
            passes: Passes::default(),
        }
    }

    pub(super) fn maps<T: Real>(&self) -> Pyramid<T, CHANNELS> {
        let texels = self.texels.chunks(CHANNELS).map(|t| std::array::from_fn(|c| T::of(t[c]))).collect();
        Pyramid::new(Maps { width: self.size, height: self.size, texels })
    }

    /// Runs `f` with the geometry and the view.
    pub(super) fn with<T: Real, R>(&self, f: impl FnOnce(&Geometry<'_, T>, &View<'_, T>) -> R) -> R {
        let vector = |v: &[f64]| vec3(v[0], v[1], v[2]).cast::<T>();
        let vectors = |v: &[f64]| v.chunks(3).map(vector).collect::<Vec<_>>();
        let (positions, normals) = (vectors(&self.positions), vectors(&self.normals));
        let tangents: Vec<Vec4<T>> =
            vectors(&self.tangents).iter().map(|t| vec4(t.x, t.y, t.z, T::one())).collect();
        let uvs: Vec<Vec2<T>> = self.uvs.iter().map(|uv| uv.cast()).collect();
        let geometry = Geometry {
            positions: &positions,
            normals: &normals,
            tangents: &tangents,
            uvs: &uvs,
            topology: Topology { triangles: &TRIANGLES, opposite: &OPPOSITE, neighbour: &NEIGHBOUR },
            alpha: &self.alpha,
            sides: &[],
        };
        let sky = (self.lights == Lights::Sky).then(|| {
            let sky: Vec<f32> = (0..8 * 4 * 3).map(|i| 0.1 + (i * 7 % 11) as f32 / 9.0).collect();
            Environment::from_equirectangular(8, 4, &sky).unwrap().cast()
        });
        let vector = |x: f64, y: f64, z: f64| vec3(x, y, z).cast::<T>();
        let lights = match (self.lights, &sky) {
            (Lights::Sky, Some(map)) => vec![
                Light::Directional { direction: vector(0.6, 0.0, 0.8), irradiance: vector(2.0, 1.8, 1.5) },
                Light::Environment { map, rotation: Yaw::new(T::of(0.4)), scale: T::of(0.9) },
            ],
            (Lights::Lamp, _) => vec![
                Light::Point { position: vector(1.0, 1.5, 3.0), intensity: vector(20.0, 18.0, 15.0) },
                Light::Ambient { radiance: vector(0.3, 0.3, 0.4) },
            ],
            _ => vec![],
        };
        let projection =
            [[1.3, 0.0, 0.0, 0.0], [0.0, 1.3, 0.0, 0.0], [0.0, 0.0, -1.2, 1.8], [0.0, 0.0, -1.0, 2.5]];
        let view = View {
            view_projection: projection.map(|row: [f64; 4]| row.map(T::of)),
            eye: vector(0.0, 0.0, 2.5),
            lights: &lights,
            width: SIZE * self.samples,
            height: SIZE * self.samples,
            samples: self.samples,
            shade_per_pixel: self.shade_per_pixel,
            lod_bias: T::of(self.lod_bias),
        };
        f(&geometry, &view)
    }

    /// Bits of the samples and of the gradients of the corners and texels of the first layer, by vectors up to `most`.
    fn bits<T: Real>(&self, most: Width, g: &[[f64; 4]]) -> Vec<u64> {
        let (maps, passes) = (self.maps::<T>(), &self.passes);
        let g: Vec<[T; 4]> = g.iter().map(|g| g.map(T::of)).collect();
        let bits_of = |x: &T| x.f64().to_bits();
        self.with(|geometry, view| {
            let size = (view.width, view.height);
            let mut clip = vec![Vec4::zero(); geometry.positions.len()];
            project(&view.view_projection, geometry.positions, &mut clip);
            let clip32: Vec<Vec4<f32>> = clip.iter().map(|c| c.cast()).collect();
            let visibility = &rasterize(&clip32, geometry.topology.triangles, size.0, size.1, None);
            let mut out = Gradients::new(5, &maps);
            let mut bits = Vec::new();
            for y in (0..size.1).step_by(TILE) {
                let rows = y * size.0..(y + TILE).min(size.1) * size.0;
                let strip = Strip { geometry, view, passes, maps: &maps, clip: &clip, visibility, y };
                let (mut kept, mut color) = (StripSpans::default(), vec![[T::zero(); 4]; rows.len()]);
                strip.shade(most, &mut kept, &mut color);
                let mut back = StripGradients::default();
                strip.shade_vjp(most, &kept, &g[rows], &mut back);
                Scatter::accumulate(&[&back.texels], &mut out.maps);
                bits.extend(color.as_flattened().iter().map(bits_of));
                bits.extend(back.clips.iter().flat_map(|(_, c)| c.each_ref().map(bits_of)));
                bits.extend(back.attributes.as_flattened().as_flattened().iter().map(bits_of));
            }
            let texels = out.maps.levels.iter().flat_map(|l| l.texels.as_flattened());
            bits.extend(texels.map(bits_of));
            bits
        })
    }

    fn loss(&self, weights: &[[f64; 4]], background: &[[f64; 3]], passes: &Passes) -> f64 {
        let frame = self.with(|g, v| render(g, &self.maps(), v, background, passes));
        frame.color.iter().zip(weights).map(|(c, w)| (0..4).map(|k| c[k] * w[k]).sum::<f64>()).sum()
    }

    fn gradients(&self, weights: &[[f64; 4]], background: &[[f64; 3]], passes: &Passes) -> Gradients<f64> {
        let maps = self.maps();
        let mut out = Gradients::new(5, &maps);
        self.with(|g, v| {
            let frame = render(g, &maps, v, background, passes);
            render_vjp(g, &maps, v, passes, &frame, weights, &mut out);
        });
        maps.collapse_vjp(&mut out.maps, MipAdjoint::Exact);
        out
    }
}

fn weights(seed: u64) -> (Vec<[f64; 4]>, Vec<[f64; 3]>) {
    let mut rng = Uniform::new(seed);
    let w = (0..SIZE * SIZE).map(|_| std::array::from_fn(|_| rng.range(-1.0, 1.0))).collect();
    let b = (0..SIZE * SIZE).map(|_| std::array::from_fn(|_| rng.range(0.0, 1.0))).collect();
    (w, b)
}

#[test]
fn gradients_of_vertex_attributes_and_texels() {
    let patch = Patch::new(16, 11);
    let (w, b) = weights(3);
    let passes = Passes::default();
    let g = patch.gradients(&w, &b, &passes);
    let with = |set: &dyn Fn(&mut Patch)| {
        let mut p = Patch::new(16, 11);
        set(&mut p);
        p.loss(&w, &b, &passes)
    };
    let normals: &[f64] = bytemuck::cast_slice(&g.normals);
    check("normals", &patch.normals, normals, 1e-6, 1e-6, |x| with(&|p| p.normals = x.to_vec()));
    let tangents: &[f64] = bytemuck::cast_slice(&g.tangents);
    check("tangents", &patch.tangents, tangents, 1e-6, 1e-6, |x| with(&|p| p.tangents = x.to_vec()));
    let texels = g.maps.levels[0].texels.concat();
    check("texels", &patch.texels, &texels, 1e-6, 1e-6, |x| with(&|p| p.texels = x.to_vec()));
}

#[test]
fn gradients_of_positions_through_the_rendered_image() {
    // Visibility does not change for these steps, so differences of the image are the truth.
    let patch = Patch::new(16, 12);
    let (w, b) = weights(4);
    let passes = Passes::default();
    let g = patch.gradients(&w, &b, &passes);
    let positions: &[f64] = bytemuck::cast_slice(&g.positions);
    check("positions", &patch.positions, positions, 1e-7, 1e-5, |x| {
        let mut p = Patch::new(16, 12);
        p.positions = x.to_vec();
        p.loss(&w, &b, &passes)
    });
}

#[test]
fn gradients_through_transparent_layers() {
    let mut patch = Patch::new(16, 13);
    patch.alpha = vec![AlphaMode::Blend; 4];
    // A second, tilted copy of the outer vertices would need more topology; instead let the patch cover itself by
    // perspective: the frame has one layer, and alpha blends it with the background.
    let (w, b) = weights(5);
    let passes = Passes::default();
    let g = patch.gradients(&w, &b, &passes);
    let texels = g.maps.levels[0].texels.concat();
    assert!(texels.chunks(CHANNELS).any(|t| t[channel::ALPHA] != 0.0), "alpha has a gradient");
    let error = max_relative_error(&patch.texels, &texels, 1e-6, |x| {
        let mut p = Patch::new(16, 13);
        p.alpha = vec![AlphaMode::Blend; 4];
        p.texels = x.to_vec();
        p.loss(&w, &b, &passes)
    });
    assert!(error < 1e-6, "texels with alpha: {error:.2e}");
}

#[test]
fn frozen_parts_get_no_gradient_and_opaque_scenes_one_layer() {
    let patch = Patch::new(8, 14);
    let (w, b) = weights(6);
    let g = patch.gradients(&w, &b, &Passes { position_gradients: false, ..Passes::default() });
    assert!(g.positions.iter().chain(&g.normals).all(|p| *p == Vec3::zero()));
    assert!(g.maps.levels[0].texels.iter().flatten().any(|t| *t != 0.0));
    let moving = patch.gradients(&w, &b, &Passes::default());
    assert_eq!(g.maps.levels[0].texels, moving.maps.levels[0].texels, "colours at silhouettes keep theirs");
    let g = patch.gradients(&w, &b, &Passes { map_gradients: false, ..Passes::default() });
    assert!(g.maps.levels[0].texels.iter().flatten().all(|t| *t == 0.0));
    assert!(g.positions.iter().any(|p| *p != Vec3::zero()));
    let frame = patch.with(|g, v| render(g, &patch.maps(), v, &b, &Passes::default()));
    assert_eq!(frame.layers.len(), 1);
}

#[test]
fn production_precision_agrees_with_double() {
    let patch = Patch::new(16, 15);
    let (w, b) = weights(7);
    let passes = Passes::default();
    let g = patch.gradients(&w, &b, &passes);
    let maps = patch.maps::<f32>();
    let b: Vec<[f32; 3]> = b.iter().map(|b| b.map(|x| x as f32)).collect();
    let w: Vec<[f32; 4]> = w.iter().map(|b| b.map(|x| x as f32)).collect();
    let mut single = Gradients::new(5, &maps);
    patch.with(|geometry, view| {
        let frame = render(geometry, &maps, view, &b, &passes);
        render_vjp(geometry, &maps, view, &passes, &frame, &w, &mut single);
    });
    let scale = g.positions.iter().fold(0.0, |m: f64, p| m.max(p.length()));
    for (a, e) in single.positions.iter().zip(&g.positions) {
        assert!((a.cast::<f64>() - *e).length() < 2e-4 * scale, "{a:?} against {e:?}");
    }
}

/// The patch with 4 x 4 samples of visibility per pixel, shaded once per pixel and triangle.
fn shaded_per_pixel(seed: u64) -> Patch {
    Patch { samples: 4, shade_per_pixel: true, ..Patch::new(16, seed) }
}

#[test]
fn gradients_where_a_pixel_is_shaded_once() {
    let patch = shaded_per_pixel(16);
    let (w, b) = weights(8);
    let passes = Passes::default();
    let g = patch.gradients(&w, &b, &passes);
    let with = |set: &dyn Fn(&mut Patch)| {
        let mut p = shaded_per_pixel(16);
        set(&mut p);
        p.loss(&w, &b, &passes)
    };
    let texels = g.maps.levels[0].texels.concat();
    check("texels", &patch.texels, &texels, 1e-6, 1e-6, |x| with(&|p| p.texels = x.to_vec()));
    let normals: &[f64] = bytemuck::cast_slice(&g.normals);
    check("normals", &patch.normals, normals, 1e-6, 1e-6, |x| with(&|p| p.normals = x.to_vec()));
    let positions: &[f64] = bytemuck::cast_slice(&g.positions);
    check("positions", &patch.positions, positions, 1e-8, 1e-5, |x| with(&|p| p.positions = x.to_vec()));
}

#[test]
fn a_pixel_inside_of_a_triangle_is_shaded_as_with_one_sample() {
    // With the mip level that belongs to the footprint of a pixel.
    let one = Patch { lod_bias: 0.0, ..Patch::new(128, 17) };
    let many = Patch { samples: 4, shade_per_pixel: true, lod_bias: 0.0, ..Patch::new(128, 17) };
    let each = Patch { samples: 4, lod_bias: 0.0, ..Patch::new(128, 17) };
    let (_, b) = weights(9);
    let passes = Passes { antialias: false, ..Passes::default() };
    let frame = |p: &Patch| p.with(|g, v| render(g, &p.maps(), v, &b, &passes));
    let [one, many, each] = [&one, &many, &each].map(frame);
    let triangles = &many.layers[0].visibility.triangle;
    let inside = |i: usize| {
        let (x, y) = (i % SIZE, i / SIZE);
        let of = |k: usize| triangles[(4 * y + k / 4) * SIZE * 4 + 4 * x + k % 4];
        of(0) != NONE && (1..16).all(|k| of(k) == of(0))
    };
    let (mut checked, mut differs) = (0, 0);
    for i in (0..SIZE * SIZE).filter(|i| inside(*i)) {
        for k in 0..4 {
            assert!((one.color[i][k] - many.color[i][k]).abs() < 1e-12, "pixel {i}");
            differs += usize::from((one.color[i][k] - each.color[i][k]).abs() > 1e-3);
        }
        checked += 1;
    }
    assert!(checked > 20, "{checked} pixels lie inside");
    assert!(differs > 50, "samples that are shaded one by one give another colour: {differs}");
    // Coverage is the share of the samples.
    for (i, c) in many.color.iter().enumerate() {
        let (x, y) = (i % SIZE, i / SIZE);
        let covered = |k: &usize| triangles[(4 * y + k / 4) * SIZE * 4 + 4 * x + k % 4] != NONE;
        assert!((c[3] - (0..16).filter(covered).count() as f64 / 16.0).abs() < 1e-12, "pixel {i}");
    }
}

#[test]
fn bits_are_the_same_for_any_width() {
    let mask = AlphaMode::Mask { cutoff: 0.5 };
    let classes = [vec![], vec![AlphaMode::Blend, mask, AlphaMode::Opaque, AlphaMode::Blend]];
    let faded = Passes { masks: Masks::Faded { slope: 2.0 }, ..Passes::default() };
    let compensated = Passes { energy: Energy::Compensated, ..faded };
    let mut cases = vec![];
    for sampling in [(1, false), (2, false), (2, true)] {
        for alpha in &classes {
            cases.push((sampling, alpha, Lights::Lamp, Passes::default()));
        }
        cases.push((sampling, &classes[1], Lights::Sky, faded));
        cases.push((sampling, &classes[0], Lights::None, Passes::default()));
    }
    cases.push(((1, false), &classes[1], Lights::Lamp, compensated));
    cases.push(((2, true), &classes[0], Lights::Sky, compensated));
    for ((samples, shade_per_pixel), alpha, lights, passes) in cases {
        let alpha = alpha.clone();
        let patch =
            Patch { samples, shade_per_pixel, lod_bias: 0.3, alpha, lights, passes, ..Patch::new(9, 4) };
        let mut rng = Uniform::new(6);
        let g: Vec<[f64; 4]> =
            (0..(SIZE * samples).pow(2)).map(|_| std::array::from_fn(|_| rng.range(-1.0, 1.0))).collect();
        let each = |bits: &dyn Fn(Width) -> Vec<u64>, name: &str| {
            let base = bits(Width::Base);
            assert!(base.iter().filter(|b| **b << 1 != 0).count() > 500, "something is drawn");
            for width in Width::ALL {
                assert!(bits(width) == base, "{name}: {samples} samples a side, {lights:?}, {width:?}");
            }
        };
        each(&|width| patch.bits::<f64>(width, &g), "f64");
        each(&|width| patch.bits::<f32>(width, &g), "f32");
    }
}
