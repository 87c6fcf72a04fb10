//! Lights without a surface: points, spots, and directions.

use super::{End, LightOrigin, LightSample, ThrownPicture, luminance};
use crate::PathtraceError;
use crate::error::invalid;
use crate::world::dvec3;
use glam::DVec3;
use photofit_scalar::{Vec3f, vec3};
use photofit_shading::Light;
use std::f32::consts::PI;
use std::sync::Arc;

/// How a spot fades between its inner and its outer cone.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Falloff {
    /// The square of a linear ramp in the cosine (`KHR_lights_punctual`).
    #[default]
    Smooth,
    /// A linear ramp in the angle.
    Linear,
}

/// A light without a surface.
#[derive(Clone, Debug, PartialEq)]
pub enum LightSource {
    /// A point that radiates equally in all directions.
    Point {
        /// Place in the world.
        position: DVec3,
        /// Radiant intensity, W/sr per channel.
        intensity: Vec3f,
    },
    /// Light from one direction, infinitely far away.
    Directional {
        /// Towards the light, of any length.
        direction: Vec3f,
        /// Irradiance on a surface that faces the light.
        irradiance: Vec3f,
    },
    /// A point that radiates into a cone.
    Spot {
        /// Place in the world.
        position: DVec3,
        /// Axis of the cone, away from the light, of any length.
        direction: Vec3f,
        /// Radiant intensity on the axis, W/sr per channel.
        intensity: Vec3f,
        /// Half angle of the cone of full intensity, radians.
        inner: f32,
        /// Half angle of the cone outside of which there is no light, radians, at most pi / 2.
        outer: f32,
        /// What lies between.
        falloff: Falloff,
        /// What it throws over its cone.
        picture: Option<Arc<ThrownPicture>>,
    },
    /// A point that throws a picture, evenly over a plane that faces it: the intensity grows with the inverse cube of the
    /// cosine between axis and direction, and there is no light beside the picture.
    Projector {
        /// Place in the world.
        position: DVec3,
        /// Axis, away from the light, of any length.
        direction: Vec3f,
        /// Radiant intensity on the axis where the picture is 1, W/sr per channel.
        intensity: Vec3f,
        /// What it throws.
        picture: Arc<ThrownPicture>,
    },
}

/// A source in the render frame.
#[derive(Clone, Debug)]
pub(super) enum PreparedSource {
    Point {
        position: Vec3f,
        intensity: Vec3f,
    },
    Directional {
        direction: Vec3f,
        irradiance: Vec3f,
    },
    Spot {
        position: Vec3f,
        axis: Vec3f,
        intensity: Vec3f,
        inner: f32,
        outer: f32,
        falloff: Falloff,
        picture: Option<Arc<ThrownPicture>>,
    },
    Projector {
        position: Vec3f,
        axis: Vec3f,
        intensity: Vec3f,
        picture: Arc<ThrownPicture>,
    },
}

impl LightSource {
    /// A light of the rasterizer; `None` for those that shine from all around.
    pub fn of(light: &Light<'_>) -> Option<Self> {
        match *light {
            Light::Point { position, intensity } => {
                Some(Self::Point { position: dvec3(position), intensity })
            }
            Light::Directional { direction, irradiance } => Some(Self::Directional { direction, irradiance }),
            Light::Ambient { .. } | Light::Environment { .. } => None,
        }
    }

    /// Intensity, or irradiance of a directional light.
    pub(crate) fn flux(&self) -> Vec3f {
        match *self {
            Self::Directional { irradiance, .. } => irradiance,
            Self::Point { intensity, .. }
            | Self::Spot { intensity, .. }
            | Self::Projector { intensity, .. } => intensity,
        }
    }

    /// What [`Self::flux`] reads.
    pub(crate) fn flux_mut(&mut self) -> &mut Vec3f {
        match self {
            Self::Directional { irradiance, .. } => irradiance,
            Self::Point { intensity, .. }
            | Self::Spot { intensity, .. }
            | Self::Projector { intensity, .. } => intensity,
        }
    }

