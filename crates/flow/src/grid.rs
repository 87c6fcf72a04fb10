//! Features of a position: a multiresolution hash grid (Müller et al. 2022, "Instant Neural Graphics Primitives").

use photofit_scalar::Real;

/// Features of a level.
const WIDTH: usize = 2;
/// Factors of the coordinates in the hash.
const HASH: [usize; 3] = [1, 2_654_435_761, 805_459_861];

/// A stack of grids over the unit cube, each with two features at its corners, interpolated trilinearly. Grids with
/// more corners than a table has entries share entries by a hash.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Levels.
    pub levels: usize,
    /// Cells along an edge of the first level.
    pub coarsest: usize,
    /// Growth of that number from level to level.
    pub growth: f64,
    /// Entries of the table of a level: a power of two, or the functions of a grid panic.
    pub entries: usize,
}

impl Default for Grid {
    /// 8 levels of 4 to 68 cells, 4,096 entries each.
    fn default() -> Self {
        Self { levels: 8, coarsest: 4, growth: 1.5, entries: 1 << 12 }
    }
}

/// A corner of a cell: its entry and its weight.
type Corner<T> = (usize, T);

impl Grid {
    /// Number of parameters.
    pub fn len(&self) -> usize {
        self.levels * self.entries * WIDTH
    }

    /// Whether there are no parameters.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of features.
    pub fn features(&self) -> usize {
        self.levels * WIDTH
    }

    /// Cells along an edge, level by level without an end.
    fn cells(&self) -> impl Iterator<Item = usize> {
        let growth = self.growth;
        std::iter::successors(Some(self.coarsest as f64), move |cells| Some(cells * growth))
            .map(|cells| cells as usize)
    }

    /// Entries are masked: with another number of them, corners would share entries unseen.
    #[inline(always)]
    fn assert_entries(&self) {
        assert!(
            self.entries.is_power_of_two(),
            "a grid level has {} entries, but must have a power of two",
            self.entries
        );
    }

    /// The corners around `p` at a level, with entries of its table.
    #[inline(always)]
    fn corners<T: Real>(&self, cells: usize, p: [T; 3]) -> [Corner<T>; 8] {
        let mut cell = [0_usize; 3];
        let mut part = [T::zero(); 3];
        for k in 0..3 {
            // Not a number becomes zero: every position has features.
            let scaled = p[k].clamp_to(T::zero(), T::one()) * T::of(cells as f64);
            cell[k] = (scaled.as_i32() as usize).min(cells - 1);
            part[k] = scaled - T::of(cell[k] as f64);
        }
        let side = cells + 1;
        // A dense level is addressed by sums, a hashed one by exclusive ors, of what the three coordinates give.
        let dense = side * side * side <= self.entries;
        let stride = if dense { [1, side, side * side] } else { HASH };
        let mut places = [[0_usize; 2]; 3];
        for k in 0..3 {
            let place = cell[k].wrapping_mul(stride[k]);
            places[k] = [place, place.wrapping_add(stride[k])];
        }
        let mask = self.entries - 1;
        std::array::from_fn(|i| {
            let [x, y, z] = [places[0][i & 1], places[1][i >> 1 & 1], places[2][i >> 2]];
            let entry = if dense { x + y + z } else { x ^ y ^ z };
            let side = |k: usize| if i >> k & 1 == 1 { part[k] } else { T::one() - part[k] };
            (entry & mask, side(0) * side(1) * side(2))
        })
    }

    /// Features at `p` in the unit cube (clamped to it) into `out`.
    ///
    /// # Panics
    /// If the number of entries is no power of two.
    #[inline]
    pub fn forward<T: Real>(&self, table: &[T], p: [T; 3], out: &mut [T]) {
        self.assert_entries();
        let tables = table.as_chunks::<WIDTH>().0.chunks_exact(self.entries);
        for ((table, out), cells) in tables.zip(out.as_chunks_mut::<WIDTH>().0).zip(self.cells()) {
            *out = [T::zero(); WIDTH];
            for (entry, weight) in self.corners(cells, p) {
                let [a, b] = table[entry];
                out[0] += a * weight;
                out[1] += b * weight;
            }
        }
    }

