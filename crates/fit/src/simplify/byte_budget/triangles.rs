//! The triangles that bytes hold.

use crate::FitError;
use crate::simplify::FEWEST;
use photofit_scene::{Compression, Material, Scene, to_glb_with};

/// Part of a file's bytes that geometry may take where the budget of triangles follows from bytes: a convention, which no
/// measurement chose.
const GEOMETRY: f64 = 0.5;
/// Other parts that the asset's own textures are tried with, which cost no fit.
const OTHER_PARTS: [f64; 3] = [0.25, 0.75, 0.9];
/// Share of its bytes that a decimation may leave unused, and decimations that come nearer to them at most.
const UNUSED: f64 = 0.02;
const CORRECTIONS: usize = 4;

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

/// Other decimations of an asset of `all` triangles than `first`, with the same textures, for a file of `most` bytes: those whose
/// geometry takes each of [`OTHER_PARTS`] of it, or all of it where nothing has textures. `bytes` are those of a file of a decimation
/// without its textures.
///
/// # Errors
/// As `decimated` and `bytes`.
pub(in crate::simplify) fn others(
    (first, all): (&Scene, usize),
    most: u64,
    decimated: &dyn Fn(usize) -> Result<Scene, FitError>,
    bytes: &dyn Fn(&Scene) -> Result<u64, FitError>,
) -> Result<Vec<Scene>, FitError> {
    let parts = if first.images.is_empty() { &[1.0][..] } else { &OTHER_PARTS };
    let start = [first.triangle_count() as f64, bytes(first)? as f64];
    let mut out: Vec<Scene> = Vec::new();
    for part in parts {
        let room = part * most as f64;
        // Bytes are a line of triangles: at first through none, then through the last two decimations.
        let (mut before, mut last, mut best) = ([0.0; 2], start, None::<Scene>);
        for _ in 0..CORRECTIONS {
            let slope = (last[0] - before[0]) / (last[1] - before[1]);
            let aimed = last[0] + slope * ((1.0 - UNUSED / 2.0) * room - last[1]);
            let triangles = (aimed.max(0.0) as usize).clamp(FEWEST.min(all), all);
            if !slope.is_finite() || triangles as f64 == last[0] {
                break;
            }
            let made = decimated(triangles)?;
            (before, last) = (last, [made.triangle_count() as f64, bytes(&made)? as f64]);
            let more = |b: &Scene| made.triangle_count() > b.triangle_count();
            if last[1] <= room && best.as_ref().is_none_or(more) {
                best = Some(made);
            }
            if last[1] <= room && (last[1] >= (1.0 - UNUSED) * room || triangles == all) {
                break;
            }
        }
        let known = |s: &Scene| s.triangle_count() == best.as_ref().map_or(0, Scene::triangle_count);
        if first.triangle_count() != best.as_ref().map_or(0, Scene::triangle_count) && !out.iter().any(known)
        {
            out.extend(best);
        }
    }
    Ok(out)
}

/// Bytes of the file of a scene without its textures.
///
/// # Errors
/// If it cannot be written.
pub(in crate::simplify) fn bytes_without_textures(
    scene: &Scene,
    compression: Compression,
) -> Result<u64, FitError> {
    Ok(match scene.images.is_empty() {
        true => to_glb_with(scene, compression)?.len() as u64,
        false => geometry(scene, compression)?[1] as u64,
    })
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
