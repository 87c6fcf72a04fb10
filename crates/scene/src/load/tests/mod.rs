//! Files made on the spot: good ones with known contents, and bad ones with known messages.

mod bad_gltf;
mod compressed;
mod draco;
mod extensions;
mod gltf;
mod kept;
mod obj;
mod ply;
mod posed;

use crate::{Limits, Scene, SceneError, load, load_with};
use std::path::Path;

/// Writes files into a fresh folder and loads the first.
pub(super) fn load_files(files: &[(&str, &[u8])]) -> Result<Scene, SceneError> {
    load_files_with(files, &Limits::default())
}

pub(super) fn load_files_with(files: &[(&str, &[u8])], limits: &Limits) -> Result<Scene, SceneError> {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        write(folder.path(), name, bytes);
    }
    load_with(folder.path().join(files[0].0), limits)
}

fn write(folder: &Path, name: &str, bytes: &[u8]) {
    let path = folder.join(name);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, bytes).unwrap();
}

/// The file is refused with one line that names it and contains every one of `words`.
pub(super) fn refused(files: &[(&str, &[u8])], words: &[&str]) {
    refused_with(files, &Limits::default(), words);
}

pub(super) fn refused_with(files: &[(&str, &[u8])], limits: &Limits, words: &[&str]) {
    let text = match load_files_with(files, limits) {
        Ok(_) => panic!("{} is accepted; expected {words:?}", files[0].0),
        Err(e) => e.to_string(),
    };
    assert!(text.contains(files[0].0), "names the file: {text}");
    assert!(!text.contains('\n'), "one line: {text}");
    for word in words {
        assert!(text.contains(word), "says `{word}`: {text}");
    }
}

/// A PNG of one colour.
pub(super) fn png(width: usize, height: usize, texel: [u8; 4]) -> Vec<u8> {
    let bytes: Vec<u8> = texel.repeat(width * height);
    photofit_image::encode_png(width, height, 4, &bytes, photofit_image::PngCompression::Fast).unwrap()
}

#[test]
fn formats_are_told_by_content_and_name() {
    refused(&[("a.glb", b"")], &["empty"]);
    refused(&[("a.glb", b"hello")], &["glTF"]);
    refused(&[("a.gltf", b"hello")], &["JSON"]);
    refused(&[("a.ply", b"hello")], &["ply"]);
    refused(&[("a.fbx", b"Kaydara")], &["FBX", "Blender", ".glb"]);
    refused(&[("a", b"Kaydara FBX Binary  \0")], &["FBX", "Blender"]);
    refused(&[("a.usdz", b"PK\x03\x04")], &["USD", "usd2gltf"]);
    refused(&[("a.glb", b"#usda 1.0\n")], &["USD", "usd2gltf"]);
    refused(&[("a.stl", b"solid")], &[".glb", "stl"]);
    let folder = tempfile::tempdir().unwrap();
    let text = load(folder.path()).unwrap_err().to_string();
    assert!(text.contains("regular file"), "{text}");
    let text = load(folder.path().join("none.glb")).unwrap_err().to_string();
    assert!(text.contains("none.glb"), "{text}");
    // A binary file under a wrong extension still loads by its content.
    let scene = load_files(&[("a.obj", &gltf::triangle().glb())]).unwrap();
    assert_eq!(scene.triangle_count(), 1);
    refused_with(
        &[("a.obj", b"v 0 0 0\n")],
        &Limits { file_bytes: 4, ..Limits::default() },
        &["at most 4 bytes"],
    );
}
