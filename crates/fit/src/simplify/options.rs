//! What the user chooses.

use super::ReferenceRenderer;
use crate::FitError;
use crate::views::Lighting;
use photofit_geometry::decimate::Target;
use photofit_scene::TextureEncoding;
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
    /// Width and height of the training pictures.
    pub resolution: usize,
    /// Pictures per step.
    pub batch: usize,
    /// Steps of the fit.
    pub steps: u64,
    /// Ends the fit early; what is reached counts.
    pub time_limit: Option<Duration>,
    /// Width and height of the maps.
    pub texture_size: usize,
    /// How the maps are stored in the written file.
    pub texture_encoding: TextureEncoding,
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
    /// Checks the ranges against an asset of `triangles` triangles.
    ///
    /// # Errors
    /// [`FitError::Setting`] names the option and the rule.
    pub fn check(&self, triangles: usize) -> Result<(), FitError> {
        let fail = |option, rule: String| Err(FitError::Setting { option, rule });
        match self.target {
            Target::Triangles(0) => return fail("--triangles", "the budget is at least 1 triangle".into()),
            Target::Triangles(n) if n > triangles => {
                return fail(
                    "--triangles",
                    format!("the budget of {n} is above the {triangles} triangles of the asset"),
                );
            }
            Target::Ratio(r) if !(r > 0.0 && r <= 1.0) => {
                return fail("--ratio", format!("{r} is not in (0, 1]"));
            }
            Target::Error(e) if !(e > 0.0 && e < 1.0) => {
                return fail("--error", format!("{e} is not in (0, 1), a share of the bounding diagonal"));
            }
            Target::ScreenSize(p) if !(1.0..=65536.0).contains(&p) => {
                return fail("--screen-size", format!("{p} is not in 1..65536 pixels"));
            }
            _ => {}
        }
        if !(16..=4096).contains(&self.resolution) {
            return fail("--resolution", format!("{} is not in 16..4096", self.resolution));
        }
        if !(16..=8192).contains(&self.texture_size) {
            return fail("--texture-size", format!("{} is not in 16..8192", self.texture_size));
        }
        if !(1..=64).contains(&self.batch) {
            return fail("--batch", format!("{} is not in 1..64", self.batch));
        }
        if self.resume && self.checkpoint.is_none() {
            return fail("--resume", "needs --checkpoint DIR, the folder to go on from".into());
        }
        Ok(())
    }
}
