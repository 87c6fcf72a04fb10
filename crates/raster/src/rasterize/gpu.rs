//! Rasterization on a device.
//!
//! Small triangles are drawn by one invocation each, larger ones by one workgroup or, tile by tile, by several; the nearest depth and the
//! lowest triangle with it are minima, so that no order matters. Edge functions are evaluated about every pixel centre in
//! `f32`: triangles agree with those of the CPU except where a centre lies on an edge, or two depths are equal, within
//! rounding. Shared edges are watertight, whichever way their triangles are drawn.

use crate::gpu::{FRAME, LayerBuffers, MeshBuffers, PictureBuffers, Steps, Work};
use photofit_gpu::{Buffer, Gpu, GpuError, INDEX, Kernel};

/// Barycentric coordinates, their derivatives and their adjoint in WGSL, for kernels that shade.
pub const BARYCENTRICS: &str = include_str!("barycentric.wgsl");

const TRIANGLE: &str = include_str!("triangle.wgsl");
const BOX: &str = include_str!("box.wgsl");
const DRAW: &[&str] = &[INDEX, FRAME, TRIANGLE, BOX, include_str!("draw.wgsl")];
const LAYER: &[&str] = &[INDEX, FRAME, BOX, include_str!("layer.wgsl")];

/// Boxes of triangles, and lists of the larger ones.
pub(crate) const BIN: Kernel =
    Kernel { name: "bin", source: &[INDEX, FRAME, TRIANGLE, BOX, include_str!("bin.wgsl")], entry: "bin" };
/// An empty layer.
pub(crate) const EMPTY: Kernel = Kernel { name: "empty_layer", source: LAYER, entry: "empty" };
/// The workgroups of a layer's kernels.
pub(crate) const COUNT: Kernel = Kernel { name: "count_groups", source: LAYER, entry: "count_groups" };
/// Small triangles.
pub(crate) const SMALL: Kernel = Kernel { name: "draw_small", source: DRAW, entry: "small" };
/// Medium triangles.
pub(crate) const MEDIUM: Kernel = Kernel { name: "draw_medium", source: DRAW, entry: "medium" };
/// Large triangles.
pub(crate) const LARGE: Kernel = Kernel { name: "draw_large", source: DRAW, entry: "large" };

/// Words of [`BinBuffers::groups`] per layer.
const GROUPS: usize = 12;

/// Where triangles may be seen, and how much work that is.
#[derive(Clone, Debug)]
pub struct BinBuffers {
    /// Box of samples of each triangle: first and last column, first and last row, 16 bits each.
    pub boxes: Buffer<[u32; 2]>,
    /// Triangles of more than a few samples: the numbers of medium and of large ones, and these.
    pub lists: Buffer<u32>,
    /// For each layer the workgroups of kernels over its samples, over all, medium and large triangles.
    pub groups: Buffer<u32>,
}

impl BinBuffers {
    /// Room for a mesh in a picture of some layers.
    ///
    /// # Errors
    /// If the device cannot hold a buffer.
    pub fn new(gpu: &Gpu, triangles: usize, layers: usize) -> Result<Self, GpuError> {
        Ok(Self {
            boxes: gpu.zeros("boxes", triangles)?,
            lists: gpu.zeros("lists of triangles", 2 + 2 * triangles)?,
            groups: gpu.zeros("groups", GROUPS * layers)?,
        })
    }

    /// How a kernel over the samples of a layer is dispatched.
    pub fn samples(&self, layer: usize, samples: usize) -> Work<'_> {
        if layer == 0 { Work::Threads(samples) } else { Work::Groups(&self.groups, GROUPS * layer) }
    }

    fn triangles(&self, layer: usize, triangles: usize) -> Work<'_> {
        if layer == 0 { Work::Threads(triangles) } else { Work::Groups(&self.groups, GROUPS * layer + 3) }
    }

    fn listed(&self, layer: usize, large: bool) -> Work<'_> {
        Work::Groups(&self.groups, GROUPS * layer + if large { 9 } else { 6 })
    }
}

/// Records what all layers share: which samples each triangle may cover.
///
/// # Errors
/// If a dispatch does not fit.
pub fn bin(s: &mut Steps<'_>, mesh: &MeshBuffers, picture: &PictureBuffers) -> Result<(), GpuError> {
    let bins = &picture.bins;
    s.recorder.clear(&bins.lists);
    let buffers = [
        picture.clip.bind(),
        mesh.triangles.bind(),
        mesh.surfaces.bind(),
        bins.boxes.bind(),
        bins.lists.bind(),
    ];
    s.dispatch(&BIN, 0, 0, &buffers, Work::Threads(mesh.triangles()))
}

/// Records [`super::rasterize`] of layer number `layer`, behind the ids in `picture.front` if it is not the first.
///
/// # Errors
/// If a dispatch does not fit.
pub fn rasterize(
    s: &mut Steps<'_>,
    mesh: &MeshBuffers,
    picture: &PictureBuffers,
    layer: usize,
) -> Result<(), GpuError> {
    let (bins, samples) = (&picture.bins, s.samples());
    let LayerBuffers { triangle, depth, .. } = &picture.layers[layer];
    let counted = [bins.lists.bind(), picture.live.bind(), bins.groups.bind()];
    s.dispatch(&COUNT, layer, 0, &counted, Work::Threads(1))?;
    s.dispatch(&EMPTY, layer, 0, &[depth.bind(), triangle.bind()], bins.samples(layer, samples))?;
    let front_depth = match layer {
        // Not read.
        0 => picture.front.bind(),
        _ => picture.layers[layer - 1].depth.bind(),
    };
    let drawn = [
        picture.clip.bind(),
        mesh.triangles.bind(),
        mesh.surfaces.bind(),
        bins.boxes.bind(),
        depth.bind(),
        triangle.bind(),
        picture.front.bind(),
        front_depth,
        bins.lists.bind(),
    ];
    // Depths, then triangles.
    for mode in [0, 1] {
        s.dispatch(&SMALL, layer, mode, &drawn[..8], bins.triangles(layer, mesh.triangles()))?;
        s.dispatch(&MEDIUM, layer, mode, &drawn, bins.listed(layer, false))?;
        s.dispatch(&LARGE, layer, mode, &drawn, bins.listed(layer, true))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests;
