//! Directional albedo of the anisotropic GGX lobe, tabulated at first use.
//!
//! As [`crate::split_sum()`], but over cosine, azimuth and both alphas: `scale = int (1 - p) f`, `bias = int p f` with
//! `p = (1 - wo.h)^5`, by quadrature over the visible normals. Between the points it is linear along each axis.

use super::ggx::Ggx;
use super::refraction::{Facets, reflect};
use super::table::{coordinates, interpolate};
use crate::energy::schlick_weight;
use photofit_scalar::{Real, Vec3, vec3};
use std::sync::LazyLock;

/// Points along the square root of the cosine, the squared sine of the azimuth, the perceptual roughness of the longer
/// axis, and that of the shorter one over it.
const SIZE: [usize; 4] = [14, 5, 14, 9];
/// Points of the quadrature along each axis.
const POINTS: usize = 30;
/// Smallest cosine and roughness of the table.
const COSINE_MIN: f64 = 1e-3;
const ROUGHNESS_MIN: f64 = 0.02;

// On one thread: a worker of a pool that waits for others in here could be given work that waits for this table.
static TABLE: LazyLock<Vec<[f32; 2]>> =
    LazyLock::new(|| (0..SIZE.iter().product::<usize>()).map(entry).collect());

/// Averages over all directions, by both roughnesses.
static AVERAGES: LazyLock<Vec<[f32; 2]>> = LazyLock::new(|| {
    let entry = |k: usize| {
        let (long, ratio) = (k % SIZE[2], k / SIZE[2]);
        let (cosines, azimuths) = (64, 16);
        let mut sum = [0.0; 2];
        for i in 0..cosines * azimuths {
            let mu = ((i % cosines) as f64 + 0.5) / cosines as f64;
            let phi = std::f64::consts::FRAC_PI_2 * ((i / cosines) as f64 + 0.5) / azimuths as f64;
            let at = [mu.sqrt() * (SIZE[0] - 1) as f64, phi.sin().powi(2) * (SIZE[1] - 1) as f64];
            let e: [f64; 2] = interpolate(&TABLE, &SIZE, [at[0], at[1], long as f64, ratio as f64]);
            (0..2).for_each(|c| sum[c] += 2.0 * mu * e[c] / (cosines * azimuths) as f64);
        }
        sum.map(|s| s as f32)
    };
    (0..SIZE[2] * SIZE[3]).map(entry).collect()
});

fn entry(k: usize) -> [f32; 2] {
    let at = coordinates(&SIZE, k);
    let mu = (at[0] * at[0]).max(COSINE_MIN);
    let sine = (1.0 - mu * mu).sqrt();
    let (s, c) = (at[1].sqrt(), (1.0 - at[1]).sqrt());
    let wo = vec3(sine * c, sine * s, mu);
    let long = at[2].max(ROUGHNESS_MIN);
    let short = (long * at[3]).max(ROUGHNESS_MIN);
    let ggx = Ggx { ax: long * long, ay: short * short };
    let mut sum = [0.0; 2];
    for i in 0..POINTS * POINTS {
        let u = |k: usize| (k as f64 + 0.5) / POINTS as f64;
        let m = ggx.sample(wo, [u(i % POINTS), u(i / POINTS)]);
        let wi = reflect(wo, m);
        if wi.z > 0.0 {
            // The masking of both directions over that of `wo`.
            let w = 4.0 * ggx.visibility(wo, wi) * wi.z * ggx.masked(wo);
            let p = schlick_weight(wo.dot(m));
            sum[0] += (1.0 - p) * w;
            sum[1] += p * w;
        }
    }
    sum.map(|s| (s / (POINTS * POINTS) as f64) as f32)
}

/// Coordinates of both alphas in the table, the longer one first, and whether they are swapped.
#[inline]
fn alphas<T: Real>(ggx: &Ggx<T>) -> ([T; 2], bool) {
    let swapped = ggx.ay > ggx.ax;
    let (long, short) = if swapped { (ggx.ay, ggx.ax) } else { (ggx.ax, ggx.ay) };
    let ratio = if long > T::zero() { (short / long).sqrt() } else { T::one() };
    ([long.sqrt() * T::of((SIZE[2] - 1) as f64), ratio * T::of((SIZE[3] - 1) as f64)], swapped)
}

/// Scale and bias towards a direction above the surface.
#[inline]
pub(super) fn directional<T: Real>(ggx: &Ggx<T>, v: Vec3<T>) -> [T; 2] {
    let ([long, ratio], swapped) = alphas(ggx);
    let (x, y) = (v.x * v.x, v.y * v.y);
    let sine = if x + y > T::zero() { (if swapped { x } else { y }) / (x + y) } else { T::of(0.5) };
    let mu = v.z.abs().sqrt() * T::of((SIZE[0] - 1) as f64);
    interpolate(&TABLE, &SIZE, [mu, sine * T::of((SIZE[1] - 1) as f64), long, ratio])
}

/// Averages of scale and bias over all directions.
#[inline]
pub(super) fn average<T: Real>(ggx: &Ggx<T>) -> [T; 2] {
    interpolate(&AVERAGES, &[SIZE[2], SIZE[3]], alphas(ggx).0)
}
