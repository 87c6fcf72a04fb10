//! Forward rendering of whole scenes with their own materials: supersampled, with depth peeling where something is
//! transparent. This is the reference renderer of a fit, and `photofit render`.

mod fragments;
#[cfg(feature = "gpu")]
pub(crate) mod gpu;

use crate::progress::{Progress, Silent};
use fragments::{Corners, Fragments, MOST};
use photofit_image::Image;
use photofit_raster::deferred::{LEAST_TRANSMITTANCE, MOST_LAYERS};
use photofit_raster::project::{matrix_rows, project};
use photofit_raster::rasterize::{Bins, Layer, NONE, PixelGrid, TILE, Tile};
use photofit_scalar::{Vec3f, Vec4f, vec3};
use photofit_scene::{Camera, FlatScene, SurfaceLibrary};
use photofit_shading::{Light, Sides};
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};

const AREA: usize = TILE * TILE;

/// A scene ready to be rendered.
#[derive(Clone, Debug)]
pub struct SceneRenderer<'a> {
    flat: &'a FlatScene,
    library: &'a SurfaceLibrary,
    /// What is drawn of each triangle; both sides where nothing is said.
    sides: Vec<Sides>,
    opaque: bool,
}

impl<'a> SceneRenderer<'a> {
    /// A renderer for a flattened scene and its materials.
    pub fn new(flat: &'a FlatScene, library: &'a SurfaceLibrary) -> Self {
        let mut seen: Vec<u32> = flat.triangle_material.clone();
        seen.sort_unstable();
        seen.dedup();
        let sides = flat.triangle_material.iter().map(|m| library.sides(*m as usize)).collect();
        Self { flat, library, sides, opaque: seen.iter().all(|m| library.is_opaque(*m as usize)) }
    }

    /// The same with the backs of single-sided materials, as renderers draw them that know no sides.
    #[must_use]
    pub fn with_backs(self) -> Self {
        Self { sides: Vec::new(), ..self }
    }

    /// Renders linear, premultiplied RGBA of `width` x `height` pixels, each the average of `supersample`^2 samples
    /// (1, 2, 4 or 8 per axis) that all are shaded. The backs of single-sided materials are not drawn ([`Sides`]), unless
    /// [`Self::with_backs`] asks for them.
    ///
    /// # Panics
    /// If `supersample` is none of 1, 2, 4, 8, or the scene has an index out of range.
    pub fn render(
        &self,
        camera: &Camera,
        lights: &[Light<'_, f32>],
        width: usize,
        height: usize,
        supersample: usize,
    ) -> Image {
        self.render_with(camera, lights, (width, height), supersample, &Silent)
    }

    /// [`Self::render`] that tells the rows of tiles that are done (stage `render`).
    ///
    /// # Panics
    /// As [`Self::render`].
    pub fn render_with(
        &self,
        camera: &Camera,
        lights: &[Light<'_, f32>],
        (width, height): (usize, usize),
        supersample: usize,
        progress: &dyn Progress,
    ) -> Image {
        assert!([1, 2, 4, 8].contains(&supersample), "1, 2, 4 or 8 samples per axis");
        let (w, h) = (width * supersample, height * supersample);
        let mesh = &self.flat.mesh;
        let mut clip = vec![Vec4f::zero(); mesh.positions.len()];
        project(&matrix_rows(&camera.view_projection()), &mesh.positions, &mut clip);
        let bins = Bins::new(&clip, &mesh.triangles, &self.sides, w, h);
        let eye = vec3(camera.eye.x, camera.eye.y, camera.eye.z);
        let grid = PixelGrid::new(w, h);
        let mut image = Image::new(width, height, 4);
        let strip = (width * 4 * TILE / supersample).max(1);
        let (done, strips) = (Mutex::new(0), image.data.len().div_ceil(strip) as u64);
        image.data.par_chunks_mut(strip).enumerate().for_each(|(row, out)| {
            let mut work = TileWork::default();
            for column in 0..bins.columns() {
                let tile = bins.tile(column, row);
                if tile.is_empty() {
                    continue;
                }
                let shading = Shading { renderer: self, clip: &clip, eye, lights, grid: &grid };
                shading.tile(&tile, &mut work);
                resolve(&work, &tile, supersample, width, out);
            }
            let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
            *done += 1;
            progress.report("render", *done, strips, "");
        });
        image
    }
}

/// Buffers of a tile.
struct TileWork {
    layer: Layer,
    front: Layer,
    rgb: [Vec3f; AREA],
    transmittance: [f32; AREA],
    /// The covered samples of a layer: `triangle << 32 | place`, sorted.
    keys: Vec<u64>,
    fragments: Fragments,
}

impl TileWork {
    /// Lists the covered samples of the layer, those of a triangle one after the other.
    fn collect(&mut self, tile: &Tile<'_>) {
        self.keys.clear();
        for y in 0..tile.height {
            let row = &self.layer.triangle[y * TILE..][..tile.width];
            let covered = row.iter().enumerate().filter(|(_, id)| **id != NONE);
            self.keys.extend(covered.map(|(x, id)| u64::from(*id) << 32 | (y * TILE + x) as u64));
        }
        self.keys.sort_unstable();
    }
}

impl Default for TileWork {
    fn default() -> Self {
        Self {
            layer: Layer::default(),
            front: Layer::default(),
            rgb: [Vec3f::default(); AREA],
            transmittance: [1.0; AREA],
            keys: Vec::with_capacity(AREA),
            fragments: Fragments::default(),
        }
    }
}

/// Averages a tile's samples into the rows of its strip.
fn resolve(work: &TileWork, tile: &Tile<'_>, supersample: usize, width: usize, out: &mut [f32]) {
    let share = 1.0 / (supersample * supersample) as f32;
    for y in 0..tile.height {
        for x in 0..tile.width {
            let i = y * TILE + x;
            let at = ((y / supersample) * width + (tile.x + x) / supersample) * 4;
            let c = work.rgb[i];
            for (o, v) in out[at..at + 4].iter_mut().zip([c.x, c.y, c.z, 1.0 - work.transmittance[i]]) {
                *o += v * share;
            }
        }
    }
}

struct Shading<'a> {
    renderer: &'a SceneRenderer<'a>,
    clip: &'a [Vec4f],
    eye: Vec3f,
    lights: &'a [Light<'a, f32>],
    grid: &'a PixelGrid<f32>,
}

