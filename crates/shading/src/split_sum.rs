//! Directional albedo of the specular lobe as `f0 * scale + bias` (the split-sum of Karis 2013).
//!
//! `scale = int (1 - p) D V (n.wi) dwi` and `bias = int p D V (n.wi) dwi` with `p = (1 - wo.h)^5`, over the hemisphere:
//! exact for a constant environment, because Schlick's term is linear in `f0`. The integrals are tabulated once per
//! process over cosine and roughness and read bilinearly.

use crate::ggx::{COSINE_MIN, ROUGHNESS_MIN};
use photofit_scalar::Real;
use std::sync::LazyLock;

/// Cosines and roughnesses in the table.
const COSINES: usize = 64;
const ROUGHNESSES: usize = 48;
/// The table is denser near grazing: coordinate `(1 + c) x / (x + c)` of the cosine x.
const GRAZING: f64 = 0.05;
/// Quadrature points per entry: polar and azimuthal.
const POLAR: usize = 64;
const AZIMUTHAL: usize = 32;

static TABLE: LazyLock<Vec<[f32; 2]>> = LazyLock::new(|| {
    let mut table = Vec::with_capacity(COSINES * ROUGHNESSES);
    for j in 0..ROUGHNESSES {
        let r = ROUGHNESS_MIN + (1.0 - ROUGHNESS_MIN) * j as f64 / (ROUGHNESSES - 1) as f64;
        for i in 0..COSINES {
            let x = i as f64 / (COSINES - 1) as f64;
            let cosine = GRAZING * x / (1.0 + GRAZING - x);
            let (scale, bias) = integrate(cosine, r, POLAR, AZIMUTHAL);
            table.push([scale as f32, bias as f32]);
        }
    }
    table
});

/// The table, row by row of a roughness, and its columns.
#[cfg(feature = "gpu")]
pub(crate) fn table() -> (&'static [[f32; 2]], usize) {
    (&TABLE, COSINES)
}

/// Scale and bias with their derivatives.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SplitSum<T = f32> {
    /// Factor of `f0`.
    pub scale: T,
    /// Constant part.
    pub bias: T,
    /// Derivative of the scale by the cosine and by the roughness.
    pub d_scale: [T; 2],
    /// Derivative of the bias by the cosine and by the roughness.
    pub d_bias: [T; 2],
}

/// Scale and bias for `cosine = n.wo` (floored at [`COSINE_MIN`]) and perceptual roughness in [`ROUGHNESS_MIN`]..1.
///
/// The largest error against numerical integration is 5e-3 (at grazing, smooth surfaces), the rms error below 1e-3.
/// Derivatives are those of the interpolation; they vanish where the arguments are clamped.
#[inline(always)]
pub fn split_sum<T: Real>(cosine: T, roughness: T) -> SplitSum<T> {
    let one = T::one();
    let (lo, hi) = (T::of(COSINE_MIN), one);
    let c = cosine.clamp_to(lo, hi);
    let d_c = if c == cosine { one } else { T::zero() };
    let inv = one / (c + T::of(GRAZING));
    let to_x = T::of((1.0 + GRAZING) * (COSINES - 1) as f64);
    let x = c * inv * to_x;
    let d_x = to_x * T::of(GRAZING) * inv * inv * d_c;

    let r = roughness.clamp_to(T::of(ROUGHNESS_MIN), one);
    let to_y = T::of((ROUGHNESSES - 1) as f64 / (1.0 - ROUGHNESS_MIN));
    let y = (r - T::of(ROUGHNESS_MIN)) * to_y;
    let d_y = if r == roughness { to_y } else { T::zero() };

    let i = (x.f64() as usize).min(COSINES - 2);
    let j = (y.f64() as usize).min(ROUGHNESSES - 2);
    let (fx, fy) = (x - T::of(i as f64), y - T::of(j as f64));
    let row = &TABLE[j * COSINES + i..][..COSINES + 2];
    let (a, b, c, d) = (row[0], row[1], row[COSINES], row[COSINES + 1]);
    let channel = |k: usize| {
        let [a, b, c, d] = [a, b, c, d].map(|v| T::of(f64::from(v[k])));
        let (low, high) = (a + (b - a) * fx, c + (d - c) * fx);
        let slope = (b - a) + ((d - c) - (b - a)) * fy;
        (low + (high - low) * fy, [slope * d_x, (high - low) * d_y])
    };
    let ((scale, d_scale), (bias, d_bias)) = (channel(0), channel(1));
    SplitSum { scale, bias, d_scale, d_bias }
}

/// Midpoint quadrature over half vectors distributed as the normals: with `(n.h) D dh = du dphi / 2 pi`, the
/// integrand is `4 V (n.wi) (wo.h) / (n.h)`; the substitution `1 - u = t^2` removes its singularity.
fn integrate(cosine: f64, roughness: f64, polar: usize, azimuthal: usize) -> (f64, f64) {
    let a2 = roughness.powi(4);
    let nv = cosine.max(COSINE_MIN);
    let sine = (1.0 - nv * nv).max(0.0).sqrt();
    let lo = (nv * nv * (1.0 - a2) + a2).sqrt();
    let (mut scale, mut bias) = (0.0, 0.0);
    for i in 0..polar {
        let t = (i as f64 + 0.5) / polar as f64;
        let nh = t / (a2 + (1.0 - a2) * t * t).sqrt();
        let sh = (1.0 - nh * nh).max(0.0).sqrt();
        for j in 0..azimuthal {
            let phi = (j as f64 + 0.5) / azimuthal as f64 * std::f64::consts::PI;
            let vh = sine * sh * phi.cos() + nv * nh;
            let nl = 2.0 * vh * nh - nv;
            if nl > 0.0 && vh > 0.0 {
                let v = 0.5 / (nl * lo + nv * (nl * nl * (1.0 - a2) + a2).sqrt());
                let w = 8.0 * t * v * nl * vh / nh;
                let p = (1.0 - vh).max(0.0).powi(5);
                scale += (1.0 - p) * w;
                bias += p * w;
            }
        }
    }
    let count = (polar * azimuthal) as f64;
    (scale / count, bias / count)
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_gradcheck::Uniform;

    #[test]
    fn table_agrees_with_integration() {
        let mut random = Uniform::new(7);
        let (mut worst, mut sum, mut count): ([f64; 2], [f64; 2], f64) = ([0.0; 2], [0.0; 2], 0.0);
        let mut at = [(0.0, 0.0); 2];
        for k in 0..400 {
            let c = if k % 4 == 0 { 10f64.powf(random.range(-3.0, 0.0)) } else { random.range(0.0, 1.0) };
            let r = random.range(ROUGHNESS_MIN, 1.0);
            let reference = integrate(c, r, 512, 128);
            let table = split_sum(c, r);
            let e = [(table.scale - reference.0).abs(), (table.bias - reference.1).abs()];
            for m in 0..2 {
                if e[m] > worst[m] {
                    worst[m] = e[m];
                    at[m] = (c, r);
                }
                sum[m] += e[m] * e[m];
            }
            count += 1.0;
        }
        let rms = sum.map(|s| (s / count).sqrt());
        assert!(worst.iter().all(|e| *e < 6e-3), "worst errors {worst:?} at {at:?}");
        assert!(rms.iter().all(|e| *e < 1e-3), "rms errors {rms:?}");
    }
}
