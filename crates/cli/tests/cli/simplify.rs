//! The main job on small assets.

use crate::support::{command, names, photofit, read_json, rock, stderr, stdout, succeeds, write_rock};
use serde_json::Value;
use std::process::Stdio;
use std::time::{Duration, Instant};

/// A small fit to a file.
fn fit<'a>(output: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let mut all = vec![
        "simplify",
        "rock.glb",
        "-o",
        output,
        "--triangles",
        "300",
        "--resolution",
        "48",
        "--texture-size",
        "64",
        "--batch",
        "1",
    ];
    all.extend(more);
    all
}

#[test]
fn the_main_job_end_to_end() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    // Without uvs.
    write_rock(d, 12, false);
    let more = ["--steps", "8", "--json", "f.json", "--report", "r", "--explain", "--checkpoint", "c"];
    let o = succeeds(d, &fit("out.glb", &more));
    let (text, f) = (stdout(&o), read_json(&d.join("f.json")));
    for part in [
        "decimated",
        "baked",
        "shrink-wrapped",
        "fitted",
        "what ran",
        "skip transparent layers",
        "out.glb",
        "index.html",
    ] {
        assert!(text.contains(part), "{part} in {text}");
    }
    let light = photofit_scene::load(d.join("out.glb")).unwrap();
    assert!((1..=300).contains(&light.triangle_count()), "{}", light.triangle_count());
    assert_eq!(f["triangles_in"], 20 * 144);
    assert_eq!(f["triangles_out"], light.triangle_count());
    assert_eq!(f["steps"], 8);
    let written = f["written"].as_str().unwrap();
    assert!(
        ["fitted", "rebaked", "shrink_wrapped", "baked", "own_materials"].contains(&written),
        "{written}"
    );
    for key in ["seconds", "mpix_per_s"] {
        assert!(f[key].as_f64().is_some_and(|x| x > 0.0), "{key}: {}", f[key]);
    }
    assert_eq!(f["peak_rss_mb"].is_number(), cfg!(target_os = "linux"));
    // What was fitted has a row where it looked better than the start in some step.
    let course: Vec<f64> =
        f["history"].as_array().unwrap().iter().map(|h| h["held_out_psnr"].as_f64().unwrap()).collect();
    let gained = course.iter().any(|psnr| *psnr > course[0]);
    assert_eq!(f["fitted"].is_object(), gained, "{f}");
    assert!(gained || !["fitted", "rebaked"].contains(&written), "{f}");
    let table = text.lines().filter(|l| l.starts_with("fitted ")).count();
    assert_eq!(table, usize::from(gained), "{text}");
    for stage in ["decimated", "baked", "shrink_wrapped", "file"] {
        assert!(f[stage]["triangles"].as_u64().is_some_and(|n| (1..=300).contains(&n)), "{stage}: {f}");
        let psnr = f[stage]["psnr"].as_f64().unwrap();
        assert!((8.0..=60.0).contains(&psnr), "{stage}: {psnr}");
        assert!(f[stage]["ssim"].is_number() && f[stage]["flip"].is_number());
    }
    assert!(std::fs::read_to_string(d.join("r/index.html")).unwrap().contains("rock.glb"));
    assert_eq!(names(d), ["c", "f.json", "out.glb", "r", "rock.glb"]);
    assert_eq!(names(&d.join("c")), ["fit.ckpt"], "the only file that is checked against the inputs");
    // Every stage belongs to a step, and the steps go up.
    let steps: Vec<usize> =
        stderr(&o).lines().filter_map(|l| l.split_once(" of 6 ")?.0.parse().ok()).collect();
    assert!(steps.is_sorted() && (1..=6).all(|k| steps.contains(&k)), "{}", stderr(&o));
    assert_eq!(steps.len(), stderr(&o).lines().count(), "{}", stderr(&o));
    let size = |name: &str| std::fs::metadata(d.join(name)).unwrap().len();
    assert_eq!(
        (f["bytes_in"].as_u64(), f["bytes_out"].as_u64()),
        (Some(size("rock.glb")), Some(size("out.glb")))
    );
    assert!(text.contains("KiB"), "{text}");
}

