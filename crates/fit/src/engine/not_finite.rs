//! Light that is not a number: contributions that path traced pictures and gradients leave out, counted and told once.

use crate::Progress;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// How many contributions were left out because they were not finite; clones share the count.
#[derive(Clone, Debug, Default)]
pub struct NotFinite(Arc<AtomicU64>);

impl NotFinite {
    /// Counts so many more.
    pub(crate) fn add(&self, count: u64) {
        self.0.fetch_add(count, Ordering::Relaxed);
    }

    /// Warns of those that were counted since this was told last, where there are any.
    pub(crate) fn tell(&self, progress: &dyn Progress) {
        let count = self.0.swap(0, Ordering::Relaxed);
        if count > 0 {
            progress.warn(&not_finite_told(count));
        }
    }
}

/// What is said of so many contributions.
pub fn not_finite_told(count: u64) -> String {
    format!("{count} contributions were not finite and are left out: the scene is faulty")
}
