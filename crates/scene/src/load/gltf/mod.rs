//! glTF 2.0: `.glb` containers and `.gltf` with external or embedded buffers.

mod accessor;
mod animation;
mod compressed;
mod container;
mod document;
mod draco;
mod extensions;
mod geometry;
mod instancing;
mod inventory;
mod lights;
mod material;
mod nodes;
mod skin;

pub(crate) use geometry::strip;

use super::file::{Folder, clip};
use super::texture::Textures;
use super::{Budget, Limits, normals};
use crate::error::{Fault, fault};
use crate::nodes::{Hierarchy, Lens, NodeMesh, NodePrimitive, Placement};
use crate::skin::Skin;
use crate::{Instance, MAX_COORDINATE, Material, Primitive, Scene, VertexAttribute};
use document::Document;
use geometry::{Attributes, Part};
use glam::Affine3A;
use gltf::json::animation::Property;
use gltf::json::validation::Checked;
use photofit_geometry::Mesh;
use std::collections::hash_map::Entry;
use std::collections::{BTreeSet, HashMap, HashSet};
use std::sync::Arc;

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
    let document = Document::new(json, binary, folder, limits, &mut scene)?;
    // Of those that nothing uses, too, no output may take the place.
    let images = document.root.images.iter().filter_map(|i| i.uri.as_deref());
    images.chain(document.root.buffers.iter().filter_map(|b| b.uri.as_deref())).for_each(|uri| {
        folder.notes_uri(uri);
    });
    scene.about = document.about()?;
    let mut hierarchy = nodes::read(&document, &mut scene.warnings)?;
    hierarchy.skins = (0..document.root.skins.len())
        .map(|s| skin::read(&document, s).and_then(|skin| check_skin(skin, s, hierarchy.nodes.len())))
        .collect::<Result<_, Fault>>()?;
    let mut textures = Textures::new(limits);
    place_meshes(&document, &mut hierarchy, &mut scene, &mut textures)?;
    hierarchy.animations = animation::read(&document, &hierarchy, &mut scene.warnings)?;
    let world = hierarchy.worlds(&hierarchy.locals());
    (scene.cameras, scene.lights) = hierarchy.cameras_and_lights(&world);
    for (c, camera) in hierarchy.cameras.iter().enumerate() {
        if matches!(camera.lens, Lens::Orthographic { .. }) {
            scene.warnings.push(format!("camera {c} is not a perspective one and is left out"));
        }
    }
    for light in &scene.lights {
        if !(light.position.is_finite() && light.position.abs().max_element() <= MAX_COORDINATE) {
            let rule =
                format!("stands at {}; coordinates must be at most {MAX_COORDINATE:e}", light.position);
            return Err(fault(format!("light `{}`", clip(&light.name)), rule));
        }
    }
    let data: HashSet<usize> = scene.materials.iter().flat_map(Material::data).collect();
    scene.images = textures.decode(&data, &mut scene.warnings)?;
    scene.hierarchy = Some(Arc::new(hierarchy));
    scene.ignored_extras = document.extras.saturating_sub(scene.extras());
    if scene.ignored_extras > 0 {
        let what = "application data (extras) of objects that a scene has no place for, or does not show, are ignored";
        scene.warnings.push(format!("{what}: {}", scene.ignored_extras));
    }
    Ok(scene)
}

fn check_skin(skin: Skin, s: usize, nodes: usize) -> Result<Skin, Fault> {
    skin.check(nodes).map_err(|rule| fault(format!("skin {s}"), rule))?;
    Ok(skin)
}

