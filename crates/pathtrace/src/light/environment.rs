//! Light from all around: an equirectangular image, chosen by an alias table over its texels.

use super::{End, LightOrigin, LightSample, luminance};
use crate::PathtraceError;
use crate::error::invalid;
use glam::{Mat3A, Quat};
use photofit_image::Image;
use photofit_sampling::AliasTable;
use photofit_scalar::{Vec3f, vec3};
use photofit_shading::EquirectangularTaps;
use std::f32::consts::{PI, TAU};

/// Radiance from all directions, infinitely far away.
///
/// Orientation (the same as [`photofit_shading::Environment::from_equirectangular`]): the direction `d` is found at
/// `u = 1/2 + atan2(d.z, d.x) / 2 pi` from the left and `v = acos(d.y) / pi` from the top. Texels are interpolated
/// linearly, around the seam too.
#[derive(Clone, Debug)]
pub struct EnvironmentMap {
    /// Linear radiance, three channels, row 0 at +y.
    pub image: Image,
    /// Factor of the radiance.
    pub scale: f32,
    /// Turns the map: from its own frame to the world.
    pub rotation: Quat,
    /// Choose texels by what they have above the mean (Karlík et al. 2019, "MIS Compensation"): BSDF sampling finds
    /// the rest. Without multiple importance sampling this must be off.
    pub compensate: bool,
    /// The centres of the first and the last row lie at the poles (as in Mitsuba), instead of half a row away.
    pub rows_to_poles: bool,
}

impl EnvironmentMap {
    /// A map as it is.
    pub fn new(image: Image) -> Self {
        Self { image, scale: 1.0, rotation: Quat::IDENTITY, compensate: true, rows_to_poles: false }
    }

    /// The same radiance from everywhere.
    pub fn constant(radiance: Vec3f) -> Self {
        Self::new(Image::from_data(1, 1, 3, radiance.to_array().to_vec()))
    }

    /// Mean radiance over all directions.
    pub fn mean(&self) -> Vec3f {
        let mut sum = [0.0_f64; 3];
        for y in 0..self.image.height {
            let share = row_share(y, self.image.height) / self.image.width as f64;
            for x in 0..self.image.width {
                for (s, v) in sum.iter_mut().zip(self.image.pixel(x, y)) {
                    *s += share * f64::from(*v);
                }
            }
        }
        Vec3f::from_array(sum.map(|s| s as f32)) * self.scale
    }
}

/// Share of the sphere that a row covers.
fn row_share(y: usize, height: usize) -> f64 {
    let cosine = |y: usize| (std::f64::consts::PI * y as f64 / height as f64).cos();
    0.5 * (cosine(y) - cosine(y + 1))
}

/// A map ready to be sampled.
#[derive(Debug)]
pub(crate) struct EnvironmentLight {
    width: usize,
    height: usize,
    rows_to_poles: bool,
    /// Radiance with the scale multiplied in, `height * width`.
    texels: Vec<Vec3f>,
    /// Map to world, as it was given: [`Self::inward`] does not give it back bit by bit.
    rotation: Quat,
    /// World to map.
    inward: Option<Mat3A>,
    table: Option<AliasTable>,
    /// The table leaves out what is below the mean.
    compensated: bool,
    /// Factor of the radiance, in the texels already.
    scale: f32,
    /// Integral of the luminance over all directions, divided by pi: power per area of the scene's disk.
    total: f64,
}

impl EnvironmentLight {
    /// The map that this is made of.
    pub(crate) fn map(&self) -> EnvironmentMap {
        let share = if self.scale > 0.0 { 1.0 / self.scale } else { 0.0 };
        let data = self.texels.iter().flat_map(|t| (*t * share).to_array()).collect();
        EnvironmentMap {
            image: Image::from_data(self.width, self.height, 3, data),
            scale: self.scale,
            rotation: self.rotation,
            compensate: self.compensated,
            rows_to_poles: self.rows_to_poles,
        }
    }

