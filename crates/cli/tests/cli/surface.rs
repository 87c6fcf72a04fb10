//! `photofit surface`: outputs, cameras, and clouds that cannot be used.

use crate::support::{assert_one_error, names, photofit, read_json, stdout, succeeds};
use std::fmt::Write as _;
use std::path::Path;

/// A coloured sphere of radius 1 as an ASCII PLY file.
fn write_sphere(folder: &Path, count: usize) {
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {count}\nproperty float x\nproperty float y\nproperty float z\n\
        property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
    );
    for i in 0..count {
        let z = 1.0 - (2 * i + 1) as f64 / count as f64;
        let (r, turn) = ((1.0 - z * z).sqrt(), i as f64 * 2.399_963);
        let _ = writeln!(text, "{} {} {z} 200 100 50", r * turn.cos(), r * turn.sin());
    }
    std::fs::write(folder.join("sphere.ply"), text).unwrap();
}

#[test]
fn a_sphere_becomes_maps_without_holes() {
    let dir = tempfile::tempdir().unwrap();
    write_sphere(dir.path(), 4000);
    let size = ["--width", "120", "--height", "90"];
    let o = succeeds(
        dir.path(),
        &[&["surface", "sphere.ply", "-o", "out", "--json", "a.json"], &size[..]].concat(),
    );
    assert!(stdout(&o).contains("4,000 points"), "{}", stdout(&o));
    let expected =
        ["albedo.png", "camera.json", "depth.png", "normal.png", "shaded.png", "sheet.png", "surface.exr"];
    assert_eq!(names(&dir.path().join("out")), expected);
    let figures = read_json(&dir.path().join("a.json"));
    assert_eq!((figures["points"].as_u64(), figures["method"].as_str()), (Some(4000), Some("fast")));
    let layers = photofit_image::read_exr_layers(dir.path().join("out/surface.exr")).unwrap();
    let layer = |name: &str| layers.iter().find(|l| l.0 == name).map(|l| &l.1).unwrap();
    let (depth, normal, albedo) = (layer("depth"), layer("normal"), layer("albedo"));
    assert_eq!((depth.width, depth.height), (120, 90));
    // The sphere as the written camera sees it: holes and wrong depths would both show.
    let camera = read_json(&dir.path().join("out/camera.json"));
    let v = |key: &str| -> Vec<f64> {
        camera[key].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
    };
    let (eye, forward) = (v("eye"), v("forward"));
    let distance = eye.iter().map(|x| x * x).sum::<f64>().sqrt();
    let middle = depth.pixel(60, 45)[0];
    assert!((f64::from(middle) - (distance - 1.0)).abs() < 0.02, "{middle}");
    let towards: f64 = (0..3).map(|k| f64::from(normal.pixel(60, 45)[k]) * forward[k]).sum();
    assert!(towards < -0.99, "{towards}");
    let linear = photofit_image::srgb_u8_to_linear(200);
    assert!((albedo.pixel(60, 45)[0] - linear).abs() < 0.01);
    let focal = camera["fy"].as_f64().unwrap();
    let covered = depth.data.iter().filter(|z| **z > 0.0).count() as f64;
    let sine = 1.0 / distance;
    let disc = std::f64::consts::PI * focal * focal * sine * sine / (1.0 - sine * sine);
    assert!((covered / disc - 1.0).abs() < 0.06, "{covered} pixels of {disc}");
    // The camera that was written gives the same bits again, with any number of threads.
    let again = ["surface", "sphere.ply", "-o", "again", "--camera", "out/camera.json"];
    succeeds(dir.path(), &again);
    let bytes = |folder: &str| std::fs::read(dir.path().join(folder).join("surface.exr")).unwrap();
    assert!(bytes("out") == bytes("again"));
    for method in ["blend", "hybrid"] {
        let run = ["surface", "sphere.ply", "-o", method, "--method", method, "--iterations", "12", "--fill"];
        succeeds(dir.path(), &[&run[..], &size[..]].concat());
        let layers = photofit_image::read_exr_layers(dir.path().join(method).join("surface.exr")).unwrap();
        assert!(layers[0].1.data.iter().all(|z| z.is_finite()), "{method}");
        let depth = layers.iter().find(|l| l.0 == "depth").unwrap();
        assert!(depth.1.data.iter().all(|z| *z > 0.0), "{method}: the whole picture is filled");
    }
}

