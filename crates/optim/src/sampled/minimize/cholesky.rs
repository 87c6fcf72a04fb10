//! A Cholesky factorisation that makes its matrix positive definite as it goes.

/// `L D L^T = A + E` with a diagonal `E >= 0` that is zero for matrices that are safely positive definite (Gill, Murray
/// and Wright 1981; Nocedal and Wright 2006, section 3.4).
#[derive(Debug)]
pub(crate) struct ModifiedCholesky {
    /// `L` below the diagonal, `D` on it, row by row.
    factors: Vec<f64>,
    n: usize,
}

impl ModifiedCholesky {
    /// Factors the symmetric `n x n` matrix `a`; pivots are made at least `least` (positive) in size, negative ones
    /// positive.
    pub(crate) fn new(mut a: Vec<f64>, n: usize, least: f64) -> Self {
        let diagonal = (0..n).map(|i| a[i * n + i].abs()).fold(0.0, f64::max);
        let off = (0..n * n).filter(|e| e / n != e % n).map(|e| a[e].abs()).fold(0.0, f64::max);
        // Bounds the factors, and with them E, for the best of matrices: |L_ij| sqrt(D_j) <= bound.
        let spread = ((n * n - 1) as f64).sqrt().max(1.0);
        let bound = diagonal.max(off / spread).max(least);
        for j in 0..n {
            for k in 0..j {
                a[j * n + k] /= a[k * n + k];
            }
            for i in j + 1..n {
                // c_ij = a_ij - sum_k l_jk c_ik; c_ik stands in a[i][k], not yet divided.
                let sum: f64 = (0..j).map(|k| a[j * n + k] * a[i * n + k]).sum();
                a[i * n + j] = a[j * n + i] - sum;
            }
            let largest = (j + 1..n).map(|i| a[i * n + j].abs()).fold(0.0, f64::max);
            let d = a[j * n + j].abs().max(largest * largest / bound).max(least);
            a[j * n + j] = d;
            for i in j + 1..n {
                a[i * n + i] -= a[i * n + j] * a[i * n + j] / d;
            }
        }
        Self { factors: a, n }
    }

    /// Solves `(A + E) x = b`.
    pub(crate) fn solve(&self, mut b: Vec<f64>) -> Vec<f64> {
        let n = self.n;
        for i in 0..n {
            let sum: f64 = (0..i).map(|k| self.factors[i * n + k] * b[k]).sum();
            b[i] -= sum;
        }
        for i in 0..n {
            b[i] /= self.factors[i * n + i];
        }
        for i in (0..n).rev() {
            let sum: f64 = (i + 1..n).map(|k| self.factors[k * n + i] * b[k]).sum();
            b[i] -= sum;
        }
        b
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn residual(a: &[f64], x: &[f64], b: &[f64]) -> f64 {
        let n = b.len();
        (0..n).map(|i| ((0..n).map(|j| a[i * n + j] * x[j]).sum::<f64>() - b[i]).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn positive_definite_matrices_are_left_as_they_are() {
        let a = vec![4.0, 1.0, 0.5, 1.0, 3.0, -0.7, 0.5, -0.7, 2.0];
        let b = vec![1.0, -2.0, 0.3];
        let x = ModifiedCholesky::new(a.clone(), 3, 1e-9).solve(b.clone());
        assert!(residual(&a, &x, &b) < 1e-12);
    }

    #[test]
    fn indefinite_and_singular_matrices_lead_downhill() {
        for a in [
            vec![1.0, 2.0, 2.0, 1.0],
            vec![-3.0, 0.0, 0.0, -1e-3],
            vec![0.0, 0.0, 0.0, 0.0],
            vec![0.0, 1.0, 1.0, 0.0],
            vec![1e20, 1e20, 1e20, 1e20],
        ] {
            for g in [[1.0, 0.0], [0.3, -0.8], [-1.0, 1.0]] {
                let x = ModifiedCholesky::new(a.clone(), 2, 1e-3).solve(g.to_vec());
                let along = x[0] * g[0] + x[1] * g[1];
                assert!(along > 0.0 && along.is_finite(), "{a:?} {g:?} {x:?}");
            }
        }
    }
}
