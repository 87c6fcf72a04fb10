//! No output replaces an input or another output, whatever it is called.

use crate::support::{
    TRIANGLE, assert_misuse, names, photofit, stderr, triangle_bin, triangle_json, write_rock,
};
use std::path::Path;

/// Every file of a folder with its bytes.
fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let is_file = |name: &String| folder.join(name).is_file();
    let with_bytes = |name: String| {
        let bytes = std::fs::read(folder.join(&name)).unwrap();
        (name, bytes)
    };
    names(folder).into_iter().filter(is_file).map(with_bytes).collect()
}

/// Runs `line` on each case and expects a refusal that names both sides and changes no file.
fn refused(folder: &Path, cases: &[(&str, &str, &str)]) {
    let before = files(folder);
    for (line, output, other) in cases {
        let arguments: Vec<&str> = line.split(' ').collect();
        let o = photofit(folder, &arguments);
        assert_misuse(&o, line, &[output, other, "it must be another file"]);
        assert!(files(folder) == before, "{line} changed a file");
    }
}

#[test]
fn outputs_that_name_an_input_are_refused_by_every_command() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    write_rock(d, 2, false);
    std::fs::create_dir_all(d.join("sub")).unwrap();
    std::fs::create_dir_all(d.join("pics")).unwrap();
    std::fs::write(
        d.join("pics/transforms.json"),
        r#"{ "frames": [{ "file_path": "0", "transform_matrix": [] }] }"#,
    )
    .unwrap();
    std::fs::write(d.join("pics/0.png"), "a picture").unwrap();
    std::fs::hard_link(d.join("rock.glb"), d.join("hard.glb")).unwrap();
    // Refused before anything is read: what they hold does not matter.
    for name in [
        "a.png",
        "b.png",
        "c.exr",
        "albedo.exr",
        "half.exr",
        "ref.exr",
        "cameras.json",
        "p.ply",
        "camera.json",
        "sky.exr",
        "s.xml",
        "x.png.state",
    ] {
        std::fs::write(d.join(name), name).unwrap();
    }
    refused(
        d,
        &[
            ("inspect rock.glb --json rock.glb", "--json", "IN"),
            ("inspect s.xml --json ./s.xml", "--json", "IN"),
            ("simplify rock.glb -o rock.glb", "--output", "IN"),
            ("simplify rock.glb -o ./sub/../rock.glb", "--output", "IN"),
            ("simplify rock.glb -o hard.glb", "--output", "IN"),
            ("simplify rock.glb -o o.glb --json rock.glb", "--json", "IN"),
            ("simplify rock.glb -o o.glb --env sky.exr --json sky.exr", "--json", "--env"),
            ("simplify rock.glb -o o.glb --json o.glb", "--json", "--output"),
            ("simplify rock.glb -o o.glb --json O.glb", "--json", "--output"),
            ("simplify rock.glb -o o.glb --report o.glb", "--report", "--output"),
            ("simplify rock.glb -o o.glb --report r --json r/index.html", "--report", "--json"),
            ("simplify rock.glb -o o.glb --checkpoint k --json k/fit.ckpt", "--checkpoint", "--json"),
            ("render rock.glb -o a.png --env a.png", "--output", "--env"),
            ("render rock.glb -o x.png --json rock.glb", "--json", "IN"),
            ("render rock.glb -o x.png --json x.png", "--json", "--output"),
            ("render rock.glb -o x.png --integrator path --env x.png.state", "the state", "--env"),
            ("render s.xml -o x.png --json s.xml", "--json", "IN"),
            ("compare a.png b.png --json a.png", "--json", "A"),
            ("compare a.png b.png --heatmap b.png", "--heatmap", "B"),
            ("compare a.png b.png --heatmap h.png --json h.png", "--heatmap", "--json"),
            ("denoise c.exr -o c.exr", "--output", "COLOR"),
            ("denoise c.exr -o albedo.exr --albedo albedo.exr", "--output", "--albedo"),
            ("denoise c.exr -o half.exr --half half.exr", "--output", "--half"),
            ("denoise c.exr -o ref.exr --compare ref.exr", "--output", "--compare"),
            ("denoise c.exr -o o.exr --sequence cameras.json --json cameras.json", "--json", "--sequence"),
            ("denoise c.exr -o o.exr --json o.exr", "--json", "--output"),
            ("recover texture pics --mesh rock.glb -o rock.glb", "--output", "--mesh"),
            (
                "recover texture pics --mesh rock.glb -o o.glb --json pics/transforms.json",
                "--json",
                "PICTURES",
            ),
            ("recover texture pics --mesh rock.glb -o o.glb --json pics/0.png", "--json", "PICTURES"),
            ("recover texture pics --mesh rock.glb -o o.glb --json o.glb", "--json", "--output"),
            ("recover mesh pics -o rock.glb --mesh rock.glb", "--output", "--mesh"),
            ("recover mesh --self-test rock.glb -o rock.glb", "--output", "--self-test"),
            ("recover mesh pics -o o.glb --json pics/0.png", "--json", "PICTURES"),
            ("recover material --self-test rock.glb -o out --env out/environment.exr", "--output", "--env"),
            ("recover volume pics -o out --env out/views.png", "--output", "--env"),
            ("retexture rock.glb hard.glb -o rock.glb", "--output", "REFERENCE"),
            ("retexture rock.glb b.glb -o b.glb", "--output", "LIGHT"),
            ("retexture rock.glb b.glb -o o.glb --env sky.exr --json sky.exr", "--json", "--env"),
            ("retexture rock.glb b.glb -o o.glb --json o.glb", "--json", "--output"),
            ("gradient s.xml --parameter k --json s.xml", "--json", "SCENE"),
            ("gradient s.xml --parameter k --weights c.exr --image c.exr", "--image", "--weights"),
            ("surface p.ply -o out --json p.ply", "--json", "POINTS"),
            ("surface p.ply -o . --camera camera.json", "--output", "--camera"),
            ("surface p.ply -o out --json out/depth.png", "--json", "--output"),
        ],
    );
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("rock.glb", d.join("soft.json")).unwrap();
        refused(d, &[("inspect rock.glb --json soft.json", "--json", "IN")]);
        assert!(d.join("soft.json").is_symlink());
    }
}

