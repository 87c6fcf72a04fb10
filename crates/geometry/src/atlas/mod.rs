//! Texture atlases: charts of bounded stretch, packed without overlap into a square texture.
//!
//! [`unwrap`] cuts a mesh into charts, flattens each and packs them; [`coverage`] says which triangle owns each
//! texel; [`dilate`] fills the texels between the charts, so that filtering and mip levels do not bleed.
//!
//! The uv origin is the upper left, as in glTF. Charts are rotated but never mirrored: seen in the upright image
//! every counter-clockwise triangle stays counter-clockwise, that is, its signed area in `(u, 1 - v)` is positive.
//! Tangent frames made from these uvs (`MikkTSpace` with v up, as glTF asks) therefore have handedness +1 everywhere.
//!
//! ```
//! use photofit_geometry::atlas::{UnwrapOptions, unwrap};
//! use photofit_scalar::vec3;
//! let positions = [vec3(0.0, 0.0, 0.0), vec3(1.0, 0.0, 0.0), vec3(1.0, 1.0, 0.0), vec3(0.0, 1.0, 0.0)];
//! let triangles = [[0, 1, 2], [0, 2, 3]];
//! let atlas = unwrap(&positions, &triangles, &[0, 0], &UnwrapOptions { size: 64, ..UnwrapOptions::default() })?;
//! assert_eq!(atlas.charts, 1);
//! let (mesh, source) = atlas.build_mesh(&positions, &triangles);
//! assert_eq!((mesh.uvs.len(), source.len()), (4, 4));
//! # Ok::<(), photofit_geometry::atlas::AtlasError>(())
//! ```

mod bitmap;
mod chart;
mod cluster;
mod coverage;
mod cut;
mod dilate;
mod flatten;
mod join;
mod layout;
mod linear;
mod overlap;
mod pack;
mod regrow;
mod segment;
mod settle;
mod topology;

#[cfg(test)]
mod tests;

pub use coverage::{Coverage, coverage, mesh_coverage};
pub use dilate::dilate;
pub use layout::{Atlas, Stretch};

use photofit_scalar::Vec3f;
use thiserror::Error;

/// Largest side of an atlas, in texels.
pub const MAX_SIZE: u32 = 16_384;

/// How to unwrap; see [`unwrap`].
#[derive(Clone, Debug, PartialEq)]
pub struct UnwrapOptions {
    /// Side of the square texture, in texels, `1..=`[`MAX_SIZE`].
    pub size: u32,
    /// Free texels between charts and at the border; `None` means `max(2, size / 256)`. Where even the smallest
    /// charts do not fit, it is halved until they do: see [`Atlas::padding`].
    pub padding: Option<u32>,
    /// Largest stretch of a triangle, at least 1.05: both singular values of its map, relative to the density of
    /// its chart, lie in `[1 / max_stretch, max_stretch]`.
    pub max_stretch: f32,
    /// Texel area per surface area wanted for each triangle, relative to the mean (such as a visibility), or empty
    /// for a uniform density. Clamped to `[1/16, 16]` around the mean; averaged over each chart.
    pub importance: Vec<f32>,
}

impl Default for UnwrapOptions {
    fn default() -> Self {
        Self { size: 1024, padding: None, max_stretch: 2.0, importance: Vec::new() }
    }
}

/// Why a mesh could not be unwrapped.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum AtlasError {
    /// A vertex that a triangle uses is not finite.
    #[error("vertex {vertex}: the position is not finite")]
    Position {
        /// Index of the vertex.
        vertex: usize,
    },
    /// A triangle names a vertex that does not exist.
    #[error("triangle {triangle}: vertex {vertex} does not exist")]
    Index {
        /// Index of the triangle.
        triangle: usize,
        /// The index it names.
        vertex: u32,
    },
    /// An array has the wrong length.
    #[error("{name}: {found} entries for {triangles} triangles")]
    Length {
        /// Name of the array.
        name: &'static str,
        /// Its length.
        found: usize,
        /// Number of triangles.
        triangles: usize,
    },
    /// An importance is negative or not finite.
    #[error("triangle {triangle}: the importance must be finite and not negative")]
    Importance {
        /// Index of the triangle.
        triangle: usize,
    },
    /// The size is zero or too large.
    #[error("atlas size {size}: must be from 1 to 16384")]
    Size {
        /// The size asked for.
        size: u32,
    },
    /// The stretch bound is too small or not a number.
    #[error("stretch bound {bound}: must be at least 1.05")]
    StretchBound {
        /// The bound asked for.
        bound: f32,
    },
    /// More charts than texels.
    #[error("{charts} charts do not fit into {size} x {size} texels even without padding")]
    TooManyCharts {
        /// Number of charts.
        charts: usize,
        /// Side of the square.
        size: u32,
    },
}

/// Unwraps a triangle mesh into the unit square.
///
/// `positions`: vertices, any unit; vertices at the same position count as one. `triangles`: vertex indices,
/// counter-clockwise from outside. `group`: one number per triangle; a chart never crosses groups.
///
/// Neighbouring triangles are clustered by their normals, each cluster is flattened as rigidly as possible, and
/// neighbouring charts are joined while the joint map is injective, keeps [`UnwrapOptions::max_stretch`] and packs
/// well. What cannot be flattened is cut, at worst into single triangles, so that every valid mesh has an atlas.
/// Triangles without area share the uvs of a neighbour, or one texel per group. The result is the same for any
/// number of threads.
///
/// # Errors
/// When an index, a position, an array length or an option is invalid, or there are more charts than texels.
pub fn unwrap(
    positions: &[Vec3f],
    triangles: &[[u32; 3]],
    group: &[u32],
    options: &UnwrapOptions,
) -> Result<Atlas, AtlasError> {
    let count = triangles.len();
    if !(1..=MAX_SIZE).contains(&options.size) {
        return Err(AtlasError::Size { size: options.size });
    }
    if options.max_stretch.is_nan() || options.max_stretch < 1.05 {
        return Err(AtlasError::StretchBound { bound: options.max_stretch });
    }
    if group.len() != count {
        return Err(AtlasError::Length { name: "group", found: group.len(), triangles: count });
    }
    let found = options.importance.len();
    if found != 0 && found != count {
        return Err(AtlasError::Length { name: "importance", found, triangles: count });
    }
    if let Some(triangle) = options.importance.iter().position(|w| !(*w >= 0.0 && w.is_finite())) {
        return Err(AtlasError::Importance { triangle });
    }
    let mut topo = topology::Topology::new(positions, triangles, group, vec![1.0; count])?;
    if found != 0 {
        topo.weight = weights(&topo, &options.importance);
    }
    // A little below the bound, so that rounding to single precision keeps it.
    let bound = f64::from(options.max_stretch) * 0.999;
    let charts = segment::charts(&topo, bound);
    layout::lay_out(&topo, charts, group, options)
}

/// Importance relative to its area-weighted mean, clamped.
fn weights(topo: &topology::Topology, importance: &[f32]) -> Vec<f64> {
    let (mut sum, mut area) = (0.0, 0.0);
    for (t, &w) in importance.iter().enumerate() {
        sum += f64::from(w) * topo.area(t as u32);
        area += topo.area(t as u32);
    }
    let mean = if area > 0.0 { sum / area } else { 0.0 };
    let relative = |w: f32| if mean > 0.0 { (f64::from(w) / mean).clamp(1.0 / 16.0, 16.0) } else { 1.0 };
    importance.iter().map(|&w| relative(w)).collect()
}
