//! `photofit recover scene`: what it writes, stopping and resuming, several pictures, what is refused.

use crate::support::{assert_misuse, assert_one_error, photofit, read_json, rock, stderr, stdout, succeeds};
use photofit_image::Image;
use photofit_scene::{Camera, TextureSlot};
use serde_json::Value;
use std::path::Path;

/// A floor under a lamp of these values.
fn scene(reflectance: &str, radiance: &str) -> String {
    format!(
        "<scene version='3.0.0'><integrator type='path'><integer name='max_depth' value='3'/></integrator>
  <sensor type='perspective'><float name='fov' value='45'/>
    <transform name='to_world'><lookat origin='0,1,4' target='0,0,0' up='0,1,0'/></transform>
    <film type='hdrfilm'><integer name='width' value='12'/><integer name='height' value='8'/>
    <rfilter type='box'/></film></sensor>
  <bsdf type='diffuse' id='white'><rgb name='reflectance' value='{reflectance}'/></bsdf>
  <shape type='rectangle' id='floor'><ref id='white'/><transform name='to_world'><scale value='4'/>
    <rotate x='1' angle='-90'/><translate y='-1'/></transform></shape>
  <shape type='rectangle' id='lamp'><transform name='to_world'><rotate x='1' angle='90'/>
    <translate y='3'/></transform><emitter type='area'><rgb name='radiance' value='{radiance}'/></emitter></shape>
  <emitter type='constant' id='sky'><rgb name='radiance' value='0.5'/></emitter></scene>"
    )
}

fn figures(folder: &Path) -> Value {
    read_json(&folder.join("values.json"))
}

const WHITE: [&str; 2] = ["--parameter", "white.reflectance.value"];

#[test]
fn a_self_test_finds_a_colour_again_and_tells_it() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    std::fs::write(d.join("s.xml"), scene("0.7 0.2 0.3", "4")).unwrap();
    let run = ["recover", "scene", "s.xml", "--self-test", "-o", "out", "--steps", "60", "--spp", "8"];
    let text = stdout(&succeeds(d, &[&run[..], &WHITE].concat()));
    assert!(text.contains("none is held out"), "{text}");
    let f = figures(&d.join("out"));
    let parameter = &f["parameters"][0];
    assert_eq!(parameter["parameter"], "white.reflectance.value");
    let error = |which: &str| parameter["parameter_error"][which].as_f64().unwrap();
    assert!(error("last") < 0.25 * error("first"), "{parameter}");
    let (first, best) = (&f["relative_error"]["first"], &f["relative_error"]["best"]);
    assert!(best.as_f64().unwrap() < 0.1 * first.as_f64().unwrap(), "{first} {best}");
    assert_eq!((f["views"].as_u64(), f["held_out"].is_null()), (Some(1), true));
    assert_eq!(f["steps"].as_u64(), Some(60));
    assert!(f["seconds_per_iteration"].as_f64().unwrap() > 0.0);
    assert!(f["course"].as_array().unwrap().len() >= 3);
    for file in ["reference.png", "start.png", "recovered.png", "recovered.exr"] {
        assert!(d.join("out").join(file).is_file(), "{file}");
    }
    let page = std::fs::read_to_string(d.join("out/index.html")).unwrap();
    for part in ["s.xml from pictures", "data:image/png", "all pictures were fitted", "<svg"] {
        assert!(page.contains(part), "{part:?} is not in the page");
    }
}