    pub(super) fn new(map: EnvironmentMap) -> Result<Self, PathtraceError> {
        let fail = |rule: String| Err(invalid("environment", rule));
        let (width, height) = (map.image.width, map.image.height);
        if width == 0 || height == 0 || map.image.channels != 3 {
            return fail(format!(
                "the image has {width} x {height} pixels and {} channels; it must have pixels and 3 channels",
                map.image.channels
            ));
        }
        if !(map.scale >= 0.0 && map.scale.is_finite()) {
            return fail(format!("its scale is {}; it must be finite and not negative", map.scale));
        }
        if !(map.rotation.is_finite() && (map.rotation.length() - 1.0).abs() < 1e-3) {
            return fail(format!("its rotation is {}; it must be a unit quaternion", map.rotation));
        }
        let scale = map.scale;
        let texels: Vec<Vec3f> =
            map.image.data.chunks_exact(3).map(|c| vec3(c[0], c[1], c[2]) * scale).collect();
        if let Some(i) = texels.iter().position(|t| !t.is_finite() || t.to_array().iter().any(|x| *x < 0.0)) {
            let at = (i % width, i / width);
            return fail(format!(
                "radiance of pixel {at:?} is {:?}; it must be finite and not negative",
                texels[i].to_array()
            ));
        }
        let mut light = Self {
            width,
            height,
            rows_to_poles: map.rows_to_poles && height > 1,
            texels,
            rotation: map.rotation,
            inward: (map.rotation != Quat::IDENTITY).then(|| Mat3A::from_quat(map.rotation.inverse())),
            table: None,
            compensated: map.compensate,
            scale,
            total: 0.0,
        };
        let mean = {
            let mut sum = 0.0;
            for y in 0..height {
                let share = row_share(y, height) / width as f64;
                for x in 0..width {
                    sum += share * f64::from(light.smoothed(x, y));
                }
            }
            sum
        };
        light.total = 4.0 * mean;
        let threshold = if map.compensate { mean } else { 0.0 };
        let weights: Vec<f32> = (0..width * height)
            .map(|i| {
                let above = f64::from(light.smoothed(i % width, i / width)) - threshold;
                // What rounding leaves of a constant map is not worth a light.
                let above = if above > 1e-5 * mean { above } else { 0.0 };
                (above * row_share(i / width, height)) as f32
            })
            .collect();
        light.table = AliasTable::new(&weights).ok();
        Ok(light)
    }

    /// Mean luminance of the interpolated map over a texel.
    fn smoothed(&self, x: usize, y: usize) -> f32 {
        let mut sum = 0.0;
        if self.rows_to_poles {
            for i in 0..16 {
                let at = |k: usize| (k as f32 + 0.5) / 4.0;
                let c = self.interpolate(x as f32 + at(i % 4), y as f32 + at(i / 4));
                sum += luminance(c) / 16.0;
            }
            return sum;
        }
        for (dy, wy) in [(-1_isize, 0.125), (0, 0.75), (1, 0.125)] {
            let row = y.saturating_add_signed(dy).min(self.height - 1);
            for (dx, wx) in [(self.width - 1, 0.125), (0, 0.75), (1, 0.125)] {
                let column = (x + dx) % self.width;
                sum += wy * wx * luminance(self.texels[row * self.width + column]);
            }
        }
        sum
    }

    /// Whether next-event estimation can find it.
    pub(super) fn is_sampled(&self) -> bool {
        self.table.is_some()
    }

    pub(super) fn is_compensated(&self) -> bool {
        self.compensated
    }

    pub(super) fn is_black(&self) -> bool {
        self.total <= 0.0
    }

