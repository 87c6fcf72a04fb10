//! `photofit recover material`: what it writes, stopping and resuming, folders of pictures, what is refused.

use crate::support::{
    assert_misuse, assert_one_error, names, of_mesh, photofit, read_json, stderr, stdout, succeeds,
    write_rock,
};
use photofit_geometry::shapes::parallelogram;
use photofit_image::Image;
use photofit_scalar::vec3;
use photofit_scene::Material;
use serde_json::{Value, json};
use std::path::Path;

fn figures(folder: &Path) -> Value {
    read_json(&folder.join("values.json"))
}

#[test]
fn known_materials_are_found_stopped_and_resumed() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 4, true);
    let run = |more: &[&str]| {
        let base = ["recover", "material", "--self-test", "rock.glb", "--views", "6", "--resolution", "24"];
        let small = ["--texture-size", "32", "--environment-size", "4", "--max-depth", "2", "--spp", "8"];
        succeeds(d, &[&base[..], &small, &["--steps", "60", "--guiding", "lobes"], more].concat())
    };
    let o = run(&["-o", "whole", "--explain"]);
    let text = stdout(&o);
    for part in ["mean error of base colour", "under another environment", "guiding (lobes)", "held out"] {
        assert!(text.contains(part), "{part:?} in {text}");
    }
    let f = figures(&d.join("whole"));
    let relative = |which: &str| f["relative_error"][which].as_f64().unwrap();
    assert!(relative("best") < 0.5 * relative("first"), "{f}");
    assert_eq!((&f["steps"], &f["held_out"], &f["unwrapped"]), (&json!(60), &json!(5), &json!(false)));
    for error in ["albedo", "scaled_albedo", "roughness", "metallic"] {
        let value = f["errors"][error].as_f64().unwrap();
        assert!(value > 0.0 && value < 0.5, "{error}: {f}");
    }
    assert!(f["errors"]["scaled_relit_psnr"].as_f64().unwrap() > 15.0, "{f}");
    assert_eq!(f["guiding"].as_array().unwrap().len(), 1, "of the second round");
    let guide = &f["guiding"][0];
    assert!(text.contains(guide["told"].as_str().unwrap()) && guide["rounds"].as_u64() >= Some(3), "{guide}");
    let files = ["environment.exr", "index.html", "material.glb", "relit.png", "values.json", "views.png"];
    assert_eq!(names(&d.join("whole")), files);
    let page = std::fs::read_to_string(d.join("whole/index.html")).unwrap();
    for part in ["materials of rock.glb from pictures", "data:image/png", "guided paths", "<svg"] {
        assert!(page.contains(part), "{part:?} is not in the page");
    }
    let sky = photofit_image::read(d.join("whole/environment.exr")).unwrap();
    assert_eq!((sky.width, sky.height), (8, 4));
    // Before the first step, and among the first ones.
    for (limit, cut, state, end) in [("0.0001", "cut 0", "state 0", "end 0"), ("0.1", "cut", "state", "end")]
    {
        run(&["-o", cut, "--checkpoint", state, "--time-limit", limit]);
        assert_eq!(figures(&d.join(cut))["stopped"], true);
        run(&["-o", end, "--checkpoint", state, "--resume", "--threads", "1"]);
        for file in ["material.glb", "environment.exr"] {
            let [a, b] = ["whole", end].map(|f| std::fs::read(d.join(f).join(file)).unwrap());
            assert!(a == b, "{file} after {limit} s");
        }
    }
}

/// Pictures of a grey ball in grey light, from four sides, listed by `transforms.json` with this lens.
fn write_pictures(folder: &Path, lens: &Value) {
    let pictures = folder.join("pictures");
    std::fs::create_dir_all(&pictures).unwrap();
    let frame = |k: usize| {
        let (sin, cos) = (k as f64 * std::f64::consts::FRAC_PI_2).sin_cos();
        write_picture(&pictures.join(format!("{k}.exr")), 16, 0.3);
        let rows = [[cos, 0.0, sin, 4.0 * sin], [0.0, 1.0, 0.0, 0.0], [-sin, 0.0, cos, 4.0 * cos]];
        let rows: Vec<Value> = rows.iter().map(|r| json!(r)).chain([json!([0, 0, 0, 1])]).collect();
        json!({ "file_path": format!("{k}.exr"), "transform_matrix": rows })
    };
    let mut file = lens.clone();
    file["frames"] = (0..4).map(frame).collect();
    std::fs::write(pictures.join("transforms.json"), file.to_string()).unwrap();
}

fn write_picture(file: &Path, size: usize, value: f32) {
    let image = Image::from_fn(size, size, 3, |_, _, _| value);
    photofit_image::write_exr(file, &[("", &image, &["R", "G", "B"])]).unwrap();
}

