//! `render`, `compare` and `inspect`.

use crate::support::{
    assert_one_error, names, photofit, read_json, rock, stderr, stdout, succeeds, write_rock,
};
use photofit_scene::{Clearcoat, Extensions, LightKind, PunctualLight};

#[test]
fn pictures_have_the_size_light_and_background_asked_for() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 8, true);
    let small = ["--width", "40", "--height", "24"];
    let render = |output: &str, more: &[&str]| {
        succeeds(d, &[&["render", "rock.glb", "-o", output][..], &small, more].concat());
        photofit_image::read(d.join(output)).unwrap()
    };
    let png = render("a.png", &["--spp", "4"]);
    assert_eq!((png.width, png.height, png.channels), (40, 24, 4));
    assert_eq!(png.pixel(0, 0)[3], 0.0, "the background is transparent");
    assert_eq!(png.pixel(20, 12)[3], 1.0, "the asset is in the middle");
    let exr = render("a.exr", &["--spp", "4"]);
    let close = png.data.iter().zip(&exr.data).filter(|(a, b)| (*a - *b).abs() < 0.02).count();
    assert!(close as f64 > 0.9 * png.data.len() as f64, "both show the same, {close} of {}", png.data.len());
    let mean = |i: &photofit_image::Image| i.data.iter().sum::<f32>() / i.data.len() as f32;
    let far = render("far.exr", &["--distance", "20", "--light", "headlight"]);
    assert!(mean(&far.select(&[3])) < 0.1 * mean(&exr.select(&[3])), "far away it is small");
    let turned = render("b.exr", &["--azimuth", "-100", "--elevation", "-30"]);
    assert!(turned.data != exr.data);

    let sky = photofit_image::Image::from_fn(16, 8, 3, |_, y, c| if y < 4 && c == 0 { 4.0 } else { 0.1 });
    photofit_image::write_exr(d.join("sky.exr"), &[("", &sky, &["R", "G", "B"])]).unwrap();
    let red = render("red.exr", &["--light", "env", "--env", "sky.exr"]);
    assert!(mean(&red.select(&[0])) > 1.5 * mean(&red.select(&[2])), "lit by the environment");
}

#[test]
fn images_and_assets_are_compared() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 10, true);
    photofit_scene::save_glb(d.join("coarse.glb"), &rock(4, true)).unwrap();
    for (asset, picture) in [("rock.glb", "a.png"), ("coarse.glb", "b.png")] {
        succeeds(d, &["render", asset, "-o", picture, "--width", "64", "--height", "64"]);
    }
    let compare = |a: &str, b: &str, more: &[&str]| {
        let o = succeeds(d, &[&["compare", a, b, "--json", "c.json"][..], more].concat());
        assert!(stdout(&o).contains("PSNR"));
        read_json(&d.join("c.json"))
    };
    let figures = compare("a.png", "b.png", &["--heatmap", "heat.png"]);
    assert_eq!(photofit_image::read(d.join("heat.png")).unwrap().width, 64);
    let views = ["--views", "2", "--resolution", "64", "--heatmap", "sheet.png"];
    let assets = compare("rock.glb", "coarse.glb", &views);
    assert_eq!(assets["views"].as_array().unwrap().len(), 2);
    for f in [&figures, &assets] {
        assert_eq!(f["psnr_is"], "exact");
        let at = |key: &str| f[key].as_f64().unwrap();
        assert!((8.0..50.0).contains(&at("psnr")) && (0.2..1.0).contains(&at("ssim")), "{f}");
        assert!(at("flip") > 0.0 && at("rmse") > 0.0);
    }
    let same = compare("a.png", "a.png", &[]);
    assert_eq!((same["rmse"].as_f64(), same["ssim"].as_f64()), (Some(0.0), Some(1.0)));
    assert!(same["psnr"].is_null() && same["psnr_is"] == "infinite", "infinity has no number in JSON");
    let same = compare("rock.glb", "rock.glb", &["--views", "1", "--resolution", "32"]);
    assert_eq!(same["flip"].as_f64(), Some(0.0));
    assert!(same["psnr"] == 60.0 && same["psnr_is"] == "at least", "{same}");
}

