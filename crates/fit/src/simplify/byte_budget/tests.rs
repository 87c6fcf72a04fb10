//! Whole jobs within a budget of bytes.

mod counted;

use super::{Budget, Files, Made, as_asked};
use crate::engine::reference::Rasterized;
use crate::simplify::tests::{Heard, Watching, of, options, rock, tiled};
use crate::simplify::{
    Appearance, FitRenderer, Judged, Outcome, ReferenceRenderer, SimplifyOptions, Written, simplify,
    with_asset,
};
use crate::{Progress, Silent};
use photofit_geometry::decimate::Target;
use photofit_geometry::shapes::{displaced_sphere, uv_sphere};
use photofit_scalar::vec4;
use photofit_scene::{
    Compression, Extensions, Instance, Material, Precision, Primitive, Scene, TextureEncoding, TextureImage,
    Transmission, Volume,
};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Textures that are stored alike are told together, by their names where others are stored otherwise.
#[test]
fn textures_are_told_by_name_where_they_differ() {
    let image =
        |name: &str, width| TextureImage { name: name.into(), width, height: 8, ..TextureImage::default() };
    let told = |images: &[(&str, usize)]| {
        let images = images.iter().map(|(name, width)| image(name, *width)).collect();
        super::told(&Scene { images, ..Scene::default() })
    };
    assert_eq!(told(&[]), "none");
    assert_eq!(told(&[("a", 8), ("b", 8)]), "8 x 8 as PNG");
    assert_eq!(told(&[("a", 8), ("", 16), ("c", 8)]), "\"a\", \"c\" 8 x 8 as PNG; image 1 16 x 8 as PNG");
    assert!(
        told(&[("\u{1b}[31m\n", 8), ("b", 16)]).starts_with("\"\\u{1b}[31m\\n\" 8 x 8"),
        "no control characters"
    );
    let six = [("a", 8), ("b", 8), ("c", 8), ("d", 8), ("e", 8), ("f", 16)];
    assert_eq!(told(&six), "\"a\", \"b\", \"c\", \"d\" and 1 more 8 x 8 as PNG; \"f\" 16 x 8 as PNG");
}

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
    let images = photofit_scene::load_with(&outcome.file, &limits).unwrap().images;
    let encoding = |i: &TextureImage| match i.encoded.as_deref() {
        Some([0xff, 0xd8, ..]) => "JPEG",
        Some([b'R', ..]) => "WebP",
        Some([0xab, ..]) => "KTX2",
        _ => "PNG",
    };
    Budgeted {
        bytes: std::fs::metadata(&outcome.file).unwrap().len(),
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
    assert!(none.warnings.contains("no file of 100 bytes was found"), "{}", none.warnings);
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
        let words: Vec<&str> = third.told.split("; ").collect();
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
    let whole = photofit_scene::to_glb_with(&asset, Compression::None).unwrap().len() as u64;
    let (outcome, bytes) = made(whole + 100);
    assert_eq!((outcome.triangles_out, outcome.steps, bytes <= whole + 100), (all, 0, true));
    assert!(outcome.shipped().unwrap().psnr > 45.0, "{:?}", outcome.stages);
    assert_eq!(outcome.written, Written::Decimated);
    let verdict = crate::report::Verdict::of(&outcome).to_string();
    assert!(!verdict.contains("as it was given") && !verdict.contains("no fit"), "{verdict}");
    let (outcome, bytes) = made(whole * 9 / 10);
    assert!(outcome.steps == 2 && bytes <= whole, "{} steps, {bytes} bytes of {whole}", outcome.steps);
    assert!((all / 4..all).contains(&outcome.triangles_out), "{} of {all}", outcome.triangles_out);
    let alone = SimplifyOptions { triangles_by_bytes: true, ..options() };
    assert!(alone.check(all).unwrap_err().to_string().contains("needs max_bytes"));
}

/// Many instances of one mesh take fewer bytes than a mesh of all of them: such an asset is written as it was given.
#[test]
fn an_asset_that_fits_only_as_it_is_is_written_so() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    let mut asset = striped();
    let beside = |k: usize| glam::Affine3A::from_translation(glam::Vec3::X * 2.5 * k as f32);
    asset.instances = (0..6).map(|k| Instance { primitive: 0, transform: beside(k) }).collect();
    let whole = photofit_scene::to_glb(&asset).unwrap().len() as u64;
    let o = SimplifyOptions {
        max_bytes: Some(whole + 100),
        triangles_by_bytes: true,
        own_textures: true,
        steps: 2,
        ..options()
    };
    let made = simplify(&asset, &path, &o, &Silent).unwrap();
    assert_eq!((made.written, made.triangles_out), (Written::Whole, asset.triangle_count()));
    assert_eq!(made.steps, 0, "that it fits is known before a fit");
    assert_eq!(photofit_scene::load(&path).unwrap().instances.len(), 6);
    let verdict = crate::report::Verdict::of(&made).to_string();
    assert!(verdict.contains("the asset as it was given, which has few enough bytes"), "{verdict}");
}