#[test]
fn outputs_that_name_a_file_of_the_asset_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let json = triangle_json(r#"[{"mesh":0}]"#, "");
    let json = json.replace(r#"{"byteLength":44}"#, r#"{"byteLength":44,"uri":"tri.bin"}"#);
    std::fs::write(d.join("tri.gltf"), json).unwrap();
    std::fs::write(d.join("tri.bin"), triangle_bin(TRIANGLE, [0, 1, 2])).unwrap();
    std::fs::write(d.join("tri.obj"), "mtllib tri.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    std::fs::write(d.join("tri.mtl"), "newmtl a\n").unwrap();
    let scene = "<scene version='3.0.0'><sensor type='perspective'/><shape type='obj'><string name='filename' value='tri.obj'/></shape></scene>";
    std::fs::write(d.join("tri.xml"), scene).unwrap();
    refused(
        d,
        &[
            ("inspect tri.gltf --json tri.bin", "--json", "a file of IN"),
            ("simplify tri.gltf -o o.glb --json tri.bin", "--json", "a file of IN"),
            ("render tri.gltf -o o.png --json tri.bin", "--json", "a file of IN"),
            ("render tri.gltf -o o.png --integrator path --json tri.bin", "--json", "a file of IN"),
            ("compare tri.gltf tri.obj --json tri.mtl", "--json", "a file of an asset"),
            ("inspect tri.obj --json tri.mtl", "--json", "a file of IN"),
            ("inspect tri.xml --json tri.obj", "--json", "a file of IN"),
            ("render tri.xml -o o.png --json tri.obj", "--json", "a file of IN"),
        ],
    );
    let o = photofit(d, &["inspect", "tri.gltf", "--json", "f.json"]);
    assert_eq!(o.status.code(), Some(0), "{}", stderr(&o));
}

#[test]
fn textures_of_recovered_scenes_replace_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    std::fs::create_dir(d.join("found")).unwrap();
    for name in ["s.xml", "found/wood.data.exr", "found/sky.exr", "found/s.xml", "found/recovered.exr"] {
        std::fs::write(d.join(name), name).unwrap();
    }
    refused(
        d,
        &[
            (
                "recover scene s.xml --picture found/wood.data.exr --parameter wood.data -o found",
                "--output",
                "--picture",
            ),
            (
                "recover scene s.xml --picture found/recovered.exr --parameter a -o found",
                "--output",
                "--picture",
            ),
            (
                "recover scene s.xml --self-test --env found/sky.exr --parameter sky -o found",
                "--output",
                "--env",
            ),
            ("recover scene s.xml --self-test --parameter a -o s.xml", "--output", "SCENE"),
            (
                "recover scene s.xml --self-test --parameter a -o k --checkpoint k/recovered.png",
                "--checkpoint",
                "--output",
            ),
        ],
    );
    let before = files(&d.join("found"));
    // Characters that file names do not have are written alike.
    let two = [
        "recover",
        "scene",
        "s.xml",
        "--self-test",
        "--parameter",
        "a b",
        "--parameter",
        "a_b",
        "-o",
        "found",
    ];
    let o = photofit(d, &two);
    assert_misuse(&o, "two keys of one file", &["a b and a_b", "a_b.exr", "each must have its own"]);
    assert!(files(&d.join("found")) == before);
}