#[test]
fn inspect_tells_contents_and_plan() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 4, true);
    let o = succeeds(d, &["inspect", "rock.glb", "--json", "i.json"]);
    let text = stdout(&o);
    for part in [
        "320 triangles",
        "opaque",
        "image 0",
        "16 x 16",
        "memory",
        "skip transparent layers",
        "run  textures",
    ] {
        assert!(text.contains(part), "{part} in {text}");
    }
    let i = read_json(&d.join("i.json"));
    assert_eq!(i["triangles"], 320);
    assert_eq!(i["images"][0]["width"], 16);
    assert!(i["memory"]["geometry"].as_u64().unwrap() > 320 * 12);
    let plan = i["plan"].as_array().unwrap();
    let runs = |what: &str| plan.iter().find(|p| p["what"] == what).unwrap()["runs"].as_bool().unwrap();
    assert!(runs("textures") && !runs("emission") && !runs("alpha gradients"));
    // An asset that cannot be fitted can still be looked at.
    let points = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n";
    std::fs::write(d.join("points.ply"), points).unwrap();
    assert!(stdout(&succeeds(d, &["inspect", "points.ply"])).contains("is not possible"));
    assert_eq!(names(d), ["i.json", "points.ply", "rock.glb"]);
}

/// Normals and skins are told as the file has them.
#[test]
fn inspect_tells_what_the_file_has() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvn 0 0 1\n";
    for (faces, given) in [("f 1//1 2//1 3//1\n", true), ("f 1/1 2/1 3/1\n", false)] {
        std::fs::write(d.join("a.obj"), format!("{square}{faces}")).unwrap();
        let text = stdout(&succeeds(d, &["inspect", "a.obj", "--json", "i.json"]));
        assert_eq!(text.contains("; normals\n"), given, "{text}");
        assert_eq!(text.contains("uv 0, normals are computed\n"), !given, "{text}");
        let of = &read_json(&d.join("i.json"))["primitives"][0];
        assert_eq!(of["computed_normals"], !given, "{of}");
        assert_eq!(
            of["attributes"],
            if given { serde_json::json!(["normals"]) } else { serde_json::json!(["uv 0"]) }
        );
    }
    // A triangle that hangs on a joint.
    let data = "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAAAAAAAAAAAAAIA/\
                AAAAAAAAAAAAAAAA";
    let skinned = serde_json::json!({
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0, "skin": 0}, {"name": "hip"}],
        "skins": [{"name": "body", "joints": [1]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "JOINTS_0": 1, "WEIGHTS_0": 2}}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
            {"bufferView": 1, "componentType": 5121, "count": 3, "type": "VEC4"},
            {"bufferView": 2, "componentType": 5126, "count": 3, "type": "VEC4"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 36},
            {"buffer": 0, "byteOffset": 36, "byteLength": 12},
            {"buffer": 0, "byteOffset": 48, "byteLength": 48},
        ],
        "buffers": [{"byteLength": 96, "uri": format!("data:application/octet-stream;base64,{data}")}],
    });
    std::fs::write(d.join("a.gltf"), skinned.to_string()).unwrap();
    let text = stdout(&succeeds(d, &["inspect", "a.gltf", "--json", "i.json"]));
    assert!(
        text.contains("skin 0 \"body\": 1 joint\n") && text.contains("; normals are computed\n"),
        "{text}"
    );
    assert_eq!(read_json(&d.join("i.json"))["skins"], serde_json::json!([{ "name": "body", "joints": 1 }]));
}

#[test]
fn inspect_lists_extensions_and_lights() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let mut scene = rock(4, false);
    let clearcoat = Some(Clearcoat { factor: 1.0, ..Clearcoat::default() });
    scene.materials[0].extensions =
        Some(Box::new(Extensions { ior: 1.25, clearcoat, ..Extensions::default() }));
    scene.lights.push(PunctualLight {
        name: "lamp".into(),
        kind: LightKind::Point,
        intensity: [8.0, 4.0, 2.0],
        position: glam::Vec3::ONE,
        direction: glam::Vec3::NEG_Z,
        range: None,
        picture: None,
    });
    photofit_scene::save_glb(d.join("a.glb"), &scene).unwrap();
    let text = stdout(&succeeds(d, &["inspect", "a.glb", "--json", "i.json"]));
    for part in ["extensions: ior, clearcoat", "light 0 \"lamp\": point, 8 4 2 candela"] {
        assert!(text.contains(part), "{part} in {text}");
    }
    assert!(!text.contains("path tracer only"), "what a fit does with each is told by its plan: {text}");
    let i = read_json(&d.join("i.json"));
    assert_eq!(i["materials"][0]["extensions"], serde_json::json!(["ior", "clearcoat"]));
    assert_eq!(i["lights"][0]["kind"], "point");
}

