//! The memory that maps, textures and grids of fits and drawings take at their peak, estimated before they begin. Geometry
//! and pictures come on top.
//!
//! Texels decide: maps are kept in single precision, sixteen channels each with all mip levels, by every candidate, by the
//! gradients and by the optimizer; textures of assets in bytes, by every renderer. The bytes per texel are those that the peak
//! of the resident set (`peak_rss_mb` in the JSON of `photofit simplify`) grew by from 1024 to 2048 texels a side, rounded up.

use photofit_scene::{Scene, TextureImage};

/// Tasks by what they keep of a texel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Task {
    /// [`crate::simplify`] and [`crate::lod`]: two starts, the fit, the same with maps baked anew.
    Simplify,
    /// The same with mip levels that have texels of their own, each with moments of the optimizer and a best state.
    SimplifyFreeMips,
    /// [`crate::retexture`]: one candidate.
    Retexture,
    /// [`crate::recover`] and [`crate::recover_mesh`].
    Recover,
    /// [`crate::compare`]: no maps.
    Compare,
    /// One picture: no maps.
    Render,
}

impl Task {
    /// Bytes of a texel of the maps that are fitted, and of one of the assets' textures.
    fn bytes_per_texel(self) -> [u64; 2] {
        match self {
            Self::Simplify => [700, 36],
            Self::SimplifyFreeMips => [900, 36],
            Self::Retexture => [380, 36],
            Self::Recover => [460, 36],
            Self::Compare => [0, 20],
            Self::Render => [0, 14],
        }
    }

    /// Bytes of maps of `side` x `side` texels.
    pub fn maps(self, side: usize) -> u64 {
        self.bytes_per_texel()[0].saturating_mul((side as u64).saturating_mul(side as u64))
    }

    /// Bytes of the textures of assets, with mip levels and the copies of what draws them.
    pub fn textures(self, assets: &[&Scene]) -> u64 {
        let images = assets.iter().flat_map(|a| &a.images);
        // 16 bits take three times as much, 8 bytes here and as many where they are looked up.
        let of =
            |i: &TextureImage| (i.width as u64 * i.height as u64) * if i.texels16.is_empty() { 1 } else { 3 };
        let texels: u64 = images.map(of).sum();
        self.bytes_per_texel()[1].saturating_mul(texels)
    }
}

/// Bytes of a grid of [`crate::recover_volume`], by voxel and by value of a voxel that is found, a little above what the peak of the
/// resident set grew by from 96 to 128 voxels a side: 273 and 504 bytes a voxel of four and of seven values.
const VOXEL: u64 = 10;
const VALUE: u64 = 76;

/// Bytes of a grid of so many voxels, of each of which so many values are found. What voxels that pictures touch take while gradients
/// are summed follows from samples instead, and comes on top: some dozens of megabytes.
pub fn grid(voxels: [usize; 3], values: usize) -> u64 {
    let count = voxels.iter().fold(1, |n: u64, side| n.saturating_mul(*side as u64));
    count.saturating_mul(VOXEL + VALUE * values as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_follow_the_texels() {
        assert_eq!(Task::Simplify.maps(1024), 700 << 20);
        assert!(Task::SimplifyFreeMips.maps(1024) > Task::Simplify.maps(1024));
        assert!(Task::Simplify.maps(8192) > 40 << 30 && Task::Retexture.maps(8192) > 20 << 30);
        assert_eq!(Task::Recover.maps(usize::MAX), u64::MAX, "no overflow");
        let image = TextureImage { width: 4096, height: 2048, ..TextureImage::default() };
        let scene = Scene { images: vec![image.clone(), image], ..Scene::default() };
        assert_eq!(Task::Simplify.textures(&[&scene]), 36 * 4096 * 4096);
        assert_eq!(Task::Compare.textures(&[&scene, &scene]), 40 * 4096 * 4096);
        assert_eq!(Task::Render.maps(4096), 0);
        assert_eq!(grid([64, 32, 16], 4), (VOXEL + 4 * VALUE) << 15);
        assert_eq!(grid([usize::MAX; 3], 1), u64::MAX, "no overflow");
    }
}
