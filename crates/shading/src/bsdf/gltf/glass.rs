//! Compensation of the energy that single scattering at a rough refracting boundary loses.
//!
//! As for reflection (Kulla and Conty 2017), on both sides: with `E` the part of light that single scattering reflects or
//! refracts, `c_R (1 - E(wo)) (1 - E(wi)) / (pi (1 - Ea))` is reflected and the same with `c_T` and the other side's
//! `E(wi)` and `Ea` passes. `c_R + c_T = 1` on each side; `c_T` outside is the average of `1 - F`, or less where the
//! other side's would exceed 1, and that inside follows by reciprocity. `E` is tabulated at first use over cosine,
//! roughness, index and side, apart from Schlick's `f0` and `f90`, in which it is linear.

use crate::bsdf::ggx::Ggx;
use crate::bsdf::refraction::{Facets, reflect, refract, refracted_cosine};
use crate::bsdf::table::{coordinates, interpolate};
use crate::energy::schlick_weight;
use photofit_scalar::{Real, vec3};
use std::sync::LazyLock;

/// Points along the cosine (see [`cosine_coordinate`]), the perceptual roughness, and the cosine of the critical angle,
/// `sqrt(1 - 1 / n^2)`, up to [`CRITICAL_MAX`].
const SIZE: [usize; 3] = [33, 14, 12];
/// Largest cosine of the critical angle: an index of 3. Higher ones read the table there.
const CRITICAL_MAX: f64 = 0.943;
/// Points of the quadrature along each axis.
const POINTS: usize = 20;
/// Smallest cosine and roughness of the table.
const COSINE_MIN: f64 = 1e-3;
const ROUGHNESS_MIN: f64 = 0.02;

/// Parts of the light that single scattering handles: totally reflected; reflected in proportion to `f0` and to `f90`;
/// refracted in proportion to `1 - f0` and to `1 - f90`.
type Parts = [f32; 5];

// On one thread: a worker of a pool that waits for others in here could be given work that waits for this table.
static OUTSIDE: LazyLock<Vec<Parts>> = LazyLock::new(|| table(false));
static INSIDE: LazyLock<Vec<Parts>> = LazyLock::new(|| table(true));
static OUTSIDE_AVERAGE: LazyLock<Vec<Parts>> = LazyLock::new(|| averages(&OUTSIDE, false));
static INSIDE_AVERAGE: LazyLock<Vec<Parts>> = LazyLock::new(|| averages(&INSIDE, true));

fn table(inside: bool) -> Vec<Parts> {
    (0..SIZE.iter().product::<usize>()).map(|k| entry(coordinates(&SIZE, k), inside)).collect()
}

fn entry(at: [f64; 3], inside: bool) -> Parts {
    let critical = at[2] * CRITICAL_MAX;
    let mu = cosine_of(at[0], if inside { critical } else { 0.0 }).max(COSINE_MIN);
    let wo = vec3((1.0 - mu * mu).sqrt(), 0.0, mu);
    let roughness = at[1].max(ROUGHNESS_MIN);
    let ggx = Ggx::isotropic(roughness * roughness);
    let ior = 1.0 / (1.0 - critical * critical).sqrt();
    let eta = if inside { 1.0 / ior } else { ior };
    let mut sum = [0.0; 5];
    for i in 0..POINTS * POINTS {
        let u = |k: usize| (k as f64 + 0.5) / POINTS as f64;
        let m = ggx.sample(wo, [u(i % POINTS), u(i / POINTS)]);
        let c = wo.dot(m);
        // The masking of both directions over that of `wo`.
        let masking = |z: f64, visibility: f64| 4.0 * visibility * z.abs() * ggx.masked(wo);
        let refracted = refracted_cosine(c, eta);
        let p = schlick_weight(if inside { refracted.unwrap_or(0.0) } else { c });
        let wi = reflect(wo, m);
        if wi.z > 0.0 {
            let w = masking(wi.z, ggx.visibility(wo, wi));
            match refracted {
                None => sum[0] += w,
                Some(_) => {
                    sum[1] += (1.0 - p) * w;
                    sum[2] += p * w;
                }
            }
        }
        if let Some(wi) = refract(wo, m, eta).filter(|wi| wi.z < 0.0) {
            let w = masking(wi.z, ggx.visibility(wo, wi));
            sum[3] += (1.0 - p) * w;
            sum[4] += p * w;
        }
    }
    sum.map(|s| (s / (POINTS * POINTS) as f64) as f32)
}

/// Coordinate from 0 to 1 of a cosine: its square root outside; inside the first half goes up to the critical angle and
/// the second on from there, so that total reflection sets in at a point of the table for every index.
#[inline]
fn cosine_coordinate<T: Real>(mu: T, critical: T) -> T {
    let half = T::of(0.5);
    if critical <= T::zero() {
        mu.sqrt()
    } else if mu < critical {
        half * (mu / critical).sqrt()
    } else {
        half + half * ((mu - critical) / (T::one() - critical)).relu().sqrt()
    }
}

