//! A ball over a floor whose materials are known, and found again.

use super::*;
use crate::Silent;
use crate::engine::chain::part_folder;
use photofit_geometry::{Mesh, shapes};
use photofit_image::downsample;
use photofit_scalar::{vec2, vec3};
use photofit_scene::{Instance, Material, Primitive, TextureImage, TextureSlot};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

const TEXELS: usize = 16;

/// A slot of an image.
fn slot(image: usize) -> Option<TextureSlot> {
    Some(TextureSlot::new(image))
}

/// A floor with a map of colours, and a ball with one of roughness on it.
fn asset() -> Scene {
    let image = |name: &str, texel: &dyn Fn(usize, usize) -> [u8; 4]| TextureImage {
        name: name.into(),
        width: TEXELS,
        height: TEXELS,
        texels: (0..TEXELS * TEXELS).map(|i| texel(i % TEXELS, i / TEXELS)).collect(),
        ..TextureImage::default()
    };
    let mut scene = Scene {
        images: vec![
            image("colors", &|x, y| {
                if (x / 8 + y / 8) % 2 == 0 { [210, 80, 50, 255] } else { [60, 110, 190, 255] }
            }),
            image("roughness", &|_, y| [255, if y < 8 { 60 } else { 200 }, 0, 255]),
        ],
        materials: vec![
            Material { base_color_texture: slot(0), metallic: 0.0, roughness: 0.8, ..Material::default() },
            Material {
                base_color: [0.7, 0.6, 0.4, 1.0],
                metallic_roughness_texture: slot(1),
                ..Material::default()
            },
        ],
        ..Scene::default()
    };
    let mut floor = shapes::parallelogram(vec3(-1.0, 0.0, -1.0), vec3(0.0, 0.0, 2.0), vec3(2.0, 0.0, 0.0));
    floor.uvs = floor.positions.iter().map(|p| vec2(0.5 + 0.5 * p.x, 0.5 + 0.5 * p.z)).collect();
    let mut ball = shapes::uv_sphere(24, 12);
    ball.positions.iter_mut().for_each(|p| *p = *p * 0.45 + vec3(0.0, 0.5, 0.0));
    for (material, mesh) in [floor, ball].into_iter().enumerate() {
        scene.primitives.push(Primitive { mesh, material });
        scene.instances.push(Instance { primitive: material, transform: glam::Affine3A::IDENTITY });
    }
    scene
}

/// Cameras from above.
fn above(asset: &Scene, count: usize) -> Vec<View> {
    let mut views = around(asset, 2 * count).expect("an asset");
    views.truncate(count);
    views.reverse();
    views
}

fn options() -> RecoverMaterialOptions {
    RecoverMaterialOptions {
        texture_size: TEXELS,
        environment_size: 4,
        steps: 60,
        spp: 8,
        gradient_spp: 2,
        max_depth: 3,
        ..RecoverMaterialOptions::default()
    }
}

fn known(asset: &Scene, background: bool) -> KnownMaterial<'_> {
    KnownMaterial::new(asset, &first_sky(), above(asset, 5), (24, 64), background, 0).expect("renders")
}

fn found(asset: &Scene, known: &KnownMaterial<'_>, options: &RecoverMaterialOptions) -> RecoveredMaterial {
    recover_material(asset, &known.views, &known.pictures, options, &Silent).expect("fits")
}

