//! Rasterization on a device.
//!
//! Small triangles are drawn by one invocation each, large ones tile by tile from a queue; the nearest depth and the
//! lowest triangle with it are minima, so that no order matters. Edge functions are evaluated about every pixel centre in
//! `f32`: triangles agree with those of the CPU except where a centre lies on an edge, or two depths are equal, within
//! rounding. Shared edges are watertight, whichever way their triangles are drawn.

use crate::gpu::{FRAME, LayerBuffers, MeshBuffers, PictureBuffers, Steps, Work};
use photofit_gpu::{Buffer, Gpu, GpuError, INDEX, Kernel};

const TRIANGLE: &str = include_str!("triangle.wgsl");
const DRAW: &[&str] = &[INDEX, FRAME, TRIANGLE, include_str!("draw.wgsl")];
const LAYER: &[&str] = &[INDEX, FRAME, include_str!("layer.wgsl")];

/// Boxes of triangles, and the queue of the large ones.
pub(crate) const BIN: Kernel =
    Kernel { name: "bin", source: &[INDEX, FRAME, TRIANGLE, include_str!("bin.wgsl")], entry: "bin" };
/// An empty layer.
pub(crate) const EMPTY: Kernel = Kernel { name: "empty_layer", source: LAYER, entry: "empty" };
/// The workgroups of a layer's kernels.
pub(crate) const COUNT: Kernel = Kernel { name: "count_groups", source: LAYER, entry: "count_groups" };
/// Small triangles.
pub(crate) const SMALL: Kernel = Kernel { name: "draw_small", source: DRAW, entry: "small" };
/// Large triangles.
pub(crate) const LARGE: Kernel = Kernel { name: "draw_large", source: DRAW, entry: "large" };

/// Width and height of the tiles of large triangles (`TILE` in the kernels).
const TILE: usize = 16;
/// Pairs in the queue for each tile, and for each triangle up to a number of these. What does not fit is drawn right, but
/// slowly.
const PAIRS_PER_TILE: usize = 8;
const PAIRS_PER_TRIANGLE: usize = 8;
const COUNTED_TRIANGLES: usize = 1 << 17;
/// Words of [`BinBuffers::groups`] per layer.
const GROUPS: usize = 9;

/// Where triangles may be seen, and how much work that is.
#[derive(Clone, Debug)]
pub struct BinBuffers {
    /// Box of samples of each triangle: first and last column, first and last row, 16 bits each.
    pub boxes: Buffer<[u32; 2]>,
    /// Pairs of a large triangle and a tile, behind their number.
    pub queue: Buffer<u32>,
    /// For each layer the workgroups of kernels over its samples, over triangles, and over the queue.
    pub groups: Buffer<u32>,
}

impl BinBuffers {
    /// Room for a mesh in a picture.
    ///
    /// # Errors
    /// If the device cannot hold a buffer.
    pub fn new(gpu: &Gpu, triangles: usize, samples: usize, layers: usize) -> Result<Self, GpuError> {
        // A narrow picture has more tiles than its area says.
        let tiles = samples.div_ceil(TILE * TILE) + samples.div_ceil(TILE);
        let pairs = PAIRS_PER_TILE * tiles + PAIRS_PER_TRIANGLE * triangles.min(COUNTED_TRIANGLES);
        Self::with_capacity(gpu, triangles, layers, pairs)
    }

    /// Room for that many pairs in the queue.
    pub(crate) fn with_capacity(
        gpu: &Gpu,
        triangles: usize,
        layers: usize,
        pairs: usize,
    ) -> Result<Self, GpuError> {
        Ok(Self {
            boxes: gpu.zeros("boxes", triangles)?,
            queue: gpu.zeros("queue", 1 + 2 * pairs)?,
            groups: gpu.zeros("groups", GROUPS * layers)?,
        })
    }

    fn capacity(&self) -> usize {
        self.queue.len() / 2
    }

    /// How a kernel over the samples of a layer is dispatched.
    pub fn samples(&self, layer: usize, samples: usize) -> Work<'_> {
        if layer == 0 { Work::Threads(samples) } else { Work::Groups(&self.groups, GROUPS * layer) }
    }

    fn triangles(&self, layer: usize, triangles: usize) -> Work<'_> {
        if layer == 0 { Work::Threads(triangles) } else { Work::Groups(&self.groups, GROUPS * layer + 3) }
    }

    fn pairs(&self, layer: usize) -> Work<'_> {
        Work::Groups(&self.groups, GROUPS * layer + 6)
    }
}

/// Records what all layers share: which samples each triangle may cover.
///
/// # Errors
/// If a dispatch does not fit.
pub fn bin(s: &mut Steps<'_>, mesh: &MeshBuffers, picture: &PictureBuffers) -> Result<(), GpuError> {
    let bins = &picture.bins;
    s.set_capacity(bins.capacity());
    s.recorder.clear(&bins.queue);
    let buffers = [
        picture.clip.bind(),
        mesh.triangles.bind(),
        mesh.surfaces.bind(),
        bins.boxes.bind(),
        bins.queue.bind(),
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
    let counted = [bins.queue.bind(), picture.live.bind(), bins.groups.bind()];
    s.dispatch(&COUNT, layer, 0, &counted, Work::Threads(1))?;
    s.dispatch(&EMPTY, layer, 0, &[depth.bind(), triangle.bind()], bins.samples(layer, samples))?;
    let front_depth = match layer {
        // Not read.
        0 => picture.front.bind(),
        _ => picture.layers[layer - 1].depth.bind(),
    };
    let buffers = |source| {
        [
            picture.clip.bind(),
            mesh.triangles.bind(),
            mesh.surfaces.bind(),
            source,
            depth.bind(),
            triangle.bind(),
            picture.front.bind(),
            front_depth.clone(),
        ]
    };
    // Depths, then triangles.
    for mode in [0, 1] {
        let work = bins.triangles(layer, mesh.triangles());
        s.dispatch(&SMALL, layer, mode, &buffers(bins.boxes.bind()), work)?;
        s.dispatch(&LARGE, layer, mode, &buffers(bins.queue.bind()), bins.pairs(layer))?;
    }
    Ok(())
}
