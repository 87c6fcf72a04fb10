//! The references that a simplification can be asked for.

use super::{Device, Mips, SimplifyOptions};
use crate::FitError;
use crate::engine::Normalised;
use crate::engine::reference::{MaterialFeatures, PathTraced, Rasterized, Reference, ReferenceKind, SAMPLES};
use photofit_scene::Scene;

/// How pictures of the reference are made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ReferenceRenderer {
    /// As the candidate's: direct light without shadows.
    #[default]
    Raster,
    /// With all light.
    Path,
}

impl ReferenceRenderer {
    /// What its pictures are.
    pub fn kind(self) -> ReferenceKind {
        match self {
            Self::Raster => ReferenceKind::RASTERIZED,
            Self::Path => ReferenceKind::path_traced(SAMPLES),
        }
    }

    /// Pictures of the asset as the options ask for them.
    pub(super) fn reference<'a>(
        self,
        scene: &Scene,
        n: &'a Normalised,
        options: &SimplifyOptions,
    ) -> Result<Box<dyn Reference + 'a>, FitError> {
        Ok(match self {
            Self::Raster => Box::new(rasterized(n, options)),
            Self::Path => Box::new(PathTraced::new(scene, n, MaterialFeatures::Core, options.seed)?),
        })
    }
}

impl ReferenceRenderer {
    /// The same pictures drawn where a fit runs, if that is a device and draws such pictures: what the fit is compared with. What
    /// is written is judged by those of the CPU.
    pub(super) fn drawn_on<'a>(
        self,
        device: &Device,
        n: &'a Normalised,
        options: &SimplifyOptions,
    ) -> Option<Box<dyn Reference + 'a>> {
        let draws = self == Self::Raster && !device.is_cpu();
        draws.then(|| device.drawing(rasterized(n, options)))
    }
}

fn rasterized<'a>(n: &'a Normalised, options: &SimplifyOptions) -> Rasterized<'a> {
    let rasterized = Rasterized::new(&n.flat, &n.library);
    match options.mips {
        Mips::Classic => rasterized.sampled(options.reference_samples()),
        Mips::Free => rasterized.sampled_by_size(options.effort.work().coarser),
    }
}
