//! `render --integrator path`.

use crate::support::{
    assert_misuse, assert_one_error, command, names, photofit, read_json, rock, stderr, stdout, succeeds,
    until, write_rock,
};
use photofit_image::Image;
use photofit_scene::{Extensions, Sheen};
use std::path::Path;
use std::time::{Duration, Instant};

const SMALL: [&str; 8] = ["render", "rock.glb", "--integrator", "path", "--width", "48", "--height", "32"];

fn render(d: &Path, output: &str, more: &[&str]) -> Image {
    succeeds(d, &[&SMALL[..], &["-o", output], more].concat());
    photofit_image::read(d.join(output)).unwrap()
}

fn mean(image: &Image, c: usize) -> f32 {
    image.select(&[c]).data.iter().sum::<f32>() / image.pixels() as f32
}

#[test]
fn the_picture_is_that_of_the_rasterizer_with_all_light() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 8, true);
    let path = render(d, "a.exr", &["--spp", "16"]);
    succeeds(d, &["render", "rock.glb", "-o", "b.exr", "--width", "48", "--height", "32"]);
    let raster = photofit_image::read(d.join("b.exr")).unwrap();
    assert!((mean(&path, 3) - mean(&raster, 3)).abs() < 0.01, "the same coverage");
    let (a, b) = (mean(&path, 0), mean(&raster, 0));
    assert!((0.6..1.1).contains(&(a / b)), "{a} and {b}: shadows darken, light between surfaces brightens");
    let png = render(d, "a.png", &["--spp", "4", "--exposure", "1", "--tone-map"]);
    assert_eq!((png.channels, png.pixel(0, 0)[3]), (4, 0.0));
    let seen = render(d, "c.exr", &["--spp", "4", "--background"]);
    assert!(seen.pixel(0, 0)[0] > 0.1, "the environment is behind the rock");
    assert_eq!(names(d), ["a.exr", "a.png", "b.exr", "c.exr", "rock.glb"], "no state is left");
}

#[test]
fn layers_and_the_plan_are_written() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 8, true);
    let more = ["-o", "a.exr", "--spp", "8", "--aov", "albedo,normal,depth,variance", "--explain"];
    let o = succeeds(d, &[&SMALL[..], &more].concat());
    assert!(stdout(&o).contains("skipped: there are no volumes"), "{}", stdout(&o));
    let layers = photofit_image::read_exr_layers(d.join("a.exr")).unwrap();
    let found: Vec<(&str, usize)> = layers.iter().map(|(name, i, _)| (name.as_str(), i.channels)).collect();
    assert_eq!(found, [("", 4), ("albedo", 3), ("depth", 1), ("normal", 3), ("variance", 3)]);
    let bytes = std::fs::read(d.join("a.exr")).unwrap();
    assert!(bytes.windows(12).any(|w| w == b"photofit/spp"), "metadata");
    let o = photofit(d, &[&SMALL[..], &["-o", "a.png", "--aov", "depth"]].concat());
    assert_misuse(&o, "layers need an .exr", &["a.png", "--aov"]);
    let o = photofit(d, &[&SMALL[..], &["-o", "b.exr", "--aov", "depht"]].concat());
    assert_misuse(&o, "a misspelt layer", &["depht", "depth"]);
    let o = photofit(d, &[&SMALL[..], &["-o", "b.exr", "--camera", "2"]].concat());
    assert_one_error(&o, "a camera that is not there", &["rock.glb", "no cameras"]);
    let o = photofit(d, &[&SMALL[..], &["-o", "b.exr", "--light", "asset"]].concat());
    assert_one_error(&o, "nothing glows", &["rock.glb", "no light"]);
}