/// The source, as it is, stands in for a file that is too large or has fewer triangles.
#[test]
fn the_source_is_written_where_nothing_else_has_its_triangles_within_the_bytes() {
    let asset = striped();
    let most = photofit_scene::to_glb(&asset).unwrap().len() as u64;
    let options = options();
    let found = with_asset(&asset, &Silent, |asset| {
        let reference = Rasterized::new(&asset.n.flat, &asset.n.library);
        let budget =
            |most| Budget { most, asset, reference: &reference, options: &options, progress: &Silent };
        let large = |scene: &Scene| Made {
            scene: scene.clone(),
            compression: Compression::None,
            file: vec![0; most as usize + 1],
        };
        let of = |most| budget(most).or_whole(large(asset.given), Some(asset.given));
        let fewer = budget(most + 1).or_whole(large(&Scene::default()), Some(asset.given));
        Ok([of(most)?, of(most - 1)?, of(most + 1)?, fewer?].map(|(made, whole)| (made.bytes(), whole)))
    });
    assert_eq!(found.unwrap(), [(most, true), (most + 1, false), (most + 1, false), (most, true)]);
}

/// Without textures all bytes are those of triangles; with textures several parts of them.
#[test]
fn the_bytes_of_a_budget_hold_triangles() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    let bare = of(displaced_sphere(40, 0.2, 5, 3), Material::clay());
    let mut bare_with_uvs = bare.clone();
    let uvs = &mut bare_with_uvs.primitives[0].mesh;
    uvs.uvs = uvs.positions.iter().map(|p| photofit_scalar::vec2(p.x, p.y)).collect();
    let whole = photofit_scene::to_glb_with(&bare, Compression::None).unwrap().len() as u64;
    for (asset, appearance, written) in
        [(&bare_with_uvs, Appearance::Kept, Written::Kept), (&bare, Appearance::Maps, Written::Decimated)]
    {
        let o = SimplifyOptions {
            max_bytes: Some(whole / 5),
            triangles_by_bytes: true,
            own_textures: true,
            appearance,
            steps: 1,
            ..options()
        };
        let made = simplify(asset, &path, &o, &Silent).unwrap();
        let bytes = std::fs::metadata(&path).unwrap().len();
        assert_eq!(made.written, written);
        assert!(bytes <= whole / 5 && bytes * 100 >= whole / 5 * 96, "{bytes} of {}", whole / 5);
    }
}

/// A sphere of stone, and the bytes of its file by precision, finest first.
fn compressed_sphere() -> (Scene, [u64; 3]) {
    let asset = of(displaced_sphere(40, 0.2, 5, 3), Material::clay());
    let bytes = [Precision::Fine, Precision::Medium, Precision::Coarse].map(|precision| {
        photofit_scene::to_glb_with(&asset, Compression::Meshopt(precision)).unwrap().len() as u64
    });
    (asset, bytes)
}

/// Triangles, compression and bytes of a compressed file within `most` bytes.
fn compressed_within(asset: &Scene, most: u64) -> (usize, Compression, u64) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    let o = SimplifyOptions {
        max_bytes: Some(most),
        triangles_by_bytes: true,
        own_textures: true,
        compression: Compression::Meshopt(Precision::Fine),
        steps: 1,
        ..options()
    };
    let made = simplify(asset, &path, &o, &Silent).unwrap();
    let bytes = std::fs::metadata(&path).unwrap().len();
    assert!(bytes <= most, "{bytes} of {most}");
    (made.triangles_out, made.compression, bytes)
}

/// Compressed geometry is rounded as finely as the bytes allow.
#[test]
fn the_precision_of_geometry_follows_from_the_bytes() {
    let (asset, [fine, medium, coarse]) = compressed_sphere();
    assert!(medium * 10 < fine * 9 && coarse < medium, "{coarse} and {medium} of {fine}");
    for (bytes, precision) in
        [(fine, Precision::Fine), (medium, Precision::Medium), (coarse, Precision::Coarse)]
    {
        let (triangles, compression, _) = compressed_within(&asset, bytes + 100);
        assert_eq!((triangles, compression), (asset.triangle_count(), Compression::Meshopt(precision)));
    }
}

