//! Tiles whose paths are walked side by side.

use super::{Job, primary_ray};
use crate::film::Tile;
use crate::integrator::PathSample;
use crate::integrator::path::trace_with;
use photofit_sampling::{DirectionSampler, Paths, SideBySide};
use std::cell::Cell;

/// Samples that are walked before they are added to the film, in whole pixels: the more, the fewer walks idle at the end; more than this leave the caches.
const BATCH: usize = 4096;

/// Samples of some pixels of a tile, the samples of a pixel one after another.
struct Samples<'a, const F: u32> {
    job: &'a Job<'a>,
    tile: &'a Tile,
    /// The first pixel.
    first: usize,
    /// Samples of a pixel.
    each: usize,
    aovs: bool,
    found: &'a [Cell<PathSample>],
}

impl<const F: u32> Paths for Samples<'_, F> {
    fn walk<D: DirectionSampler>(&self, path: usize, sampler: &D) {
        let (renderer, options) = (self.job.renderer, &self.job.renderer.options);
        let (at, mut pixel) = self.job.pixel(self.tile, self.first + path / self.each);
        let random = pixel.sample(self.tile.count + (path % self.each) as u32);
        let ray = primary_ray(options, &self.job.camera, at, &random);
        let sample = trace_with::<F, D>(renderer.world, &ray, &random, &options.path, sampler, self.aovs);
        self.found[path].set(sample);
    }
}

/// Adds the samples that a tile lacks.
pub(super) fn tile<const F: u32, W: SideBySide>(job: &Job<'_>, tile: &mut Tile, walker: &W, aovs: bool) {
    let each = (job.target - tile.count) as usize;
    let (pixels, some) = (tile.width * tile.height, BATCH.div_ceil(each));
    let found = vec![Cell::new(PathSample::default()); some.min(pixels) * each];
    for first in (0..pixels).step_by(some) {
        let count = some.min(pixels - first);
        let samples = Samples::<F> { job, tile, first, each, aovs, found: &found };
        walker.walk_all(count * each, &samples);
        for (i, samples) in found.chunks_exact(each).enumerate().take(count) {
            job.recorder.add(tile, first + i, tile.count, samples.iter().map(Cell::get));
        }
    }
}
