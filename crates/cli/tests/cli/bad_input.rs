//! Broken files and impossible wishes: one line, status 1, nothing left behind.

use crate::support::{
    TRIANGLE, assert_one_error, command, glb, names, photofit, rock, succeeds, triangle_bin, triangle_json,
    write_rock,
};
use std::path::Path;

const NODE: &str = r#"[{"mesh":0}]"#;

/// A fit that would be quick if the asset were sound.
const QUICK: [&str; 10] =
    ["-o", "out.glb", "--ratio", "1", "--steps", "1", "--resolution", "16", "--texture-size", "16"];

fn simplify<'a>(input: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let mut all = vec!["simplify", input];
    all.extend(QUICK);
    all.extend(more);
    all
}

/// Every command that reads an asset refuses `file` with one line that holds `parts`.
fn refused(folder: &Path, file: &str, parts: &[&str]) {
    let before = names(folder);
    for arguments in [simplify(file, &["--json", "out.json"]), vec!["render", file, "-o", "out.png"]] {
        let o = photofit(folder, &arguments);
        assert_one_error(&o, &format!("{arguments:?}"), &[&[file], parts].concat());
        assert_eq!(names(folder), before, "{arguments:?} left something behind");
    }
}

#[test]
fn broken_glb_files() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let sound = photofit_scene::to_glb(&rock(3, true)).unwrap();
    let bin = triangle_bin(TRIANGLE, [0, 1, 2]);
    let json = triangle_json(NODE, "");
    let mut claims = glb(&json, &bin);
    claims[8..12].copy_from_slice(&u32::MAX.to_le_bytes());
    let mut chunk = glb(&json, &bin);
    chunk[12..16].copy_from_slice(&0xffff_fff0_u32.to_le_bytes());
    let nan = [[f32::NAN, 0.0, 0.0], TRIANGLE[1], TRIANGLE[2]];
    let cycle = r#"[{"mesh":0,"children":[1]},{"children":[0]}]"#;
    let sparse = json.replace(
        r#""count":3,"type":"VEC3""#,
        r#""count":3,"sparse":{"count":4000000000,"indices":{"bufferView":1,"componentType":5123},"values":{"bufferView":0}},"type":"VEC3""#,
    );
    let outside = json.replace(r#"{"byteLength":44}"#, r#"{"byteLength":44,"uri":"../secret.bin"}"#);
    let many = json.replace(r#""count":3,"type":"VEC3""#, r#""count":4000000000,"type":"VEC3""#);
    let cases: Vec<(&str, Vec<u8>, &[&str])> = vec![
        ("empty.glb", Vec::new(), &["empty"]),
        ("magic.glb", b"glTF".to_vec(), &[]),
        ("truncated.glb", sound[..sound.len() / 2].to_vec(), &[]),
        ("claims-4-GB.glb", claims, &[]),
        ("chunk-4-GB.glb", chunk, &[]),
        ("count.glb", glb(&many, &bin), &["4000000000"]),
        ("index.glb", glb(&json, &triangle_bin(TRIANGLE, [0, 1, 9])), &["9"]),
        ("nan.glb", glb(&json, &triangle_bin(nan, [0, 1, 2])), &["finite"]),
        ("flat.glb", glb(&json, &triangle_bin([TRIANGLE[0]; 3], [0, 1, 2])), &["area"]),
        ("cycle.glb", glb(&triangle_json(cycle, ""), &bin), &["node"]),
        ("sparse.glb", glb(&sparse, &bin), &["sparse"]),
        ("outside.glb", glb(&outside, &bin), &["folder"]),
        ("json.glb", glb("{\"asset\":", &bin), &[]),
        ("noise.bin", vec![0xa5; 4096], &[".glb, .gltf, .obj or .ply"]),
    ];
    for (name, bytes, _) in &cases {
        std::fs::write(d.join(name), bytes).unwrap();
    }
    for (name, _, parts) in &cases {
        refused(d, name, parts);
    }
    refused(d, "absent.glb", &[]);
}

#[test]
fn broken_ply_and_obj_files() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let head = |vertices: &str, faces: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n\
             element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
        )
    };
    let body = "0 0 0\n1 0 0\n0 1 0\n";
    let cases: Vec<(&str, String)> = vec![
        ("empty.ply", String::new()),
        ("truncated.ply", format!("{}0 0 0\n1 0", head("3", "1"))),
        ("header.ply", "ply\nformat ascii 1.0\nelement vert".into()),
        ("huge.ply", format!("{}{body}3 0 1 2\n", head("4000000000", "1"))),
        ("huge-faces.ply", format!("{}{body}3 0 1 2\n", head("3", "4000000000"))),
        ("index.ply", format!("{}{body}3 0 1 7\n", head("3", "1"))),
        ("nan.ply", format!("{}nan 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", head("3", "1"))),
        ("points.ply", format!("{}{body}", head("3", "0"))),
        ("index.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n".into()),
        ("nan.obj", "v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".into()),
        ("flat.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n".into()),
    ];
    for (name, text) in &cases {
        std::fs::write(d.join(name), text).unwrap();
    }
    for (name, _) in &cases {
        refused(d, name, &[]);
    }
}

