//! Signals: to work that has nothing to keep, and to renders and recoveries that go on.

use crate::support::{command, photofit, stderr, stdout, succeeds, until, write_rock};
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::Duration;

fn terminate(child: &Child) {
    let id = child.id().to_string();
    assert!(std::process::Command::new("kill").args(["-TERM", &id]).status().unwrap().success());
}

/// Whether a process has a handler for SIGTERM.
#[cfg(target_os = "linux")]
fn listens(id: u32) -> bool {
    let status = std::fs::read_to_string(format!("/proc/{id}/status")).unwrap_or_default();
    let caught = status.lines().find_map(|l| l.strip_prefix("SigCgt:"));
    caught.and_then(|c| u64::from_str_radix(c.trim(), 16).ok()).is_some_and(|c| c >> 14 & 1 == 1)
}

#[cfg(target_os = "linux")]
#[test]
fn work_that_has_nothing_to_keep_ends_with_status_130() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 60, true);
    let picture = photofit_image::Image::from_fn(640, 480, 3, |x, y, _| ((x * 7 + y * 3) % 17) as f32 / 17.0);
    photofit_image::write_exr(d.join("a.exr"), &[("", &picture, &["R", "G", "B"])]).unwrap();
    let keys = stdout(&succeeds(d, &["gradient", "rock.glb", "--list"]));
    let key = keys.lines().find_map(|l| l.split_whitespace().next().filter(|k| k.contains("base"))).unwrap();
    for line in [
        &["compare", "rock.glb", "rock.glb", "--views", "256", "--resolution", "2048"][..],
        &["denoise", "a.exr", "-o", "b.exr", "--model", "tgv"],
        &["gradient", "rock.glb", "--parameter", key, "--spp", "100000"],
        &["recover", "scene", "rock.glb", "--self-test", "--parameter", key, "--views", "256", "-o", "o"],
    ] {
        let mut child = command(d, line).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let id = child.id();
        until("a handler", &mut child, || listens(id));
        terminate(&child);
        let o = child.wait_with_output().unwrap();
        assert_eq!(o.status.code(), Some(130), "{line:?}: {}", stderr(&o));
        assert!(!stderr(&o).contains("kept"), "{line:?}: {}", stderr(&o));
    }
    assert!(!d.join("b.exr").exists());
}

/// A render that does not end by itself, of few pixels.
fn render<'a>(output: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let size = ["--width", "48", "--height", "32", "--save-every", "0.02", "--integrator", "path"];
    [&["render", "rock.glb", "-o", output][..], &size, more].concat()
}

#[cfg(unix)]
#[test]
fn a_terminated_render_goes_on_to_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 8, true);
    let spp = ["--spp", "2000"];
    succeeds(d, &render("whole.exr", &spp));
    let mut child =
        command(d, &render("cut.exr", &spp)).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    until("a state", &mut child, || d.join("cut.exr.state").exists());
    terminate(&child);
    let o = child.wait_with_output().unwrap();
    assert_eq!(o.status.code(), Some(3), "{}", stderr(&o));
    assert!(stderr(&o).contains("of the samples; --resume goes on"), "{}", stderr(&o));
    assert!(d.join("cut.exr").is_file(), "the picture is written");
    succeeds(d, &render("cut.exr", &[&spp[..], &["--resume"]].concat()));
    let bytes = |name: &str| std::fs::read(d.join(name)).unwrap();
    assert!(bytes("whole.exr") == bytes("cut.exr"), "the same file to the bit");
}

