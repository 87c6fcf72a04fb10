//! A mesh as a surface that can be fitted: an atlas, creases, and blank maps.

use crate::bake::{ReferenceSurface, blank_texel, hard_edges, own_creases};
use crate::candidate::{Candidate, SurfaceClass};
use crate::visibility::Visibility;
use crate::{FitError, Progress};
use photofit_geometry::atlas::{AtlasError, UnwrapOptions, unwrap};
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
    let atlas = unwrap(&mesh.positions, &mesh.triangles, &class, &settings).map_err(advised)?;
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

/// The error of an atlas, with the setting that mends it.
fn advised(error: AtlasError) -> FitError {
    let AtlasError::TooManyCharts { charts, size } = error else { return error.into() };
    // Pieces of a few texels each, with room between them.
    let side = (4.0 * (charts as f64).sqrt()) as usize;
    let rule = format!(
        "is {size}, and the {charts} pieces of the atlas find no room: it must be larger, such as {}, or the triangles fewer",
        side.next_power_of_two()
    );
    FitError::Setting { field: "texture_size", rule }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Silent;
    use photofit_scalar::vec3;

    #[test]
    fn too_many_pieces_are_told_with_a_size_that_holds_them() {
        let mut mesh = Mesh::default();
        for k in 0..600_u32 {
            let x = 3.0 * k as f32;
            mesh.positions.extend([vec3(x, 0.0, 0.0), vec3(x + 1.0, 0.0, 0.0), vec3(x, 1.0, 0.0)]);
            mesh.triangles.push([3 * k, 3 * k + 1, 3 * k + 2]);
        }
        let made = |size| {
            let classes = vec![SurfaceClass::default()];
            unwrapped(&mesh, None, vec![0; mesh.triangles.len()], classes, size, &Silent)
        };
        let told = made(16).unwrap_err().to_string();
        assert!(told.contains("texture_size is 16") && told.contains("600 pieces"), "{told}");
        assert!(told.contains("such as 128, or the triangles fewer"), "{told}");
        assert!(made(128).is_ok(), "the size that is told holds them");
    }
}
