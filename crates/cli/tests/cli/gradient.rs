//! `photofit gradient`: keys, values against differences of pictures, what is refused.

use crate::support::{assert_one_error, photofit, rock, stderr, stdout, succeeds, write_rock};
use photofit_image::Image;
use std::fmt::Display;
use std::path::Path;

/// A floor and a plate of metal under a lamp.
fn scene(reflectance: impl Display) -> String {
    format!(
        "<scene version='3.0.0'><integrator type='path'><integer name='max_depth' value='3'/></integrator>
  <sensor type='perspective'><float name='fov' value='45'/>
    <transform name='to_world'><lookat origin='0,1,4' target='0,0,0' up='0,1,0'/></transform>
    <film type='hdrfilm'><integer name='width' value='16'/><integer name='height' value='12'/>
    <rfilter type='box'/></film></sensor>
  <bsdf type='diffuse' id='white'><rgb name='reflectance' value='{reflectance}'/></bsdf>
  <bsdf type='roughconductor' id='metal'><float name='alpha' value='0.3'/></bsdf>
  <shape type='rectangle' id='floor'><ref id='white'/><transform name='to_world'><scale value='4'/>
    <rotate x='1' angle='-90'/><translate y='-1'/></transform></shape>
  <shape type='sphere'><ref id='metal'/><float name='radius' value='0.6'/></shape>
  <shape type='rectangle' id='lamp'><transform name='to_world'><rotate x='1' angle='90'/>
    <translate y='3'/></transform><emitter type='area'><rgb name='radiance' value='4,5,6'/></emitter></shape>
  <emitter type='constant' id='sky'><rgb name='radiance' value='0.5'/></emitter></scene>"
    )
}

fn figures(d: &Path, file: &str) -> (Vec<f64>, Vec<f64>) {
    let text = std::fs::read_to_string(d.join(file)).unwrap();
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let array = |name: &str| json[name].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    (array("gradient"), array("standard_error"))
}

#[test]
fn keys_are_those_of_mitsuba_and_gradients_those_of_pictures() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    std::fs::write(d.join("s.xml"), scene(0.5)).unwrap();
    let list = stdout(&succeeds(d, &["gradient", "s.xml", "--list"]));
    for key in [
        "white.reflectance.value",
        "metal.alpha.value",
        "metal.specular_reflectance.value",
        "lamp.emitter.radiance.value",
        "sky.radiance.value",
    ] {
        assert!(list.lines().any(|l| l.split_whitespace().next() == Some(key)), "{key} in {list}");
    }
    photofit_image::write_exr(
        d.join("w.exr"),
        &[("", &Image::from_fn(16, 12, 3, |x, _, c| if x < 8 { 1.0 } else { c as f32 }), &["R", "G", "B"])],
    )
    .unwrap();
    let run = |threads: &str, file: &str| {
        let parameter = ["--parameter", "white.reflectance.value", "--weights", "w.exr", "--spp", "512"];
        let common = ["gradient", "s.xml", "--json", file, "--threads", threads];
        succeeds(d, &[&common[..], &parameter].concat());
        figures(d, file)
    };
    let (gradient, error) = run("1", "a.json");
    // Weights at the ends of single precision: the same numbers, by another factor.
    for (k, name) in [(120, "large.exr"), (-120, "small.exr")] {
        let factor = f64::from(k).exp2();
        let scaled = |x: usize, c: usize| if x < 8 { factor as f32 } else { c as f32 * factor as f32 };
        let image = Image::from_fn(16, 12, 3, |x, _, c| scaled(x, c));
        photofit_image::write_exr(d.join(name), &[("", &image, &["R", "G", "B"])]).unwrap();
        let parameter = ["--parameter", "white.reflectance.value", "--weights", name, "--spp", "512"];
        succeeds(d, &[&["gradient", "s.xml", "--json", "s.json"][..], &parameter].concat());
        let (found, found_error) = figures(d, "s.json");
        for c in 0..3 {
            // Numbers of the file are read to the last digit but one.
            let off = |found: f64, expected: f64| (found / factor / expected - 1.0).abs();
            assert!(
                off(found[c], gradient[c]) < 1e-14 && off(found_error[c], error[c]) < 1e-14,
                "{name} {c}"
            );
        }
    }
    assert!((gradient.clone(), error.clone()) == run("2", "b.json"), "one thread and two");
    // Weighted sums of pictures of two reflectances: sum(W I) with the same seed.
    let sum = |reflectance: f64, c: usize| {
        std::fs::write(d.join("m.xml"), scene(reflectance)).unwrap();
        succeeds(d, &["render", "m.xml", "-o", "m.exr", "--spp", "1024", "--background"]);
        let picture = photofit_image::read(d.join("m.exr")).unwrap();
        let weight = |x: usize| if x < 8 { 1.0 } else { c as f64 };
        (0..192).map(|i| weight(i % 16) * f64::from(picture.pixel(i % 16, i / 16)[c])).sum::<f64>()
    };
    for c in 0..3 {
        let difference = (sum(0.55, c) - sum(0.45, c)) / 0.1;
        let off = (gradient[c] - difference).abs();
        let bound = (0.02 * difference).max(5.0 * error[c]);
        assert!(off < bound && error[c] < 0.05 * difference, "{c}: {gradient:?} {error:?} {difference}");
    }
}

