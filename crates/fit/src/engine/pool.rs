//! The pictures that the fit draws from.

use super::reference::Reference;
use super::views::{Sampling, Set, Setup, Shot, Views};
use crate::FitError;
use photofit_image::Image;
use photofit_sampling::Rng;
use std::collections::VecDeque;
use std::sync::Arc;

/// Pictures that are kept at least: the fit sees the latest ones again, at random.
const WINDOW: u64 = 64;
/// Pictures that are kept for each one that a step sees again, and for each new one: where a step sees many again, they
/// are not the same few.
const WINDOW_PER_REPLAY: u64 = 64;

/// Pictures of a step: some that were never shown, and others drawn from the latest ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Batch {
    pictures: usize,
    fresh: usize,
}

impl Batch {
    /// `pictures`, of which `fresh` are new.
    ///
    /// # Panics
    /// Unless 1 to `pictures` are new.
    pub fn new(pictures: usize, fresh: usize) -> Self {
        assert!(
            (1..=pictures).contains(&fresh),
            "{fresh} of {pictures} pictures are new; it must be 1 to all of them"
        );
        Self { pictures, fresh }
    }

    /// `pictures`, of which half are new, rounded up.
    ///
    /// # Panics
    /// Without any.
    pub fn half_new(pictures: usize) -> Self {
        Self::new(pictures, pictures.div_ceil(2))
    }

    /// All pictures.
    pub fn pictures(self) -> usize {
        self.pictures
    }

    /// Those that are new.
    pub fn fresh(self) -> usize {
        self.fresh
    }
}

/// Pictures that a fit keeps at most, whose batches have `size` pictures, `fresh` of them new.
pub(super) fn window(size: u64, fresh: u64) -> u64 {
    WINDOW.max(WINDOW_PER_REPLAY * (size - fresh) / fresh)
}

/// How a fit draws its batches.
#[derive(Clone, Copy)]
pub(super) struct Batches<'a> {
    pub(super) reference: &'a dyn Reference,
    pub(super) views: &'a dyn Views,
    pub(super) seed: u64,
    /// Pictures of a batch.
    pub(super) size: u64,
    /// How many of them are new.
    pub(super) fresh: u64,
    pub(super) sampling: Sampling,
}

/// Pictures of the reference from views that never end: some of every batch are new, the others are drawn from the
/// latest. A fixed set of views is learned by heart: texels come to fit what happens to be seen of them (72 views:
/// DamagedHelmet at 500 triangles is .9 dB worse in other views).
///
/// What a step draws depends on the step alone, so that a fit that goes on from a checkpoint sees the same.
#[derive(Debug, Default)]
pub(super) struct Pool {
    /// With their numbers, in increasing order.
    kept: VecDeque<(u64, Setup, Arc<Image>)>,
    /// By how much the pictures that are kept are smaller.
    shrink: usize,
}

impl Pool {
    /// The shots of one step with pictures that are smaller by `shrink`; `first` is the first step with pictures of
    /// this size.
    pub(super) fn batch(
        &mut self,
        from: &Batches<'_>,
        (first, step): (u64, u64),
        shrink: usize,
    ) -> Result<Vec<Shot>, FitError> {
        if shrink != self.shrink {
            (self.kept, self.shrink) = (VecDeque::new(), shrink);
        }
        let mut rng = Rng::new(from.seed, (7 << 32) + step);
        let fresh = from.fresh;
        let window = window(from.size, fresh);
        let (next, end) = (step * fresh, (step + 1) * fresh);
        let oldest = end.saturating_sub(window).max(first * fresh);
        while self.kept.front().is_some_and(|k| k.0 < oldest) {
            self.kept.pop_front();
        }
        (0..from.size)
            .map(|b| {
                let index =
                    if b < fresh { next + b } else { oldest + u64::from(rng.next_u32()) % (end - oldest) };
                let at = match self.kept.binary_search_by_key(&index, |k| k.0) {
                    Ok(at) => at,
                    Err(at) => {
                        let s = from.views.setup(Set::Train, index, 0).shrunk(shrink);
                        let picture = from.reference.picture(&s)?;
                        if s.picture.is_some() {
                            // The reference holds it already.
                            let number = step * from.size + b;
                            return Ok(Shot::new(&s, picture.image, from.sampling, from.seed, number));
                        }
                        self.kept.insert(at, (index, s, Arc::new(picture.image)));
                        at
                    }
                };
                let (_, s, picture) = &self.kept[at];
                Ok(Shot::new(s, picture.clone(), from.sampling, from.seed, step * from.size + b))
            })
            .collect()
    }
}
