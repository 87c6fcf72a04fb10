//! What the user chooses.

use super::ReferenceRenderer;
use crate::FitError;
use crate::views::Lighting;
use photofit_geometry::decimate::Target;
use photofit_scene::{Compression, TextureEncoding};
use std::path::PathBuf;
use std::time::Duration;

/// What the fit starts from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Init {
    /// The decimated reference.
    #[default]
    Decimate,
    /// A sphere.
    Sphere,
}

/// Options of [`super::simplify`].
#[derive(Clone, Debug)]
pub struct SimplifyOptions {
    /// The budget.
    pub target: Target,
    /// What the fit starts from.
    pub init: Init,
    /// Width and height of the pictures that quality is reported by; the fit compares pictures half as wide, in which
    /// each pixel is the mean of two by two samples.
    pub resolution: usize,
    /// Pictures per step.
    pub batch: usize,
    /// Steps of the fit.
    pub steps: u64,
    /// Ends the fit early; what is reached counts. It bounds the fit alone: preparation, export and the report come on top.
    pub time_limit: Option<Duration>,
    /// Width and height of the maps.
    pub texture_size: usize,
    /// How the maps are stored in the written file.
    pub texture_encoding: TextureEncoding,
    /// How the geometry is stored in the written file.
    pub compression: Compression,
    /// The light while fitting.
    pub lighting: Lighting,
    /// How pictures of the reference are made, for the fit and for the report.
    pub reference: ReferenceRenderer,
    /// Seed of all random choices.
    pub seed: u64,
    /// Folder of the checkpoint.
    pub checkpoint: Option<PathBuf>,
    /// Goes on from the checkpoint.
    pub resume: bool,
    /// Views of the report.
    pub report_views: u64,
}

impl Default for SimplifyOptions {
    fn default() -> Self {
        Self {
            target: Target::Ratio(0.03),
            init: Init::Decimate,
            resolution: 512,
            batch: 2,
            steps: 1000,
            time_limit: None,
            texture_size: 1024,
            texture_encoding: TextureEncoding::Png,
            compression: Compression::None,
            lighting: Lighting::default(),
            reference: ReferenceRenderer::default(),
            seed: 0,
            checkpoint: None,
            resume: false,
            report_views: 8,
        }
    }
}

impl SimplifyOptions {
    /// Checks the ranges against an asset of `triangles` triangles; `usize::MAX` where there is none yet.
    ///
    /// # Errors
    /// [`FitError::Setting`] names the field, what it is and what it must be.
    pub fn check(&self, triangles: usize) -> Result<(), FitError> {
        let resolution = self.resolution;
        let texture_size = self.texture_size;
        let rules = [
            target_rule(self.target, triangles),
            rule("resolution", resolution, (16..=4096).contains(&resolution), "must be 16 to 4096"),
            rule("texture_size", texture_size, (16..=8192).contains(&texture_size), "must be 16 to 8192"),
            rule("batch", self.batch, (1..=64).contains(&self.batch), "must be 1 to 64"),
            rule("report_views", self.report_views, self.report_views <= 256, "must be at most 256"),
            rule(
                "resume",
                self.resume,
                !self.resume || self.checkpoint.is_some(),
                "needs a checkpoint, the folder to go on from",
            ),
        ];
        rules.into_iter().collect()
    }

    /// The budget that is meant: a share of the triangles of an asset never leaves fewer than [`FEWEST`] of them, or all
    /// that there are. Also says what a user should know about it.
    pub fn sane_target(&self, triangles: usize) -> (Target, Option<String>) {
        let floor = FEWEST.min(triangles);
        match self.target {
            Target::Ratio(r) if ((triangles as f64 * r) as usize) < floor => {
                let meant = (triangles as f64 * r) as usize;
                let text = format!(
                    "{r} of {triangles} triangles are {meant}, too few for a shape: the budget is {floor} triangles"
                );
                (Target::Triangles(floor), Some(text))
            }
            Target::Triangles(n) if n < floor => {
                let text = format!("a budget of {n} triangles is hardly a shape; {floor} are a sane floor");
                (self.target, Some(text))
            }
            target => (target, None),
        }
    }
}

/// Fewest triangles that a share of an asset leaves.
pub const FEWEST: usize = 64;

fn rule(field: &'static str, is: impl std::fmt::Display, holds: bool, must: &str) -> Result<(), FitError> {
    if holds { Ok(()) } else { Err(FitError::Setting { field, rule: format!("is {is}; it {must}") }) }
}

fn target_rule(target: Target, triangles: usize) -> Result<(), FitError> {
    match target {
        Target::Triangles(n) => {
            let must = match triangles {
                usize::MAX => "must be at least 1".to_owned(),
                most => format!("must be 1 to {most}, the triangles of the asset"),
            };
            rule("triangles", n, (1..=triangles).contains(&n), &must)
        }
        Target::Ratio(r) => rule("ratio", r, r > 0.0 && r <= 1.0, "must be above 0 and at most 1"),
        Target::Error(e) => {
            rule("error", e, e > 0.0 && e < 1.0, "must lie between 0 and 1, a share of the bounding diagonal")
        }
        Target::ScreenSize(p) => {
            rule("screen_size", p, (1.0..=65536.0).contains(&p), "must be 1 to 65536 pixels")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(target: Target) -> SimplifyOptions {
        SimplifyOptions { target, ..SimplifyOptions::default() }
    }

    #[test]
    fn errors_name_the_field_what_it_is_and_what_it_must_be() {
        let cases = [
            (with(Target::Triangles(0)), "triangles is 0; it must be 1 to 500, the triangles of the asset"),
            (
                with(Target::Triangles(501)),
                "triangles is 501; it must be 1 to 500, the triangles of the asset",
            ),
            (with(Target::Ratio(2.0)), "ratio is 2; it must be above 0 and at most 1"),
            (
                SimplifyOptions { resolution: 8, ..SimplifyOptions::default() },
                "resolution is 8; it must be 16 to 4096",
            ),
            (SimplifyOptions { batch: 0, ..SimplifyOptions::default() }, "batch is 0; it must be 1 to 64"),
        ];
        for (options, message) in cases {
            assert_eq!(options.check(500).unwrap_err().to_string(), message);
        }
        assert!(SimplifyOptions::default().check(1).is_ok());
    }

    #[test]
    fn a_share_of_a_small_asset_leaves_a_shape() {
        let (target, told) = SimplifyOptions::default().sane_target(12);
        assert_eq!(target, Target::Triangles(12));
        assert!(told.is_some_and(|t| t.contains("12 triangles")), "all of a cube stays");
        assert_eq!(SimplifyOptions::default().sane_target(1000).0, Target::Triangles(FEWEST));
        assert_eq!(SimplifyOptions::default().sane_target(100_000), (Target::Ratio(0.03), None));
        let (target, told) = with(Target::Triangles(5)).sane_target(1000);
        assert!(target == Target::Triangles(5) && told.is_some(), "an explicit budget holds, with a warning");
    }
}
