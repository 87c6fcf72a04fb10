//! Chains of levels of detail.

use crate::support::{
    assert_misuse, command, names, photofit, read_json, stderr, stdout, succeeds, write_rock,
};
use serde_json::Value;
use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};

fn chain<'a>(output: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let mut all = vec!["simplify", "rock.glb", "-o", output, "--lod", "48,24,16", "--batch", "1"];
    all.extend(["--lod-triangles", "300,100,64"]);
    all.extend(more);
    all
}

#[test]
fn a_chain_in_one_command() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 10, true);
    let more = ["--steps", "8", "--msft-lod", "--json", "f.json", "--report", "r", "--checkpoint", "c"];
    let o = succeeds(d, &chain("out.glb", &more));
    let files =
        ["c", "f.json", "out.glb", "out.lod1.glb", "out.lod2.glb", "out.lods.glb", "out.lods.json", "r"];
    assert_eq!(names(d), [&files[..], &["rock.glb"]].concat());
    assert_eq!(names(&d.join("c")), ["fit.ckpt", "part1", "part2"]);
    assert!(d.join("r/index.html").exists() && d.join("r/lod2/index.html").exists());
    let (summary, all) = (read_json(&d.join("out.lods.json")), read_json(&d.join("f.json")));
    let levels = summary["levels"].as_array().unwrap();
    assert_eq!((levels.len(), all["levels"].as_array().unwrap().len()), (3, 3));
    for (k, level) in levels.iter().enumerate() {
        let file = d.join(level["file"].as_str().unwrap());
        assert_eq!(level["bytes"].as_u64(), Some(std::fs::metadata(&file).unwrap().len()));
        assert_eq!(level["triangles"], photofit_scene::load(&file).unwrap().triangle_count());
        assert_eq!(level["size"], [48.0, 24.0, 16.0][k]);
        assert_eq!(level["switch_size"].is_number(), k < 2);
        assert_eq!(level["popping_flip"].is_number(), k < 2);
        for key in ["psnr", "flip", "original_psnr", "original_flip", "luminance_ratio"] {
            assert!(level[key].as_f64().is_some_and(|x| x > 0.0), "{key}: {level}");
        }
    }
    assert!(stdout(&o).contains("level 3 of 3, for 16 pixels"), "{}", stdout(&o));
    assert!(stderr(&o).lines().all(|l| !l.starts_with("warning")), "{}", stderr(&o));
}

#[test]
fn a_continuous_chain_has_targets_that_inspect_shows() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 10, true);
    let more = ["--steps", "4", "--continuous", "--msft-lod", "--compress", "meshopt", "--json", "f.json"];
    let o = succeeds(d, &chain("out.glb", &more));
    assert!(stdout(&o).contains("turns into lod1 from 48 to 34 pixels"), "{}", stdout(&o));
    let (summary, all) = (read_json(&d.join("out.lods.json")), read_json(&d.join("f.json")));
    for (k, level) in summary["levels"].as_array().unwrap().iter().enumerate() {
        let blend = &level["blend"];
        assert_eq!(*blend, all["levels"][k]["blend"]);
        let file = d.join(level["file"].as_str().unwrap());
        assert_eq!(level["bytes"].as_u64(), Some(std::fs::metadata(&file).unwrap().len()));
        let told = stdout(&succeeds(d, &["inspect", level["file"].as_str().unwrap(), "--json", "i.json"]));
        let inspected = read_json(&d.join("i.json"));
        if k == 2 {
            assert!(blend.is_null() && !told.contains("morph target"), "{told}");
            assert_eq!(inspected["morph_targets"], serde_json::json!([]));
            continue;
        }
        let name = format!("lod{}", k + 1);
        assert!(told.contains(&format!("1 morph target: {name:?}")), "{told}");
        assert_eq!(
            (&inspected["morph_targets"][0]["names"][0], &blend["target"]),
            (&name.clone().into(), &name.into())
        );
        assert_eq!(
            (&blend["weight_0_size"], &blend["weight_1_size"]),
            (&level["size"], &level["switch_size"])
        );
        let number = |v: &Value| v.as_f64().unwrap();
        assert!(number(&blend["popping_outline"]) < number(&level["popping_outline"]), "{level}");
        let mean = |when: &str| number(&blend[when]["mean"]);
        assert!(mean("distance_weight_1") < mean("distance_weight_0"), "{level}");
        assert_eq!(blend["turned_triangles"], 0);
    }
    assert!(stdout(&succeeds(d, &["inspect", "out.lods.glb"])).contains("1 morph target: \"lod1\""));
}

