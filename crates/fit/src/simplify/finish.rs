//! What is written of what was chosen: with maps fitted through the path tracer where that is asked for, and within the bytes that the
//! file may have.

use super::byte_budget::{Budget, Shapes};
use super::choice::Chosen;
use super::{Asset, SimplifyOptions, Written, dressed, locks, through_path};
use crate::engine::reference::Reference;
use crate::engine::surface::Surface;
use crate::engine::trainer::Trained;
use crate::traced_maps::MapsCourse;
use crate::{FitError, Progress};
use photofit_scene::Scene;
use std::time::Duration;

/// What is written, and how it came about.
pub(super) struct Finished {
    pub(super) trained: Trained<Surface>,
    pub(super) light: Scene,
    pub(super) written: Written,
    /// What was fitted, where something else is written.
    pub(super) fitted: Option<Scene>,
    /// How the fit of the maps through the path tracer went, where there was one.
    pub(super) traced_maps: Option<MapsCourse>,
}

/// What is written of `chosen` and, where the file may have so many bytes only, of the asset with its `own` materials, which was not
/// among what that was chosen from: each is made to fit, and what looks best then is written. `spent` is the time of the fit.
pub(super) fn finish(
    asset: Asset<'_>,
    chosen: Chosen,
    own: Option<&Shapes>,
    spent: Duration,
    reference: &dyn Reference,
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<Finished, FitError> {
    let Asset { scene, n, .. } = asset;
    let Chosen { trained, light: new, written: was, mut fitted } = chosen;
    let with_maps = |light, written| {
        through_path::fit_maps(asset, light, (written, trained.stopped, spent), options, progress)
    };
    let (mut light, written, traced_maps) = match options.max_bytes {
        None => {
            let (light, course) = with_maps(new, was);
            (dressed(light, scene, options), was, course)
        }
        Some(most) => {
            let budget = Budget { most, asset, reference, options, progress };
            within(&budget, (&Shapes::new(new), was), own, &with_maps)?
        }
    };
    if written != was && was == Written::Fitted && trained.steps > 0 {
        fitted = Some(options.exported(&trained.model.candidate, n));
    }
    if options.lock_borders {
        locks::restore(&mut light, scene, n);
    }
    Ok(Finished { trained, light, written, fitted, traced_maps })
}

/// The better of the files within a budget that the asset with `new` maps and that with its `own` materials come to; what that is; and how
/// the fit of its maps `with_maps` went.
fn within(
    budget: &Budget<'_>,
    (new, was): (&Shapes, Written),
    own: Option<&Shapes>,
    with_maps: &dyn Fn(Scene, Written) -> (Scene, Option<MapsCourse>),
) -> Result<(Scene, Written, Option<MapsCourse>), FitError> {
    let mut made = budget.within(new)?;
    if let Some(own) = own {
        made.extend(budget.within(own)?);
    }
    let best = budget.best(&made)?;
    let (start, written) = match own.filter(|_| best > 0) {
        Some(own) => (own.scene(best - 1), Written::Decimated),
        None => (new.scene(0), was),
    };
    let (start, course) = with_maps(start, written);
    let mut made = vec![made.swap_remove(best)];
    if course.as_ref().is_some_and(MapsCourse::gained) {
        made.extend(budget.within(&Shapes::new(start))?);
    }
    let best = budget.best(&made)?;
    let scene = budget.asset.scene;
    let whole = budget.options.keeps_all(scene).then_some(scene);
    Ok(match budget.or_whole(made.swap_remove(best), whole)? {
        (light, true) => (light, Written::Decimated, None),
        (light, false) => (light, written, course),
    })
}
