//! What is written of what was chosen: with maps fitted through the path tracer where that is asked for, and within the bytes that the
//! file may have.

use super::byte_budget::{Budget, Made, Shapes};
use super::choice::Chosen;
use super::through_path::{TracedMaps, fit_maps};
use super::{Asset, SimplifyOptions, Written, dressed};
use crate::engine::reference::Reference;
use crate::{FitError, Progress};
use photofit_scene::{Compression, Scene};
use std::time::Duration;

/// What is written, and how it came about.
pub(super) struct Finished {
    /// What was chosen, as it is written.
    pub(super) chosen: Chosen,
    /// How its geometry is stored.
    pub(super) compression: Compression,
    /// What came of the fit of its maps through the path tracer.
    pub(super) traced_maps: TracedMaps,
    /// Whether the work was ended while what could be written was compared.
    pub(super) cut: bool,
}

/// What is written of `chosen` and, where the file may have so many bytes only, of the asset with its own materials, which was not
/// among what that was chosen from: each is made to fit, and what looks best then is written. `spent` is the time of the fit.
pub(super) fn finish(
    asset: Asset<'_>,
    mut chosen: Chosen,
    spent: Duration,
    reference: &dyn Reference,
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<Finished, FitError> {
    let (new, was, own) = (std::mem::take(&mut chosen.light), chosen.written, chosen.own.take());
    let stopped = chosen.trained.stopped;
    let with_maps = |light, written| fit_maps(asset, light, (written, stopped, spent), options, progress);
    let compared = chosen.plain.is_some();
    let ((light, compression, written, traced_maps), cut) = match options.max_bytes {
        None => {
            let (light, course) = with_maps(new, was);
            ((dressed(light, asset, options), options.compression, was, course), false)
        }
        Some(most) => {
            let budget = Budget { most, asset, reference, options, progress };
            let shapes = (&Shapes::new(new), was);
            let (made, written, course, cut) = within(&budget, shapes, own.as_ref(), compared, &with_maps)?;
            ((made.scene, made.compression, written, course), cut)
        }
    };
    let cut = compared && (chosen.certainty.is_none() || cut);
    if options.max_bytes.is_some() {
        // The file is not as it was fitted, and was compared once more.
        if was == Written::Fitted {
            chosen.fitted = Some(options.exported(&chosen.trained.model.candidate, asset.n));
        }
        chosen.certainty = None;
    }
    chosen.decimation = chosen.decimation.filter(|_| written == Written::Decimated);
    (chosen.light, chosen.written) = (light, written);
    Ok(Finished { chosen, compression, traced_maps, cut })
}

/// The better of the files within a budget that the asset with `new` maps and that with its `own` materials come to; what that is; and how
/// the fit of its maps `with_maps` went; and whether the work was ended in this choice. The asset as it was given is looked at where the work `compares` anything.
fn within(
    budget: &Budget<'_>,
    (new, was): (&Shapes, Written),
    own: Option<&Shapes>,
    compares: bool,
    with_maps: &dyn Fn(Scene, Written) -> (Scene, TracedMaps),
) -> Result<(Made, Written, TracedMaps, bool), FitError> {
    let mut made = budget.within(new)?;
    // Who stopped the work waits for no other files.
    let own = own.filter(|_| !budget.progress.is_cancelled());
    if let Some(own) = own {
        made.extend(budget.within(own)?);
    }
    let best = budget.best(&made)?;
    let mut cut = budget.progress.is_cancelled();
    let (start, written) = match own.filter(|_| best > 0) {
        Some(own) => (own.scene(best - 1), Written::Decimated),
        None => (new.scene(0), was),
    };
    let (start, course) = with_maps(start, written);
    let mut made = vec![made.swap_remove(best)];
    if course.gained() {
        made.extend(budget.within(&Shapes::new(start))?);
    }
    let fits: Vec<bool> = made.iter().map(|m| m.bytes() <= budget.most).collect();
    let (best, why) = match fits[..] {
        // They looked better when they were fitted: who stopped the work gets them without a comparison of files.
        [true, true] if budget.progress.is_cancelled() => (1, ""),
        [true, false] => (0, "with them no file has so few bytes"),
        [false, false] => (budget.best(&made)?, "the file with those before is smaller"),
        _ => (budget.best(&made)?, "within the bytes those before look better"),
    };
    cut |= fits == [true, true] && budget.progress.is_cancelled();
    let course = if best == 0 { course.beaten_by(why) } else { course };
    let given = budget.asset.given;
    let whole = (budget.options.keeps_all(given) && compares).then_some(given);
    Ok(match budget.or_whole(made.swap_remove(best), whole)? {
        (made, true) => (made, Written::Whole, course.beaten_by("the asset as it was given is written"), cut),
        (made, false) => (made, written, course, cut),
    })
}
