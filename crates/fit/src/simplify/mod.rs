//! Appearance-driven simplification: the main job (Hasselgren et al. 2021), assembled from the parts of the engine.
//!
//! load -> normalise -> decimate -> shrink-wrap -> atlas -> bake -> fit by rendering -> bake again on the fitted shape -> fit
//! the maps -> export -> reload the file and compare it with the reference on views and lights that the fit never saw.

mod appearance;
mod assembly;
mod asset;
mod backs;
mod by_outline;
mod byte_budget;
mod choice;
mod coverage;
mod delivery;
mod effort;
mod finish;
mod init;
mod kept;
pub(crate) mod locks;
mod mips;
mod options;
pub(crate) mod outcome;
mod phases;
mod plain;
mod plan;
pub(crate) mod prepare;
mod reference;
mod rival;
pub(crate) mod shrink_wrap;
mod steering;
mod texture_space;
mod through_path;

#[cfg(test)]
mod tests;

pub use crate::engine::Normalised;
pub use crate::engine::classes::MaterialClass;
pub use crate::engine::device::Device;
pub use crate::engine::export::to_scene;
pub use crate::engine::judge::{JudgeRenderer, Judged, Quality, ReportView, ViewQuality};
pub use crate::engine::plan::Runs;
pub use crate::engine::trainer::HistoryPoint;
pub use appearance::Appearance;
pub use effort::Effort;
pub use init::Init;
pub use mips::Mips;
pub use options::{
    LARGEST_ENGINE_PICTURE, MILD_RATIO, MIN_TRIANGLES, MOST_REPLAYS, Resolved, SimplifyOptions,
};
pub use outcome::{Outcome, StageQuality, Written, too_large_path};
pub use plan::{FitPlan, Judgement};
pub use reference::ReferenceRenderer;
pub use through_path::{FitRenderer, TRACED_FOLDER};

pub(crate) use assembly::simplify_asset;
pub(crate) use asset::{Asset, with_asset};

use crate::engine::checkpoint;
use crate::engine::trainer::Checkpointing;
use crate::{FitError, Progress};
use delivery::dressed;
use photofit_scene::Scene;
use std::path::Path;
use std::time::Instant;

/// The stage of the asset's own materials on as many triangles.
pub(crate) const DECIMATED: &str = "decimated";
/// The stage of what was fitted, and that of the written file where it is another.
pub(crate) const FITTED: &str = "fitted";
pub(crate) const FILE: &str = "file";
/// The stage of the asset itself, which has all of its triangles.
pub(crate) const ORIGINAL: &str = "original";

/// Simplifies `scene` and writes the result to `output` (.glb).
///
/// When the user stops the fit, what has been reached is exported and reported like a finished fit. A file of more bytes than
/// [`SimplifyOptions::max_bytes`] replaces nothing: it is written to [`too_large_path`] instead ([`Outcome::file`]).
///
/// # Errors
/// See [`FitError`]; nothing is written then.
pub fn simplify(
    scene: &Scene,
    output: &Path,
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<Outcome, FitError> {
    let began = Instant::now();
    resolved_since(began, scene, output, &options.resolved(scene)?, progress)
}

/// The same with options that were resolved for `scene` before, which encodes geometry where triangles follow from bytes.
///
/// # Errors
/// See [`FitError`]; nothing is written then.
pub fn simplify_resolved(
    scene: &Scene,
    output: &Path,
    options: &Resolved,
    progress: &dyn Progress,
) -> Result<Outcome, FitError> {
    resolved_since(Instant::now(), scene, output, options, progress)
}

fn resolved_since(
    began: Instant,
    scene: &Scene,
    output: &Path,
    Resolved { options, told }: &Resolved,
    progress: &dyn Progress,
) -> Result<Outcome, FitError> {
    locks::check(scene, options, progress)?;
    if let Checkpointing { checkpoint: Some(folder), resume: true, .. } = options.checkpointing()
        && options.fit_steps() > 0
    {
        checkpoint::check_options(&folder, &steering::of_options(options).option("steps", options.steps))?;
    }
    told.iter().for_each(|t| progress.warn(t));
    with_asset(scene, progress, |asset| simplify_asset(asset, None, output, options, began, progress))
}