/// A PNG header that claims a size, with nothing behind it.
fn png_claiming(width: u32, height: u32) -> Vec<u8> {
    let png = photofit_image::encode_png(1, 1, 3, &[1, 2, 3], photofit_image::PngCompression::Fast).unwrap();
    let mut out = png.clone();
    out[16..20].copy_from_slice(&width.to_be_bytes());
    out[20..24].copy_from_slice(&height.to_be_bytes());
    let crc = crc(&out[12..29]);
    out[29..33].copy_from_slice(&crc.to_be_bytes());
    out
}

fn crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |c, b| {
        (0..8).fold(c ^ u32::from(*b), |c, _| if c & 1 == 1 { 0xedb8_8320 ^ (c >> 1) } else { c >> 1 })
    })
}

#[test]
fn broken_pictures() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let whole = photofit_image::encode_png(8, 8, 3, &[7; 192], photofit_image::PngCompression::Fast).unwrap();
    std::fs::write(d.join("whole.png"), &whole).unwrap();
    std::fs::write(d.join("other.png"), {
        photofit_image::encode_png(8, 4, 3, &[7; 96], photofit_image::PngCompression::Fast).unwrap()
    })
    .unwrap();
    let cases: [(&str, Vec<u8>); 3] = [
        ("empty.png", Vec::new()),
        ("truncated.png", whole[..whole.len() - 20].to_vec()),
        ("huge.png", png_claiming(200_000, 200_000)),
    ];
    let uv = r#","materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}],"textures":[{"source":0}],"images":[{"uri":"IMAGE"}]"#;
    let bin = triangle_bin(TRIANGLE, [0, 1, 2]);
    let asset = |image: &str| {
        let json = triangle_json(NODE, &uv.replace("IMAGE", image));
        glb(&json.replace(r#""indices":1"#, r#""indices":1,"material":0"#), &bin)
    };
    for (name, bytes) in &cases {
        std::fs::write(d.join(name), bytes).unwrap();
        let file = format!("{name}.glb");
        std::fs::write(d.join(&file), asset(name)).unwrap();
    }
    std::fs::write(d.join("missing.glb"), asset("absent.png")).unwrap();
    std::fs::write(d.join("leaves.glb"), asset("../x.png")).unwrap();
    for (name, _) in &cases {
        refused(d, &format!("{name}.glb"), &[name]);
        let o = photofit(d, &["compare", "whole.png", name, "--json", "c.json"]);
        assert_one_error(&o, name, &[name]);
    }
    refused(d, "missing.glb", &["absent.png"]);
    refused(d, "leaves.glb", &["folder"]);
    let o = photofit(d, &["compare", "whole.png", "other.png", "--heatmap", "heat.png"]);
    assert_one_error(&o, "sizes", &["other.png", "8 x 4", "8 x 8"]);
    let o = photofit(d, &["compare", "whole.png", "missing.glb"]);
    assert_one_error(&o, "kinds", &["missing.glb", "both must be images"]);
    assert!(!d.join("c.json").exists() && !d.join("heat.png").exists());
}

#[test]
fn impossible_outputs() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 2, false);
    std::fs::write(d.join("plain"), b"x").unwrap();
    std::fs::create_dir(d.join("folder.glb")).unwrap();
    let mut cases: Vec<(Vec<&str>, &str)> = vec![
        (vec!["simplify", "rock.glb", "-o", "no/out.glb"], "does not exist"),
        (vec!["simplify", "rock.glb", "-o", "plain/out.glb"], "not a folder"),
        (vec!["simplify", "rock.glb", "-o", "folder.glb"], "not a folder"),
        (vec!["simplify", "rock.glb", "-o", "out.glb", "--json", "no/f.json"], "f.json"),
        (vec!["simplify", "rock.glb", "-o", "out.glb", "--report", "plain"], "not a folder"),
        (vec!["simplify", "rock.glb", "-o", "out.glb", "--checkpoint", "plain/c"], "not a folder"),
        (vec!["simplify", "rock.glb", "-o", "r/out.glb", "--report", "r"], "does not exist"),
        (vec!["render", "rock.glb", "-o", "no/out.png"], "does not exist"),
        (vec!["demo", "--out", "plain/demo"], "not a folder"),
    ];
    if cfg!(target_os = "linux") {
        // Nobody, root included, can make files there.
        cases.push((vec!["simplify", "rock.glb", "-o", "/proc/out.glb"], "cannot be written"));
        cases.push((vec!["inspect", "rock.glb", "--json", "/dev/null"], "must be a regular file"));
    }
    let before = names(d);
    for (arguments, rule) in &cases {
        assert_one_error(&photofit(d, arguments), &format!("{arguments:?}"), &[rule]);
        assert_eq!(names(d), before, "{arguments:?} left something behind");
    }
}

