//! Laplacian smoothing on grids: the screened Poisson equation by cosine transforms.

use super::grid::Grid;
use super::{Guidance, SpatialFilter};
use crate::error::OptimError;
use photofit_fft::{Cosine, laplacian_eigenvalue};
use photofit_scalar::Real;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Lines that are gathered together, neighbours in memory.
const LINES: usize = 16;

/// The filter `(I + lambda L)^-1` on a grid, `L` the Laplacian of nearest neighbours (degree minus adjacency, reflecting
/// at the ends): Laplacian smoothing of gradients (Osher et al. 2018), the isotropic low-pass to compare the bilateral
/// filter with.
///
/// By a type-2 discrete cosine transform along every axis, in f64: `O(n log n)`, exact, and the same bits for any
/// number of threads. Results are held between the smallest and the largest sample of their channel, which rounding
/// could leave: filtered squares stay non-negative.
///
/// ```
/// use photofit_optim::{Grid, Optimizer, Placement, ScreenedPoisson, Temporal};
/// let filter = ScreenedPoisson::new("height", Grid::plane(16, 8), 3.0)?;
/// let mut optimizer = Optimizer::new("height", 128, Temporal::adam())?.with_filter(Placement::PRE, filter)?;
/// let mut height = vec![0.0_f32; 128];
/// let gradient: Vec<f32> = (0..128).map(|i| if i == 70 { 1.0 } else { 0.0 }).collect();
/// optimizer.step(&mut height, &gradient, 0.1)?;
/// assert!(height[70] < 0.0 && height[71] < 0.0);
/// # Ok::<(), photofit_optim::OptimError>(())
/// ```
#[derive(Debug)]
pub struct ScreenedPoisson {
    grid: Grid,
    /// Axes longer than one, with their transforms.
    axes: Vec<Axis>,
    lambda: f64,
    planes: [Vec<f64>; 2],
}

impl ScreenedPoisson {
    /// For a group on `grid`, named for messages; `lambda` finite and not negative.
    ///
    /// # Errors
    /// [`OptimError::Setting`].
    pub fn new(group: &str, grid: Grid, lambda: f64) -> Result<Self, OptimError> {
        let good = lambda >= 0.0 && lambda.is_finite();
        OptimError::setting(group, "lambda", lambda, "finite and not negative", good)?;
        let count = grid.sites();
        OptimError::setting(group, "number of sites", count as f64, "below 2^40", count < 1 << 40)?;
        let axes = grid.shape().into_iter().filter(|n| *n > 1).map(Axis::new).collect();
        Ok(Self { grid, axes, lambda, planes: Default::default() })
    }

    /// Filters the samples in `planes[0]`.
    fn solve(&mut self) {
        let [data, other] = &mut self.planes;
        other.resize(data.len(), 0.0);
        // The axes as they stand in memory, fastest first; each transform brings its axis to the front.
        let mut order: Vec<usize> = (0..self.axes.len()).collect();
        for axis in 0..self.axes.len() {
            sweep(data, other, &self.axes, &mut order, axis, false);
        }
        let axes: Vec<&Axis> = order.iter().map(|a| &self.axes[*a]).collect();
        let norm: f64 = axes.iter().map(|a| 1.0 / a.len() as f64).product();
        if let [front, rest @ ..] = &axes[..] {
            data.par_chunks_mut(front.len()).enumerate().for_each(|(r, row)| {
                let (mut index, mut sum) = (r, 0.0);
                for axis in rest {
                    sum += axis.eigenvalues[index % axis.len()];
                    index /= axis.len();
                }
                for (x, e) in row.iter_mut().zip(&front.eigenvalues) {
                    *x *= norm / (1.0 + self.lambda * (sum + e));
                }
            });
        }
        for axis in (0..self.axes.len()).rev() {
            sweep(data, other, &self.axes, &mut order, axis, true);
        }
    }
}

/// Brings `axis` to the front of `order` and transforms along it; the result is again in `data`.
fn sweep(
    data: &mut Vec<f64>,
    other: &mut Vec<f64>,
    axes: &[Axis],
    order: &mut Vec<usize>,
    axis: usize,
    inverse: bool,
) {
    let cosine = &axes[axis].cosine;
    let n = cosine.len();
    let faster: usize = order.iter().take_while(|a| **a != axis).map(|a| axes[*a].len()).product();
    other.par_chunks_mut(n * LINES).enumerate().for_each_init(
        || cosine.buffers(),
        |buffers, (chunk, lines)| {
            let count = lines.len() / n;
            let from = |line: usize| {
                let (outer, inner) = ((chunk * LINES + line) / faster, (chunk * LINES + line) % faster);
                outer * faster * n + inner
            };
            let mut starts = [0; LINES];
            starts.iter_mut().take(count).enumerate().for_each(|(l, start)| *start = from(l));
            for j in 0..n {
                for l in 0..count {
                    lines[l * n + j] = data[starts[l] + j * faster];
                }
            }
            for line in lines.chunks_exact_mut(n) {
                if inverse { cosine.inverse(line, buffers) } else { cosine.forward(line, buffers) }
            }
        },
    );
    std::mem::swap(data, other);
    order.retain(|a| *a != axis);
    order.insert(0, axis);
}

