//! Textures from pictures: what is refused, with which words. The job itself is tested in `photofit-fit`.

use crate::support::{
    assert_misuse, assert_one_error, photofit, read_json, rock, stderr, stdout, succeeds, write_rock,
};
use photofit_scene::{Camera, Hierarchy, Node, NodeMesh, NodePrimitive, Placement};
use serde_json::{Value, json};
use std::path::Path;

#[test]
fn pictures_that_cannot_be_used_are_refused_in_one_line() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 4, false);
    std::fs::create_dir(d.join("pictures")).unwrap();
    let run = |more: &[&str]| {
        let all =
            [&["recover", "texture", "pictures", "--mesh", "rock.glb", "-o", "out.glb"][..], more].concat();
        photofit(d, &all)
    };
    assert_one_error(&run(&[]), "no list of pictures", &["transforms.json"]);
    std::fs::write(d.join("pictures/transforms.json"), r#"{"fl_x": 50, "frames": []}"#).unwrap();
    assert_one_error(&run(&[]), "no pictures", &["transforms.json", "0 frames", "at least 8"]);
    let before = std::fs::read(d.join("rock.glb")).unwrap();
    let o = photofit(d, &["recover", "texture", "pictures", "--mesh", "rock.glb", "-o", "rock.glb"]);
    assert_misuse(&o, "the asset is not written over", &["--output", "--mesh", "another file"]);
    assert!(std::fs::read(d.join("rock.glb")).unwrap() == before);
    assert!(!d.join("out.glb").exists());
    // A list that never ends is not read.
    #[cfg(unix)]
    {
        let list = ["recover", "texture", "/dev/zero", "--mesh", "rock.glb", "-o", "out.glb"];
        assert_one_error(&photofit(d, &list), "a device", &["/dev/zero", "not a regular file"]);
    }
    let refused = run(&["--loss", "l1"]);
    assert_eq!(refused.status.code(), Some(2), "no such loss");
    assert!(["--loss", "'l1'", "log-l1", "ssim"].iter().all(|part| stderr(&refused).contains(part)));
    let help = stdout(&succeeds(d, &["recover", "texture", "--help"]));
    assert!(help.contains("--loss") && help.contains("relative-squares"), "{help}");
    assert!(help.contains("--mesh") && help.contains("transforms.json"), "{help}");
}

/// Renders a folder of `pictures` of `rock.glb` as the guide does, and lists them in `transforms.json`.
fn photograph(d: &Path) -> Value {
    std::fs::create_dir(d.join("pictures")).unwrap();
    let frame = |k: usize| {
        let (picture, figures) = (format!("pictures/{k}.exr"), format!("pictures/{k}.json"));
        let (azimuth, elevation) = ((30 * k).to_string(), if k.is_multiple_of(2) { "20" } else { "-20" });
        let line = ["render", "rock.glb", "-o", &picture, "--json", &figures, "--azimuth", &azimuth];
        succeeds(d, &[&line[..], &["--elevation", elevation, "--width", "48", "--height", "48"]].concat());
        let figures = read_json(&d.join(&figures));
        let mut frame = figures["camera"].clone();
        frame["file_path"] = json!(format!("{k}.exr"));
        frame["lights"] = figures["lights"].clone();
        frame
    };
    let file = json!({ "frames": (0..12).map(frame).collect::<Vec<Value>>() });
    std::fs::write(d.join("pictures/transforms.json"), file.to_string()).unwrap();
    file
}

#[test]
fn rendered_pictures_are_recovered_and_useless_ones_are_told() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 6, true);
    let mut file = photograph(d);
    let line =
        ["recover", "texture", "pictures", "--mesh", "rock.glb", "-o", "out.glb", "--texture-size", "64"];
    let run = |more: &[&str]| succeeds(d, &[&line[..], more].concat());
    let o = run(&["--steps", "400", "--json", "f.json", "--report", "r"]);
    assert_page(&d.join("r"), &["rock.glb from pictures", "recovered", "known lights"]);
    assert!(stdout(&o).contains("wrote r/index.html"), "{}", stdout(&o));
    assert!(!stderr(&o).contains("warning"), "{}", stderr(&o));
    let f = read_json(&d.join("f.json"));
    let psnr = |stage: &str| f[stage]["psnr"].as_f64().unwrap();
    assert_eq!(f["lit"], true);
    assert!(psnr("recovered") > psnr("start") + 10.0, "{f}");
    for frame in file["frames"].as_array_mut().unwrap() {
        frame["file_path"] = json!("0.exr");
    }
    std::fs::write(d.join("pictures/transforms.json"), file.to_string()).unwrap();
    let o = run(&["--steps", "1", "--loss", "ssim", "--report", "s"]);
    assert_page(&d.join("s"), &["ssim is asked for"]);
    assert!(stderr(&o).contains("warning: 12 frames have only 1 distinct picture"), "{}", stderr(&o));
}