#[test]
fn channels_that_are_black_have_the_derivative_of_those_that_hardly_are() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    std::fs::write(d.join("s.xml"), scene("0.5,0,0.5")).unwrap();
    let line = ["gradient", "s.xml", "--parameter", "white.reflectance.value", "--spp", "1024"];
    let o = succeeds(d, &[&line[..], &["--json", "g.json"]].concat());
    let told = String::from_utf8_lossy(&o.stderr).into_owned();
    assert!(told.contains("1 of 3 numbers are 0") && told.contains("at 0.0001"), "{told}");
    let (gradient, error) = figures(d, "g.json");
    let sum = |green: f64| {
        std::fs::write(d.join("m.xml"), scene(format!("0.5,{green},0.5"))).unwrap();
        succeeds(d, &["render", "m.xml", "-o", "m.exr", "--spp", "1024", "--background"]);
        let picture = photofit_image::read(d.join("m.exr")).unwrap();
        (0..192).map(|i| f64::from(picture.pixel(i % 16, i / 16)[1])).sum::<f64>()
    };
    let difference = (sum(0.02) - sum(0.0)) / 0.02;
    let bound = (0.02 * difference).max(5.0 * error[1]);
    assert!((gradient[1] - difference).abs() < bound, "{gradient:?} {error:?} {difference}");
    assert!(error[1] < 0.02 * difference, "{error:?} says nothing");
}

/// The gradient, its standard error and what is told of texels that are black.
fn of_texels(
    d: &Path,
    [left, right]: [f32; 2],
    texture: &str,
    of: &str,
    key: &str,
) -> (Vec<f64>, Vec<f64>, String) {
    let image = Image::from_fn(2, 1, 3, |x, _, _| if x == 0 { left } else { right });
    photofit_image::write_exr(d.join("map.exr"), &[("", &image, &["R", "G", "B"])]).unwrap();
    let map = format!(
        "<texture type='bitmap' name='{texture}'><string name='filename' value='map.exr'/>
        <boolean name='raw' value='true'/><string name='filter_type' value='nearest'/></texture>"
    );
    std::fs::write(d.join("t.xml"), scene(0.5).replace(of, &map)).unwrap();
    let line = ["gradient", "t.xml", "--parameter", key, "--spp", "1024", "--json", "t.json"];
    let o = succeeds(d, &line);
    let (gradient, error) = figures(d, "t.json");
    (gradient, error, String::from_utf8_lossy(&o.stderr).into_owned())
}

#[test]
fn black_texels_have_the_derivatives_of_others() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    // Pictures are linear in what a lamp emits, and nearly in a small reflectance.
    let lamp = ("radiance", "<rgb name='radiance' value='4,5,6'/>", "lamp.emitter.radiance.data");
    let floor = ("reflectance", "<rgb name='reflectance' value='0.5'/>", "white.reflectance.data");
    for ((texture, of, key), black, lit, slack) in
        [(lamp, [0.0, 5.0], [2.0, 5.0], 0.0), (floor, [0.0, 0.5], [0.01, 0.5], 0.02)]
    {
        let (a, sa, told) = of_texels(d, black, texture, of, key);
        assert!(told.contains("3 of 6 numbers are 0"), "{told}");
        let json = std::fs::read_to_string(d.join("t.json")).unwrap();
        let json: serde_json::Value = serde_json::from_str(&json).unwrap();
        // Three events at most; lamps leave roulette as it is.
        let depth = if texture == "radiance" { 1 } else { 3 };
        assert_eq!([&json["lifted"], &json["roulette_depth"]], [3, depth], "{key}");
        let (b, sb, told) = of_texels(d, lit, texture, of, key);
        assert!(!told.contains("are 0"), "{told}");
        for i in 0..6 {
            let sigma = sa[i].hypot(sb[i]);
            let told = format!("{key} {i}: {a:?} +- {sa:?}, {b:?} +- {sb:?}");
            assert!((a[i] - b[i]).abs() < 5.0 * sigma + slack * b[i].abs(), "{told}");
            assert!(sigma < 0.1 * b[i].abs(), "{told} says nothing");
        }
    }
}

#[test]
fn a_gradient_of_nothing_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    std::fs::write(d.join("s.xml"), scene(0.5)).unwrap();
    let told = |depth: &str| {
        let common = ["gradient", "s.xml", "--parameter", "white.reflectance.value", "--spp", "16"];
        let out = succeeds(d, &[&common[..], &["--max-depth", depth]].concat());
        String::from_utf8_lossy(&out.stderr)
            .contains("warning: white.reflectance.value: no path depends on it")
    };
    assert_eq!(["0", "1"].map(told), [true, false]);
}

