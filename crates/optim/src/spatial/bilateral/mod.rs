//! The cross-bilateral à-trous filter on grids: averages along the parameters' own edges.

mod config;
mod exp;
mod planes;
mod rows;
mod sigma;

use super::grid::Grid;
use super::{Guidance, SpatialFilter};
use crate::error::OptimError;
pub use config::{Bilateral, GuideMap, Sigma, Source, Taps};
use photofit_scalar::Real;
use planes::Planes;
use rayon::prelude::*;
use rows::Level;
use std::f64::consts::LOG2_E;

/// A further guide: what is constant on each side of an edge that the parameters may not show yet.
#[derive(Clone, Debug)]
struct Joint<T> {
    channels: usize,
    sigma: f64,
    values: Vec<T>,
}

/// The edge-avoiding à-trous filter (Dammertz et al. 2010) guided by the parameters (Belhe et al. 2025), on grids of one,
/// two or three axes with any number of channels.
///
/// Each level is `F(x) = sum_y k(x, y) w(x, y) f(y) / sum_y k(x, y) w(x, y)` over 3 or 5 taps per axis, `stride` apart;
/// taps outside the grid are left out. `w = exp(-d)`, `d^2 = |theta_x - theta_y|^2 / sigma^2` (+ the same of every joint
/// guide): a length, not its square. All levels and all fields of a step share the guide of that step, and a level's
/// weights are computed once for all fields. One level has real eigenvalues in [0, 1]; the product of several need not,
/// so the filtered gradient is not always a descent direction.
///
/// Labels and holes cut: nothing passes between sites of different labels, and holes neither give nor receive.
#[derive(Clone, Debug)]
pub struct GridBilateral<T> {
    config: Bilateral,
    grid: Grid,
    channels: usize,
    joint: Option<Joint<T>>,
    /// Rank of each site's label times a cut that no weight survives; 0 for holes.
    cuts: Option<Vec<T>>,
    holes: Option<Vec<bool>>,
    guide: Planes<T>,
    fields: [Planes<T>; 2],
}

/// Distance in the guide at which weights are exactly zero.
const CUT: f64 = 128.0;

impl<T: Real> GridBilateral<T> {
    /// For a group of `grid.sites()` rows of `channels` consecutive samples, named for messages.
    ///
    /// # Errors
    /// [`OptimError::Setting`].
    pub fn new(group: &str, grid: Grid, channels: usize, config: Bilateral) -> Result<Self, OptimError> {
        let levels = config.levels;
        OptimError::setting(group, "number of levels", f64::from(levels), "at most 30", levels <= 30)?;
        OptimError::setting(
            group,
            "channels",
            channels as f64,
            "from 1 to 1024",
            (1..=1024).contains(&channels),
        )?;
        let (sigma, name) = match config.sigma {
            Sigma::Auto(k) => (k, "automatic sigma's factor"),
            Sigma::Fixed(sigma) => (sigma, "sigma"),
            Sigma::Unlimited => (0.0, "sigma"),
        };
        OptimError::setting(
            group,
            name,
            sigma,
            "finite and not negative",
            sigma >= 0.0 && sigma.is_finite(),
        )?;
        if let GuideMap::Asinh(s) = config.map {
            OptimError::setting(group, "asinh scale", s, "finite and positive", s > 0.0 && s.is_finite())?;
        }
        let count = grid.sites();
        let good = count.checked_mul(channels).is_some_and(|n| (n as u64) < 1 << 40);
        OptimError::setting(group, "number of sites", count as f64, "below 2^40 samples", good)?;
        Ok(Self {
            config,
            grid,
            channels,
            joint: None,
            cuts: None,
            holes: None,
            guide: Planes::default(),
            fields: Default::default(),
        })
    }

    /// With a joint guide of `channels` samples per site (normals, say) and its own width `sigma`; the values may be
    /// replaced by those given with a step ([`Optimizer::step_guided`](crate::Optimizer::step_guided)).
    ///
    /// # Errors
    /// [`OptimError::Length`], or [`OptimError::Setting`] for non-finite values or a width that is not positive.
    pub fn with_guide(mut self, values: &[T], channels: usize, sigma: f64) -> Result<Self, OptimError> {
        OptimError::setting(
            NAME,
            "joint sigma",
            sigma,
            "finite and positive",
            sigma > 0.0 && sigma.is_finite(),
        )?;
        OptimError::length(NAME, "joint guide", values.len(), self.grid.sites().saturating_mul(channels))?;
        check_joint(NAME, values)?;
        self.joint = Some(Joint { channels, sigma, values: values.to_vec() });
        Ok(self)
    }