#[test]
fn colours_and_light_are_found_again_with_every_guide() {
    let asset = asset();
    let known = known(&asset, false);
    let none = found(&asset, &known, &RecoverMaterialOptions { steps: 0, ..options() });
    let start = known.errors(&none.asset).unwrap();
    for kind in [Guiding::Off, Guiding::Lobes, Guiding::Flow] {
        let guiding = GuidingOptions { least_gain: 0.0, ..guiding(kind) };
        let r = found(&asset, &known, &RecoverMaterialOptions { guiding, ..options() });
        let end = known.errors(&r.asset).unwrap();
        println!("{kind:?}: {start:?} -> {end:?}");
        assert!(end.scaled_albedo < 0.6 * start.scaled_albedo, "{kind:?}: {start:?} {end:?}");
        assert!(end.scaled_relit > start.scaled_relit + 3.0, "{kind:?}: {start:?} {end:?}");
        assert_eq!((r.steps, r.held_out, r.unwrapped), (60, Some(4), false));
        let guided = usize::from(kind != Guiding::Off);
        assert!(
            r.guides.len() == guided && r.guides.iter().all(|g| g.used && g.records > 0),
            "{:?}",
            r.guides
        );
        // What is bright in the sky is found brighter than the rest; it starts even.
        let sky = downsample(&first_sky(), 8);
        let mean = sky.data.iter().sum::<f32>() / sky.data.len() as f32;
        let of = |is_bright: bool| {
            let at = (0..sky.data.len()).filter(|i| (sky.data[*i] > mean) == is_bright);
            let all: Vec<f32> = at.map(|i| r.environment.data[i]).collect();
            all.iter().sum::<f32>() / all.len() as f32
        };
        assert!(of(true) > of(false), "{kind:?}: {} {}", of(true), of(false));
    }
}

#[test]
fn errors_of_what_is_known_are_nothing_but_noise() {
    let asset = asset();
    let known = known(&asset, false);
    let e = known.errors(&asset).unwrap();
    assert_eq!((e.albedo, e.roughness, e.metallic), (0.0, 0.0, 0.0));
    assert!(e.albedo_scale.iter().all(|k| (k - 1.0).abs() < 1e-6) && e.relit > 30.0, "{e:?}");
    // A darker asset is found out, and told apart from one in other light.
    let mut dark = asset.clone();
    for m in &mut dark.materials {
        m.base_color = [0.5 * m.base_color[0], 0.5 * m.base_color[1], 0.5 * m.base_color[2], 1.0];
        (m.roughness, m.metallic) = (0.5 * m.roughness, m.metallic + 0.25 * (1.0 - m.metallic));
    }
    let e = known.errors(&dark).unwrap();
    assert!(e.albedo > 0.05 && e.scaled_albedo < 1e-4 && (e.albedo_scale[0] - 2.0).abs() < 1e-3, "{e:?}");
    assert!(e.roughness > 0.1 && e.metallic > 0.0 && e.relit < 30.0, "{e:?}");
}

/// Says stop at the n-th question.
struct Stop(AtomicUsize, usize);

impl Progress for Stop {
    fn report(&self, _: &'static str, _: u64, _: u64, _: &str) {}

    fn is_cancelled(&self) -> bool {
        self.0.fetch_add(1, Ordering::Relaxed) >= self.1
    }
}

#[test]
fn a_stopped_guided_fit_goes_on_to_the_same_bits() {
    let asset = asset();
    let known = known(&asset, false);
    let dir = tempfile::tempdir().unwrap();
    let guiding = GuidingOptions { least_gain: 0.0, ..guiding(Guiding::Flow) };
    let run = |folder: Option<&Path>, resume, stop: usize, threads: usize| {
        let checkpointing =
            Checkpointing { checkpoint: folder.map(Path::to_owned), resume, time_limit: None };
        let options = RecoverMaterialOptions { guiding, steps: 20, checkpointing, ..options() };
        let stop = Stop(AtomicUsize::new(0), stop);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| recover_material(&asset, &known.views, &known.pictures, &options, &stop)).unwrap()
    };
    let whole = run(None, false, usize::MAX, 2);
    // While the guide of the second round learns from 5 views in 4 rounds, with a pilot run without it and with it.
    let asked = 5 * (4 + 2) + 1;
    let folder = dir.path();
    let cut = run(Some(folder), false, 14 + asked / 2, 1);
    assert!(cut.stopped && cut.steps == 10 && cut.guides.is_empty(), "{} {:?}", cut.steps, cut.guides);
    assert!(!part_folder(folder, 1).join("fit.ckpt").exists(), "the round has not begun");
    // In the second round.
    let cut = run(Some(folder), true, 5 + asked, 1);
    assert!(cut.stopped && (10..20).contains(&cut.steps), "{}", cut.steps);
    assert!(part_folder(folder, 1).is_dir());
    let end = run(Some(folder), true, usize::MAX, 1);
    assert!(end.resumed >= 10 && end.steps == 20, "{} {}", end.resumed, end.steps);
    assert!(end.asset.images == whole.asset.images && end.environment.data == whole.environment.data);
    for k in 0..whole.model.parameters.len() {
        assert!(whole.model.of(k) == end.model.of(k), "{}", whole.model.parameters[k].name);
    }
}

