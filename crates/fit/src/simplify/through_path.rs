//! The second fit of a simplification whose maps are fitted through the path tracer.

use super::{Asset, FitRenderer, SimplifyOptions, Written};
use crate::Progress;
use crate::engine::chain::fit_after_another;
use crate::engine::checkpoint;
use crate::engine::trainer::Keeping;
use crate::traced_maps::{MapsCourse, TracedMapsOptions, traced_maps};
use photofit_scene::Scene;
use std::time::Duration;

/// Folder of its checkpoint in that of the fit by the rasterizer.
pub const TRACED_FOLDER: &str = "traced-maps";
/// Most steps.
const STEPS: u64 = 150;
/// Widest pictures, pixels.
const WIDEST: usize = 192;

/// What comes before any work: unless the fit goes on from checkpoints, that of an earlier one is set aside, so that a fit
/// which is stopped before this one begins and goes on later does not meet it.
pub(super) fn begin(options: &SimplifyOptions, progress: &dyn Progress) {
    if let Some(folder) = options.checkpoint.as_ref().filter(|_| !options.resume) {
        checkpoint::set_aside(&folder.join(TRACED_FOLDER), progress);
    }
}

/// Where the fit before this one keeps its state, and how long it may take: half of the time, where this one follows.
pub(super) fn keeping_before(options: &SimplifyOptions) -> Keeping {
    let keeping = options.keeping();
    let share = if options.fit_with == FitRenderer::Path { 2 } else { 1 };
    Keeping { time_limit: keeping.time_limit.map(|limit| limit / share), ..keeping }
}

/// What is to be written, with its maps fitted through the path tracer where that is asked for and time is left. What
/// fails is told, and the maps stay as they are.
pub(super) fn fit_maps(
    asset: Asset<'_>,
    light: Scene,
    (written, stopped, spent): (Written, bool, Duration),
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> (Scene, Option<MapsCourse>) {
    if options.fit_with == FitRenderer::Raster || options.steps == 0 || progress.is_cancelled() {
        return (light, None);
    }
    let mut fit = fit_options(options, spent);
    // A fit that the time limit ended goes on first, and these maps would follow from another shape then.
    if stopped && fit.keeping.checkpoint.is_some() {
        progress.warn(
            "its maps are not fitted through the path tracer: the fit before was ended by the time limit",
        );
        return (light, None);
    }
    // Texture coordinates of the asset's own may show one texel in many places.
    fit.new_map = fit.new_map.filter(|_| written != Written::Decimated);
    let made = fit_after_another(fit.keeping.clone(), progress, |keeping| {
        fit.keeping.clone_from(keeping);
        traced_maps(asset.scene, asset.n, &light, &fit, progress)
    });
    match made {
        // Written again they would be rounded, too.
        Ok(made) if !made.course.gained() => {
            progress.warn("no maps fitted through the path tracer looked better: those before are written");
            (light, Some(made.course))
        }
        Ok(made) => (made.light, Some(made.course)),
        Err(e) => {
            progress.warn(&format!("its maps are not fitted through the path tracer: {e}"));
            (light, None)
        }
    }
}

/// The options of the fit, in what is left of the time.
fn fit_options(o: &SimplifyOptions, spent: Duration) -> TracedMapsOptions {
    TracedMapsOptions {
        steps: o.steps.min(STEPS),
        size: o.picture_size().clamp(16, WIDEST),
        new_map: Some(o.texture_size),
        lighting: o.lighting.clone(),
        seed: o.seed,
        keeping: Keeping {
            checkpoint: o.checkpoint.as_ref().map(|folder| folder.join(TRACED_FOLDER)),
            resume: o.resume,
            time_limit: o.time_limit.map(|limit| limit.saturating_sub(spent)),
        },
        ..TracedMapsOptions::default()
    }
}