#[test]
fn continuous_chains_go_with_what_else_levels_have() {
    for more in [&["--textures", "none"][..], &["--keep-uvs"], &["--lock-borders"], &["--jpeg"]] {
        let dir = tempfile::tempdir().unwrap();
        let d = dir.path();
        write_rock(d, 8, true);
        let line = ["simplify", "rock.glb", "-o", "out.glb", "--lod", "32,16", "--lod-triangles", "200,80"];
        let steps = if more == ["--keep-uvs"] { &[][..] } else { &["--steps", "1", "--batch", "1"] };
        succeeds(d, &[&line[..], &["--continuous"], steps, more].concat());
        let level = photofit_scene::load(d.join("out.glb")).unwrap();
        let meshes = &level.hierarchy.as_ref().unwrap().meshes;
        assert!(!meshes.is_empty() && meshes.iter().all(|m| m.targets() == 1), "{more:?}");
        let blend = &read_json(&d.join("out.lods.json"))["levels"][0]["blend"];
        let mean = |when: &str| blend[when]["mean"].as_f64().unwrap();
        assert!(mean("distance_weight_1") < mean("distance_weight_0"), "{more:?}: {blend}");
    }
}

#[test]
fn no_level_replaces_an_input_or_another_output() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let rock = write_rock(d, 4, false);
    for (input, output, more) in [
        ("out.lod1.glb", "out.glb", vec![]),
        ("out.lods.glb", "out.glb", vec!["--msft-lod"]),
        ("rock.glb", "out.glb", vec!["--json", "out.lods.json"]),
        ("rock.glb", "out.glb", vec!["--json", "out.lod2.glb"]),
    ] {
        std::fs::copy(&rock, d.join(input)).ok();
        let line = [&["simplify", input, "-o", output, "--lod", "64,32,16"], &more[..]].concat();
        assert_misuse(&photofit(d, &line), &format!("{line:?}"), &["must be another file"]);
    }
    assert!(!d.join("out.glb").exists());
}

#[test]
fn sizes_and_budgets_are_checked() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 4, false);
    for (more, status, part) in [
        (&["--lod", "32,64"][..], 2, "--lod is [32, 64]; sizes must fall"),
        (
            &["--lod", "64,32", "--lod-triangles", "10"],
            2,
            "--lod-triangles is [10]; there must be one for each of 2 levels",
        ),
        (&["--lod", "64,32", "--lod-triangles", "10,20"], 2, "budgets must fall"),
        (&["--lod", "64", "--lod-triangles", "100000"], 1, "--lod-triangles is 100000; it must be 1 to 320"),
        (&["--lod", "64,8"], 2, "16 to 1024"),
        (&["--lod", "64", "--ratio", "0.1"], 2, "cannot be used with"),
        (&["--msft-lod"], 2, "--lod"),
        (&["--continuous"], 2, "--lod"),
        (
            &["--continuous", "--lod", "64"],
            2,
            "--continuous blends each level into the next; it needs two levels at least",
        ),
        (
            &["--continuous", "--lod", "64,32", "--max-bytes", "90000"],
            2,
            "--continuous adds morph targets to a level once the next one is there, and --max-bytes",
        ),
    ] {
        let o = photofit(d, &[&["simplify", "rock.glb", "-o", "out.glb"], more].concat());
        assert_eq!(o.status.code(), Some(status), "{more:?}: {}", stderr(&o));
        assert!(stderr(&o).contains(part), "{more:?}: {}", stderr(&o));
    }
}

