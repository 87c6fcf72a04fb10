//! Sizes of the levels of a mip pyramid, and where they lie in memory.

/// Place and size of one level.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Level {
    /// Index of the first texel.
    pub offset: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// What a lookup must know of a pyramid.
pub trait MipSizes {
    /// Number of levels, at least one.
    fn count(&self) -> usize;
    /// Level `k`, the base being 0.
    fn level(&self, k: usize) -> Level;
}

/// Width and height of the next smaller level: halved and rounded down, at least 1.
#[inline]
pub fn mip_size(width: usize, height: usize) -> (usize, usize) {
    ((width / 2).max(1), (height / 2).max(1))
}

/// Number of levels down to 1 x 1, the base included: `floor(log2(max(width, height))) + 1`.
#[inline]
pub fn mip_levels(width: usize, height: usize) -> usize {
    width.max(height).max(1).ilog2() as usize + 1
}

/// Levels that lie one after the other in one array, the base first.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MipLayout(Vec<Level>);

impl MipLayout {
    /// All levels of a texture of `width` x `height` texels.
    ///
    /// # Panics
    /// If a size is 0 or the texels cannot be counted in 32 bits.
    pub fn full(width: usize, height: usize) -> Self {
        Self::new(width, height, mip_levels(width, height))
    }

    /// The base level alone.
    ///
    /// # Panics
    /// As [`Self::full`].
    pub fn base(width: usize, height: usize) -> Self {
        Self::new(width, height, 1)
    }

    /// The first `count` levels, at least the base, at most all.
    ///
    /// # Panics
    /// As [`Self::full`].
    pub fn first(width: usize, height: usize, count: usize) -> Self {
        Self::new(width, height, count.clamp(1, mip_levels(width, height)))
    }

    fn new(width: usize, height: usize, count: usize) -> Self {
        assert!(width > 0 && height > 0, "a texture has at least one texel");
        let (mut size, mut offset) = ((width, height), 0);
        let mut levels = Vec::with_capacity(count);
        for _ in 0..count {
            levels.push(Level { offset: offset as u32, width: size.0 as u32, height: size.1 as u32 });
            offset += size.0 * size.1;
            size = mip_size(size.0, size.1);
        }
        assert!(u32::try_from(offset).is_ok(), "texels are counted in 32 bits");
        Self(levels)
    }

    /// The levels, the base first.
    pub fn levels(&self) -> &[Level] {
        &self.0
    }

    /// Texels of all levels.
    pub fn texels(&self) -> usize {
        self.0.iter().map(|l| l.width as usize * l.height as usize).sum()
    }
}

impl MipSizes for MipLayout {
    #[inline(always)]
    fn count(&self) -> usize {
        self.0.len()
    }
    #[inline(always)]
    fn level(&self, k: usize) -> Level {
        self.0[k]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_lie_one_after_the_other() {
        let layout = MipLayout::full(13, 6);
        let sizes: Vec<_> = layout.levels().iter().map(|l| (l.offset, l.width, l.height)).collect();
        assert_eq!(sizes, [(0, 13, 6), (78, 6, 3), (96, 3, 1), (99, 1, 1)]);
        assert_eq!((layout.texels(), layout.count()), (100, 4));
        assert_eq!(MipLayout::base(13, 6).levels(), &layout.levels()[..1]);
        let some = |count| MipLayout::first(13, 6, count).levels().to_vec();
        assert_eq!([some(0), some(3), some(9)], [1, 3, 4].map(|n| layout.levels()[..n].to_vec()));
        assert_eq!(mip_size(1, 9), (1, 4));
    }
}
