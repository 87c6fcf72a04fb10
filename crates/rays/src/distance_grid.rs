//! The zero level of a grid of signed distances, as a surface that rays meet.
//!
//! Between its samples the grid is interpolated trilinearly; along a ray that is a cubic in each cell (Parker et al. 1998,
//! "Interactive Ray Tracing for Isosurface Rendering"; Hansson-Söderlund, Evans, Akenine-Möller 2022, "Ray Tracing of
//! Signed Distance Function Grids", JCGT 11(3)), which is solved in double precision. Cells through which the zero level
//! passes stand in a [`BoxTree`].
//!
//! The surface is the border of what is negative. It has no holes: cells agree on the signs at the points where a ray
//! passes from one to the next, to the last bit. At the border of the grid it ends, so a shape that reaches it is open there.

mod cell;

use super::{BoxRay, BoxTree};
use cell::{Cell, Crossing};
use glam::DVec3;
use photofit_scalar::vec3;
use rayon::prelude::*;

/// Most samples of one grid.
const SAMPLES: usize = 1 << 27;
/// By how much the boxes of cells are widened, in cells of the longest side: more than a ray in single precision is off
/// within the grid.
const WIDENED: f64 = 1e-6;

/// Values of a point that lies on the surface, of the largest in its cell.
const OFF: f64 = 1e-9;

/// Signed distances on a grid, prepared for rays.
///
/// Points are in *grid coordinates*: sample (i, j, k) stands at the point (i, j, k).
#[derive(Clone, Debug)]
pub struct DistanceGrid {
    size: [usize; 3],
    values: Vec<f32>,
    tree: BoxTree,
    /// The lower corner of each cell of the tree, as an index of its sample.
    cells: Vec<u32>,
    bounds: [DVec3; 2],
}

/// Why a grid has no surface for rays.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DistanceGridError {
    /// A side is too short, or there are too many samples.
    #[error("the grid has {} x {} x {} samples; it must have 2 or more along each side and at most 2^27", size[0], size[1], size[2])]
    Size {
        /// Samples along x, y and z.
        size: [usize; 3],
    },
    /// Values are missing, or there are too many.
    #[error("there are {found} values; there must be {expected}, one a sample")]
    Count {
        /// Number of values.
        found: usize,
        /// Number of samples.
        expected: usize,
    },
    /// A value is NaN or infinite.
    #[error("value {index} is {value}; it must be finite")]
    NonFinite {
        /// Index of the value.
        index: usize,
        /// The value.
        value: f32,
    },
    /// There is no zero level.
    #[error("all values are {}; some must be below 0 and some must not", if *negative { "below 0" } else { "0 or more" })]
    OneSided {
        /// Which they are.
        negative: bool,
    },
    /// The surface passes through too many cells.
    #[error("the surface passes through {cells} cells; it may pass through {}", DistanceGrid::MAX_CELLS)]
    TooMany {
        /// Number of cells.
        cells: usize,
    },
}

/// Where a ray meets the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DistanceHit {
    /// Distance along the ray, in lengths of its direction.
    pub t: f64,
    /// Which cell it is in, for [`DistanceGrid::on_surface`].
    pub cell: u32,
    /// The ray comes from outside, where distances are positive.
    pub front: bool,
}

impl DistanceGrid {
    /// Most cells with a part of the surface: the tree over them takes about 200 bytes each while it is built.
    pub const MAX_CELLS: usize = 1 << 22;

    /// Takes over the values, x fastest, of `size` samples along x, y and z; they are negative inside.
    ///
    /// # Errors
    /// If a side has fewer than 2 samples, there are more than 2^27, a value is not finite, none is negative or all are,
    /// or the surface passes through more than 2^22 cells.
    pub fn new(size: [usize; 3], values: Vec<f32>) -> Result<Self, DistanceGridError> {
        check(size, &values)?;
        let mut out =
            Self { size, values, tree: BoxTree::default(), cells: Vec::new(), bounds: [DVec3::ZERO; 2] };
        let grid = &out;
        let of_layer = |z: usize| -> Vec<u32> {
            let row = |y: usize| (0..size[0] - 1).map(move |x| grid.index([x, y, z]));
            (0..size[1] - 1).flat_map(row).filter(|i| grid.is_crossed(*i)).map(|i| i as u32).collect()
        };
        let layers: Vec<Vec<u32>> = (0..size[2] - 1).into_par_iter().map(of_layer).collect();
        let count = layers.iter().map(Vec::len).sum();
        if count > Self::MAX_CELLS {
            return Err(DistanceGridError::TooMany { cells: count });
        }
        out.cells = layers.concat();
        let wide = DVec3::splat(WIDENED * (size[0].max(size[1]).max(size[2]) as f64));
        let around = |i: &u32| {
            let low = out.corner(*i).as_dvec3();
            [low - wide, low + DVec3::ONE + wide]
        };
        let boxes: Vec<[DVec3; 2]> = out.cells.iter().map(around).collect();
        let joined = |a: [DVec3; 2], b: &[DVec3; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        let bounds = boxes.iter().fold([DVec3::INFINITY, DVec3::NEG_INFINITY], joined);
        out.tree = BoxTree::build(&boxes);
        out.bounds = bounds;
        Ok(out)
    }

    /// Samples along x, y and z.
    pub fn size(&self) -> [usize; 3] {
        self.size
    }

    /// Number of cells that the surface passes through.
    pub fn cells(&self) -> usize {
        self.cells.len()
    }

    /// The box of these cells, in grid coordinates.
    pub fn bounds(&self) -> [DVec3; 2] {
        self.bounds
    }

    /// Memory of the values, the cells and the tree, in bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(self.values.as_slice()) + size_of_val(self.cells.as_slice()) + self.tree.bytes()
    }