#[test]
fn a_path_traced_reference_is_fitted_and_does_not_depend_on_threads() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 10, true);
    let run = |output: &str, reference: &str, threads: &str| {
        let o = succeeds(
            d,
            &fit(output, &["--steps", "4", "--reference", reference, "--threads", threads, "--explain"]),
        );
        let file = std::fs::read(d.join(output)).unwrap();
        std::fs::remove_file(d.join(output)).unwrap();
        (stdout(&o), file)
    };
    let (text, path) = run("out.glb", "path", "1");
    assert!(text.contains("run  indirect light"), "{text}");
    assert!(path == run("out.glb", "path", "2").1, "the same for any number of threads");
    let (text, raster) = run("out.glb", "raster", "2");
    assert!(text.contains("skip indirect light"), "{text}");
    assert!(path != raster);
}

#[test]
fn jpeg_textures_make_the_file_smaller() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 10, true);
    let bytes = |output: &str, more: &[&str]| {
        succeeds(d, &fit(output, &[&["--steps", "2"], more].concat()));
        let file = std::fs::read(d.join(output)).unwrap();
        let jpeg = file.windows(10).any(|w| w == b"image/jpeg");
        (file.len(), jpeg)
    };
    let (png, best, small) =
        (bytes("png.glb", &[]), bytes("best.glb", &["--jpeg", "98"]), bytes("small.glb", &["--jpeg"]));
    assert!(!png.1 && best.1 && small.1);
    assert!(small.0 < best.0 && small.0 < png.0, "{png:?} {best:?} {small:?}");
}

#[test]
fn glass_stays_glass_and_what_it_holds_is_kept() {
    use photofit_scene::{Extensions, Instance, Material, Transmission, Volume, load, save_glb};
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    // A rock in a larger hull of glass.
    let mut scene = rock(10, true);
    let mut hull = rock(6, false).primitives[0].clone();
    for p in &mut hull.mesh.positions {
        *p *= 1.5;
    }
    let glass = Extensions {
        transmission: Some(Transmission { factor: 1.0, texture: None }),
        volume: Some(Volume { thickness: 0.25, ..Volume::default() }),
        ..Extensions::default()
    };
    hull.material = scene.materials.len();
    scene.materials.push(Material { extensions: Some(Box::new(glass)), ..Material::clay() });
    scene.primitives.push(hull);
    scene.instances.push(Instance { primitive: 1, transform: glam::Affine3A::IDENTITY });
    save_glb(d.join("rock.glb"), &scene).unwrap();
    succeeds(d, &fit("out.glb", &["--steps", "4", "--json", "f.json"]));
    let light = load(d.join("out.glb")).unwrap();
    assert_eq!(light.materials.len(), 2);
    let glass = light.materials[1].extensions.as_ref().expect("extensions");
    assert_eq!(glass.transmission.as_ref().map(|t| t.factor.to_bits()), Some(1.0_f32.to_bits()));
    assert!((glass.volume.as_ref().unwrap().thickness - 0.25).abs() < 1e-6);
    assert_eq!(light.materials[1].alpha_mode, photofit_scene::AlphaMode::Opaque);
    assert!(light.materials[0].extensions.is_none());
    let triangles = |k: usize| light.primitives[k].mesh.triangles.len();
    assert!(triangles(0) > 20 && triangles(1) > 20, "the rock is seen through the glass");
    let f = read_json(&d.join("f.json"));
    assert!(f["file"]["psnr"].as_f64().unwrap() > 20.0, "{f}");
}

#[test]
fn threads_do_not_change_the_file() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 10, true);
    let file = |output: &str, threads: &str| {
        succeeds(d, &fit(output, &["--steps", "120", "--threads", threads]));
        std::fs::read(d.join(output)).unwrap()
    };
    // The name of the file is the name of the asset in it.
    std::fs::create_dir(d.join("two")).unwrap();
    assert!(file("out.glb", "1") == file("two/out.glb", "2"), "the same bytes");
    let other = succeeds(d, &fit("out.glb", &["--steps", "120", "--seed", "1"]));
    assert!(other.status.success());
    let (a, b) = (std::fs::read(d.join("out.glb")).unwrap(), std::fs::read(d.join("two/out.glb")).unwrap());
    assert!(a != b, "another seed gives another file");
}