impl Shading<'_> {
    /// Shades all layers of a tile, front to back.
    fn tile(&self, tile: &Tile<'_>, work: &mut TileWork) {
        #[cfg(target_arch = "x86_64")]
        if photofit_raster::has_avx2() {
            #[expect(unsafe_code, reason = "calling a function compiled for AVX2 and FMA")]
            // SAFETY: both features were just detected.
            return unsafe { self.tile_avx2(tile, work) };
        }
        self.tile_any(tile, work);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma")]
    fn tile_avx2(&self, tile: &Tile<'_>, work: &mut TileWork) {
        self.tile_any(tile, work);
    }

    #[inline(always)]
    fn tile_any(&self, tile: &Tile<'_>, work: &mut TileWork) {
        let flat = self.renderer.flat;
        work.rgb.fill(Vec3f::default());
        work.transmittance.fill(1.0);
        for layer in 0..MOST_LAYERS {
            let front = (layer > 0).then_some(&work.front);
            tile.rasterize(self.clip, &flat.mesh.triangles, front, &mut work.layer);
            work.collect(tile);
            let mut more = false;
            let material = |key: &u64| flat.triangle_material[(key >> 32) as usize];
            let keys = std::mem::take(&mut work.keys);
            for same in keys.chunk_by(|a, b| material(a) == material(b)) {
                let material = material(&same[0]) as usize;
                for block in same.chunks(MOST) {
                    more |= self.blend(block, material, (tile.x, tile.y), work);
                }
            }
            work.keys = keys;
            if !more || self.renderer.opaque {
                return;
            }
            std::mem::swap(&mut work.layer, &mut work.front);
        }
    }

    /// Shades samples of one material in the tile whose first sample is `corner`, and puts them behind what was there so
    /// far; true where something may shine through.
    #[inline(always)]
    fn blend(&self, keys: &[u64], material: usize, corner: (usize, usize), work: &mut TileWork) -> bool {
        let fragments = &mut work.fragments;
        fragments.clear();
        for triangle in keys.chunk_by(|a, b| a >> 32 == b >> 32) {
            let corners = Corners::load(self, material, (triangle[0] >> 32) as usize);
            fragments.add(self, &corners, corner, triangle);
        }
        fragments.shade(self, material);
        let mut more = false;
        for (k, key) in keys.iter().enumerate() {
            let i = (key & 0xffff_ffff) as usize;
            let t = work.transmittance[i];
            let (radiance, alpha) = fragments.radiance_alpha(k);
            if alpha > 0.0 {
                work.rgb[i] += radiance * (t * alpha);
            }
            work.transmittance[i] = t * (1.0 - alpha);
            if work.transmittance[i] >= LEAST_TRANSMITTANCE {
                more = true;
            } else {
                work.transmittance[i] = 0.0;
                work.layer.triangle[i] = NONE;
            }
        }
        more
    }
}

#[cfg(test)]
pub(crate) mod tests;