/// Reads the meshes of the nodes that are shown and places them in their default pose; the nodes then name them by their
/// places in the hierarchy.
fn place_meshes<'a>(
    document: &'a Document<'_>,
    hierarchy: &mut Hierarchy,
    scene: &mut Scene,
    textures: &mut Textures<'a>,
) -> Result<(), Fault> {
    let world = hierarchy.worlds(&hierarchy.locals());
    let joints: Vec<_> = hierarchy.skins.iter().map(|s| s.matrices(&world)).collect();
    let moving = moving_weights(document);
    let mut materials = Materials::default();
    let mut budget = Budget::new(document.limits);
    let wanted: Vec<Option<usize>> = hierarchy.nodes.iter_mut().map(|n| n.mesh.take()).collect();
    let mut known: HashMap<usize, Known> = HashMap::new();
    let shown = hierarchy.shown();
    let mut ignored = BTreeSet::new();
    let meshes = wanted.iter().flatten().count();
    let hidden = meshes - shown.iter().filter(|&&n| wanted[n].is_some()).count();
    if hidden > 0 {
        let rule = "of nodes outside of the default scene are left out";
        scene.warnings.push(format!("{hidden} of {meshes} meshes {rule}"));
    }
    for node in shown {
        let Some(m) = wanted[node] else { continue };
        let there = document.root.meshes.len();
        let Some(json) = document.root.meshes.get(m) else {
            return Err(fault(format!("node {node}"), format!("names mesh {m}; there are {there} meshes")));
        };
        if let Some(s) = hierarchy.nodes[node].skin.filter(|&s| s >= joints.len()) {
            let rule = format!("names skin {s}; there are {} skins", joints.len());
            return Err(fault(format!("node {node}"), rule));
        }
        let known = match known.entry(m) {
            Entry::Occupied(e) => e.into_mut(),
            Entry::Vacant(e) => {
                let parts = geometry::mesh(document, m, &mut budget, &mut scene.warnings, &mut ignored)?;
                let (mesh, known) =
                    read_mesh(document, m, json, parts, &mut materials, &mut budget, scene, textures)?;
                hierarchy.meshes.push(mesh);
                e.insert(Known { mesh: hierarchy.meshes.len() - 1, ..known })
            }
        };
        let (mesh, json) = (&mut hierarchy.meshes[known.mesh], &mut hierarchy.nodes[node]);
        json.mesh = Some(known.mesh);
        let own_pose = json.skin.is_some() || !json.weights.is_empty() || moving.contains(&node);
        let weights = if json.weights.is_empty() { &mesh.weights } else { &json.weights };
        let matrices = json.skin.map(|s| joints[s].as_slice());
        for (part, of_mesh) in mesh.primitives.iter_mut().enumerate() {
            let place = || format!("node {node} primitive {part}");
            if let Some(matrices) = matrices {
                let bind = of_mesh.bind.as_ref().filter(|b| !b.influences.is_empty());
                let bind = bind.ok_or_else(|| fault(place(), UNBOUND))?;
                bind.check_joints(matrices.len()).map_err(|rule| fault(place(), rule))?;
            }
            let primitive = match (known.shared[part], &of_mesh.bind) {
                (Some(shared), bind) if bind.is_none() || !own_pose => shared,
                (_, bind) => {
                    let bind = bind.as_ref().ok_or_else(|| fault(place(), UNBOUND))?;
                    budget.vertices(bind.posed_vertices() as u64, place)?;
                    let mesh = bind.posed(weights, matrices);
                    let of = &known.attributes[part];
                    budget.vertices((of.len() * mesh.positions.len()) as u64, place)?;
                    let attributes = corner_values(of, &bind.mesh, &mesh);
                    let computed = bind.mesh.normals.is_empty();
                    add(scene, Primitive { mesh, material: known.materials[part] }, computed, attributes)
                }
            };
            if known.shared[part].is_none() && !own_pose {
                known.shared[part] = Some(primitive);
            }
            if !std::mem::replace(&mut known.placed[part], true) {
                of_mesh.primitive = primitive;
            }
            // A skin places the vertices in the world itself; the specification ignores the node's own transform.
            let transform = if json.skin.is_some() { Affine3A::IDENTITY } else { world[node] };
            scene.instances.push(Instance { primitive, transform });
            hierarchy.placements.push(Placement { node, part });
        }
        if scene.instances.len() > document.limits.instances {
            let rule =
                format!("places more than {} primitives; that many are accepted", document.limits.instances);
            return Err(fault(format!("node {node}"), rule));
        }
    }
    scene.ignored_attributes = ignored.into_iter().collect();
    Ok(())
}

const UNBOUND: &str = "has a skin without JOINTS_0 and WEIGHTS_0; it must have both";