#[test]
fn a_stopped_run_goes_on_to_the_same_values() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    std::fs::write(d.join("s.xml"), scene("0.7 0.2 0.3", "4")).unwrap();
    let lamp = ["--parameter", "lamp.emitter.radiance.value", "--parameter", "sky.radiance.value"];
    let run = |more: &[&str]| {
        let base = ["recover", "scene", "s.xml", "--self-test", "--steps", "30", "--spp", "64"];
        succeeds(d, &[&base[..], &WHITE, &lamp, more].concat())
    };
    run(&["-o", "whole"]);
    run(&["-o", "cut", "--checkpoint", "state", "--time-limit", "0.005"]);
    let cut = figures(&d.join("cut"));
    assert_eq!(cut["stopped"], true, "a run of 30 steps is longer than the limit");
    let made = cut["steps"].as_u64().unwrap();
    assert!(made < 30, "{made}");
    run(&["-o", "end", "--checkpoint", "state", "--resume"]);
    let (whole, end) = (figures(&d.join("whole")), figures(&d.join("end")));
    assert_eq!(whole["parameters"], end["parameters"]);
    assert_eq!(end["steps"].as_u64(), Some(30));
    // What is told per step counts the steps of the run that took the time.
    let told = end["seconds_per_iteration"].as_f64().unwrap() * (30 - made) as f64;
    assert!((told - end["seconds"].as_f64().unwrap()).abs() < 1e-6 * told, "{end}");
    // A run that finds everything done has made no step.
    run(&["-o", "again", "--checkpoint", "state", "--resume"]);
    let again = figures(&d.join("again"));
    assert!(again["seconds_per_iteration"].is_null(), "{again}");
    assert_eq!(again["parameters"], end["parameters"]);
    // With another option it is refused by the names that are typed, before anything is written.
    let base = ["recover", "scene", "s.xml", "--self-test", "--steps", "30", "--spp", "64"];
    let other = ["-o", "other", "--checkpoint", "state", "--resume", "--smoothing", "bilateral"];
    let o = photofit(d, &[&base[..], &WHITE, &lamp, &other].concat());
    assert_eq!(o.status.code(), Some(1));
    let told = stderr(&o);
    assert!(told.contains("fit.ckpt: is the checkpoint of another fit"), "{told}");
    assert!(told.contains("--smoothing was narrowing and is bilateral"), "{told}");
    assert!(!d.join("other").exists());
    // With another start, too, and the pictures of the fit before stay.
    let start = || std::fs::read(d.join("again/start.png")).unwrap();
    let before = start();
    let other = ["-o", "again", "--checkpoint", "state", "--resume", "--start", "0.9"];
    let o = photofit(d, &[&base[..], &WHITE, &lamp, &other].concat());
    assert_eq!(o.status.code(), Some(1));
    assert!(stderr(&o).contains("is the checkpoint of another fit"), "{}", stderr(&o));
    assert_eq!(before, start());
}

#[test]
fn starts_that_no_parameter_can_have_are_refused_at_once() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    std::fs::write(d.join("s.xml"), scene("0.7 0.2 0.3", "4")).unwrap();
    let cases = [
        ("1.5", "--start: 1.5 for white.reflectance.value; it must be at most 1"),
        ("white.reflectance.value=2", "--start: 2 for white.reflectance.value; it must be at most 1"),
        ("sky.radiance.value=2", "--start: sky.radiance.value is not fitted; it must be one of --parameter"),
    ];
    for (start, rule) in cases {
        let base = ["recover", "scene", "s.xml", "--self-test", "-o", "out", "--start", start];
        let o = photofit(d, &[&base[..], &WHITE].concat());
        assert_eq!(o.status.code(), Some(2));
        let told = stderr(&o);
        assert!(told.contains(rule) && !told.contains("pictures"), "{told}");
        assert!(!d.join("out").exists());
    }
}

