//! Compressed sparse rows: lists of indices per item, and sparse matrices.

use photofit_scalar::{Real, Vec3};
use rayon::prelude::*;

/// Rows of indices, stored one after the other.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Csr {
    /// Start of each row in [`Self::items`], and the total length as last entry; length rows + 1.
    pub offsets: Vec<u32>,
    /// The rows' entries.
    pub items: Vec<u32>,
}

impl Csr {
    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.offsets.len().saturating_sub(1)
    }

    /// The entries of row `i`.
    #[inline(always)]
    pub fn row(&self, i: usize) -> &[u32] {
        &self.items[self.offsets[i] as usize..self.offsets[i + 1] as usize]
    }

    /// Groups positions by key: row `r` lists, in ascending order, every `i` with `keys[i] == r` (counting sort,
    /// linear time).
    ///
    /// # Panics
    /// When a key is not below `rows`, or when there are 2^32 keys or more.
    pub fn group(rows: usize, keys: impl Iterator<Item = u32> + Clone) -> Self {
        let mut offsets = vec![0_u32; rows + 1];
        let mut total = 0_u64;
        for key in keys.clone() {
            offsets[key as usize + 1] += 1;
            total += 1;
        }
        assert!(total <= u64::from(u32::MAX), "row entries are counted in 32 bits");
        for i in 0..rows {
            offsets[i + 1] += offsets[i];
        }
        let mut next = offsets.clone();
        let mut items = vec![0_u32; total as usize];
        for (i, key) in keys.enumerate() {
            let slot = &mut next[key as usize];
            items[*slot as usize] = i as u32;
            *slot += 1;
        }
        Self { offsets, items }
    }
}

/// A sparse square matrix in compressed sparse rows; columns ascend within a row.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CsrMatrix<T> {
    /// Start of each row, and the number of stored entries as last entry; length rows + 1.
    pub offsets: Vec<u32>,
    /// Column of each stored entry.
    pub columns: Vec<u32>,
    /// Value of each stored entry.
    pub values: Vec<T>,
}

impl<T: Real> CsrMatrix<T> {
    /// Number of rows (and columns).
    pub fn rows(&self) -> usize {
        self.offsets.len().saturating_sub(1)
    }

    /// `(column, value)` of the stored entries of row `i`.
    #[inline]
    pub fn row(&self, i: usize) -> impl Iterator<Item = (usize, T)> + '_ {
        let range = self.offsets[i] as usize..self.offsets[i + 1] as usize;
        self.columns[range.clone()].iter().map(|&c| c as usize).zip(self.values[range].iter().copied())
    }

    /// `A x` for one 3-vector per row.
    ///
    /// # Panics
    /// When `x` does not have one entry per row.
    pub fn mul(&self, x: &[Vec3<T>]) -> Vec<Vec3<T>> {
        assert_eq!(x.len(), self.rows(), "one vector per row");
        (0..x.len())
            .into_par_iter()
            .with_min_len(2048)
            .map(|i| self.row(i).fold(Vec3::zero(), |s, (j, a)| s + x[j] * a))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grouping_keeps_the_order() {
        let csr = Csr::group(4, [2_u32, 0, 2, 3, 0].into_iter());
        assert_eq!(csr.rows(), 4);
        assert_eq!(
            (0..4).map(|i| csr.row(i).to_vec()).collect::<Vec<_>>(),
            [vec![1, 4], vec![], vec![0, 2], vec![3]]
        );
    }
}