    /// With a label per site (uv charts, material ids): nothing passes between different labels.
    ///
    /// # Errors
    /// [`OptimError::Length`], or [`OptimError::Setting`] for more than 2^24 labels.
    pub fn with_labels(mut self, labels: &[u32]) -> Result<Self, OptimError> {
        OptimError::length(NAME, "labels", labels.len(), self.grid.sites())?;
        let mut distinct = labels.to_vec();
        distinct.sort_unstable();
        distinct.dedup();
        let count = distinct.len();
        // Ranks times the cut stay exact in f32.
        OptimError::setting(NAME, "number of labels", count as f64, "below 2^24", count < 1 << 24)?;
        let rank = |l: &u32| distinct.partition_point(|d| d < l) + 1;
        let mut cuts: Vec<T> = labels.iter().map(|l| T::of(rank(l) as f64 * CUT)).collect();
        self.cut_holes(&mut cuts);
        self.cuts = Some(cuts);
        Ok(self)
    }

    /// With holes (unused texels, empty voxels), which neither give nor receive; their fields come back as they were.
    ///
    /// # Errors
    /// [`OptimError::Length`].
    pub fn with_holes(mut self, holes: &[bool]) -> Result<Self, OptimError> {
        OptimError::length(NAME, "holes", holes.len(), self.grid.sites())?;
        self.holes = Some(holes.to_vec());
        let mut cuts = self.cuts.take().unwrap_or_else(|| vec![T::of(CUT); holes.len()]);
        self.cut_holes(&mut cuts);
        self.cuts = Some(cuts);
        Ok(self)
    }

    fn cut_holes(&self, cuts: &mut [T]) {
        for (cut, hole) in cuts.iter_mut().zip(self.holes.iter().flatten()) {
            if *hole {
                *cut = T::zero();
            }
        }
    }

    /// Strides of the levels that do anything on this grid, in the order in which they run.
    fn strides(&self) -> Vec<usize> {
        let longest = self.grid.shape().into_iter().max().unwrap_or(0);
        let mut strides: Vec<usize> =
            (0..self.config.levels).map(|l| 1 << l).filter(|s| *s < longest).collect();
        if self.config.coarse_to_fine {
            strides.reverse();
        }
        strides
    }

    /// Samples beyond a row that the widest level reaches.
    fn pad(&self) -> usize {
        let radius = self.config.taps.weights().len() / 2;
        let widest = self.strides().into_iter().max().unwrap_or(0) * radius;
        widest.min(self.grid.shape()[0].saturating_sub(1)).next_multiple_of(8)
    }

    /// Writes the scaled guide of this step to its planes.
    fn load_guide(&mut self, values: &[T], inverse: Option<T>) {
        let map = self.config.map;
        let [nx, ny, nz] = self.grid.shape();
        let own = if inverse.is_some() { self.channels } else { 0 };
        let scale = inverse.unwrap_or(T::zero());
        let joint = self.joint.as_ref().map(|j| (j, j.inverse()));
        let cuts = self.cuts.as_deref();
        let further = joint.map_or(0, |(j, _)| j.channels) + usize::from(cuts.is_some());
        let pad = self.pad();
        self.guide.shape(ny * nz, nx, (own + further).max(1), pad);
        self.guide.rows_mut().for_each(|mut row| {
            let sites = row.index * nx..(row.index + 1) * nx;
            if own > 0 {
                let values = &values[sites.start * own..sites.end * own];
                row.load(0, own, nx, values, |x| map.value(x) * scale);
            }
            let mut plane = own;
            if let Some((joint, scale)) = joint {
                let width = joint.channels;
                row.load(plane, width, nx, &joint.values[sites.start * width..sites.end * width], |x| {
                    x * scale
                });
                plane += width;
            }
            if let Some(cuts) = cuts {
                row.load(plane, 1, nx, &cuts[sites], |x| x);
            }
            row.fence(nx);
        });
    }
}

/// Name in messages where no group is known.
const NAME: &str = "bilateral filter";

impl<T: Real> Joint<T> {
    /// Factor on the values that brings them to units of the width.
    fn inverse(&self) -> T {
        let size = self.values.iter().fold(T::zero(), |a, b| a.max(b.abs()));
        scale(self.sigma, size.f64())
    }
}

/// Factor that brings a guide of at most `size` to units in which a weight halves at distance one. The result stays
/// below 1e15, and so at weight zero from the outside of the grid.
fn scale<T: Real>(sigma: f64, size: f64) -> T {
    T::of((LOG2_E / sigma).min(1e15 / size.max(1e-15)).min(1e30))
}

