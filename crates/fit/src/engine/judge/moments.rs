//! Judging assets that move, at moments of the reference's animations.

use super::{
    Judge, Judged, OF_REFERENCE, OF_STAGES, ReportView, Stage, WIDEST_TRACED, compared, rasterized_views,
};
use crate::engine::animated::Animated;
use crate::engine::reference::{MaterialFeatures, PathTraced, Rasterized, Reference};
use crate::engine::views::{Moment, Orbit, OverMoments, Set};
use crate::engine::{FitFrame, LightAsset};
use crate::{FitError, Progress};

impl Stage {
    /// The stage in the frame of the reference, whose animations it plays by name.
    pub(super) fn animated(&self, light: &LightAsset) -> Animated<'_> {
        let frame = if self.normalised { FitFrame::WORLD } else { light.frame };
        Animated::in_frame(&self.scene, frame).playing(&light.animations)
    }
}

impl Judge<'_> {
    /// Compares stages with the reference in the `views` views of a report, each at one of these moments; without any, as both
    /// stand. In fewer views when the user stops it meanwhile.
    ///
    /// # Errors
    /// If a picture cannot be made, or an asset does not have a moment.
    pub fn at_moments(
        &self,
        stages: &[Stage],
        moments: &[Moment],
        views: u64,
        progress: &dyn Progress,
    ) -> Result<Vec<ReportView>, FitError> {
        let traced = self.method(stages) == Judged::PathTraced;
        let size = if traced { self.size.min(WIDEST_TRACED) } else { self.size };
        let orbit = Orbit::new(self.seed, self.lighting, size);
        let seen = OverMoments { views: orbit, moments: moments.to_vec() };
        let n = self.n;
        let theirs = Animated::new(self.scene, n);
        if !traced {
            let reference = Rasterized::new(&n.flat, &n.library).animated(&theirs).sampled(self.samples[0]);
            return rasterized_views(
                &n.light_asset,
                &reference,
                stages,
                &seen,
                Set::Report,
                views,
                self.samples[1],
                progress,
            );
        }
        let own: Vec<Animated<'_>> = stages.iter().map(|s| s.animated(&n.light_asset)).collect();
        // What stands still is not taken apart.
        let posed = |drawn: PathTraced<'static>, number, animated| -> PathTraced<'_> {
            let drawn = drawn.sampled(self.spp).in_halves(number);
            if moments.is_empty() { drawn } else { drawn.animated(animated) }
        };
        let reference = PathTraced::new(self.scene, n, MaterialFeatures::All, self.seed)?;
        let reference = posed(reference, OF_REFERENCE, &theirs);
        let drawn: Vec<PathTraced<'_>> = stages
            .iter()
            .zip(&own)
            .map(|(stage, animated)| Ok(posed(stage.traced(n, self.seed)?, OF_STAGES, animated)))
            .collect::<Result<_, FitError>>()?;
        let drawn: Vec<&dyn Reference> = drawn.iter().map(|d| d as &dyn Reference).collect();
        compared(&reference, &drawn, &seen, Set::Report, views, progress)
    }
}