    /// Adds to the gradients of the table for those of the features. (Positions get none: they are not learned.)
    ///
    /// # Panics
    /// If the number of entries is no power of two.
    pub fn forward_vjp<T: Real>(&self, p: [T; 3], g: &[T], g_table: &mut [T]) {
        self.assert_entries();
        let tables = g_table.as_chunks_mut::<WIDTH>().0.chunks_exact_mut(self.entries);
        for ((table, g), cells) in tables.zip(g.as_chunks::<WIDTH>().0).zip(self.cells()) {
            for (entry, weight) in self.corners(cells, p) {
                table[entry][0] += g[0] * weight;
                table[entry][1] += g[1] * weight;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_gradcheck::{Uniform, check};

    #[test]
    fn gradients_agree_with_differences() {
        let grid = Grid { levels: 3, coarsest: 2, growth: 2.0, entries: 32 };
        let mut random = Uniform::new(1);
        let table = random.vec(grid.len(), -1.0, 1.0);
        let g = random.vec(grid.features(), -1.0, 1.0);
        for _ in 0..10 {
            let p: [f64; 3] = std::array::from_fn(|_| random.range(0.0, 1.0));
            let mut gradient = vec![0.0; grid.len()];
            grid.forward_vjp(p, &g, &mut gradient);
            check("grid", &table, &gradient, 1e-4, 1e-8, |t| {
                let mut out = vec![0.0; grid.features()];
                grid.forward(t, p, &mut out);
                out.iter().zip(&g).map(|(a, b)| a * b).sum()
            });
        }
    }

    #[test]
    fn features_and_gradients_read_the_same_cells_for_all_settings() {
        // Features are linear in the table: those of a table are its product with the gradient.
        let mut random = Uniform::new(3);
        for coarsest in [1, 2, 3, 5, 7, 16, 25, 50] {
            for tenths in 10..30 {
                let grid = Grid { levels: 6, coarsest, growth: f64::from(tenths) / 10.0, entries: 64 };
                let table: Vec<f64> = random.vec(grid.len(), -1.0, 1.0);
                let p: [f64; 3] = std::array::from_fn(|_| random.range(0.0, 1.0));
                let g = random.vec(grid.features(), -1.0, 1.0);
                let (mut out, mut gradient) = (vec![0.0; grid.features()], vec![0.0; grid.len()]);
                grid.forward(&table, p, &mut out);
                grid.forward_vjp(p, &g, &mut gradient);
                let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
                let (a, b) = (dot(&out, &g), dot(&table, &gradient));
                assert!((a - b).abs() < 1e-12, "{grid:?}: {a} {b}");
            }
        }
    }

    #[test]
    #[should_panic(expected = "1000 entries")]
    fn entries_that_are_no_power_of_two_are_refused() {
        let grid = Grid { entries: 1000, ..Grid::default() };
        grid.forward(&vec![0.0_f32; grid.len()], [0.5; 3], &mut vec![0.0; grid.features()]);
    }

    #[test]
    fn features_are_continuous_and_bounded() {
        let grid = Grid::default();
        let mut random = Uniform::new(2);
        let table: Vec<f32> = random.vec(grid.len(), -1.0, 1.0).iter().map(|v| *v as f32).collect();
        let at = |p: [f32; 3]| {
            let mut out = vec![0.0; grid.features()];
            grid.forward(&table, p, &mut out);
            out
        };
        for _ in 0..100 {
            let p: [f32; 3] = std::array::from_fn(|_| random.range(0.0, 0.999) as f32);
            let (a, b) = (at(p), at(p.map(|v| v + 1e-6)));
            assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 2e-3 && a.abs() <= 1.0));
        }
        for p in [[f32::NAN; 3], [f32::INFINITY; 3], [-1e30; 3], [1.0; 3]] {
            assert!(at(p).iter().all(|v| v.abs() <= 1.0), "{p:?}");
        }
    }
}
