//! The slope of ln z that normals demand: the target of the normal term.
//!
//! On the plane `n . P = c` the depth along the ray `r = (X, Y, 1)` is `c / (n . r)`, so that
//! `ln z(x + 1) - ln z(x) = ln(n . r(x)) - ln(n . r(x + 1))`: exact between pixels, free of z, and the sign of n
//! cancels.

use super::Pinhole;
use photofit_scalar::{Real, Vec3};
use rayon::prelude::*;

/// Least `|n . r|`: beyond it the plane is seen edge-on.
const LEAST: f64 = 0.05;
/// Range of the ratio of depths of neighbouring pixels.
const RATIO: (f64, f64) = (0.5, 2.0);

/// Differences of ln z to the right and downwards, pixel by pixel; zero where the normal is zero.
///
/// `normal` holds camera-frame normals (right, down, forward) of either sign, row by row.
///
/// # Panics
/// If there is not one normal per pixel.
pub fn normal_target<T: Real>(normal: &[Vec3<T>], camera: &Pinhole) -> (Vec<T>, Vec<T>) {
    assert_eq!(normal.len(), camera.pixels(), "one normal per pixel");
    let w = camera.width;
    let (mut gx, mut gy) = (vec![T::zero(); normal.len()], vec![T::zero(); normal.len()]);
    gx.par_chunks_mut(w).zip(gy.par_chunks_mut(w)).zip(normal.par_chunks(w)).enumerate().for_each(
        |(y, ((gx, gy), normal))| {
            let ry = T::of((y as f64 + 0.5 - camera.cy) / camera.fy);
            for (x, n) in normal.iter().enumerate() {
                let rx = T::of((x as f64 + 0.5 - camera.cx) / camera.fx);
                let steps = [T::of(1.0 / camera.fx), T::of(1.0 / camera.fy)];
                [gx[x], gy[x]] = slope(*n, rx, ry, steps);
            }
        },
    );
    (gx, gy)
}

/// The differences at one pixel.
#[inline]
pub(super) fn slope<T: Real>(n: Vec3<T>, rx: T, ry: T, steps: [T; 2]) -> [T; 2] {
    let here = n.x * rx + n.y * ry + n.z;
    let sign = if here < T::zero() { -T::one() } else { T::one() };
    let least = T::of(LEAST) * n.length();
    let clamp = |v: T| if v > least { v } else { least };
    let m = clamp(here * sign);
    let there = [clamp((here + n.x * steps[0]) * sign), clamp((here + n.y * steps[1]) * sign)];
    let none = n.length_squared() == T::zero();
    there.map(|t| if none { T::zero() } else { (m / t).clamp_to(T::of(RATIO.0), T::of(RATIO.1)).ln() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_scalar::vec3;

    #[test]
    fn planes_have_their_exact_slope() {
        let camera = Pinhole::look_at([0.0; 3], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0], 1.0, 40, 30);
        let n = vec3(0.45_f64, -0.2, -0.8);
        let ln_z = |x: usize, y: usize| {
            let (rx, ry) =
                ((x as f64 + 0.5 - camera.cx) / camera.fx, (y as f64 + 0.5 - camera.cy) / camera.fy);
            (3.0 / -(n.x * rx + n.y * ry + n.z)).ln()
        };
        for sign in [1.0, -1.0] {
            let (gx, gy) = normal_target(&vec![n * sign; 1200], &camera);
            let mut worst = 0.0_f64;
            for y in 0..29 {
                for x in 0..39 {
                    worst = worst.max((gx[y * 40 + x] - (ln_z(x + 1, y) - ln_z(x, y))).abs());
                    worst = worst.max((gy[y * 40 + x] - (ln_z(x, y + 1) - ln_z(x, y))).abs());
                }
            }
            assert!(worst < 2e-14, "{worst}");
        }
    }

    #[test]
    fn grazing_and_missing_normals_stay_bounded() {
        let camera = Pinhole::look_at([0.0; 3], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0], 2.5, 5, 1);
        let normals = [
            vec3(0.0_f32, 0.0, 0.0),
            vec3(1.0, 0.0, 0.0),
            vec3(-1.0, 0.0, 1e-9),
            vec3(0.7, 0.7, 0.0),
            vec3(0.0, 0.0, 1.0),
        ];
        let (gx, gy) = normal_target(&normals, &camera);
        assert_eq!((gx[0], gy[0], gx[4], gy[4]), (0.0, 0.0, 0.0, 0.0));
        assert!(gx.iter().chain(&gy).all(|g| g.abs() <= 2.0_f32.ln() + 1e-6), "{gx:?} {gy:?}");
    }
}
