//! The triangles of a fit with maps of its own within a budget of bytes: its geometry is another than that of the asset, with an atlas
//! that splits vertices, so that starts of it are made and measured.

use super::{bytes_without_textures, coarsest, triangles::triangles_of_maps};
use crate::simplify::prepare::{Weights, importance, prepare};
use crate::simplify::{Appearance, Asset, Effort, SimplifyOptions, dressed};
use crate::{FitError, Progress};
use photofit_geometry::decimate::Target;

/// The options with as many triangles as the bytes of the file leave to what is fitted, where they say how many there are.
///
/// # Errors
/// If a start cannot be made or written.
pub(in crate::simplify) fn with_triangles_of_maps(
    asset: Asset<'_>,
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<SimplifyOptions, FitError> {
    let Asset { scene, n, rays, visibility, .. } = asset;
    let Target::Triangles(first) = options.target else { return Ok(options.clone()) };
    let Some(most) =
        options.max_bytes.filter(|_| options.triangles_by_bytes && !options.lacks_nothing(scene))
    else {
        return Ok(options.clone());
    };
    let seen = importance(n, visibility);
    let with = |triangles| SimplifyOptions { target: Target::Triangles(triangles), ..options.clone() };
    let started = |triangles| {
        let weights = (visibility, Weights { decimated: &seen, drawn: &[] });
        // A single one is measured.
        let options = SimplifyOptions { effort: Effort::Fast, ..with(triangles) };
        let start = prepare(n, rays, weights, None, &options, progress)?;
        let light = dressed(options.exported(&start[0].candidate, n), asset, &options);
        Ok((light.triangle_count(), bytes_without_textures(&light, coarsest(options.compression))?))
    };
    let textured = options.appearance == Appearance::Maps;
    let stop = || progress.is_cancelled();
    triangles_of_maps((first, scene.triangle_count()), (most, textured), &started, &stop).map(with)
}