#[test]
fn a_killed_fit_resumes_to_the_same_file() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 10, true);
    for folder in ["a", "b"] {
        std::fs::create_dir(d.join(folder)).unwrap();
    }
    let steps = ["--steps", "60"];
    succeeds(d, &fit("a/out.glb", &steps));

    let kept = ["--steps", "60", "--checkpoint", "state"];
    let mut child =
        command(d, &fit("b/out.glb", &kept)).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let start = Instant::now();
    while !d.join("state/fit.ckpt").exists() {
        assert!(start.elapsed() < Duration::from_secs(60), "no checkpoint");
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(!d.join("b/out.glb").exists(), "killed before the end");

    let other = photofit(d, &fit("b/out.glb", &["--steps", "61", "--checkpoint", "state", "--resume"]));
    assert_eq!(other.status.code(), Some(1), "a checkpoint of another fit is refused");
    assert!(stderr(&other).contains("--steps was 60 and is 61"), "{}", stderr(&other));
    assert!(!stderr(&other).contains("--batch"), "what agrees is not named: {}", stderr(&other));

    let resumed = [&kept[..], &["--resume"]].concat();
    let mut edited = rock(10, true);
    edited.primitives[0].mesh.positions.iter_mut().for_each(|p| p.y *= 1.01);
    photofit_scene::save_glb(d.join("edited.glb"), &edited).unwrap();
    std::fs::rename(d.join("rock.glb"), d.join("kept.glb")).unwrap();
    std::fs::rename(d.join("edited.glb"), d.join("rock.glb")).unwrap();
    let other = photofit(d, &fit("b/out.glb", &resumed));
    assert_eq!(other.status.code(), Some(1), "an edited asset of the same counts is refused");
    assert!(stderr(&other).contains("is not the same"), "{}", stderr(&other));
    std::fs::rename(d.join("kept.glb"), d.join("rock.glb")).unwrap();
    let o = succeeds(d, &fit("b/out.glb", &resumed));
    let told = stderr(&o)
        .lines()
        .find_map(|l| l.strip_prefix("resuming at step ")?.strip_suffix(" of 60")?.parse().ok());
    assert!(told.is_some_and(|step: u64| (1..=60).contains(&step)), "{}", stderr(&o));
    let (a, b) = (std::fs::read(d.join("a/out.glb")).unwrap(), std::fs::read(d.join("b/out.glb")).unwrap());
    assert!(a == b, "the same bytes");
    // Without --resume a new fit begins, and the earlier state is kept.
    let o = succeeds(d, &fit("b/out.glb", &["--steps", "2", "--checkpoint", "state"]));
    assert!(stderr(&o).contains("an earlier fit is kept as state/fit.ckpt.bak"), "{}", stderr(&o));
    assert_eq!(names(&d.join("state")), ["fit.ckpt", "fit.ckpt.bak"]);
}

#[cfg(unix)]
#[test]
fn ctrl_c_and_termination_keep_what_was_reached() {
    for signal in ["-INT", "-TERM"] {
        stopped_by(signal);
    }
}

#[cfg(unix)]
fn stopped_by(signal: &str) {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 10, true);
    let more = ["--steps", "100000", "--checkpoint", "state", "--json", "f.json"];
    let child =
        command(d, &fit("out.glb", &more)).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let start = Instant::now();
    while !d.join("state/fit.ckpt").exists() {
        assert!(start.elapsed() < Duration::from_secs(60), "no checkpoint");
        std::thread::sleep(Duration::from_millis(5));
    }
    let sent = std::process::Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
    let o = child.wait_with_output().unwrap();
    assert_eq!(o.status.code(), Some(3), "{signal}: {}", stderr(&o));
    assert!(stderr(&o).contains("stopping"), "{}", stderr(&o));
    let f = read_json(&d.join("f.json"));
    assert_eq!((&f["stopped"], &f["stopped_by"]), (&true.into(), &"signal".into()));
    assert!(f["steps"].as_u64().unwrap() < 100_000);
    assert!(photofit_scene::load(d.join("out.glb")).unwrap().triangle_count() <= 300);
}

