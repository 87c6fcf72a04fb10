//! The second fit of a simplification whose maps are fitted through the path tracer.

use super::{Asset, SimplifyOptions, Written};
use crate::Progress;
use crate::engine::chain::fit_after_another;
use crate::engine::checkpoint;
use crate::engine::plan::Item;
use crate::engine::plan::rows::NO_STEPS;
use crate::engine::trainer::Checkpointing;
use crate::traced_maps::{MapsCourse, TracedMapsOptions, traced_maps};
use photofit_scene::Scene;
use std::time::Duration;

/// What draws the light asset while its maps are fitted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FitRenderer {
    /// The rasterizer: shadows of path traced pictures of the reference go into the maps.
    #[default]
    Raster,
    /// Shape and maps by the rasterizer, without shadows on either side, then the maps by the path tracer against path
    /// traced pictures ([`crate::traced_maps`]): what the light shape casts itself stays out of them.
    Path,
}

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
pub(super) fn checkpointing_before(options: &SimplifyOptions) -> Checkpointing {
    let checkpointing = options.checkpointing();
    let share = if options.fit_with == FitRenderer::Path { 2 } else { 1 };
    Checkpointing { time_limit: checkpointing.time_limit.map(|limit| limit / share), ..checkpointing }
}

/// What comes, or came, of the fit.
#[derive(Debug)]
pub(super) enum TracedMaps {
    /// It is not asked for.
    NotAsked,
    /// It is asked for.
    Planned,
    /// It is not made, and why.
    Skipped(String),
    /// It was made.
    Made(MapsCourse),
    /// It was made, maybe not to its end, and something else is written, as is told.
    Beaten { why: &'static str, stopped: bool },
}

impl TracedMaps {
    /// Before any work.
    pub(super) fn planned(options: &SimplifyOptions) -> Self {
        match options.fit_with {
            FitRenderer::Raster => Self::NotAsked,
            FitRenderer::Path if options.steps == 0 => Self::Skipped(NO_STEPS.into()),
            FitRenderer::Path => Self::Planned,
        }
    }

    /// The same where something else is written than maps that looked better: what, or why.
    pub(super) fn beaten_by(self, what: &'static str) -> Self {
        match self {
            Self::Made(course) if course.gained() => Self::Beaten { why: what, stopped: course.stopped },
            other => other,
        }
    }

    /// Whether maps were made that look better than those before.
    pub(super) fn gained(&self) -> bool {
        matches!(self, Self::Made(course) if course.gained())
    }

    /// The row of the plan.
    pub(super) fn row(&self) -> Option<Item> {
        let (runs, why) = match self {
            Self::NotAsked => return None,
            Self::Skipped(why) => (false, why.as_str()),
            Self::Planned => (true, "fitted once more, after the rasterizer"),
            Self::Made(course) if course.steps == 0 => (false, "the work was ended before the first step"),
            Self::Made(_) if self.gained() => (true, "fitted once more, after the rasterizer"),
            Self::Made(_) => (true, "fitted once more; none looked better, and those before are written"),
            Self::Beaten { why, .. } => {
                let why = format!("fitted once more; {why}");
                return Some(Item { what: "path traced maps", runs: true.into(), why });
            }
        };
        Some(Item { what: "path traced maps", runs: runs.into(), why: why.into() })
    }

    /// Whether it ended before its end.
    pub(super) fn stopped(&self) -> bool {
        matches!(self, Self::Made(MapsCourse { stopped: true, .. }) | Self::Beaten { stopped: true, .. })
    }

    /// How the fit of what is written went.
    pub(super) fn course(self) -> Option<MapsCourse> {
        if let Self::Made(course) = self { Some(course) } else { None }
    }
}

/// What is to be written, with its maps fitted through the path tracer where that is asked for and time is left. What
/// fails is told, and the maps stay as they are.
pub(super) fn fit_maps(
    asset: Asset<'_>,
    light: Scene,
    (written, stopped, spent): (Written, bool, Duration),
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> (Scene, TracedMaps) {
    match TracedMaps::planned(options) {
        TracedMaps::Planned if progress.is_cancelled() => {
            return (light, TracedMaps::Skipped("the work was ended before".into()));
        }
        TracedMaps::Planned => {}
        not => return (light, not),
    }
    let mut fit = fit_options(options, spent);
    // A fit that the time limit ended goes on first, and these maps would follow from another shape then.
    if stopped && fit.checkpointing.checkpoint.is_some() {
        let why = "the fit before was ended by the time limit";
        progress.warn(&format!("its maps are not fitted through the path tracer: {why}"));
        return (light, TracedMaps::Skipped(why.into()));
    }
    // Texture coordinates of the asset's own may show one texel in many places.
    fit.new_map = fit.new_map.filter(|_| written != Written::Decimated);
    let made = fit_after_another(fit.checkpointing.clone(), progress, |checkpointing| {
        fit.checkpointing.clone_from(checkpointing);
        traced_maps(asset.scene, asset.n, &light, &fit, progress)
    });
    match made {
        // Written again they would be rounded, too.
        Ok(made) if !made.course.gained() => {
            progress.warn("no maps fitted through the path tracer looked better: those before are written");
            (light, TracedMaps::Made(made.course))
        }
        Ok(made) => (made.light, TracedMaps::Made(made.course)),
        Err(e) => {
            progress.warn(&format!("its maps are not fitted through the path tracer: {e}"));
            (light, TracedMaps::Skipped(e.to_string()))
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
        checkpointing: Checkpointing {
            checkpoint: o.checkpoint.as_ref().map(|folder| folder.join(TRACED_FOLDER)),
            resume: o.resume,
            time_limit: o.time_limit.map(|limit| limit.saturating_sub(spent)),
        },
        ..TracedMapsOptions::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::plan::{PlanRows, Runs};
    use crate::engine::trainer::HistoryPoint;
    use crate::simplify::ReferenceRenderer;

    #[test]
    fn the_row_tells_whether_maps_were_fitted() {
        let options = |fit_with, steps| SimplifyOptions {
            reference: ReferenceRenderer::Path,
            fit_with,
            steps,
            ..SimplifyOptions::default()
        };
        let point = |quality| HistoryPoint { step: 0, seconds: 0.0, loss: 0.0, quality };
        let made = |steps, end| MapsCourse {
            history: vec![point(20.0), point(end)],
            steps,
            stopped: false,
            plan: PlanRows::default(),
        };
        let made = |steps, end| TracedMaps::Made(made(steps, end));
        assert!(TracedMaps::planned(&options(FitRenderer::Raster, 9)).row().is_none());
        for (came, runs, part) in [
            (TracedMaps::planned(&options(FitRenderer::Path, 9)), Runs::Yes, "once more"),
            (TracedMaps::planned(&options(FitRenderer::Path, 0)), Runs::No, "no steps are made"),
            (TracedMaps::Skipped("the asset has no map".into()), Runs::No, "the asset has no map"),
            (made(9, 21.0), Runs::Yes, "once more"),
            (made(9, 20.0), Runs::Yes, "those before are written"),
            (made(0, 20.0), Runs::No, "before the first step"),
            (made(9, 21.0).beaten_by("the asset as it was given is written"), Runs::Yes, "as it was given"),
        ] {
            let row = came.row().expect("it is asked for");
            assert!(row.runs == runs && row.why.contains(part), "{came:?}: {row:?}");
        }
    }
}
