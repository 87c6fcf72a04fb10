//! Shading of a fitted mesh's layers on a device: the twin of the per-pixel stages, per sample or once per pixel.
//!
//! The reverse pass recomputes the forward one. Texel gradients are fixed-point sums per channel with a gradient, those of
//! vertices fixed-point sums to which a workgroup adds what neighbours of one triangle have summed: the same bits in
//! every run.

use super::{Masks, Passes, View};
use crate::gpu::{GradientBuffers, LayerBuffers, MeshBuffers, PictureBuffers, Shading, ShadingVjp, Work};
use crate::rasterize::PixelGrid;
use crate::rasterize::gpu::BARYCENTRICS;
use photofit_gpu::{
    Bind, Buffer, FIXED, Gpu, GpuError, INDEX, Kernel, Recorder, Recording, Slot, Z_CURVE, fixed_adding,
};
use photofit_shading::gpu::{Lights, ShadingTables};
use photofit_shading::{Energy, Environment};
use photofit_texture::gpu::{LOOKUP, MipBuffers, MipTable, SCATTER};

/// Vectors of a triangle in the buffer that pixels read.
const CORNERS: usize = 13;

/// A kernel over the pixels of a layer. What it computes of energy and gradients is constant in its source: code that is not
/// needed takes no registers.
macro_rules! layer_kernel {
    ($name:literal, $entry:literal, $compensated:literal, $positions:literal, $maps:literal) => {
        Kernel {
            name: $name,
            source: &[
                INDEX,
                Z_CURVE,
                photofit_scalar::WGSL,
                FIXED,
                fixed_adding!("add_vertex", "vertex_term", "vertex_sums"),
                LOOKUP,
                SCATTER,
                photofit_shading::gpu::WGSL,
                BARYCENTRICS,
                concat!(
                    "const COMPENSATED: bool = ",
                    $compensated,
                    "; const POSITION_GRADIENTS: bool = ",
                    $positions,
                    "; const MAP_GRADIENTS: bool = ",
                    $maps,
                    ";"
                ),
                include_str!("pixel.wgsl"),
                include_str!("shade.wgsl"),
            ],
            entry: $entry,
        }
    };
}

const LOAD_CORNERS: Kernel =
    Kernel { name: "load_corners", source: &[INDEX, include_str!("corners.wgsl")], entry: "load_corners" };
/// Forward, under single scattering and compensated.
const SHADE: [Kernel; 2] = [
    layer_kernel!("shade_layer", "shade_layer", false, false, false),
    layer_kernel!("shade_layer, compensated", "shade_layer", true, false, false),
];
/// The adjoint for gradients of positions and maps.
const SHADE_VJP: [Kernel; 2] = [
    layer_kernel!("shade_layer_vjp", "shade_layer_vjp", false, true, true),
    layer_kernel!("shade_layer_vjp, compensated", "shade_layer_vjp", true, true, true),
];
/// The adjoint for gradients of positions alone.
const SHADE_VJP_POSITIONS: [Kernel; 2] = [
    layer_kernel!("shade_layer_vjp of positions", "shade_layer_vjp", false, true, false),
    layer_kernel!("shade_layer_vjp of positions, compensated", "shade_layer_vjp", true, true, false),
];
/// The adjoint for gradients of maps alone.
const SHADE_VJP_MAPS: [Kernel; 2] = [
    layer_kernel!("shade_layer_vjp of maps", "shade_layer_vjp", false, false, true),
    layer_kernel!("shade_layer_vjp of maps, compensated", "shade_layer_vjp", true, false, true),
];

/// The kernels of this module.
pub(crate) const KERNELS: [Kernel; 9] = [
    LOAD_CORNERS,
    SHADE[0],
    SHADE[1],
    SHADE_VJP[0],
    SHADE_VJP[1],
    SHADE_VJP_POSITIONS[0],
    SHADE_VJP_POSITIONS[1],
    SHADE_VJP_MAPS[0],
    SHADE_VJP_MAPS[1],
];

/// Parameters of the shading of a picture.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct ShadeParams {
    maps: MipTable,
    lights: Lights,
    eye: [f32; 3],
    lod_bias: f32,
    grid: [f32; 2],
    footprint: [f32; 2],
    width: u32,
    height: u32,
    side: u32,
    flags: u32,
    slope: f32,
    scale: f32,
    pad: [u32; 2],
}

/// The maps of a mesh and the lights on it: gives layers their colours, and takes their gradients.
#[derive(Debug)]
pub struct MapShading {
    /// The maps.
    pub maps: MipBuffers,
    /// Tables and environments.
    pub tables: ShadingTables,
    corners: Buffer<[u32; 4]>,
    forward: Kernel,
    /// None where nothing gets gradients.
    adjoint: Option<Kernel>,
    params: ShadeParams,
    slots: ShadeSlots,
}

/// The kernels of one picture's shading in a recording.
#[derive(Clone, Debug, Default)]
pub struct ShadeSlots(Vec<Slot>);

impl ShadeSlots {
    /// Sets the parameters of the shading for the next run. The size of the picture must not exceed the one that was
    /// recorded.
    pub fn set(&self, recording: &mut Recording, params: &ShadeParams) {
        self.0.iter().for_each(|slot| recording.set(*slot, params));
    }
}

