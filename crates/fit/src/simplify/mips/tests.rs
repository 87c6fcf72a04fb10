//! What goes with free mip levels, and what they are worth on a small glossy asset.

use super::super::tests::of;
use super::super::{Effort, JudgeRenderer, Quality, simplify};
use super::*;
use crate::Silent;
use crate::engine::Normalised;
use crate::engine::judge::{Judge, Stage, flicker};
use crate::engine::reference::{Rasterized, samples_for};
use crate::engine::views::Lighting;
use photofit_geometry::decimate::Target;
use photofit_geometry::shapes;
use photofit_scalar::vec3;
use photofit_scene::{Material, Scene, TextureImage, TextureSlot};

fn free() -> SimplifyOptions {
    let texture_encoding = TextureEncoding::Ktx2 { quality: 90 };
    SimplifyOptions { mips: Mips::Free, texture_encoding, ..SimplifyOptions::default() }
}

#[test]
fn free_levels_need_files_that_hold_them_and_maps_that_are_fitted() {
    let refused = |o: SimplifyOptions| o.check(500).unwrap_err().to_string();
    free().check(500).unwrap();
    for encoding in [TextureEncoding::Png, TextureEncoding::Jpeg { quality: 9 }, TextureEncoding::WebP] {
        let told = refused(SimplifyOptions { texture_encoding: encoding, ..free() });
        assert!(told.starts_with("mips is free; it needs ktx2 textures"), "{told}");
    }
    let told = refused(SimplifyOptions { appearance: Appearance::VertexColors, ..free() });
    assert!(told.contains("needs new maps"), "{told}");
    let told = refused(SimplifyOptions { texture_size: 102, ..free() });
    assert!(told.contains("multiple of 4"), "{told}");
    let told = refused(SimplifyOptions { smallest_size: 8, ..free() });
    assert_eq!(told, "smallest_size is 8; it must be 16 to 4096");
    SimplifyOptions { smallest_size: 8, ..SimplifyOptions::default() }.check(500).unwrap();
}

#[test]
fn coarse_texels_of_several_kinds_of_surfaces_are_refused() {
    let class = |written: AlphaMode, drawn: AlphaMode, unlit: bool| MaterialClass {
        written,
        drawn,
        unlit,
        ..MaterialClass::PLAIN
    };
    let (opaque, blend) = (AlphaMode::Opaque, AlphaMode::Blend);
    let lit = class(opaque, opaque, false);
    let unlit = class(opaque, opaque, true);
    let glass = MaterialClass { see_through: Some(0.25), ..class(opaque, blend, false) };
    let hazy = MaterialClass { written: blend, ..glass.clone() };
    let leaf = class(blend, blend, false);
    let refused =
        |classes: &[&MaterialClass]| check_classes(&free(), classes).map_err(|e| e.to_string()).err();
    assert_eq!(refused(&[&lit, &glass]), None);
    assert!(refused(&[&lit, &unlit]).is_some_and(|e| e.contains("all lit or all unlit")));
    assert!(refused(&[&glass, &leaf]).is_some_and(|e| e.contains("without alpha")));
    assert!(refused(&[&hazy]).is_some_and(|e| e.contains("without alpha")));
    check_classes(&SimplifyOptions::default(), &[&lit, &unlit, &glass, &leaf]).unwrap();
    // An asset has the plain class though none of its triangles do.
    let scene = of(shapes::cube(), Material { unlit: true, ..Material::clay() });
    let n = Normalised::new(&scene).unwrap();
    assert_eq!((n.light_asset.classes.len(), refused(&n.used_classes())), (2, None));
}

#[test]
fn a_step_sees_as_many_pixels_as_one_of_classic_levels() {
    let side = |smallest_size| SimplifyOptions { smallest_size, ..free() }.mean_side();
    assert_eq!((side(512), side(16), side(1000)), (512, 194, 512));
    assert_eq!(SimplifyOptions::default().mean_side(), 512);
    let batch = |o: SimplifyOptions| (o.batch_of_steps().pictures(), o.batch_of_steps().fresh());
    assert_eq!((batch(SimplifyOptions::default()), batch(free())), ((2, 1), (4, 1)));
    let engine = SimplifyOptions { as_engine: true, resolution: 32, batch: 3, ..SimplifyOptions::default() };
    assert_eq!(
        batch(engine),
        (3 * crate::simplify::MOST_REPLAYS, 2),
        "small pictures are seen again, not made anew"
    );
    assert_eq!(free().picture_size(), 512, "pixels as an engine shades them");
}