/// Nodes whose morph weights are animated.
fn moving_weights(document: &Document<'_>) -> HashSet<usize> {
    let channels = document.root.animations.iter().flat_map(|a| &a.channels);
    let weights = Checked::Valid(Property::MorphTargetWeights);
    channels.filter(|c| c.target.path == weights).map(|c| c.target.node.value()).collect()
}

/// A mesh of the file that has been read; one entry for each of its parts.
#[derive(Debug, Default)]
struct Known {
    /// Its place in the hierarchy.
    mesh: usize,
    materials: Vec<usize>,
    /// The primitive of nodes without a pose of their own, once there is one.
    shared: Vec<Option<usize>>,
    /// The part has been placed.
    placed: Vec<bool>,
    /// Attributes of the vertices of parts that deform.
    attributes: Vec<Attributes>,
}

/// A mesh of the file; its rigid parts become primitives.
fn read_mesh<'a>(
    document: &'a Document<'_>,
    m: usize,
    json: &gltf::json::Mesh,
    parts: Vec<Part>,
    materials: &mut Materials,
    budget: &mut Budget<'_>,
    scene: &mut Scene,
    textures: &mut Textures<'a>,
) -> Result<(NodeMesh, Known), Fault> {
    let weights = json.weights.clone().unwrap_or_default();
    if let Some(w) = weights.iter().find(|w| !w.is_finite()) {
        return Err(fault(format!("mesh {m}"), format!("has the weight {w}; weights must be finite")));
    }
    let mut primitives = Vec::with_capacity(parts.len());
    let mut known = Known { placed: vec![false; parts.len()], ..Known::default() };
    for (p, Part { bind, material, extras, attributes }) in parts.into_iter().enumerate() {
        let place = || format!("mesh {m} primitive {p}");
        let material = materials.index(document, material, scene, textures)?;
        bind.check().map_err(|rule| fault(place(), rule))?;
        let deforms = !(bind.influences.is_empty() && bind.targets.is_empty());
        known.materials.push(material);
        known.shared.push((!deforms).then_some(scene.primitives.len()));
        if deforms {
            known.attributes.push(attributes);
            primitives.push(NodePrimitive { primitive: 0, bind: Some(bind), extras });
            continue;
        }
        known.attributes.push(Attributes::new());
        let computed = bind.mesh.normals.is_empty();
        let (mesh, attributes) = if computed {
            budget.vertices(bind.posed_vertices() as u64, place)?;
            let mesh = normals::flat(&bind.mesh);
            let attributes = corner_values(&attributes, &bind.mesh, &mesh);
            (mesh, attributes)
        } else {
            (bind.mesh, attributes)
        };
        primitives.push(NodePrimitive { primitive: scene.primitives.len(), bind: None, extras });
        add(scene, Primitive { mesh, material }, computed, attributes);
    }
    let extras = document.extras(&json.extras, || format!("mesh {m}"))?;
    Ok((NodeMesh { name: json.name.clone().unwrap_or_default(), extras, weights, primitives }, known))
}

/// Adds a primitive, whose normals may be computed, with the attributes of its vertices; its index.
fn add(scene: &mut Scene, primitive: Primitive, computed: bool, attributes: Attributes) -> usize {
    let index = scene.primitives.len();
    scene.computed_normals.extend(computed.then_some(index));
    let of = |(name, values)| VertexAttribute { name, primitive: index, values };
    scene.vertex_attributes.extend(attributes.into_iter().map(of));
    scene.primitives.push(primitive);
    index
}

/// The attributes of the vertices of `from` for `mesh`, which has the same vertices, or one for each corner where faces have
/// normals of their own.
fn corner_values(attributes: &Attributes, from: &Mesh, mesh: &Mesh) -> Attributes {
    if from.positions.len() == mesh.positions.len() && from.triangles == mesh.triangles {
        return attributes.clone();
    }
    let corners = |values: &[f32]| from.triangles.iter().flatten().map(|v| values[*v as usize]).collect();
    attributes.iter().map(|(name, values)| (name.clone(), corners(values))).collect()
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
