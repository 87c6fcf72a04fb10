//! Pictures of whole scenes on a device: the twin of [`super::SceneRenderer`].
//!
//! Geometry, materials and textures are uploaded once. The buffers of a picture are shared by its layers and its bands of rows,
//! and kept for the next picture of about the same size: a picture is one submission and one readback. In how many bands a
//! picture is drawn depends on its size and the limits of the device alone, and so do its bits.

use crate::engine::gpu::{Skies, projection_of_rows};
use crate::engine::reference::ENERGY;
use crate::engine::views::ViewLights;
use photofit_gpu::{Buffer, Gpu, GpuError, INDEX, Kernel, Recorder, Recording, Slot, Z_CURVE};
use photofit_image::Image;
use photofit_raster::deferred::{MOST_LAYERS, Passes};
use photofit_raster::gpu::{
    FrameParams, LayerBuffers, MeshBuffers, PictureBuffers, Shading, Shot, Slots, Work, draw,
};
use photofit_raster::project::matrix_rows;
use photofit_raster::rasterize::PixelGrid;
use photofit_raster::rasterize::gpu::BARYCENTRICS;
use photofit_raster::texture::gpu::STORED;
use photofit_scalar::Vec2f;
use photofit_scene::gpu::{SURFACE, SurfaceBuffers};
use photofit_scene::{Camera, FlatScene, SurfaceLibrary};
use photofit_shading::Energy;
use photofit_shading::gpu::{LIGHTS_MAX, Lights, ShadingTables};
use std::ops::Range;

/// What the CPU does with light that single scattering loses, too.
const COMPENSATED: &str = match ENERGY {
    Energy::Single => "const COMPENSATED: bool = false;",
    Energy::Compensated => "const COMPENSATED: bool = true;",
};
/// The samples of a layer.
pub(crate) const SHADE: Kernel = Kernel {
    name: "fit.shade_fragments",
    source: &[
        INDEX,
        Z_CURVE,
        photofit_scalar::WGSL,
        STORED,
        SURFACE,
        photofit_shading::gpu::WGSL,
        BARYCENTRICS,
        COMPENSATED,
        include_str!("gpu/fragments.wgsl"),
    ],
    entry: "shade_fragments",
};

/// Bytes of device memory that the samples of a picture may take; of larger ones bands of rows are drawn, one after the other
/// in the same buffers.
const BYTES_MAX: usize = 1 << 29;
/// Samples of an axis that kernels number.
const AXIS_MAX: usize = 0xffff;

/// As `fragments.wgsl` has it.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
struct Params {
    lights: Lights,
    eye: [f32; 3],
    stride: u32,
    grid: [f32; 2],
    width: u32,
    height: u32,
    tangent: u32,
    uvs: u32,
    color: u32,
    pad: u32,
}

/// A picture that is asked for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PictureRequest<'a> {
    pub(crate) camera: &'a Camera,
    pub(crate) lights: &'a ViewLights,
    /// Columns and rows of pixels, at least one of each.
    pub(crate) size: [usize; 2],
    /// Samples per axis of a pixel.
    pub(crate) samples: usize,
    /// Backs of single-sided surfaces are drawn, too.
    pub(crate) backs: bool,
}

/// What the vectors of a vertex are, as in [`Params`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Layout {
    stride: u32,
    tangent: u32,
    uvs: u32,
    color: u32,
}

/// A scene on a device, and the room for its pictures.
#[derive(Debug)]
pub(crate) struct DeviceScene {
    scene: Uploaded,
    skies: Skies,
    stage: Option<Stage>,
    /// Most bands of a picture so far.
    most: usize,
}

/// What stays from picture to picture.
#[derive(Debug)]
struct Uploaded {
    gpu: Gpu,
    mesh: MeshBuffers,
    vertices: Buffer<[f32; 4]>,
    material_of: Buffer<u32>,
    surfaces: SurfaceBuffers,
    layout: Layout,
    /// Most layers of a picture.
    layers: usize,
}