#[test]
fn two_pictures_with_cameras_recover_a_scene() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    std::fs::create_dir(d.join("photos")).unwrap();
    // The camera of the scene, and one to the left of it: lookat with x to the right.
    let at = |x: f64, name: &str| {
        let text = scene("0.7 0.2 0.3", "4").replace("origin='0,1,4'", &format!("origin='{x},1,4'"));
        std::fs::write(d.join("t.xml"), text).unwrap();
        succeeds(d, &["render", "t.xml", "-o", &format!("photos/{name}"), "--spp", "512", "--background"]);
        let v = Camera::look_at(
            glam::vec3(x as f32, 1.0, 4.0),
            glam::Vec3::ZERO,
            glam::Vec3::Y,
            1.0,
            1.5,
            0.1,
            10.0,
        )
        .view
        .inverse()
        .transpose();
        let rows: Vec<Vec<f32>> = v.to_cols_array_2d().iter().map(|r| r.to_vec()).collect();
        serde_json::json!({ "file_path": name, "transform_matrix": rows })
    };
    let frames = vec![at(0.0, "recovered.exr"), at(-1.0, "b.exr")];
    // The field of view of 45 degrees is that of the width.
    let list = serde_json::json!({ "camera_angle_x": std::f64::consts::FRAC_PI_4, "frames": frames });
    std::fs::write(d.join("photos/transforms.json"), list.to_string()).unwrap();
    std::fs::write(d.join("s.xml"), scene("0.4", "4")).unwrap();
    let run =
        ["recover", "scene", "s.xml", "--picture", "photos", "-o", "out", "--steps", "80", "--spp", "8"];
    succeeds(d, &[&run[..], &WHITE].concat());
    let f = figures(&d.join("out"));
    assert_eq!(f["views"].as_u64(), Some(2));
    let value: Vec<f64> =
        f["parameters"][0]["value"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    for (found, truth) in value.iter().zip([0.7, 0.2, 0.3]) {
        assert!((found - truth).abs() < 0.03, "{value:?}");
    }
    // Cameras that are wrong would leave a rest.
    assert!(f["relative_error"]["best"].as_f64().unwrap() < 0.003, "{}", f["relative_error"]);
    assert!(d.join("out/recovered_1.png").is_file() && d.join("out/reference_1.png").is_file());
    let more = ["recover", "scene", "s.xml", "--picture", "photos", "-o", "o", "--camera", "1"];
    assert_misuse(&photofit(d, &[&more[..], &WHITE].concat()), "cameras twice", &["--camera", "photos"]);
    let more = ["recover", "scene", "s.xml", "--picture", "photos", "-o", "photos"];
    assert_misuse(
        &photofit(d, &[&more[..], &WHITE].concat()),
        "pictures stay",
        &["recovered.exr", "--picture"],
    );
}

#[test]
fn maps_of_data_are_written_as_data_and_normals_start_flat() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let mut asset = rock(3, true);
    let of = |s: &Option<TextureSlot>| *s;
    let slot = of(&asset.materials[0].base_color_texture);
    asset.materials[0].name = "rock".into();
    let mut normals = asset.images[0].clone();
    normals.texels =
        (0..256).map(|i| if i % 2 == 0 { [150, 128, 252, 255] } else { [128, 128, 255, 255] }).collect();
    let mut surface = normals.clone();
    surface.texels = vec![[13, 100, 30, 255]; 256];
    asset.images.extend([normals, surface]);
    asset.materials[0].normal_texture = slot.map(|s| TextureSlot { image: 1, ..s });
    asset.materials[0].metallic_roughness_texture = slot.map(|s| TextureSlot { image: 2, ..s });
    (asset.materials[0].roughness, asset.materials[0].metallic) = (1.0, 1.0);
    let eye = glam::vec3(0.5, 1.0, 3.0);
    for eye in [eye, -eye] {
        asset.cameras.push(Camera::look_at(eye, glam::Vec3::ZERO, glam::Vec3::Y, 0.8, 1.0, 0.1, 10.0));
    }
    photofit_scene::save_glb(d.join("rock.glb"), &asset).unwrap();
    let sky = Image::from_fn(4, 2, 3, |x, y, _| 0.2 + 0.3 * ((x + y) % 3) as f32);
    photofit_image::write_exr(d.join("sky.exr"), &[("", &sky, &["R", "G", "B"])]).unwrap();
    let keys = ["--parameter", "rock.normal_texture", "--parameter", "rock.metallic_roughness_texture"];
    let base =
        ["recover", "scene", "rock.glb", "--env", "sky.exr", "--self-test", "-o", "out", "--steps", "0"];
    let more = ["--width", "12", "--height", "12", "--max-depth", "2", "--camera", "0", "--camera", "1"];
    let o = photofit(d, &[&base[..], &keys, &more].concat());
    assert_eq!(o.status.code(), Some(0), "{}", stderr(&o));
    // Without steps, what is written is the start.
    let bytes = |file: &str| {
        let png = std::fs::read(d.join("out").join(file)).unwrap();
        let linear = photofit_image::decode(&png, file, &photofit_image::Limits::default()).unwrap();
        (0..3).map(|c| photofit_image::linear_to_srgb_u8(linear.pixel(3, 5)[c])).collect::<Vec<u8>>()
    };
    assert_eq!(bytes("rock.normal_texture.png"), [128, 128, 255]);
    let [red, green, blue] = bytes("rock.metallic_roughness_texture.png")[..] else { panic!("three") };
    assert_eq!([red, green, blue], [13, 128, 128], "red stays, roughness and metalness are numbers");
    let f = figures(&d.join("out"));
    let first = |k: usize| f["parameters"][k]["parameter_error"]["first"].as_f64().unwrap();
    // Of normals: half of the texels lean by 22 / 255 in x, and are 3 / 255 lower.
    let lean = ((22.0_f64 / 255.0).powi(2) + (3.0_f64 / 255.0).powi(2)) / 6.0;
    assert!((first(0) - lean.sqrt()).abs() < 4e-3, "{} {}", first(0), lean.sqrt());
    let off = ((0.5 - 100.0_f64 / 255.0).powi(2) + (0.5 - 30.0_f64 / 255.0).powi(2)) / 2.0;
    assert!((first(1) - off.sqrt()).abs() < 1e-3, "{} {}", first(1), off.sqrt());
    assert_eq!(f["views"].as_u64(), Some(2));
}

