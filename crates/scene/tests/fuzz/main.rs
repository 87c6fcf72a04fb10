//! Readers of untrusted files against mutants of valid ones: each is read or refused, without a panic, within a time and
//! an amount of memory.
//!
//! Files are mutated in their structure: JSON values, lines and numbers of text, attributes of XML, words of binary files
//! inside of valid containers; most mutants of bytes alone are refused at the door. What a mutant is follows from the
//! target's name and its number. `PHOTOFIT_FUZZ_MINUTES` is the time of all targets in the slow suite (60),
//! `PHOTOFIT_FUZZ_CORPUS` a folder whose files are seeds too.

mod corpus;
mod memory;

use photofit_mutants::{Seen, Shape};
use photofit_scene::{Limits, load_points_with, load_with};
use std::path::Path;
use std::time::{Duration, Instant};

/// Mutants of each target in the fast suite.
const FEW: u64 = 300;
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
    /// Reads the file, or tells why not.
    read: Reader,
    /// How many different rules the mutants of the fast suite break at least: two thirds of what they broke when this was
    /// written.
    rules: usize,
}

type Reader = fn(&Path) -> Result<(), String>;

impl Target {
    /// The same, read through another file that names `mutant` with its extension.
    fn named_by(mut self, file: &'static str, text: impl Into<Vec<u8>>) -> Self {
        self.beside.push((file, text.into()));
        self
    }
}

/// Without the path, which is another one in each run.
fn told<T, E: std::fmt::Display>(read: Result<T, E>) -> Result<(), String> {
    read.map(drop).map_err(|e| e.to_string())
}

fn targets() -> Vec<Target> {
    let scene: Reader = |path| told(load_with(path, &LIMITS).map(|s| s.flatten()));
    let points: Reader = |path| told(load_points_with(path, &LIMITS));
    let environment: Reader = |path| told(photofit_scene::load_environment(path));
    let ktx2: Reader = |path| {
        let limits = photofit_image::Limits { max_side: 1024, max_samples: 1 << 22, ..Default::default() };
        told(photofit_image::read_with_limits(path, &limits))
    };
    let target = |name, extension, shape, seeds, read, rules| Target {
        name,
        extension,
        shape,
        seeds,
        beside: Vec::new(),
        read,
        rules,
    };
    let mut out = vec![
        target("gltf", "gltf", Shape::Json, corpus::gltf(), scene, 69),
        target("glb", "glb", Shape::Glb, corpus::glb(), scene, 54),
        target("glb-textures", "glb", Shape::GlbBinary, corpus::glb_textures(), scene, 42),
        target("glb-draco", "glb", Shape::GlbBinary, corpus::glb_draco(), scene, 48),
        target("glb-meshopt", "glb", Shape::GlbBinary, corpus::glb_meshopt(), scene, 43),
        target("obj", "obj", Shape::Text, corpus::obj(), scene, 4),
        target("mtl", "mtl", Shape::Text, corpus::mtl(), scene, 1).named_by("a.obj", corpus::OBJ_OF_MTL),
        target("ply", "ply", Shape::Text, corpus::ply_text(), scene, 22),
        target("ply-binary", "ply", Shape::Bytes, corpus::ply_binary(), scene, 32),
        target("points", "ply", Shape::Text, corpus::ply_text(), points, 18),
        target("pcd", "pcd", Shape::Text, corpus::pcd_text(), points, 18),
        target("pcd-binary", "pcd", Shape::Bytes, corpus::pcd_binary(), points, 11),
        target("hdr", "hdr", Shape::Bytes, corpus::radiance(), environment, 8),
        target("exr", "exr", Shape::Bytes, corpus::exr(), environment, 17),
        target("ktx2", "ktx2", Shape::Bytes, corpus::ktx2(), ktx2, 9),
    ];
    #[cfg(feature = "mitsuba")]
    {
        let mitsuba: Reader = |path| {
            let options = photofit_scene::mitsuba::MitsubaOptions { limits: LIMITS, ..Default::default() };
            told(photofit_scene::mitsuba::load_mitsuba(path, &options))
        };
        out.push(target("mitsuba", "xml", Shape::Xml, corpus::mitsuba(), mitsuba, 41));
        for (name, extension, shape, seeds, body) in corpus::named_by_mitsuba() {
            // Lines of two numbers break two rules.
            let target =
                target(name, extension, shape, seeds, mitsuba, if name == "spectrum" { 2 } else { 4 });
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

/// Reads mutants until `enough(number)`.
fn fuzz(target: &Target, enough: impl Fn(u64) -> bool) -> Seen {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("m.mtl"), corpus::MTL).expect("written");
    std::fs::write(folder.path().join("t.png"), corpus::png()).expect("written");
    for (name, bytes) in &target.beside {
        std::fs::write(folder.path().join(name), bytes).expect("written");
    }
    let path = folder.path().join("mutant").with_extension(target.extension);
    let opened = target.beside.first().map_or(path.clone(), |(name, _)| path.with_file_name(name));
    let mutants = photofit_mutants::Target { name: target.name, shape: target.shape, seeds: &target.seeds };
    mutants.run(enough, |bytes| {
        std::fs::write(&path, bytes).expect("the mutant is written");
        let before = memory::restart();
        let read = (target.read)(&opened);
        let peak = memory::peak().saturating_sub(before);
        assert!(peak <= BYTES, "takes {} MiB", peak >> 20);
        read
    })
}

#[test]
fn mutants_are_read_or_refused() {
    for target in targets() {
        let seen = fuzz(&target, |n| n == FEW);
        println!("{}: {seen}", target.name);
        seen.assert_deep(target.name, target.rules);
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
        let seen = fuzz(&target, |_| Instant::now() >= end);
        println!("{}: {seen}", target.name);
        seen.assert_deep(target.name, target.rules);
    }
}
