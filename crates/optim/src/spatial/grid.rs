//! Shapes of regular grids.

/// A regular grid of one, two or three axes; x runs fastest, then y, then z.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    shape: [usize; 3],
}

impl Grid {
    /// `n` sites in a row.
    pub const fn line(n: usize) -> Self {
        Self { shape: [n, 1, 1] }
    }

    /// `width x height` sites; site `(x, y)` is number `y width + x`.
    pub const fn plane(width: usize, height: usize) -> Self {
        Self { shape: [width, height, 1] }
    }

    /// `width x height x depth` sites; site `(x, y, z)` is number `(z height + y) width + x`.
    pub const fn volume(width: usize, height: usize, depth: usize) -> Self {
        Self { shape: [width, height, depth] }
    }

    /// Sites along x, y and z.
    pub const fn shape(&self) -> [usize; 3] {
        self.shape
    }

    /// Number of sites.
    pub const fn sites(&self) -> usize {
        self.shape[0].saturating_mul(self.shape[1]).saturating_mul(self.shape[2])
    }

    /// Distance in the numbering between neighbours along each axis.
    pub(crate) const fn strides(&self) -> [usize; 3] {
        [1, self.shape[0], self.shape[0] * self.shape[1]]
    }
}
