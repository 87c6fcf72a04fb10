//! What a picture keeps on a device: the mesh, the layers of the picture, and the gradients.
//!
//! Vectors of three numbers are packed (`array<f32>` in WGSL, 3 per row), those of four are `array<vec4<f32>>`. Sizes are
//! capacities: a picture of at most that many samples, whose size follows from the parameters of its kernels.

use crate::antialias::Topology;
use crate::deferred::Passes;
use crate::rasterize::NONE;
use crate::rasterize::gpu::BinBuffers;
use photofit_gpu::{Buffer, Gpu, GpuError, fixed_words};
use photofit_shading::Sides;
use photofit_texture::AlphaMode;

/// How a triangle is drawn: `array<vec2<u32>>` in WGSL, the cutoff by its bits.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct TriangleSurface {
    /// Bits 0 and 1: 0 opaque, 1 mask, 2 blend. Bit 2: both sides are drawn.
    pub flags: u32,
    /// Alpha from which a mask is drawn.
    pub cutoff: f32,
}

impl TriangleSurface {
    /// Bit of [`Self::flags`]: both sides are drawn.
    pub const BOTH_SIDES: u32 = 4;

    /// The surface of a triangle.
    pub fn new(alpha: AlphaMode, sides: Sides) -> Self {
        let cutoff = if let AlphaMode::Mask { cutoff } = alpha { cutoff } else { 0.0 };
        Self { flags: alpha.code() | if sides == Sides::Both { Self::BOTH_SIDES } else { 0 }, cutoff }
    }
}

/// Some alpha of the mode of another one.
fn of_mode(alpha: &[AlphaMode], wanted: AlphaMode) -> Option<AlphaMode> {
    alpha.iter().copied().find(|a| a.code() == wanted.code())
}

/// A mesh: what [`crate::deferred::Geometry`] is on the CPU.
#[derive(Clone, Debug)]
pub struct MeshBuffers {
    /// World positions `[V]`.
    pub positions: Buffer<[f32; 3]>,
    /// Vertex normals `[V]`.
    pub normals: Buffer<[f32; 3]>,
    /// Tangents with handedness `[V]`.
    pub tangents: Buffer<[f32; 4]>,
    /// Texture coordinates `[V]`.
    pub uvs: Buffer<[f32; 2]>,
    /// Vertex indices `[T]`.
    pub triangles: Buffer<[u32; 3]>,
    /// For edge k (from corner k to corner k+1) the vertex opposite to it in the triangle across, or [`NONE`] `[T]`.
    pub opposite: Buffer<[u32; 3]>,
    /// For edge k the triangle across, or [`NONE`] `[T]`.
    pub neighbour: Buffer<[u32; 3]>,
    /// How each triangle is drawn `[T]`.
    pub surfaces: Buffer<TriangleSurface>,
    /// What alpha means for some triangle.
    modes: Vec<AlphaMode>,
}

