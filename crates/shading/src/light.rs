//! Lights, and the radiance that a surface reflects from them.

use crate::energy::Energy;
use crate::environment::Environment;
use crate::eval::{Compensation, eval_lobes, eval_lobes_vjp, eval_single_vjp};
use crate::split_sum::{SplitSum, split_sum};
use crate::surface::{Lobes, LobesGradient, Surface, SurfaceGradient};
use photofit_scalar::{Real, Vec3, vec3};

/// A light, without visibility: nothing casts a shadow here.
#[derive(Clone, Copy, Debug)]
pub enum Light<'a, T = f32> {
    /// A point that radiates equally in all directions.
    Point {
        /// Place in world space.
        position: Vec3<T>,
        /// Radiant intensity (W/sr per channel); irradiance falls with the square of the distance.
        intensity: Vec3<T>,
    },
    /// Light from one direction, infinitely far away.
    Directional {
        /// Unit vector towards the light.
        direction: Vec3<T>,
        /// Irradiance on a surface that faces the light.
        irradiance: Vec3<T>,
    },
    /// The same radiance from every direction.
    Ambient {
        /// The radiance.
        radiance: Vec3<T>,
    },
    /// Light from an environment map.
    Environment {
        /// The map.
        map: &'a Environment<T>,
        /// How the map is turned.
        rotation: Yaw<T>,
        /// Factor of the map's radiance.
        scale: T,
    },
}

/// A turn about the y axis, counterclockwise seen from above.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Yaw<T = f32> {
    cosine: T,
    sine: T,
}

impl<T: Real> Yaw<T> {
    /// Cosine and sine of the angle.
    pub fn cosine_sine(self) -> [T; 2] {
        [self.cosine, self.sine]
    }

    /// A turn by `angle` radians.
    pub fn new(angle: T) -> Self {
        Self { cosine: angle.cos(), sine: angle.sin() }
    }

    /// Turns a vector.
    #[inline(always)]
    pub fn apply(self, v: Vec3<T>) -> Vec3<T> {
        vec3(self.cosine * v.x + self.sine * v.z, v.y, self.cosine * v.z - self.sine * v.x)
    }

    /// Turns a vector back (also the adjoint of [`Self::apply`]).
    #[inline(always)]
    pub fn invert(self, v: Vec3<T>) -> Vec3<T> {
        vec3(self.cosine * v.x - self.sine * v.z, v.y, self.cosine * v.z + self.sine * v.x)
    }
}

impl<T: Real> Default for Yaw<T> {
    fn default() -> Self {
        Self { cosine: T::one(), sine: T::zero() }
    }
}

/// Gradient of [`shade`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ShadeGradient<T = f32> {
    /// With respect to the material.
    pub surface: SurfaceGradient<T>,
    /// With respect to the position, for a fixed `wo` (see [`view_direction_vjp`]).
    pub position: Vec3<T>,
    /// With respect to the shading normal.
    pub n: Vec3<T>,
    /// With respect to the direction to the viewer.
    pub wo: Vec3<T>,
}

/// Unit direction from `position` to `eye`; zero where they coincide.
#[inline(always)]
pub fn view_direction<T: Real>(eye: Vec3<T>, position: Vec3<T>) -> Vec3<T> {
    (eye - position).normalize_or_zero()
}

/// Adjoint of [`view_direction`]: the gradient with respect to the position, from that of the direction.
#[inline(always)]
pub fn view_direction_vjp<T: Real>(eye: Vec3<T>, position: Vec3<T>, g: Vec3<T>) -> Vec3<T> {
    -(eye - position).normalize_vjp(g)
}

