//! A mesh as a surface that can be fitted: an atlas, creases, and blank maps.

use crate::bake::{ReferenceSurface, blank_texel, hard_edges, own_creases};
use crate::candidate::{Candidate, SurfaceClass};
use crate::visibility::Visibility;
use crate::{FitError, Progress};
use photofit_geometry::atlas::{UnwrapOptions, unwrap};
use photofit_geometry::{Edges, Mesh, normals::split_hard_edges, weld::weld_exact};
use photofit_raster::Maps;

/// Gives a mesh an atlas and hard edges: those of the reference's surface where one is given, else those that its own
/// normals have. Its maps of `size` x `size` texels are blank.
pub(crate) fn unwrapped(
    mesh: &Mesh,
    reference: Option<(&ReferenceSurface<'_>, &Visibility)>,
    class: Vec<u32>,
    classes: Vec<SurfaceClass>,
    size: usize,
    progress: &dyn Progress,
) -> Result<Candidate, FitError> {
    progress.report("atlas", 0, 1, "");
    let settings = UnwrapOptions { size: size as u32, ..UnwrapOptions::default() };
    let atlas = unwrap(&mesh.positions, &mesh.triangles, &class, &settings)?;
    let (unwrapped, _) = atlas.build_mesh(&mesh.positions, &mesh.triangles);
    if progress.is_cancelled() {
        return Err(FitError::Interrupted);
    }
    let weld = weld_exact(&unwrapped.positions);
    let edges = Edges::new(&unwrapped.triangles, &weld);
    let mut hard = match reference {
        Some((reference, seen)) => hard_edges(reference, seen, &unwrapped, &edges),
        None => own_creases(mesh, &edges),
    };
    // Normals of two sides have no mean.
    let opposed = |half: &u32| classes[class[*half as usize / 3] as usize].opposed;
    for (e, hard) in hard.iter_mut().enumerate() {
        let halves = edges.half_edges.row(e);
        *hard |= halves.iter().any(|h| opposed(h) != opposed(&halves[0]));
    }
    let creased = split_hard_edges(&unwrapped.triangles, &weld, &edges, &hard);
    let maps = Maps::filled(size, size, blank_texel());
    let split = creased.split.apply(&unwrapped);
    Ok(Candidate::new(&split, &creased.smoothing, class, classes, maps))
}
