//! What a folder of pictures means, and what is refused with which words.

use super::*;
use crate::engine::Normalised;
use crate::engine::reference::Reference;
use crate::engine::views::Views;
use glam::Vec3;
use photofit_geometry::shapes::cube;
use photofit_mutants::{Shape, Target};
use photofit_scene::{Instance, Material, Primitive, Scene};
use serde_json::{Value, json};

/// The asset of the tests: a cube about (1, 2, 3).
fn asset() -> Normalised {
    let scene = Scene {
        primitives: vec![Primitive { mesh: cube(), material: 0 }],
        instances: vec![Instance {
            primitive: 0,
            transform: glam::Affine3A::from_translation(Vec3::new(1.0, 2.0, 3.0)),
        }],
        materials: vec![Material::clay()],
        ..Scene::default()
    };
    Normalised::new(&scene).unwrap()
}

/// Nine pictures of 6 x 4 pixels, of grey `k / 10`, from (1, 2, 13 + k), looking down -z.
fn folder() -> (tempfile::TempDir, Value) {
    let dir = tempfile::tempdir().unwrap();
    std::fs::create_dir(dir.path().join("images")).unwrap();
    let frame = |k: usize| {
        let image = Image::new(6, 4, 4).map(|_| 0.1 * k as f32);
        photofit_image::write_png(dir.path().join(format!("images/{k}.png")), &image).unwrap();
        json!({
            "file_path": format!("images/{k}"),
            "transform_matrix":
                [[1, 0, 0, 1.0], [0, 1, 0, 2.0], [0, 0, 1, 13.0 + k as f64], [0, 0, 0, 1]],
        })
    };
    let frames: Vec<Value> = (0..9).map(frame).collect();
    (dir, json!({ "fl_x": 12.0, "cx": 2.0, "cy": 3.0, "w": 6, "h": 4, "frames": frames }))
}

fn load(dir: &tempfile::TempDir, file: &Value) -> Result<PictureFolder, FitError> {
    std::fs::write(dir.path().join(FILE), file.to_string()).unwrap();
    PictureFolder::load(
        dir.path(),
        asset().frame(),
        0,
        &|s| Ok(Image::new(s.width, s.height, 4).map(|_| 1.0)),
    )
}

#[test]
fn cameras_pictures_and_sets_are_read() {
    let (dir, file) = folder();
    let photos = load(&dir, &file).unwrap();
    assert_eq!(
        (photos.given.pictures().len(), photos.given.held_out(), photos.lit, photos.without_alpha),
        (9, 1, false, 0)
    );
    let n = asset();
    let photo = &photos.given.pictures()[4];
    // A point of the world lands where the pinhole formula says.
    let world = Vec3::new(1.3, 1.8, 3.4);
    let p = (world - Vec3::from_array(n.frame().center.to_array())) / n.frame().radius;
    let clip = photo.camera.pinhole().view_projection().project_point3(p);
    let pixel = [(clip.x + 1.0) * 0.5 * 6.0, (1.0 - clip.y) * 0.5 * 4.0];
    let depth = 17.0 - 3.4;
    let expected = [2.0 + 12.0 * 0.3 / depth, 3.0 - 12.0 * -0.2 / depth];
    for k in 0..2 {
        assert!((pixel[k] - expected[k]).abs() < 1e-3, "{pixel:?} {expected:?}");
    }
    // Straight alpha becomes premultiplied.
    let [c, a] = [photo.image.pixel(0, 0)[0], photo.image.pixel(0, 0)[3]];
    assert!((a - 0.4).abs() < 0.01 && (c - 0.16).abs() < 0.01, "{c} {a}");
    // The 8th is held out; training shows all others before any comes again.
    assert_eq!(photos.given.setup(Set::HeldOut, 0, 1).picture, Some(7));
    for epoch in 0..3 {
        let mut seen: Vec<_> =
            (0..8).map(|i| photos.given.setup(Set::Train, 8 * epoch + i, 0).picture.unwrap()).collect();
        seen.sort_unstable();
        assert_eq!(seen, [0, 1, 2, 3, 4, 5, 6, 8]);
    }
    let s = photos.given.setup(Set::Train, 0, 0).shrunk(2);
    let small = photos.given.picture(&s).unwrap().image;
    assert_eq!((small.width, small.height), (3, 2));
}

