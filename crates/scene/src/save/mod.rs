//! Saving assets as glTF 2.0 binary files.

mod animation;
mod compress;
mod encode;
mod extensions;
mod geometry;
mod levels;
mod lods;
mod material;
mod nodes;
mod order;
#[cfg(test)]
mod tests;

pub use compress::{Compression, Precision};
pub use lods::save_glb_lods;

use crate::error::{Fault, fault};
use crate::{Camera, Scene, SceneError};
use photofit_scalar::Vec4f;
use serde_json::{Map, Number, Value, json};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::Path;

/// Writes a scene as a `.glb` file that holds everything: geometry, materials and textures (see [`crate::TextureEncoding`]).
///
/// Tangents that a material needs ([`crate::Material::needs_tangents`]) are computed for rigid meshes that lack them; those that none needs
/// are written for the meshes of a [`Scene::hierarchy`] alone.
/// A scene with a [`Scene::hierarchy`] is written with its nodes, skins, morph targets and animations; what the scene holds
/// beyond that follows as further nodes. Without one, primitives keep their sharing, instances become nodes (transforms that shear, which glTF nodes cannot, are worked
/// into the vertices), factors above one of the emission become `KHR_materials_emissive_strength`. Images that no
/// material uses are left out. The file appears under its name only when it is complete.
///
/// # Errors
/// If the scene is not valid (see [`Scene::validate`]), is larger than 4 GiB, or the file cannot be written.
///
/// ```
/// use photofit_scene::{Material, Primitive, Instance, Scene, load, save_glb};
/// use photofit_scalar::vec3;
/// let mut scene = Scene { materials: vec![Material::clay()], ..Scene::default() };
/// let mut primitive = Primitive::default();
/// primitive.mesh.positions = vec![vec3(0.0, 0.0, 0.0), vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0)];
/// primitive.mesh.triangles = vec![[0, 1, 2]];
/// scene.primitives.push(primitive);
/// scene.instances.push(Instance { primitive: 0, transform: glam::Affine3A::IDENTITY });
/// let path = std::env::temp_dir().join("photofit_scene_triangle.glb");
/// save_glb(&path, &scene)?;
/// assert_eq!(load(&path)?.triangle_count(), 1);
/// # std::fs::remove_file(&path).ok();
/// # Ok::<(), photofit_scene::SceneError>(())
/// ```
pub fn save_glb(path: impl AsRef<Path>, scene: &Scene) -> Result<(), SceneError> {
    save_glb_with(path, scene, Compression::None)
}

/// As [`save_glb`], with compressed geometry: triangles and vertices may come in another order.
///
/// # Errors
/// As [`save_glb`].
pub fn save_glb_with(
    path: impl AsRef<Path>,
    scene: &Scene,
    compression: Compression,
) -> Result<(), SceneError> {
    write(path.as_ref(), &to_glb_with(scene, compression)?)
}

/// Writes what [`to_glb_with`] made as a file, which appears under its name only when it is complete.
///
/// # Errors
/// If the file cannot be written.
pub fn write_glb(path: impl AsRef<Path>, bytes: &[u8]) -> Result<(), SceneError> {
    write(path.as_ref(), bytes)
}

/// Writes a file under its name when it is complete.
fn write(path: &Path, bytes: &[u8]) -> Result<(), SceneError> {
    photofit_image::write_atomically(path, bytes).map_err(|e| {
        let cause = match e {
            photofit_image::ImageError::Io { source, .. } => source,
            other => std::io::Error::other(other.to_string()),
        };
        SceneError::Write { path: path.to_owned(), cause }
    })
}

/// The bytes that [`save_glb`] writes.
///
/// # Errors
/// If the scene is not valid (see [`Scene::validate`]) or is larger than 4 GiB.
pub fn to_glb(scene: &Scene) -> Result<Vec<u8>, SceneError> {
    to_glb_with(scene, Compression::None)
}

/// The bytes that [`save_glb_with`] writes.
///
/// # Errors
/// As [`to_glb`].
pub fn to_glb_with(scene: &Scene, compression: Compression) -> Result<Vec<u8>, SceneError> {
    scene.validate()?;
    encode(scene, compression).map_err(Fault::in_scene)
}

fn encode(scene: &Scene, compression: Compression) -> Result<Vec<u8>, Fault> {
    let mut writer = Writer::new(compression, scene.primitives.iter().map(|p| &p.mesh));
    let (mut instances, mut cameras, mut lights) = (0, 0, 0);
    if let Some(hierarchy) = scene.hierarchy.as_deref() {
        nodes::write(scene, hierarchy, &mut writer)?;
        let (c, l) = hierarchy.cameras_and_lights(&hierarchy.locals());
        (instances, cameras, lights) = (hierarchy.placements.len(), c.len(), l.len());
    }
    geometry::write(scene, &scene.instances[instances..], &BTreeMap::new(), &mut writer)?;
    for camera in scene.cameras.iter().skip(cameras) {
        write_camera(camera, &mut writer);
    }
    extensions::write_lights(scene.lights.get(lights..).unwrap_or_default(), &mut writer)?;
    material::write(scene, &mut writer)?;
    writer.finish(scene)
}

