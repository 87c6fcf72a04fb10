//! `photofit recover volume`: what it writes, stopping and resuming, pictures with lights, what is refused.

use crate::support::{assert_misuse, assert_one_error, photofit, read_json, stderr, stdout, succeeds};
use photofit_image::Image;
use photofit_scene::mitsuba::{encode_grid, parse_grid};
use serde_json::{Value, json};
use std::path::Path;

const SIDE: usize = 16;

/// A ball of extinction 6 in the cube from -1 to 1.
fn write_ball(folder: &Path) {
    let at = |i: usize| (i as f32 + 0.5) / SIDE as f32 * 2.0 - 1.0;
    let values: Vec<f32> = (0..SIDE.pow(3))
        .map(|i| {
            let r = at(i % SIDE).hypot(at(i / SIDE % SIDE)).hypot(at(i / SIDE / SIDE));
            6.0 * (2.0 - 2.5 * r).clamp(0.0, 1.0)
        })
        .collect();
    let bounds = [glam::DVec3::splat(-1.0), glam::DVec3::splat(1.0)];
    std::fs::write(folder.join("ball.vol"), encode_grid([SIDE; 3], &values, bounds)).unwrap();
}

fn figures(folder: &Path) -> Value {
    read_json(&folder.join("values.json"))
}

/// Mean of the extinction that was written.
fn mean(folder: &Path) -> f32 {
    let (_, values, _) = parse_grid(&std::fs::read(folder.join("extinction.vol")).unwrap()).unwrap();
    values.iter().map(|v| v.x).sum::<f32>() / values.len() as f32
}

#[test]
fn a_known_cloud_is_found_stopped_and_resumed() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_ball(d);
    let run = |more: &[&str]| {
        let base = ["recover", "volume", "--self-test", "ball.vol", "--size", "16", "--steps", "60"];
        let small = ["--views", "6", "--resolution", "24", "--max-depth", "4", "--gradient-spp", "2"];
        succeeds(d, &[&base[..], &small, more].concat())
    };
    let o = run(&["-o", "whole", "--explain"]);
    assert!(!stderr(&o).contains("what it was at the start"), "{}", stderr(&o));
    let text = stdout(&o);
    assert!(text.contains("16 x 16 x 16 voxels, grids of 8, 16") && text.contains("held out"), "{text}");
    let f = figures(&d.join("whole"));
    let error = |which: &str| f["parameter_error"][which].as_f64().unwrap();
    assert!(error("last") < 0.8 * error("first"), "{f}");
    let relative = |which: &str| f["relative_error"][which].as_f64().unwrap();
    assert!(relative("best") < 0.15 * relative("first"), "{f}");
    assert_eq!((f["voxels"].clone(), f["held_out"].clone()), (json!([16, 16, 16]), json!(5)));
    assert!(d.join("whole/views.png").is_file());
    let page = std::fs::read_to_string(d.join("whole/index.html")).unwrap();
    for part in ["a cloud on 16 x 16 x 16 voxels", "data:image/png", "picture 5 was held out", "<svg"] {
        assert!(page.contains(part), "{part:?} is not in the page");
    }
    run(&["-o", "cut", "--checkpoint", "state", "--time-limit", "0.3"]);
    run(&["-o", "end", "--checkpoint", "state", "--resume"]);
    for file in ["extinction.vol", "albedo.vol"] {
        let [a, b] = ["whole", "end"].map(|f| std::fs::read(d.join(f).join(file)).unwrap());
        assert!(a == b, "{file}");
    }
    let one = stdout(&run(&["-o", "one", "--one-grid"]));
    assert!(one.contains("grids of 16 along"), "{one}");
    assert!(!d.join("one/emission.vol").exists());
}

#[test]
fn a_known_cloud_is_found_with_the_light_that_it_emits() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_ball(d);
    let base = [
        "recover",
        "volume",
        "--self-test",
        "ball.vol",
        "--emission",
        "--size",
        "16",
        "--steps",
        "60",
        "-o",
        "out",
    ];
    let small = ["--views", "6", "--resolution", "24", "--max-depth", "4", "--gradient-spp", "2"];
    let text = stdout(&succeeds(d, &[&base[..], &small].concat()));
    assert!(text.contains("error of the emission"), "{text}");
    let f = figures(&d.join("out"));
    let error = |which: &str| f["emission_error"][which].as_f64().unwrap();
    assert!(error("last") < 0.9 * error("first"), "{f}");
    let (size, values, _) = parse_grid(&std::fs::read(d.join("out/emission.vol")).unwrap()).unwrap();
    assert_eq!(size, [16; 3]);
    // Red of the self-test is brighter than its blue.
    let sum = values.iter().fold([0.0; 2], |s, v| [s[0] + v.x, s[1] + v.z]);
    assert!(sum[0] > sum[1], "{sum:?}");
}

