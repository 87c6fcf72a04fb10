//! glTF 2.0: `.glb` containers and `.gltf` with external or embedded buffers.

mod accessor;
mod container;
mod document;
mod extensions;
mod geometry;
mod lights;
mod material;
mod nodes;
mod skin;

pub(crate) use geometry::strip;

use super::file::Folder;
use super::texture::Textures;
use super::{Budget, Limits};
use crate::error::Fault;
use crate::{Instance, Material, Primitive, Scene};
use document::Document;
use std::collections::HashMap;
use std::collections::hash_map::Entry;

/// Loads a binary container.
pub(crate) fn parse_glb(bytes: &[u8], folder: &Folder, limits: &Limits) -> Result<Scene, Fault> {
    let (json, binary) = container::split(bytes)?;
    parse_document(json, binary, folder, limits)
}

/// Loads a JSON document.
pub(crate) fn parse_json(json: &[u8], folder: &Folder, limits: &Limits) -> Result<Scene, Fault> {
    parse_document(json, None, folder, limits)
}

fn parse_document(
    json: &[u8],
    binary: Option<&[u8]>,
    folder: &Folder,
    limits: &Limits,
) -> Result<Scene, Fault> {
    let mut scene = Scene::default();
    let document = Document::new(json, binary, folder, limits, &mut scene.warnings)?;
    let nodes = nodes::Nodes::new(&document.root)?;
    let mut textures = Textures::new(limits);
    let mut materials = Materials::default();
    let mut budget = Budget::new(limits);
    // Primitives of a mesh that need neither skin nor own weights are shared by all nodes.
    let mut shared: HashMap<usize, Vec<usize>> = HashMap::new();
    let mut skins: HashMap<usize, skin::Skin> = HashMap::new();
    for node in nodes.of_scene(&document.root, &mut scene.warnings)? {
        if scene.instances.len() > limits.instances {
            return Err(crate::error::fault(
                format!("node {node}"),
                format!("at most {} placed primitives", limits.instances),
            ));
        }
        let json = &document.root.nodes[node];
        if let Some(camera) = json.camera {
            match nodes::camera(&document.root, camera.value(), nodes.world(node), node)? {
                Some(camera) => scene.cameras.push(camera),
                None => {
                    let warning =
                        format!("camera {} is not a perspective one and is left out", camera.value());
                    scene.warnings.push(warning);
                }
            }
        }
        if let Some(light) = document.light(node) {
            scene.lights.push(lights::read(&document.lights, light, nodes.world(node), node)?);
        }
        let Some(mesh) = json.mesh.map(|m| m.value()) else { continue };
        let skin = match json.skin.map(|s| s.value()) {
            None => None,
            Some(s) => {
                if let Entry::Vacant(e) = skins.entry(s) {
                    e.insert(skin::Skin::new(&document, &nodes, s, node)?);
                }
                skins.get(&s)
            }
        };
        let own = skin.is_some() || json.weights.is_some();
        if let Some(primitives) = shared.get(&mesh).filter(|_| !own) {
            let transform = nodes.world(node);
            scene.instances.extend(primitives.iter().map(|&primitive| Instance { primitive, transform }));
            continue;
        }
        let context = geometry::Context { document: &document, weights: json.weights.as_deref(), skin };
        let loaded = geometry::mesh(&context, mesh, node, &mut budget, &mut scene.warnings)?;
        // A skin places the vertices in the world itself; the node's own transform is ignored by the specification.
        let transform = if skin.is_some() { glam::Affine3A::IDENTITY } else { nodes.world(node) };
        let first = scene.primitives.len();
        for (mesh, material) in loaded {
            let material = materials.index(&document, material, &mut scene, &mut textures)?;
            scene.instances.push(Instance { primitive: scene.primitives.len(), transform });
            scene.primitives.push(Primitive { mesh, material });
        }
        if !own {
            shared.insert(mesh, (first..scene.primitives.len()).collect());
        }
    }
    scene.images = textures.decode()?;
    Ok(scene)
}

/// Materials in the order of their first use.
#[derive(Debug, Default)]
struct Materials {
    index: HashMap<Option<usize>, usize>,
}

impl Materials {
    fn index<'a>(
        &mut self,
        document: &'a Document<'_>,
        material: Option<usize>,
        scene: &mut Scene,
        textures: &mut Textures<'a>,
    ) -> Result<usize, Fault> {
        if let Some(&i) = self.index.get(&material) {
            return Ok(i);
        }
        let value = match material {
            None => Material { name: "default".into(), ..Material::default() },
            Some(m) => material::read(document, m, textures, &mut scene.warnings)?,
        };
        scene.materials.push(value);
        self.index.insert(material, scene.materials.len() - 1);
        Ok(scene.materials.len() - 1)
    }
}
