//! Running the program, and assets made in memory.

use photofit_geometry::Mesh;
use photofit_geometry::shapes::displaced_sphere;
use photofit_scalar::vec2;
use photofit_scene::{Instance, Material, Primitive, Scene, TextureImage, TextureSlot};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output};
use std::time::{Duration, Instant};

/// The program with arguments, in a folder.
pub(crate) fn command(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_photofit"));
    command.current_dir(folder).args(arguments);
    command
}

/// Runs the program to its end.
pub(crate) fn photofit(folder: &Path, arguments: &[&str]) -> Output {
    command(folder, arguments).output().expect("the program starts")
}

pub(crate) fn stdout(o: &Output) -> String {
    String::from_utf8_lossy(&o.stdout).into_owned()
}

pub(crate) fn stderr(o: &Output) -> String {
    String::from_utf8_lossy(&o.stderr).into_owned()
}

/// Runs the program and expects status 0.
pub(crate) fn succeeds(folder: &Path, arguments: &[&str]) -> Output {
    let o = photofit(folder, arguments);
    assert_eq!(o.status.code(), Some(0), "{arguments:?}: {}", stderr(&o));
    o
}

/// Waits until something holds, and panics when it never does.
#[track_caller]
pub(crate) fn until(what: &str, child: &mut Child, mut holds: impl FnMut() -> bool) {
    let start = Instant::now();
    while !holds() {
        assert!(start.elapsed() < Duration::from_secs(60), "{what}");
        assert!(child.try_wait().unwrap().is_none(), "{what}: the program has ended");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Expects exit status 1 and one line on stderr that begins with `error:` and holds all of `parts`.
pub(crate) fn assert_one_error(o: &Output, what: &str, parts: &[&str]) {
    assert_one_line(o, 1, what, parts);
}

/// Expects exit status 2 and one line on stderr that begins with `error:` and holds all of `parts`.
pub(crate) fn assert_misuse(o: &Output, what: &str, parts: &[&str]) {
    assert_one_line(o, 2, what, parts);
}

fn assert_one_line(o: &Output, status: i32, what: &str, parts: &[&str]) {
    let text = stderr(o);
    assert_eq!(o.status.code(), Some(status), "{what}: {text}");
    // A driver for Vulkan speaks for itself where there is no desktop.
    let of_driver = |l: &str| l.contains("XDG_RUNTIME_DIR");
    let errors: Vec<&str> = text.lines().filter(|l| !l.starts_with("warning:") && !of_driver(l)).collect();
    assert_eq!(errors.len(), 1, "{what}: one line, found {text}");
    assert!(errors[0].starts_with("error: "), "{what}: {text}");
    assert!(!text.contains("panicked"), "{what}: {text}");
    for part in parts {
        assert!(errors[0].contains(part), "{what}: {part:?} in {text}");
    }
}

/// The names in a folder, sorted.
pub(crate) fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .expect("a folder")
        .map(|e| e.expect("an entry").file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

/// A rock of `20 frequency^2` triangles; with uvs and a checked texture where asked.
pub(crate) fn rock(frequency: u32, textured: bool) -> Scene {
    let mut mesh = displaced_sphere(frequency, 0.25, 4, 3);
    let mut material = Material::clay();
    let mut images = Vec::new();
    if textured {
        mesh.uvs = mesh.positions.iter().map(|p| vec2(0.5 + 0.3 * p.x, 0.5 + 0.3 * p.y)).collect();
        let texel = |i: usize| {
            if (i % 16 / 4 + i / 64).is_multiple_of(2) { [200, 90, 40, 255] } else { [40, 80, 190, 255] }
        };
        images.push(TextureImage {
            name: "checks".into(),
            width: 16,
            height: 16,
            texels: (0..256).map(texel).collect(),
            ..TextureImage::default()
        });
        material.base_color = [1.0; 4];
        material.base_color_texture = Some(TextureSlot::new(0));
    }
    of_mesh(mesh, material, images)
}

pub(crate) fn of_mesh(mesh: Mesh, material: Material, images: Vec<TextureImage>) -> Scene {
    Scene {
        name: "rock".into(),
        primitives: vec![Primitive { mesh, material: 0 }],
        instances: vec![Instance { primitive: 0, transform: glam::Affine3A::IDENTITY }],
        materials: vec![material],
        images,
        ..Scene::default()
    }
}

/// Writes a rock to `rock.glb` in a folder.
pub(crate) fn write_rock(folder: &Path, frequency: u32, textured: bool) -> PathBuf {
    let path = folder.join("rock.glb");
    photofit_scene::save_glb(&path, &rock(frequency, textured)).expect("written");
    path
}

/// A binary glTF file of a JSON and a binary part.
pub(crate) fn glb(json: &str, bin: &[u8]) -> Vec<u8> {
    let mut json = json.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bin = bin.to_vec();
    bin.resize(bin.len().next_multiple_of(4), 0);
    let mut out = b"glTF".to_vec();
    let total = 12 + 8 + json.len() + 8 + bin.len();
    out.extend(2_u32.to_le_bytes());
    out.extend((total as u32).to_le_bytes());
    out.extend((json.len() as u32).to_le_bytes());
    out.extend(b"JSON");
    out.extend(&json);
    out.extend((bin.len() as u32).to_le_bytes());
    out.extend(b"BIN\0");
    out.extend(&bin);
    out
}

/// The JSON of one triangle of 3 positions and 3 u16 indices, with more members spliced in.
pub(crate) fn triangle_json(nodes: &str, more: &str) -> String {
    format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":{nodes},
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}],
        "buffers":[{{"byteLength":44}}],
        "bufferViews":[{{"buffer":0,"byteLength":36}},{{"buffer":0,"byteOffset":36,"byteLength":6}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}},
        {{"bufferView":1,"componentType":5123,"count":3,"type":"SCALAR"}}]{more}}}"#
    )
}

/// The binary part of one triangle.
pub(crate) fn triangle_bin(positions: [[f32; 3]; 3], indices: [u16; 3]) -> Vec<u8> {
    let mut out = Vec::new();
    positions.as_flattened().iter().for_each(|x| out.extend(x.to_le_bytes()));
    indices.iter().for_each(|i| out.extend(i.to_le_bytes()));
    out.resize(44, 0);
    out
}

/// A triangle that is sound.
pub(crate) const TRIANGLE: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

/// A file of JSON.
pub(crate) fn read_json(path: &Path) -> serde_json::Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}