    /// Calls `found` with hits at `t` from 0 to `limit` and the limit so far; it returns the new limit, or ends the walk.
    ///
    /// `direction` is finite and not zero; hits come in no particular order.
    #[inline(never)]
    pub fn candidates(
        &self,
        origin: DVec3,
        direction: DVec3,
        limit: f32,
        found: &mut dyn FnMut(DistanceHit, f32) -> Option<f32>,
    ) {
        // The tree is walked in single precision, from where the ray enters its box: distances from there are short.
        let [enter, leave] = slab(origin, direction, self.bounds);
        let start = enter.max(0.0);
        if !(start <= leave && start <= f64::from(limit)) {
            return;
        }
        let single = |p: DVec3| vec3(p.x as f32, p.y as f32, p.z as f32);
        let ray = BoxRay::new(&self.tree, single(origin + direction * start), single(direction));
        // Rounded up.
        let behind = |limit: f32| ((f64::from(limit) - start) * (1.0 + 1e-6)) as f32;
        let mut limit = limit;
        self.tree.walk(&ray, behind(limit.min(f32::MAX)), |index, _| {
            let mut goes_on = true;
            self.hits_in(index, origin, direction, |hit| {
                if hit.t > f64::from(limit) {
                    return true;
                }
                match found(hit, limit) {
                    Some(new) => limit = new,
                    None => goes_on = false,
                }
                goes_on
            });
            goes_on.then(|| behind(limit.min(f32::MAX)))
        });
    }

    /// The hits of a ray in one cell.
    fn hits_in(
        &self,
        index: u32,
        origin: DVec3,
        direction: DVec3,
        mut found: impl FnMut(DistanceHit) -> bool,
    ) {
        let low = self.corner(self.cells[index as usize]).as_dvec3();
        let high = low + DVec3::ONE;
        let [enter, leave] = slab(origin, direction, [low, high]);
        let start = enter.max(0.0);
        if start > leave {
            return;
        }
        // On the faces coordinates are exact, so that the next cell sees the same value there.
        let on_cell = |t: f64| {
            let mut p = (origin + direction * t - low).clamp(DVec3::ZERO, DVec3::ONE);
            for k in 0..3 {
                if direction[k] != 0.0 {
                    if (low[k] - origin[k]) / direction[k] == t {
                        p[k] = 0.0;
                    } else if (high[k] - origin[k]) / direction[k] == t {
                        p[k] = 1.0;
                    }
                }
            }
            p
        };
        let (a, b) = (on_cell(start), on_cell(leave));
        let cell = self.cell(self.cells[index as usize]);
        cell.crossings(a, b, |Crossing { s, inwards }| {
            found(DistanceHit { t: start + (leave - start) * s, cell: index, front: inwards })
        });
    }

    /// A point of the surface in a cell beside `p`, found along the gradient, and the gradient there, in grid coordinates;
    /// from far off `p` may be anywhere.
    pub fn on_surface(&self, cell: u32, p: DVec3) -> (DVec3, DVec3) {
        let sample = self.cells[cell as usize];
        let (low, values) = (self.corner(sample).as_dvec3(), self.cell(sample));
        let mut q = (p - low).clamp(DVec3::ZERO, DVec3::ONE);
        for _ in 0..3 {
            let g = values.gradient(q);
            let step = g * (values.value(q) / g.length_squared());
            // Where the gradient vanishes the point stays.
            if step.length_squared() <= 1.0 {
                q = (q - step).clamp(DVec3::ZERO, DVec3::ONE);
            }
        }
        let value = values.value(q);
        if value.abs() > OFF * values.0.iter().fold(0.0, |most: f64, v| most.max(v.abs())) {
            // The gradient leads out of the cell: towards a corner on the other side.
            if let Some(corner) = (0..8).find(|i| (values.0[*i] < 0.0) != (value < 0.0)) {
                let corner = DVec3::from_array([0, 1, 2].map(|k| (corner >> k & 1) as f64));
                let from = q;
                values.crossings(from, corner, |crossing| {
                    q = from + (corner - from) * crossing.s;
                    false
                });
            }
        }
        (low + q, values.gradient(q))
    }