#[test]
fn what_is_black_is_told_by_gradient_and_found_by_recover() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    std::fs::write(d.join("lit.xml"), scene("0.5", "4")).unwrap();
    succeeds(d, &["render", "lit.xml", "-o", "lit.exr", "--spp", "512", "--background"]);
    std::fs::write(d.join("s.xml"), scene("0.5", "0")).unwrap();
    let key = ["--parameter", "lamp.emitter.radiance.value"];
    let o = photofit(d, &[&["gradient", "s.xml"][..], &key].concat());
    assert_one_error(&o, "black", &["s.xml", "lamp.emitter.radiance.value", "is 0", "more than 0"]);
    let run =
        ["recover", "scene", "s.xml", "--picture", "lit.exr", "-o", "out", "--spp", "8", "--steps", "300"];
    succeeds(d, &[&run[..], &key].concat());
    let f = figures(&d.join("out"));
    for value in f["parameters"][0]["value"].as_array().unwrap() {
        assert!((value.as_f64().unwrap() - 4.0).abs() < 0.6, "{}", f["parameters"][0]);
    }
}

#[test]
fn wrong_keys_and_pictures_are_refused_in_one_line() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    std::fs::write(d.join("s.xml"), scene("0.5", "4")).unwrap();
    let write = |name: &str, image: &Image| {
        let names: &[&str] = if image.channels == 3 { &["R", "G", "B"] } else { &["Y"] };
        photofit_image::write_exr(d.join(name), &[("", image, names)]).unwrap();
    };
    write("small.exr", &Image::new(3, 2, 3));
    let nan = Image::from_fn(12, 8, 3, |x, y, _| if (x, y) == (4, 7) { f32::NAN } else { 1.0 });
    write("nan.exr", &nan);
    write("ok.exr", &Image::from_fn(12, 8, 3, |_, _, _| 0.5));
    let run = |picture: &[&str], more: &[&str]| {
        let base = ["recover", "scene", "s.xml", "-o", "out", "--steps", "1"];
        photofit(d, &[&base[..], picture, more].concat())
    };
    let of = |file: &'static str| ["--picture", file];
    let unknown = run(&of("ok.exr"), &["--parameter", "black.reflectance.value"]);
    assert_one_error(&unknown, "no such key", &["black.reflectance.value", "white.reflectance.value"]);
    assert_one_error(&run(&of("small.exr"), &WHITE), "size", &["small.exr", "3 x 2", "12 x 8"]);
    assert_one_error(&run(&of("nan.exr"), &WHITE), "not finite", &["nan.exr", "(4, 7)", "finite"]);
    assert_misuse(&run(&of("photo.png"), &WHITE), "ending", &["photo.png", ".exr", "transforms.json"]);
    let two = ["--picture", "ok.exr", "--picture", "ok.exr"];
    assert_misuse(&run(&two, &WHITE), "number", &["2 files", "1 of --camera", "one for each"]);
    let twice = run(&of("ok.exr"), &[WHITE, WHITE].concat());
    assert_misuse(&twice, "twice", &["white.reflectance.value", "given twice"]);
    assert_eq!(run(&[], &WHITE).status.code(), Some(2), "a picture or --self-test");
    std::fs::create_dir(d.join("empty")).unwrap();
    assert_one_error(&run(&of("empty"), &WHITE), "no list", &["transforms.json"]);
    assert!(!d.join("out").exists(), "nothing is written");
}

