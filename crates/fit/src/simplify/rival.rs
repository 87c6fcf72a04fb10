//! What is written unless a fit looks better: the asset's own materials on as few triangles.

use super::{Asset, SimplifyOptions, plain};
use crate::FitError;
use crate::candidate::Candidate;
use crate::engine::judge::Stage;
use crate::engine::trainer::HeldOut;
use crate::engine::views::{Sampling, Views};
use photofit_geometry::decimate::Target;

/// The asset with its own materials on as many triangles as the fit has.
pub(super) struct Rival {
    /// Without its textures, which are those of the asset.
    stage: Stage,
    /// Its quality in the held-out views as it would be written; `None` where it may not be, or no step is made.
    pub(super) quality: Option<f64>,
}

impl Rival {
    /// Of a fit of `candidate` that is judged by `held_out`, views of `views` sampled so.
    pub(super) fn new(
        asset: Asset<'_>,
        candidate: &Candidate,
        (held_out, views, sampling): (&HeldOut, &dyn Views, Sampling),
        options: &SimplifyOptions,
    ) -> Result<Self, FitError> {
        let Asset { scene, n, .. } = asset;
        let as_many = Target::Triangles(candidate.triangles.len());
        let mut stage = plain::decimated(scene, n, &[], &plain::own(as_many, n, options))?;
        // Within a budget of bytes it is written with textures that are not known yet.
        let is_alike = options.keeps_textures() && options.max_bytes.is_none();
        let quality = if is_alike && options.steps > 0 {
            let written = Stage::new("", plain::written(&stage, n, options));
            let count = held_out.shots().len() as u64;
            let pictures = written.rasterized(&n.light_asset, options.choice_samples(), |drawn| {
                HeldOut::new(drawn, views, sampling, count, options.seed)
            })?;
            Some(held_out.quality(pictures.references()))
        } else {
            None
        };
        stage.scene.images.clear();
        Ok(Self { stage, quality })
    }

    /// With its textures.
    pub(super) fn into_stage(mut self, asset: Asset<'_>) -> Stage {
        self.stage.scene.images.clone_from(&asset.scene.images);
        self.stage
    }
}