#[test]
fn an_applied_transform_is_undone() {
    let (dir, mut file) = folder();
    let plain = load(&dir, &file).unwrap();
    // z up: (x, y, z) -> (x, -z, y), applied to every matrix.
    file["applied_transform"] = json!([[1, 0, 0, 0.5], [0, 0, -1, 0], [0, 1, 0, 0]]);
    for k in 0..9 {
        let z = 13.0 + k as f64;
        file["frames"][k]["transform_matrix"] =
            json!([[1, 0, 0, 1.5], [0, 0, -1, -z], [0, 1, 0, 2.0], [0, 0, 0, 1]]);
    }
    let undone = load(&dir, &file).unwrap();
    for (a, b) in plain.given.pictures().iter().zip(undone.given.pictures()) {
        assert!(
            a.camera.pinhole().view.abs_diff_eq(b.camera.pinhole().view, 1e-4),
            "{:?} {:?}",
            a.camera,
            b.camera
        );
    }
}

#[test]
fn lights_are_read_into_the_frame() {
    let (dir, mut file) = folder();
    file["lights"] = json!([
        { "type": "point", "position": [1, 2, 8], "intensity": [10, 20, 30] },
        { "type": "directional", "direction": [0, 0, 2], "irradiance": [1, 1, 1] },
        { "type": "ambient", "radiance": [0.1, 0.2, 0.3] },
    ]);
    let photos = load(&dir, &file).unwrap();
    assert!(photos.lit);
    let n = asset();
    let lights = photos.given.pictures()[0].lights.lights();
    let photofit_shading::Light::Point { position, intensity } = lights[0] else { panic!("{lights:?}") };
    let distance = position.length() * n.frame().radius;
    let expected = (photofit_scalar::vec3(1.0, 2.0, 8.0) - n.frame().center).length();
    assert!((distance - expected).abs() < 1e-4, "{distance}");
    // The irradiance on the asset stays what it is.
    let irradiance = intensity.y / position.length_squared();
    assert!((irradiance - 20.0 / (expected * expected)).abs() < 1e-4, "{irradiance}");
    let photofit_shading::Light::Directional { direction, .. } = lights[1] else { panic!("{lights:?}") };
    assert!((direction.z - 1.0).abs() < 1e-6);
}

/// What is wrong, how a sound file is made so, and words of the error.
type Case<'a> = (&'a str, fn(&mut Value), &'a [&'a str]);

