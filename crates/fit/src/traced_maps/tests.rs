//! A plate with a deep pit, and a flat plate that is to look like it.

use super::*;
use crate::Silent;
use crate::engine::judge::view_quality;
use crate::engine::reference::Reference;
use crate::engine::views::{Set, Views};
use photofit_geometry::{Mesh, shapes};
use photofit_scalar::{Vec3f, vec2, vec3};
use photofit_scene::{AlphaMode, Instance, Material, Primitive};

/// Half of the side of the pit; its depth is twice as much.
const PIT: f32 = 0.2;

fn asset(meshes: Vec<Mesh>) -> Scene {
    let mut out = Scene::default();
    out.materials.push(Material { base_color: [0.8, 0.7, 0.6, 1.0], roughness: 1.0, ..Material::clay() });
    for mut mesh in meshes {
        mesh.normals = photofit_geometry::normals::mesh_normals(&mesh);
        out.primitives.push(Primitive { mesh, material: 0 });
        out.instances
            .push(Instance { primitive: out.primitives.len() - 1, transform: glam::Affine3A::IDENTITY });
    }
    out
}

/// A sheet in the plane y = 0 that looks up.
fn sheet([x0, x1]: [f32; 2], [z0, z1]: [f32; 2]) -> Mesh {
    shapes::parallelogram(vec3(x0, 0.0, z0), vec3(0.0, 0.0, z1 - z0), vec3(x1 - x0, 0.0, 0.0))
}

/// The plate [-1, 1] x [-1, 1] with a pit in its middle.
fn pitted() -> Scene {
    let (a, d) = (PIT, -2.0 * PIT);
    let wall = |corner: Vec3f, u: Vec3f| shapes::parallelogram(corner, u, vec3(0.0, -d, 0.0));
    let mut floor = sheet([-a, a], [-a, a]);
    floor.positions.iter_mut().for_each(|p| p.y = d);
    asset(vec![
        sheet([-1.0, -a], [-1.0, 1.0]),
        sheet([a, 1.0], [-1.0, 1.0]),
        sheet([-a, a], [-1.0, -a]),
        sheet([-a, a], [a, 1.0]),
        floor,
        wall(vec3(-a, d, -a), vec3(2.0 * a, 0.0, 0.0)),
        wall(vec3(a, d, a), vec3(-2.0 * a, 0.0, 0.0)),
        wall(vec3(-a, d, a), vec3(0.0, 0.0, -2.0 * a)),
        wall(vec3(a, d, -a), vec3(0.0, 0.0, 2.0 * a)),
    ])
}

fn flat() -> Scene {
    let mut mesh = sheet([-1.0, 1.0], [-1.0, 1.0]);
    mesh.uvs = mesh.positions.iter().map(|p| vec2(0.5 + 0.5 * p.x, 0.5 + 0.5 * p.z)).collect();
    asset(vec![mesh])
}

fn options() -> TracedMapsOptions {
    TracedMapsOptions {
        steps: 60,
        size: 48,
        spp: 8,
        reference_spp: 32,
        new_map: Some(32),
        ..TracedMapsOptions::default()
    }
}

fn fitted(threads: usize) -> (Scene, Normalised, TracedMaps) {
    let heavy = pitted();
    let n = Normalised::new(&heavy).expect("an asset");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    let made = pool.install(|| traced_maps(&heavy, &n, &flat(), &options(), &Silent)).expect("fits");
    (heavy, n, made)
}

/// Mean of the green of texels whose distance from the middle, along the farther axis, lies in a range.
fn mean(light: &Scene, range: [f32; 2]) -> f32 {
    let image = &light.images[0];
    let at = |i: usize| 2.0 * (i as f32 + 0.5) / image.width as f32 - 1.0;
    let (mut sum, mut count) = (0.0, 0.0);
    for (i, texel) in image.texels.iter().enumerate() {
        let far = at(i % image.width).abs().max(at(i / image.width).abs());
        if (range[0]..range[1]).contains(&far) {
            sum += photofit_image::srgb_u8_to_linear(texel[1]);
            count += 1.0;
        }
    }
    sum / count
}

#[test]
fn a_lost_pit_darkens_the_map_where_it_was() {
    let (heavy, n, made) = fitted(2);
    let [pit, plate] = [[0.0, PIT - 0.05], [PIT + 0.1, 0.9]].map(|r| mean(&made.light, r));
    println!(
        "pit {pit:.3}, plate {plate:.3}, {:?}",
        made.course.history.iter().map(|h| h.quality).collect::<Vec<_>>()
    );
    assert!((plate - 0.7).abs() < 0.05, "the plate keeps its colour: {plate}");
    assert!(pit < 0.75 * plate, "the pit is in shadow: {pit} of {plate}");
    // Looked at from views that the fit never saw, drawn by the path tracer.
    let target = PathTraced::new(&heavy, &n, MaterialFeatures::Core, 7).expect("a scene");
    let views = Orbit::new(5, &Lighting::default(), 64);
    let quality = |scene: &Scene| {
        let drawn = PathTraced::new(scene, &n, MaterialFeatures::Core, 8).expect("a scene");
        let of = |i| {
            let s = views.setup(Set::Report, i, 6);
            let picture = |r: &PathTraced<'_>| r.picture(&s).expect("a picture").image;
            view_quality(&picture(&target), &picture(&drawn)).quality.psnr
        };
        (0..6).map(of).sum::<f64>() / 6.0
    };
    let (before, after) = (quality(&flat()), quality(&made.light));
    assert!(after > before + 1.0, "{before:.2} dB became {after:.2}");
}