impl MeshBuffers {
    /// Uploads the topology; positions, normals and tangents are zero until they are written. `alpha` and `sides` as in
    /// [`crate::deferred::Geometry`]: empty, or one per triangle.
    ///
    /// # Errors
    /// If the device cannot hold a buffer.
    ///
    /// # Panics
    /// If an index is out of range or the lengths disagree.
    pub fn new(
        gpu: &Gpu,
        uvs: &[[f32; 2]],
        topology: &Topology<'_>,
        alpha: &[AlphaMode],
        sides: &[Sides],
    ) -> Result<Self, GpuError> {
        let (vertices, triangles) = (uvs.len(), topology.triangles.len());
        let below =
            |rows: &[[u32; 3]], n: usize| rows.iter().flatten().all(|i| *i == NONE || (*i as usize) < n);
        assert!(
            topology.triangles.iter().flatten().all(|i| (*i as usize) < vertices),
            "corners are vertices"
        );
        assert!(below(topology.opposite, vertices), "opposite corners are vertices");
        assert!(below(topology.neighbour, triangles), "neighbours are triangles");
        for n in [topology.opposite.len(), topology.neighbour.len()] {
            assert_eq!(n, triangles, "one row of topology per triangle");
        }
        assert!(alpha.is_empty() || alpha.len() == triangles, "one alpha mode per triangle");
        assert!(sides.is_empty() || sides.len() == triangles, "one entry of sides per triangle");
        let surface = |t: usize| {
            let sides = sides.get(t).copied().unwrap_or(Sides::Both);
            TriangleSurface::new(alpha.get(t).copied().unwrap_or_default(), sides)
        };
        let surfaces: Vec<_> = (0..triangles).map(surface).collect();
        Ok(Self {
            positions: gpu.zeros("positions", vertices)?,
            normals: gpu.zeros("normals", vertices)?,
            tangents: gpu.zeros("tangents", vertices)?,
            uvs: gpu.upload("uvs", uvs)?,
            triangles: gpu.upload("triangles", topology.triangles)?,
            opposite: gpu.upload("opposite", topology.opposite)?,
            neighbour: gpu.upload("neighbour", topology.neighbour)?,
            surfaces: gpu.upload("surfaces", &surfaces)?,
            modes: [AlphaMode::Blend, AlphaMode::Mask { cutoff: 0.0 }]
                .into_iter()
                .filter_map(|mode| of_mode(alpha, mode))
                .collect(),
        })
    }

    /// A mesh at these positions for pictures without gradients, whose shading brings what it reads besides: normals, tangents,
    /// texture coordinates and neighbours have no room. `sides` as in [`crate::deferred::Geometry`].
    ///
    /// # Errors
    /// If the device cannot hold a buffer.
    ///
    /// # Panics
    /// If an index is out of range or the lengths disagree.
    pub fn drawn(
        gpu: &Gpu,
        positions: &[[f32; 3]],
        triangles: &[[u32; 3]],
        sides: &[Sides],
    ) -> Result<Self, GpuError> {
        let inside = |i: &u32| (*i as usize) < positions.len();
        assert!(triangles.iter().flatten().all(inside), "corners are vertices");
        assert!(sides.is_empty() || sides.len() == triangles.len(), "one entry of sides per triangle");
        let surface =
            |t: usize| TriangleSurface::new(AlphaMode::Opaque, sides.get(t).copied().unwrap_or(Sides::Both));
        let surfaces: Vec<_> = (0..triangles.len()).map(surface).collect();
        Ok(Self {
            positions: gpu.upload("positions", positions)?,
            normals: gpu.zeros("normals", 0)?,
            tangents: gpu.zeros("tangents", 0)?,
            uvs: gpu.zeros("texture coordinates", 0)?,
            triangles: gpu.upload("triangles", triangles)?,
            opposite: gpu.zeros("opposite", 0)?,
            neighbour: gpu.zeros("neighbour", 0)?,
            surfaces: gpu.upload("surfaces", &surfaces)?,
            modes: Vec::new(),
        })
    }

    /// Most layers that a picture has: one of an opaque mesh.
    pub fn layers(&self, passes: &Passes) -> usize {
        if self.modes.is_empty() { 1 } else { passes.max_layers.max(1) }
    }

    /// Whether some alpha has a gradient.
    pub fn fits_alpha(&self, passes: &Passes) -> bool {
        passes.fits_alpha() && self.modes.iter().any(|a| passes.masks.fades(*a))
    }

    /// Vertices.
    pub fn vertices(&self) -> usize {
        self.positions.len()
    }

    /// Triangles.
    pub fn triangles(&self) -> usize {
        self.triangles.len()
    }
}

/// One depth layer; all arrays have an entry per sample, row-major, row 0 at the top.
#[derive(Clone, Debug)]
pub struct LayerBuffers {
    /// Index of the visible triangle, or [`NONE`].
    pub triangle: Buffer<u32>,
    /// z/w in [0, 1], 1 for the background.
    pub depth: Buffer<f32>,
    /// Silhouettes to the right (even) and below (odd), two per sample: `3 triangle + edge`, with the highest bit set
    /// where the other sample is the closer one; [`NONE`] without a silhouette.
    pub pairs: Buffer<u32>,
    /// Radiance and drawn alpha of the layer's fragments: written by shading; read only where there is a triangle.
    pub shaded: Buffer<[f32; 4]>,
    /// This layer over those behind it, before antialiasing.
    pub blended: Buffer<[f32; 4]>,
    /// What lies behind the layer; not written for the last one, behind which is the background.
    pub behind: Buffer<[f32; 4]>,
}