/// Where not all triangles fit, nearly all bytes are used, in whichever precision looks best on its triangles.
#[test]
#[ignore = "slow: files of three precisions by pictures of each"]
fn geometry_is_rounded_more_where_triangles_are_worth_it() {
    let (asset, [_, _, coarse]) = compressed_sphere();
    let (triangles, compression, bytes) = compressed_within(&asset, coarse / 2);
    let fewer = triangles < asset.triangle_count();
    assert!(fewer && compression != Compression::None, "{triangles} {compression:?}");
    assert!(bytes * 100 >= coarse / 2 * 96, "{bytes} of {}", coarse / 2);
}

/// A mirror whose texture says nothing: halved, it leaves the bytes for fine normals, which only pictures of the files tell.
#[test]
fn textures_give_way_where_rounded_geometry_shows() {
    let mut mesh = uv_sphere(48, 24);
    mesh.uvs =
        mesh.positions.iter().map(|p| photofit_scalar::vec2(0.5 + 0.4 * p.x, 0.5 + 0.4 * p.y)).collect();
    let slot = photofit_scene::TextureSlot::new(0);
    let mirror =
        Material { metallic: 1.0, roughness: 0.1, base_color_texture: Some(slot), ..Material::clay() };
    let mut asset = of(mesh, mirror);
    let mut state = 7_u32;
    // The last bit of a picture, which no file can make smaller.
    let mut bit = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        200 + (state >> 31) as u8
    };
    let texels = (0..128 * 128).map(|_| [bit(), bit(), bit(), 255]).collect();
    asset.images = vec![TextureImage { width: 128, height: 128, texels, ..TextureImage::default() }];
    let bytes = |precision| {
        photofit_scene::to_glb_with(&asset, Compression::Meshopt(precision)).unwrap().len() as u64
    };
    let [fine, coarse] = [Precision::Fine, Precision::Coarse].map(bytes);
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    let o = SimplifyOptions {
        max_bytes: Some((fine + coarse) / 2),
        triangles_by_bytes: true,
        own_textures: true,
        compression: Compression::Meshopt(Precision::Fine),
        texture_encoding: TextureEncoding::WebP,
        ..options()
    };
    let made = simplify(&asset, &path, &o, &Silent).unwrap();
    assert_eq!(made.triangles_out, asset.triangle_count());
    assert_eq!(made.compression, Compression::Meshopt(Precision::Fine), "{}", made.textures);
    assert!(std::fs::metadata(&path).unwrap().len() <= (fine + coarse) / 2);
}

/// What a job within `max_bytes` that may write the asset's own textures comes to, and the bytes of its file.
fn with_own(asset: &Scene, path: &Path, max_bytes: Option<u64>, o: SimplifyOptions) -> (Outcome, Vec<u8>) {
    let o = SimplifyOptions { max_bytes, own_textures: true, ..o };
    let outcome = simplify(asset, path, &o, &Silent).unwrap();
    let file = std::fs::read(path).unwrap();
    assert!(max_bytes.is_none_or(|most| file.len() as u64 <= most), "{} of {max_bytes:?}", file.len());
    (outcome, file)
}

/// Tiles need few texels, which maps of as many bytes do not have for all of them.
#[test]
fn own_textures_are_written_where_they_look_better_within_the_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    let asset = tiled();
    let o =
        SimplifyOptions { target: Target::Triangles(60), texture_size: 256, report_views: 4, ..options() };
    let free =
        simplify(&asset, &path, &SimplifyOptions { own_textures: false, ..o.clone() }, &Silent).unwrap();
    assert_ne!(free.written, Written::Decimated, "{:?}", free.stages);
    let most = Some(std::fs::metadata(&path).unwrap().len() / 8);
    let (own, _) = with_own(&asset, &path, most, o.clone());
    assert_eq!(own.written, Written::Decimated, "{:?}", own.stages);
    assert!(own.stage("fitted").is_some(), "what was fitted has a row of its own: {:?}", own.stages);
    let new = SimplifyOptions { max_bytes: most, own_textures: false, ..o };
    let new = simplify(&asset, &path, &new, &Silent).unwrap();
    assert_ne!(new.written, Written::Decimated);
    let psnr = |o: &Outcome| o.shipped().unwrap().psnr;
    assert!(psnr(&own) > psnr(&new) + 0.5, "{} and {}", psnr(&own), psnr(&new));
}