#[test]
fn what_cannot_be_used_is_refused_by_file_frame_and_rule() {
    let cases: [Case<'_>; 18] = [
        ("few", |f| f["frames"].as_array_mut().unwrap().truncate(7), &["7 frames", "at least 8"]),
        (
            "missing",
            |f| f["frames"][3]["file_path"] = json!("images/none"),
            &["frame 3", "images/none", "does not exist"],
        ),
        (
            "outside",
            |f| f["frames"][2]["file_path"] = json!("../x.png"),
            &["frame 2", "inside of the folder"],
        ),
        (
            "absolute",
            |f| f["frames"][2]["file_path"] = json!("/etc/passwd"),
            &["frame 2", "inside of the folder"],
        ),
        (
            "scaled",
            |f| f["frames"][1]["transform_matrix"][0][0] = json!(2),
            &["frame 1", "not rigid", "it must be 1"],
        ),
        ("mirrored", |f| f["frames"][1]["transform_matrix"][0][0] = json!(-1), &["frame 1", "mirrors"]),
        (
            "short",
            |f| f["frames"][1]["transform_matrix"] = json!([[1, 0, 0, 0]]),
            &["frame 1", "3 or 4 rows"],
        ),
        ("last row", |f| f["frames"][1]["transform_matrix"][3][0] = json!(1), &["frame 1", "last row"]),
        ("bent", |f| f["k1"] = json!(0.1), &["frame 0", "k1 is 0.1", "must be 0"]),
        ("fisheye", |f| f["camera_model"] = json!("OPENCV_FISHEYE"), &["OPENCV_FISHEYE", "pinhole"]),
        ("size", |f| f["w"] = json!(8), &["w is 8", "6 pixels"]),
        (
            "degrees",
            |f| (f["fl_x"], f["camera_angle_x"]) = (Value::Null, json!(40.0)),
            &["camera_angle_x is 40", "radians"],
        ),
        ("no lens", |f| f["fl_x"] = Value::Null, &["fl_x", "camera_angle_x"]),
        ("negative lens", |f| f["fl_x"] = json!(-3), &["focal length is -3"]),
        (
            "a frame without a matrix",
            |f| {
                f["frames"][4].as_object_mut().unwrap().remove("transform_matrix");
            },
            &["frame 4 (images/4)", "missing field `transform_matrix`"],
        ),
        (
            "a word in a matrix",
            |f| f["frames"][6]["transform_matrix"][0][1] = json!("one"),
            &["frame 6 (images/6)", "\"one\"", "f64"],
        ),
        ("no name", |f| f["frames"][2]["file_path"] = json!(7), &["frame 2: ", "string"]),
        ("light", |f| f["lights"] = json!([{ "type": "spot" }]), &["spot"]),
    ];
    for (what, change, parts) in cases {
        let (dir, mut file) = folder();
        change(&mut file);
        let error = load(&dir, &file).unwrap_err().to_string();
        for part in parts.iter().chain(&[FILE]) {
            assert!(error.contains(part), "{what}: {part:?} in {error}");
        }
    }
    #[cfg(unix)]
    {
        // A link out of the folder, and one inside of it.
        let (dir, mut file) = folder();
        let (elsewhere, _) = folder();
        std::os::unix::fs::symlink(elsewhere.path().join("images/2.png"), dir.path().join("images/out.png"))
            .unwrap();
        std::os::unix::fs::symlink("2.png", dir.path().join("images/in.png")).unwrap();
        file["frames"][2]["file_path"] = json!("images/in.png");
        assert!(load(&dir, &file).is_ok());
        file["frames"][2]["file_path"] = json!("images/out.png");
        let error = load(&dir, &file).unwrap_err().to_string();
        assert!(error.contains("frame 2") && error.contains("inside of the folder"), "{error}");
        // Lists that never end, or never begin.
        std::fs::remove_file(dir.path().join(FILE)).unwrap();
        std::os::unix::fs::symlink("/dev/zero", dir.path().join(FILE)).unwrap();
        let error = PictureFolder::load(dir.path(), asset().frame(), 0, &|_| Ok(Image::new(1, 1, 4)));
        assert!(error.unwrap_err().to_string().contains("not a regular file"));
    }
    let (dir, file) = folder();
    std::fs::write(dir.path().join("images/5.png"), b"not a picture").unwrap();
    let error = load(&dir, &file).unwrap_err().to_string();
    assert!(error.contains("5.png"), "{error}");
    std::fs::write(dir.path().join(FILE), "{\"frames\": 3}").unwrap();
    let error = PictureFolder::load(dir.path(), asset().frame(), 0, &|_| Ok(Image::new(1, 1, 4)))
        .unwrap_err()
        .to_string();
    assert!(error.contains(FILE) && error.contains("line 1"), "{error}");
    let error =
        PictureFolder::load(&dir.path().join("no.json"), asset().frame(), 0, &|_| Ok(Image::new(1, 1, 4)));
    assert!(error.unwrap_err().to_string().contains("no.json"));
}

#[test]
fn pictures_without_alpha_take_the_outline() {
    let (dir, file) = folder();
    for k in 0..9 {
        let image = Image::new(6, 4, 3).map(|_| 0.5);
        photofit_image::write_png(dir.path().join(format!("images/{k}.png")), &image).unwrap();
    }
    std::fs::write(dir.path().join(FILE), file.to_string()).unwrap();
    let half = |s: &Setup| Ok(Image::from_fn(s.width, s.height, 4, |x, _, _| f32::from(u8::from(x < 3))));
    let photos = PictureFolder::load(dir.path(), asset().frame(), 0, &half).unwrap();
    assert_eq!(photos.without_alpha, 9);
    let image = &photos.given.pictures()[0].image;
    assert!((image.pixel(0, 0)[0] - 0.5).abs() < 0.01 && image.pixel(5, 0).iter().all(|x| *x < 1e-6));
}

#[test]
fn cameras_that_look_away_are_told() {
    let (dir, file) = folder();
    std::fs::write(dir.path().join(FILE), file.to_string()).unwrap();
    let seen = |s: &Setup| s.picture != Some(3);
    let outline = |s: &Setup| Ok(Image::new(s.width, s.height, 4).map(|_| f32::from(u8::from(seen(s)))));
    assert_eq!(PictureFolder::load(dir.path(), asset().frame(), 0, &outline).unwrap().unseen, [3]);
    let none = |s: &Setup| Ok(Image::new(s.width, s.height, 4));
    let error = PictureFolder::load(dir.path(), asset().frame(), 0, &none).unwrap_err().to_string();
    assert!(error.contains("no camera sees the asset") && error.contains("-z"), "{error}");
}