/// An axis of the grid.
#[derive(Debug)]
struct Axis {
    cosine: Cosine<f64>,
    /// Of the Laplacian along it.
    eigenvalues: Vec<f64>,
}

impl Axis {
    fn new(n: usize) -> Self {
        let eigenvalue = |k: usize| laplacian_eigenvalue(PI * k as f64 / n as f64);
        Self { cosine: Cosine::new(n), eigenvalues: (0..n).map(eigenvalue).collect() }
    }

    fn len(&self) -> usize {
        self.cosine.len()
    }
}

impl<T: Real> SpatialFilter<T> for ScreenedPoisson {
    fn sites(&self) -> usize {
        self.grid.sites()
    }

    fn prepare(&mut self, _: &Guidance<'_, T>) -> Result<(), OptimError> {
        Ok(())
    }

    fn apply(&mut self, fields: &[&[T]], out: &mut [&mut [T]]) {
        let sites = self.grid.sites();
        if sites == 0 {
            return;
        }
        for (field, out) in fields.iter().zip(out) {
            let width = field.len() / sites;
            for c in 0..width {
                let samples = field.par_chunks(width).map(|row| row[c].f64());
                samples.collect_into_vec(&mut self.planes[0]);
                let range = |(lo, hi): (f64, f64), x: &f64| (lo.min(*x), hi.max(*x));
                let (lo, hi) = self.planes[0].iter().fold((f64::INFINITY, f64::NEG_INFINITY), range);
                self.solve();
                let rows = out.par_chunks_mut(width).zip(&self.planes[0]);
                rows.for_each(|(row, x)| row[c] = T::of(x.clamp(lo, hi)));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::LargeSteps;
    use photofit_gradcheck::Uniform;

    const SHAPES: [[usize; 3]; 9] = [
        [1, 1, 1],
        [7, 1, 1],
        [2, 1, 1],
        [1, 9, 1],
        [8, 5, 1],
        [12, 1, 5],
        [4, 3, 6],
        [33, 20, 1],
        [1, 1, 3],
    ];

    fn grid([x, y, z]: [usize; 3]) -> Grid {
        Grid::volume(x, y, z)
    }

    fn edges(grid: Grid) -> Vec<[u32; 2]> {
        let (shape, strides) = (grid.shape(), grid.strides());
        let inside = |i: usize, a: usize| i / strides[a] % shape[a] + 1 < shape[a];
        let axes = |i: usize| {
            (0..3).filter(move |a| inside(i, *a)).map(move |a| [i as u32, (i + strides[a]) as u32])
        };
        (0..grid.sites()).flat_map(axes).collect()
    }

    #[test]
    fn it_is_the_inverse_of_the_matrix() {
        for shape in SHAPES {
            for lambda in [0.0, 0.7, 300.0] {
                let grid = grid(shape);
                let n = grid.sites();
                let matrix = LargeSteps::new(n, &edges(grid), lambda).unwrap();
                let mut filter = ScreenedPoisson::new("x", grid, lambda).unwrap();
                let field = Uniform::new(5).vec(3 * n, -1.0, 1.0);
                let mut out = vec![0.0; 3 * n];
                filter.apply(&[&field], &mut [&mut out]);
                let worst =
                    |a: &[f64], b: &[f64]| a.iter().zip(b).fold(0.0_f64, |w, (a, b)| w.max((a - b).abs()));
                let residual = worst(&matrix.to_u(&out).unwrap(), &field);
                assert!(residual < 1e-9, "{shape:?} lambda {lambda}: {residual:e}");
                assert!(worst(&matrix.to_x(&field).unwrap(), &out) < 1e-11, "{shape:?} lambda {lambda}");
            }
        }
    }

    #[test]
    fn squares_stay_non_negative() {
        let grid = Grid::plane(64, 64);
        let mut filter = ScreenedPoisson::new("x", grid, 0.5).unwrap();
        let mut field = vec![0.0_f32; 4096];
        field[70] = 3e4;
        let mut out = vec![0.0_f32; 4096];
        filter.apply(&[&field], &mut [&mut out]);
        assert!(out.iter().all(|x| *x >= 0.0));
        assert!((out.iter().map(|x| f64::from(*x)).sum::<f64>() / 3e4 - 1.0).abs() < 1e-6);
    }

    #[test]
    fn bad_settings_are_refused() {
        assert!(ScreenedPoisson::new("x", Grid::line(4), -1.0).is_err());
        assert!(ScreenedPoisson::new("x", Grid::line(4), f64::NAN).is_err());
        assert!(ScreenedPoisson::new("x", Grid::volume(usize::MAX, 2, 2), 1.0).is_err());
        let mut empty = ScreenedPoisson::new("x", Grid::plane(0, 4), 1.0).unwrap();
        SpatialFilter::<f32>::apply(&mut empty, &[&[]], &mut [&mut []]);
    }
}
