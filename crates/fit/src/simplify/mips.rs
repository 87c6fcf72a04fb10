//! Mip levels with texels of their own: what goes with them, and the sizes of the pictures that they are fitted to.

use super::options::rule;
use super::{Appearance, FitRenderer, SimplifyOptions};
use crate::FitError;
use crate::engine::classes::MaterialClass;
use crate::engine::trainer::Measure;
use crate::engine::views::Orbit;
use photofit_scene::{AlphaMode, TextureEncoding};

/// How the mip levels of new maps come about.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mips {
    /// Each averages the one before it, as renderers do.
    #[default]
    Classic,
    /// Each has texels of its own, fitted to pictures of the sizes that read them. Textures must be KTX 2.0, which alone holds
    /// levels.
    Free,
}

impl Mips {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Classic => "classic",
            Self::Free => "free",
        }
    }

    /// What held-out pictures are judged by: those of several sizes count alike.
    pub(super) fn measure(self) -> Measure {
        match self {
            Self::Classic => Measure::Psnr,
            Self::Free => Measure::PsnrOfViews,
        }
    }
}

/// What goes with free levels.
pub(super) fn check(o: &SimplifyOptions) -> Result<(), FitError> {
    let needs = |holds, must| rule("mips", o.mips.name(), o.mips == Mips::Classic || holds, must);
    let ktx2 = matches!(o.texture_encoding, TextureEncoding::Ktx2 { .. });
    needs(ktx2, "needs ktx2 textures: PNG, JPEG and WebP hold no mip levels, readers make their own")?;
    needs(
        o.appearance == Appearance::Maps,
        "needs new maps: what is kept or has colours of vertices has none",
    )?;
    needs(
        o.fit_with == FitRenderer::Raster,
        "needs maps that the rasterizer fits: the path tracer moves the base alone",
    )?;
    needs(o.texture_size.is_multiple_of(4), "needs a texture size that is a multiple of 4, as ktx2 does")?;
    let (least, free) = (o.smallest_size, o.mips == Mips::Free);
    rule("smallest_size", least, !free || (16..=4096).contains(&least), "must be 16 to 4096")
}

/// Whether free levels can be written for surfaces of these classes. A coarse texel may belong to surfaces of several classes,
/// of which some are drawn from other samples than their material names: for classic levels the base alone is converted.
pub(super) fn check_classes(o: &SimplifyOptions, classes: &[&MaterialClass]) -> Result<(), FitError> {
    let some = |of: fn(&MaterialClass) -> bool| classes.iter().any(|c| of(c));
    let needs = |holds, must| rule("mips", o.mips.name(), o.mips == Mips::Classic || holds, must);
    let lit = some(|c| !c.unlit);
    needs(!(lit && some(|c| c.unlit)), "needs materials that are all lit or all unlit")?;
    let alpha = some(|c| c.written != AlphaMode::Opaque);
    needs(
        !(alpha && some(MaterialClass::is_see_through)),
        "needs an asset without alpha where there is glass",
    )
}

impl SimplifyOptions {
    /// Smallest and largest picture that free levels are fitted to, pixels a side; `None` where levels follow from the base.
    pub fn mip_sizes(&self) -> Option<[usize; 2]> {
        (self.mips == Mips::Free).then(|| [self.smallest_size.min(self.resolution), self.resolution])
    }

    /// Views in pictures of `size` pixels a side at most: of all sizes that free levels are fitted to, else of this one.
    pub(super) fn orbit(&self, size: usize) -> Orbit {
        Orbit { smallest: self.smallest_picture(), ..Orbit::new(self.seed, &self.lighting, size) }
    }

    /// Side of the smallest pictures of the fit, where they are of several sizes.
    pub(super) fn smallest_picture(&self) -> Option<usize> {
        self.mip_sizes().map(|[least, _]| least)
    }

    /// Side of a square that has as many pixels as a picture of the fit has on average.
    pub(super) fn mean_side(&self) -> usize {
        match self.mip_sizes() {
            // The mean of squares whose roots have evenly spread logarithms.
            Some([least, most]) if least < most => {
                let (a, b) = (least as f64, most as f64);
                ((b * b - a * a) / (2.0 * (b / a).ln())).sqrt() as usize
            }
            _ => self.resolution,
        }
    }
}

#[cfg(test)]
mod tests;
