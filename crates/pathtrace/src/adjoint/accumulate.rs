//! Sums of gradients that do not depend on the number of threads.
//!
//! Every task sums the small parameters densely and queues what falls on large images; its queue is sorted and merged
//! by cell when it ends, and in between when it is long. Tasks are reduced in their order, bands of cells in parallel.

use super::layout::NONE;
use photofit_scalar::Vec3f;
use rayon::prelude::*;

/// Cells that one thread reduces at a time.
const BAND: usize = 4096;
/// Entries of a queue that are merged before it ends.
const LONG: usize = 1 << 20;

/// The gradients of one task.
#[derive(Debug)]
pub(super) struct Accumulator {
    dense: Vec<[f64; 3]>,
    sparse: Vec<(u32, [f64; 3])>,
    /// Length of the queue at which it is merged.
    long: usize,
    /// Largest remainder of light at the end of a path, relative to the light of the path.
    pub(super) residual: f64,
    /// Contributions that were left out because they were not finite.
    pub(super) not_finite: u64,
}

impl Accumulator {
    pub(super) fn new(dense: usize) -> Self {
        Self { dense: vec![[0.0; 3]; dense], sparse: Vec::new(), long: LONG, residual: 0.0, not_finite: 0 }
    }

    /// Adds to a cell, if it is one.
    #[inline]
    pub(super) fn add(&mut self, cell: u32, g: Vec3f) {
        if cell == NONE {
            return;
        }
        if !g.is_finite() {
            self.not_finite += 1;
            return;
        }
        let g = g.to_array().map(f64::from);
        match self.dense.get_mut(cell as usize) {
            Some(sum) => (0..3).for_each(|c| sum[c] += g[c]),
            None => {
                self.sparse.push((cell, g));
                if self.sparse.len() >= self.long {
                    self.merge_queue();
                    self.long = LONG.max(2 * self.sparse.len());
                }
            }
        }
    }

    /// One entry per cell, in the order of the cells.
    pub(super) fn merge(&mut self) {
        self.merge_queue();
        self.sparse.shrink_to_fit();
    }

    #[inline(never)]
    fn merge_queue(&mut self) {
        self.sparse.sort_by_key(|e| e.0);
        self.sparse.dedup_by(|next, sum| {
            let same = next.0 == sum.0;
            if same {
                (0..3).for_each(|c| sum.1[c] += next.1[c]);
            }
            same
        });
    }

    /// Adds merged tasks in order.
    pub(super) fn reduce(tasks: &[Self], total: &mut [[f64; 3]]) {
        let Some(first) = tasks.first() else { return };
        let (dense, large) = total.split_at_mut(first.dense.len());
        for task in tasks {
            for (sum, g) in dense.iter_mut().zip(&task.dense) {
                (0..3).for_each(|c| sum[c] += g[c]);
            }
        }
        let offset = dense.len();
        large.par_chunks_mut(BAND).enumerate().for_each(|(band, cells)| {
            let from = offset + band * BAND;
            let end = from + cells.len();
            for task in tasks {
                let begin = task.sparse.partition_point(|e| (e.0 as usize) < from);
                let inside = |e: &&(u32, [f64; 3])| (e.0 as usize) < end;
                for (cell, g) in task.sparse[begin..].iter().take_while(inside) {
                    let sum = &mut cells[*cell as usize - from];
                    (0..3).for_each(|c| sum[c] += g[c]);
                }
            }
        });
    }
}