impl MapShading {
    /// For meshes of at most `triangles` triangles, with the gradients and the energy that `passes` ask for.
    ///
    /// # Errors
    /// If the device cannot hold what is kept of each.
    pub fn new(
        gpu: &Gpu,
        maps: MipBuffers,
        tables: ShadingTables,
        triangles: usize,
        passes: &Passes,
    ) -> Result<Self, GpuError> {
        let corners = gpu.zeros("corners", CORNERS * triangles)?;
        // Of an empty picture.
        let params = ShadeParams { side: 1, ..bytemuck::Zeroable::zeroed() };
        let energy = usize::from(passes.energy == Energy::Compensated);
        let adjoint = match (passes.position_gradients, passes.map_gradients) {
            (true, true) => Some(SHADE_VJP[energy]),
            (true, false) => Some(SHADE_VJP_POSITIONS[energy]),
            (false, true) => Some(SHADE_VJP_MAPS[energy]),
            (false, false) => None,
        };
        Ok(Self {
            maps,
            tables,
            corners,
            forward: SHADE[energy],
            adjoint,
            params,
            slots: ShadeSlots::default(),
        })
    }

    /// The parameters of a picture; `passes` as in [`Self::new`], but for masks, alpha, emission and the normal map. `scales` are those of
    /// the sums of vertices and of texels, `number` tells which of the uploaded
    /// environments a map is.
    ///
    /// # Panics
    /// If there are more lights than [`photofit_shading::gpu::LIGHTS_MAX`], or the samples do not fill whole pixels.
    pub fn params(
        &self,
        view: &View<'_, f32>,
        passes: &Passes,
        [vertices, texels]: [f32; 2],
        number: impl Fn(&Environment<f32>) -> usize,
    ) -> ShadeParams {
        let side = if view.shade_per_pixel { view.samples.max(1) } else { 1 };
        assert!(view.width.is_multiple_of(side) && view.height.is_multiple_of(side), "whole pixels");
        let of = |g: PixelGrid<f32>| [g.sx, g.sy];
        let (faded, slope) = match passes.masks {
            Masks::Cut => (false, 0.0),
            Masks::Faded { slope } => (true, slope),
        };
        let flags = [passes.normal_map, passes.emissive, passes.alpha_gradients, faded];
        ShadeParams {
            maps: self.maps.table(texels),
            lights: self.tables.lights(view.lights, number),
            eye: [view.eye.x, view.eye.y, view.eye.z],
            lod_bias: view.lod_bias,
            grid: of(PixelGrid::new(view.width, view.height)),
            footprint: of(PixelGrid::new(view.width / side, view.height / side)),
            width: view.width as u32,
            height: view.height as u32,
            side: side as u32,
            flags: flags.iter().enumerate().map(|(k, on)| u32::from(*on) << k).sum(),
            slope,
            scale: vertices,
            pad: [0; 2],
        }
    }

    /// Sets the parameters that the next kernels are recorded with.
    pub fn set(&mut self, params: &ShadeParams) {
        self.params = *params;
    }

    /// The kernels recorded since the last call.
    pub fn take_slots(&mut self) -> ShadeSlots {
        std::mem::take(&mut self.slots)
    }

    /// Gathers what pixels read of the triangles.
    fn load(&self, r: &mut Recorder, mesh: &MeshBuffers, picture: &PictureBuffers) -> Result<(), GpuError> {
        let triangles = mesh.triangles();
        assert!(CORNERS * triangles <= self.corners.len(), "room for all triangles");
        let buffers = [
            mesh.triangles.bind(),
            mesh.surfaces.bind(),
            picture.clip.bind(),
            mesh.positions.bind(),
            mesh.normals.bind(),
            mesh.tangents.bind(),
            mesh.uvs.bind(),
            self.corners.bind(),
        ];
        r.dispatch(&LOAD_CORNERS, &[triangles as u32, 0, 0, 0], &buffers, triangles).map(|_| ())
    }

    fn shared(&self, layer: &LayerBuffers) -> [Bind; 4] {
        [layer.triangle.bind(), self.corners.bind(), self.maps.texels.bind(), self.tables.buffer.bind()]
    }
}

impl Shading for MapShading {
    fn record(
        &mut self,
        r: &mut Recorder,
        mesh: &MeshBuffers,
        picture: &PictureBuffers,
        layer: &LayerBuffers,
        work: Work<'_>,
    ) -> Result<(), GpuError> {
        self.load(r, mesh, picture)?;
        let [triangle, corners, texels, tables] = self.shared(layer);
        let buffers = [triangle, corners, texels, tables, layer.shaded.bind()];
        self.slots.0.push(work.dispatch(r, &self.forward, &self.params, &buffers)?);
        Ok(())
    }
}

impl ShadingVjp for MapShading {
    fn record_vjp(
        &mut self,
        r: &mut Recorder,
        mesh: &MeshBuffers,
        picture: &PictureBuffers,
        layer: &LayerBuffers,
        g: &GradientBuffers,
        work: Work<'_>,
    ) -> Result<(), GpuError> {
        let Some(adjoint) = &self.adjoint else { return Ok(()) };
        self.load(r, mesh, picture)?;
        let [triangle, corners, texels, tables] = self.shared(layer);
        let gradients = [g.shaded.bind(), self.maps.sums.bind(), g.sums.bind()];
        let buffers = [&[triangle, corners, texels, tables], &gradients[..]].concat();
        self.slots.0.push(work.dispatch(r, adjoint, &self.params, &buffers)?);
        Ok(())
    }
}

#[cfg(test)]
mod tests;