/// A mirror is in sight, and yet no picture changes with its roughness before that counts.
#[test]
fn values_that_do_not_count_are_told_as_such() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let sky = Image::from_fn(8, 4, 3, |x, _, _| x as f32 / 8.0);
    photofit_image::write_png(d.join("sky.png"), &sky).unwrap();
    for (roughness, told) in [(0.01, true), (0.2, false)] {
        let mut scene = rock(4, false);
        scene.materials[0].roughness = roughness;
        photofit_scene::save_glb(d.join("rock.glb"), &scene).unwrap();
        let key = format!("{}.roughness", scene.materials[0].name);
        let common = ["gradient", "rock.glb", "--parameter", &key, "--env", "sky.png"];
        let out = succeeds(d, &[&common[..], &["--width", "16", "--height", "16", "--spp", "16"]].concat());
        let warning = format!("warning: {key}: all values are below 0.030");
        assert_eq!(stderr(&out).contains(&warning), told, "{}", stderr(&out));
    }
}

#[test]
fn what_cannot_be_differentiated_is_refused_in_one_line() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    std::fs::write(d.join("s.xml"), scene(0.5)).unwrap();
    let run = |more: &[&str]| photofit(d, &[&["gradient", "s.xml"][..], more].concat());
    let moved = run(&["--parameter", "floor.vertex_positions"]);
    assert_one_error(&moved, "positions", &["s.xml", "vertex_positions", "rasterizer", "--list"]);
    let unknown = run(&["--parameter", "black.reflectance.value"]);
    assert_one_error(&unknown, "no such key", &["black.reflectance.value", "white.reflectance.value"]);
    // The picture of a projector has no derivatives: its keys are named as such, and not listed.
    let plate =
        "<emitter type='projector' id='beamer'><rgb name='irradiance' value='0.5 1 0.5'/></emitter></scene>";
    std::fs::write(d.join("p.xml"), scene(0.5).replace("</scene>", plate)).unwrap();
    for key in ["beamer.irradiance.data", "beamer.irradiance.value"] {
        let o = photofit(d, &["gradient", "p.xml", "--parameter", key]);
        assert_one_error(&o, "a projector", &["p.xml", key, "throws a picture", "no derivatives", "--list"]);
    }
    assert!(!stdout(&succeeds(d, &["gradient", "p.xml", "--list"])).contains("beamer"));
    let small = Image::new(3, 2, 3);
    photofit_image::write_exr(d.join("w.exr"), &[("", &small, &["R", "G", "B"])]).unwrap();
    let white = ["--parameter", "white.reflectance.value"];
    let o = run(&[&white[..], &["--weights", "w.exr"]].concat());
    assert_one_error(&o, "weights of another size", &["w.exr", "3 x 2", "16 x 12"]);
    let nan = Image::from_fn(16, 12, 3, |x, y, _| if (x, y) == (4, 7) { f32::NAN } else { 1.0 });
    photofit_image::write_exr(d.join("nan.exr"), &[("", &nan, &["R", "G", "B"])]).unwrap();
    let o = run(&[&white[..], &["--weights", "nan.exr"]].concat());
    assert_one_error(&o, "weights that are no numbers", &["nan.exr", "(4, 7)", "finite"]);
    assert_eq!(run(&[]).status.code(), Some(2), "a parameter or --list");
    assert_eq!(run(&[&white[..], &["--spp", "1"]].concat()).status.code(), Some(2), "an error needs two");
    let o = run(&[&white[..], &["--image", "g.exr"]].concat());
    assert_eq!(o.status.code(), Some(2), "a value is no picture");
    let o = run(&[&white[..], &["--json", "s.xml"]].concat());
    assert_eq!(o.status.code(), Some(2), "the scene is not written over");
    // An asset without a camera is seen as `render` shows it, but it has no other one.
    write_rock(d, 4, false);
    photofit_image::write_png(
        d.join("sky.png"),
        &Image::from_fn(8, 4, 3, |_, y, _| if y < 2 { 0.9 } else { 0.2 }),
    )
    .unwrap();
    let keys = stdout(&succeeds(d, &["gradient", "rock.glb", "--list"]));
    let key = keys.lines().find_map(|l| l.split_whitespace().next().filter(|k| k.contains("base"))).unwrap();
    let rock = ["gradient", "rock.glb", "--parameter", key, "--width", "16", "--height", "16"];
    let lit = [&rock[..], &["--env", "sky.png", "--spp", "4"]].concat();
    assert!(stdout(&succeeds(d, &lit)).contains(key));
    let o = photofit(d, &[&rock[..], &["--spp", "4"]].concat());
    assert_one_error(&o, "no light", &["rock.glb", "has no light", "--env FILE"]);
    // The error about an unknown key and the list say the same.
    let o = photofit(d, &["gradient", "rock.glb", "--parameter", "none"]);
    assert_one_error(&o, "no such key", &[&format!("{key}, "), ".emissive (0 in this scene)"]);
    assert!(keys.lines().any(|l| l.contains(".emissive") && l.ends_with("3 (0 in this scene)")), "{keys}");
    let o = photofit(d, &[&lit[..], &["--camera", "1"]].concat());
    assert_one_error(&o, "no camera", &["rock.glb", "no cameras", "--camera"]);
}