/// Buffers and kernels for pictures of some size.
#[derive(Debug)]
struct Stage {
    size: [usize; 2],
    samples: usize,
    picture: PictureBuffers,
    recording: Recording,
    /// The kernels of each band.
    bands: Vec<(Slots, Vec<Slot>)>,
}

impl DeviceScene {
    /// Uploads a flattened scene with its materials.
    ///
    /// # Errors
    /// If the device cannot hold it.
    pub(crate) fn new(gpu: &Gpu, flat: &FlatScene, library: &SurfaceLibrary) -> Result<Self, GpuError> {
        Ok(Self { scene: Uploaded::new(gpu, flat, library)?, skies: Skies::new(gpu)?, stage: None, most: 1 })
    }

    /// Why a device cannot draw a picture, whatever it has room for: by the picture and the limits alone.
    pub(crate) fn refused(gpu: &Gpu, asked: &PictureRequest<'_>) -> Option<String> {
        let [w, h] = asked.size;
        let axis = w.max(h) * asked.samples;
        if axis > AXIS_MAX {
            return Some(format!("{axis} samples along an axis are more than {AXIS_MAX}"));
        }
        let lights = asked.lights.lights();
        let ambient = |l: &&photofit_shading::Light<'_>| matches!(l, photofit_shading::Light::Ambient { .. });
        let count = lights.len() - lights.iter().filter(ambient).count();
        if count > LIGHTS_MAX {
            return Some(format!("{count} lights that are not ambient are more than {LIGHTS_MAX}"));
        }
        // The finished pixels lie in one buffer, and no band is less than a row.
        let binding = gpu.report().largest_binding;
        let [pixels, row] = [w * h, w * asked.samples.pow(2)].map(|n| (n * size_of::<[f32; 4]>()) as u64);
        let (what, bytes) = if row > pixels { ("the samples of a row", row) } else { ("its pixels", pixels) };
        (bytes > binding).then(|| {
            format!("a picture of {w} x {h} pixels is more than a kernel binds: {what} take {bytes} of {binding} bytes")
        })
    }

    /// Bytes that a picture takes besides the asset.
    pub(crate) fn bytes(&self, asked: &PictureRequest<'_>) -> usize {
        let [w, h] = asked.size;
        let band = w * h.div_ceil(self.scene.bands(asked)) * asked.samples.pow(2);
        band * PictureBuffers::bytes_of_sample(self.scene.layers) + w * h * size_of::<[f32; 4]>()
    }

    /// Linear, premultiplied RGBA of a picture that is not [`Self::refused`]: what [`super::SceneRenderer::render`] draws.
    ///
    /// # Errors
    /// If the device has no room, refuses a command or is lost; what the picture took is given back then.
    pub(crate) fn draw(&mut self, asked: &PictureRequest<'_>) -> Result<Image, GpuError> {
        let Self { scene, skies, stage, most } = self;
        let bands = scene.bands(asked);
        if !stage.as_ref().is_some_and(|s| s.serves(asked, bands)) {
            *stage = None;
        }
        if skies.add(&scene.gpu, [asked.lights]).inspect_err(|_| *stage = None)? {
            *stage = None;
        }
        let stage = match stage {
            Some(stage) => stage,
            None => stage.insert(Stage::new(scene, skies, asked, bands)?),
        };
        *most = bands.max(*most);
        let [width, height] = asked.size;
        stage.aim(scene, skies, asked);
        stage.recording.run()?;
        let mut color = scene.gpu.read(&stage.picture.color)?;
        color.truncate(width * height);
        Ok(Image::from_data(width, height, 4, color.into_flattened()))
    }

    /// Gives back the buffers of pictures; whether there were any.
    pub(crate) fn give_back(&mut self) -> bool {
        self.stage.take().is_some()
    }

    /// Most bands that a picture was drawn in.
    pub(crate) fn bands(&self) -> usize {
        self.most
    }
}

