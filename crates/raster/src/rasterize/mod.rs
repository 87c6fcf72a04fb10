//! Rasterization: which triangle a pixel centre sees, and where on it.
//!
//! Triangles are tested with homogeneous edge functions (Olano and Greer 1997), so nothing is clipped and no crack can
//! open: the edge shared by two triangles has exactly negated coefficients, and a tie belongs to one of them.
//! Only the id and z/w are stored; barycentrics are recomputed from the vertices by [`barycentrics`].

mod barycentric;
mod bins;
#[cfg(feature = "gpu")]
pub mod gpu;
mod tile;
#[cfg(target_arch = "x86_64")]
mod tile_avx2;

pub use barycentric::{Barycentrics, PixelGrid, barycentrics, barycentrics_vjp};
pub use bins::Bins;
pub use tile::{Layer, TILE, Tile};

use photofit_scalar::Vec4f;
use photofit_shading::Sides;
use rayon::prelude::*;

/// The id of a pixel that shows no triangle.
pub const NONE: u32 = u32::MAX;

/// What each pixel sees: triangle ids and depths, row-major, row 0 at the top.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Visibility {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Index of the visible triangle, or [`NONE`].
    pub triangle: Vec<u32>,
    /// z/w in [0, 1], 1 for the background.
    pub depth: Vec<f32>,
}

/// Finds the nearest triangle at every pixel centre.
///
/// `clip` `[V]` are clip-space positions with z in [0, w]; both sides are drawn. With `behind` only
/// fragments strictly behind that layer count (depth peeling, Everitt 2001); of coplanar duplicates the lower index
/// comes first, and none is lost.
///
/// # Panics
/// If an index is out of range, or `behind` has another size.
pub fn rasterize(
    clip: &[Vec4f],
    triangles: &[[u32; 3]],
    width: usize,
    height: usize,
    behind: Option<&Visibility>,
) -> Visibility {
    let mut out = Visibility::default();
    rasterize_into(clip, triangles, &[], width, height, behind, &mut out);
    out
}

/// [`rasterize`] into memory that is used again. `sides` `[T]` says what is drawn of each triangle; empty: both sides.
///
/// # Panics
/// As [`rasterize`], and if `sides` has another length.
pub fn rasterize_into(
    clip: &[Vec4f],
    triangles: &[[u32; 3]],
    sides: &[Sides],
    width: usize,
    height: usize,
    behind: Option<&Visibility>,
    out: &mut Visibility,
) {
    let bins = Bins::new(clip, triangles, sides, width, height);
    (out.width, out.height) = (width, height);
    out.triangle.resize(width * height, NONE);
    out.depth.resize(width * height, 1.0);
    if let Some(b) = behind {
        assert_eq!((b.width, b.height), (width, height), "the layer in front has the same size");
    }
    out.triangle
        .par_chunks_mut(width.max(1) * TILE)
        .zip(out.depth.par_chunks_mut(width.max(1) * TILE))
        .enumerate()
        .for_each(|(row, (ids, depths))| {
            let (mut layer, mut front) = (Layer::default(), Layer::default());
            for column in 0..bins.columns() {
                let tile = bins.tile(column, row);
                if let Some(b) = behind {
                    front.load(
                        &tile,
                        &b.triangle[row * TILE * width..],
                        &b.depth[row * TILE * width..],
                        width,
                    );
                }
                tile.rasterize(clip, triangles, behind.map(|_| &front), &mut layer);
                layer.store(&tile, ids, depths, width);
            }
        });
}

#[cfg(test)]
mod tests;
