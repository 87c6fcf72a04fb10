//! Loading asset files: glTF 2.0, Wavefront OBJ and PLY, all treated as untrusted.

mod file;
#[cfg(feature = "mitsuba")]
mod geometry;
mod gltf;
mod mtl;
mod normals;
mod obj;
mod ply;
mod points;
mod polygon;
#[cfg(test)]
mod tests;
pub(crate) mod texture;

use crate::error::{Fault, fault};
use crate::{Primitive, Scene, SceneError};
pub(crate) use file::clip;
#[cfg(feature = "mitsuba")]
pub(crate) use file::read as read_file;
#[cfg(feature = "mitsuba")]
pub(crate) use geometry::{Geometry, normals_by_index, obj_geometry, ply_geometry};
pub use points::{Points, Sensor, load_points, load_points_with};
use std::path::Path;

/// What a loader accepts; anything larger is an error before memory is taken.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Bytes of one file; of all buffers of an asset; of all textures, as encoded.
    pub file_bytes: u64,
    /// Bytes of the JSON part of a glTF asset.
    pub json_bytes: usize,
    /// Objects and arrays in the JSON part of a glTF asset; sixteen times as many values.
    pub json_items: usize,
    /// Vertices of all primitives together, as stored.
    pub vertices: usize,
    /// Triangles of all primitives together, as stored.
    pub triangles: usize,
    /// Placed primitives.
    pub instances: usize,
    /// Columns or rows of one texture.
    pub texture_side: usize,
    /// Texels of all textures together; one of data in 16 bits a channel counts as three, or, where there is no
    /// room for that beside the others, is read in 8.
    pub texels: u64,
    /// Keeps the files of textures beside their texels ([`crate::TextureImage::encoded`]), so that they are written again as
    /// they are.
    pub keep_encoded: bool,
    /// The attribute of one number per vertex that is read beside those of glTF: `_NAME`, without the underscore and whatever the
    /// case; it counts as vertices do. The names of others are listed alone ([`Scene::ignored_attributes`]).
    pub vertex_attribute: Option<String>,
}

impl Default for Limits {
    /// 4 GiB per file, 512 MiB of JSON with 2 million items, 64 million vertices, 128 million triangles, 4 million
    /// instances, textures up to 16384 x 16384 and half a gigatexel together.
    fn default() -> Self {
        Self {
            file_bytes: 4 << 30,
            json_bytes: 512 << 20,
            json_items: 2_000_000,
            vertices: 64_000_000,
            triangles: 128_000_000,
            instances: 4_000_000,
            texture_side: 16_384,
            texels: 1 << 29,
            keep_encoded: false,
            vertex_attribute: None,
        }
    }
}

/// Largest coordinate that a loader accepts, in the asset's units and in world space: squares of it stay finite.
pub const MAX_COORDINATE: f32 = 1e15;

/// Loads a glTF (`.glb`, `.gltf`), OBJ or PLY asset with the default [`Limits`].
///
/// The format follows from the contents, then from the extension. Textures and buffers are read from the asset's
/// folder and below only. Missing normals are computed: flat for glTF as the specification asks, smooth (weighted by
/// angle, over vertices of equal position) for OBJ and PLY. Things that are ignored are listed in
/// [`Scene::warnings`].
///
/// # Errors
/// If the file or a file that it names cannot be read, breaks a rule of its format, or exceeds a limit; the message
/// names file, place and rule.
pub fn load(path: impl AsRef<Path>) -> Result<Scene, SceneError> {
    load_with(path, &Limits::default())
}

/// As [`load`], with other limits.
///
/// # Errors
/// As [`load`].
pub fn load_with(path: impl AsRef<Path>, limits: &Limits) -> Result<Scene, SceneError> {
    let path = path.as_ref();
    let bytes = file::read(path, limits.file_bytes)?;
    let folder = file::Folder::of(path);
    let mut scene = parse(path, &bytes, &folder, limits).map_err(|f| f.in_file(path))?;
    scene.source_bytes = bytes.len() as u64 + folder.bytes_read();
    scene.files = folder.into_files();
    scene.name = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    checked(scene).map_err(|f| f.in_file(path))
}

/// The scene of a `.glb` file that is in memory, as [`to_glb`](crate::to_glb) makes them, with the default [`Limits`]; it may refer to no
/// other files.
///
/// # Errors
/// As [`load`].
pub fn from_glb(bytes: &[u8]) -> Result<Scene, SceneError> {
    if !bytes.starts_with(b"glTF") {
        return Err(fault("byte 0", NO_MAGIC).in_scene());
    }
    let mut scene =
        gltf::parse_glb(bytes, &file::Folder::default(), &Limits::default()).map_err(Fault::in_scene)?;
    scene.source_bytes = bytes.len() as u64;
    checked(scene).map_err(Fault::in_scene)
}

const NO_MAGIC: &str = "the file does not begin with the magic `glTF`; a .glb file must";

/// A scene that was read, if it is valid.
fn checked(scene: Scene) -> Result<Scene, Fault> {
    scene.check()?;
    check_extent(&scene)?;
    Ok(scene)
}