#[test]
fn the_rasterizer_takes_cameras_and_threads_and_tells_its_camera() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let mut scene = rock(8, true);
    let eye = glam::vec3(0.5, 0.25, 4.0);
    scene.cameras.push(photofit_scene::Camera::look_at(
        eye,
        glam::Vec3::ZERO,
        glam::Vec3::Y,
        0.6,
        1.0,
        0.1,
        9.0,
    ));
    photofit_scene::save_glb(d.join("rock.glb"), &scene).unwrap();
    let line = ["render", "rock.glb", "--width", "48", "--height", "32", "--camera", "0"];
    let render = |more: &[&str]| succeeds(d, &[&line[..], more].concat());
    let o = render(&["-o", "a.exr", "--json", "a.json", "--threads", "1"]);
    assert!(stdout(&o).starts_with("wrote a.exr: 48 x 32 pixels, 16 samples each, "), "{}", stdout(&o));
    render(&["-o", "b.exr", "--threads", "2"]);
    let bytes = |name: &str| std::fs::read(d.join(name)).unwrap();
    assert!(bytes("a.exr") == bytes("b.exr"), "the same for any number of threads");
    let o = render(&["-o", "c.exr", "--json", "c.json", "--integrator", "path", "--spp", "16"]);
    assert!(stdout(&o).contains("wrote c.exr: 48 x 32 pixels, 16 samples each"), "{}", stdout(&o));
    let (raster, path) = (read_json(&d.join("a.json")), read_json(&d.join("c.json")));
    assert_eq!((&raster["camera"], raster["threads"].as_u64()), (&path["camera"], Some(1)));
    for (k, x) in [0.5, 0.25, 4.0].into_iter().enumerate() {
        let told = raster["camera"]["transform_matrix"][k][3].as_f64().unwrap();
        assert!((told - x).abs() < 1e-5, "{raster}");
    }
    let focal = 16.0 / 0.3_f64.tan();
    assert!((raster["camera"]["fl_x"].as_f64().unwrap() / focal - 1.0).abs() < 1e-4, "{raster}");
    // Both look through the same camera.
    let alpha = |name: &str| photofit_image::read(d.join(name)).unwrap().select(&[3]);
    let rmse = photofit_image::rmse(&alpha("a.exr"), &alpha("c.exr"));
    assert!(rmse < 0.05, "{rmse}");
    let o = photofit(d, &["render", "rock.glb", "-o", "d.png", "--camera", "1"]);
    assert_one_error(&o, "a camera that is not there", &["rock.glb", "1 cameras", "--camera is 1"]);
}

#[test]
fn comparing_assets_tells_small_errors_caps_and_warnings() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let scene = rock(8, false);
    photofit_scene::save_glb(d.join("a.glb"), &scene).unwrap();
    let mut near = scene.clone();
    near.materials[0].base_color[0] += 2e-4;
    photofit_scene::save_glb(d.join("b.glb"), &near).unwrap();
    let line = ["compare", "a.glb", "b.glb", "--views", "2", "--resolution", "64", "--json", "f.json"];
    let o = succeeds(d, &line);
    assert!(stdout(&o).contains("60 or more"), "{}", stdout(&o));
    let f = read_json(&d.join("f.json"));
    let rmse = f["rmse"].as_f64().unwrap();
    assert!(rmse > 1e-6 && rmse < 9e-4, "less than 60 dB can say: {f}");
    std::fs::write(d.join("c.mtl"), "newmtl m\nNs many\n").unwrap();
    // A library that is not there is told by whatever reads the asset.
    std::fs::write(d.join("bare.obj"), "mtllib none.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let o = succeeds(d, &["render", "bare.obj", "-o", "bare.png", "--width", "8", "--height", "8"]);
    assert!(
        stderr(&o).contains("warning: bare.obj: line 1: ") && stderr(&o).contains("none.mtl"),
        "{}",
        stderr(&o)
    );
    std::fs::write(d.join("c.obj"), "mtllib c.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n").unwrap();
    let o = succeeds(d, &["compare", "c.obj", "c.obj", "--views", "1", "--resolution", "16"]);
    assert_eq!(stderr(&o).matches("warning: c.obj: ").count(), 2, "one of each asset: {}", stderr(&o));
}
