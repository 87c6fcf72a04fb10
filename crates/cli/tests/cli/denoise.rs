//! `denoise`: layers, sequences, figures, refusals.

use crate::support::{
    assert_misuse, assert_one_error, names, photofit, read_json, stderr, stdout, succeeds, write_rock,
};
use photofit_denoise::mc::synthetic::SyntheticFrame;
use photofit_image::{Image, read, rmse, srgb_decode, write_exr, write_png};
use serde_json::{Value, json};
use std::path::Path;

const ROWS: usize = 72;
const COLS: usize = 96;

fn image(planes: &[f32]) -> Image {
    let n = ROWS * COLS;
    let channels = planes.len() / n;
    Image::from_data(
        COLS,
        ROWS,
        channels,
        (0..planes.len()).map(|i| planes[i % channels * n + i / channels]).collect(),
    )
}

fn write(path: &Path, layers: &[(&str, &[f32], &[&str])]) {
    let images: Vec<Image> = layers.iter().map(|(_, p, _)| image(p)).collect();
    let list: Vec<(&str, &Image, &[&str])> =
        layers.iter().zip(&images).map(|((name, _, channels), image)| (*name, image, *channels)).collect();
    write_exr(path, &list).unwrap();
}

const RGB: &[&str] = &["R", "G", "B"];
const XYZ: &[&str] = &["X", "Y", "Z"];

#[test]
fn layers_of_one_file_are_found_and_figures_written() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let f = SyntheticFrame::new(COLS, ROWS, 0.0);
    let noisy = f.noisy(1, 1);
    write(&d.join("ref.exr"), &[("", &f.reference, RGB)]);
    write(
        &d.join("all.exr"),
        &[
            ("color", &noisy, RGB),
            ("albedo", &f.albedo, RGB),
            ("depth", &f.depth, &["Z"]),
            ("normal", &f.normal, XYZ),
            ("position", &f.position, XYZ),
        ],
    );
    let run = |more: &[&str]| {
        let o = succeeds(
            d,
            &[&["denoise", "all.exr", "--compare", "ref.exr", "--json", "a.json"][..], more].concat(),
        );
        (stdout(&o), read_json(&d.join("a.json")))
    };
    let (text, auto) = run(&["-o", "out.exr", "--explain"]);
    for word in ["normal", "skipped", "regression", "denoised", "out.exr", "layer albedo"] {
        assert!(text.contains(word), "{word} in {text}");
    }
    let figure = |j: &Value, name: &str| j[name].as_f64().unwrap();
    assert!(figure(&auto, "psnr") > figure(&auto["noisy"], "psnr") + 10.0, "{auto}");
    assert!(figure(&auto, "ssim") > 0.8 && figure(&auto, "flip") < figure(&auto["noisy"], "flip"));
    assert!(figure(&auto, "seconds") > 0.0 && figure(&auto, "rmse") > 0.0);
    assert_eq!(auto["layers"]["depth"], json!("all.exr, layer depth"));
    let step =
        |name: &str| auto["plan"].as_array().unwrap().iter().find(|s| s["name"] == name).unwrap().clone();
    assert_eq!(
        (step("albedo")["runs"].clone(), step("history")["runs"].clone()),
        (json!(true), json!(false))
    );
    assert!(step("regression")["seconds"].as_f64().unwrap() > 0.0);
    let out = read(d.join("out.exr")).unwrap();
    assert_eq!((out.width, out.height, out.channels), (COLS, ROWS, 3));
    for model in ["rof", "tvl1", "hybrid", "tgv", "atrous"] {
        let (_, j) = run(&["-o", "m.png", "--model", model]);
        assert_eq!(j["model"], json!(model));
        assert!(figure(&j, "psnr") > figure(&j["noisy"], "psnr") + 2.0, "{model}: {j}");
    }
    // The same from single files, and without guides worse.
    for (name, planes, channels) in
        [("albedo", &f.albedo, RGB), ("normal", &f.normal, XYZ), ("position", &f.position, XYZ)]
    {
        write(&d.join(format!("{name}.exr")), &[("", planes, channels)]);
    }
    write(&d.join("color.exr"), &[("", &noisy, RGB)]);
    let single = ["denoise", "color.exr", "-o", "s.exr", "--compare", "ref.exr", "--json", "s.json"];
    succeeds(
        d,
        &[&single[..], &["--albedo", "albedo.exr", "--normal", "normal.exr", "--position", "position.exr"]]
            .concat(),
    );
    let guided = figure(&read_json(&d.join("s.json")), "psnr");
    assert!((guided - figure(&auto, "psnr")).abs() < 1e-6, "the depth adds nothing to the position");
    succeeds(d, &single);
    assert!(figure(&read_json(&d.join("s.json")), "psnr") < guided - 1.0);
}