#[cfg(unix)]
#[test]
fn a_second_signal_ends_the_program_at_once() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 10, true);
    // The judgement takes longer than the time within which signals are one.
    let judged = ["--judge", "path", "--judge-spp", "4096"];
    let more = [&["--steps", "100000", "--checkpoint", "state"][..], &judged].concat();
    let mut child =
        command(d, &fit("out.glb", &more)).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let start = Instant::now();
    while !d.join("state/fit.ckpt").exists() {
        assert!(start.elapsed() < Duration::from_secs(60), "no checkpoint");
        std::thread::sleep(Duration::from_millis(5));
    }
    // Those that come with the first are the same request.
    let id = child.id().to_string();
    while child.try_wait().unwrap().is_none() {
        assert!(start.elapsed() < Duration::from_secs(120), "still runs");
        std::process::Command::new("kill").args(["-TERM", &id]).stderr(Stdio::null()).status().unwrap();
        std::thread::sleep(Duration::from_millis(1));
    }
    let status = child.wait().unwrap().code();
    assert_eq!(status, Some(130));
    // The file may have been written before the judgement that was ended.
    let out = d.join("out.glb");
    assert!(!out.exists() || photofit_scene::load(&out).is_ok(), "a whole file or none");
}

#[test]
fn a_time_limit_is_a_wish_and_no_failure() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 10, true);
    let more = ["--steps", "100000", "--time-limit", "0.5", "--json", "f.json"];
    succeeds(d, &fit("out.glb", &more));
    let f = read_json(&d.join("f.json"));
    assert_eq!((&f["stopped"], &f["stopped_by"]), (&true.into(), &"time limit".into()));
}

#[cfg(unix)]
#[test]
fn a_signal_after_the_fit_has_the_status_of_a_stopped_job() {
    use std::io::{BufRead as _, BufReader};
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 10, true);
    let mut line = fit("out.glb", &["--steps", "2", "--json", "f.json"]);
    let resolution = line.iter().position(|a| *a == "48").unwrap();
    line[resolution] = "320";
    let mut child = command(d, &line).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let mut told = String::new();
    for line in BufReader::new(child.stderr.take().unwrap()).lines() {
        let line = line.unwrap();
        // The line of a stage comes at its end: after the second phase, whose maps are baked anew, what is written is chosen.
        if line.starts_with("5 of 6 fit") && !line.contains('/') && told.contains("5 of 6 bake") {
            let id = child.id().to_string();
            assert!(std::process::Command::new("kill").args(["-TERM", &id]).status().unwrap().success());
        }
        told += &(line + "\n");
    }
    assert_eq!(child.wait().unwrap().code(), Some(3), "{told}");
    let f = read_json(&d.join("f.json"));
    assert_eq!((&f["stopped"], &f["stopped_by"]), (&true.into(), &"signal".into()));
    assert!(d.join("out.glb").exists());
}

#[test]
fn a_report_that_cannot_be_written_hides_nothing_else() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 10, true);
    let more = ["--steps", "60", "--checkpoint", "state", "--report", "r", "--json", "f.json"];
    let child =
        command(d, &fit("out.glb", &more)).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let start = Instant::now();
    while !d.join("state/fit.ckpt").exists() {
        assert!(start.elapsed() < Duration::from_secs(60), "no checkpoint");
        std::thread::sleep(Duration::from_millis(2));
    }
    // A page cannot replace a folder of its name.
    std::fs::create_dir_all(d.join("r/index.html/in the way")).unwrap();
    let o = child.wait_with_output().unwrap();
    assert_eq!(o.status.code(), Some(1), "{}", stderr(&o));
    for part in ["decimated", "fitted", "looks", "wrote out.glb"] {
        assert!(stdout(&o).contains(part), "{part:?} in {}", stdout(&o));
    }
    let error = stderr(&o).lines().find(|l| l.starts_with("error: ")).unwrap_or_default().to_owned();
    assert!(error.contains("index.html") && error.contains("the report is not written"), "{error}");
    assert!(d.join("out.glb").exists());
    assert!(read_json(&d.join("f.json"))["report"].is_null());
}

