//! Help and wrong command lines.

use crate::support::{names, photofit, read_json, stderr, stdout, succeeds, write_rock};

#[test]
fn help_lists_commands_and_options() {
    let dir = tempfile::tempdir().unwrap();
    let help = stdout(&succeeds(dir.path(), &["--help"]));
    for name in ["simplify", "render", "compare", "inspect", "denoise", "demo"] {
        assert!(help.contains(name), "{name}");
    }
    let help = stdout(&succeeds(dir.path(), &["simplify", "--help"]));
    for option in [
        "--triangles",
        "--ratio",
        "--error",
        "--screen-size",
        "--init",
        "--resolution",
        "--batch",
        "--steps",
        "--time-limit",
        "--texture-size",
        "--device",
        "--light",
        "--env",
        "--seed",
        "--threads",
        "--checkpoint",
        "--resume",
        "--report",
        "--explain",
        "--json",
        "--output",
    ] {
        assert!(help.contains(option), "{option}");
    }
    assert!(stdout(&succeeds(dir.path(), &["--version"])).starts_with("photofit "));
    for command in [
        &[][..],
        &["simplify"],
        &["render"],
        &["compare"],
        &["inspect"],
        &["surface"],
        &["denoise"],
        &["recover"],
        &["recover", "texture"],
        &["recover", "mesh"],
        &["recover", "scene"],
        &["recover", "material"],
        &["recover", "volume"],
        &["retexture"],
        &["gradient"],
        &["demo"],
    ] {
        let help = stdout(&succeeds(dir.path(), &[command, &["--help"]].concat()));
        assert!(help.contains("Exit status:") && help.contains("130"), "{command:?}");
    }
}

#[test]
fn values_out_of_range_are_told_with_the_range() {
    let dir = tempfile::tempdir().unwrap();
    for (option, value, rule) in [
        ("--triangles", "0", "at least 1"),
        ("--ratio", "0", "more than 0, at most 1"),
        ("--ratio", "2", "more than 0, at most 1"),
        ("--ratio", "nan", "more than 0, at most 1"),
        ("--error", "0", "more than 0, less than 1"),
        ("--screen-size", "0", "1 to 65536"),
        ("--resolution", "100000", "16 to 4096"),
        ("--batch", "0", "1 to 64"),
        ("--texture-size", "1000000", "16 to 8192"),
        ("--jpeg", "101", "1 to 100"),
        ("--threads", "0", "1 to 1024"),
        ("--time-limit", "0", "more than 0"),
        ("--time-limit", "-1", "more than 0"),
        ("--triangles", "-3", "at least 1"),
        ("--ratio", "-0.5", "more than 0, at most 1"),
        ("--seed", "-1", "at least 0"),
        ("--seed", "18446744073709551616", "at most 18446744073709551615"),
    ] {
        let o = photofit(dir.path(), &["simplify", "rock.glb", "-o", "out.glb", option, value]);
        let text = stderr(&o);
        assert_eq!(o.status.code(), Some(2), "{option} {value}: {text}");
        assert!(text.contains(&format!("invalid value '{value}' for '{option}")), "what it is: {text}");
        assert!(text.contains("it must be") && text.contains(rule), "what it must be: {text}");
    }
}

#[test]
fn wrong_command_lines_have_status_2() {
    let dir = tempfile::tempdir().unwrap();
    let cases: &[&[&str]] = &[
        &[],
        &["polish", "a.glb"],
        &["simplify", "a.glb"],
        &["simplify", "-o", "b.glb"],
        &["simplify", "a.glb", "-o", "b.glb", "--triangles", "many"],
        &["simplify", "a.glb", "-o", "b.glb", "--triangles", "-3"],
        &["simplify", "a.glb", "-o", "b.glb", "--triangles", "10", "--ratio", "0.1"],
        &["simplify", "a.glb", "-o", "b.glb", "--init", "cube"],
        &["simplify", "a.glb", "-o", "b.glb", "--light", "env"],
        &["simplify", "a.glb", "-o", "b.glb", "--threads", "0"],
        &["simplify", "a.glb", "-o", "b.glb", "--time-limit", "-1"],
        &["simplify", "a.glb", "-o", "b.glb", "--time-limit", "nan"],
        &["simplify", "a.glb", "-o", "b.glb", "--resume"],
        &["simplify", "a.glb", "-o", "b.glb", "--faster"],
        &["simplify", "a.glb", "-o", "b.glb", "--fit-with", "path"],
        &["render", "a.glb", "-o", "b.png", "--spp", "5"],
        &["render", "a.glb", "-o", "b.png", "--width", "0"],
        &["render", "a.glb", "-o", "b.jpg"],
        &["render", "a.glb", "-o", "b.png", "--seed", "1"],
        &["render", "a.glb", "-o", "b.png", "--camera", "0", "--distance", "3"],
        &["simplify", "a.glb", "-o", "b.glb", "--screen-size", "64", "--resolution", "64"],
        &["render", "a.glb", "-o", "b.png", "--max-depth", "2"],
        &["render", "a.glb", "-o", "b.png", "--save-every", "2"],
        &["simplify", "a.glb", "-o", "b.gltf"],
        &["simplify", "a.glb", "-o", "b"],
        &["compare", "a.glb", "b.glb", "--heatmap", "h.exr"],
        &["denoise", "a.exr", "-o", "b.jpg"],
        &["render", "a.glb", "-o", "b.png", "--light", "env"],
        &["compare", "a.png"],
        &["inspect"],
        &["demo", "extra"],
    ];
    for case in cases {
        let o = photofit(dir.path(), case);
        assert_eq!(o.status.code(), Some(2), "{case:?}: {}", stderr(&o));
        assert!(!stderr(&o).contains("panicked"), "{case:?}");
        assert!(!stderr(&o).is_empty(), "{case:?} explains itself");
    }
    assert!(names(dir.path()).is_empty());
}