#[test]
fn pngs_are_decoded_and_alpha_is_kept() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let f = SyntheticFrame::new(COLS, ROWS, 0.0);
    write_png(d.join("color.png"), &image(&f.noisy(4, 1))).unwrap();
    write_png(d.join("albedo.png"), &image(&f.albedo)).unwrap();
    // The bytes hold (n + 1) / 2 as it is.
    write_png(d.join("normal.png"), &image(&f.normal).map(|v| srgb_decode(0.5 * v + 0.5))).unwrap();
    let o = [
        "denoise",
        "color.png",
        "-o",
        "out.png",
        "--albedo",
        "albedo.png",
        "--normal",
        "normal.png",
        "--explain",
    ];
    let text = stdout(&succeeds(d, &o));
    assert!(text.contains("regressors") && text.contains("normal, pixel"), "{text}");
    let shown = read(d.join("out.png")).unwrap();
    assert_eq!((shown.width, shown.channels), (COLS, 3));
    succeeds(d, &[&o[..3], &["out.exr"], &o[4..]].concat());
    let linear = read(d.join("out.exr")).unwrap().map(|v| v.clamp(0.0, 1.0));
    assert!(rmse(&shown, &linear) < 0.005, "a .png holds the light of the .exr: {}", rmse(&shown, &linear));
    let rgba: Vec<f32> =
        f.noisy(1, 2).into_iter().chain((0..ROWS * COLS).map(|i| (i % 3) as f32 / 2.0)).collect();
    write(&d.join("rgba.exr"), &[("", &rgba, &["R", "G", "B", "A"])]);
    succeeds(d, &["denoise", "rgba.exr", "-o", "out.exr"]);
    let out = read(d.join("out.exr")).unwrap();
    assert_eq!((out.channels, out.pixel(2, 0)[3], out.pixel(1, 0)[3]), (4, 1.0, 0.5));
}

