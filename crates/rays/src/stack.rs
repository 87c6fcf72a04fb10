//! The stack of a traversal.

/// Nodes still to visit, with the distances of their boxes where the order counts ([`entry`]); spills to the
/// heap in very deep trees.
///
/// Aligned to lines of the cache, and with it what a traversal keeps on the stack of the thread: else a
/// quarter of the time goes to vectors that cross lines, in some processes and not in others.
///
/// Users keep the number of entries to themselves, in a register.
#[repr(C, align(64))]
pub(super) struct Stack<T> {
    inline: [T; INLINE],
    spilled: Vec<T>,
}

/// Entries that need no memory of the heap.
const INLINE: usize = 32;
/// Entries moved at once to the heap or back.
const MOVED: usize = INLINE / 2;
/// Most entries that [`Stack::reserve`] makes room for.
const ROOM: usize = 8;

/// A node and its distance as one number: entries of distances from zero on sort by distance.
#[inline(always)]
pub(super) fn entry(node: u32, near: f32) -> u64 {
    u64::from(near.to_bits()) << 32 | u64::from(node)
}

/// The inverse of [`entry`].
#[inline(always)]
pub(super) fn parts(entry: u64) -> (u32, f32) {
    (entry as u32, f32::from_bits((entry >> 32) as u32))
}

impl<T: Copy + Default + PartialOrd> Stack<T> {
    #[inline(always)]
    pub(super) fn new() -> Self {
        Self { inline: [T::default(); INLINE], spilled: Vec::new() }
    }

    /// Makes room for eight entries above the `len` that are there; returns the new number.
    #[inline(always)]
    pub(super) fn reserve(&mut self, len: usize) -> usize {
        if len > INLINE - ROOM { self.spill(len) } else { len }
    }

    /// Sets the entry at a place.
    #[inline(always)]
    pub(super) fn set(&mut self, at: usize, entry: T) {
        self.inline[at % INLINE] = entry;
    }

    /// Sets eight entries from a place with room for them.
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    pub(super) fn set_all(&mut self, at: usize, entries: [T; ROOM]) {
        let at = at.min(INLINE - ROOM);
        self.inline[at..at + ROOM].copy_from_slice(&entries);
    }

    /// The entry at a place.
    #[inline(always)]
    pub(super) fn get(&self, at: usize) -> T {
        self.inline[at % INLINE]
    }

    /// Inserts an entry among those from `bottom` to `top`, which are sorted, the nearest at the top.
    #[inline(always)]
    pub(super) fn insert(&mut self, bottom: usize, top: usize, entry: T) {
        let mut at = top;
        while at > bottom && self.get(at - 1) < entry {
            self.set(at, self.get(at - 1));
            at -= 1;
        }
        self.set(at, entry);
    }

    /// The top entry of `len` and the number of those below.
    #[inline(always)]
    pub(super) fn pop(&mut self, mut len: usize) -> Option<(T, usize)> {
        if len == 0 {
            len = self.refill()?;
        }
        Some((self.inline[(len - 1) % INLINE], len - 1))
    }

    /// Moves the bottom entries to the heap.
    #[cold]
    #[inline(never)]
    fn spill(&mut self, len: usize) -> usize {
        self.spilled.extend_from_slice(&self.inline[..MOVED]);
        self.inline.copy_within(MOVED..len, 0);
        len - MOVED
    }

    /// Takes the latest entries back from the heap.
    #[inline(always)]
    fn refill(&mut self) -> Option<usize> {
        let start = self.spilled.len().checked_sub(MOVED)?;
        self.inline[..MOVED].copy_from_slice(&self.spilled[start..]);
        self.spilled.truncate(start);
        Some(MOVED)
    }
}

#[cfg(test)]
mod tests {
    use super::{Stack, entry, parts};

    #[test]
    fn deep_stacks_spill_and_come_back_in_order() {
        let mut stack = Stack::new();
        let mut len = 0;
        for round in 0..3_u32 {
            for i in 0..200 {
                len = stack.reserve(len);
                stack.set(len, entry(i, (i + round) as f32));
                len += 1;
            }
            for i in (0..200).rev() {
                let (top, below) = stack.pop(len).unwrap();
                assert_eq!(parts(top), (i, (i + round) as f32));
                len = below;
            }
            assert_eq!(stack.pop(len), None);
        }
    }

    #[test]
    fn insertion_sorts() {
        let mut stack = Stack::new();
        for (i, near) in [1.0, 2.0, 0.5, 4.0, 3.0].into_iter().enumerate() {
            stack.insert(i.min(1), i, entry(i as u32, near));
        }
        let order: Vec<u32> = (1..6).rev().map(|len| parts(stack.pop(len).unwrap().0).0).collect();
        assert_eq!(order, [2, 1, 4, 3, 0]);
    }
}