#[test]
fn pictures_that_tell_nothing_are_doubted() {
    let (dir, mut file) = folder();
    let sound = load(&dir, &file).unwrap();
    // The grey of the first is 0.
    assert_eq!(sound.doubts(), ["1 of 9 pictures are black, or empty: frames [0]"]);
    for k in 0..9 {
        file["frames"][k]["file_path"] = json!("images/5");
    }
    assert_eq!(load(&dir, &file).unwrap().doubts(), ["9 frames have only 1 distinct picture"]);
    let (dir, mut file) = folder();
    for k in 1..9 {
        file["frames"][k]["transform_matrix"] = file["frames"][0]["transform_matrix"].clone();
    }
    let doubts = load(&dir, &file).unwrap().doubts();
    assert!(doubts[1].starts_with("9 frames have only 1 distinct camera"), "{doubts:?}");
    for k in 0..9 {
        file["frames"][k]["file_path"] = json!("images/0");
    }
    let doubts = load(&dir, &file).unwrap().doubts();
    assert!(doubts[0].starts_with("all 9 pictures are black"), "{doubts:?}");
    let one = Image::from_fn(2, 1, 4, |x, _, c| if c == 3 { 1.0 } else { -1.0 + 1.5 * x as f32 });
    assert_eq!(
        super::doubts(&[&one], &["one".into()]),
        ["the picture is below 0 on the whole, as light never is"]
    );
    // Dim pictures are not black, but for those that are dark beside the others.
    let grey = |v: f32| Image::from_fn(2, 1, 4, |x, _, c| if c == 3 { 1.0 } else { v * (1.0 + x as f32) });
    let (dim, bright) = (grey(1e-6), grey(0.5));
    let cameras = ["one".to_owned(), "two".to_owned()];
    assert!(super::doubts(&[&dim], &cameras[..1]).is_empty());
    let beside = super::doubts(&[&bright, &dim], &cameras);
    assert_eq!(beside, ["1 of 2 pictures are black, or empty: frames [1]"]);
}

#[test]
fn numbers_that_are_not_finite_are_named_with_their_frame() {
    let (dir, file) = folder();
    let text = file.to_string().replacen("17.0", "NaN", 1);
    std::fs::write(dir.path().join(FILE), text).unwrap();
    let rule =
        PictureFolder::load(dir.path(), asset().frame(), 0, &|_| panic!("nothing is drawn")).unwrap_err();
    let rule = rule.to_string();
    for part in [FILE, "frame 4 (images/4)", "transform_matrix[2][3] is NaN; it must be finite"] {
        assert!(rule.contains(part), "{part:?} in {rule}");
    }
}

#[test]
fn the_list_is_checked_before_a_picture_is_decoded() {
    let (dir, mut file) = folder();
    std::fs::write(dir.path().join("images/0.png"), "not a picture").unwrap();
    file["frames"][8]["transform_matrix"][0][0] = json!(2);
    let told = load(&dir, &file).unwrap_err().to_string();
    assert!(told.contains("frame 8") && told.contains("transform_matrix"), "{told}");
}

#[test]
fn mutants_are_read_or_refused() {
    let (dir, mut file) = folder();
    let point = json!({"type": "point", "position": [0, 3, 1], "intensity": [2, 2, 1]});
    file["lights"] = json!([point, {"type": "directional", "direction": [0, 1, 0], "irradiance": [1, 1, 1]},
        {"type": "ambient", "radiance": [0.1, 0.2, 0.3]}]);
    file["applied_transform"] = json!([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0.5]]);
    let mut other = folder().1;
    other["frames"][3]["camera_angle_x"] = json!(0.6);
    other["frames"][4]["lights"] = json!([point]);
    let seeds = [file, other].map(|f| f.to_string().into_bytes());
    let frame = asset().frame();
    let seen = Target { name: "transforms", shape: Shape::Json, seeds: &seeds }.run(
        |n| n == 600,
        |bytes| {
            std::fs::write(dir.path().join(FILE), bytes).unwrap();
            let outline: Outline<'_> = &|s| Ok(Image::new(s.width, s.height, 4).map(|_| 1.0));
            let read = PictureFolder::load(dir.path(), frame, 0, outline).map_err(|e| e.to_string())?;
            let sound = |p: &GivenPicture| {
                p.camera.pinhole().view_projection().is_finite() && p.image.width * p.image.height == 24
            };
            assert!(read.given.pictures().iter().all(sound), "cameras and pictures are sound");
            Ok(())
        },
    );
    seen.assert_deep("transforms", 0);
}
