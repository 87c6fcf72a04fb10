//! What the fit of a light animated asset starts from: its mesh at rest with maps baked from the reference.

use crate::bake::{BakeSettings, ReferenceSurface, Target, bake, blank_texel};
use crate::candidate::{Candidate, Vertices};
use crate::engine::Normalised;
use crate::visibility::Visibility;
use crate::{FitError, Progress};
use photofit_geometry::weld::weld_rows;
use photofit_geometry::{Mesh, Weld};
use photofit_raster::Maps;
use photofit_scalar::Vec3f;
use photofit_scene::FlatScene;
use std::ops::ControlFlow;

/// Warns where vertex normals of one asset point to the back of its triangles and those of the other do not; `turned` says
/// of which triangles of the light asset they do.
pub(super) fn warn_of_normals(
    n: &Normalised,
    (rest, turned): (&FlatScene, &[bool]),
    progress: &dyn Progress,
) {
    let count = |opposed: &[bool]| opposed.iter().filter(|o| **o).count();
    let [theirs, own] = [(n.opposed(), &n.flat.mesh), (turned, &rest.mesh)]
        .map(|(opposed, mesh)| [count(opposed), mesh.triangles.len()]);
    let kinds = |[opposed, all]: [usize; 2]| [opposed > 0, opposed < all];
    if kinds(theirs) != kinds(own) {
        let told = |[opposed, all]: [usize; 2]| format!("{opposed} of {all} triangles");
        progress.warn(&format!(
            "vertex normals point to the back of {} of the reference and of {} of the light asset: no map turns normals that \
             far, so that the light asset is shaded from the other side where they differ",
            told(theirs),
            told(own)
        ));
    }
}

/// The light asset at rest with blank maps.
pub(super) fn candidate(n: &Normalised, rest: &FlatScene, size: usize) -> Result<Candidate, FitError> {
    let mut kinds = n.triangle_classes();
    kinds.sort_unstable();
    kinds.dedup();
    let [kind] = kinds[..] else {
        let rule = format!("has materials of {} kinds; they must be of one", kinds.len());
        return Err(FitError::Setting { field: "reference_asset", rule });
    };
    let mesh = &rest.mesh;
    let row = |v: usize| {
        let (p, n) = (mesh.positions[v], mesh.normals[v]);
        [p.x, p.y, p.z, n.x, n.y, n.z]
    };
    let rows: Vec<f32> = (0..mesh.positions.len()).flat_map(row).collect();
    let smoothing: Weld = weld_rows(&rows, 6);
    let maps = Maps::filled(size, size, blank_texel());
    Ok(Candidate::new(
        mesh,
        &smoothing,
        vec![kind; mesh.triangles.len()],
        n.light_asset.drawn_classes(),
        maps,
    ))
}

/// Maps of the reference at rest onto these vertices, and the mean distance to it. Rays go along `directions` of the vertices,
/// where they are not their normals.
pub(super) fn baked(
    n: &Normalised,
    (rays, seen): (&ReferenceSurface<'_>, &Visibility),
    candidate: &Candidate,
    (vertices, directions): (Vertices, Option<&[Vec3f]>),
    progress: &dyn Progress,
) -> Result<(Maps, f64), FitError> {
    let mesh = Mesh {
        positions: vertices.positions,
        normals: vertices.normals,
        tangents: vertices.tangents,
        uvs: candidate.uvs.clone(),
        triangles: candidate.triangles.clone(),
        ..Mesh::default()
    };
    let base = &candidate.maps.levels[0];
    let settings = BakeSettings { width: base.width, height: base.height, ..BakeSettings::default() };
    let heard = |share: f32| {
        progress.report("bake", (share * 1000.0) as u64, 1000, n.light_asset.name.as_str());
        if progress.is_cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    let target = Target { directions, ..Target::new(&mesh) };
    let mut baked = bake(rays, seen, &target, &settings, &heard).map_err(|e| match e {
        crate::bake::BakeError::Stopped => FitError::Interrupted,
        e => e.into(),
    })?;
    baked.fill(None);
    Ok((baked.maps, baked.statistics.mean_distance))
}