#[test]
fn budgets_beyond_the_asset() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 2, false);
    let o = photofit(d, &["simplify", "rock.glb", "-o", "out.glb", "--triangles", "81"]);
    assert_one_error(&o, "81 of 80", &["rock.glb", "triangles", "81", "80"]);
    assert_eq!(names(d), ["rock.glb"]);
}

/// Files that claim gigabytes are refused before memory is taken.
#[cfg(target_os = "linux")]
#[test]
fn huge_claims_take_little_memory() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let json = triangle_json(NODE, "").replace("\"byteLength\":44", "\"byteLength\":4000000000");
    std::fs::write(d.join("huge.glb"), glb(&json, &triangle_bin(TRIANGLE, [0, 1, 2]))).unwrap();
    let header =
        "ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\nend_header\n";
    std::fs::write(d.join("huge.ply"), header).unwrap();
    std::fs::write(d.join("huge.png"), png_claiming(60_000, 60_000)).unwrap();
    let program = command(d, &[]);
    for arguments in ["inspect huge.glb", "inspect huge.ply", "compare huge.png huge.png"] {
        // 1 GiB of address space: the claims are 4 GB and more.
        let line = format!("ulimit -v 1048576; exec \"$0\" {arguments}");
        let o = std::process::Command::new("sh")
            .current_dir(d)
            .args([std::ffi::OsStr::new("-c"), line.as_ref(), program.get_program()])
            .output()
            .unwrap();
        assert_one_error(&o, arguments, &["huge"]);
    }
}

/// Maps that no memory holds are refused before the work, in one line that names the option.
#[cfg(target_os = "linux")]
#[test]
fn maps_beyond_the_memory_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 4, true);
    for task in [
        "simplify",
        "retexture rock.glb",
        "recover texture nothing --mesh",
        "recover mesh --self-test",
        "recover material --self-test",
    ] {
        // Pictures are read after the asset.
        std::fs::write(d.join("nothing"), "{}").unwrap();
        // 2 GiB of address space: maps of 4096 x 4096 texels take 6 GiB and more.
        let line = format!(
            "ulimit -v 2097152; exec \"$0\" {task} rock.glb -o out.glb --texture-size 4096 --steps 1"
        );
        let o = std::process::Command::new("sh")
            .current_dir(d)
            .args(["-c", &line, env!("CARGO_BIN_EXE_photofit")])
            .output()
            .unwrap();
        let parts =
            ["the fit needs about", "GiB of memory", "--texture-size 4096", "there are 1.", "smaller"];
        assert_one_error(&o, task, &parts);
        assert_eq!(names(d), ["nothing", "rock.glb"], "{task}");
    }
    succeeds(d, &["render", "rock.glb", "-o", "a.png", "--width", "16", "--height", "16"]);
}
