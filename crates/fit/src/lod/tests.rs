//! Chains of assets of a few hundred triangles.

use super::*;
use crate::Silent;
use crate::simplify::too_large_path;
use photofit_geometry::shapes::displaced_sphere;
use photofit_scene::{Compression, Instance, Material, Precision, Primitive};
use std::sync::atomic::{AtomicUsize, Ordering};

fn rock() -> Scene {
    Scene {
        name: "rock".into(),
        primitives: vec![Primitive { mesh: displaced_sphere(10, 0.25, 4, 3), material: 0 }],
        instances: vec![Instance { primitive: 0, transform: glam::Affine3A::IDENTITY }],
        materials: vec![Material::clay()],
        ..Scene::default()
    }
}

fn options() -> LodOptions {
    LodOptions {
        sizes: vec![48.0, 24.0, 16.0],
        triangles: vec![400, 150, 60],
        combined: true,
        continuous: false,
        fit: SimplifyOptions {
            steps: 12,
            batch: 1,
            report_views: 2,
            own_textures: false,
            ..SimplifyOptions::default()
        },
        texture_size: None,
    }
}

/// Stops at the first question after `levels` levels began their fit.
struct StopAfter {
    levels: usize,
    begun: AtomicUsize,
}

impl Progress for StopAfter {
    fn report(&self, stage: &'static str, done: u64, _: u64, note: &str) {
        let level = note.strip_prefix("level ").and_then(|n| n.split(' ').next()?.parse().ok());
        if let (true, Some(level)) = (stage == "fit" && done > 0, level) {
            self.begun.fetch_max(level, Ordering::Relaxed);
        }
    }
    fn is_cancelled(&self) -> bool {
        self.begun.load(Ordering::Relaxed) > self.levels
    }
}

#[test]
fn levels_fall_in_triangles_and_bytes_and_are_judged_at_their_size() {
    let dir = tempfile::tempdir().unwrap();
    let output = dir.path().join("out.glb");
    let chain = simplify_chain(&rock(), &output, &options(), &Silent).unwrap();
    assert!(!chain.stopped && chain.levels.len() == 3);
    for (k, level) in chain.levels.iter().enumerate() {
        let o = options();
        assert_eq!(level.path, level_path(&output, k));
        let scene = photofit_scene::load(&level.path).unwrap();
        assert_eq!(scene.triangle_count(), level.outcome.triangles_out);
        assert!((1..=o.triangles[k]).contains(&level.outcome.triangles_out));
        assert_eq!(level.outcome.resolution, o.sizes[k] as usize);
        assert_eq!(level.bytes, std::fs::metadata(&level.path).unwrap().len());
        assert_eq!(level.outcome.stages[0].name, "original");
        let q = level.quality();
        assert!(q.psnr > 18.0 && (q.luminance - 1.0).abs() < 0.1, "level {k}: {q:?}");
        let seen = level.popping.is_some_and(|p| p.flip > 0.0 && p.flip < 0.5 && p.outline < 0.2);
        assert_eq!(seen, k < 2, "level {k}: {:?}", level.popping);
    }
    assert!(chain.levels.windows(2).all(|w| w[1].bytes < w[0].bytes));
    assert!((chain.levels[0].switch_size.unwrap() - (48.0_f64 * 24.0).sqrt()).abs() < 1e-9);
    assert_eq!(chain.levels[2].switch_size, None);
    let combined = photofit_scene::load(chain.combined.unwrap()).unwrap();
    assert_eq!(combined.triangle_count(), chain.levels[0].outcome.triangles_out, "the finest level is shown");
}