    /// A normal that is continuous over the faces of cells, in grid coordinates and not normalised: the directions of the
    /// gradients of the eight cells around the sample nearest to `p`, interpolated between the middles of these cells
    /// (Hansson-Söderlund et al. 2022, section 5).
    ///
    /// The derivative along an axis is the difference over a cell's length on the line through `p`, which two of the cells
    /// tell apart. `scale` is the length of a cell along each axis; cells beyond the grid do not count.
    pub fn smooth_normal(&self, p: DVec3, scale: DVec3) -> DVec3 {
        let last = DVec3::from_array(self.size.map(|n| (n - 1) as f64));
        let p = p.clamp(DVec3::ZERO, last);
        let nearest = p.round();
        let cell = p.floor().min(last - DVec3::ONE);
        // Along each axis: derivatives in the lower and the upper cell, and their weights.
        let (mut slopes, mut weights) = ([[0.0; 2]; 3], [[0.0; 2]; 3]);
        for k in 0..3 {
            for (side, lower) in [nearest[k] - 1.0, nearest[k]].into_iter().enumerate() {
                if lower < 0.0 || lower >= last[k] {
                    continue;
                }
                let at = |plane: f64| {
                    let (mut corner, mut q) = (cell, p - cell);
                    (corner[k], q[k]) = (plane.min(last[k] - 1.0), plane - plane.min(last[k] - 1.0));
                    self.cell(self.index(corner.to_array().map(|x| x as usize)) as u32).value(q)
                };
                slopes[k][side] = (at(lower + 1.0) - at(lower)) / scale[k];
                weights[k][side] = 1.0 - (p[k] - (lower + 0.5)).abs();
            }
        }
        let mut sum = DVec3::ZERO;
        for corner in 0..8 {
            let side = |k: usize| corner >> k & 1;
            let slope = DVec3::from_array([0, 1, 2].map(|k| slopes[k][side(k)]));
            let weight: f64 = (0..3).map(|k| weights[k][side(k)]).product();
            sum += slope.normalize_or_zero() * weight;
        }
        sum
    }

    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.size[1] + y) * self.size[0] + x
    }

    /// The lower corner of a cell.
    fn corner(&self, sample: u32) -> glam::UVec3 {
        let [nx, ny] = [self.size[0] as u32, self.size[1] as u32];
        glam::UVec3::new(sample % nx, sample / nx % ny, sample / nx / ny)
    }

    /// Offsets of a cell's corners from its lower one.
    fn offsets(&self) -> [usize; 8] {
        let (row, layer) = (self.size[0], self.size[0] * self.size[1]);
        std::array::from_fn(|i| (i & 1) + (i >> 1 & 1) * row + (i >> 2) * layer)
    }

    fn cell(&self, sample: u32) -> Cell {
        Cell(self.offsets().map(|o| f64::from(self.values[sample as usize + o])))
    }

    /// Whether a cell has corners on both sides.
    fn is_crossed(&self, sample: usize) -> bool {
        let inside = self.offsets().map(|o| self.values[sample + o] < 0.0);
        inside.iter().any(|s| *s != inside[0])
    }
}

fn check(size: [usize; 3], values: &[f32]) -> Result<(), DistanceGridError> {
    let samples = size[0].checked_mul(size[1]).and_then(|n| n.checked_mul(size[2]));
    let Some(expected) = samples.filter(|n| *n <= SAMPLES && size.iter().all(|n| *n >= 2)) else {
        return Err(DistanceGridError::Size { size });
    };
    if values.len() != expected {
        return Err(DistanceGridError::Count { found: values.len(), expected });
    }
    if let Some(index) = values.iter().position(|v| !v.is_finite()) {
        return Err(DistanceGridError::NonFinite { index, value: values[index] });
    }
    let negative = values[0] < 0.0;
    if values.iter().all(|v| (*v < 0.0) == negative) {
        return Err(DistanceGridError::OneSided { negative });
    }
    Ok(())
}

/// Where a ray enters and leaves a box; NaN, or the first above the second, where it misses.
#[inline]
fn slab(origin: DVec3, direction: DVec3, [low, high]: [DVec3; 2]) -> [f64; 2] {
    let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
    for k in 0..3 {
        if direction[k] == 0.0 {
            if !(low[k] <= origin[k] && origin[k] <= high[k]) {
                return [f64::INFINITY, f64::NEG_INFINITY];
            }
            continue;
        }
        let (a, b) = ((low[k] - origin[k]) / direction[k], (high[k] - origin[k]) / direction[k]);
        (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
    }
    [enter, leave]
}

#[cfg(test)]
mod tests;