#[test]
fn sequences_and_halves_lower_the_error() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let mut frames = Vec::new();
    let mut last = None;
    for k in 0..4 {
        let f = SyntheticFrame::new(COLS, ROWS, 0.02 * f64::from(k));
        let noisy = f.noisy(1, 10 + k as u64);
        write(
            &d.join(format!("room_{k:03}.exr")),
            &[
                ("color", &noisy, RGB),
                ("albedo", &f.albedo, RGB),
                ("depth", &f.depth, &["Z"]),
                ("normal", &f.normal, XYZ),
            ],
        );
        frames.push(json!({ "frame": k, "world_to_pixel": f.camera.world_to_pixel }));
        last = Some(f);
    }
    let f = last.unwrap();
    write(&d.join("ref.exr"), &[("", &f.reference, RGB)]);
    std::fs::write(d.join("cameras.json"), json!({ "frames": frames }).to_string()).unwrap();
    let psnr = |more: &[&str]| {
        let o = ["denoise", "room_003.exr", "-o", "o.exr", "--compare", "ref.exr", "--json", "o.json"];
        succeeds(d, &[&o[..], more].concat());
        read_json(&d.join("o.json"))["psnr"].as_f64().unwrap()
    };
    let one = psnr(&[]);
    let four = psnr(&["--sequence", "cameras.json"]);
    // Since detail comes back within a frame, those before it bring less than half a decibel here.
    assert!(four > one + 0.25, "{four} dB of four frames, {one} of one");
    write(&d.join("b.exr"), &[("", &f.noisy(1, 99), RGB)]);
    let halves = psnr(&["--half", "b.exr"]);
    assert!(halves > one + 0.2, "{halves} dB of two halves, {one} of one");
    // The same depths measured along the axis give the same picture.
    for k in 0..4 {
        let f = SyntheticFrame::new(COLS, ROWS, 0.02 * f64::from(k));
        let n = ROWS * COLS;
        // The camera looks down -z from z = 0.
        let axial: Vec<f32> = (0..n).map(|i| -f.position[2 * n + i]).collect();
        write(
            &d.join(format!("room_{k:03}.exr")),
            &[
                ("color", &f.noisy(1, 10 + k as u64), RGB),
                ("albedo", &f.albedo, RGB),
                ("depth", &axial, &["Z"]),
                ("normal", &f.normal, XYZ),
            ],
        );
    }
    std::fs::write(d.join("axial.json"), json!({ "frames": frames, "depth": "axis" }).to_string()).unwrap();
    let axial = psnr(&["--sequence", "axial.json"]);
    assert!((axial - four).abs() < 0.05, "{axial} and {four} dB");
    // What does not fit is named.
    let refused = |more: &[&str], parts: &[&str]| {
        let o = photofit(d, &[&["denoise", "room_003.exr", "-o", "p.exr"][..], more].concat());
        assert_one_error(&o, &more.join(" "), parts);
    };
    std::fs::write(
        d.join("few.json"),
        json!({ "frames": [{ "frame": 9, "world_to_pixel": f.camera.world_to_pixel }] }).to_string(),
    )
    .unwrap();
    refused(&["--sequence", "few.json"], &["few.json", "room_003.exr", "no frame"]);
    std::fs::write(d.join("bad.json"), r#"{"frames":[{"frame":3,"world_to_pixel":[[1,2,3,4]]}]}"#).unwrap();
    refused(
        &["--sequence", "bad.json"],
        &["bad.json", "frame 3", "world_to_pixel is an array of 1; it must be three rows of four"],
    );
    std::fs::write(d.join("none.json"), "{}").unwrap();
    refused(
        &["--sequence", "none.json"],
        &["none.json", "has neither `frames` nor `scenes`; it must have one"],
    );
    refused(&["--sequence", "missing.json"], &["missing.json"]);
    write(&d.join("plain_003.exr"), &[("", &f.noisy(1, 7), RGB)]);
    let only = json!({ "frames": [frames[3]] }).to_string();
    std::fs::write(d.join("only.json"), only).unwrap();
    let o = photofit(d, &["denoise", "plain_003.exr", "-o", "p.exr", "--sequence", "only.json"]);
    assert_one_error(&o, "colour alone", &["plain_003.exr", "has neither positions nor depths"]);
    std::fs::write(d.join("odd.json"), json!({ "frames": frames, "depth": "inverse" }).to_string()).unwrap();
    refused(
        &["--sequence", "odd.json"],
        &["odd.json", "`depth` is the text \"inverse\"; it must be \"distance\""],
    );
    // Without depths and positions there is no history.
    let noisy = f.noisy(1, 13);
    for k in 0..4 {
        write(&d.join(format!("bare_{k}.exr")), &[("", &noisy, RGB)]);
    }
    let o = photofit(d, &["denoise", "bare_3.exr", "-o", "p.exr", "--sequence", "cameras.json"]);
    assert_one_error(&o, "no positions", &["bare_0.exr", "positions"]);
    let both = ["denoise", "room_003.exr", "-o", "p.exr", "--sequence", "cameras.json", "--half", "b.exr"];
    assert_misuse(&photofit(d, &both), "both", &["--half", "one of them"]);
    // An earlier frame of the sequence is an input too.
    let over = ["denoise", "room_003.exr", "-o", "room_001.exr", "--sequence", "cameras.json"];
    let before = std::fs::read(d.join("room_001.exr")).unwrap();
    assert_misuse(&photofit(d, &over), "over a frame", &["room_001.exr", "--output", "--sequence"]);
    assert!(std::fs::read(d.join("room_001.exr")).unwrap() == before);
    std::fs::remove_file(d.join("room_001.exr")).unwrap();
    refused(&["--sequence", "cameras.json"], &["room_001.exr", "missing", "frame 1"]);
    assert!(!names(d).contains(&"p.exr".to_owned()));
}