#[test]
fn the_plan_of_guided_paths_tells_what_they_run() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 8, true);
    let more = ["-o", "a.png", "--spp", "4", "--guiding", "lobes", "--explain", "--json", "a.json"];
    let text = stdout(&succeeds(d, &[&SMALL[..], &more].concat()));
    let (guided, rest) = text.split_once("path tracing").expect("the picture");
    assert!(guided.starts_with("paths that a guide learns from"), "{text}");
    // All sets of features are not compiled for each guide.
    let guide_line = |name: &str| guided.lines().find(|l| l.trim().starts_with(name)).expect("a line");
    assert!(guide_line("alpha tests").contains("idle: every surface is opaque"), "{text}");
    assert!(guide_line("media").contains("skipped: there are no volumes"), "{text}");
    let figures = read_json(&d.join("a.json"));
    let used = figures["guide"]["used"].as_bool().expect("a guide was trained");
    let line = if used { "as these paths" } else { "alpha tests            skipped" };
    assert!(rest.contains(line), "{used}: {text}");
    // Where no time is left for training, no guide learns.
    let more = ["-o", "b.png", "--guiding", "lobes", "--explain", "--time-limit", "0.000001"];
    let o = photofit(d, &[&SMALL[..], &more].concat());
    let text = stdout(&o);
    assert!(o.status.code() == Some(1) && !d.join("b.png").exists(), "{text}");
    assert!(!text.contains("paths that a guide learns from"), "{text}");
    assert!(text.contains("path tracing, not guided"), "{text}");
}

#[test]
fn a_guided_render_goes_on_to_the_same_bits() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 8, true);
    let size = ["render", "rock.glb", "--integrator", "path", "--width", "96", "--height", "64"];
    // So few samples are worth so many rounds, with a limit and without.
    for (guide, spp, rounds) in [("lobes", "400", 4), ("flow", "120", 3)] {
        let forced = ["--guiding", guide, "--least-gain", "0", "--spp", spp];
        let line = |output, more: &[&'static str]| [&size[..], &["-o", output], &forced, more].concat();
        succeeds(d, &line("whole.exr", &[]));
        let _ = std::fs::remove_file(d.join("cut.exr"));
        let often = ["--save-every", "0.02", "--time-limit", "1000"];
        let mut child = command(d, &line("cut.exr", &often)).spawn().unwrap();
        let state = d.join("cut.exr.state");
        until("a state", &mut child, || state.exists());
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(state.exists() && !d.join("cut.exr").exists(), "{guide}: killed in the middle");
        // What differs is named, and nothing else.
        let other = |more: &[&str]| photofit(d, &[&size[..], &["-o", "cut.exr", "--resume"], more].concat());
        let o = other(&["--guiding", guide, "--spp", spp]);
        assert_one_error(&o, "another gain", &["made with another guide or training of a guide; it"]);
        let o = other(&[&forced[..], &["--seed", "3"]].concat());
        assert_one_error(&o, "another seed", &["made with another seed; it"]);
        // Learning again takes longer than this.
        let o = photofit(d, &line("cut.exr", &["--resume", "--time-limit", "0.000001"]));
        assert!(o.status.success(), "{}", stderr(&o));
        assert!(stderr(&o).contains("before the guide had learned again"), "{}", stderr(&o));
        succeeds(d, &line("cut.exr", &["--resume", "--threads", "1", "--json", "f.json"]));
        let bytes = |name: &str| std::fs::read(d.join(name)).unwrap();
        assert!(bytes("whole.exr") == bytes("cut.exr"), "{guide}: the same file to the bit");
        let figures = read_json(&d.join("f.json"));
        assert_eq!((&figures["guide"]["used"], &figures["guide"]["rounds"]), (&true.into(), &rounds.into()));
        assert!(figures["training_seconds"].as_f64().unwrap() > 0.0);
        let told = figures["guide"]["told"].as_str().expect("a sentence");
        assert!(told.starts_with(&format!("guiding ({guide}) is on: variance / ")), "{told}");
        assert_eq!((&figures["guide"]["least_gain"], &figures["unsampled"]), (&0.0.into(), &0.into()));
    }
}

#[test]
fn a_guide_that_was_given_up_is_off_when_the_render_goes_on() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 8, true);
    let line = [&SMALL[..], &["-o", "a.exr", "--guiding", "lobes", "--json", "a.json"]].concat();
    // Rounds double, and training may take three tenths: where one of these limits ends it, there is time for samples left.
    let given_up = |k: i32| {
        let limit = (0.002 * 2_f64.powi(k)).to_string();
        let o = photofit(d, &[&line[..], &["--spp", "1000000", "--time-limit", &limit]].concat());
        let figures = || read_json(&d.join("a.json"));
        o.status.success() && figures()["guide"].is_null() && figures()["training_seconds"] != 0.0
    };
    assert!((0..12).any(given_up), "no limit ended training alone");
    let more = ["--spp", "1000000", "--time-limit", "0.3", "--resume"];
    let o = succeeds(d, &[&line[..], &more].concat());
    assert!(stderr(&o).contains("guiding is off, as it was before"), "{}", stderr(&o));
}

