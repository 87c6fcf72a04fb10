//! The priority queue of candidates.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// A collapse of `u v`, or the removal of component `u`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Entry {
    pub(super) u: u32,
    /// [`super::topology::NONE`] for a removal.
    pub(super) v: u32,
    /// Sum of the versions of both ends.
    pub(super) stamp: u32,
    /// Place and marks; see [`super::run`].
    pub(super) flags: u32,
}

/// Cheapest first; equal costs in the order of insertion.
#[derive(Debug, Default)]
pub(super) struct Queue {
    /// Bits of the cost above the index into `entries`: eight bytes are all that the heap moves.
    heap: BinaryHeap<Reverse<u64>>,
    entries: Vec<Entry>,
}

fn key(cost: f64, index: usize) -> Reverse<u64> {
    // Non-negative floats order as their bits.
    let bits = (cost.clamp(0.0, f64::from(f32::MAX)) as f32).to_bits();
    Reverse((u64::from(bits) << 32) | index as u64)
}

impl Queue {
    /// Builds the queue from scratch in linear time.
    pub(super) fn fill(all: impl IntoIterator<Item = (f64, Entry)>) -> Self {
        let mut entries = Vec::new();
        let mut keys = Vec::new();
        for (cost, entry) in all {
            keys.push(key(cost, entries.len()));
            entries.push(entry);
        }
        Self { heap: BinaryHeap::from(keys), entries }
    }

    /// Adds a candidate; negative costs and NaN count as zero.
    pub(super) fn push(&mut self, cost: f64, entry: Entry) {
        self.heap.push(key(cost, self.entries.len()));
        self.entries.push(entry);
    }

    /// Takes the cheapest with its cost.
    pub(super) fn pop(&mut self) -> Option<(f64, Entry)> {
        let Reverse(key) = self.heap.pop()?;
        Some((f64::from(f32::from_bits((key >> 32) as u32)), self.entries[key as u32 as usize]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn order_is_cost_then_insertion() {
        let e = |u| Entry { u, v: 0, stamp: 0, flags: 0 };
        let mut q = Queue::fill([(3.0, e(0)), (1e-30, e(1)), (3.0, e(2))]);
        q.push(f64::MAX, e(3));
        q.push(0.0, e(4));
        let order: Vec<u32> = std::iter::from_fn(|| q.pop()).map(|x| x.1.u).collect();
        assert_eq!(order, [4, 1, 0, 2, 3]);
    }
}
