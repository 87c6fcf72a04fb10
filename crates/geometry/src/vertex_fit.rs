//! Values of vertices whose linear interpolation over triangles is nearest to samples, in the sense of least squares.
//!
//! Minimised is `sum_s weight_s (sum_k at_sk x_(v_k) - value_s)^2 + sum_v held_v (x_v - target_v)^2` with barycentric
//! coordinates `at`. The normal equations are symmetric, of one 3 x 3 block per triangle, and definite where every unknown is held or
//! has samples enough. They are solved by conjugate gradients with a diagonal preconditioner (Hestenes and Stiefel, 1952).

use crate::NONE;

/// The matrix of the normal equations; right sides are made by [`Self::spread`].
///
/// ```
/// use photofit_geometry::VertexFit;
/// let mut fit = VertexFit::new(vec![[0, 1, 2]], 3);
/// let mut right = vec![0.0; 3];
/// for (at, value) in [([0.5, 0.5, 0.0], 1.0), ([0.0, 0.5, 0.5], 3.0), ([0.5, 0.0, 0.5], 2.0)] {
///     fit.add(0, at, 1.0);
///     fit.spread(&mut right, 0, at, value);
/// }
/// let x = fit.solve(&right, 50, 1e-12);
/// assert!(x.iter().zip([0.0, 2.0, 4.0]).all(|(x, wanted)| (x - wanted).abs() < 1e-9));
/// ```
#[derive(Clone, Debug)]
pub struct VertexFit {
    /// Unknown of each corner, or [`NONE`].
    corners: Vec<[u32; 3]>,
    /// Upper triangle of `sum weight at at'` of each triangle: 00, 11, 22, 01, 02, 12.
    blocks: Vec<[f64; 6]>,
    /// Weight of each unknown against a target of its own.
    held: Vec<f64>,
}

impl VertexFit {
    /// Without samples. `corners` are the unknowns of each triangle, below `unknowns`, or [`NONE`] where the value is given.
    ///
    /// # Panics
    /// If a corner is neither.
    pub fn new(corners: Vec<[u32; 3]>, unknowns: usize) -> Self {
        let known = |v: &u32| *v == NONE || (*v as usize) < unknowns;
        assert!(corners.iter().flatten().all(known), "an unknown of a corner below {unknowns}");
        Self { blocks: vec![[0.0; 6]; corners.len()], held: vec![0.0; unknowns], corners }
    }

    /// Number of unknowns.
    pub fn unknowns(&self) -> usize {
        self.held.len()
    }

    /// Adds a sample of a weight at barycentric coordinates `at` of triangle `t`.
    pub fn add(&mut self, t: usize, at: [f64; 3], weight: f64) {
        let [x, y, z] = at;
        let products = [x * x, y * y, z * z, x * y, x * z, y * z];
        self.blocks[t].iter_mut().zip(products).for_each(|(b, p)| *b += weight * p);
    }

    /// Holds an unknown against a target, whose share `weight * target` belongs to the right side.
    pub fn hold(&mut self, unknown: usize, weight: f64) {
        self.held[unknown] += weight;
    }

    /// Adds what a sample of [`Self::add`] has in the right side: `amount` is its weight times its value, less what given corners
    /// make of it.
    pub fn spread(&self, right: &mut [f64], t: usize, at: [f64; 3], amount: f64) {
        for (v, x) in self.corners[t].iter().zip(at).filter(|(v, _)| **v != NONE) {
            right[*v as usize] += x * amount;
        }
    }

    /// The unknowns for a right side, after `steps` steps at most; the solver ends where the residual has fallen to `tolerance` times the
    /// right side, both in the norm of the preconditioner. It begins with each unknown by itself: what no other unknown shares a sample
    /// with is exact. Unknowns that nothing tells of stay zero.
    ///
    /// # Panics
    /// If the right side does not have a number for each unknown.
    pub fn solve(&self, right: &[f64], steps: usize, tolerance: f64) -> Vec<f64> {
        assert_eq!(right.len(), self.unknowns(), "a number for each unknown");
        let inverse: Vec<f64> =
            self.diagonal().iter().map(|d| if *d > 0.0 { 1.0 / d } else { 0.0 }).collect();
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let scaled = |r: &[f64], z: &mut [f64]| {
            z.iter_mut().zip(r).zip(&inverse).for_each(|((z, r), i)| *z = r * i);
        };
        let [mut x, mut z, mut image] = [(); 3].map(|()| vec![0.0; right.len()]);
        scaled(right, &mut x);
        let least = tolerance * tolerance * dot(right, &x);
        self.apply(&x, &mut image);
        let mut r: Vec<f64> = right.iter().zip(&image).map(|(b, i)| b - i).collect();
        scaled(&r, &mut z);
        let mut p = z.clone();
        let mut energy = dot(&r, &z);
        for _ in 0..steps {
            if energy <= least || energy <= f64::MIN_POSITIVE {
                break;
            }
            self.apply(&p, &mut image);
            let curvature = dot(&p, &image);
            // Rounding, in directions that nothing tells of.
            if curvature <= 0.0 {
                break;
            }
            let step = energy / curvature;
            x.iter_mut().zip(&p).for_each(|(x, p)| *x += step * p);
            r.iter_mut().zip(&image).for_each(|(r, i)| *r -= step * i);
            scaled(&r, &mut z);
            let next = dot(&r, &z);
            let ratio = next / energy;
            p.iter_mut().zip(&z).for_each(|(p, z)| *p = z + ratio * *p);
            energy = next;
        }
        x
    }

