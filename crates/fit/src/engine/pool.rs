//! The pictures that the fit draws from.

use super::reference::Painter;
use crate::FitError;
use crate::simplify::SimplifyOptions;
use crate::views::{Set, Setup, Shot, setup};
use photofit_image::Image;
use photofit_sampling::Rng;
use std::collections::VecDeque;

/// Pictures that are kept: the fit sees the latest ones again, at random.
const WINDOW: u64 = 64;

/// Pictures of the reference from views that never end: half of every batch is new, the other half is drawn from the
/// latest. A fixed set of views is learned by heart: texels come to fit what happens to be seen of them (72 views:
/// DamagedHelmet at 500 triangles is .9 dB worse in other views).
///
/// What a step draws depends on the step alone, so that a fit that goes on from a checkpoint sees the same.
#[derive(Debug, Default)]
pub(crate) struct Pool {
    /// With their numbers, in increasing order.
    kept: VecDeque<(u64, Setup, Image)>,
    /// Width and height of the pictures that are kept.
    size: usize,
}

impl Pool {
    /// The shots of one step with pictures of `size` x `size` pixels, compared at `samples` per axis; `first` is the
    /// first step with pictures of this size.
    pub(crate) fn batch(
        &mut self,
        painter: &Painter<'_>,
        options: &SimplifyOptions,
        (first, step): (u64, u64),
        size: usize,
        samples: usize,
    ) -> Result<Vec<Shot>, FitError> {
        if size != self.size {
            (self.kept, self.size) = (VecDeque::new(), size);
        }
        let mut rng = Rng::new(options.seed, (7 << 32) + step);
        let batch = options.batch as u64;
        let fresh = batch.div_ceil(2);
        let (next, end) = (step * fresh, (step + 1) * fresh);
        let oldest = end.saturating_sub(WINDOW).max(first * fresh);
        while self.kept.front().is_some_and(|k| k.0 < oldest) {
            self.kept.pop_front();
        }
        (0..batch)
            .map(|b| {
                let index =
                    if b < fresh { next + b } else { oldest + u64::from(rng.next_u32()) % (end - oldest) };
                let at = match self.kept.binary_search_by_key(&index, |k| k.0) {
                    Ok(at) => at,
                    Err(at) => {
                        let s = setup(Set::Train, index, 0, options.seed, &options.lighting);
                        let picture = painter.picture(&s, size)?;
                        self.kept.insert(at, (index, s, picture));
                        at
                    }
                };
                let (_, s, picture) = &self.kept[at];
                Ok(Shot::new(s, picture, samples, options.seed, step * batch + b))
            })
            .collect()
    }
}
