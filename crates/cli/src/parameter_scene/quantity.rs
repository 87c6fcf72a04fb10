//! What the values of a parameter are, and what follows for a fit of them: range, start, encoding in files.

use photofit_pathtrace::{MaterialValue, MediumValue};
use photofit_scene::MapKind;
use std::ops::Range;

/// Values without an upper bound of their own.
const MOST: f32 = 1e6;
/// Least radiance and reflectance: at 0, light that would come by them is not found by paths, and they would stay dark.
pub(crate) const FAINT: f32 = 1e-4;

/// What the values of a parameter are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Quantity {
    /// Share of light that is reflected, or a factor of it.
    Color,
    /// Width of a microfacet distribution.
    Alpha,
    /// Perceptual roughness, or a factor of it.
    Roughness,
    /// Metalness, or a factor of it.
    Metallic,
    /// Texels of roughness (green) and metalness (blue); red is not read.
    MetallicRoughness,
    /// Texels of a normal map, 0 to 1.
    Normal,
    /// Radiance, intensity, irradiance, or a factor of them.
    Radiance,
    /// Absorption per length.
    Absorption,
    /// Extinction of a medium, before its scale.
    Extinction,
    /// Albedo of a medium.
    Albedo,
    /// Radiance that a medium emits per length.
    Emission,
}

impl Quantity {
    /// That of a value of a material.
    pub(super) fn of(value: MaterialValue) -> Self {
        match value {
            MaterialValue::Reflectance | MaterialValue::SpecularReflectance | MaterialValue::BaseColor => {
                Self::Color
            }
            MaterialValue::Alpha | MaterialValue::AlphaU | MaterialValue::AlphaV => Self::Alpha,
            MaterialValue::Roughness => Self::Roughness,
            MaterialValue::Metallic => Self::Metallic,
            MaterialValue::Emissive | MaterialValue::Emission => Self::Radiance,
            MaterialValue::Absorption => Self::Absorption,
        }
    }

    /// That of a value of a medium.
    pub(super) fn of_medium(value: MediumValue) -> Self {
        match value {
            MediumValue::Extinction => Self::Extinction,
            MediumValue::Albedo => Self::Albedo,
            MediumValue::Emission => Self::Emission,
        }
    }

    /// That of the texels of a map of an asset.
    pub(super) fn of_map(map: MapKind) -> Self {
        match map {
            MapKind::MetallicRoughness => Self::MetallicRoughness,
            MapKind::Normal => Self::Normal,
            MapKind::Emissive => Self::Radiance,
            _ => Self::Color,
        }
    }

    /// Lowest and highest value of a fit.
    pub(crate) fn range(self) -> [f32; 2] {
        match self {
            Self::Color => [FAINT, 1.0],
            Self::Alpha => [1e-3, 1.0],
            Self::Roughness => [photofit_shading::ROUGHNESS_MIN as f32, 1.0],
            Self::Metallic | Self::MetallicRoughness | Self::Normal | Self::Albedo => [0.0, 1.0],
            Self::Radiance => [FAINT, MOST],
            Self::Absorption | Self::Extinction | Self::Emission => [0.0, MOST],
        }
    }

    /// The channels of `channels` that pictures depend on.
    pub(crate) fn read(self, channels: usize) -> Range<usize> {
        if self == Self::MetallicRoughness { 1..channels.min(3) } else { 0..channels }
    }

    /// Flat values to start from: `given`, or without it the middle of what has bounds, half the mean of densities and
    /// twice the mean of other values. Normal maps start without bumps, and channels that nothing reads stay as they are.
    pub(crate) fn flat(self, values: &[f32], channels: usize, given: Option<f32>) -> Vec<f32> {
        let [low, high] = self.range();
        let start = given.unwrap_or_else(|| {
            if high <= 1.0 {
                0.5 * (low + high)
            } else {
                let times = if self == Self::Extinction { 0.5 } else { 2.0 };
                times * values.iter().sum::<f32>() / values.len().max(1) as f32
            }
        });
        let channel = |(i, old): (usize, &f32)| match self {
            Self::Normal => [0.5, 0.5, 1.0][i % channels],
            _ if !self.read(channels).contains(&(i % channels)) => *old,
            _ => start.clamp(low, high),
        };
        values.iter().enumerate().map(channel).collect()
    }

    /// Root mean square of the differences of what is read.
    pub(crate) fn error(self, a: &[f32], b: &[f32], channels: usize) -> f64 {
        let read = self.read(channels);
        let (mut sum, mut count) = (0.0, 0_usize);
        for (a, b) in a.chunks_exact(channels).zip(b.chunks_exact(channels)) {
            for c in read.clone() {
                sum += f64::from(a[c] - b[c]).powi(2);
                count += 1;
            }
        }
        (sum / count.max(1) as f64).sqrt()
    }

    /// Whether image files hold the numbers as they are; colours and radiance are encoded as sRGB.
    pub(crate) fn is_data(self) -> bool {
        !matches!(self, Self::Color | Self::Radiance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flat_starts_suit_what_the_values_are() {
        let values = [0.1, 0.2, 0.9, 0.3, 0.4, 0.8];
        assert_eq!(Quantity::Normal.flat(&values, 3, Some(0.2)), [0.5, 0.5, 1.0, 0.5, 0.5, 1.0]);
        assert_eq!(Quantity::MetallicRoughness.flat(&values, 3, None), [0.1, 0.5, 0.5, 0.3, 0.5, 0.5]);
        assert_eq!(Quantity::Radiance.flat(&[1.0, 2.0, 3.0], 3, None), [4.0; 3]);
        assert_eq!(Quantity::Radiance.flat(&[0.0; 3], 3, None), [FAINT; 3]);
        assert_eq!(Quantity::Alpha.flat(&[0.3], 1, Some(0.0)), [1e-3]);
    }

    #[test]
    fn errors_are_those_of_what_is_read() {
        let (a, b) = ([0.0, 0.5, 0.5], [1.0, 0.5, 0.5]);
        assert_eq!(Quantity::MetallicRoughness.error(&a, &b, 3), 0.0);
        assert!((Quantity::Color.error(&a, &b, 3) - (1.0_f64 / 3.0).sqrt()).abs() < 1e-12);
    }
}
