//! `render --integrator path`.

use crate::support::{
    assert_misuse, assert_one_error, command, names, photofit, rock, stderr, stdout, succeeds, write_rock,
};
use photofit_image::Image;
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
    assert_one_error(&o, "a camera that is not there", &["rock.glb", "0 cameras"]);
    let o = photofit(d, &[&SMALL[..], &["-o", "b.exr", "--light", "asset"]].concat());
    assert_one_error(&o, "nothing glows", &["rock.glb", "no light"]);
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
    let figures: serde_json::Value =
        serde_json::from_slice(&std::fs::read(d.join("noise.json")).unwrap()).unwrap();
    assert!(figures["noise"].as_f64().is_some_and(|n| n <= 0.1), "{figures}");
    assert_eq!((&figures["finished"], &figures["width"]), (&true.into(), &48.into()));
    let n = samples("noise.exr");
    assert!(n.iter().all(|n| (32.0..4096.0).contains(n)), "{n:?}");
    let began = Instant::now();
    render(d, "time.exr", &["--time-limit", "0.3", "--aov", "samples", "--spp", "1000000"]);
    assert!(began.elapsed() < Duration::from_secs(60));
    assert!(samples("time.exr").iter().any(|n| *n > 0.0));
    assert!(names(d).contains(&"time.exr.state".to_owned()), "an unfinished render can go on");
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
    let began = Instant::now();
    while !state.exists() && child.try_wait().unwrap().is_none() && began.elapsed() < Duration::from_secs(60)
    {
        std::thread::sleep(Duration::from_millis(2));
    }
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
}