/// The document and its binary chunk as they grow.
#[derive(Debug, Default)]
struct Writer {
    compression: Compression,
    /// Exponent of the grid of compressed positions.
    grid: i32,
    binary: Vec<u8>,
    /// Bytes that readers decode from compressed views.
    decoded: usize,
    views: Vec<Value>,
    accessors: Vec<Value>,
    meshes: Vec<Value>,
    nodes: Vec<Value>,
    /// The nodes that the scene lists.
    roots: Vec<usize>,
    skins: Vec<Value>,
    animations: Vec<Value>,
    /// Accessors of key times by their bits.
    times: HashMap<Vec<u32>, usize>,
    cameras: Vec<Value>,
    materials: Vec<Value>,
    textures: Vec<Value>,
    samplers: Vec<Value>,
    images: Vec<Value>,
    lights: Vec<Value>,
    extensions: BTreeSet<&'static str>,
    /// Those of them that a reader must know.
    required: BTreeSet<&'static str>,
}

/// `bufferView.target` of vertices and of indices.
const VERTICES: u32 = 34962;
const INDICES: u32 = 34963;

impl Writer {
    /// Appends bytes at a multiple of four; the index of their view.
    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let mut view = json!({"buffer": 0, "byteOffset": self.binary.len(), "byteLength": bytes.len()});
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        self.binary.extend_from_slice(bytes);
        self.views.push(view);
        self.views.len() - 1
    }

    /// Appends a node at the top.
    fn top(&mut self, node: Value) {
        self.roots.push(self.nodes.len());
        self.nodes.push(node);
    }

    /// Appends floats as elements of 1, 2, 3, 4 or 16 components; the index of their accessor.
    fn floats(&mut self, values: &[f32], components: usize, target: Option<u32>) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
        self.accessor(&bytes, target, 5126, values.len() / components, components)
    }

    /// Appends colours in [0, 1], uncompressed as integers where these hold the same bits, and without an alpha that is 1 everywhere.
    fn colors(&mut self, colors: &[Vec4f]) -> usize {
        let values: &[f32] = bytemuck::cast_slice(colors);
        if self.compression != Compression::None {
            return self.rounded(values, 4, compress::Rounding::Unit).0;
        }
        let in_steps = |most: f32| {
            let steps = values.iter().map(|x| (x * most).round());
            steps.clone().zip(values).all(|(k, x)| k / most == *x).then(|| steps.collect::<Vec<f32>>())
        };
        let (bytes, component) = if let Some(steps) = in_steps(255.0) {
            (steps.into_iter().map(|k| k as u8).collect::<Vec<u8>>(), 5121)
        } else if let Some(steps) = in_steps(65535.0) {
            (steps.into_iter().flat_map(|k| (k as u16).to_le_bytes()).collect(), 5123)
        } else if colors.iter().all(|c| c.w == 1.0) {
            let opaque: Vec<f32> = colors.iter().flat_map(|c| [c.x, c.y, c.z]).collect();
            return self.floats(&opaque, 3, Some(VERTICES));
        } else {
            return self.floats(values, 4, Some(VERTICES));
        };
        let accessor = self.accessor(&bytes, Some(VERTICES), component, colors.len(), 4);
        self.accessors[accessor]["normalized"] = json!(true);
        accessor
    }

    fn accessor(
        &mut self,
        bytes: &[u8],
        target: Option<u32>,
        component: u32,
        count: usize,
        components: usize,
    ) -> usize {
        let view = self.lossless(bytes, bytes.len() / count.max(1), target);
        self.accessor_of(view, component, count, components)
    }

    /// The accessor of a whole view.
    fn accessor_of(&mut self, view: usize, component: u32, count: usize, components: usize) -> usize {
        let kind = match components {
            1 => "SCALAR",
            2 => "VEC2",
            3 => "VEC3",
            4 => "VEC4",
            _ => "MAT4",
        };
        self.accessors.push(json!({
            "bufferView": view,
            "componentType": component,
            "count": count,
            "type": kind,
        }));
        self.accessors.len() - 1
    }

    fn finish(mut self, written: &Scene) -> Result<Vec<u8>, Fault> {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let mut root = Map::new();
        let about = &written.about;
        let mut asset = json!({"version": "2.0", "generator": "photofit"});
        if !about.copyright.is_empty() {
            asset["copyright"] = json!(about.copyright);
        }
        root.insert("asset".into(), with_extras(asset, &about.asset_extras));
        root.insert("scene".into(), json!(0));
        // Readers differ in whether an empty scene may lack its list of nodes; an empty node serves all.
        if self.roots.is_empty() {
            self.top(json!({"name": "empty"}));
        }
        let scene = named(json!({"nodes": self.roots}), &about.scene);
        let scene = with_extras(scene, &about.scene_extras);
        if let Some(extras) = &about.root_extras {
            root.insert("extras".into(), extras.clone());
        }
        root.insert("scenes".into(), json!([scene]));
        if !self.binary.is_empty() {
            let mut buffers = vec![json!({"byteLength": self.binary.len()})];
            if self.decoded > 0 {
                let fallback = json!({"EXT_meshopt_compression": {"fallback": true}});
                buffers.push(json!({"byteLength": self.decoded, "extensions": fallback}));
            }
            root.insert("buffers".into(), Value::Array(buffers));
        }
        if !self.lights.is_empty() {
            root.insert("extensions".into(), json!({"KHR_lights_punctual": {"lights": self.lights}}));
            self.extensions.insert("KHR_lights_punctual");
        }
        let extensions: Vec<Value> = self.extensions.iter().map(|&e| json!(e)).collect();
        let required: Vec<Value> = self.required.iter().map(|&e| json!(e)).collect();
        for (key, values) in [
            ("nodes", self.nodes),
            ("meshes", self.meshes),
            ("skins", self.skins),
            ("animations", self.animations),
            ("cameras", self.cameras),
            ("materials", self.materials),
            ("textures", self.textures),
            ("samplers", self.samplers),
            ("images", self.images),
            ("accessors", self.accessors),
            ("bufferViews", self.views),
            ("extensionsUsed", extensions),
            ("extensionsRequired", required),
        ] {
            if !values.is_empty() {
                root.insert(key.into(), Value::Array(values));
            }
        }
        let mut root = Value::Object(root);
        shorten(&mut root);
        let mut json = root.to_string().into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        container(&json, &self.binary)
    }
}