#[test]
fn maps_of_more_texels_than_pixels_move_by_corrections_of_their_start() {
    let heavy = pitted();
    let n = Normalised::new(&heavy).expect("an asset");
    let dir = tempfile::tempdir().expect("a folder");
    let kept = |resume| Checkpointing { checkpoint: Some(dir.path().into()), resume, time_limit: None };
    // Cells of 4 x 4 texels.
    let coarse = TracedMapsOptions { size: 16, new_map: Some(64), checkpointing: kept(false), ..options() };
    let made = traced_maps(&heavy, &n, &flat(), &coarse, &Silent).expect("fits");
    assert!(made.course.gained(), "{:?}", made.course.history);
    let told = made
        .course
        .plan
        .items
        .iter()
        .any(|i| i.why.contains("1 of them moved in cells of up to 4 x 4 texels"));
    assert!(told, "{:?}", made.course.plan.items);
    let [pit, plate] = [[0.0, PIT - 0.1], [PIT + 0.2, 0.9]].map(|r| mean(&made.light, r));
    println!("pit {pit:.3}, plate {plate:.3}");
    assert!(pit < 0.9 * plate, "the pit is in shadow: {pit} of {plate}");
    // Neighbours differ by a part of what cells differ by, where texels that move alone hold noise.
    let texels = &made.light.images[0].texels;
    let apart = |i: &usize| i32::from(texels[*i][1]).abs_diff(i32::from(texels[*i + 1][1]));
    let most = (0..64 * 64 - 1).filter(|i| i % 64 != 63).map(|i| apart(&i)).max();
    assert!(most < Some(30), "{most:?}");
    // A correction of other maps is another fit.
    let mut other = flat();
    other.materials[0].base_color[1] = 0.5;
    let again = TracedMapsOptions { checkpointing: kept(true), ..coarse };
    let refused = traced_maps(&heavy, &n, &other, &again, &Silent).unwrap_err().to_string();
    assert!(refused.contains("maps of the light asset"), "{refused}");
}

#[test]
fn maps_of_two_alpha_modes_on_one_image_are_both_written() {
    // Two sheets, the right one cut out by its alpha of 1, on halves of one image.
    let heavy = pitted();
    let n = Normalised::new(&heavy).expect("an asset");
    let mut light = flat();
    add_maps(&mut light, 32);
    let mut mesh = light.primitives[0].mesh.clone();
    let half = |mesh: &mut Mesh, x0: f32| {
        for (p, uv) in mesh.positions.iter_mut().zip(&mut mesh.uvs) {
            p.x = x0 + 0.5 * (p.x + 1.0);
            uv.x = 0.5 + 0.5 * p.x;
        }
    };
    half(&mut light.primitives[0].mesh, -1.0);
    half(&mut mesh, 0.0);
    let masked = Material { alpha_mode: AlphaMode::Mask { cutoff: 0.5 }, ..light.materials[0].clone() };
    light.materials.push(masked);
    light.primitives.push(Primitive { mesh, material: 1 });
    light.instances.push(Instance { primitive: 1, transform: glam::Affine3A::IDENTITY });
    let options = TracedMapsOptions { new_map: None, ..options() };
    let made = traced_maps(&heavy, &n, &light, &options, &Silent).expect("fits");
    let image = &made.light.images[0];
    let dark = |x: usize| photofit_image::srgb_u8_to_linear(image.texels[16 * 32 + x][1]);
    assert!(dark(14) < 0.5 && dark(17) < 0.5, "the pit lies on both: {} {}", dark(14), dark(17));
}

#[test]
fn the_same_bits_on_one_thread_and_two() {
    let texels = |threads| fitted(threads).2.light.images.remove(0).texels;
    assert_eq!(texels(1), texels(2));
}

#[test]
fn a_light_asset_without_maps_is_refused_unless_it_may_get_one() {
    let heavy = pitted();
    let n = Normalised::new(&heavy).expect("an asset");
    let refused = TracedMapsOptions { new_map: None, ..options() };
    let text = traced_maps(&heavy, &n, &flat(), &refused, &Silent).unwrap_err().to_string();
    assert!(text.contains("has no map of base colour"), "{text}");
    let text = traced_maps(&heavy, &n, &heavy, &options(), &Silent).unwrap_err().to_string();
    assert!(text.contains("has no map"), "without texture coordinates none can be made: {text}");
}
