//! The triangles that bytes hold.

use super::coarsest;
use crate::FitError;
use crate::simplify::MIN_TRIANGLES;
use photofit_scene::{Compression, Scene, TextureImage, to_glb_with};

/// Part of a file's bytes that geometry may take where the budget of triangles follows from bytes: a convention, which no
/// measurement chose.
pub(super) const GEOMETRY: f64 = 0.5;
/// Other parts that the asset's own textures, and starts of a fit, are tried with.
pub(super) const OTHER_PARTS: [f64; 3] = [0.25, 0.75, 0.9];
/// Share of its bytes that a decimation may leave unused, and decimations that come nearer to them at most.
const UNUSED: f64 = 0.02;
const CORRECTIONS: usize = 4;

/// Whether an asset as it is fits into a file of `most` bytes, in the coarsest precision that geometry may have.
///
/// # Errors
/// If it cannot be written.
pub(in crate::simplify) fn fits(
    scene: &Scene,
    most: u64,
    compression: Compression,
) -> Result<bool, FitError> {
    Ok(to_glb_with(scene, coarsest(compression))?.len() as u64 <= most)
}

/// The triangles of an asset that a file of `most` bytes holds: all where the asset as it is fits, and otherwise as many as
/// take [`GEOMETRY`] of it, in the coarsest precision that geometry may have. Bytes are taken to follow the number of triangles, each
/// instance with its own.
///
/// # Errors
/// If the geometry cannot be written.
pub(in crate::simplify) fn triangles_within(
    scene: &Scene,
    most: u64,
    compression: Compression,
) -> Result<usize, FitError> {
    let compression = coarsest(compression);
    let [geometry, stored] = geometry(scene, compression)?;
    let textures = to_glb_with(scene, compression)?.len() as f64 - stored;
    if geometry + textures <= most as f64 {
        return Ok(scene.triangle_count().max(1));
    }
    Ok(triangles_in(scene, GEOMETRY * most as f64, geometry))
}

/// Gives `add` other decimations of an asset of `all` triangles than `first`, with the same textures, for a file of `most` bytes: those
/// whose geometry takes each of [`OTHER_PARTS`] of it, or all of it where nothing has textures. With decimations come the bytes that
/// their file has without textures. Work that is to `stop` makes no more of them.
///
/// # Errors
/// As `decimated`.
pub(in crate::simplify) fn others(
    (first, bytes, all): (&Scene, u64, usize),
    most: u64,
    decimated: &dyn Fn(usize) -> Result<(Scene, u64), FitError>,
    stop: &dyn Fn() -> bool,
    add: &mut dyn FnMut(Scene),
) -> Result<(), FitError> {
    let parts = if first.images.is_empty() { &[1.0][..] } else { &OTHER_PARTS };
    let start = [first.triangle_count() as f64, bytes as f64];
    let mut known = vec![first.triangle_count()];
    for part in parts {
        let sized = |triangles: usize| {
            let (made, bytes) = decimated(triangles)?;
            let size = [made.triangle_count() as f64, bytes as f64];
            Ok((made, size))
        };
        let best = nearest([[0.0; 2], start], (part * most as f64, UNUSED), all, &sized, stop)?;
        if let Some(best) = best.filter(|b| !known.contains(&b.triangle_count())) {
            known.push(best.triangle_count());
            add(best);
        }
    }
    Ok(())
}

