//! The solver that transforms both directions.

use rayon::prelude::{IndexedParallelIterator, ParallelIterator, ParallelSlice, ParallelSliceMut};

use super::{LineTransform, Sample, Symbol};
use crate::operators::Boundary;

/// Rows transformed by one task.
const ROWS: usize = 16;

/// Solves `(c0 + c1 L + c2 L^2) u = f` with periodic or Neumann boundaries: rows are transformed, the result is
/// transposed, each of its rows (a column of the image) is transformed, divided by the symbol and transformed back.
/// Plans, symbol and buffers are kept between solves.
///
/// ```
/// use photofit_denoise::operators::Boundary;
/// use photofit_denoise::transform::{SpectralSolver, Symbol};
/// let symbol = Symbol { c0: 2.0, c1: 1.0, c2: 0.0 };
/// let mut solver = SpectralSolver::new(Boundary::Neumann, 5, 3, symbol);
/// let mut plane = vec![4.0_f64; 15]; // constants are not smoothed
/// solver.solve(&mut plane);
/// assert!(plane.iter().all(|v| (v - 2.0).abs() < 1e-14));
/// ```
#[derive(Debug)]
pub struct SpectralSolver<T: Sample> {
    along_rows: LineTransform<T>,
    along_columns: LineTransform<T>,
    width: usize,
    height: usize,
    symbol: Symbol,
    spectrum: Vec<T>,
    transposed: Vec<T>,
}

impl<T: Sample> SpectralSolver<T> {
    /// Plans for planes of `width x height`.
    ///
    /// # Panics
    /// If there are no pixels, or the symbol is not positive definite and finite.
    pub fn new(boundary: Boundary, width: usize, height: usize, symbol: Symbol) -> Self {
        symbol.check();
        let (along_rows, along_columns) =
            (LineTransform::new(boundary, width), LineTransform::new(boundary, height));
        let coefficients = height * along_rows.coefficients();
        Self {
            along_rows,
            along_columns,
            height,
            width,
            symbol,
            spectrum: vec![T::zero(); coefficients],
            transposed: vec![T::zero(); coefficients],
        }
    }

    /// Replaces the right-hand side `f` by the solution `u`.
    ///
    /// # Panics
    /// If `plane` does not have `width * height` samples.
    pub fn solve(&mut self, plane: &mut [T]) {
        let (height, width, coefficients) = (self.height, self.width, self.along_rows.coefficients());
        assert_eq!(plane.len(), width * height, "a plane of {width} x {height}");
        let (along_rows, along_columns, symbol) = (&self.along_rows, &self.along_columns, self.symbol);
        self.spectrum.par_chunks_mut(ROWS * coefficients).zip(plane.par_chunks(ROWS * width)).for_each(
            |(out, rows)| {
                let mut scratch = along_rows.scratch();
                for (out, row) in out.chunks_mut(coefficients).zip(rows.chunks(width)) {
                    along_rows.forward(row, out, &mut scratch);
                }
            },
        );
        transpose(&self.spectrum, height, coefficients, &mut self.transposed);
        let norm = 1.0 / (height * width) as f64;
        self.transposed.par_chunks_mut(ROWS * height).enumerate().for_each(|(chunk, columns)| {
            let mut scratch = along_columns.scratch();
            let mut line = vec![T::zero(); along_columns.coefficients()];
            for (k, column) in columns.chunks_mut(height).enumerate() {
                along_columns.forward(column, &mut line, &mut scratch);
                let lx = along_rows.eigenvalue(chunk * ROWS + k);
                for (k, v) in line.iter_mut().enumerate() {
                    *v *= T::of(norm / symbol.at(lx + along_columns.eigenvalue(k)));
                }
                along_columns.inverse(&line, column, &mut scratch);
            }
        });
        transpose(&self.transposed, coefficients, height, &mut self.spectrum);
        plane.par_chunks_mut(ROWS * width).zip(self.spectrum.par_chunks(ROWS * coefficients)).for_each(
            |(out, rows)| {
                let mut scratch = along_rows.scratch();
                for (out, row) in out.chunks_mut(width).zip(rows.chunks(coefficients)) {
                    along_rows.inverse(row, out, &mut scratch);
                }
            },
        );
    }
}

/// Transposes a matrix of `rows x cols` into `cols x rows` in tiles that fit the first cache, in parallel over bands of the output.
fn transpose<T: Copy + Send + Sync>(source: &[T], rows: usize, cols: usize, target: &mut [T]) {
    const TILE: usize = 16;
    target.par_chunks_mut(TILE * rows).enumerate().for_each(|(band, out)| {
        for from in (0..rows).step_by(TILE) {
            for (c, out) in out.chunks_mut(rows).enumerate() {
                for r in from..(from + TILE).min(rows) {
                    out[r] = source[r * cols + band * TILE + c];
                }
            }
        }
    });
}