/// A glossy metal ball with bumps that no vertex shows.
fn ball() -> Scene {
    let (width, height) = (256, 128);
    let normal = |i: usize| {
        let (x, y) = ((i % width) as f32, (i / width) as f32);
        let wave = |t: f32| 0.5 * (0.9 * t).sin() + 0.3 * (0.37 * t + 1.0).sin();
        let n = vec3(wave(x), wave(y + 0.3 * x), 1.0).normalize_or_zero();
        let [x, y, z] = n.to_array().map(|x| (127.5 + 127.5 * x) as u8);
        [x, y, z, 255]
    };
    let slot = TextureSlot::new(0);
    let glossy = Material { metallic: 1.0, roughness: 0.3, normal_texture: Some(slot), ..Material::clay() };
    let texels = (0..width * height).map(normal).collect();
    let images = vec![TextureImage { width, height, texels, ..TextureImage::default() }];
    Scene { images, ..of(shapes::uv_sphere(48, 24), glossy) }
}

/// Quality of written files in pictures of a size, one sample a pixel, and their flicker.
fn at_size(scene: &Scene, files: &[Scene], size: usize) -> Vec<(Quality, f64)> {
    let n = Normalised::new(scene).unwrap();
    let reference = Rasterized::new(&n.flat, &n.library).sampled_by_size(1);
    let judge = Judge {
        scene,
        n: &n,
        reference: &reference,
        renderer: JudgeRenderer::Raster,
        spp: 1,
        lighting: &Lighting::Mixed,
        size,
        samples: [samples_for(size), 1],
        seed: 7,
    };
    let stages: Vec<Stage> = files.iter().map(|f| Stage::new("file", f.clone())).collect();
    let views = judge.views(&stages, 8, &Silent).unwrap();
    let flicker = flicker(&n.light_asset, &reference, &stages, &Lighting::Mixed, (size, 4, 7)).unwrap();
    let mean = |k: usize| Quality::mean(views.iter().map(|v| &v.quality[k].quality));
    (0..stages.len()).map(mean).zip(flicker).collect()
}

#[test]
#[ignore = "slow: fits of both kinds of levels, judged at three sizes"]
fn free_levels_look_better_than_averages_at_small_sizes() {
    let dir = tempfile::tempdir().unwrap();
    let scene = ball();
    let written = |mips: Mips| {
        let path = dir.path().join(format!("{}.glb", mips.name()));
        let fit = SimplifyOptions {
            mips,
            target: Target::Triangles(1200),
            steps: 150,
            report_views: 1,
            own_textures: false,
            ..free().with_effort(Effort::Fast).for_screen_size(64.0)
        };
        let outcome = simplify(&scene, &path, &fit, &Silent).unwrap();
        let told = outcome.plan.items().iter().any(|i| i.what == "free mip levels");
        assert_eq!(told, mips == Mips::Free, "{}", outcome.plan);
        photofit_scene::load(&path).unwrap()
    };
    let files = [Mips::Classic, Mips::Free].map(written);
    assert!(files.iter().all(|f| f.images.iter().all(|i| i.mips.len() == 7)), "128 x 128 and all its levels");
    for size in [16, 32, 64] {
        let [(classic, before), (free, flicker)] = at_size(&scene, &files, size)[..] else {
            panic!("two files")
        };
        for (name, q, flicker) in [("classic", classic, before), ("free", free, flicker)] {
            let Quality { psnr, flip, luminance, .. } = q;
            println!("| {size} | {name} | {psnr:.2} | {flip:.3} | {luminance:.3} | {flicker:.2} |");
        }
        let (gain, flip) = (free.psnr - classic.psnr, free.flip / classic.flip);
        let [least, most] = if size > 32 { [-0.4, 1.05] } else { [0.4, 0.9] };
        assert!(gain > least && flip < most, "{size} pixels: {gain} dB, {flip} of the FLIP");
        assert!(flicker < 1.2, "{size} pixels: {flicker}");
    }
}