#[test]
fn black_pictures_and_those_below_0_are_doubted() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    std::fs::write(d.join("s.xml"), scene("0.5", "4")).unwrap();
    for (value, doubt) in [(0.0, "the picture is black"), (-1.0, "the picture is below 0")] {
        let image = Image::from_fn(12, 8, 3, |_, _, _| value);
        photofit_image::write_exr(d.join("p.exr"), &[("", &image, &["R", "G", "B"])]).unwrap();
        let line = ["recover", "scene", "s.xml", "-o", "out", "--steps", "1", "--picture", "p.exr"];
        let o = succeeds(d, &[&line[..], &WHITE].concat());
        assert!(stderr(&o).contains(&format!("warning: --picture: {doubt}")), "{}", stderr(&o));
    }
}

/// A ball of smoke on a grid, lit from the side, before the sky.
fn smoke(folder: &Path) {
    let (side, mut values) = (6_usize, Vec::new());
    for i in 0..side.pow(3) {
        let at = |n: usize| (n % side) as f32 / (side - 1) as f32 - 0.5;
        let d = at(i).powi(2) + at(i / side).powi(2) + at(i / side / side).powi(2);
        values.push(if d < 0.12 { 5.0 } else { 0.0 });
    }
    let unit = [glam::DVec3::ZERO, glam::DVec3::ONE];
    let grid = photofit_scene::mitsuba::encode_grid([side; 3], &values, unit);
    std::fs::write(folder.join("smoke.vol"), grid).unwrap();
    let text =
        "<scene version='3.0.0'><integrator type='volpath'><integer name='max_depth' value='4'/></integrator>
  <sensor type='perspective'><float name='fov' value='40'/>
    <transform name='to_world'><lookat origin='0,1,4' target='0,0,0' up='0,1,0'/></transform>
    <film type='hdrfilm'><integer name='width' value='12'/><integer name='height' value='12'/>
    <rfilter type='box'/></film></sensor>
  <shape type='cube' id='box'><bsdf type='null'/><medium name='interior' type='heterogeneous'>
    <volume name='sigma_t' type='gridvolume'><string name='filename' value='smoke.vol'/>
      <transform name='to_world'><scale value='2'/><translate x='-1' y='-1' z='-1'/></transform></volume>
    <rgb name='albedo' value='0.8 0.5 0.3'/></medium></shape>
  <emitter type='directional' id='sun'><vector name='direction' x='-1' y='-1' z='-0.5'/>
    <rgb name='irradiance' value='5'/></emitter>
  <emitter type='constant' id='sky'><rgb name='radiance' value='0.2'/></emitter></scene>";
    std::fs::write(folder.join("s.xml"), text).unwrap();
}