#[cfg(target_os = "linux")]
#[test]
fn a_render_without_a_sample_leaves_what_stands_there() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 8, true);
    std::fs::write(d.join("a.png"), "an earlier picture").unwrap();
    let kept = || std::fs::read_to_string(d.join("a.png")).is_ok_and(|s| s == "an earlier picture");
    for guide in ["off", "lobes"] {
        let o = photofit(d, &render("a.png", &["--time-limit", "0.000001", "--guiding", guide]));
        assert!(o.status.code() == Some(1) && kept(), "{guide}: {}", stderr(&o));
        assert!(stderr(&o).contains("no sample was made within --time-limit"), "{}", stderr(&o));
    }
    // While a guide learns, which takes longer here than the signal.
    let size =
        ["--width", "1024", "--height", "1024", "--spp", "4096", "--guiding", "flow", "--integrator", "path"];
    let line = [&["render", "rock.glb", "-o", "a.png"][..], &size].concat();
    let mut child = command(d, &line).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let id = child.id();
    until("a handler", &mut child, || listens(id));
    terminate(&child);
    let o = child.wait_with_output().unwrap();
    assert!(o.status.code() == Some(130) && kept(), "{:?}: {}", o.status, stderr(&o));
    assert!(!stderr(&o).contains("time limit"), "{}", stderr(&o));
}

#[cfg(unix)]
#[test]
fn a_state_that_cannot_be_saved_does_not_end_a_render() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 8, true);
    let line = render("a.exr", &["--spp", "16000000", "--json", "f.json"]);
    let mut child = command(d, &line).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let state = d.join("a.exr.state");
    until("a state", &mut child, || state.exists());
    // A state cannot replace a folder of its name; between both calls another one may have been saved.
    until("a folder", &mut child, || {
        let _ = std::fs::remove_file(&state);
        std::fs::create_dir_all(state.join("in the way")).is_ok()
    });
    let mut told = Vec::new();
    for line in BufReader::new(child.stderr.take().unwrap()).lines() {
        let line = line.unwrap();
        if line.starts_with("warning:") {
            // Time for several saves more, which are told no more.
            std::thread::sleep(Duration::from_millis(200));
            terminate(&child);
        }
        told.push(line);
    }
    assert_eq!(child.wait().unwrap().code(), Some(3), "{told:?}");
    let warnings: Vec<&String> = told.iter().filter(|l| l.starts_with("warning:")).collect();
    assert_eq!(warnings.len(), 1, "{told:?}");
    assert!(warnings[0].contains("the state could not be saved, the render goes on: "), "{told:?}");
    assert!(warnings[0].contains("a.exr.state"), "{told:?}");
    assert!(told.iter().any(|l| l.contains("--resume cannot go on")), "{told:?}");
    assert!(photofit_image::read(d.join("a.exr")).is_ok() && d.join("f.json").is_file());
}

#[cfg(unix)]
#[test]
fn a_terminated_recovery_goes_on_to_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 6, false);
    let run = |output: &'static str, more: &[&'static str]| {
        let line = ["recover", "mesh", "--self-test", "rock.glb", "-o", output, "--triangles", "320"];
        let small = ["--picture-size", "48", "--views", "12", "--texture-size", "64", "--steps", "400"];
        [&line[..], &small, more].concat()
    };
    // The name of the file is the name of the asset in it.
    for folder in ["whole", "cut"] {
        std::fs::create_dir(d.join(folder)).unwrap();
    }
    succeeds(d, &run("whole/out.glb", &[]));
    let line = run("cut/out.glb", &["--checkpoint", "c"]);
    let mut child = command(d, &line).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    until("a checkpoint", &mut child, || d.join("c/fit.ckpt").exists());
    terminate(&child);
    let o = child.wait_with_output().unwrap();
    assert_eq!(o.status.code(), Some(3), "{}", stderr(&o));
    assert!(d.join("cut/out.glb").is_file(), "what was reached is written");
    let before = bytes(d, "cut/out.glb");
    let o = photofit(d, &run("cut/out.glb", &["--checkpoint", "c", "--resume"]));
    assert_eq!(o.status.code(), Some(0), "{}", stderr(&o));
    assert!(bytes(d, "cut/out.glb") != before, "it went on");
    assert!(bytes(d, "whole/out.glb") == bytes(d, "cut/out.glb"), "the same bytes");
}

fn bytes(d: &Path, name: &str) -> Vec<u8> {
    std::fs::read(d.join(name)).unwrap()
}