/// What `made` makes with most triangles, of at most `all`, in `room` bytes, of which a share may stay unused; `None` where nothing
/// that was tried fits. What is made comes with its triangles and bytes, as they are `known` of two others. Work that is to `stop` makes
/// no more.
///
/// # Errors
/// As `made`.
pub(super) fn nearest<T>(
    [mut before, mut last]: [[f64; 2]; 2],
    (room, unused): (f64, f64),
    all: usize,
    made: &dyn Fn(usize) -> Result<(T, [f64; 2]), FitError>,
    stop: &dyn Fn() -> bool,
) -> Result<Option<T>, FitError> {
    // Bytes are a line of triangles, through the last two that were made.
    let mut best = None::<(T, f64)>;
    for _ in 0..CORRECTIONS {
        let slope = (last[0] - before[0]) / (last[1] - before[1]);
        let aimed = last[0] + slope * ((1.0 - unused / 2.0) * room - last[1]);
        let triangles = (aimed.max(0.0) as usize).clamp(MIN_TRIANGLES.min(all), all);
        if !slope.is_finite() || triangles as f64 == last[0] || stop() {
            break;
        }
        let (made, size) = made(triangles)?;
        (before, last) = (last, size);
        let fits = last[1] <= room;
        if fits && best.as_ref().is_none_or(|b| last[0] > b.1) {
            best = Some((made, last[0]));
        }
        if fits && (last[1] >= (1.0 - unused) * room || triangles == all) {
            break;
        }
    }
    Ok(best.map(|b| b.0))
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

/// Bytes of the geometry of a scene, each instance with its own, and of what is stored of it. Materials count in, which say what is stored
/// of vertices; their images, which may be left out, count with a texel each.
pub(super) fn geometry(scene: &Scene, compression: Compression) -> Result<[f64; 2], FitError> {
    let images = scene.materials.iter().flat_map(|m| m.texture_slots()).map(|slot| slot.image + 1).max();
    let texel = |k: usize| {
        let name = scene.images.get(k).map_or_else(String::new, |i| i.name.clone());
        TextureImage { name, width: 1, height: 1, texels: vec![[255; 4]], ..TextureImage::default() }
    };
    let bare = Scene { images: (0..images.unwrap_or(0)).map(texel).collect(), ..scene.clone() };
    let shared: usize = scene.primitives.iter().map(|p| p.mesh.triangles.len()).sum();
    let stored = to_glb_with(&bare, compression)?.len() as f64;
    Ok([stored * (scene.triangle_count() as f64 / shared.max(1) as f64).max(1.0), stored])
}

/// The triangles of a scene that so many bytes hold, where all take `geometry`.
fn triangles_in(scene: &Scene, bytes: f64, geometry: f64) -> usize {
    let all = scene.triangle_count().max(1);
    ((all as f64 * bytes / geometry) as usize).clamp(MIN_TRIANGLES.min(all), all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_geometry::Mesh;
    use photofit_scene::{Instance, Primitive};

    fn scene(triangles: usize, images: usize) -> Scene {
        let mesh = Mesh { triangles: vec![[0; 3]; triangles], ..Mesh::default() };
        Scene {
            primitives: vec![Primitive { mesh, material: 0 }],
            instances: vec![Instance { primitive: 0, transform: glam::Affine3A::IDENTITY }],
            images: vec![TextureImage::default(); images],
            ..Scene::default()
        }
    }

    /// Triangles of what is added to a half of 10,000 bytes of an asset of 1,000 triangles, and decimations made.
    fn added(images: usize, bytes: &dyn Fn(usize) -> u64, stop: bool) -> (Vec<usize>, usize) {
        let (first, made) = (scene(300, images), std::cell::Cell::new(0));
        let decimated = |n: usize| {
            made.set(made.get() + 1);
            Ok((scene(n, images), bytes(n)))
        };
        let mut out = Vec::new();
        let add = &mut |s: Scene| out.push(s.triangle_count());
        others((&first, bytes(300), 1000), 10_000, &decimated, &|| stop, add).unwrap();
        (out, made.get())
    }

    #[test]
    fn triangles_follow_the_bytes_that_decimations_take() {
        // A line, and a curve that bends: all of the bytes, and each part of them where there are textures.
        for bytes in [&(|n: usize| 700 + 15 * n as u64) as &dyn Fn(usize) -> u64, &|n| {
            500 + (70.0 * (n as f64).powf(0.75)) as u64
        }] {
            let (found, made) = added(0, bytes, false);
            let [n] = found[..] else { panic!("{found:?}") };
            assert!((9_800..=10_000).contains(&bytes(n)) && made <= 3, "{} bytes, {made} made", bytes(n));
            let (found, _) = added(2, bytes, false);
            assert_eq!(found.len(), 3);
            for (n, part) in found.iter().zip(OTHER_PARTS) {
                let room = part * 10_000.0;
                let share = bytes(*n) as f64 / room;
                assert!((0.97..=1.0).contains(&share), "{share} of {room}");
            }
        }
        // All triangles fit; bytes that do not fall, that nothing fits into, and work that is stopped.
        assert_eq!(added(0, &|n| 2 * n as u64, false), (vec![1000], 1));
        assert_eq!(added(0, &|_| 20_000, false).0, [0; 0]);
        assert_eq!(added(0, &|n| 30_000 - n as u64, false).0, [0; 0]);
        assert_eq!(added(2, &|n| 15 * n as u64, true), (Vec::new(), 0));
    }
}
