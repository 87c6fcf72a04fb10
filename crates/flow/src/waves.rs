//! Waves of paths: many walks are suspended at what they ask of a guide, and answered together.

#[cfg(any(target_arch = "x86_64", target_arch = "aarch64", target_arch = "riscv64"))]
mod suspended;

use crate::guide::{Guide, Guided};
use photofit_sampling::{Paths, SideBySide};

/// Walks paths with directions of the mixture [`Guided`], to the same bits as one after another.
///
/// One after another is how they are walked where no memory is left for their stacks, and on processors for which stacks cannot be
/// switched (a browser's).
#[derive(Clone, Copy, Debug)]
pub struct Waves<'a, G>(pub &'a G);

impl<G: Guide> SideBySide for Waves<'_, G> {
    fn walk_all<P: Paths>(&self, count: usize, paths: &P) {
        #[cfg(any(target_arch = "x86_64", target_arch = "aarch64", target_arch = "riscv64"))]
        if suspended::walk_all(self.0, count, paths) {
            return;
        }
        (0..count).for_each(|path| paths.walk(path, &Guided(self.0)));
    }
}

#[cfg(test)]
mod tests;