/// Pictures of nothing under light from all around, from four sides.
fn write_pictures(folder: &Path, lights: &Value) {
    let pictures = folder.join("pictures");
    std::fs::create_dir_all(&pictures).unwrap();
    let frame = |k: usize| {
        let (sin, cos) = (k as f64 * std::f64::consts::FRAC_PI_2).sin_cos();
        let image = Image::from_fn(12, 12, 3, |_, _, _| 0.5);
        photofit_image::write_exr(pictures.join(format!("{k}.exr")), &[("", &image, &["R", "G", "B"])])
            .unwrap();
        let rows = [[cos, 0.0, sin, 4.0 * sin], [0.0, 1.0, 0.0, 0.0], [-sin, 0.0, cos, 4.0 * cos]];
        let rows: Vec<Value> = rows.iter().map(|r| json!(r)).chain([json!([0, 0, 0, 1])]).collect();
        json!({ "file_path": format!("{k}.exr"), "transform_matrix": rows })
    };
    let frames: Vec<Value> = (0..4).map(frame).collect();
    let mut file = json!({ "camera_angle_x": 0.7, "frames": frames });
    if !lights.is_null() {
        file["lights"] = lights.clone();
    }
    std::fs::write(pictures.join("transforms.json"), file.to_string()).unwrap();
}

#[test]
fn pictures_with_lights_are_read_and_an_empty_box_is_found_empty() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_pictures(d, &json!([{ "type": "ambient", "radiance": [0.5, 0.5, 0.5] }]));
    let line =
        ["recover", "volume", "pictures", "-o", "out", "--size", "8", "--steps", "40", "--albedo", "0.3"];
    let o = succeeds(d, &line);
    assert!(!stderr(&o).contains("warning: pictures have alpha"), "{}", stderr(&o));
    let alike = "warning: pictures: 4 frames have only 1 distinct picture";
    assert!(stderr(&o).contains(alike), "{}", stderr(&o));
    // Half the side of the cube: 4 sin(.35). The fit starts from an optical thickness of .5.
    let f = figures(&d.join("out"));
    let half = 4.0 * 0.35_f64.sin();
    assert!((f["box"][1][0].as_f64().unwrap() - half).abs() < 1e-3, "{f}");
    assert!(mean(&d.join("out")) < 0.1 * (0.25 / half) as f32, "{}", mean(&d.join("out")));
    write_pictures(d, &Value::Null);
    assert_one_error(&photofit(d, &line), "no light", &["pictures", "names no lights", "--env"]);
    let point = [&line[..], &["--bounds", "0,0,0,0,1,1"]].concat();
    write_pictures(d, &json!([{ "type": "ambient", "radiance": [0.5, 0.5, 0.5] }]));
    assert_misuse(&photofit(d, &point), "a flat box", &["--bounds", "have a volume"]);
    // Before a picture is read.
    let early = ["recover", "volume", "none", "-o", "out", "--bounds", "0,0,0,0,1,1"];
    assert_misuse(&photofit(d, &early), "a flat box", &["--bounds", "have a volume"]);
}

#[test]
fn what_cannot_be_used_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_ball(d);
    let run = |grid: &str| photofit(d, &["recover", "volume", "--self-test", grid, "-o", "out"]);
    assert_one_error(&run("none.vol"), "no file", &["none.vol"]);
    let whole = std::fs::read(d.join("ball.vol")).unwrap();
    std::fs::write(d.join("cut.vol"), &whole[..100]).unwrap();
    assert_one_error(&run("cut.vol"), "a cut file", &["cut.vol", "has 100 bytes"]);
    let coloured = encode_grid([1; 3], &[1.0, 2.0, 3.0], [glam::DVec3::ZERO, glam::DVec3::ONE]);
    std::fs::write(d.join("coloured.vol"), coloured).unwrap();
    assert_one_error(&run("coloured.vol"), "colours", &["coloured.vol: voxel 0 holds [1.0, 2.0, 3.0]"]);
    // A box that no camera sees.
    let beside = [
        "--bounds",
        "10,10,10,11,11,11",
        "--size",
        "8",
        "--steps",
        "6",
        "--resolution",
        "16",
        "--views",
        "4",
    ];
    let o = succeeds(
        d,
        &[&["recover", "volume", "--self-test", "ball.vol", "-o", "beside"][..], &beside].concat(),
    );
    assert!(stderr(&o).contains("warning: the error is what it was at the start"), "{}", stderr(&o));
    for more in [&[][..], &["--self-test", "ball.vol", "--bounds", "1,2,3"]] {
        let o = photofit(d, &[&["recover", "volume", "-o", "out"], more].concat());
        assert_eq!(o.status.code(), Some(2), "{}", stderr(&o));
    }
    let over =
        ["recover", "volume", "--self-test", "ball.vol", "-o", "out", "--checkpoint", "out/values.json"];
    let refusal = photofit(d, &over);
    assert_misuse(&refusal, "a folder in place of a file", &["--checkpoint", "--output", "out/values.json"]);
    assert!(!d.join("out").exists(), "nothing is written before the input is read");
    // The grid of a self-test is not replaced by the one that is found.
    std::fs::create_dir(d.join("out")).unwrap();
    std::fs::copy(d.join("ball.vol"), d.join("out/extinction.vol")).unwrap();
    let o = run("out/extinction.vol");
    assert_misuse(&o, "the grid itself", &["--output", "--self-test", "another file"]);
    assert!(std::fs::read(d.join("out/extinction.vol")).unwrap() == whole);
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("/dev/zero", d.join("zero.vol")).unwrap();
        assert_one_error(&run("zero.vol"), "no end", &["zero.vol", "not a regular file"]);
    }
}
