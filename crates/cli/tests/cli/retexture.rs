//! Maps of light animated assets.

use crate::support::{assert_misuse, assert_one_error, photofit, read_json, rock, stderr, stdout, succeeds};
use glam::{Affine3A, Quat, Vec3};
use photofit_scene::{
    Animation, Channel, Curve, Extensions, Hierarchy, Instance, Interpolation, Node, NodeMesh, NodePrimitive,
    NodeTransform, Placement, Primitive, Property, Scene, Sheen,
};
use std::path::Path;
use std::sync::Arc;

/// A rock that slides to the right within a second.
fn sliding(frequency: u32, animation: &str) -> Scene {
    let mut scene = rock(frequency, true);
    scene.instances[0].transform = Affine3A::IDENTITY;
    let parts = NodeTransform::Parts { translation: Vec3::ZERO, rotation: Quat::IDENTITY, scale: Vec3::ONE };
    scene.hierarchy = Some(Arc::new(Hierarchy {
        nodes: vec![Node { mesh: Some(0), transform: parts, ..Node::default() }],
        roots: vec![0],
        meshes: vec![NodeMesh {
            primitives: vec![NodePrimitive { primitive: 0, bind: None, extras: None }],
            ..NodeMesh::default()
        }],
        animations: vec![Animation {
            name: animation.into(),
            channels: vec![Channel { node: 0, property: Property::Translation, curve: 0 }],
            curves: vec![Curve {
                times: vec![0.0, 1.0],
                values: vec![0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
                interpolation: Interpolation::Linear,
            }],
            ..Animation::default()
        }],
        placements: vec![Placement { node: 0, part: 0 }],
        ..Hierarchy::default()
    }));
    scene
}

fn write(folder: &Path, name: &str, scene: &Scene) {
    photofit_scene::save_glb(folder.join(name), scene).unwrap();
}

#[test]
fn a_light_rock_is_painted_in_motion() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write(d, "heavy.glb", &sliding(10, "slide"));
    write(d, "light.glb", &sliding(4, "slide"));
    let line = ["retexture", "heavy.glb", "light.glb", "-o", "out.glb", "--texture-size", "64"];
    let run = |more: &[&str]| photofit(d, &[&line[..], more].concat());
    let small = ["--resolution", "64", "--steps", "40", "--moments", "3", "--json", "f.json"];
    let o = succeeds(d, &[&line[..], &small[..], &["--explain", "--report", "r"]].concat());
    let page = std::fs::read_to_string(d.join("r/index.html")).unwrap();
    for part in ["light.glb in the look of heavy.glb", "data:image/png", "at 3 moments, rasterized", "<svg"] {
        assert!(page.contains(part), "{part:?} is not in the page");
    }
    assert!(stdout(&o).contains("3 moments of slide"), "{}", stdout(&o));
    let f = read_json(&d.join("f.json"));
    let psnr = |stage: &str| f[stage]["psnr"].as_f64().unwrap();
    assert!(psnr("file") > psnr("baked") && f["moments"].as_array().unwrap().len() == 3, "{f}");
    let bytes = std::fs::read(d.join("out.glb")).unwrap();
    let again = ["--threads", "1", "--resolution", "64", "--steps", "40", "--moments", "3"];
    assert_eq!(run(&again).status.code(), Some(0));
    assert!(std::fs::read(d.join("out.glb")).unwrap() == bytes, "the same bytes on one thread");
    assert!(stdout(&succeeds(d, &["inspect", "out.glb"])).contains("slide"), "the animation is kept");
    // What cannot be is told in one line.
    assert_one_error(&run(&["--animation", "jump"]), "animation", &["heavy.glb", "\"slide\"", "jump"]);
    assert_misuse(
        &photofit(d, &["retexture", "heavy.glb", "light.glb", "-o", "light.glb"]),
        "overwritten",
        &["LIGHT"],
    );
    write(d, "light.glb", &sliding(4, "other"));
    let o = succeeds(d, &[&line[..], &["--steps", "0", "--resolution", "32"]].concat());
    assert!(stderr(&o).contains("none of the reference's animations, \"slide\""), "{}", stderr(&o));
    assert_one_error(&run(&["--animation", "slide"]), "not there", &["light.glb", "animation 0"]);
}

#[test]
fn velvet_is_judged_as_velvet_and_errors_name_the_asset_that_they_are_about() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let mut velvet = rock(8, true);
    let sheen = Sheen { color: [0.2, 0.3, 1.0], roughness: 0.4, ..Sheen::default() };
    velvet.materials[0].extensions =
        Some(Box::new(Extensions { sheen: Some(sheen), ..Extensions::default() }));
    write(d, "velvet.glb", &velvet);
    write(d, "light.glb", &rock(3, true));
    let line = ["retexture", "velvet.glb", "light.glb", "-o", "out.glb", "--texture-size", "32"];
    let small = ["--resolution", "24", "--steps", "1"];
    let o = succeeds(d, &[&line[..], &small, &["--json", "f.json"]].concat());
    assert!(stderr(&o).contains("velvet.glb: kept, but not drawn while fitting: material extensions"));
    assert!(stdout(&o).contains("path traced at most 256 pixels wide"), "{}", stdout(&o));
    let f = read_json(&d.join("f.json"));
    assert_eq!(
        (f["judged"].as_str(), f["left_out"].as_array().map(Vec::len)),
        (Some("path traced"), Some(0))
    );
    assert!(f["not_fitted"][0].as_str().unwrap().ends_with("sheen"), "{f}");
    assert!(photofit_scene::load(d.join("out.glb")).unwrap().materials[0].extensions.is_some());
    // Which asset, and what of it: never an option that the command does not have.
    write(d, "light.glb", &rock(3, false));
    let told = photofit(d, &line);
    assert_one_error(&told, "no texture coordinates", &["light.glb: light asset has no texture coordinates"]);
    write(d, "light.glb", &rock(3, true));
    let mut two = velvet.clone();
    two.primitives.push(Primitive { mesh: two.primitives[0].mesh.clone(), material: 1 });
    two.instances.push(Instance { primitive: 1, transform: Affine3A::from_scale(Vec3::splat(2.0)) });
    two.materials.push(rock(3, true).materials[0].clone());
    write(d, "velvet.glb", &two);
    let told = photofit(d, &line);
    assert_one_error(&told, "two kinds", &["velvet.glb: reference asset has materials of 2 kinds"]);
    assert!(!stderr(&told).contains("--"), "{}", stderr(&told));
}