impl LayerBuffers {
    /// Room for `samples`; without `antialias` and `blend` for a single layer whose silhouettes are not blended.
    fn new(gpu: &Gpu, samples: usize, antialias: bool, blend: bool) -> Result<Self, GpuError> {
        let some = |needed: bool, n: usize| if needed { n } else { 0 };
        Ok(Self {
            triangle: gpu.zeros("triangle", samples)?,
            depth: gpu.zeros("depth", samples)?,
            pairs: gpu.zeros("pairs", some(antialias, 2 * samples))?,
            shaded: gpu.zeros("shaded", samples)?,
            blended: gpu.zeros("blended", some(antialias, samples))?,
            behind: gpu.zeros("behind", some(blend, samples))?,
        })
    }
}

/// A picture.
#[derive(Clone, Debug)]
pub struct PictureBuffers {
    /// Clip-space positions `[V]`.
    pub clip: Buffer<[f32; 4]>,
    /// Where triangles may be seen.
    pub bins: BinBuffers,
    /// For each triangle a bit for each of its edges that is a silhouette `[T]`.
    pub folds: Buffer<u32>,
    /// Layers, front first.
    pub layers: Vec<LayerBuffers>,
    /// Radiance behind the mesh, one per pixel; the fourth number is not read.
    pub background: Buffer<[f32; 4]>,
    /// The finished samples, where a pixel has several.
    pub samples: Buffer<[f32; 4]>,
    /// Radiance and coverage, one per pixel.
    pub color: Buffer<[f32; 4]>,
    /// Ids of the layer in front that do not hide what lies behind.
    pub front: Buffer<u32>,
    /// For each layer whether it is drawn, and an entry more that is zero: layers that nothing lets see are skipped.
    pub live: Buffer<u32>,
}

impl PictureBuffers {
    /// Room for a picture of at most `samples` samples and `pixels` pixels of a mesh.
    ///
    /// # Errors
    /// If the device cannot hold a buffer.
    pub fn new(
        gpu: &Gpu,
        mesh: &MeshBuffers,
        samples: usize,
        pixels: usize,
        layers: usize,
        antialias: bool,
    ) -> Result<Self, GpuError> {
        let layers = layers.max(1);
        let layer = |l| LayerBuffers::new(gpu, samples, antialias, l + 1 < layers);
        Ok(Self {
            clip: gpu.zeros("clip", mesh.vertices())?,
            bins: BinBuffers::new(gpu, mesh.triangles(), layers)?,
            folds: gpu.zeros("folds", if antialias { mesh.triangles() } else { 0 })?,
            layers: (0..layers).map(layer).collect::<Result<_, _>>()?,
            background: gpu.zeros("background", pixels)?,
            samples: gpu.zeros("samples", if samples > pixels { samples } else { 0 })?,
            color: gpu.zeros("color", pixels)?,
            front: gpu.zeros("front", if layers > 1 { samples } else { 0 })?,
            live: gpu.zeros("live", layers + 1)?,
        })
    }
}