#[test]
fn a_continuous_chain_turns_each_level_into_the_next() {
    let dir = tempfile::tempdir().unwrap();
    let [plain, turning] = ["plain.glb", "turning.glb"].map(|name| dir.path().join(name));
    let continuous = |compression| {
        let fit = SimplifyOptions { compression, ..options().fit };
        LodOptions { continuous: true, fit, ..options() }
    };
    let before = simplify_chain(&rock(), &plain, &options(), &Silent).unwrap();
    let chain = simplify_chain(&rock(), &turning, &continuous(Compression::None), &Silent).unwrap();
    let file = |path: &Path| photofit_scene::load(path).unwrap();
    for (k, (level, was)) in chain.levels.iter().zip(&before.levels).enumerate() {
        assert_eq!((level.popping, level.quality()), (was.popping, was.quality()));
        let scene = file(&level.path);
        let rest = |scene: &Scene| -> Vec<_> {
            let all = scene.primitives.iter().map(|p| &p.mesh);
            all.map(|m| (m.positions.clone(), m.uvs.clone(), m.triangles.clone())).collect()
        };
        assert_eq!(rest(&scene), rest(&file(&was.path)), "at rest it is the same to the bit");
        let mesh = &scene.hierarchy.as_ref().unwrap().meshes[0];
        let names: Vec<&str> = mesh.target_names().collect();
        assert_eq!(level.bytes, std::fs::metadata(&level.path).unwrap().len());
        let (Some(blend), Some(popping)) = (&level.blend, level.popping) else {
            assert_eq!((k, mesh.targets()), (2, 0), "the coarsest level turns into nothing");
            assert_eq!(std::fs::read(&level.path).unwrap(), std::fs::read(&was.path).unwrap());
            continue;
        };
        assert_eq!((mesh.targets(), names), (1, vec![blend.target.as_str()]));
        assert_eq!(blend.target, format!("lod{}", k + 1));
        assert_eq!(blend.sizes, [level.size, level.switch_size.unwrap()]);
        assert!(level.bytes > was.bytes);
        // The outline jumps less; what textures and normal maps differ in stays.
        assert!(blend.popping.outline < 0.7 * popping.outline, "{k}: {popping:?} {blend:?}");
        assert!(blend.popping.flip < 1.2 * popping.flip, "{k}: {popping:?} {blend:?}");
        assert!(blend.after.mean < 0.7 * blend.before.mean, "{k}: {blend:?}");
        assert_eq!(blend.turned, 0);
    }
    let combined = file(&chain.combined.unwrap());
    assert_eq!(combined.hierarchy.as_ref().unwrap().meshes[0].targets(), 1);
    // Compressed, the target is on the grid of the positions.
    let small = dir.path().join("small.glb");
    let chain =
        simplify_chain(&rock(), &small, &continuous(Compression::Meshopt(Precision::Fine)), &Silent).unwrap();
    for (name, k) in [("turning.glb", 0), ("turning.lod1.glb", 1)] {
        let [a, b] =
            [&dir.path().join(name), &chain.levels[k].path].map(|p| weighted(&file(p), 1.0).flatten());
        let accel = photofit_rays::Accel::build(&a.mesh.positions, &a.mesh.triangles).unwrap();
        let away = |p: &photofit_scalar::Vec3f| accel.closest_point(*p, f32::INFINITY).unwrap().distance;
        let mean = b.mesh.positions.iter().map(away).sum::<f32>() / b.mesh.positions.len() as f32;
        assert!(mean < 2e-3, "level {k}: {mean}");
    }
}

#[test]
fn a_stopped_chain_keeps_its_levels_and_resumes_to_the_same_files() {
    let dir = tempfile::tempdir().unwrap();
    let bytes = |name: &str, k: usize| std::fs::read(level_path(&dir.path().join(name), k)).unwrap();
    let run = |name: &str, options: &LodOptions, progress: &dyn Progress| {
        simplify_chain(&rock(), &dir.path().join(name), options, progress).unwrap()
    };
    run("whole.glb", &options(), &Silent);
    let mut kept = options();
    kept.fit.checkpoint = Some(dir.path().join("state"));
    let progress = StopAfter { levels: 1, begun: AtomicUsize::new(0) };
    let chain = run("a.glb", &kept, &progress);
    assert!(chain.stopped);
    assert_eq!(chain.levels.len(), 2, "the level at work is finished, the next is not begun");
    assert!(!level_path(&dir.path().join("a.glb"), 2).exists());
    assert!(bytes("a.glb", 0) == bytes("whole.glb", 0));
    kept.fit.resume = true;
    assert!(!run("a.glb", &kept, &Silent).stopped);
    for k in 0..3 {
        assert!(bytes("a.glb", k) == bytes("whole.glb", k), "level {k}");
    }
}

