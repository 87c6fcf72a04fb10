//! An asset prepared for fits.

use super::prepare;
use crate::bake;
use crate::engine::Normalised;
use crate::engine::classes::apart_by_scale;
use crate::visibility::Visibility;
use crate::{FitError, Progress};
use photofit_scene::Scene;

/// An asset with what every fit of it needs.
#[derive(Clone, Copy)]
pub(crate) struct Asset<'a> {
    /// As it was given.
    pub(crate) given: &'a Scene,
    /// The same where glass of several scales has a material for each: [`apart_by_scale`].
    pub(crate) scene: &'a Scene,
    pub(crate) n: &'a Normalised,
    pub(super) rays: &'a bake::ReferenceSurface<'a>,
    pub(super) visibility: &'a Visibility,
}

/// Runs `work` with an asset prepared for fits.
pub(crate) fn with_asset<R>(
    scene: &Scene,
    progress: &dyn Progress,
    work: impl FnOnce(Asset<'_>) -> Result<R, FitError>,
) -> Result<R, FitError> {
    scene.validate_for_fit()?;
    let given = scene;
    let scene = &*apart_by_scale(scene);
    let (n, opposed) = Normalised::new(scene)?.with_opposed_normals();
    if opposed > 0 {
        let of = n.flat.mesh.triangles.len();
        progress.warn(&format!(
            "the vertex normals of {opposed} of {of} triangles point to their back, so that they are shaded dark: the \
             light asset is made to look the same"
        ));
    }
    let rays = n.surface()?;
    let visibility = prepare::visibility(&rays, progress)?;
    let _told = n.not_finite.told_at_the_end(progress);
    work(Asset { given, scene, n: &n, rays: &rays, visibility: &visibility })
}