/// Refuses non-finite values of a joint guide.
fn check_joint<T: Real>(group: &str, values: &[T]) -> Result<(), OptimError> {
    match values.iter().find(|x| !x.is_finite()) {
        Some(x) => OptimError::setting(group, "joint guide", x.f64(), "finite", false),
        None => Ok(()),
    }
}

/// Largest size of the values; the first that is not finite is an error.
fn largest<T: Real>(group: &str, values: &[T]) -> Result<f64, OptimError> {
    let sizes: Vec<(T, bool)> = values
        .par_chunks(1 << 14)
        .map(|c| {
            let largest = c.iter().fold(T::zero(), |a, b| if b.abs() > a { b.abs() } else { a });
            (largest, c.iter().fold(true, |good, x| good & x.is_finite()))
        })
        .collect();
    if sizes.iter().all(|s| s.1) {
        return Ok(sizes.iter().fold(T::zero(), |a, s| a.max(s.0)).f64());
    }
    let index = values.iter().position(|x| !x.is_finite()).unwrap_or(0);
    Err(OptimError::NonFiniteParameter { group: group.to_owned(), index, value: values[index].f64() })
}

impl<T: Real> SpatialFilter<T> for GridBilateral<T> {
    fn sites(&self) -> usize {
        self.grid.sites()
    }

    fn prepare(&mut self, guidance: &Guidance<'_, T>) -> Result<(), OptimError> {
        let Guidance { group, params, grads, rate, guide } = *guidance;
        let sites = self.grid.sites();
        OptimError::length(group, "guide", params.len(), sites * self.channels)?;
        if sites == 0 {
            return Ok(());
        }
        if !guide.is_empty() {
            let expected = self.joint.as_ref().map_or(0, |j| j.channels) * sites;
            OptimError::length(group, "joint guide", guide.len(), expected)?;
            check_joint(group, guide)?;
        }
        let (values, rate) = match self.config.source {
            Source::Parameters => (params, rate.f64()),
            Source::Gradients => (grads, 0.0),
        };
        let size = largest(group, values)?;
        if let (Some(joint), false) = (&mut self.joint, guide.is_empty()) {
            joint.values.copy_from_slice(guide);
        }
        let map = self.config.map;
        let sigma = sigma::sigma(self.config.sigma, map, self.grid, values, self.cuts.as_deref(), rate);
        let size = map.value(T::of(size)).abs().max(map.value(T::zero()).abs()).f64();
        self.load_guide(values, sigma.is_finite().then(|| scale(sigma, size)));
        Ok(())
    }

    fn apply(&mut self, fields: &[&[T]], out: &mut [&mut [T]]) {
        let (shape, sites) = (self.grid.shape(), self.grid.sites());
        if sites == 0 {
            return;
        }
        let [nx, ny, nz] = shape;
        let widths: Vec<usize> = fields.iter().map(|f| f.len() / sites).collect();
        let (count, pad) = (widths.iter().sum(), self.guide.pad);
        let [from, to] = &mut self.fields;
        from.shape(ny * nz, nx, count, pad);
        to.shape(ny * nz, nx, count, pad);
        from.rows_mut().for_each(|mut row| {
            let mut plane = 0;
            for (field, &width) in fields.iter().zip(&widths) {
                let at = row.index * nx * width;
                row.load(plane, width, nx, &field[at..at + nx * width], |x| x);
                plane += width;
            }
        });
        let taps = self.config.taps.weights();
        for stride in self.strides() {
            let [from, to] = &mut self.fields;
            rows::filter(shape, Level { taps, stride }, &self.guide, from, to);
            std::mem::swap(from, to);
        }
        let from = &self.fields[0];
        let mut plane = 0;
        for ((field, out), width) in fields.iter().zip(out).zip(widths) {
            out.par_chunks_mut(nx * width).enumerate().for_each(|(r, out)| {
                from.store(r, plane, width, nx, out);
                let Some(holes) = &self.holes else { return };
                for (x, hole) in holes[r * nx..(r + 1) * nx].iter().enumerate().filter(|(_, h)| **h) {
                    debug_assert!(*hole, "only holes pass the filter");
                    let own = (r * nx + x) * width..(r * nx + x + 1) * width;
                    out[x * width..(x + 1) * width].copy_from_slice(&field[own]);
                }
            });
            plane += width;
        }
    }
}

#[cfg(test)]
mod tests;