/// Inverse of [`cosine_coordinate`].
fn cosine_of(x: f64, critical: f64) -> f64 {
    if critical <= 0.0 {
        x * x
    } else if x < 0.5 {
        4.0 * x * x * critical
    } else {
        critical + (2.0 * x - 1.0).powi(2) * (1.0 - critical)
    }
}

fn averages(table: &[Parts], inside: bool) -> Vec<Parts> {
    let entry = |k: usize| {
        let steps = 256;
        let mut sum = [0.0; 5];
        for i in 0..steps {
            let mu = (i as f64 + 0.5) / steps as f64;
            let critical =
                if inside { (k / SIZE[1]) as f64 / (SIZE[2] - 1) as f64 * CRITICAL_MAX } else { 0.0 };
            let x = cosine_coordinate(mu, critical) * (SIZE[0] - 1) as f64;
            let parts: [f64; 5] = interpolate(table, &SIZE, [x, (k % SIZE[1]) as f64, (k / SIZE[1]) as f64]);
            (0..5).for_each(|c| sum[c] += 2.0 * mu * parts[c] / steps as f64);
        }
        sum.map(|s| s as f32)
    };
    (0..SIZE[1] * SIZE[2]).map(entry).collect()
}

/// What multiple scattering adds for one direction.
#[derive(Clone, Copy, Debug)]
pub(super) struct Glass<T> {
    f0: T,
    f90: T,
    /// Coordinates of roughness and index in the table.
    at: [T; 2],
    /// Cosine of the critical angle inside, at most that of the table.
    critical: T,
    inside: bool,
    /// `1 - E(wo)`.
    lost: T,
    /// `1 - Ea` on the side of `wo` and on the other one.
    lost_average: [T; 2],
    /// `c_T`.
    passed: T,
}

/// Smallest `1 - Ea`: where less is lost, nothing is given back.
const LOST_MIN: f64 = 1e-5;

impl<T: Real> Glass<T> {
    /// For `wo` of cosine `mu` on one side of a boundary with Schlick's `f0` and `f90`, GGX `alpha` and index `ior`.
    #[inline]
    pub(super) fn new(f0: T, f90: T, alpha: T, ior: T, inside: bool, mu: T) -> Self {
        let one = T::one();
        let critical = (one - one / (ior * ior)).relu().sqrt().min(T::of(CRITICAL_MAX));
        let index = critical * T::of((SIZE[2] - 1) as f64 / CRITICAL_MAX);
        let at = [alpha.sqrt() * T::of((SIZE[1] - 1) as f64), index];
        let size = [SIZE[1], SIZE[2]];
        let lost = |table: &[Parts]| one - whole(f0, f90, interpolate(table, &size, at));
        let (out, inn) = (lost(&OUTSIDE_AVERAGE), lost(&INSIDE_AVERAGE));
        let floor = T::of(LOST_MIN);
        // `c_T` inside is that outside times this.
        let ratio = if inn > floor { out / (inn * ior * ior) } else { T::zero() };
        let fresnel = f0 * T::of(20.0 / 21.0) + f90 * T::of(1.0 / 21.0);
        let passed = (one - fresnel).relu().min(one / ratio.max(T::of(1e-6)));
        let mut glass = Self {
            f0,
            f90,
            at,
            critical,
            inside,
            lost: T::zero(),
            lost_average: if inside { [inn, out] } else { [out, inn] },
            passed: if inside { passed * ratio } else { passed },
        };
        if out > floor && inn > floor {
            glass.lost = glass.lost_at(mu, inside);
        }
        glass
    }

    /// `1 - E` for a cosine on a side.
    #[inline]
    fn lost_at(&self, mu: T, inside: bool) -> T {
        let table: &[Parts] = if inside { &INSIDE } else { &OUTSIDE };
        let critical = if inside { self.critical } else { T::zero() };
        let x = cosine_coordinate(mu.abs(), critical) * T::of((SIZE[0] - 1) as f64);
        let parts = interpolate(table, &SIZE, [x, self.at[0], self.at[1]]);
        (T::one() - whole(self.f0, self.f90, parts)).relu()
    }

    /// Albedos of what is added: reflected and passed.
    #[inline]
    pub(super) fn albedo(&self) -> [T; 2] {
        [self.lost * (T::one() - self.passed), self.lost * self.passed]
    }

    /// Value without cosine and, where light passes, without the factor of radiance, for `wi` of cosine `mu`.
    #[inline]
    pub(super) fn value(&self, mu: T, passes: bool) -> T {
        let zero = T::zero();
        if self.lost <= zero {
            return zero;
        }
        let inv_pi = T::of(std::f64::consts::FRAC_1_PI);
        let lost = self.lost_at(mu, self.inside != passes);
        let [here, there] = self.lost_average;
        if passes {
            self.passed * self.lost * lost * inv_pi / there
        } else {
            (T::one() - self.passed) * self.lost * lost * inv_pi / here
        }
    }
}

/// `E` for Schlick's `f0` and `f90`.
#[inline(always)]
fn whole<T: Real>(f0: T, f90: T, [total, r0, r90, t0, t90]: [T; 5]) -> T {
    total + f0 * r0 + f90 * r90 + (T::one() - f0) * t0 + (T::one() - f90) * t90
}