/// Tiles under a ball of glass whose mesh is twice as large as it is placed.
fn glazed() -> Scene {
    let mut scene = tiled();
    let glass = Extensions {
        transmission: Some(Transmission { factor: 1.0, texture: None }),
        volume: Some(Volume { thickness: 0.8, ..Volume::default() }),
        ..Extensions::default()
    };
    let glass = Material { roughness: 0.0, extensions: Some(Box::new(glass)), ..Material::clay() };
    scene.materials.push(glass);
    scene.primitives.push(Primitive { mesh: uv_sphere(16, 8), material: 1 });
    let placed = glam::Affine3A::from_scale_rotation_translation(
        glam::Vec3::splat(0.5),
        glam::Quat::IDENTITY,
        glam::vec3(0.0, 0.0, 0.8),
    );
    scene.instances.push(Instance { primitive: 1, transform: placed });
    scene
}

fn of_glass() -> SimplifyOptions {
    SimplifyOptions {
        target: Target::Triangles(400),
        texture_size: 256,
        judge_spp: 64,
        steps: 6,
        ..options()
    }
}

#[test]
fn own_textures_of_an_asset_with_glass_are_written_too() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    let (made, file) = with_own(&glazed(), &path, Some(22_000), of_glass());
    assert_eq!((made.written, made.judged), (Written::Decimated, Judged::PathTraced), "{:?}", made.stages);
    let light = photofit_scene::load(&path).unwrap();
    assert_eq!(light.images[0].texels, tiled().images[0].texels, "a texture of 8 x 8 is not reduced");
    let volume = |m: &Material| Some(m.extensions.as_ref()?.volume.as_ref()?.thickness);
    let thickness = light.materials.iter().find_map(volume).unwrap();
    assert!((thickness - 0.4).abs() < 1e-6, "{thickness} in the units of the written mesh");
    let kept = SimplifyOptions { appearance: Appearance::Kept, ..of_glass() };
    let (kept, as_kept) = with_own(&glazed(), &path, Some(22_000), kept);
    assert_eq!(kept.written, Written::Kept);
    // The same decimation and textures without a fit; coordinates that no texture reads stay.
    let shape = |file: &[u8]| {
        let scene = photofit_scene::from_glb(file).unwrap();
        let parts = scene.primitives.iter().map(|p| (p.mesh.positions.clone(), p.mesh.triangles.clone()));
        (parts.collect::<Vec<_>>(), scene.images.iter().map(|i| i.texels.clone()).collect::<Vec<_>>())
    };
    assert!(shape(&as_kept) == shape(&file) && as_kept.len() > file.len());
}

/// Says stop once a stage is reported from so many steps of it on.
struct StopsAt {
    stage: &'static str,
    from: u64,
    reached: AtomicBool,
}

impl StopsAt {
    fn new(stage: &'static str, from: u64) -> Self {
        Self { stage, from, reached: AtomicBool::new(false) }
    }
}

impl Progress for StopsAt {
    fn report(&self, stage: &'static str, done: u64, _: u64, _: &str) {
        self.reached.fetch_or(stage == self.stage && done >= self.from, Ordering::Relaxed);
    }
    fn warn(&self, _: &str) {}
    fn is_cancelled(&self) -> bool {
        self.reached.load(Ordering::Relaxed)
    }
}

#[test]
fn a_stopped_run_within_bytes_goes_on_to_the_same_file() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    let (asset, o) =
        (tiled(), SimplifyOptions { target: Target::Triangles(60), texture_size: 128, ..options() });
    let o = SimplifyOptions { max_bytes: Some(4_500), own_textures: true, ..o };
    let file = |o: &SimplifyOptions, progress: &dyn Progress| {
        let outcome = simplify(&asset, &path, o, progress).unwrap();
        (outcome, std::fs::read(&path).unwrap())
    };
    let (whole, bytes) = file(&o, &Silent);
    assert_eq!((whole.written, bytes.len() <= 4_500), (Written::Decimated, true), "{:?}", whole.stages);
    let fitting = Watching::stopping_at;
    let at = |stage| StopsAt::new(stage, 0);
    let stops: [&dyn Progress; 5] = [&fitting(0), &fitting(17), &at("choose"), &at("encode"), &at("report")];
    for (k, stop) in stops.into_iter().enumerate() {
        let checkpoint = Some(dir.path().join(format!("state{k}")));
        let kept = SimplifyOptions { checkpoint, ..o.clone() };
        assert!(file(&kept, stop).0.stopped, "{k}");
        let (resumed, again) = file(&SimplifyOptions { resume: true, ..kept }, &Silent);
        assert!(!resumed.stopped && again == bytes, "stop {k}");
    }
}

