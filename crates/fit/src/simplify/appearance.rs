//! What the light asset has in place of the asset's surface.

use super::SimplifyOptions;
use super::options::rule;
use super::through_path::FitRenderer;
use crate::FitError;
use crate::bake::Occlusion;

/// What the light asset has in place of the asset's surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Appearance {
    /// New maps in an atlas of their own, or, where [`SimplifyOptions::own_textures`] allows it and it looks better, what
    /// the asset has.
    #[default]
    Maps,
    /// The asset's own texture coordinates, materials and textures, all as they are: nothing but triangles is less, and
    /// nothing is fitted.
    Kept,
    /// A colour for each vertex; everything else is the same all over a material, and there are no textures.
    VertexColors,
}

impl Appearance {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Maps => "maps",
            Self::Kept => "kept",
            Self::VertexColors => "vertex colors",
        }
    }

    /// What the fit moves, as it is written.
    pub(crate) fn in_words(self) -> &'static str {
        match self {
            Self::Maps | Self::Kept => "maps",
            Self::VertexColors => "colours of vertices",
        }
    }
}

/// The field of [`Appearance`].
const FIELD: &str = "appearance";

/// What goes with the asset's own surface, and with colours of vertices.
///
/// # Errors
/// [`FitError::Setting`] names the field, what it is and what it must be.
pub(super) fn check(o: &SimplifyOptions) -> Result<(), FitError> {
    let baked = matches!(o.occlusion, Occlusion::Rays(_));
    let needs = |holds, must: &str| rule(FIELD, o.appearance.name(), holds, must);
    match o.appearance {
        Appearance::Maps => Ok(()),
        Appearance::Kept => {
            let plain = !o.reference.kind().indirect_light && o.init.is_decimated() && !baked;
            let must = "goes with pictures of the asset without indirect light, the decimated asset as the start and no baked \
                        occlusion";
            needs(plain, must)
        }
        Appearance::VertexColors => {
            let plain = o.fit_with == FitRenderer::Raster && !baked;
            let must =
                "cannot stand for maps where these are fitted through the path tracer or occlusion is baked";
            needs(plain, must)
        }
    }
}
