//! Beyond which bounds values of a parameter have no derivative.

use super::parameter::{MaterialValue, Parameter, library_material};
use crate::volume::MediumValue;
use crate::world::World;
use photofit_scene::{MapKind, SurfaceLibrary};
use photofit_shading::ROUGHNESS_MIN;

/// What keeps products and sums of single precision on the side of a bound where they have a derivative.
const MARGIN: f64 = 1e-6;
/// Least factor, or largest texel, that bounds the other for: texels below a bound may count where they are mixed with brighter ones,
/// and either may change.
const LEAST_OTHER: f32 = 0.5;

impl World {
    /// Lowest and highest value of each channel of a parameter, so that values beyond have no derivative of their own. Infinite
    /// where there is no such bound.
    ///
    /// Opaque materials of assets are never smoother than [`ROUGHNESS_MIN`], which bounds a map of roughness by the largest
    /// factor that it has, and the factor by the largest value of its maps. Where that is below a half the bound is twice
    /// [`ROUGHNESS_MIN`], and values next above it have no derivative either. (A texel below the bound has one where it is mixed with
    /// rougher ones.) Extinction of grids is bounded by [`crate::Volume::THICKEST`], beyond which nothing changes.
    pub fn effective_range(&self, parameter: &Parameter) -> [[f32; 2]; 3] {
        let mut range = [[f32::NEG_INFINITY, f32::INFINITY]; 3];
        match (parameter, self.library()) {
            (Parameter::Texels { texture }, Some(library)) => {
                range[1][0] = least_texel(library, *texture);
            }
            (Parameter::Material { materials, value: MaterialValue::Roughness }, Some(library)) => {
                let of = |m: &usize| self.given.get(*m).and_then(library_material);
                range[0][0] = least_factor(library, materials.iter().filter_map(of));
            }
            (Parameter::Medium { medium, value: MediumValue::Extinction }, _) => {
                range[0][1] = self.media.thickest(*medium) * (1.0 - MARGIN) as f32;
            }
            _ => {}
        }
        range
    }
}

/// The least roughness in a map that counts, if it is one and no material that reads it is clear.
fn least_texel(library: &SurfaceLibrary, texture: usize) -> f32 {
    let readers: Vec<usize> = library.readers(texture, MapKind::MetallicRoughness).collect();
    let factor = readers.iter().map(|m| library.factors(*m).roughness).fold(0.0, f32::max);
    least(library, &readers, factor)
}

/// The least factor of roughness that counts of materials of the library.
fn least_factor(library: &SurfaceLibrary, materials: impl Iterator<Item = usize>) -> f32 {
    let materials: Vec<usize> = materials.collect();
    let of = |m: &usize| match library.texture_of(*m, MapKind::MetallicRoughness) {
        None => 1.0,
        Some(texture) => library.texture(texture).linear_base().iter().map(|t| t[1]).fold(0.0, f32::max),
    };
    let most = materials.iter().map(of).fold(0.0, f32::max);
    least(library, &materials, most)
}

/// The least value whose product with this one counts as roughness, at most twice [`ROUGHNESS_MIN`]; none without materials, or
/// where clear glass has none.
fn least(library: &SurfaceLibrary, materials: &[usize], other: f32) -> f32 {
    if materials.is_empty() || materials.iter().any(|m| library.may_transmit(*m)) {
        return f32::NEG_INFINITY;
    }
    (ROUGHNESS_MIN * (1.0 + MARGIN)) as f32 / other.max(LEAST_OTHER)
}