    fn diagonal(&self) -> Vec<f64> {
        let mut out = self.held.clone();
        for (corners, block) in self.corners.iter().zip(&self.blocks) {
            for (v, b) in corners.iter().zip(block).filter(|(v, _)| **v != NONE) {
                out[*v as usize] += b;
            }
        }
        out
    }

    /// The matrix times `x`.
    fn apply(&self, x: &[f64], out: &mut [f64]) {
        out.iter_mut().zip(x).zip(&self.held).for_each(|((o, x), h)| *o = h * x);
        for (corners, b) in self.corners.iter().zip(&self.blocks) {
            let [p, q, r] = corners.map(|v| if v == NONE { 0.0 } else { x[v as usize] });
            let rows = [
                b[0] * p + b[3] * q + b[4] * r,
                b[3] * p + b[1] * q + b[5] * r,
                b[4] * p + b[5] * q + b[2] * r,
            ];
            for (v, row) in corners.iter().zip(rows).filter(|(v, _)| **v != NONE) {
                out[*v as usize] += row;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use photofit_sampling::Rng;

    /// Triangle, barycentric coordinates, weight and value.
    type Sample = (usize, [f64; 3], f64, f64);

    /// A strip of triangles, of which one vertex is given, with random samples.
    fn strip(rng: &mut Rng) -> (Vec<[u32; 3]>, Vec<Sample>) {
        let given = |v| if v == 7 { NONE } else { v };
        // The first triangle has one unknown at two of its corners.
        let corners = (0..20_u32).map(|t| [t.max(1), t + 1, t + 2].map(given)).collect();
        let mut unit = || f64::from(rng.next_f32());
        let samples = (0..400).map(|k| {
            let (u, v) = (unit(), unit());
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            (k % 20, [1.0 - u - v, u, v], 0.1 + unit(), 2.0 * unit() - 1.0)
        });
        (corners, samples.collect())
    }

    #[test]
    fn the_solution_is_that_of_the_dense_normal_equations() {
        let (corners, samples) = strip(&mut Rng::new(5, 1));
        let mut fit = VertexFit::new(corners.clone(), 22);
        let mut right = vec![0.0; fit.unknowns()];
        let (mut matrix, mut side) = (DMatrix::<f64>::zeros(22, 22), DVector::<f64>::zeros(22));
        for (t, at, weight, value) in &samples {
            fit.add(*t, *at, *weight);
            fit.spread(&mut right, *t, *at, weight * value);
            let known = corners[*t].iter().zip(at).filter(|(v, _)| **v != NONE);
            let row = known.fold(DVector::zeros(22), |mut row, (v, x)| {
                row[*v as usize] += *x;
                row
            });
            matrix += &row * row.transpose() * *weight;
            side += row * (weight * value);
        }
        fit.hold(3, 2.5);
        right[3] += 2.5 * 0.75;
        matrix[(3, 3)] += 2.5;
        side[3] += 2.5 * 0.75;
        // Nothing tells of the given vertex, and of the first one.
        (matrix[(7, 7)], matrix[(0, 0)]) = (1.0, 1.0);
        let wanted = matrix.cholesky().expect("a definite matrix").solve(&side);
        let found = fit.solve(&right, 200, 1e-13);
        for (k, (a, b)) in found.iter().zip(wanted.iter()).enumerate() {
            assert!((a - b).abs() < 1e-10, "{k}: {a} {b}");
        }
        assert_eq!((found[7], found[0]), (0.0, 0.0));
        let few = fit.solve(&right, 3, 1e-13);
        assert!(
            few.iter().zip(wanted.iter()).any(|(a, b)| (a - b).abs() > 1e-6),
            "three steps do not suffice"
        );
    }

    #[test]
    fn what_is_hardly_held_has_its_target_too() {
        let mut fit = VertexFit::new(vec![[0, 1, 2]], 4);
        let mut right = vec![0.0; 4];
        for at in [[1.0, 0.0, 0.0], [0.3, 0.3, 0.4], [0.0, 0.5, 0.5], [0.1, 0.8, 0.1]] {
            fit.add(0, at, 1.0);
            fit.spread(&mut right, 0, at, 0.6);
        }
        fit.hold(3, 1e-16);
        right[3] = 1e-16 * 0.6;
        let found = fit.solve(&right, 200, 1e-7);
        assert!(found.iter().all(|x| (x - 0.6).abs() < 1e-5), "{found:?}");
    }

    #[test]
    fn nothing_known_changes_nothing() {
        let fit = VertexFit::new(vec![[0, 1, NONE]], 2);
        assert_eq!(fit.solve(&[0.0, 0.0], 10, 1e-9), [0.0, 0.0]);
    }
}