/// Radiance reflected towards `wo`, summed over the lights in order.
///
/// `n` (the unit shading normal, on the viewer's side: see [`crate::face_viewer`]) and `wo` are unit vectors. Point
/// and directional lights use the exact BSDF ([`crate::eval()`]); ambient light its exact integral, up to the table of
/// [`crate::split_sum()`]; environments the split-sum approximation, in which multiple scattering reflects like the
/// Lambertian lobe.
///
/// ```
/// use photofit_scalar::{Vec3, vec3};
/// use photofit_shading::{Energy, Light, Surface, shade};
/// let surface = Surface { base_color: vec3(0.5_f32, 0.5, 0.5), roughness: 0.8, metallic: 0.0, gamma: 0.0 };
/// let (up, eye) = (vec3(0.0, 1.0, 0.0), vec3(0.0, 0.8, 0.6));
/// let sun = Light::Directional { direction: up, irradiance: Vec3::splat(3.0) };
/// let sky = Light::Ambient { radiance: Vec3::splat(0.2) };
/// let both = shade(&surface, Energy::Single, Vec3::zero(), up, eye, &[sun, sky]);
/// let one = shade(&surface, Energy::Single, Vec3::zero(), up, eye, &[sun]);
/// assert!(both.x > one.x + 0.1 && one.x > 0.4);
/// ```
#[inline(always)]
pub fn shade<T: Real>(
    surface: &Surface<T>,
    energy: Energy,
    position: Vec3<T>,
    n: Vec3<T>,
    wo: Vec3<T>,
    lights: &[Light<'_, T>],
) -> Vec3<T> {
    let lobes = surface.lobes();
    match energy {
        Energy::Single => shade_lobes(&lobes, None, position, n, wo, lights),
        Energy::Compensated => shade_compensated(&lobes, position, n, wo, lights),
    }
}

/// Adjoint of [`shade`] for the gradient `g` of the radiance; the forward pass is recomputed.
#[inline(always)]
pub fn shade_vjp<T: Real>(
    surface: &Surface<T>,
    energy: Energy,
    position: Vec3<T>,
    n: Vec3<T>,
    wo: Vec3<T>,
    lights: &[Light<'_, T>],
    g: Vec3<T>,
) -> ShadeGradient<T> {
    let lobes = surface.lobes();
    let sum = match energy {
        Energy::Single => shade_lobes_vjp(&lobes, None, position, n, wo, lights, g),
        Energy::Compensated => shade_compensated_vjp(&lobes, position, n, wo, lights, g),
    };
    sum.gradient(surface)
}

/// Light from one direction at a point.
#[derive(Clone, Copy, Debug)]
pub struct Beam<T = f32> {
    /// Unit direction towards the light.
    wi: Vec3<T>,
    /// Irradiance on a surface that faces the light.
    irradiance: Vec3<T>,
    /// Inverse of the distance to the light; 0 where that is infinite.
    inverse: T,
}

impl<T: Real> Beam<T> {
    /// That of [`Light::Point`] at a position.
    #[inline(always)]
    pub fn of_point(at: Vec3<T>, intensity: Vec3<T>, position: Vec3<T>) -> Self {
        let (wi, falloff, inverse) = towards(at, position);
        Self { wi, irradiance: intensity * falloff, inverse }
    }

    /// That of [`Light::Directional`].
    #[inline(always)]
    pub fn of_direction(wi: Vec3<T>, irradiance: Vec3<T>) -> Self {
        Self { wi, irradiance, inverse: T::zero() }
    }
}

/// What [`shade`] adds up for one beam by single scattering. Without calls and branches that matter: loops over many points
/// become vector instructions.
#[inline(always)]
pub fn shade_beam<T: Real>(surface: &Surface<T>, n: Vec3<T>, wo: Vec3<T>, beam: &Beam<T>) -> Vec3<T> {
    eval_lobes(&surface.lobes(), None, n, wo, beam.wi).mul(beam.irradiance)
}

/// Adjoint of [`shade_beam`] for the gradient `g` of the radiance, the position included that a beam of a point depends on.
#[inline(always)]
pub fn shade_beam_vjp<T: Real>(
    surface: &Surface<T>,
    n: Vec3<T>,
    wo: Vec3<T>,
    beam: &Beam<T>,
    g: Vec3<T>,
) -> ShadeGradient<T> {
    let Beam { wi, irradiance, inverse } = *beam;
    let g = g.mul(irradiance);
    let (f, d) = eval_single_vjp(&surface.lobes(), n, wo, wi, g);
    let position = point_vjp(wi, inverse, d.wi, g.dot(f));
    ShadeGradient { surface: surface.lobes_vjp(&d.lobes), position, n: d.n, wo: d.wo }
}

/// Adjoint of `wi = v / |v|` and `falloff = 1 / |v|^2`, `v = at - position`, for the gradients of `wi` and of the
/// falloff's logarithm; returns that of the position.
#[inline(always)]
fn point_vjp<T: Real>(wi: Vec3<T>, inverse: T, g_wi: Vec3<T>, g_falloff: T) -> Vec3<T> {
    let g_wi = g_wi - wi * wi.dot(g_wi);
    (wi * (g_falloff + g_falloff) - g_wi) * inverse
}

/// What [`shade`] adds up for ambient light by single scattering, where [`split_sum()`] of `n.wo` and the roughness is known:
/// without calls, as [`shade_beam`].
#[inline(always)]
pub fn shade_ambient<T: Real>(surface: &Surface<T>, viewer: &SplitSum<T>, radiance: Vec3<T>) -> Vec3<T> {
    ambient(&surface.lobes(), None, viewer).mul(radiance)
}

/// Adjoint of [`shade_ambient`] for the gradient `g` of the radiance.
#[inline(always)]
pub fn shade_ambient_vjp<T: Real>(
    surface: &Surface<T>,
    viewer: &SplitSum<T>,
    n: Vec3<T>,
    wo: Vec3<T>,
    radiance: Vec3<T>,
    g: Vec3<T>,
) -> ShadeGradient<T> {
    let mut sum = Sum::default();
    ambient_vjp(&surface.lobes(), None, viewer, n, wo, g.mul(radiance), &mut sum);
    sum.gradient(surface)
}

/// Out of the way of the other policy, whose loops it must not slow down.
#[inline(never)]
fn shade_compensated<T: Real>(
    lobes: &Lobes<T>,
    position: Vec3<T>,
    n: Vec3<T>,
    wo: Vec3<T>,
    lights: &[Light<'_, T>],
) -> Vec3<T> {
    let compensation = Compensation::new(lobes, n.dot(wo));
    shade_lobes(lobes, Some(&compensation), position, n, wo, lights)
}

#[inline(never)]
fn shade_compensated_vjp<T: Real>(
    lobes: &Lobes<T>,
    position: Vec3<T>,
    n: Vec3<T>,
    wo: Vec3<T>,
    lights: &[Light<'_, T>],
    g: Vec3<T>,
) -> Sum<T> {
    let compensation = Compensation::new(lobes, n.dot(wo));
    shade_lobes_vjp(lobes, Some(&compensation), position, n, wo, lights, g)
}

#[inline(always)]
fn shade_lobes<T: Real>(
    lobes: &Lobes<T>,
    compensation: Option<&Compensation<T>>,
    position: Vec3<T>,
    n: Vec3<T>,
    wo: Vec3<T>,
    lights: &[Light<'_, T>],
) -> Vec3<T> {
    let mut sum = Vec3::zero();
    for light in lights {
        sum += match *light {
            Light::Point { position: at, intensity } => {
                let (wi, falloff, _) = towards(at, position);
                eval_lobes(lobes, compensation, n, wo, wi).mul(intensity) * falloff
            }
            Light::Directional { direction, irradiance } => {
                eval_lobes(lobes, compensation, n, wo, direction).mul(irradiance)
            }
            Light::Ambient { radiance } => {
                ambient(lobes, compensation, &viewer(lobes, compensation, n, wo)).mul(radiance)
            }
            Light::Environment { map, rotation, scale } => {
                environment(lobes, compensation, n, wo, map, rotation) * scale
            }
        };
    }
    sum
}

#[inline(always)]
fn shade_lobes_vjp<T: Real>(
    lobes: &Lobes<T>,
    compensation: Option<&Compensation<T>>,
    position: Vec3<T>,
    n: Vec3<T>,
    wo: Vec3<T>,
    lights: &[Light<'_, T>],
    g: Vec3<T>,
) -> Sum<T> {
    let mut sum = Sum::default();
    for light in lights {
        match *light {
            Light::Point { position: at, intensity } => {
                let (wi, falloff, inverse) = towards(at, position);
                let g = g.mul(intensity);
                let (f, d) = eval_lobes_vjp(lobes, compensation, n, wo, wi, g * falloff);
                sum.add_lobes(&d.lobes);
                sum.n += d.n;
                sum.wo += d.wo;
                sum.position += point_vjp(wi, inverse, d.wi, g.dot(f) * falloff);
            }
            Light::Directional { direction, irradiance } => {
                let (_, d) = eval_lobes_vjp(lobes, compensation, n, wo, direction, g.mul(irradiance));
                sum.add_lobes(&d.lobes);
                sum.n += d.n;
                sum.wo += d.wo;
            }
            Light::Ambient { radiance } => {
                let viewer = viewer(lobes, compensation, n, wo);
                ambient_vjp(lobes, compensation, &viewer, n, wo, g.mul(radiance), &mut sum);
            }
            Light::Environment { map, rotation, scale } => {
                environment_vjp(lobes, compensation, n, wo, map, rotation, g * scale, &mut sum);
            }
        }
    }
    sum
}

/// Gradients summed over the lights; `f90` is no parameter of a surface.
#[derive(Default)]
struct Sum<T> {
    diffuse: Vec3<T>,
    f0: Vec3<T>,
    roughness: T,
    position: Vec3<T>,
    n: Vec3<T>,
    wo: Vec3<T>,
}

impl<T: Real> Sum<T> {
    #[inline(always)]
    fn add_lobes(&mut self, d: &LobesGradient<T>) {
        self.diffuse += d.diffuse;
        self.f0 += d.f0;
        self.roughness += d.roughness;
    }

    #[inline(always)]
    fn gradient(self, surface: &Surface<T>) -> ShadeGradient<T> {
        let Self { diffuse, f0, roughness, position, n, wo } = self;
        let lobes = Lobes { diffuse, f0, f90: T::zero(), roughness };
        ShadeGradient { surface: surface.lobes_vjp(&lobes), position, n, wo }
    }
}

/// Unit direction to a point light, inverse squared distance and inverse distance; zero on the spot, as in the path tracer.
#[inline(always)]
fn towards<T: Real>(at: Vec3<T>, position: Vec3<T>) -> (Vec3<T>, T, T) {
    let v = at - position;
    let falloff = T::one() / v.length_squared();
    let falloff = if falloff.is_finite() { falloff } else { T::zero() };
    let inverse = falloff.sqrt();
    (v * inverse, falloff, inverse)
}

/// Scale and bias of the specular lobe towards `wo`.
#[inline(always)]
fn viewer<T: Real>(
    lobes: &Lobes<T>,
    compensation: Option<&Compensation<T>>,
    n: Vec3<T>,
    wo: Vec3<T>,
) -> SplitSum<T> {
    match compensation {
        None => split_sum(n.dot(wo), lobes.roughness),
        Some(c) => c.viewer,
    }
}

/// Part of uniform light that the Lambertian lobe and multiple scattering reflect.
#[inline(always)]
fn broad_albedo<T: Real>(lobes: &Lobes<T>, compensation: Option<&Compensation<T>>) -> Vec3<T> {
    match compensation {
        None => lobes.diffuse,
        Some(c) => c.albedo.broad_albedo(lobes.diffuse, &c.viewer),
    }
}

/// Adjoint of [`broad_albedo`] for its gradient `g`; returns that of the viewer's cosine.
#[inline(always)]
fn broad_albedo_vjp<T: Real>(
    lobes: &Lobes<T>,
    compensation: Option<&Compensation<T>>,
    g: Vec3<T>,
    sum: &mut Sum<T>,
) -> T {
    match compensation {
        None => {
            sum.diffuse += g;
            T::zero()
        }
        Some(c) => {
            let d = c.albedo.broad_albedo_vjp(lobes.diffuse, &c.viewer, g);
            sum.add_lobes(&d.lobes);
            d.cosines[0]
        }
    }
}

/// Reflection of unit radiance from everywhere: `diffuse + f0 scale + f90 bias`, and multiple scattering.
#[inline(always)]
fn ambient<T: Real>(
    lobes: &Lobes<T>,
    compensation: Option<&Compensation<T>>,
    viewer: &SplitSum<T>,
) -> Vec3<T> {
    broad_albedo(lobes, compensation) + lobes.f0 * viewer.scale + Vec3::splat(lobes.f90 * viewer.bias)
}

#[inline(always)]
fn ambient_vjp<T: Real>(
    lobes: &Lobes<T>,
    compensation: Option<&Compensation<T>>,
    viewer: &SplitSum<T>,
    n: Vec3<T>,
    wo: Vec3<T>,
    g: Vec3<T>,
    sum: &mut Sum<T>,
) {
    let s = viewer;
    let (g_scale, g_bias) = (g.dot(lobes.f0), g.sum() * lobes.f90);
    let g_cosine = g_scale * s.d_scale[0] + g_bias * s.d_bias[0];
    let g_cosine = g_cosine + broad_albedo_vjp(lobes, compensation, g, sum);
    sum.f0 += g * s.scale;
    sum.roughness += g_scale * s.d_scale[1] + g_bias * s.d_bias[1];
    sum.n += wo * g_cosine;
    sum.wo += n * g_cosine;
}

/// Axis of the specular lobe: the mirror direction, drawn towards the normal on rough surfaces by `r^2`.
#[inline(always)]
fn lobe_axis<T: Real>(n: Vec3<T>, wo: Vec3<T>, r: T) -> Vec3<T> {
    let t = r * r;
    // m + t (n - m), m = 2 (n.wo) n - wo
    n * ((T::one() - t) * (n.dot(wo) + n.dot(wo)) + t) - wo * (T::one() - t)
}

#[inline(always)]
fn environment<T: Real>(
    lobes: &Lobes<T>,
    compensation: Option<&Compensation<T>>,
    n: Vec3<T>,
    wo: Vec3<T>,
    map: &Environment<T>,
    rotation: Yaw<T>,
) -> Vec3<T> {
    let r = lobes.roughness;
    let s = viewer(lobes, compensation, n, wo);
    let specular = map.specular(rotation.invert(lobe_axis(n, wo, r)), r);
    broad_albedo(lobes, compensation).mul(map.diffuse(rotation.invert(n)))
        + specular.mul(lobes.f0 * s.scale + Vec3::splat(lobes.f90 * s.bias))
}

#[inline(always)]
fn environment_vjp<T: Real>(
    lobes: &Lobes<T>,
    compensation: Option<&Compensation<T>>,
    n: Vec3<T>,
    wo: Vec3<T>,
    map: &Environment<T>,
    rotation: Yaw<T>,
    g: Vec3<T>,
    sum: &mut Sum<T>,
) {
    let (one, two, r) = (T::one(), T::of(2.0), lobes.roughness);
    let s = viewer(lobes, compensation, n, wo);
    let broad = broad_albedo(lobes, compensation);
    let (diffuse, g_n) = map.diffuse_vjp(rotation.invert(n), |_| g.mul(broad));
    let g_specular = g.mul(lobes.f0 * s.scale + Vec3::splat(lobes.f90 * s.bias));
    let axis = rotation.invert(lobe_axis(n, wo, r));
    let (specular, g_axis, g_r) = map.specular_vjp(axis, r, g_specular);
    let g_axis = rotation.apply(g_axis);
    let g_albedo = g.mul(specular);
    let (g_scale, g_bias) = (g_albedo.dot(lobes.f0), g_albedo.sum() * lobes.f90);

    // axis = k n - (1 - t) wo, k = 2 (1 - t)(n.wo) + t, t = r^2
    let (t, cosine) = (r * r, n.dot(wo));
    let g_k = g_axis.dot(n);
    let g_cosine = g_scale * s.d_scale[0] + g_bias * s.d_bias[0] + g_k * two * (one - t);
    let g_cosine = g_cosine + broad_albedo_vjp(lobes, compensation, g.mul(diffuse), sum);
    let g_t = g_k * (one - two * cosine) + g_axis.dot(wo);
    sum.f0 += g_albedo * s.scale;
    sum.roughness += g_scale * s.d_scale[1] + g_bias * s.d_bias[1] + g_r + two * r * g_t;
    sum.n += rotation.apply(g_n) + g_axis * (two * (one - t) * cosine + t) + wo * g_cosine;
    sum.wo += n * g_cosine - g_axis * (one - t);
}