#[test]
fn smoke_is_found_from_views_around_it() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    smoke(d);
    let density = "box.interior_medium.sigma_t.data";
    let albedo = "box.interior_medium.albedo.value.value";
    let list = stdout(&succeeds(d, &["gradient", "s.xml", "--list"]));
    assert!(list.contains(&format!("{density}  ")) && list.contains("6 x 6 x 6 x 1"), "{list}");
    assert!(list.contains(albedo), "{list}");
    let gradient = ["gradient", "s.xml", "--parameter", density, "--spp", "4", "--json", "g.json"];
    assert!(stdout(&succeeds(d, &gradient)).contains("sum over all voxels"));
    let g: Value = serde_json::from_str(&std::fs::read_to_string(d.join("g.json")).unwrap()).unwrap();
    assert_eq!(g["shape"], serde_json::json!([6, 6, 6, 1]));
    assert_eq!(g["gradient"].as_array().unwrap().len(), 216);
    let image = photofit(d, &[&gradient[..6], &["--image", "g.exr"]].concat());
    assert_misuse(&image, "a picture of voxels", &["--image", "a grid in space"]);
    let run = ["recover", "scene", "s.xml", "--self-test", "--views", "5", "-o", "out", "--steps", "60"];
    let more = ["--spp", "8", "--gradient-spp", "2", "--parameter", density, "--parameter", albedo];
    succeeds(d, &[&run[..], &more].concat());
    let f = figures(&d.join("out"));
    for (k, bound) in [(0, 0.8), (1, 0.7)] {
        let error = |which: &str| f["parameters"][k]["parameter_error"][which].as_f64().unwrap();
        assert!(error("last") < bound * error("first"), "{}", f["parameters"][k]);
    }
    assert_eq!((f["views"].as_u64(), f["held_out"].as_u64()), (Some(5), Some(4)));
    assert_eq!(f["parameters"][0]["file"], format!("{density}.vol"));
    // What was found is a scene's grid again.
    std::fs::copy(d.join("out").join(format!("{density}.vol")), d.join("smoke.vol")).unwrap();
    assert!(stdout(&succeeds(d, &["gradient", "s.xml", "--list"])).contains("6 x 6 x 6 x 1"));
}

#[test]
fn bad_volumes_are_refused_in_one_line() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    smoke(d);
    let run =
        |key: &str| photofit(d, &["recover", "scene", "s.xml", "--self-test", "-o", "o", "--parameter", key]);
    assert_one_error(
        &run("box.interior_medium.sigma_s.data"),
        "no such key",
        &["s.xml", "sigma_s", "it must be of"],
    );
    let good = std::fs::read(d.join("smoke.vol")).unwrap();
    let mut many = good.clone();
    many[8..12].copy_from_slice(&i32::MAX.to_le_bytes());
    let mut nan = good;
    nan[48 + 4 * 7..48 + 4 * 8].copy_from_slice(&f32::NAN.to_le_bytes());
    for (bytes, words) in [(many, "voxels"), (nan, "NaN")] {
        std::fs::write(d.join("smoke.vol"), bytes).unwrap();
        assert_one_error(&run("box.interior_medium.sigma_t.data"), words, &["smoke.vol", words]);
    }
    let both = [
        "recover",
        "scene",
        "s.xml",
        "--views",
        "3",
        "--picture",
        "a.exr",
        "-o",
        "o",
        "--parameter",
        "sun.irradiance.value",
    ];
    assert_misuse(&photofit(d, &both), "views alone", &["--self-test"]);
}

/// A disk that takes small files alone: the pictures of what was found are refused, its values are not lost.
#[cfg(target_os = "linux")]
#[test]
fn values_are_written_where_pictures_cannot_be() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let larger =
        scene("0.7 0.2 0.3", "4").replace("value='12'", "value='40'").replace("value='8'", "value='28'");
    std::fs::write(d.join("s.xml"), larger).unwrap();
    let run = |limit: &str, output: &str| {
        let fit =
            format!("recover scene s.xml --self-test -o {output} --steps 4 --spp 4 --parameter {}", WHITE[1]);
        // Writing beyond the limit is an error, no signal.
        let line = format!("trap '' XFSZ; ulimit -f {limit}; exec \"$0\" {fit}");
        std::process::Command::new("sh")
            .current_dir(d)
            .args(["-c", &line, env!("CARGO_BIN_EXE_photofit")])
            .output()
            .unwrap()
    };
    // In blocks of 512 bytes, or of 1024.
    let o = run("8", "out");
    assert_eq!(o.status.code(), Some(1), "full");
    let told = stderr(&o);
    let last = "error: out: 2 of the files of the result could not be written; all others are there";
    assert_eq!(told.trim_end().lines().last(), Some(last), "{told}");
    assert!(!stdout(&o).contains("wrote"), "{}", stdout(&o));
    assert!(told.contains("recovered.exr") && told.contains("index.html"), "{told}");
    let f = figures(&d.join("out"));
    assert_eq!(f["parameters"][0]["parameter"], "white.reflectance.value");
    assert!(stdout(&o).contains("white.reflectance.value  0."), "{}", stdout(&o));
    assert!(d.join("out/recovered.png").is_file() && !d.join("out/recovered.exr").exists());
}