#[test]
fn pixels_without_a_sample_are_told() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 8, true);
    let line = ["render", "rock.glb", "--integrator", "path", "--width", "600", "--height", "400"];
    // Some limit ends the first sample in the middle.
    let told = |k: i32| {
        let limit = (0.001 * 2_f64.powi(k)).to_string();
        let more = ["-o", "a.png", "--json", "a.json", "--spp", "1", "--time-limit", &limit];
        let o = photofit(d, &[&line[..], &more].concat());
        if !d.join("a.json").exists() {
            return false;
        }
        let figures = read_json(&d.join("a.json"));
        let unsampled = figures["unsampled"].as_u64().unwrap();
        let samples = figures["samples"].as_u64().unwrap();
        assert_eq!(unsampled + samples, 240_000, "a sample a pixel at most");
        let line = format!("{unsampled} of 240000 pixels have no sample");
        assert_eq!(stderr(&o).contains(&line), unsampled > 0, "{}", stderr(&o));
        unsampled > 0
    };
    assert!((0..12).any(told), "no limit ended the first sample");
}

#[test]
fn noise_and_time_end_a_render() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 8, true);
    let samples = |name: &str| {
        let layers = photofit_image::read_exr_layers(d.join(name)).unwrap();
        layers.into_iter().find(|l| l.0 == "samples").unwrap().1.data
    };
    render(d, "noise.exr", &["--noise", "0.1", "--aov", "samples", "--json", "noise.json"]);
    let figures = read_json(&d.join("noise.json"));
    assert!(figures["noise"].as_f64().is_some_and(|n| n <= 0.1), "{figures}");
    assert_eq!((&figures["finished"], &figures["width"]), (&true.into(), &48.into()));
    let n = samples("noise.exr");
    assert!(n.iter().all(|n| (32.0..4096.0).contains(n)), "{n:?}");
    let began = Instant::now();
    render(d, "time.exr", &["--time-limit", "0.3", "--aov", "samples", "--spp", "1000000"]);
    assert!(began.elapsed() < Duration::from_secs(60));
    assert!(samples("time.exr").iter().any(|n| *n > 1.0));
    assert!(names(d).contains(&"time.exr.state".to_owned()), "an unfinished render can go on");
    render(d, "time.exr", &["--resume", "--aov", "samples", "--spp", "1"]);
    assert!(names(d).contains(&"time.exr.state".to_owned()), "it has more samples than that");
}

#[test]
fn a_killed_render_goes_on_to_the_same_bits() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    photofit_scene::save_glb(d.join("rock.glb"), &rock(8, true)).unwrap();
    let options = ["--spp", "300", "--aov", "all", "--seed", "5"];
    let arguments = |output| [&SMALL[..], &["-o", output], &options].concat();
    succeeds(d, &arguments("whole.exr"));
    let state = d.join("killed.exr.state");
    let often = ["--save-every", "0.02"];
    let mut child = command(d, &[&arguments("killed.exr")[..], &often].concat()).spawn().unwrap();
    until("a state", &mut child, || state.exists());
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(state.exists() && !d.join("killed.exr").exists(), "killed in the middle");
    // Another seed is another picture.
    let other = [&SMALL[..], &["-o", "killed.exr", "--spp", "300", "--aov", "all", "--resume"]].concat();
    assert_one_error(&photofit(d, &other), "a foreign state", &["killed.exr.state", "another seed"]);
    succeeds(d, &[&arguments("killed.exr")[..], &["--resume", "--threads", "3"]].concat());
    let bytes = |name: &str| std::fs::read(d.join(name)).unwrap();
    assert!(bytes("whole.exr") == bytes("killed.exr"), "the same file to the bit");
    assert!(!state.exists(), "a finished render leaves no state");
    // One that begins anew keeps the state that it finds.
    std::fs::write(&state, "of an earlier render").unwrap();
    let o = succeeds(d, &[&SMALL[..], &["-o", "killed.exr", "--spp", "2"]].concat());
    assert!(stderr(&o).contains("killed.exr.state.bak"), "{}", stderr(&o));
    assert!(d.join("killed.exr.state.bak").exists());
    // Who forgets it twice loses nothing either.
    std::fs::write(&state, "of the render after it").unwrap();
    let o = succeeds(d, &[&SMALL[..], &["-o", "killed.exr", "--spp", "2"]].concat());
    assert!(stderr(&o).contains("killed.exr.state.bak2"), "{}", stderr(&o));
    assert_eq!(bytes("killed.exr.state.bak"), b"of an earlier render");
    assert_eq!(bytes("killed.exr.state.bak2"), b"of the render after it");
}