#[test]
fn devices_that_are_not_there_are_wrong_command_lines() {
    let dir = tempfile::tempdir().unwrap();
    write_rock(dir.path(), 4, false);
    for device in ["cuda", "gpu:", "GPU"] {
        let o = photofit(dir.path(), &["simplify", "rock.glb", "-o", "a.glb", "--device", device]);
        assert_eq!(o.status.code(), Some(2), "{device}");
        assert!(stderr(&o).contains("auto, cpu, gpu or gpu:NAME"), "{}", stderr(&o));
    }
    let o = photofit(dir.path(), &["simplify", "rock.glb", "-o", "a.glb", "--device", "gpu:no such GPU"]);
    assert_eq!(o.status.code(), Some(2));
    for part in ["--device gpu:no such GPU", "no GPU adapter", "found: "] {
        assert!(stderr(&o).contains(part), "{part:?} in {}", stderr(&o));
    }
    assert!(!dir.path().join("a.glb").exists());
    // One line, whatever drivers write; on a machine that has a GPU the fit runs there.
    let line = ["simplify", "rock.glb", "-o", "a.glb", "--steps", "0", "--device", "gpu"];
    let o = photofit(dir.path(), &line);
    let refused =
        stderr(&o).lines().count() == 1 && stderr(&o).starts_with("error: --device gpu: no GPU adapter");
    assert!(refused || o.status.success() && dir.path().join("a.glb").exists(), "{}", stderr(&o));
}

#[test]
fn devices_are_listed_and_an_asset_is_still_needed_otherwise() {
    let dir = tempfile::tempdir().unwrap();
    let listed = stdout(&succeeds(dir.path(), &["inspect", "--devices", "--json", "d.json"]));
    let json = read_json(&dir.path().join("d.json"));
    let devices = json["devices"].as_array().unwrap();
    for d in devices {
        assert!(listed.contains(d["name"].as_str().unwrap()) && listed.contains("lacks"), "{listed}");
    }
    assert!(!devices.is_empty() || listed.contains("no GPU adapter"), "{listed}");
    for wrong in [&["inspect"][..], &["inspect", "rock.glb", "--devices"]] {
        assert_eq!(photofit(dir.path(), wrong).status.code(), Some(2), "{wrong:?}");
    }
}

#[test]
fn the_plan_tells_where_a_fit_ran() {
    let dir = tempfile::tempdir().unwrap();
    write_rock(dir.path(), 4, false);
    let line = "simplify rock.glb -o a.glb --ratio 0.5 --steps 1 --resolution 16 --texture-size 16 --explain";
    let line: Vec<&str> = line.split(' ').chain(["--device", "cpu", "--json", "a.json"]).collect();
    let text = stdout(&succeeds(dir.path(), &line));
    assert!(text.contains("CPU: as --device says"), "{text}");
    let json = read_json(&dir.path().join("a.json"));
    assert_eq!(json["device"], "CPU");
}