#[test]
fn maps_of_what_is_written_within_bytes_are_fitted_through_the_path_tracer() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    let o = SimplifyOptions {
        target: Target::Triangles(60),
        texture_size: 128,
        steps: 4,
        judge_spp: 16,
        reference: ReferenceRenderer::Path,
        fit_with: FitRenderer::Path,
        ..options()
    };
    let (made, _) = with_own(&tiled(), &path, Some(4_500), o);
    assert_eq!(made.written, Written::Decimated, "{:?}", made.stages);
    // Whichever look better within the bytes are written.
    let items = made.plan.items();
    let row = items.iter().find(|i| i.what == "path traced maps").expect("a row");
    assert!(row.why.starts_with("fitted once more"), "{row:?}");
    assert!(made.traced_maps.is_none_or(|m| m.steps == 4));
}

/// Who stops such a fit gets the maps that it had reached, where their file fits.
#[test]
fn maps_of_a_stopped_fit_through_the_path_tracer_are_written_within_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.glb");
    let o = SimplifyOptions {
        target: Target::Triangles(200),
        max_bytes: Some(200_000),
        texture_size: 32,
        steps: 60,
        judge_spp: 16,
        reference: ReferenceRenderer::Path,
        fit_with: FitRenderer::Path,
        ..options()
    };
    let made = simplify(&tiled(), &path, &o, &StopsAt::new("maps", 40)).unwrap();
    let maps = made.traced_maps.as_ref().expect("they looked better when the work was stopped");
    assert!(maps.gained() && maps.stopped && maps.steps < 60, "{} steps: {:?}", maps.steps, maps.history);
    assert!(made.choice_cut, "files of both maps fit, and were not compared");
    let verdict = crate::report::Verdict::of(&made).to_string();
    assert!(verdict.contains("through the path tracer: the best when the work was ended"), "{verdict}");
    assert!(made.fit_stopped && made.stopped && made.ended_early().unwrap().contains("the fit was ended"));
    let told = made.plan.to_string();
    assert!(
        told.contains("fitted once more through the path tracer") && !told.contains("look better"),
        "{told}"
    );
}

/// The quality of what is stored with loss is the best with which the file fits.
#[test]
fn the_bytes_of_a_budget_are_used() {
    let mut asset = tiled();
    let mut state = 7_u32;
    let mut noise = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    };
    let texels = (0..128 * 128).map(|_| [noise(), noise(), noise(), 255]).collect();
    asset.images = vec![TextureImage { width: 128, height: 128, texels, ..TextureImage::default() }];
    let asked = as_asked(&asset).unwrap();
    let files = Files::new(asset.clone(), &asked, u64::MAX, &options(), &Silent).unwrap();
    let choice = vec![[0, files.encodings - 1]];
    let coarse = || Made::new(files.with(&asset, &choice).unwrap(), Compression::None).unwrap();
    let most = coarse().bytes() * 5 / 4;
    let made = files.refined((&choice, coarse()), most).unwrap();
    let TextureEncoding::Jpeg { quality } = made.scene.images[0].encoding else { panic!("a JPEG") };
    let mut next = asset.clone();
    next.images[0] = asset.stored_as(0, TextureEncoding::Jpeg { quality: quality + 1 }).unwrap();
    let next = Made::new(next, Compression::None).unwrap();
    assert!(
        quality > 50 && made.bytes() <= most && next.bytes() > most,
        "{quality}: {} of {most}",
        made.bytes()
    );
}

/// A file that the asset had is among what fits, as it is.
#[test]
fn textures_that_fit_stay_as_they_were_read() {
    let mut asset = tiled();
    let texels: Vec<[u8; 4]> =
        (0..64 * 64).map(|k| [(k % 64 * 4) as u8, (k / 64 * 4) as u8, 90, 255]).collect();
    let image = TextureImage { width: 64, height: 64, texels, ..TextureImage::default() };
    asset.images = vec![image];
    asset.images[0] = asset.stored_as(0, TextureEncoding::Jpeg { quality: 70 }).unwrap();
    asset.images[0].encoding = TextureEncoding::Png;
    let dir = tempfile::tempdir().unwrap();
    let kept = SimplifyOptions { appearance: Appearance::Kept, ..options() };
    let (made, _) = with_own(&asset, &dir.path().join("a.glb"), Some(40_000), kept);
    assert!(made.textures.contains("JPEG, as in the asset"), "{}", made.textures);
}
