//! Random rotations.

use photofit_scalar::Real;

/// A uniformly distributed rotation from `u` in `[0, 1)^3`, as the rows of a matrix (Shoemake 1992): a uniform unit
/// quaternion, converted. The matrix is orthogonal with determinant 1.
///
/// ```
/// let m = photofit_sampling::random_rotation([0.3_f64, 0.7, 0.1]);
/// let dot: f64 = (0..3).map(|i| m[0][i] * m[1][i]).sum();
/// assert!(dot.abs() < 1e-12);
/// ```
pub fn random_rotation<T: Real>(u: [T; 3]) -> [[T; 3]; 3] {
    let tau = T::of(2.0 * std::f64::consts::PI);
    let (r1, r2) = ((T::one() - u[0]).relu().sqrt(), u[0].relu().sqrt());
    let ((s1, c1), (s2, c2)) = ((tau * u[1]).sin_cos(), (tau * u[2]).sin_cos());
    let (x, y, z, w) = (s1 * r1, c1 * r1, s2 * r2, c2 * r2);
    let (one, two) = (T::one(), T::of(2.0));
    [
        [one - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)],
        [two * (x * y + w * z), one - two * (x * x + z * z), two * (y * z - w * x)],
        [two * (x * z - w * y), two * (y * z + w * x), one - two * (x * x + y * y)],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Rng;
    use crate::statistics::chi_square;
    use std::f64::consts::PI;

    fn draw(rng: &mut Rng) -> [[f64; 3]; 3] {
        random_rotation([rng.next_f64(), rng.next_f64(), rng.next_f64()])
    }

    #[test]
    fn rotations_are_orthogonal_with_determinant_one() {
        let mut rng = Rng::new(1, 0);
        for _ in 0..1000 {
            let m = draw(&mut rng);
            for i in 0..3 {
                for j in 0..3 {
                    let dot: f64 = (0..3).map(|k| m[i][k] * m[j][k]).sum();
                    assert!((dot - f64::from(u8::from(i == j))).abs() < 1e-12);
                }
            }
            let minor = |a: usize, b: usize| m[1][a] * m[2][b] - m[1][b] * m[2][a];
            let det = m[0][0] * minor(1, 2) + m[0][1] * minor(2, 0) + m[0][2] * minor(0, 1);
            assert!((det - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn angles_and_axes_follow_the_uniform_measure() {
        // The angle of a uniform rotation has density (1 - cos t) / pi on [0, pi].
        let cdf = |t: f64| (t - t.sin()) / PI;
        let bins = 24;
        let probabilities: Vec<f64> = (0..bins)
            .map(|i| cdf((i + 1) as f64 / bins as f64 * PI) - cdf(i as f64 / bins as f64 * PI))
            .collect();
        let mut angles = vec![0; bins];
        let mut columns = vec![vec![0; 20]; 9];
        let mut rng = Rng::new(2, 0);
        for _ in 0..100_000 {
            let m = draw(&mut rng);
            let cos = 0.5 * (m[0][0] + m[1][1] + m[2][2] - 1.0);
            angles[((cos.clamp(-1.0, 1.0).acos() / PI * bins as f64) as usize).min(bins - 1)] += 1;
            for (i, counts) in columns.iter_mut().enumerate() {
                // Each entry is a coordinate of a uniform direction, hence uniform in [-1, 1].
                counts[((m[i / 3][i % 3] * 0.5 + 0.5) * 20.0).clamp(0.0, 19.0) as usize] += 1;
            }
        }
        chi_square("angles", &angles, &probabilities);
        for (i, counts) in columns.iter().enumerate() {
            chi_square(&format!("entry {i}"), counts, &[0.05; 20]);
        }
    }
}
