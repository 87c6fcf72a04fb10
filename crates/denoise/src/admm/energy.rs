//! The energy of an image, in double precision, with natural boundaries.

use photofit_scalar::Real;
use rayon::prelude::{IntoParallelIterator, ParallelIterator};

use super::{Coupling, Problem};

impl<T: Real> Problem<'_, T> {
    /// `E(u)`. Rows are summed by themselves and then in order, so that the value does not depend on the number of
    /// threads.
    ///
    /// # Panics
    /// If `u` does not have the shape of the problem.
    pub fn energy(&self, u: &[T]) -> f64 {
        assert_eq!(u.len(), self.shape.len(), "an image of {}", self.shape);
        let rows: Vec<f64> = (0..self.shape.height).into_par_iter().map(|i| self.row_energy(u, i)).collect();
        rows.iter().sum()
    }

    fn row_energy(&self, u: &[T], i: usize) -> f64 {
        let shape = self.shape;
        let mut sum = 0.0;
        for c in 0..shape.channels {
            for j in 0..shape.width {
                let k = (c * shape.height + i) * shape.width + j;
                if !self.data.hole(k, shape) {
                    sum += self.data.value(k, u[k] - self.target[k], shape);
                }
            }
        }
        for j in 0..shape.width {
            let pixel = i * shape.width + j;
            let mut group = [0.0; 3];
            let mut close = |squares: &mut [f64; 3], k: usize| {
                for (weight, square) in
                    [self.alpha.as_ref(), self.beta.as_ref(), self.guide.as_ref().map(|g| &g.weight)]
                        .into_iter()
                        .zip(squares.iter_mut())
                {
                    if let Some(weight) = weight {
                        sum += weight.at(k, shape).f64() * square.sqrt();
                    }
                    *square = 0.0;
                }
            };
            for c in 0..shape.channels {
                let k = c * shape.pixels() + pixel;
                let [gx, gy] = self.differences(u, i, j, k);
                group[0] += gx * gx + gy * gy;
                if self.beta.is_some() {
                    group[1] += self.hessian_square(u, i, j, k);
                }
                if let Some(guide) = &self.guide {
                    let plane = (2 * c) * shape.pixels() + pixel;
                    if j + 1 < shape.width {
                        group[2] += (gx - guide.gradient[plane].f64()).powi(2);
                    }
                    if i + 1 < shape.height {
                        group[2] += (gy - guide.gradient[plane + shape.pixels()].f64()).powi(2);
                    }
                }
                if self.coupling == Coupling::Separate {
                    close(&mut group, k);
                }
            }
            if self.coupling == Coupling::Vectorial {
                close(&mut group, pixel);
            }
        }
        sum
    }

    /// Masked gradient of sample `k`.
    fn differences(&self, u: &[T], i: usize, j: usize, k: usize) -> [f64; 2] {
        let (m, n) = (self.shape.height, self.shape.width);
        let own = u[k].f64();
        [
            if j + 1 < n { u[k + 1].f64() - own } else { 0.0 },
            if i + 1 < m { u[k + n].f64() - own } else { 0.0 },
        ]
    }

    /// Squared Frobenius norm of the masked Hessian of sample `k`.
    fn hessian_square(&self, u: &[T], i: usize, j: usize, k: usize) -> f64 {
        let (m, n) = (self.shape.height, self.shape.width);
        let at = |k: usize| u[k].f64();
        let mut square = 0.0;
        if j > 0 && j + 1 < n {
            square += (at(k + 1) - 2.0 * at(k) + at(k - 1)).powi(2);
        }
        if i > 0 && i + 1 < m {
            square += (at(k + n) - 2.0 * at(k) + at(k - n)).powi(2);
        }
        if i + 1 < m && j + 1 < n {
            square += 2.0 * (at(k + n + 1) - at(k + n) - at(k + 1) + at(k)).powi(2);
        }
        square
    }
}
