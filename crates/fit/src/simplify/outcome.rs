//! What a simplification gives back.

use super::{HistoryPoint, Plan, SimplifyOptions, Trained};
use crate::candidate::Candidate;
use crate::engine::judge::{Quality, ReportView};
use photofit_scene::Scene;

/// Figures and pictures of a finished simplification.
#[derive(Debug)]
pub struct Outcome {
    /// Triangles of the reference.
    pub triangles_in: usize,
    /// Triangles of the written file.
    pub triangles_out: usize,
    /// Wall time of everything, reports of quality included.
    pub seconds: f64,
    /// Wall time until the file was written.
    pub fit_seconds: f64,
    /// Steps made.
    pub steps: u64,
    /// Million pixels per second of the fit, forward and backward.
    pub mpix_per_s: f64,
    /// Seconds after which the held-out quality stayed within half a decibel of its end.
    pub seconds_to_half_db: f64,
    /// True when the user or the time limit ended the fit.
    pub stopped: bool,
    /// Mean quality of the decimated asset with its own textures.
    pub decimated: Quality,
    /// Mean quality of the decimated asset with an atlas and maps baked from the reference: nothing is fitted.
    pub baked: Quality,
    /// Mean quality of the same drawn onto the reference before it was baked. The fit starts from the better of the two.
    pub wrapped: Quality,
    /// Mean quality of the written file.
    pub fitted: Quality,
    /// Every view of the report.
    pub views: Vec<ReportView>,
    /// The course of the fit.
    pub history: Vec<HistoryPoint>,
    /// What ran and what was skipped.
    pub plan: Plan,
    /// The fitted asset in the normalised frame.
    pub candidate: Candidate,
    /// Width and height of the training pictures.
    pub resolution: usize,
}

impl Outcome {
    /// Names of the stages, in the order of [`ReportView::quality`].
    pub const STAGES: [&str; 4] = ["decimated", "baked", "wrapped", "fitted"];

    /// The stages with their mean quality.
    pub fn stages(&self) -> [(&'static str, &Quality); 4] {
        let [a, b, c, d] = Self::STAGES;
        [(a, &self.decimated), (b, &self.baked), (c, &self.wrapped), (d, &self.fitted)]
    }

    pub(super) fn new(
        scene: &Scene,
        trained: Trained,
        plan: Plan,
        views: Vec<ReportView>,
        triangles_out: usize,
        [seconds, fit_seconds]: [f64; 2],
        options: &SimplifyOptions,
    ) -> Self {
        let mean = |k: usize| Quality::mean(views.iter().map(|v| &v.quality[k]));
        let last = trained.history.last().map_or(0.0, |h| h.held_out_psnr);
        let settled = trained.history.iter().rev().take_while(|h| h.held_out_psnr > last - 0.5).last();
        Self {
            triangles_in: scene.triangle_count(),
            triangles_out,
            seconds,
            fit_seconds,
            steps: trained.steps,
            mpix_per_s: trained.mpix_per_s,
            seconds_to_half_db: settled.map_or(0.0, |h| h.seconds),
            stopped: trained.stopped,
            decimated: mean(0),
            baked: mean(1),
            wrapped: mean(2),
            fitted: mean(3),
            views,
            history: trained.history,
            plan,
            candidate: trained.candidate,
            resolution: options.resolution,
        }
    }
}
