//! Sheen: microfibres with the Charlie distribution (Estevez and Kulla 2017).
//!
//! `f = color D V`, `D = (2 + 1/a) sin(theta_h)^(1/a) / (2 pi)`, `V = 1 / ((1 + L(mu_o) + L(mu_i)) 4 mu_o mu_i)` with the
//! fit of `L` in the paper and `a` the square of the sheen roughness. The albedo of that formula exceeds 1 where both
//! the roughness and the cosine are small: there the value is divided by the larger albedo of the two directions.

use photofit_scalar::{Real, Vec3};
use std::sync::LazyLock;

/// Smallest `a` of the distribution: below it the powers leave the range of `f32`.
const ALPHA_MIN: f64 = 0.005;
/// Cosines and sheen roughnesses in the table of albedos.
const COSINES: usize = 40;
const ROUGHNESSES: usize = 20;
/// Quadrature points per entry, along each axis.
const POLAR: usize = 64;
const AZIMUTHAL: usize = 24;
/// Smallest cosine of the table; cosines go with the square of the coordinate, because the albedo rises at grazing.
const COSINE_MIN: f64 = 1e-3;

// On one thread: a worker of a pool that waits for others in here could be given work that waits for this table.
static ALBEDO: LazyLock<Vec<f32>> = LazyLock::new(|| {
    let entry = |k: usize| {
        let (i, j) = (k % COSINES, k / COSINES);
        let x = i as f64 / (COSINES - 1) as f64;
        let r = j as f64 / (ROUGHNESSES - 1) as f64;
        integrate((x * x).max(COSINE_MIN), alpha(r)) as f32
    };
    (0..COSINES * ROUGHNESSES).map(entry).collect()
});

/// Albedo of the formula without Fresnel and color, by quadrature with points dense at grazing.
fn integrate(mu_o: f64, a: f64) -> f64 {
    let mut sum = 0.0;
    let sine_o = (1.0 - mu_o * mu_o).sqrt();
    for i in 0..POLAR {
        let x = (i as f64 + 0.5) / POLAR as f64;
        let mu_i = x * x;
        let sine_i = (1.0 - mu_i * mu_i).sqrt();
        for j in 0..AZIMUTHAL {
            let phi = std::f64::consts::PI * (j as f64 + 0.5) / AZIMUTHAL as f64;
            let h: Vec3<f64> = Vec3 { x: sine_o + sine_i * phi.cos(), y: sine_i * phi.sin(), z: mu_o + mu_i };
            let sine_h = h.x.hypot(h.y) / h.length();
            // dmu = 2 x dx, and half of the azimuths.
            sum += raw(a, mu_o, mu_i, sine_h) * mu_i * 2.0 * x;
        }
    }
    sum * 2.0 * std::f64::consts::PI / (POLAR * AZIMUTHAL) as f64
}

/// `a` for a sheen roughness.
#[inline(always)]
pub(super) fn alpha<T: Real>(roughness: T) -> T {
    (roughness * roughness).max(T::of(ALPHA_MIN))
}

/// `D V`.
#[inline(always)]
fn raw<T: Real>(a: T, mu_o: T, mu_i: T, sine_h: T) -> T {
    let one = T::one();
    let inv = one / a;
    let d = (T::of(2.0) + inv) * sine_h.powf(inv) * T::of(0.5 * std::f64::consts::FRAC_1_PI);
    let v = (one + lambda(a, mu_o) + lambda(a, mu_i)) * T::of(4.0) * mu_o * mu_i;
    d / v
}

/// The paper's fit of Smith's lambda: interpolated between the curves of `a = 0` and `a = 1`.
#[inline(always)]
fn lambda<T: Real>(a: T, mu: T) -> T {
    let (one, half) = (T::one(), T::of(0.5));
    let t = (one - a) * (one - a);
    let mix = |rough: f64, sharp: f64| T::of(rough) + (T::of(sharp) - T::of(rough)) * t;
    let p = [
        mix(21.5473, 25.3245),
        mix(3.829_87, 3.324_35),
        mix(0.198_23, 0.168_01),
        mix(-1.977_60, -1.273_93),
        mix(-4.320_54, -4.859_67),
    ];
    let curve = |x: T| p[0] / (one + p[1] * x.powf(p[2])) + p[3] * x + p[4];
    if mu < half { curve(mu).exp() } else { (T::of(2.0) * curve(half) - curve(one - mu)).exp() }
}

/// Albedo of the formula, as tabulated.
#[inline]
fn tabulated<T: Real>(mu: T, roughness: T) -> T {
    let x = mu.clamp_to(T::of(COSINE_MIN), T::one()).sqrt() * T::of((COSINES - 1) as f64);
    let y = roughness.clamp_to(T::zero(), T::one()) * T::of((ROUGHNESSES - 1) as f64);
    let (i, j) = ((x.f64() as usize).min(COSINES - 2), (y.f64() as usize).min(ROUGHNESSES - 2));
    let (fx, fy) = (x - T::of(i as f64), y - T::of(j as f64));
    let at = |i: usize, j: usize| T::of(f64::from(ALBEDO[j * COSINES + i]));
    let low = at(i, j) + (at(i + 1, j) - at(i, j)) * fx;
    let high = at(i, j + 1) + (at(i + 1, j + 1) - at(i, j + 1)) * fx;
    low + (high - low) * fy
}

/// Albedo of the lobe of colour 1 towards a direction of cosine `mu`, at most 1.
#[inline]
pub(super) fn albedo<T: Real>(mu: T, roughness: T) -> T {
    tabulated(mu, roughness).min(T::one())
}

/// `D V`, divided by the albedo where that exceeds 1; both directions above the surface.
#[inline]
pub(super) fn value<T: Real>(roughness: T, wo: Vec3<T>, wi: Vec3<T>) -> T {
    let h = (wo + wi).normalize_or_zero();
    let sine_h = (h.x * h.x + h.y * h.y).sqrt();
    let cosine = |v: Vec3<T>| v.z.clamp_to(T::of(COSINE_MIN), T::one());
    let raw = raw(alpha(roughness), cosine(wo), cosine(wi), sine_h.min(T::one()));
    raw / tabulated(wo.z, roughness).max(tabulated(wi.z, roughness)).max(T::one())
}