#[test]
fn clouds_and_cameras_that_cannot_be_used() {
    let dir = tempfile::tempdir().unwrap();
    write_sphere(dir.path(), 50);
    let write = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).unwrap();
    let head = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\n";
    write("empty.pcd", &format!("{head}WIDTH 0\nHEIGHT 1\nDATA ascii\n"));
    write("nan.pcd", &format!("{head}WIDTH 1\nHEIGHT 1\nDATA ascii\nnan nan nan\n"));
    let ply = |points: &[&str]| {
        let head = "ply\nformat ascii 1.0\nelement vertex";
        let fields = "property float x\nproperty float y\nproperty float z\nend_header";
        format!("{head} {}\n{fields}\n{}\n", points.len(), points.join("\n"))
    };
    write("empty.ply", &ply(&[]));
    write("zero.ply", "");
    write("one.ply", &ply(&["1 2 3"]));
    write("nan.ply", &ply(&["nan 1 2", "0 inf 0", "nan nan nan", "0 0 -inf"]));
    write("few.ply", &ply(&["0 0 0", "nan 1 1", "1 0 0"]));
    write("bad.pcd", "FIELDS x y z\nSIZE four\n");
    write("huge.pcd", &format!("{head}WIDTH 4000000000\nHEIGHT 4000000000\nDATA binary\n"));
    write("away.json", r#"{"eye":[0,0,5],"target":[0,0,9],"width":32,"height":32}"#);
    write("list.json", "[1]");
    write("half.json", r#"{"eye":[0,0,5],"width":32,"height":32}"#);
    write("word.json", r#"{"eye":[0,"b",5],"target":[0,0,0],"width":32,"height":32}"#);
    write("size.json", r#"{"eye":[0,0,5],"target":[0,0,0],"width":32,"height":0.5}"#);
    write("wide.json", r#"{"eye":[0,0,5],"target":[0,0,0],"width":32,"height":32,"fov_y_degrees":200}"#);
    for (cloud, camera, parts) in [
        (
            "sphere.ply",
            Some("wide.json"),
            &["wide.json", "`fov_y_degrees` is 200; it must be 0.1 to 179"][..],
        ),
        ("none.ply", None, &["none.ply", "cannot be read"]),
        ("empty.pcd", None, &["empty.pcd", "at least one point"]),
        ("nan.pcd", None, &["nan.pcd", "finite"]),
        ("empty.ply", None, &["empty.ply", "at least one point"]),
        ("zero.ply", None, &["zero.ply", "empty"]),
        ("one.ply", None, &["one.ply", "is 1;", "at least 3"]),
        ("nan.ply", None, &["nan.ply", "finite"]),
        ("few.ply", None, &["few.ply", "is 2;", "at least 3"]),
        ("bad.pcd", None, &["bad.pcd", "header line 2", "SIZE"]),
        ("huge.pcd", None, &["huge.pcd", "POINTS", "at most"]),
        ("sphere.ply", Some("away.json"), &["sphere.ply", "none of the 50 points", "in front of the camera"]),
        ("sphere.ply", Some("list.json"), &["list.json", "is [1]; it must be an object"]),
        ("sphere.ply", Some("half.json"), &["half.json", "has no `right`; it must have one"]),
        (
            "sphere.ply",
            Some("word.json"),
            &["word.json", "`eye` is [0,\"b\",5]; it must be an array of three numbers"],
        ),
        (
            "sphere.ply",
            Some("size.json"),
            &["size.json", "`height` is 0.5; it must be a whole number, 1 to 16384"],
        ),
        ("sphere.ply", Some("gone.json"), &["gone.json", "No such file"]),
    ] {
        let mut arguments = vec!["surface", cloud, "-o", "out"];
        arguments.extend(camera.into_iter().flat_map(|c| ["--camera", c]));
        let o = photofit(dir.path(), &arguments);
        let text = String::from_utf8_lossy(&o.stderr).into_owned();
        assert_eq!(o.status.code(), Some(1), "{cloud} {camera:?}: {text}");
        let last = text.lines().last().unwrap_or_default();
        assert!(last.starts_with("error: ") && parts.iter().all(|p| last.contains(p)), "{cloud}: {text}");
        assert!(!dir.path().join("out").exists(), "nothing is written");
    }
    std::fs::write(dir.path().join("plain"), b"x").unwrap();
    assert_one_error(
        &photofit(dir.path(), &["surface", "sphere.ply", "-o", "plain"]),
        "a file",
        &["not a folder"],
    );
}