#[test]
fn a_chain_that_a_time_limit_ended_goes_on() {
    let dir = tempfile::tempdir().unwrap();
    let output = dir.path().join("a.glb");
    let mut kept = options();
    kept.fit.checkpoint = Some(dir.path().join("state"));
    kept.fit.time_limit = Some(std::time::Duration::from_millis(1));
    let short = simplify_chain(&rock(), &output, &kept, &Silent).unwrap();
    assert_eq!(short.levels.len(), 3, "a time limit shortens fits, not the chain");
    let steps = |chain: &LodChain| chain.levels.iter().map(|l| l.outcome.steps).sum::<u64>();
    // The shapes that later levels start from are others now.
    (kept.fit.time_limit, kept.fit.resume) = (None, true);
    let whole = simplify_chain(&rock(), &output, &kept, &Silent).unwrap();
    assert!(!whole.stopped && steps(&whole) > steps(&short), "{} {}", steps(&whole), steps(&short));
}

#[test]
fn a_level_that_cannot_be_written_keeps_those_before() {
    let dir = tempfile::tempdir().unwrap();
    let output = dir.path().join("out.glb");
    // A folder stands where the second level is to be written.
    std::fs::create_dir(level_path(&output, 1)).unwrap();
    let chain = simplify_chain(&rock(), &output, &options(), &Silent).unwrap();
    assert_eq!((chain.levels.len(), chain.stopped, chain.combined), (1, true, None));
    let text = chain.failed.unwrap().to_string();
    assert!(text.contains("out.lod1.glb"), "{text}");
    assert!(output.exists() && chain.levels[0].quality().psnr > 10.0);
}

#[test]
fn levels_above_their_bytes_replace_nothing_and_there_is_no_file_with_all() {
    let dir = tempfile::tempdir().unwrap();
    let output = dir.path().join("out.glb");
    let older =
        [level_path(&output, 0), level_path(&output, 1), level_path(&output, 2), combined_path(&output)];
    for path in &older {
        std::fs::write(path, "of last week").unwrap();
    }
    let mut small = options();
    (small.fit.max_bytes, small.fit.steps) = (Some(500), 2);
    let chain = simplify_chain(&rock(), &output, &small, &Silent).unwrap();
    assert!(chain.combined.is_none() && chain.failed.is_none() && !chain.stopped);
    assert_eq!(chain.levels.len(), 3);
    for (k, level) in chain.levels.iter().enumerate() {
        assert_eq!(level.path, too_large_path(&level_path(&output, k)));
        assert!(level.bytes > 500 && photofit_scene::load(&level.path).is_ok(), "level {k}");
    }
    for path in &older {
        assert_eq!(std::fs::read(path).unwrap(), b"of last week", "{}", path.display());
    }
}

