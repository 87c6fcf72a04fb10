//! Path splitting at the first surface, for sinks that ask for it.

use super::path::{Path, Step};
use super::sink::Sink;
use crate::world::{Interaction, SurfaceMaterial};
use photofit_sampling::DirectionSampler;

impl<const F: u32, S: Sink, D: DirectionSampler> Path<'_, F, S, D> {
    /// Path splitting at the first surface: several directions are followed, each with an equal share of the light, after one next-event
    /// estimation.
    #[inline(never)]
    pub(super) fn split(
        &mut self,
        at: &Interaction,
        material: &SurfaceMaterial<'_>,
        crossings: u32,
        count: u32,
    ) {
        self.with_light(at, material, |path, vertex, local, from| {
            let (random, ray, inside, medium) = (path.random, path.ray, path.inside, path.medium);
            let (throughput, unseen, last, flown) = (path.throughput, path.unseen, path.last, path.flown);
            for index in 0..count {
                path.random = random.split(index, count);
                (path.ray, path.inside, path.medium) = (ray, inside, medium);
                (path.last, path.flown, path.depth, path.together) = (last, flown, 0, false);
                // Roulette ignores the share.
                (path.throughput, path.unseen) = (throughput * (1.0 / count as f32), unseen * count as f32);
                path.sink.split();
                match path.choose(at, material, (vertex, local, from), crossings) {
                    Step::Scattered => {
                        path.depth = 1;
                        if path.depth <= path.options.max_depth && path.roulette() {
                            path.go_on(crossings);
                        }
                    }
                    // Surfaces with such parameters are never passed.
                    Step::Crossed | Step::Ended => {}
                }
            }
        });
    }
}