#[test]
fn a_path_traced_judgement_is_announced_and_can_be_bounded() {
    use photofit_scene::{Clearcoat, Extensions};
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let mut scene = rock(8, true);
    let coat = Clearcoat { factor: 1.0, ..Clearcoat::default() };
    scene.materials[0].extensions =
        Some(Box::new(Extensions { clearcoat: Some(coat), ..Extensions::default() }));
    photofit_scene::save_glb(d.join("rock.glb"), &scene).unwrap();
    let run = |more: &[&str]| {
        let all = [&["--steps", "1", "--explain", "--json", "f.json", "--report", "r"][..], more].concat();
        let o = succeeds(d, &fit("out.glb", &all));
        let page = std::fs::read_to_string(d.join("r/index.html")).unwrap();
        (stdout(&o), stderr(&o), read_json(&d.join("f.json")), page)
    };
    let (out, err, f, page) = run(&["--judge-spp", "2"]);
    // 8 views of the asset, twice, and of at most 5 stages, 48 pixels a side.
    let cost = "the report takes up to 56 pictures of 48 x 48 pixels, 2 samples each";
    assert!(out.contains("run  path traced judgement") && out.matches(cost).count() == 1, "{out}");
    let drawn = out.matches("the report takes ").count();
    assert_eq!(drawn, 2, "what was drawn is told without a bound: {out}");
    assert!(err.contains(cost) && err.contains("--judge raster"), "{err}");
    assert_eq!((&f["judged"], &f["judge_spp"]), (&"path traced".into(), &2.into()));
    let judged = "judged by path traced pictures of 48 x 48 pixels, 2 samples each";
    assert!(out.contains(judged) && page.contains(judged), "{out}");
    // It is in the file: not left out.
    assert!(err.contains("kept, but not drawn while fitting") && !err.contains("left out"), "{err}");
    assert!(f["left_out"].as_array().unwrap().is_empty() && f["not_fitted"][0].is_string(), "{f}");
    assert!(page.contains("Kept, but not drawn while fitting") && !page.contains("<h3>Left out"));
    let (out, err, f, page) = run(&["--judge", "raster"]);
    assert!(out.contains("skip path traced judgement") && !err.contains("path tracing"), "{out} {err}");
    assert_eq!((&f["judged"], &f["judge_spp"]), (&"rasterized".into(), &Value::Null));
    assert!(page.contains("judged by rasterized pictures."));
}

#[test]
fn an_effort_is_told_and_what_is_said_beside_it_counts() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 8, false);
    let more = ["--effort", "fast", "--steps", "3", "--explain", "--json", "f.json"];
    let text = stdout(&succeeds(d, &fit("out.glb", &more)));
    assert!(
        text.contains("effort fast: 250 steps at most") && text.contains("; 3 steps are asked for"),
        "{text}"
    );
    let f = read_json(&d.join("f.json"));
    assert_eq!((f["effort"].as_str(), f["steps"].as_u64()), (Some("fast"), Some(3)));
    assert_eq!(f["views"].as_array().map(Vec::len), Some(4));
    assert!(f["baked"].is_null() && f["shrink_wrapped"].is_object(), "one start: {text}");
    assert!(
        text.contains("steps                  3 of at most 3") && text.contains("unseen triangles"),
        "{text}"
    );
    assert_eq!(text.matches("cargo xtask bench raster").count(), 1, "{text}");
}

