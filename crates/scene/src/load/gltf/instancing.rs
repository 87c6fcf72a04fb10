//! `EXT_mesh_gpu_instancing`: a node that places its mesh many times becomes a node with as many children.

use super::accessor::Need;
use super::document::{Document, Instancing};
use crate::error::{Fault, fault};
use crate::nodes::{Node, NodeTransform};
use glam::{Quat, Vec3};

/// Most nodes that instances may become, and most weights of morph targets that these have together.
const MOST: usize = 1 << 20;

/// Gives every node with instances a child for each, in the order of the file; they take its mesh and weights.
///
/// # Errors
/// If no attribute is one of the extension, if they differ in length, if the node has a skin, or if there are too many.
pub(super) fn expand(document: &Document<'_>, nodes: &mut Vec<Node>) -> Result<(), Fault> {
    let mut left = MOST.min(document.limits.instances);
    for i in 0..nodes.len() {
        let Some(instancing) = document.instancing(i) else { continue };
        let place = || format!("node {i} EXT_mesh_gpu_instancing");
        if nodes[i].skin.is_some() {
            return Err(fault(place(), "belongs to a node with a skin; its node must have none"));
        }
        let transforms = transforms(document, instancing, &place, left)?;
        left -= transforms.len();
        let (mesh, weights) = (nodes[i].mesh.take(), nodes[i].weights.clone());
        let numbers = weights.len().saturating_mul(transforms.len());
        if numbers > MOST {
            let rule = format!("repeats {numbers} weights of morph targets; they may be at most {MOST}");
            return Err(fault(place(), rule));
        }
        let first = nodes.len();
        nodes.extend(transforms.into_iter().map(|transform| Node {
            transform,
            mesh,
            weights: weights.clone(),
            ..Node::default()
        }));
        let children = first..nodes.len();
        nodes[i].children.extend(children);
    }
    Ok(())
}

/// Where the instances of a node stand in it.
fn transforms(
    document: &Document<'_>,
    instancing: &Instancing,
    place: &dyn Fn() -> String,
    most: usize,
) -> Result<Vec<NodeTransform>, Fault> {
    let of = |name: &str| instancing.attributes.get(name).copied();
    let [translation, rotation, scale] = ["TRANSLATION", "ROTATION", "SCALE"].map(of);
    let Some(any) = translation.or(rotation).or(scale) else {
        return Err(fault(place(), "has no attribute TRANSLATION, ROTATION or SCALE; one must be there"));
    };
    let user = place();
    let claimed = document.count(any, &user)?;
    if claimed > most as u64 {
        return Err(fault(place(), format!("places its mesh {claimed} times; that may be at most {most}")));
    }
    for other in [translation, rotation, scale].into_iter().flatten() {
        let count = document.count(other, &user)?;
        if count != claimed {
            let rule = format!("has attributes of {claimed} and of {count} elements; all must have as many");
            return Err(fault(place(), rule));
        }
    }
    let need = Need::Exactly(claimed as usize);
    let vectors = |accessor: Option<usize>, default: [f32; 3]| match accessor {
        Some(a) => document.floats::<3>(a, &user, need),
        None => Ok(vec![default; claimed as usize]),
    };
    let translations = vectors(translation, [0.0; 3])?;
    let scales = vectors(scale, [1.0; 3])?;
    let rotations = match rotation {
        Some(a) => document.floats::<4>(a, &user, need)?,
        None => vec![[0.0, 0.0, 0.0, 1.0]; claimed as usize],
    };
    let parts = translations.into_iter().zip(rotations).zip(scales);
    Ok(parts
        .map(|((translation, rotation), scale)| NodeTransform::Parts {
            translation: Vec3::from_array(translation),
            rotation: Quat::from_array(rotation),
            scale: Vec3::from_array(scale),
        })
        .collect())
}