/// Gives numbers that are single precision floats the fewest digits that are read back as the same float; application data stay.
fn shorten(value: &mut Value) {
    match value {
        Value::Number(number) => {
            let Some(x) = number.as_f64().filter(|_| number.is_f64()) else { return };
            let single = x as f32;
            if f64::from(single) == x
                && let Ok(short) = single.to_string().parse::<f64>()
                && short as f32 == single
                && let Some(short) = Number::from_f64(short)
            {
                *number = short;
            }
        }
        Value::Array(values) => values.iter_mut().for_each(shorten),
        Value::Object(map) => {
            map.iter_mut().filter(|(key, _)| *key != "extras").for_each(|(_, value)| shorten(value));
        }
        Value::Null | Value::Bool(_) | Value::String(_) => {}
    }
}

fn container(json: &[u8], binary: &[u8]) -> Result<Vec<u8>, Fault> {
    let binary_chunk = if binary.is_empty() { 0 } else { 8 + binary.len() };
    let total = 12 + 8 + json.len() + binary_chunk;
    let Ok(total) = u32::try_from(total) else {
        return Err(fault("the .glb", format!("has {total} bytes; it must be smaller than 4 GiB")));
    };
    let mut out = Vec::with_capacity(total as usize);
    out.extend_from_slice(b"glTF");
    out.extend_from_slice(&2_u32.to_le_bytes());
    out.extend_from_slice(&total.to_le_bytes());
    let mut chunk = |kind: &[u8; 4], data: &[u8]| {
        // Fits: it is part of the total.
        out.extend_from_slice(&(data.len() as u32).to_le_bytes());
        out.extend_from_slice(kind);
        out.extend_from_slice(data);
    };
    chunk(b"JSON", json);
    if !binary.is_empty() {
        chunk(b"BIN\0", binary);
    }
    Ok(out)
}

fn write_camera(camera: &Camera, writer: &mut Writer) {
    writer.cameras.push(json!({
        "type": "perspective",
        "perspective": {
            "yfov": camera.fov_y,
            "aspectRatio": camera.aspect,
            "znear": camera.near,
            "zfar": camera.far,
        },
    }));
    let (_, rotation, _) = camera.view.inverse().to_scale_rotation_translation();
    let node = json!({
        "camera": writer.cameras.len() - 1,
        "translation": camera.eye.to_array(),
        "rotation": rotation.normalize().to_array(),
    });
    writer.top(node);
}

/// Adds application data where there are some.
fn with_extras(mut value: Value, extras: &Option<Value>) -> Value {
    if let Some(extras) = extras {
        value["extras"] = extras.clone();
    }
    value
}

/// Adds the name when there is one.
fn named(mut value: Value, name: &str) -> Value {
    if !name.is_empty() {
        value["name"] = json!(name);
    }
    value
}
