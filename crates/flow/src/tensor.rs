//! Features of a position: a vector-matrix decomposition of a grid of features (Chen et al. 2022, "`TensoRF`: Tensorial Radiance Fields").

use photofit_scalar::Real;

/// Components of a pair of a plane and a line, each of them a feature.
const COMPONENTS: usize = 8;
/// The two axes of each plane and the axis of its line.
const AXES: [[usize; 3]; 3] = [[0, 1, 2], [0, 2, 1], [1, 2, 0]];

/// Three planes with a line across each over the unit cube; a feature is a component of a plane, interpolated bilinearly,
/// times that of its line, interpolated linearly.
///
/// The table holds the planes, row by row, then the lines; components of a node stand side by side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tensor {
    /// Nodes along an edge, at least 2.
    pub nodes: usize,
}

impl Default for Tensor {
    /// 50 nodes: about as many parameters as the default [`Grid`](crate::Grid).
    fn default() -> Self {
        Self { nodes: 50 }
    }
}

/// A node and a weight: of a coordinate, the first of the two nodes around it and the weight of the second.
type Place<T> = (usize, T);

impl Tensor {
    /// Number of features.
    pub const FEATURES: usize = 3 * COMPONENTS;

    /// Number of parameters.
    pub fn len(&self) -> usize {
        3 * (self.nodes + 1) * self.nodes * COMPONENTS
    }

    /// Whether there are no parameters.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Values before training, of numbers in `[-1, 1)`: lines around one, so that planes have gradients, and planes around
    /// zero.
    pub fn init<T: Real>(&self, table: &mut [T], mut random: impl FnMut() -> T) {
        let (planes, lines) = table.split_at_mut(3 * self.nodes * self.nodes * COMPONENTS);
        planes.iter_mut().for_each(|v| *v = T::of(0.05) * random());
        lines.iter_mut().for_each(|v| *v = T::one() + T::of(0.5) * random());
    }

    #[inline(always)]
    fn places<T: Real>(&self, p: [T; 3]) -> [Place<T>; 3] {
        p.map(|v| {
            // Not a number becomes zero: every position has features.
            let scaled = v.clamp_to(T::zero(), T::one()) * T::of((self.nodes - 1) as f64);
            let node = (scaled.as_i32() as usize).min(self.nodes - 2);
            (node, scaled - T::of(node as f64))
        })
    }

    /// Nodes of plane and line `k` with their weights: indices of runs of [`COMPONENTS`] parameters.
    #[inline(always)]
    fn nodes_of<T: Real>(&self, k: usize, places: &[Place<T>; 3]) -> ([Place<T>; 4], [Place<T>; 2]) {
        let [(a, s), (b, t), (c, r)] = AXES[k].map(|axis| places[axis]);
        let (n, one) = (self.nodes, T::one());
        let (plane, line) = ((k * n + b) * n + a, (3 * n + k) * n + c);
        let corners = [
            (plane, (one - s) * (one - t)),
            (plane + 1, s * (one - t)),
            (plane + n, (one - s) * t),
            (plane + n + 1, s * t),
        ];
        (corners, [(line, one - r), (line + 1, r)])
    }

    /// Features at `p` in the unit cube (clamped to it) into the first [`Self::FEATURES`] of `out`.
    #[inline]
    pub fn forward<T: Real>(&self, table: &[T], p: [T; 3], out: &mut [T]) {
        let places = self.places(p);
        let table = table.as_chunks::<COMPONENTS>().0;
        for (k, out) in out.as_chunks_mut::<COMPONENTS>().0.iter_mut().enumerate().take(3) {
            let (corners, ends) = self.nodes_of(k, &places);
            let (plane, line) = (blend(table, &corners), blend(table, &ends));
            for c in 0..COMPONENTS {
                out[c] = plane[c] * line[c];
            }
        }
    }

    /// Adds to the gradients of the table for those of the features. (Positions get none: they are not learned.)
    pub fn forward_vjp<T: Real>(&self, table: &[T], p: [T; 3], g: &[T], g_table: &mut [T]) {
        let places = self.places(p);
        let table = table.as_chunks::<COMPONENTS>().0;
        let g_table = g_table.as_chunks_mut::<COMPONENTS>().0;
        for (k, g) in g.as_chunks::<COMPONENTS>().0.iter().enumerate().take(3) {
            let (corners, ends) = self.nodes_of(k, &places);
            let (plane, line) = (blend(table, &corners), blend(table, &ends));
            for (node, weight) in corners {
                for c in 0..COMPONENTS {
                    g_table[node][c] += g[c] * line[c] * weight;
                }
            }
            for (node, weight) in ends {
                for c in 0..COMPONENTS {
                    g_table[node][c] += g[c] * plane[c] * weight;
                }
            }
        }
    }
}

/// The weighted sum of nodes.
#[inline(always)]
fn blend<T: Real>(table: &[[T; COMPONENTS]], nodes: &[Place<T>]) -> [T; COMPONENTS] {
    let mut sum = [T::zero(); COMPONENTS];
    for (node, weight) in nodes {
        let values = &table[*node];
        for c in 0..COMPONENTS {
            sum[c] += values[c] * *weight;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_gradcheck::{Uniform, check};

    #[test]
    fn gradients_agree_with_differences() {
        let tensor = Tensor { nodes: 4 };
        let mut random = Uniform::new(1);
        let table = random.vec(tensor.len(), -1.0, 1.0);
        let g = random.vec(Tensor::FEATURES, -1.0, 1.0);
        for _ in 0..10 {
            let p: [f64; 3] = std::array::from_fn(|_| random.range(0.0, 1.0));
            let mut gradient = vec![0.0; tensor.len()];
            tensor.forward_vjp(&table, p, &g, &mut gradient);
            check("tensor", &table, &gradient, 1e-4, 1e-8, |t| {
                let mut out = vec![0.0; Tensor::FEATURES];
                tensor.forward(t, p, &mut out);
                out.iter().zip(&g).map(|(a, b)| a * b).sum()
            });
        }
    }

    #[test]
    fn nodes_have_the_products_of_their_values() {
        // One node of each plane and line is not zero: its features are, and those of its neighbours are not.
        let tensor = Tensor { nodes: 3 };
        let mut table = vec![0.0_f64; tensor.len()];
        let set = |table: &mut [f64], node: usize, value: f64| {
            table[node * COMPONENTS..][..COMPONENTS].fill(value);
        };
        // The node (1, 2, 0): planes xy, xz and yz, lines z, y and x.
        for (k, (plane, line)) in [(7, 0), (1, 2), (2, 1)].into_iter().enumerate() {
            set(&mut table, 9 * k + plane, 2.0);
            set(&mut table, 27 + 3 * k + line, 3.0);
        }
        let at = |p: [f64; 3]| {
            let mut out = vec![0.0; Tensor::FEATURES];
            tensor.forward(&table, p, &mut out);
            out
        };
        assert_eq!(at([0.5, 1.0, 0.0]), [6.0; Tensor::FEATURES]);
        assert_eq!(at([0.0, 0.5, 1.0]), [0.0; Tensor::FEATURES]);
        for p in [[f64::NAN; 3], [f64::INFINITY; 3], [-1e30; 3], [1.0; 3]] {
            assert!(at(p).iter().all(|v| v.abs() <= 6.0), "{p:?}");
        }
    }
}