#[test]
fn small_budgets_are_told_and_an_older_summary_stays_until_a_level_is_written() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 4, true);
    std::fs::write(d.join("out.lods.json"), "of an older chain").unwrap();
    let line = ["simplify", "rock.glb", "-o", "out.glb", "--lod", "24,16", "--batch", "1", "--steps", "1"];
    // A checkpoint that is a folder ends it before anything is written.
    std::fs::create_dir_all(d.join("c/fit.ckpt")).unwrap();
    let o = photofit(d, &[&line[..], &["--checkpoint", "c", "--resume"]].concat());
    assert_eq!(o.status.code(), Some(1), "{}", stderr(&o));
    assert_eq!(std::fs::read(d.join("out.lods.json")).unwrap(), b"of an older chain");
    assert!(!d.join("out.glb").exists());
    let o = succeeds(d, &[&line[..], &["--lod-triangles", "100,5"]].concat());
    let told: Vec<String> =
        stderr(&o).lines().filter(|l| l.starts_with("warning")).map(str::to_owned).collect();
    assert_eq!(told.len(), 1, "{told:?}");
    assert!(told[0].contains("level 2 of 2: a budget of 5 triangles is hardly a shape"), "{told:?}");
    assert_eq!(read_json(&d.join("out.lods.json"))["levels"].as_array().unwrap().len(), 2);
}

#[cfg(unix)]
#[test]
fn ctrl_c_keeps_the_levels_that_were_reached() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 10, true);
    let more = ["--steps", "100000", "--checkpoint", "c"];
    let child =
        command(d, &chain("out.glb", &more)).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let start = Instant::now();
    while !d.join("c/fit.ckpt").exists() {
        assert!(start.elapsed() < Duration::from_secs(60), "no checkpoint");
        std::thread::sleep(Duration::from_millis(5));
    }
    let sent = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
    let o = child.wait_with_output().unwrap();
    assert_eq!(o.status.code(), Some(3), "{}", stderr(&o));
    let summary = read_json(&d.join("out.lods.json"));
    assert_eq!(summary["stopped"], true);
    assert_eq!(summary["levels"].as_array().unwrap().len(), 1, "{summary}");
    assert!(!d.join("out.lod1.glb").exists());
}

/// The files of the textures in a `.glb`.
fn textures(file: &Path) -> Vec<Vec<u8>> {
    let bytes = std::fs::read(file).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let json: Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    let binary = &bytes[20 + length + 8..];
    let view = |image: &Value| {
        let view = &json["bufferViews"][image["bufferView"].as_u64().unwrap() as usize];
        let at = view["byteOffset"].as_u64().unwrap_or(0) as usize;
        binary[at..at + view["byteLength"].as_u64().unwrap() as usize].to_vec()
    };
    json["images"].as_array().unwrap().iter().map(view).collect()
}

#[test]
fn the_combined_file_holds_the_textures_of_the_levels_byte_for_byte() {
    for format in ["jpeg", "webp", "ktx2", "png"] {
        let dir = tempfile::tempdir().unwrap();
        let d = dir.path();
        write_rock(d, 8, true);
        let line = ["simplify", "rock.glb", "-o", "out.glb", "--lod", "32,16", "--lod-triangles", "200,60"];
        let more = ["--steps", "1", "--batch", "1", "--msft-lod", "--textures", format];
        succeeds(d, &[&line[..], &more].concat());
        let levels: Vec<Vec<u8>> =
            ["out.glb", "out.lod1.glb"].iter().flat_map(|f| textures(&d.join(f))).collect();
        assert!(levels.len() >= 2);
        assert!(textures(&d.join("out.lods.glb")) == levels, "{format}");
        photofit_scene::load(d.join("out.lods.glb")).unwrap();
    }
}