const LINE: [&str; 8] = ["recover", "material", "pictures", "--mesh", "rock.glb", "-o", "out", "--steps"];

#[test]
fn pictures_of_a_folder_are_read_and_a_mesh_without_uvs_gets_some() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 4, false);
    write_pictures(d, &json!({ "camera_angle_x": 0.7 }));
    let o = succeeds(d, &[&LINE[..], &["20", "--texture-size", "64", "--environment-size", "2"]].concat());
    let f = figures(&d.join("out"));
    assert_eq!((&f["unwrapped"], &f["errors"], &f["steps"]), (&json!(true), &Value::Null, &json!(20)));
    assert!(!stdout(&o).contains("under another environment"), "{}", stdout(&o));
    let found = photofit_scene::load(d.join("out/material.glb")).unwrap();
    assert_eq!((found.images.len(), found.images[0].width), (2, 64));
    let mesh = &found.primitives[0].mesh;
    assert_eq!(mesh.uvs.len(), mesh.positions.len());
    assert!(!d.join("out/relit.png").exists());
}

#[test]
fn what_cannot_be_used_is_refused_in_one_line() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 4, false);
    let run = |more: &[&str]| photofit(d, &[&LINE[..], &["2", "--texture-size", "16"], more].concat());
    std::fs::create_dir(d.join("pictures")).unwrap();
    assert_one_error(&run(&[]), "an empty folder", &["pictures", "transforms.json"]);
    write_pictures(d, &json!({}));
    assert_one_error(&run(&[]), "no lens", &["transforms.json", "frame 0", "camera_angle_x"]);
    write_pictures(d, &json!({ "camera_angle_x": 0.7 }));
    let list = d.join("pictures/transforms.json");
    let whole = read_json(&list);
    for (what, change, parts) in [
        ("no frames", json!([]), &["transforms.json", "0 frames", "at least 1"][..]),
        ("no camera", json!([{ "file_path": "0.exr" }]), &["transforms.json", "transform_matrix"]),
    ] {
        let mut file = whole.clone();
        file["frames"] = change;
        std::fs::write(&list, file.to_string()).unwrap();
        assert_one_error(&run(&[]), what, parts);
    }
    std::fs::write(&list, whole.to_string()).unwrap();
    write_picture(&d.join("pictures/2.exr"), 8, 0.3);
    assert_one_error(&run(&[]), "another size", &["frame 2", "8 x 8", "16 x 16"]);
    write_picture(&d.join("pictures/2.exr"), 16, f32::NAN);
    assert_one_error(&run(&[]), "NaN", &["frame 2", "pixel (0, 0) is NaN; it must be finite"]);
    write_picture(&d.join("pictures/2.exr"), 16, 1e30);
    assert_one_error(&run(&[]), "1e30", &["frame 2", "pixel (0, 0) is 1e30", "at most 1e15"]);
    write_picture(&d.join("pictures/2.exr"), 16, 0.3);
    // Cameras that look past the mesh.
    let mut file = whole.clone();
    for frame in file["frames"].as_array_mut().unwrap() {
        frame["transform_matrix"][1][3] = json!(100.0);
    }
    std::fs::write(&list, file.to_string()).unwrap();
    assert_one_error(&run(&[]), "nothing is seen", &["pictures", "in no pixel whole", "transform_matrix"]);
    std::fs::write(&list, whole.to_string()).unwrap();
    // A mesh without texture coordinates and without an area, which no atlas unwraps.
    let line = parallelogram(vec3(0.0, 0.0, 0.0), vec3(1.0, 0.0, 0.0), vec3(2.0, 0.0, 0.0));
    photofit_scene::save_glb(d.join("line.glb"), &of_mesh(line, Material::clay(), Vec::new())).unwrap();
    for source in [&["pictures", "--mesh", "line.glb"][..], &["--self-test", "line.glb"]] {
        let o = photofit(d, &[&["recover", "material", "-o", "out"], source].concat());
        assert_one_error(&o, "no area", &["line.glb", "area"]);
    }
    assert!(!d.join("out").join("material.glb").exists());
    for wrong in [&["pictures"][..], &[], &["pictures", "--self-test", "rock.glb"]] {
        let o = photofit(d, &[&["recover", "material", "-o", "out"], wrong].concat());
        assert_eq!(o.status.code(), Some(2), "{wrong:?}: {}", stderr(&o));
    }
    let unused = ["recover", "material", "--self-test", "rock.glb", "-o", "out", "--guiding", "lobes"];
    let o = photofit(d, &[&unused[..], &["--rounds", "1"]].concat());
    assert_misuse(&o, "a guide that is never asked", &["--guiding", "--rounds", "at least 2"]);
    let o = run(&["--env", "out/environment.exr"]);
    assert_misuse(&o, "the environment is not written over", &["--output", "--env", "another file"]);
}