/// Leaves a render unfinished, changes a file that its scene names, and expects that the state is refused.
fn refused_after(d: &Path, input: &str, more: &[&str], change: impl FnOnce()) {
    let small = ["render", input, "-o", "a.exr", "--width", "16", "--height", "16", "--spp", "1000000"];
    let line = [&small[..], more].concat();
    succeeds(d, &[&line[..], &["--time-limit", "0.05"]].concat());
    let resumed = [&line[..], &["--resume", "--time-limit", "0.05"]].concat();
    assert!(stderr(&succeeds(d, &resumed)).contains("resuming at"), "{input}: nothing has changed");
    change();
    assert_one_error(&photofit(d, &resumed), input, &["a.exr.state", "another scene"]);
    std::fs::remove_file(d.join("a.exr.state")).unwrap();
}

#[test]
fn a_state_belongs_to_all_files_of_its_scene() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let png = |value: f32| {
        // Of another length, because times of files may be coarse.
        let picture = Image::from_fn(4, if value > 0.5 { 4 } else { 8 }, 3, |x, _, _| value * x as f32 / 4.0);
        photofit_image::write_png(d.join("t.png"), &picture).unwrap();
    };
    png(1.0);
    let obj = "mtllib t.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3\n";
    std::fs::write(d.join("t.obj"), obj).unwrap();
    std::fs::write(d.join("t.mtl"), "newmtl a\nmap_Kd t.png\n").unwrap();
    let path = ["--integrator", "path"];
    refused_after(d, "t.obj", &path, || png(0.3));
    refused_after(d, "t.obj", &path, || {
        std::fs::write(d.join("t.mtl"), "newmtl a\nmap_Kd t.png\nNs 10\n").unwrap();
    });
    let scene = "<scene version='3.0.0'><sensor type='perspective'/><shape type='obj'><string name='filename' \
                 value='t.obj'/></shape><emitter type='constant'/></scene>";
    std::fs::write(d.join("s.xml"), scene).unwrap();
    refused_after(d, "s.xml", &[], || std::fs::write(d.join("t.obj"), format!("{obj}# changed\n")).unwrap());
}

#[test]
fn what_the_rasterizer_does_not_draw_is_told_once() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let mut velvet = rock(4, false);
    let sheen = Sheen { color: [0.2, 0.3, 1.0], roughness: 0.4, ..Sheen::default() };
    velvet.materials[0].extensions =
        Some(Box::new(Extensions { sheen: Some(sheen), ..Extensions::default() }));
    photofit_scene::save_glb(d.join("velvet.glb"), &velvet).unwrap();
    write_rock(d, 4, false);
    let warnings = |input: &str, more: &[&str]| {
        let line = ["render", input, "-o", "a.png", "--width", "16", "--height", "16", "--spp", "1"];
        let text = stderr(&succeeds(d, &[&line[..], more].concat()));
        text.lines().filter(|l| l.starts_with("warning")).map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(
        warnings("velvet.glb", &[]),
        [
            "warning: velvet.glb: the rasterizer does not draw sheen of 1 of 1 materials; --integrator path does"
        ]
    );
    assert!(warnings("velvet.glb", &["--integrator", "path"]).is_empty());
    assert!(warnings("rock.glb", &[]).is_empty());
}
