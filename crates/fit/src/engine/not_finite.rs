//! Light that is not a number: contributions that path traced pictures and gradients leave out, counted and told once.

use crate::Progress;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// How many contributions were left out because they were not finite; clones share the count.
#[derive(Clone, Debug, Default)]
pub(crate) struct NotFinite(Arc<AtomicU64>);

impl NotFinite {
    /// Counts so many more.
    pub(crate) fn add(&self, count: u64) {
        self.0.fetch_add(count, Ordering::Relaxed);
    }

    /// Warns of them once what is returned goes.
    #[must_use]
    pub(crate) fn told_at_the_end<'a>(&self, progress: &'a dyn Progress) -> ToldAtTheEnd<'a> {
        ToldAtTheEnd(self.clone(), progress)
    }

    /// Warns of those that were counted since this was told last, where there are any.
    fn tell(&self, progress: &dyn Progress) {
        let count = self.0.swap(0, Ordering::Relaxed);
        if count > 0 {
            progress.warn(&not_finite_told(count));
        }
    }
}

/// Tells what was counted when it goes, also where the work ends with an error, which such light may explain.
pub(crate) struct ToldAtTheEnd<'a>(NotFinite, &'a dyn Progress);

impl Drop for ToldAtTheEnd<'_> {
    fn drop(&mut self) {
        self.0.tell(self.1);
    }
}

/// What is said of so many contributions.
pub fn not_finite_told(count: u64) -> String {
    let were = if count == 1 { "contribution was" } else { "contributions were" };
    format!(
        "{count} {were} not finite and left out: light or materials have values that are beyond all bounds"
    )
}