#[test]
fn own_renders_are_denoised_from_one_file() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 12, true);
    let render = |out: &str, spp: &str, more: &[&str]| {
        let o = [
            "render",
            "rock.glb",
            "--integrator",
            "path",
            "--width",
            "96",
            "--height",
            "72",
            "-o",
            out,
            "--spp",
            spp,
        ];
        succeeds(d, &[&o[..], more].concat());
    };
    render("ref.exr", "256", &["--seed", "9"]);
    for spp in ["1", "4"] {
        render("noisy.exr", spp, &["--aov", "all"]);
        let o = [
            "denoise",
            "noisy.exr",
            "-o",
            "clean.exr",
            "--compare",
            "ref.exr",
            "--json",
            "a.json",
            "--explain",
        ];
        let text = stdout(&succeeds(d, &o));
        for layer in ["albedo", "normal", "depth", "position", "variance"] {
            assert!(text.contains(&format!("{layer} from noisy.exr, layer {layer}")), "{layer}: {text}");
        }
        let j = read_json(&d.join("a.json"));
        let (noisy, clean) = (j["noisy"]["psnr"].as_f64().unwrap(), j["psnr"].as_f64().unwrap());
        assert!(
            clean > noisy + if spp == "1" { 1.0 } else { -1.0 },
            "{spp} samples: {clean} dB from {noisy}: {text}"
        );
        let (before, after) = (read(d.join("noisy.exr")).unwrap(), read(d.join("clean.exr")).unwrap());
        assert_eq!(before.select(&[3]).data, after.select(&[3]).data, "alpha is kept");
    }
}

#[test]
fn bad_input_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let f = SyntheticFrame::new(COLS, ROWS, 0.0);
    let mut noisy = f.noisy(1, 1);
    noisy[5] = f32::NAN;
    noisy[ROWS * COLS + 77] = f32::INFINITY;
    write(&d.join("c.exr"), &[("", &noisy, RGB)]);
    write(&d.join("guides.exr"), &[("albedo", &f.albedo, RGB), ("normal", &f.normal, XYZ)]);
    write(&d.join("depth.exr"), &[("depth", &f.depth, &["Z"])]);
    write_exr(d.join("small.exr"), &[("", &Image::new(5, 4, 3), RGB)]).unwrap();
    let good = std::fs::read(d.join("c.exr")).unwrap();
    std::fs::write(d.join("cut.exr"), &good[..good.len() / 2]).unwrap();
    std::fs::write(d.join("text.exr"), b"no picture").unwrap();
    std::fs::write(d.join("empty.exr"), b"").unwrap();
    std::fs::write(d.join("empty.png"), b"").unwrap();
    let refused = |arguments: &[&str], parts: &[&str]| {
        assert_one_error(&photofit(d, &[&["denoise"][..], arguments].concat()), &arguments.join(" "), parts);
    };
    refused(&["missing.exr", "-o", "o.exr"], &["missing.exr"]);
    refused(&["cut.exr", "-o", "o.exr"], &["cut.exr"]);
    refused(&["text.exr", "-o", "o.exr"], &["text.exr"]);
    refused(&["empty.exr", "-o", "o.exr"], &["empty.exr"]);
    refused(&["empty.png", "-o", "o.exr"], &["empty.png"]);
    refused(&["c.exr", "-o", "o.exr", "--albedo", "missing.png"], &["missing.png"]);
    for wrong in [
        &["denoise", "c.exr"][..],
        &["denoise", "-o", "o.exr"],
        &["denoise", "c.exr", "-o", "o.exr", "--model", "best"],
    ] {
        assert_eq!(photofit(d, wrong).status.code(), Some(2), "{wrong:?}");
    }
    refused(&["guides.exr", "-o", "o.exr"], &["guides.exr", "no layer with a colour", "albedo: R G B"]);
    refused(&["depth.exr", "-o", "o.exr"], &["depth.exr", "no layer with a colour"]);
    refused(&["c.exr", "-o", "o.exr", "--albedo", "small.exr"], &["small.exr", "5 x 4", "96 x 72"]);
    refused(&["c.exr", "-o", "o.exr", "--half", "small.exr"], &["small.exr", "5 x 4"]);
    std::fs::copy(d.join("c.exr"), d.join("same.exr")).unwrap();
    let same = photofit(d, &["denoise", "c.exr", "-o", "o.exr", "--half", "same.exr"]);
    assert_misuse(&same, "the picture itself", &["same.exr", "--half", "samples of its own"]);
    refused(&["c.exr", "-o", "o.exr", "--compare", "small.exr"], &["small.exr", "5 x 4"]);
    refused(&["c.exr", "-o", "o.exr", "--normal", "depth.exr"], &["depth.exr", "normal", "depth: Z"]);
    refused(&["c.exr", "-o", "no/o.exr"], &["does not exist"]);
    refused(&["c.exr", "-o", "o.exr", "--sequence", "c.exr"], &["c.exr", "is no JSON"]);
    assert!(!names(d).iter().any(|n| n.starts_with("o.")), "nothing was written");
    // Holes are no error: they are filled and counted.
    let text = stdout(&succeeds(d, &["denoise", "c.exr", "-o", "o.exr", "--json", "o.json"]));
    assert!(text.contains("2 pixels with NaN or infinity"), "{text}");
    assert_eq!(read_json(&d.join("o.json"))["holes"], json!(2));
    assert!(read(d.join("o.exr")).unwrap().is_finite());
}