#[test]
fn errors_name_the_field_what_it_is_and_what_it_must_be() {
    let with = |sizes: &[f64], triangles: &[usize]| LodOptions {
        sizes: sizes.to_vec(),
        triangles: triangles.to_vec(),
        ..LodOptions::default()
    };
    for (sizes, triangles, message) in [
        (&[][..], &[][..], "sizes is []; there must be 1 to 8 levels"),
        (&[128.0, 128.0], &[], "sizes is [128, 128]; sizes must fall"),
        (&[128.0, 8.0], &[], "sizes is [128, 8]; sizes must be 16 to 1024 pixels"),
        (&[f64::NAN], &[], "sizes is [NaN]; sizes must be 16 to 1024 pixels"),
        (&[64.0, 32.0], &[10], "triangles is [10]; there must be one for each of 2 levels"),
        (&[64.0, 32.0], &[10, 20], "triangles is [10, 20]; budgets must fall"),
        (&[64.0], &[600], "triangles is 600; it must be 1 to 500, the triangles of the asset"),
    ] {
        assert_eq!(with(sizes, triangles).check(500).unwrap_err().to_string(), message);
    }
    assert!(with(&[512.0, 128.0, 32.0], &[400, 100, 50]).check(500).is_ok());
    let continuous = |sizes: &[f64], max_bytes| {
        let fit = SimplifyOptions { max_bytes, ..SimplifyOptions::default() };
        LodOptions { continuous: true, fit, ..with(sizes, &[]) }
    };
    assert!(continuous(&[64.0, 32.0], None).check(500).is_ok());
    let refused = |options: LodOptions| options.check(500).unwrap_err().to_string();
    assert!(refused(continuous(&[64.0], None)).contains("continuous blends each level into the next"));
    assert!(refused(continuous(&[64.0, 32.0], Some(9000))).contains("does not go with most bytes"));
}

#[test]
fn names_of_files() {
    let output = Path::new("a/b.c.glb");
    assert_eq!(level_path(output, 0), output);
    assert_eq!(level_path(output, 2), Path::new("a/b.c.lod2.glb"));
    assert_eq!(summary_path(output), Path::new("a/b.c.lods.json"));
    assert_eq!(combined_path(output), Path::new("a/b.c.lods.glb"));
}

/// Whether a column of [`fence`] belongs to a bar.
fn bar(x: usize) -> bool {
    x.is_multiple_of(2) && (x * x / 64) % 8 < 2 + x / 128
}

/// A fence of bars that are all thinner than a texel of the level, closer to each other from left to right.
fn fence() -> Scene {
    use photofit_scene::{AlphaMode, Filter, Sampler, TextureImage, TextureSlot, Wrap};
    let mut mesh = photofit_geometry::shapes::quad_grid(8, 8);
    mesh.tangents.clear();
    let wrap = Wrap::ClampToEdge;
    let slot = TextureSlot {
        sampler: Sampler { wrap_u: wrap, wrap_v: wrap, filter: Filter::Bilinear },
        ..TextureSlot::new(0)
    };
    let texel = |i: usize| if bar(i % 512) { [230, 230, 230, 255] } else { [230, 230, 230, 0] };
    Scene {
        name: "fence".into(),
        primitives: vec![Primitive { mesh, material: 0 }],
        instances: vec![Instance { primitive: 0, transform: glam::Affine3A::IDENTITY }],
        materials: vec![Material {
            base_color_texture: Some(slot),
            base_color: [1.0; 4],
            alpha_mode: AlphaMode::Mask { cutoff: 0.5 },
            double_sided: true,
            ..Material::clay()
        }],
        images: vec![TextureImage {
            width: 512,
            height: 4,
            texels: (0..512 * 4).map(texel).collect(),
            ..TextureImage::default()
        }],
        ..Scene::default()
    }
}

#[test]
fn thin_bars_do_not_vanish_in_the_distance() {
    let dir = tempfile::tempdir().unwrap();
    let options = LodOptions { sizes: vec![32.0], triangles: vec![32], combined: false, ..options() };
    let chain = simplify_chain(&fence(), &dir.path().join("out.glb"), &options, &Silent).unwrap();
    let q = chain.levels[0].quality();
    let scene = photofit_scene::load(&chain.levels[0].path).unwrap();
    let alpha: Vec<u8> = scene.images[0].texels.iter().map(|t| t[3]).collect();
    let share = alpha.iter().filter(|a| **a >= 128).count() as f64 / alpha.len() as f64;
    let covered = (0..512).filter(|x| bar(*x)).count() as f64 / 512.0;
    assert!(
        (share / covered - 1.0).abs() < 0.3,
        "{share} of the texels are drawn, {covered} is covered: {q:?}"
    );
}