#[test]
fn a_shape_is_recovered_from_pictures_of_itself_and_what_cannot_be_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 6, false);
    let line = ["recover", "mesh", "--self-test", "rock.glb", "-o", "out.glb", "--json", "f.json"];
    let small = ["--picture-size", "48", "--views", "12", "--triangles", "320", "--texture-size", "64"];
    let more = ["--steps", "200", "--optimizer", "bilateral", "--report", "r"];
    let o = succeeds(d, &[&line[..], &small[..], &more].concat());
    assert_page(&d.join("r"), &["out.glb from pictures", "recovered", "held out"]);
    assert!(stdout(&o).contains("of the bounding radius away on average"), "{}", stdout(&o));
    let f = read_json(&d.join("f.json"));
    let mean = |k: &str| f["shape_error"][k]["mean_percent"].as_f64().unwrap();
    assert!(mean("last") < 0.5 * mean("first"), "{f}");
    assert!(f["loss"]["last"].as_f64().unwrap() < f["loss"]["first"].as_f64().unwrap(), "{f}");
    assert_eq!((&f["triangles"], &f["pictures_held_out"]), (&json!(320), &json!(1)));
    std::fs::create_dir(d.join("none")).unwrap();
    let o = photofit(d, &["recover", "mesh", "none", "-o", "o.glb"]);
    assert_one_error(&o, "no list of pictures", &["transforms.json"]);
    let before = std::fs::read(d.join("rock.glb")).unwrap();
    let o = photofit(d, &["recover", "mesh", "--self-test", "rock.glb", "-o", "rock.glb"]);
    assert_misuse(&o, "the asset is not written over", &["--output", "--self-test", "another file"]);
    assert!(std::fs::read(d.join("rock.glb")).unwrap() == before);
}

/// The page of a report in a folder holds pictures and these words.
fn assert_page(folder: &Path, parts: &[&str]) {
    let page = std::fs::read_to_string(folder.join("index.html")).unwrap();
    for part in parts.iter().chain(&["data:image/png", "PSNR", "<svg"]) {
        assert!(page.contains(part), "{part:?} is not in the page");
    }
}

#[test]
fn no_figures_replace_a_picture_of_the_shape() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 4, false);
    photograph(d);
    let before = std::fs::read(d.join("pictures/3.exr")).unwrap();
    let o = photofit(d, &["recover", "mesh", "pictures", "-o", "out.glb", "--json", "pictures/3.exr"]);
    assert_misuse(&o, "a picture", &["--json", "PICTURES", "another file"]);
    assert!(std::fs::read(d.join("pictures/3.exr")).unwrap() == before && !d.join("out.glb").exists());
}

#[test]
fn what_a_painted_asset_does_not_keep_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let mut asset = rock(4, false);
    let eye = glam::vec3(0.0, 1.0, 4.0);
    asset.cameras = vec![Camera::look_at(eye, glam::Vec3::ZERO, glam::Vec3::Y, 0.8, 1.0, 0.1, 10.0)];
    asset.about.copyright = "2026 A. Painter".into();
    asset.hierarchy = Some(std::sync::Arc::new(Hierarchy {
        nodes: vec![Node { name: "stone".into(), mesh: Some(0), ..Node::default() }],
        roots: vec![0],
        meshes: vec![NodeMesh {
            primitives: vec![NodePrimitive { primitive: 0, bind: None, extras: None }],
            ..NodeMesh::default()
        }],
        placements: vec![Placement { node: 0, part: 0 }],
        ..Hierarchy::default()
    }));
    photofit_scene::save_glb(d.join("rock.glb"), &asset).unwrap();
    photograph(d);
    let line = ["recover", "texture", "pictures", "--mesh", "rock.glb", "-o", "out.glb", "--json", "f.json"];
    let o = succeeds(d, &[&line[..], &["--texture-size", "16", "--steps", "1"]].concat());
    let lost = "1 name of nodes and meshes";
    assert!(stderr(&o).contains(&format!("warning: rock.glb: left out: {lost}")), "{}", stderr(&o));
    let f = read_json(&d.join("f.json"));
    assert_eq!(f["left_out"], json!([lost]));
    let written = photofit_scene::load(d.join("out.glb")).unwrap();
    assert_eq!((written.cameras.len(), written.about.copyright.as_str()), (1, "2026 A. Painter"));
}