#[test]
fn options_that_do_not_go_together_show_the_usage_of_their_command() {
    let dir = tempfile::tempdir().unwrap();
    for (line, rule, usage) in [
        (
            &["render", "a.glb", "-o", "b.png", "--seed", "1"][..],
            "--seed needs --integrator path",
            "photofit render ",
        ),
        (
            &["simplify", "a.glb", "-o", "b.glb", "--env", "sky.hdr", "--light", "point"],
            "--env needs --light env; --light point lights by no map",
            "photofit simplify ",
        ),
        (
            &["retexture", "a.glb", "c.glb", "-o", "b.glb", "--env", "sky.hdr", "--light", "mixed"],
            "--env needs --light env; --light mixed lights by no map",
            "photofit retexture ",
        ),
        (
            &["render", "a.glb", "-o", "b.png", "--env", "sky.hdr", "--light", "headlight"],
            "--env needs --light env",
            "photofit render ",
        ),
        (
            &["render", "a.xml", "-o", "b.png", "--azimuth", "30"],
            "--azimuth does not go with an .xml",
            "render",
        ),
        (
            &["render", "a.xml", "-o", "b.png", "--elevation", "-5"],
            "--elevation does not go with an .xml",
            "photofit render ",
        ),
        (
            &["render", "a.glb", "-o", "b.png", "--camera", "0", "--azimuth", "30"],
            "--azimuth does not go with --camera",
            "photofit render ",
        ),
        (
            &["render", "a.glb", "-o", "b.exr", "--integrator", "path", "--exposure", "1"],
            "--exposure is for a display; it needs a .png",
            "photofit render ",
        ),
        (
            &["render", "a.xml", "-o", "b.EXR", "--tone-map"],
            "--tone-map is for a display; it needs a .png",
            "photofit render ",
        ),
        (
            &["compare", "a.png", "b.png", "--views", "3"],
            "--views belongs to two assets",
            "photofit compare ",
        ),
        (
            &["compare", "a.exr", "b.exr", "--resolution", "64"],
            "--resolution belongs to two assets",
            "photofit compare ",
        ),
        (
            &["recover", "mesh", "pictures", "-o", "b.glb", "--views", "9"],
            "'[PICTURES]' cannot be used with '--views",
            "photofit recover mesh ",
        ),
        (
            &["recover", "mesh", "pictures", "-o", "b.glb", "--picture-size", "64"],
            "'[PICTURES]' cannot be used with '--picture-size",
            "photofit recover mesh ",
        ),
        (
            &["recover", "material", "pictures", "--mesh", "a.glb", "-o", "b", "--views", "3"],
            "'[PICTURES]' cannot be used with '--views",
            "photofit recover material ",
        ),
        (
            &["recover", "volume", "pictures", "-o", "b", "--views", "3"],
            "'[PICTURES]' cannot be used with '--views",
            "photofit recover volume ",
        ),
        (
            &["recover", "volume", "pictures", "-o", "b", "--resolution", "64"],
            "'[PICTURES]' cannot be used with '--resolution",
            "photofit recover volume ",
        ),
        (
            &["simplify", "a.glb", "-o", "b.glb", "--textures", "none", "--keep-uvs"],
            "--keep-uvs keeps textures and --textures none has none; leave one of them out",
            "photofit simplify ",
        ),
        (
            &["simplify", "a.glb", "-o", "b.glb", "--textures", "none", "--texture-quality", "90"],
            "--textures none has no quality; leave one of them out",
            "photofit simplify ",
        ),
        (
            &["simplify", "a.glb", "-o", "b.glb", "--textures", "png", "--jpeg", "90"],
            "png and webp are exact: a quality belongs to --textures jpeg, webp-lossy or ktx2",
            "photofit simplify ",
        ),
    ] {
        let o = photofit(dir.path(), line);
        assert_eq!(o.status.code(), Some(2), "{line:?}");
        assert!(stderr(&o).contains(rule) && stderr(&o).contains(usage), "{}", stderr(&o));
    }
}

#[test]
fn options_of_denoise_belong_to_the_model() {
    let dir = tempfile::tempdir().unwrap();
    for (more, rule) in [
        (&["--without", "edges,detail", "--without", "edges"][..], "--without names edges twice"),
        (
            &["--without", "coherence"],
            "--without coherence: --model auto has no such stage; it has albedo, normal, position, variance, noiseless",
        ),
        (
            &["--model", "hybrid", "--without", "albedo,detail"],
            "--without detail: --model hybrid has no such stage",
        ),
        (&["--keep-darkening"], "--keep-darkening needs --model rof"),
    ] {
        let o = photofit(dir.path(), &[&["denoise", "a.exr", "-o", "b.exr"], more].concat());
        assert_eq!(o.status.code(), Some(2), "{more:?}");
        assert!(stderr(&o).contains(rule) && stderr(&o).contains("photofit denoise "), "{}", stderr(&o));
    }
}

#[test]
fn free_mip_levels_are_refused_where_files_do_not_hold_them() {
    let dir = tempfile::tempdir().unwrap();
    write_rock(dir.path(), 4, false);
    for (more, rule) in [
        (&[][..], "--mips is free; it needs ktx2 textures: PNG, JPEG and WebP hold no mip levels"),
        (&["--textures", "webp"], "--mips is free; it needs ktx2 textures"),
        (&["--textures", "ktx2", "--keep-uvs"], "--mips is free; it needs new maps"),
    ] {
        let o = photofit(
            dir.path(),
            &[&["simplify", "rock.glb", "-o", "b.glb", "--mips", "free"], more].concat(),
        );
        assert_eq!(o.status.code(), Some(2), "{more:?}");
        assert!(stderr(&o).contains(rule), "{}", stderr(&o));
    }
    assert_eq!(names(dir.path()), ["rock.glb"], "nothing is written");
}