#[test]
fn meshes_without_texture_coordinates_get_an_atlas_and_others_keep_theirs() {
    let asset = asset();
    let known = known(&asset, true);
    let short =
        RecoverMaterialOptions { steps: 2, rounds: 1, background: true, normal_map: true, ..options() };
    let own = found(&asset, &known, &short);
    assert!(!own.unwrapped && own.asset.primitives[1].mesh.uvs == asset.primitives[1].mesh.uvs);
    assert_eq!((own.asset.materials.len(), own.asset.images.len()), (2, 6), "a set for each material");
    assert!(own.model.parameters.iter().any(|p| p.name.starts_with("normals")));
    let mut bare = asset.clone();
    bare.primitives[1].mesh.uvs.clear();
    for (mesh, unwrap) in [(&bare, false), (&asset, true)] {
        let r = found(mesh, &known, &RecoverMaterialOptions { unwrap, normal_map: false, ..short.clone() });
        assert!(r.unwrapped && r.asset.images.len() == 2, "one set");
        let mesh: &Mesh = &r.asset.primitives[0].mesh;
        assert_eq!(mesh.uvs.len(), mesh.positions.len());
    }
}

#[test]
fn what_cannot_be_used_is_refused() {
    let asset = asset();
    let known = known(&asset, false);
    let fails = |mesh: &Scene, views: &[View], pictures: &[Image], options: &RecoverMaterialOptions| {
        recover_material(mesh, views, pictures, options, &Silent).unwrap_err().to_string()
    };
    let (v, p) = (&known.views[..], &known.pictures[..]);
    assert!(fails(&asset, v, &p[1..], &options()).contains("are 4; they must be 5"));
    assert!(fails(&asset, &[], &[], &options()).contains("are 0; they must be 1"));
    let mut sizes = p.to_vec();
    sizes[2] = Image::new(8, 8, 4);
    assert!(fails(&asset, v, &sizes, &options()).contains("8 x 8"));
    let mut nan = p.to_vec();
    nan[1].data[4 * 30 + 1] = f32::NAN;
    assert!(fails(&asset, v, &nan, &options()).contains("(6, 1)"));
    assert!(fails(&Scene::default(), v, p, &options()).contains("no geometry"));
    let empty: Vec<Image> = p.iter().map(|i| Image::new(i.width, i.height, 4)).collect();
    assert!(fails(&asset, v, &empty, &options()).contains("in no pixel whole"));
    for (field, wrong) in [
        ("texture_size", RecoverMaterialOptions { texture_size: 8, ..options() }),
        ("environment_size", RecoverMaterialOptions { environment_size: 0, ..options() }),
        ("rounds", RecoverMaterialOptions { rounds: 9, ..options() }),
        ("rate", RecoverMaterialOptions { rate: 0.0, ..options() }),
    ] {
        let text = fails(&asset, v, p, &wrong);
        assert!(text.starts_with(field) && text.contains("must be"), "{text}");
    }
    let none = RecoverMaterialOptions { keep_environment: true, steps: 1, rounds: 1, ..options() };
    let kept = found(&asset, &known, &none);
    assert!(kept.environment.data.iter().all(|v| *v == kept.environment.data[0]), "it stays even");
}