#[test]
fn a_budget_of_bytes_that_no_file_meets_is_a_failure_that_loses_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 6, false);
    std::fs::write(d.join("out.glb"), "of last week").unwrap();
    let o = photofit(d, &fit("out.glb", &["--steps", "2", "--max-bytes", "500", "--json", "f.json"]));
    let told = stderr(&o);
    assert_eq!(o.status.code(), Some(1), "{told}");
    assert!(told.contains("--max-bytes asks for at most 500") && told.contains("out.glb"), "{told}");
    assert_eq!(std::fs::read(d.join("out.glb")).unwrap(), b"of last week", "what was there stays");
    // The lightest file that was found stands beside it, and the bytes that are named take it.
    let beside = d.join("out.too-large.glb");
    assert!(photofit_scene::load(&beside).is_ok());
    let f = read_json(&d.join("f.json"));
    assert!(f["output"].as_str().unwrap().ends_with("out.too-large.glb"), "{f}");
    let bytes = std::fs::metadata(&beside).unwrap().len();
    assert!(told.contains(&format!("--max-bytes {bytes}")), "{told}");
    let o = photofit(d, &fit("out.glb", &["--steps", "2", "--max-bytes", &bytes.to_string()]));
    assert!(o.status.success(), "{}", stderr(&o));
    assert_eq!(std::fs::metadata(d.join("out.glb")).unwrap().len(), bytes);
    // A file of that name is no input to be lost.
    std::fs::copy(d.join("rock.glb"), d.join("o.too-large.glb")).unwrap();
    let over = ["simplify", "o.too-large.glb", "-o", "o.glb", "--triangles", "20", "--max-bytes", "500"];
    let o = photofit(d, &over);
    assert!(!o.status.success() && stderr(&o).contains("--max-bytes"), "{}", stderr(&o));
    assert_eq!(std::fs::read(d.join("o.too-large.glb")).unwrap(), std::fs::read(d.join("rock.glb")).unwrap());
}

#[test]
fn own_surfaces_vertex_colours_and_locked_borders_are_written_and_read_again() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let heavy = photofit_scene::load(write_rock(d, 8, true)).unwrap();
    let run = |output: &str, more: &[&str]| {
        let budget = [
            "simplify",
            "rock.glb",
            "-o",
            output,
            "--ratio",
            "0.4",
            "--resolution",
            "48",
            "--json",
            "f.json",
        ];
        let o = succeeds(d, &[&budget[..], more].concat());
        (photofit_scene::load(d.join(output)).unwrap(), read_json(&d.join("f.json")), stdout(&o))
    };
    let (kept, figures, text) = run("kept.glb", &["--keep-uvs", "--effort", "fast", "--explain"]);
    assert!(
        kept.triangle_count() * 2 < heavy.triangle_count()
            && kept.primitives.iter().all(|p| !p.mesh.uvs.is_empty())
    );
    assert_eq!(kept.images.len(), heavy.images.len());
    assert!(kept.images.iter().zip(&heavy.images).all(|(a, b)| a.texels == b.texels), "the same textures");
    assert!(
        figures["written"] == "kept"
            && text.contains("effort fast: 2 views of the choice or more where it is close, 4 of the report"),
        "{figures} {text}"
    );
    assert_eq!(figures["views"].as_array().map(Vec::len), Some(4), "{figures}");
    let (colored, ..) = run("colors.glb", &["--textures", "none", "--steps", "4", "--batch", "1"]);
    assert!(colored.images.is_empty() && colored.primitives.iter().all(|p| !p.mesh.colors.is_empty()));
    let (locked, ..) =
        run("locked.glb", &["--lock-borders", "--steps", "4", "--batch", "1", "--texture-size", "64"]);
    assert!(locked.triangle_count() < heavy.triangle_count());
    for (wrong, part) in [
        (&["--keep-uvs", "--steps", "9"][..], "--steps"),
        (&["--lock-borders", "--compress", "meshopt"][..], "needs exact positions"),
    ] {
        let budget = ["simplify", "rock.glb", "-o", "no.glb", "--ratio", "0.4"];
        let o = photofit(d, &[&budget[..], wrong].concat());
        assert_eq!(o.status.code(), Some(2), "{}", stderr(&o));
        assert!(stderr(&o).contains(part) && !d.join("no.glb").exists(), "{}", stderr(&o));
    }
}

#[test]
fn steps_that_nothing_needs_are_told_with_the_reason() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 4, true);
    let more = ["--max-bytes", "9000000", "--resolution", "32", "--texture-size", "32", "--effort", "fast"];
    let more = [&["simplify", "rock.glb", "-o", "out.glb", "--steps", "7", "--explain"][..], &more].concat();
    let text = stdout(&succeeds(d, &more));
    assert!(text.contains("; 7 steps are asked for"), "{text}");
    let reason = "skip steps                  all triangles stay: nothing is missing";
    assert_eq!(text.matches(reason).count(), 2, "before and after: {text}");
}