    pub(super) fn total(&self) -> f64 {
        self.total
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.texels.as_slice()) + self.table.as_ref().map_or(0, |t| 12 * t.len())
    }

    /// Place of a direction in the map, in texels, and the sine of its angle from the pole.
    #[inline(always)]
    fn place(&self, wi: Vec3f) -> (f32, f32, f32) {
        let d = match &self.inward {
            Some(m) => crate::world::from_glam(*m * crate::world::to_glam(wi)),
            None => wi,
        };
        let sine = (d.x * d.x + d.z * d.z).sqrt();
        let (u, v) = (0.5 + angle(d.z, d.x) * (0.5 / PI), angle(sine, d.y) * (1.0 / PI));
        (u * self.width as f32, v * self.height as f32, sine)
    }

    /// Radiance from the unit direction `wi` and, if it is `wanted`, the density of that direction (else 0).
    #[inline]
    pub(super) fn radiance_and_pdf(&self, wi: Vec3f, wanted: bool) -> (Vec3f, f32) {
        let table = self.table.as_ref().filter(|_| wanted);
        if let (1, None) = (self.texels.len(), table) {
            return (self.texels[0], 0.0);
        }
        let place = self.place(wi);
        (self.interpolate(place.0, place.1), table.map_or(0.0, |t| self.density(t, place)))
    }

    /// Factor of the radiance.
    pub(crate) fn scale(&self) -> f32 {
        self.scale
    }

    /// Columns and rows.
    pub(crate) fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// The texels that [`Self::radiance_and_pdf`] reads, with their weights.
    pub(crate) fn taps(&self, wi: Vec3f) -> EquirectangularTaps {
        if self.texels.len() == 1 {
            return EquirectangularTaps { texels: [0; 4], weights: [1.0, 0.0, 0.0, 0.0] };
        }
        let (x, y, _) = self.place(wi);
        self.taps_at(x, y)
    }

    #[inline(always)]
    fn taps_at(&self, x: f32, y: f32) -> EquirectangularTaps {
        EquirectangularTaps::at([x, y], [self.width, self.height], self.rows_to_poles)
    }

    #[inline(always)]
    fn interpolate(&self, x: f32, y: f32) -> Vec3f {
        self.taps_at(x, y).radiance(&self.texels)
    }

    #[inline]
    pub(super) fn sample(&self, choice: [f32; 2], place: [f32; 2]) -> Option<LightSample> {
        let table = self.table.as_ref()?;
        let chosen = table.sample(choice);
        let (column, row) = (chosen.index % self.width, chosen.index / self.width);
        let (x, y) = (column as f32 + place[0], row as f32 + place[1]);
        let (phi, theta) = ((x / self.width as f32 - 0.5) * TAU, y / self.height as f32 * PI);
        let ((sin_phi, cos_phi), (sine, cosine)) = (phi.sin_cos(), theta.sin_cos());
        let d = vec3(sine * cos_phi, cosine, sine * sin_phi);
        let wi = match &self.inward {
            Some(m) => crate::world::from_glam(m.transpose() * crate::world::to_glam(d)),
            None => d,
        };
        let radiance = self.interpolate(x, y);
        let pdf = chosen.pmf * self.per_solid_angle(sine);
        (radiance != Vec3f::zero()).then_some(LightSample {
            wi,
            radiance,
            pdf,
            delta: false,
            end: End::Infinite,
            origin: LightOrigin::Environment,
        })
    }

    /// Texels per solid angle at an angle from the pole: points are uniform in `(u, v)` within a texel.
    #[inline(always)]
    fn per_solid_angle(&self, sine: f32) -> f32 {
        (self.width * self.height) as f32 / (TAU * PI * sine.max(1e-12))
    }

    /// Density per solid angle of the direction that is found at a place ([`Self::place`]).
    #[inline(always)]
    fn density(&self, table: &AliasTable, (x, y, sine): (f32, f32, f32)) -> f32 {
        let (column, row) = ((x as usize).min(self.width - 1), (y as usize).min(self.height - 1));
        table.pmf(row * self.width + column) * self.per_solid_angle(sine)
    }
}

/// `atan2(y, x)`, 0 for no direction, to three units in the last place: twice as fast as that of the C library, and the same
/// on every platform.
///
/// The polynomial is that of Moshier (Cephes 2.2, `atanf`) for tangents below that of pi / 8.
#[inline(always)]
fn angle(y: f32, x: f32) -> f32 {
    const EIGHTH: f32 = 0.414_213_56;
    let (ax, ay) = (x.abs(), y.abs());
    let (least, most) = (ax.min(ay), ax.max(ay));
    // atan(t) = pi / 4 + atan((t - 1) / (t + 1)).
    let far = least > EIGHTH * most;
    let (over, under) = if far { (least - most, least + most) } else { (least, most) };
    let t = if under > 0.0 { over / under } else { 0.0 };
    let z = t * t;
    let p = ((8.053_744e-2 * z - 1.387_768_6e-1) * z + 1.997_771_1e-1) * z - 3.333_295e-1;
    let small = p * z * t + t;
    let angle = if far { 0.25 * PI + small } else { small };
    let angle = if ay > ax { 0.5 * PI - angle } else { angle };
    (if x < 0.0 { PI - angle } else { angle }).copysign(y)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_those_of_the_library() {
        let mut largest = 0.0_f64;
        for i in 0..=4000 {
            for scale in [1e-20_f32, 1.0, 3e8] {
                // All directions, and some close to the axes.
                let turn = f64::from(i) / 4000.0 * f64::from(TAU);
                let near = 10.0_f64.powf(-12.0 * f64::from(i) / 4000.0);
                for (y, x) in [turn.sin_cos(), (near, 1.0), (near, -1.0), (1.0, near), (-1.0, near)] {
                    let (y, x) = (y as f32 * scale, x as f32 * scale);
                    let expected = f64::from(y).atan2(f64::from(x));
                    largest =
                        largest.max((f64::from(angle(y, x)) - expected).abs() / expected.abs().max(1e-30));
                }
            }
        }
        assert!(largest < 3.0 * f64::from(f32::EPSILON), "relative error {largest:e}");
        assert!(largest > 1e-9, "nothing was compared");
        assert_eq!((angle(0.0, 0.0), angle(0.0, 1.0), angle(0.0, -1.0)), (0.0, 0.0, PI));
        assert_eq!((angle(1.0, 0.0), angle(-1.0, 0.0)), (0.5 * PI, -0.5 * PI));
    }
}