impl Uploaded {
    fn new(gpu: &Gpu, flat: &FlatScene, library: &SurfaceLibrary) -> Result<Self, GpuError> {
        let mut seen: Vec<u32> = flat.triangle_material.clone();
        seen.sort_unstable();
        seen.dedup();
        let some = |is: &dyn Fn(usize) -> bool| seen.iter().any(|m| is(*m as usize));
        let mesh = &flat.mesh;
        let mut stride = 2;
        let mut place = |there: bool| {
            let at = if there { stride } else { 0 };
            stride += u32::from(there);
            at
        };
        let tangent = place(!mesh.tangents.is_empty() && some(&|m| library.has_normal_map(m)));
        let has_uvs = !(mesh.uvs.is_empty() && mesh.uvs1.is_empty());
        let uvs = place(has_uvs && some(&|m| !library.is_constant(m)));
        let color = place(!mesh.colors.is_empty());
        let layout = Layout { stride, tangent, uvs, color };
        let sides: Vec<_> = flat.triangle_material.iter().map(|m| library.sides(*m as usize)).collect();
        let material_of: Vec<u32> =
            flat.triangle_material.iter().map(|m| SurfaceBuffers::place(*m as usize)).collect();
        let positions: &[[f32; 3]] = bytemuck::cast_slice(&mesh.positions);
        // Refused before vertices are put together.
        let vertices = gpu.zeros("vertices", stride as usize * mesh.positions.len())?;
        gpu.write(&vertices, &vectors(flat, layout))?;
        Ok(Self {
            gpu: gpu.clone(),
            mesh: MeshBuffers::drawn(gpu, positions, &mesh.triangles, &sides)?,
            vertices,
            material_of: gpu.upload("materials of triangles", &material_of)?,
            surfaces: SurfaceBuffers::new(gpu, library)?,
            layout,
            layers: if some(&|m| !library.is_opaque(m)) { MOST_LAYERS } else { 1 },
        })
    }

    /// In how many bands a picture is drawn: as few as its samples may be bound and take bytes in.
    fn bands(&self, asked: &PictureRequest<'_>) -> usize {
        let [width, height] = asked.size;
        let binding = usize::try_from(self.gpu.report().largest_binding).unwrap_or(usize::MAX);
        let samples =
            (binding / size_of::<[f32; 4]>()).min(BYTES_MAX / PictureBuffers::bytes_of_sample(self.layers));
        let rows = samples / (width * asked.samples.pow(2));
        height.div_ceil(rows.clamp(1, height))
    }

    /// Parameters of the kernels of some rows of a picture, but for those of shading.
    fn frame(&self, asked: &PictureRequest<'_>, rows: &Range<usize>) -> FrameParams {
        let [width, height] = asked.size;
        let whole = matrix_rows(&asked.camera.view_projection());
        let shot = Shot {
            view_projection: projection_of_rows(whole, rows, height),
            width: width * asked.samples,
            height: rows.len() * asked.samples,
            samples: asked.samples,
            // Nothing is summed.
            scale: 1.0,
        };
        let (vertices, triangles) = (self.mesh.vertices(), self.mesh.triangles());
        FrameParams {
            backs: u32::from(asked.backs),
            first: (rows.start * width) as u32,
            ..FrameParams::new(&shot, vertices, triangles, &Passes::default(), false)
        }
    }

    fn shading(&self, frame: &FrameParams, asked: &PictureRequest<'_>, lights: Lights) -> Params {
        let (eye, Layout { stride, tangent, uvs, color }) = (asked.camera.eye, self.layout);
        let FrameParams { width, height, .. } = *frame;
        let grid = PixelGrid::<f32>::new(width as usize, height as usize);
        let grid = [grid.sx, grid.sy];
        Params { lights, eye: eye.to_array(), stride, grid, width, height, tangent, uvs, color, pad: 0 }
    }
}