    /// The source seen from the origin of the render frame, checked.
    pub(super) fn prepare(&self, index: usize, origin: DVec3) -> Result<PreparedSource, PathtraceError> {
        let fail = |rule: String| Err(invalid(format!("light {index}"), rule));
        let color = self.flux();
        if !(color.is_finite() && color.x >= 0.0 && color.y >= 0.0 && color.z >= 0.0) {
            return fail(format!(
                "its intensity is {:?}; it must be finite and not negative",
                color.to_array()
            ));
        }
        let place = |p: DVec3| {
            let q = p - origin;
            vec3(q.x as f32, q.y as f32, q.z as f32)
        };
        if let Self::Point { position, .. } | Self::Spot { position, .. } | Self::Projector { position, .. } =
            *self
            && !place(position).is_finite()
        {
            return fail(format!("its position is {position}; it must be finite"));
        }
        let unit = |d: Vec3f| {
            let l = dvec3(d).normalize_or_zero();
            vec3(l.x as f32, l.y as f32, l.z as f32)
        };
        if let Self::Directional { direction, .. }
        | Self::Spot { direction, .. }
        | Self::Projector { direction, .. } = *self
            && (unit(direction) == Vec3f::zero() || !direction.is_finite())
        {
            return fail(format!(
                "its direction is {:?}; it must be finite and not zero",
                direction.to_array()
            ));
        }
        if let Self::Spot { direction, picture: Some(picture), .. }
        | Self::Projector { direction, picture, .. } = self
            && let Some(rule) = picture.broken(unit(*direction))
        {
            return fail(rule.into());
        }
        Ok(match *self {
            Self::Point { position, intensity } => {
                PreparedSource::Point { position: place(position), intensity }
            }
            Self::Directional { direction, irradiance } => {
                PreparedSource::Directional { direction: unit(direction), irradiance }
            }
            Self::Spot { position, direction, intensity, inner, outer, falloff, ref picture } => {
                // Written so that NaN fails.
                if !(0.0 <= inner && inner <= outer && outer <= 0.5 * PI + 1e-5 && outer > 0.0) {
                    return fail(format!(
                        "its cones are {inner} and {outer}; they must obey 0 <= inner <= outer <= pi / 2 and outer > 0"
                    ));
                }
                let (position, axis, picture) = (place(position), unit(direction), picture.clone());
                PreparedSource::Spot { position, axis, intensity, inner, outer, falloff, picture }
            }
            Self::Projector { position, direction, intensity, ref picture } => {
                let (position, axis, picture) = (place(position), unit(direction), picture.clone());
                PreparedSource::Projector { position, axis, intensity, picture }
            }
        })
    }
}

impl PreparedSource {
    /// Power, for the choice among lights; `radius` bounds the scene.
    pub(super) fn power(&self, radius: f32) -> f32 {
        let power = match *self {
            Self::Point { intensity, .. } => 4.0 * PI * luminance(intensity),
            Self::Directional { irradiance, .. } => PI * radius * radius * luminance(irradiance),
            Self::Spot { intensity, inner, outer, ref picture, .. } => {
                let cosine = 0.5 * (inner.cos() + outer.cos());
                let shown = picture.as_ref().map_or(1.0, |p| p.mean());
                2.0 * PI * (1.0 - cosine).max(1e-6) * luminance(intensity) * shown
            }
            // The cube of the cosine is also what turns areas of the picture into solid angles.
            Self::Projector { intensity, ref picture, .. } => {
                luminance(intensity) * picture.mean() * picture.area()
            }
        };
        // Pure blue counts too; what overflows counts as much.
        power.max(f32::MIN_POSITIVE * f32::from(u8::from(power > 0.0))).min(1e30)
    }

    /// Intensity, or irradiance of a directional light.
    pub(super) fn color(&self) -> Vec3f {
        match *self {
            Self::Directional { irradiance, .. } => irradiance,
            Self::Point { intensity, .. }
            | Self::Spot { intensity, .. }
            | Self::Projector { intensity, .. } => intensity,
        }
    }

    pub(super) fn throws_picture(&self) -> bool {
        matches!(self, Self::Spot { picture: Some(_), .. } | Self::Projector { .. })
    }

    #[inline]
    pub(super) fn sample(&self, p: Vec3f) -> Option<LightSample> {
        let (wi, radiance, end) = match *self {
            Self::Directional { direction, irradiance } => (direction, irradiance, End::Infinite),
            Self::Point { position, intensity } => {
                let (wi, falloff) = towards(position, p)?;
                (wi, intensity * falloff, End::Point(position))
            }
            Self::Spot { position, axis, intensity, inner, outer, falloff, ref picture } => {
                let (wi, square) = towards(position, p)?;
                let cosine = -wi.dot(axis);
                let share = match falloff {
                    Falloff::Smooth => {
                        let ramp = (cosine - outer.cos()) / (inner.cos() - outer.cos()).max(1e-6);
                        ramp.clamp(0.0, 1.0).powi(2)
                    }
                    Falloff::Linear => {
                        let angle = cosine.clamp(-1.0, 1.0).acos();
                        ((outer - angle) / (outer - inner).max(1e-6)).clamp(0.0, 1.0)
                    }
                };
                if share <= 0.0 {
                    return None;
                }
                let radiance = intensity * (square * share);
                match picture {
                    None => (wi, radiance, End::Point(position)),
                    Some(p) => (wi, radiance.mul(p.color(-wi, cosine)?), End::Point(position)),
                }
            }
            Self::Projector { position, axis, intensity, ref picture } => {
                let (wi, square) = towards(position, p)?;
                let cosine = -wi.dot(axis);
                let shown = picture.color(-wi, cosine)?;
                (wi, intensity.mul(shown) * (square / cosine.powi(3)), End::Point(position))
            }
        };
        let origin = LightOrigin::Source(0);
        Some(LightSample { wi, radiance, pdf: 1.0, delta: true, end, origin })
    }
}

/// Unit direction and inverse squared distance; `None` on the spot.
#[inline(always)]
fn towards(position: Vec3f, p: Vec3f) -> Option<(Vec3f, f32)> {
    let v = position - p;
    let square = v.length_squared();
    let falloff = 1.0 / square;
    (square > 0.0 && falloff.is_finite()).then(|| (v * falloff.sqrt(), falloff))
}
