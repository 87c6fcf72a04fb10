//! Buffers of nodes and packets, which rays read in no order: in huge pages where they are large, because with small
//! pages most reads miss the translation buffer. Closest hits of bounce rays in a million triangles take .6 of the time.

use bytemuck::Pod;
use rayon::prelude::*;
#[cfg(target_os = "linux")]
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};

/// Bytes from which on huge pages are asked for: a few of them.
#[cfg(target_os = "linux")]
const LARGE: usize = 8 << 20;
/// Least number of rows that a thread takes at once.
const CHUNK: usize = 1 << 10;

/// A buffer of fixed length.
#[derive(Debug)]
pub(super) struct Buffer<T> {
    memory: Memory<T>,
}

#[derive(Debug)]
enum Memory<T> {
    Heap(Vec<T>),
    #[cfg(target_os = "linux")]
    Pages {
        map: memmap2::MmapMut,
        rows: PhantomData<T>,
    },
}

impl<T: Pod + Send + Sync> Buffer<T> {
    /// A buffer of `count` rows that `row` makes.
    pub(super) fn from_fn(count: usize, row: impl Fn(usize) -> T + Sync + Send) -> Self {
        if let Some(mut buffer) = Self::pages(count) {
            buffer.par_iter_mut().with_min_len(CHUNK).enumerate().for_each(|(i, r)| *r = row(i));
            return buffer;
        }
        Self { memory: Memory::Heap((0..count).into_par_iter().with_min_len(CHUNK).map(row).collect()) }
    }

    /// A buffer of `count` rows of zeros.
    pub(super) fn zeroed(count: usize) -> Self {
        Self::pages(count).unwrap_or_else(|| Self { memory: Memory::Heap(vec![T::zeroed(); count]) })
    }

    /// Rows of zeros in huge pages, if the buffer is large.
    #[cfg(target_os = "linux")]
    fn pages(count: usize) -> Option<Self> {
        let bytes = count * size_of::<T>();
        let map = if bytes >= LARGE { memmap2::MmapMut::map_anon(bytes).ok()? } else { return None };
        // Where the system has no huge pages, small ones serve.
        let _ = map.advise(memmap2::Advice::HugePage);
        Some(Self { memory: Memory::Pages { map, rows: PhantomData } })
    }

    #[cfg(not(target_os = "linux"))]
    fn pages(_: usize) -> Option<Self> {
        None
    }
}

impl<T> Default for Buffer<T> {
    fn default() -> Self {
        Self { memory: Memory::Heap(Vec::new()) }
    }
}

impl<T: Pod> Deref for Buffer<T> {
    type Target = [T];

    #[inline(always)]
    fn deref(&self) -> &[T] {
        match &self.memory {
            Memory::Heap(rows) => rows,
            #[cfg(target_os = "linux")]
            Memory::Pages { map, .. } => bytemuck::cast_slice(map),
        }
    }
}

impl<T: Pod> DerefMut for Buffer<T> {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [T] {
        match &mut self.memory {
            Memory::Heap(rows) => rows,
            #[cfg(target_os = "linux")]
            Memory::Pages { map, .. } => bytemuck::cast_slice_mut(map),
        }
    }
}

impl<T: Pod + Send + Sync> Clone for Buffer<T> {
    fn clone(&self) -> Self {
        Self::from_fn(self.len(), |i| self[i])
    }
}

#[cfg(test)]
mod tests {
    use super::Buffer;

    #[test]
    fn small_and_large_buffers_hold_their_rows() {
        for count in [0_usize, 1, 1000, (16 << 20) / 16 + 3] {
            let buffer = Buffer::from_fn(count, |i| [i as u64, !(i as u64)]);
            let again = buffer.clone();
            drop(buffer);
            assert_eq!(again.len(), count);
            assert!(again.iter().enumerate().all(|(i, r)| *r == [i as u64, !(i as u64)]));
            let mut zeros = Buffer::<[u64; 2]>::zeroed(count);
            zeros.iter_mut().skip(1).for_each(|r| r[0] = 1);
            assert_eq!(zeros.iter().map(|r| r[0] + r[1]).sum::<u64>(), count.saturating_sub(1) as u64);
        }
    }
}