/// The vectors of all vertices.
fn vectors(flat: &FlatScene, layout: Layout) -> Vec<[f32; 4]> {
    let mesh = &flat.mesh;
    let mut out = Vec::with_capacity(layout.stride as usize * mesh.positions.len());
    let uv = |set: &[Vec2f], i: usize| if set.is_empty() { [0.0; 2] } else { set[i].to_array() };
    for (i, (p, n)) in mesh.positions.iter().zip(&mesh.normals).enumerate() {
        let tangent = if layout.tangent > 0 { mesh.tangents[i].to_array() } else { [0.0, 0.0, 0.0, 1.0] };
        out.push([p.x, p.y, p.z, tangent[3]]);
        out.push([n.x, n.y, n.z, 0.0]);
        if layout.tangent > 0 {
            out.push(tangent);
        }
        if layout.uvs > 0 {
            let ([a, b], [c, d]) = (uv(&mesh.uvs, i), uv(&mesh.uvs1, i));
            out.push([a, b, c, d]);
        }
        if layout.color > 0 {
            out.push(mesh.colors[i].to_array());
        }
    }
    out
}

/// The rows of a band of a picture of `height` rows.
fn rows(band: usize, bands: usize, height: usize) -> Range<usize> {
    band * height / bands..(band + 1) * height / bands
}

impl Stage {
    fn new(
        scene: &Uploaded,
        skies: &Skies,
        asked: &PictureRequest<'_>,
        bands: usize,
    ) -> Result<Self, GpuError> {
        let Uploaded { gpu, mesh, layers, .. } = scene;
        let ([width, height], samples) = (asked.size, asked.samples);
        let most = 0..height.div_ceil(bands);
        let of_band = width * most.len() * samples.pow(2);
        let picture = PictureBuffers::drawn(gpu, mesh, of_band, width * height, *layers)?;
        let frame = scene.frame(asked, &most);
        let params = scene.shading(&frame, asked, Lights::default());
        let mut r = gpu.record("picture of the reference");
        let mut recorded = Vec::with_capacity(bands);
        for _ in 0..bands {
            let mut fragments = Fragments { scene, tables: &skies.tables, params, slots: Vec::new() };
            let slots = draw(&mut r, mesh, &picture, &frame, &mut fragments)?;
            recorded.push((slots, fragments.slots));
        }
        Ok(Self { size: asked.size, samples, recording: r.finish()?, picture, bands: recorded })
    }

    /// Whether it has room for a picture, and not much more, and draws it in so many bands.
    fn serves(&self, asked: &PictureRequest<'_>, bands: usize) -> bool {
        let ([w, h], [width, height]) = (asked.size, self.size);
        self.samples == asked.samples
            && w <= width
            && h <= height
            && bands == self.bands.len()
            && 2 * w * h > width * height
    }

    /// Sets the parameters of a picture for the next run.
    fn aim(&mut self, scene: &Uploaded, skies: &Skies, asked: &PictureRequest<'_>) {
        let lights = skies.tables.lights(&asked.lights.lights(), |map| skies.number(map));
        let count = self.bands.len();
        for (k, (slots, shading)) in self.bands.iter().enumerate() {
            let frame = scene.frame(asked, &rows(k, count, asked.size[1]));
            slots.set(&mut self.recording, &frame);
            let params = scene.shading(&frame, asked, lights);
            shading.iter().for_each(|slot| self.recording.set(*slot, &params));
        }
    }
}

/// Gives the samples of a scene their colours, while a picture is recorded.
struct Fragments<'a> {
    scene: &'a Uploaded,
    tables: &'a ShadingTables,
    params: Params,
    slots: Vec<Slot>,
}

impl Shading for Fragments<'_> {
    fn record(
        &mut self,
        r: &mut Recorder,
        mesh: &MeshBuffers,
        picture: &PictureBuffers,
        layer: &LayerBuffers,
        work: Work<'_>,
    ) -> Result<(), GpuError> {
        let s = self.scene;
        let buffers = [
            layer.triangle.bind(),
            mesh.triangles.bind(),
            s.material_of.bind(),
            picture.clip.bind(),
            s.vertices.bind(),
            s.surfaces.materials.bind(),
            s.surfaces.textures.words.bind(),
            self.tables.buffer.bind(),
            layer.shaded.bind(),
        ];
        self.slots.push(work.dispatch(r, &SHADE, &self.params, &buffers)?);
        Ok(())
    }
}

#[cfg(test)]
mod tests;
#[cfg(test)]
mod tolerances;
