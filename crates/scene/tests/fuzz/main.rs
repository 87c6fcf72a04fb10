//! Readers of untrusted files against mutants of valid ones: each is read or refused, without a panic, within a time and
//! an amount of memory.
//!
//! Files are mutated in their structure: JSON values, lines and numbers of text, attributes of XML, words of binary files
//! inside of valid containers; most mutants of bytes alone are refused at the door. What a mutant is follows from the
//! target's name and its number. `PHOTOFIT_FUZZ_MINUTES` is the time of all targets in the slow suite (60),
//! `PHOTOFIT_FUZZ_CORPUS` a folder whose files are seeds too.

mod corpus;
mod memory;
mod mutate;

use mutate::{Rng, Shape};
use photofit_scene::{Limits, load_points_with, load_with};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::time::{Duration, Instant};

/// Mutants of each target in the fast suite.
const FEW: u64 = 300;
/// Time that a reader may take for a file of some kilobytes, on a machine that has other work.
const TIME: Duration = Duration::from_secs(20);
/// Memory that it may take.
const BYTES: usize = 256 << 20;

/// Small enough that what is within the limits stays within [`BYTES`].
const LIMITS: Limits = Limits {
    vertex_attribute: None,
    file_bytes: 1 << 20,
    json_bytes: 1 << 20,
    json_items: 50_000,
    vertices: 200_000,
    triangles: 200_000,
    instances: 10_000,
    texture_side: 1024,
    texels: 1 << 20,
    keep_encoded: false,
};