#[test]
fn a_device_gives_what_the_cpu_gives_or_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let scene = SyntheticFrame::new(COLS, ROWS, 0.0);
    write(&d.join("c.exr"), &[("", &scene.noisy(4, 1), RGB)]);
    let none = ["denoise", "c.exr", "-o", "o.exr", "--model", "hybrid", "--device", "gpu:no such GPU"];
    assert_misuse(&photofit(d, &none), "no such GPU", &["--device gpu:no such GPU"]);
    // A GPU that is asked for has kernels for the model, whether there is one or not.
    for (model, device) in
        [("auto", "gpu"), ("tgv", "gpu"), ("atrous", "gpu:llvmpipe"), ("auto", "gpu:llvmpipe")]
    {
        let line = ["denoise", "c.exr", "-o", "o.exr", "--model", model, "--device", device];
        let o = photofit(d, &line);
        assert_eq!(o.status.code(), Some(2), "{model}, {device}");
        let rule =
            format!("--device {device} needs --model hybrid, rof or tvl1: there are no kernels for {model}");
        assert!(stderr(&o).contains(&rule) && stderr(&o).contains("--device auto"), "{}", stderr(&o));
    }
    assert!(!names(d).contains(&"o.exr".to_owned()), "nothing was written");
    let report = |model: &str, device: &str, out: &str| {
        let o = ["denoise", "c.exr", "-o", out, "--model", model, "--device", device, "--json", "o.json"];
        let text = stdout(&succeeds(d, &o));
        (
            text,
            read_json(&d.join("o.json"))["device"].as_str().unwrap().to_owned(),
            read(d.join(out)).unwrap(),
        )
    };
    let (text, told, cpu) = report("hybrid", "cpu", "cpu.exr");
    assert!(!text.contains("device:") && told == "CPU: as --device says", "{text}{told}");
    // With any hardware or none.
    assert!(report("hybrid", "auto", "auto.exr").0.contains("device: "));
    let (text, told, auto) = report("auto", "auto", "auto.exr");
    let rule = "CPU: there are no kernels for the model auto";
    assert!(text.contains(&format!("device: {rule}")) && told == rule, "{text}{told}");
    assert_eq!(auto, report("auto", "cpu", "auto.exr").2);
    // In software where Mesa is there.
    let software = ["denoise", "c.exr", "-o", "o.exr", "--model", "hybrid", "--device", "gpu:llvmpipe"];
    let o = photofit(d, &software);
    if !o.status.success() {
        assert_misuse(&o, "no software driver", &["--device gpu:llvmpipe", "no GPU adapter"]);
        return;
    }
    let (text, told, gpu) = report("hybrid", "gpu:llvmpipe", "gpu.exr");
    assert!(text.contains("device: llvmpipe") && told.contains("one submission"), "{text}{told}");
    assert!(rmse(&cpu, &gpu) < 1e-5, "{}", rmse(&cpu, &gpu));
    // Trials of the strength, there as well.
    write(&d.join("h.exr"), &[("", &scene.noisy(4, 2), RGB)]);
    let halves = [&software[..], &["--half", "h.exr", "--explain"]].concat();
    let text = stdout(&succeeds(d, &halves));
    assert!(text.contains("10 trials of the strength") && text.contains("11 submissions"), "{text}");
    // What it cannot do.
    let row = Image::from_data(2050, 1, 3, (0..3 * 2050).map(|i| (i % 7) as f32).collect());
    write_exr(d.join("c.exr"), &[("", &row, RGB)]).unwrap();
    let o = photofit(d, &software);
    let parts = ["c.exr", "--model hybrid", "--device gpu:llvmpipe", "rows of 2050 pixels", "--device auto"];
    assert_one_error(&o, "too wide", &parts);
}
