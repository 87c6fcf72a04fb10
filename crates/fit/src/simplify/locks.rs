//! Vertices on open borders that stay where they are: those of one part of a larger asset meet their neighbours.

use super::Normalised;
use photofit_geometry::decimate::Decimated;
use photofit_scalar::Vec3f;
use photofit_scene::Scene;
use std::collections::{HashMap, HashSet};

/// A position as a key.
pub(super) fn bits(p: Vec3f) -> [u32; 3] {
    p.to_array().map(f32::to_bits)
}

/// The positions that a decimation has locked.
pub(super) fn locked(d: &Decimated) -> HashSet<[u32; 3]> {
    d.mesh.positions.iter().zip(&d.locked).filter(|(_, locked)| **locked).map(|(p, _)| bits(*p)).collect()
}

/// Gives the vertices of a light asset that did not move the positions of the asset: the way to the frame of the fit and back
/// rounds them.
pub(super) fn restore(light: &mut Scene, scene: &Scene, n: &Normalised) {
    let own = scene.flatten().mesh.positions;
    let back = |p: &Vec3f| bits(n.frame().to_world(*p));
    let exact: HashMap<[u32; 3], Vec3f> = n.flat.mesh.positions.iter().map(back).zip(own).collect();
    for p in light.primitives.iter_mut().flat_map(|p| &mut p.mesh.positions) {
        *p = exact.get(&bits(*p)).copied().unwrap_or(*p);
    }
}
