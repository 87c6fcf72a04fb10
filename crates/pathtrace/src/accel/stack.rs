//! The stack of a traversal.

/// Nodes still to visit with the distances of their boxes; spills to the heap in very deep trees.
pub(super) struct Stack {
    inline: [(u32, f32); Self::INLINE],
    len: usize,
    spilled: Vec<(u32, f32)>,
}

impl Stack {
    const INLINE: usize = 64;

    #[inline(always)]
    pub(super) fn new() -> Self {
        Self { inline: [(0, 0.0); Self::INLINE], len: 0, spilled: Vec::new() }
    }

    #[inline(always)]
    pub(super) fn push(&mut self, entry: (u32, f32)) {
        if self.len < Self::INLINE {
            self.inline[self.len] = entry;
            self.len += 1;
        } else {
            self.spilled.push(entry);
        }
    }

    #[inline(always)]
    pub(super) fn pop(&mut self) -> Option<(u32, f32)> {
        if self.len == Self::INLINE
            && let Some(entry) = self.spilled.pop()
        {
            return Some(entry);
        }
        self.len = self.len.checked_sub(1)?;
        Some(self.inline[self.len])
    }
}

#[cfg(test)]
mod tests {
    use super::Stack;

    #[test]
    fn deep_stacks_spill_and_come_back_in_order() {
        let mut stack = Stack::new();
        for round in 0..3_u32 {
            for i in 0..200 {
                stack.push((i, (i + round) as f32));
            }
            for i in (0..200).rev() {
                assert_eq!(stack.pop(), Some((i, (i + round) as f32)));
            }
            assert_eq!(stack.pop(), None);
        }
    }
}