fn parse(path: &Path, bytes: &[u8], folder: &file::Folder, limits: &Limits) -> Result<Scene, Fault> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let first = text.iter().copied().find(|b| !b.is_ascii_whitespace());
    if bytes.is_empty() {
        return Err(fault("byte 0", "the file is empty"));
    }
    if bytes.starts_with(b"glTF") {
        return gltf::parse_glb(bytes, folder, limits);
    }
    if text.starts_with(b"ply\n") || text.starts_with(b"ply\r") {
        return ply::parse(text, folder, limits);
    }
    if let Some(rule) = convertible(bytes, &extension) {
        return Err(fault("the file's format", rule));
    }
    match extension.as_str() {
        "obj" => obj::parse(text, folder, limits, obj::Missing::Creased),
        "gltf" | "glb" | "json" | "" if first == Some(b'{') => gltf::parse_json(text, folder, limits),
        "glb" => Err(fault("byte 0", NO_MAGIC)),
        "gltf" => Err(fault("byte 0", "the file is no JSON object; a .gltf file must be one")),
        "ply" => Err(fault("byte 0", "the file does not begin with the line `ply`; a .ply file must")),
        other => Err(fault(
            "the file's name",
            format!("the extension is `.{other}`; assets must be .glb, .gltf, .obj or .ply files"),
        )),
    }
}

/// What to do about formats that are not read, told by content or extension.
fn convertible(bytes: &[u8], extension: &str) -> Option<&'static str> {
    let starts = |magic: &[&[u8]]| magic.iter().any(|m| bytes.starts_with(m));
    if starts(&[b"Kaydara FBX", b"; FBX"]) || extension == "fbx" {
        return Some(
            "is FBX, which is not read; it must be .glb, .gltf, .obj or .ply: `FBX2glTF IN.fbx` or Blender (File, Import, \
             then File, Export, glTF 2.0) writes a .glb",
        );
    }
    let usd = ["usd", "usda", "usdc", "usdz"].contains(&extension);
    (usd || starts(&[b"PXR-USDC", b"#usda"])).then_some(
        "is USD, which is not read; it must be .glb, .gltf, .obj or .ply: `usd2gltf -i IN.usd -o OUT.glb` or Blender \
         (File, Import, then File, Export, glTF 2.0) writes a .glb",
    )
}

/// World-space coordinates are finite and at most [`MAX_COORDINATE`].
fn check_extent(scene: &Scene) -> Result<(), Fault> {
    let boxes: Vec<_> = scene.primitives.iter().map(|p| p.mesh.bounds()).collect();
    for (i, instance) in scene.instances.iter().enumerate() {
        let Some((lo, hi)) = boxes[instance.primitive] else { continue };
        for k in 0..8 {
            let corner = glam::vec3(
                if k & 1 == 0 { lo.x } else { hi.x },
                if k & 2 == 0 { lo.y } else { hi.y },
                if k & 4 == 0 { lo.z } else { hi.z },
            );
            let p = instance.transform.transform_point3(corner);
            if !(p.abs().max_element() <= MAX_COORDINATE && p.is_finite()) {
                return Err(fault(
                    format!("instance {i} of primitive {}", instance.primitive),
                    format!(
                        "has a corner at {p} in world space; coordinates must be finite and at most {MAX_COORDINATE:e}"
                    ),
                ));
            }
        }
    }
    Ok(())
}

/// Counts what is loaded against the limits.
#[derive(Debug)]
pub(crate) struct Budget<'a> {
    limits: &'a Limits,
    vertices: usize,
    triangles: usize,
    primitives: usize,
}

impl<'a> Budget<'a> {
    pub(crate) fn new(limits: &'a Limits) -> Self {
        Self { limits, vertices: 0, triangles: 0, primitives: 0 }
    }

    /// Vertices and triangles that may still be taken.
    pub(crate) fn left(&self) -> (usize, usize) {
        (self.limits.vertices - self.vertices, self.limits.triangles - self.triangles)
    }

    /// Takes `n` vertices, before they are allocated.
    pub(crate) fn vertices(&mut self, n: u64, place: impl FnOnce() -> String) -> Result<(), Fault> {
        let total = n.saturating_add(self.vertices as u64);
        if total > self.limits.vertices as u64 {
            return Err(fault(
                place(),
                format!(
                    "this makes {total} vertices; there may be at most {} vertices in all",
                    self.limits.vertices
                ),
            ));
        }
        self.vertices = total as usize;
        Ok(())
    }

    /// Takes one more primitive.
    pub(crate) fn primitive(&mut self, place: &str) -> Result<(), Fault> {
        self.primitives += 1;
        if self.primitives > self.limits.instances {
            return Err(fault(
                place,
                format!(
                    "is one primitive more than allowed; there may be at most {} placed primitives",
                    self.limits.instances
                ),
            ));
        }
        Ok(())
    }

    /// Takes `n` triangles, before they are allocated.
    pub(crate) fn triangles(&mut self, n: u64, place: impl FnOnce() -> String) -> Result<(), Fault> {
        let total = n.saturating_add(self.triangles as u64);
        if total > self.limits.triangles as u64 {
            return Err(fault(
                place(),
                format!(
                    "this makes {total} triangles; there may be at most {} triangles in all",
                    self.limits.triangles
                ),
            ));
        }
        self.triangles = total as usize;
        Ok(())
    }
}

pub(crate) use normals::{flat as flat_normals, smooth as smooth_normals};
pub(crate) use texture::affine_of_transform;

/// The material of formats that have no flag of sides: as in other programs, both are seen.
pub(crate) fn clay() -> crate::Material {
    crate::Material { double_sided: true, ..crate::Material::clay() }
}

/// Appends a primitive placed once without a transform.
pub(crate) fn place(scene: &mut Scene, primitive: Primitive) {
    scene
        .instances
        .push(crate::Instance { primitive: scene.primitives.len(), transform: glam::Affine3A::IDENTITY });
    scene.primitives.push(primitive);
}
