//! Whole jobs within a budget of bytes.

use crate::Silent;
use crate::simplify::tests::{Heard, of, options, rock};
use crate::simplify::{SimplifyOptions, simplify};
use photofit_geometry::shapes::displaced_sphere;
use photofit_scalar::vec4;
use photofit_scene::{Instance, Material, Primitive, Scene, TextureEncoding};

/// A rock with stripes in vertex colours beside one that is smooth: colours, normals and roughness have images.
fn striped() -> Scene {
    let mut mesh = displaced_sphere(24, 0.2, 5, 3);
    let stripe =
        |y: f32| if (9.0 * y).sin() > 0.0 { vec4(0.9, 0.2, 0.1, 1.0) } else { vec4(0.1, 0.3, 0.8, 1.0) };
    mesh.colors = mesh.positions.iter().map(|p| stripe(p.y)).collect();
    let mut scene = of(mesh, Material { roughness: 0.4, ..Material::clay() });
    scene.materials.push(Material { roughness: 0.8, ..Material::clay() });
    scene.primitives.push(Primitive { mesh: displaced_sphere(8, 0.1, 2, 5), material: 1 });
    let transform = glam::Affine3A::from_translation(glam::Vec3::new(2.2, 0.0, 0.0));
    scene.instances.push(Instance { primitive: 1, transform });
    scene
}

/// A job with textures of 256 x 256 within a budget, and what was written of it.
struct Budgeted {
    bytes: u64,
    psnr: f64,
    told: String,
    warnings: String,
    encodings: Vec<&'static str>,
}

fn budgeted(asset: &Scene, max_bytes: Option<u64>, texture_encoding: TextureEncoding) -> Budgeted {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    let o = SimplifyOptions {
        texture_size: 256,
        steps: 4,
        report_views: 4,
        max_bytes,
        texture_encoding,
        ..options()
    };
    let heard = Heard::default();
    let outcome = simplify(asset, &path, &o, &heard).unwrap();
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1, "no trial is left");
    let limits = photofit_scene::Limits { keep_encoded: true, ..Default::default() };
    let images = photofit_scene::load_with(&path, &limits).unwrap().images;
    let encoding = |i: &photofit_scene::TextureImage| match i.encoded.as_deref() {
        Some([0xff, 0xd8, ..]) => "JPEG",
        Some([b'R', ..]) => "WebP",
        Some([0xab, ..]) => "KTX2",
        _ => "PNG",
    };
    Budgeted {
        bytes: std::fs::metadata(&path).unwrap().len(),
        psnr: outcome.shipped().unwrap().psnr,
        told: outcome.textures,
        warnings: heard.0.into_inner().unwrap().join("; "),
        encodings: images.iter().map(encoding).collect(),
    }
}

#[test]
fn files_fit_a_budget_of_bytes_with_the_least_loss() {
    let made = |max_bytes| budgeted(&rock(), max_bytes, TextureEncoding::Png);
    let free = made(None);
    assert!(free.told.contains("256 x 256 as PNG"), "{}", free.told);
    let same = made(Some(free.bytes));
    assert_eq!((same.bytes, &same.told), (free.bytes, &free.told), "what fits stays");
    let half = made(Some(free.bytes / 2));
    assert!(half.bytes <= free.bytes / 2 && half.told != free.told, "{} bytes, {}", half.bytes, half.told);
    assert!(half.psnr > free.psnr - 1.0, "{} {}: {}", free.psnr, half.psnr, half.told);
    let fifth = made(Some(free.bytes / 5));
    assert!(
        fifth.bytes <= free.bytes / 5 && fifth.psnr <= half.psnr + 0.5,
        "{} bytes, {}",
        fifth.bytes,
        fifth.told
    );
    assert_eq!(fifth.warnings, "");
    let none = made(Some(100));
    assert!(none.bytes > 100 && none.bytes < fifth.bytes, "{}", none.bytes);
    assert!(none.warnings.contains("no file of 100 bytes"), "{}", none.warnings);
}

/// Of several images the one that matters keeps more: colour stripes and a map of roughness that hardly varies. Lossy and
/// exact WebP, JPEG and KTX 2.0 alike.
#[test]
fn images_share_a_budget_by_what_they_lose() {
    let asset = striped();
    for (encoding, allowed) in [
        (TextureEncoding::Png, &["PNG", "JPEG"][..]),
        (TextureEncoding::WebP, &["WebP", "JPEG"]),
        (TextureEncoding::Ktx2 { quality: 100 }, &["KTX2"]),
    ] {
        let free = budgeted(&asset, None, encoding);
        assert!(free.encodings.len() >= 2, "{}", free.told);
        let third = budgeted(&asset, Some(free.bytes / 3), encoding);
        println!("{encoding:?}: {} {} -> {} {}", free.bytes, free.told, third.bytes, third.told);
        assert!(
            third.bytes <= free.bytes / 3 && third.warnings.is_empty(),
            "{} {}",
            third.bytes,
            third.warnings
        );
        assert!(third.encodings.iter().all(|e| allowed.contains(e)), "{:?}", third.encodings);
        assert!(third.psnr > free.psnr - 2.0, "{} {}: {}", free.psnr, third.psnr, third.told);
        let words: Vec<&str> = third.told.split(", ").collect();
        assert!(words.len() >= 2, "images are stored apart: {}", third.told);
    }
}

#[test]
fn triangles_follow_from_bytes_and_whole_assets_are_not_fitted() {
    let asset = striped();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    let made = |most: u64| {
        let o = SimplifyOptions {
            max_bytes: Some(most),
            triangles_by_bytes: true,
            own_textures: true,
            steps: 2,
            ..options()
        };
        let outcome = simplify(&asset, &path, &o, &Silent).unwrap();
        (outcome, std::fs::metadata(&path).unwrap().len())
    };
    let all = asset.triangle_count();
    let whole = photofit_scene::to_glb_with(&asset, photofit_scene::Compression::None).unwrap().len() as u64;
    let (outcome, bytes) = made(whole + 100);
    assert_eq!((outcome.triangles_out, outcome.steps, bytes <= whole + 100), (all, 0, true));
    assert!(outcome.shipped().unwrap().psnr > 45.0, "{:?}", outcome.stages);
    let (outcome, bytes) = made(whole * 9 / 10);
    assert!(outcome.steps == 2 && bytes <= whole, "{} steps, {bytes} bytes of {whole}", outcome.steps);
    assert!((all / 4..all).contains(&outcome.triangles_out), "{} of {all}", outcome.triangles_out);
    let alone = SimplifyOptions { triangles_by_bytes: true, ..options() };
    assert!(alone.check(all).unwrap_err().to_string().contains("needs max_bytes"));
}