impl PictureBuffers {
    /// Room for pictures without gradients ([`super::draw`]) of at most `samples` samples of a mesh, in the places of `pixels` pixels.
    /// All layers share the buffers of two.
    ///
    /// # Errors
    /// If the device cannot hold a buffer.
    pub fn drawn(
        gpu: &Gpu,
        mesh: &MeshBuffers,
        samples: usize,
        pixels: usize,
        layers: usize,
    ) -> Result<Self, GpuError> {
        let layers = layers.max(1);
        let mut pair = vec![LayerBuffers::new(gpu, samples, false, false)?];
        if layers > 1 {
            let (triangle, depth) = (gpu.zeros("triangle", samples)?, gpu.zeros("depth", samples)?);
            pair.push(LayerBuffers { triangle, depth, ..pair[0].clone() });
        }
        Ok(Self {
            clip: gpu.zeros("clip", mesh.vertices())?,
            bins: BinBuffers::new(gpu, mesh.triangles(), layers)?,
            folds: gpu.zeros("folds", 0)?,
            layers: pair.into_iter().cycle().take(layers).collect(),
            background: gpu.zeros("background", 0)?,
            samples: gpu.zeros("samples", samples)?,
            color: gpu.zeros("color", pixels)?,
            front: gpu.zeros("front", if layers > 1 { samples } else { 0 })?,
            live: gpu.zeros("live", layers + 1)?,
        })
    }

    /// Bytes of [`Self::drawn`] that a sample takes.
    pub fn bytes_of_sample(layers: usize) -> usize {
        // Triangle, depth, fragment and what was laid so far; a second triangle and depth, and what lies in front.
        if layers > 1 { 52 } else { 40 }
    }
}

/// Sums of a vertex in [`GradientBuffers::sums`].
pub const VERTEX_SUMS: usize = 13;

/// Which sum of a vertex means what: sum `c` of vertex `v` has the number `VERTEX_SUMS * v + c`.
pub mod vertex_sum {
    /// Clip-space position: x, y, z, w.
    pub const CLIP: usize = 0;
    /// World position, without its influence on the clip-space position.
    pub const POSITION: usize = 4;
    /// Normal.
    pub const NORMAL: usize = 7;
    /// Tangent (xyz).
    pub const TANGENT: usize = 10;
}

/// Gradients of a picture and of what it is made from.
#[derive(Clone, Debug)]
pub struct GradientBuffers {
    /// Of the pixels: what the reverse pass starts from.
    pub color: Buffer<[f32; 4]>,
    /// Of the samples, in front of the layer at work and behind it, in turns.
    pub samples: [Buffer<[f32; 4]>; 2],
    /// Of the fragments of the layer at work; zero without a fragment.
    pub shaded: Buffer<[f32; 4]>,
    /// Fixed-point sums of one picture ([`photofit_gpu::FIXED`]), [`VERTEX_SUMS`] per vertex (see [`vertex_sum`]).
    pub sums: Buffer<u32>,
    /// One word: not zero once, in some picture, a term was not finite or terms were too many
    /// ([`photofit_gpu::FIXED_LOST`]), or a term counted as its limit ([`photofit_gpu::FIXED_LIMITED`]).
    pub status: Buffer<u32>,
    /// Of the world positions, without their influence on normals and tangents; accumulated over pictures `[V]`.
    pub positions: Buffer<[f32; 3]>,
    /// Of the vertex normals; accumulated `[V]`.
    pub normals: Buffer<[f32; 3]>,
    /// Of the tangents (xyz); accumulated `[V]`.
    pub tangents: Buffer<[f32; 3]>,
}

impl GradientBuffers {
    /// Zero gradients for pictures of at most `samples` samples and `pixels` pixels of a mesh.
    ///
    /// # Errors
    /// If the device cannot hold a buffer.
    pub fn new(gpu: &Gpu, mesh: &MeshBuffers, samples: usize, pixels: usize) -> Result<Self, GpuError> {
        let vertices = mesh.vertices();
        Ok(Self {
            color: gpu.zeros("gradient of color", pixels)?,
            samples: [gpu.zeros("gradient of samples", samples)?, gpu.zeros("gradient of samples", samples)?],
            shaded: gpu.zeros("gradient of shaded", samples)?,
            sums: gpu.zeros("sums of vertices", fixed_words(VERTEX_SUMS * vertices))?,
            status: gpu.zeros("status of sums", 1)?,
            positions: gpu.zeros("gradient of positions", vertices)?,
            normals: gpu.zeros("gradient of normals", vertices)?,
            tangents: gpu.zeros("gradient of tangents", vertices)?,
        })
    }
}