/// A reader and how its files are mutated.
struct Target {
    name: &'static str,
    extension: &'static str,
    shape: Shape,
    seeds: Vec<Vec<u8>>,
    /// Files that name the mutant, in its folder, where something else reads it; they are read in its place.
    beside: Vec<(&'static str, Vec<u8>)>,
    /// Whether the file was read.
    read: fn(&Path) -> bool,
}

impl Target {
    /// The same, read through another file that names `mutant` with its extension.
    fn named_by(mut self, file: &'static str, text: impl Into<Vec<u8>>) -> Self {
        self.beside.push((file, text.into()));
        self
    }
}

fn targets() -> Vec<Target> {
    let scene = |path: &Path| load_with(path, &LIMITS).map(|s| s.flatten()).is_ok();
    let points = |path: &Path| load_points_with(path, &LIMITS).is_ok();
    let target = |name, extension, shape, seeds, read| Target {
        name,
        extension,
        shape,
        seeds,
        beside: Vec::new(),
        read,
    };
    let mut out = vec![
        target("gltf", "gltf", Shape::Json, corpus::gltf(), scene as fn(&Path) -> bool),
        target("glb", "glb", Shape::Glb, corpus::glb(), scene),
        target("glb-textures", "glb", Shape::Packed, corpus::glb_textures(), scene),
        target("glb-draco", "glb", Shape::Packed, corpus::glb_draco(), scene),
        target("glb-meshopt", "glb", Shape::Packed, corpus::glb_meshopt(), scene),
        target("obj", "obj", Shape::Text, corpus::obj(), scene),
        target("mtl", "mtl", Shape::Text, corpus::mtl(), scene).named_by("a.obj", corpus::OBJ_OF_MTL),
        target("ply", "ply", Shape::Text, corpus::ply_text(), scene),
        target("ply-binary", "ply", Shape::Bytes, corpus::ply_binary(), scene),
        target("points", "ply", Shape::Text, corpus::ply_text(), points),
        target("pcd", "pcd", Shape::Text, corpus::pcd_text(), points),
        target("pcd-binary", "pcd", Shape::Bytes, corpus::pcd_binary(), points),
        target("hdr", "hdr", Shape::Bytes, corpus::radiance(), |p| {
            photofit_scene::load_environment(p).is_ok()
        }),
        target("exr", "exr", Shape::Bytes, corpus::exr(), |p| photofit_scene::load_environment(p).is_ok()),
        target("ktx2", "ktx2", Shape::Bytes, corpus::ktx2(), |path| {
            let limits =
                photofit_image::Limits { max_side: 1024, max_samples: 1 << 22, ..Default::default() };
            photofit_image::read_with_limits(path, &limits).is_ok()
        }),
    ];
    #[cfg(feature = "mitsuba")]
    {
        let mitsuba = |path: &Path| {
            let options = photofit_scene::mitsuba::MitsubaOptions { limits: LIMITS, ..Default::default() };
            photofit_scene::mitsuba::load_mitsuba(path, &options).is_ok()
        };
        out.push(target("mitsuba", "xml", Shape::Xml, corpus::mitsuba(), mitsuba as fn(&Path) -> bool));
        for (name, extension, shape, seeds, body) in corpus::named_by_mitsuba() {
            let target = target(name, extension, shape, seeds, mitsuba);
            out.push(target.named_by("scene.xml", corpus::mitsuba_scene(body)));
        }
    }
    if let Some(folder) = std::env::var_os("PHOTOFIT_FUZZ_CORPUS") {
        let files = std::fs::read_dir(folder).expect("the corpus is a folder");
        let mut paths: Vec<_> = files.filter_map(|f| Some(f.ok()?.path())).collect();
        paths.sort();
        for path in paths {
            let extension = path.extension().unwrap_or_default().to_string_lossy().into_owned();
            if let Some(t) = out.iter_mut().find(|t| t.extension == extension) {
                t.seeds.push(std::fs::read(&path).expect("a seed can be read"));
            }
        }
    }
    out
}

/// Reads one file; what broke, if anything.
fn try_one(target: &Target, bytes: &[u8], path: &Path) -> Result<bool, String> {
    std::fs::write(path, bytes).expect("the mutant is written");
    let before = memory::restart();
    let start = Instant::now();
    let opened = target.beside.first().map_or(path.to_owned(), |(name, _)| path.with_file_name(name));
    let read = catch_unwind(AssertUnwindSafe(|| (target.read)(&opened)));
    let (time, peak) = (start.elapsed(), memory::peak().saturating_sub(before));
    let read = read.map_err(|e| {
        let text = e.downcast_ref::<String>().cloned();
        format!(
            "panics: {}",
            text.or_else(|| e.downcast_ref::<&str>().map(|s| (*s).into())).unwrap_or_default()
        )
    })?;
    if time > TIME {
        return Err(format!("takes {time:.1?}"));
    }
    if peak > BYTES {
        return Err(format!("takes {} MiB", peak >> 20));
    }
    Ok(read)
}

/// Reads mutants until `enough(number)`; returns how many there were and how many were read.
fn fuzz(target: &Target, enough: impl Fn(u64) -> bool) -> (u64, u64) {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("m.mtl"), corpus::MTL).expect("written");
    std::fs::write(folder.path().join("t.png"), corpus::png()).expect("written");
    for (name, bytes) in &target.beside {
        std::fs::write(folder.path().join(name), bytes).expect("written");
    }
    let path = folder.path().join("mutant").with_extension(target.extension);
    for (k, seed) in target.seeds.iter().enumerate() {
        assert_eq!(try_one(target, seed, &path), Ok(true), "{}: seed {k} is valid", target.name);
    }
    let (mut number, mut read) = (0, 0);
    while !enough(number) {
        let mut rng = Rng::new(target.name, number);
        let mut bytes = target.seeds[rng.below(target.seeds.len())].clone();
        for _ in 0..1 + rng.below(3) {
            bytes = target.shape.mutate(&bytes, &mut rng);
        }
        match try_one(target, &bytes, &path) {
            Ok(valid) => read += u64::from(valid),
            Err(what) => {
                let kept = std::env::temp_dir()
                    .join(format!("photofit-fuzz-{}-{number}.{}", target.name, target.extension));
                std::fs::write(&kept, &bytes).expect("the mutant is kept");
                panic!("{} mutant {number}, kept as {}: {what}", target.name, kept.display());
            }
        }
        number += 1;
    }
    (number, read)
}

#[test]
fn mutants_are_read_or_refused() {
    for target in targets() {
        let (count, read) = fuzz(&target, |n| n == FEW);
        println!("{}: {read} of {count} mutants are read", target.name);
        // Neither all nor none: mutants that change nothing or that all end at the first byte test nothing.
        assert!(read * 50 > count && read * 50 < count * 49, "{}: {read} of {count} are read", target.name);
    }
}

#[test]
#[ignore = "slow: mutants of each reader for an hour, or PHOTOFIT_FUZZ_MINUTES"]
fn many_mutants_are_read_or_refused() {
    let minutes = std::env::var("PHOTOFIT_FUZZ_MINUTES").ok().and_then(|s| s.parse().ok()).unwrap_or(60.0);
    let targets = targets();
    let share = Duration::from_secs_f64(60.0 * minutes / targets.len() as f64);
    for target in targets {
        let end = Instant::now() + share;
        let (count, read) = fuzz(&target, |_| Instant::now() >= end);
        println!("{}: {read} of {count} mutants are read", target.name);
    }
}
