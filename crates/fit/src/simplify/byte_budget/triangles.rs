//! The triangles that bytes hold.

use crate::FitError;
use crate::simplify::FEWEST;
use photofit_scene::{Compression, Material, Scene, to_glb_with};

/// Part of a file's bytes that geometry may take where the budget of triangles follows from bytes: a convention, which no
/// measurement chose.
const GEOMETRY: f64 = 0.5;
/// Other parts that the asset's own textures are tried with, which cost no fit: in even steps.
const OTHER_PARTS: [f64; 2] = [0.25, 0.75];

/// The triangles of an asset that a file of `most` bytes holds: all where the asset as it is fits, and otherwise as many as
/// take [`GEOMETRY`] of it. Bytes are taken to follow the number of triangles, each instance with its own.
///
/// # Errors
/// If the geometry cannot be written.
pub(in crate::simplify) fn triangles_within(
    scene: &Scene,
    most: u64,
    compression: Compression,
) -> Result<usize, FitError> {
    let [geometry, stored] = geometry(scene, compression)?;
    let textures = to_glb_with(scene, compression)?.len() as f64 - stored;
    if geometry + textures <= most as f64 {
        return Ok(scene.triangle_count().max(1));
    }
    Ok(triangles_in(scene, GEOMETRY * most as f64, geometry))
}

/// Other numbers of triangles than `first` that the asset's own textures are tried with within a file of `most` bytes: as many as take
/// each of [`OTHER_PARTS`] of it.
///
/// # Errors
/// If the geometry cannot be written.
pub(in crate::simplify) fn other_triangles(
    scene: &Scene,
    (most, first): (u64, usize),
    compression: Compression,
) -> Result<Vec<usize>, FitError> {
    let [geometry, _] = geometry(scene, compression)?;
    let mut all = OTHER_PARTS.map(|part| triangles_in(scene, part * most as f64, geometry)).to_vec();
    all.dedup();
    all.retain(|n| *n != first);
    Ok(all)
}

/// Bytes of the geometry of a scene, each instance with its own, and of what is stored of it.
pub(super) fn geometry(scene: &Scene, compression: Compression) -> Result<[f64; 2], FitError> {
    let mut bare = scene.clone();
    bare.materials.iter_mut().for_each(|m| *m = Material::default());
    bare.images.clear();
    let shared: usize = scene.primitives.iter().map(|p| p.mesh.triangles.len()).sum();
    let stored = to_glb_with(&bare, compression)?.len() as f64;
    Ok([stored * (scene.triangle_count() as f64 / shared.max(1) as f64).max(1.0), stored])
}

/// The triangles of a scene that so many bytes hold, where all take `geometry`.
fn triangles_in(scene: &Scene, bytes: f64, geometry: f64) -> usize {
    let all = scene.triangle_count().max(1);
    ((all as f64 * bytes / geometry) as usize).clamp(FEWEST.min(all), all)
}
