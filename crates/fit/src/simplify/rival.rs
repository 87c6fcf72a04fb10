//! What is written unless a fit looks better: the asset's own materials on as few triangles.

use super::{Asset, SimplifyOptions, plain};
use crate::candidate::Candidate;
use crate::engine::judge::{BEST_PSNR, Stage};
use crate::engine::trainer::HeldOut;
use crate::engine::views::{Sampling, Views};
use crate::{FitError, Progress};
use photofit_geometry::decimate::Target;

/// The asset with its own materials on as many triangles as a fit has.
pub(super) struct Rival {
    /// Without its textures, which are those of the asset; `None` where the work was stopped before.
    stage: Option<Stage>,
    /// Its quality in the held-out views as it would be written, sampled as the fit is; `None` where it says nothing about what will be
    /// written ([`is_told`]).
    pub(super) quality: Option<f64>,
}

impl Rival {
    /// Of a fit of `candidate` that is judged by `held_out`, views of `views` sampled so.
    pub(super) fn new(
        asset: Asset<'_>,
        candidate: &Candidate,
        (held_out, views, sampling): (&HeldOut, &dyn Views, Sampling),
        options: &SimplifyOptions,
        progress: &dyn Progress,
    ) -> Result<Self, FitError> {
        if progress.is_cancelled() {
            return Ok(Self { stage: None, quality: None });
        }
        let mut stage = decimated(asset, candidate, options)?;
        let quality = if is_told(asset, options) {
            let written = Stage::new("", plain::written(&stage, asset.n, options));
            let count = held_out.shots().len() as u64;
            let shown = written.rasterized(&asset.n.light_asset, sampling.per_axis, |drawn| {
                HeldOut::new(drawn, views, sampling, count, options.seed)
            })?;
            Some(held_out.quality(shown.references()).min(BEST_PSNR))
        } else {
            None
        };
        stage.scene.images.clear();
        Ok(Self { stage: Some(stage), quality })
    }

    /// With its textures.
    pub(super) fn into_stage(
        self,
        asset: Asset<'_>,
        candidate: &Candidate,
        options: &SimplifyOptions,
    ) -> Result<Stage, FitError> {
        let Some(mut stage) = self.stage else { return decimated(asset, candidate, options) };
        stage.scene.images.clone_from(&asset.scene.images);
        Ok(stage)
    }
}

fn decimated(asset: Asset<'_>, candidate: &Candidate, options: &SimplifyOptions) -> Result<Stage, FitError> {
    let as_many = Target::Triangles(candidate.triangles.len());
    plain::decimated(asset.scene, asset.n, &[], &plain::own(as_many, asset.n, options))
}

/// Whether pictures of it by the rasterizer, in the views of the fit, tell whether it will be written: not within a budget of bytes,
/// which reduces its textures by no one knows yet how much; not as engines draw it, where a level may be the start of the next; not
/// where the choice is path traced, nor where the fit starts far from the asset.
pub(super) fn is_told(asset: Asset<'_>, options: &SimplifyOptions) -> bool {
    options.steps > 0
        && options.keeps_textures(asset.scene)
        && options.max_bytes.is_none()
        && !options.as_engine
        && options.init.is_decimated()
        && !options.is_judged_by_path_tracing(asset.scene)
}
