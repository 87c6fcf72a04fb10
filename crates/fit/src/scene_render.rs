//! Forward rendering of whole scenes with their own materials: supersampled, with depth peeling where something is
//! transparent. This is the reference renderer of a fit, and `photofit render`.

use crate::engine::reference::ENERGY;
use photofit_image::Image;
use photofit_raster::deferred::MOST_LAYERS;
use photofit_raster::interpolate::{derivatives, interpolate};
use photofit_raster::project::{matrix_rows, project};
use photofit_raster::rasterize::{Bins, Layer, NONE, PixelGrid, TILE, Tile, barycentrics};
use photofit_scalar::{Vec2f, Vec3f, Vec4f, vec2, vec3};
use photofit_scene::{Camera, FlatScene, SurfaceLibrary, UvDerivatives};
use photofit_shading::{Light, Sides, Surface, face_viewer, perturb, shade, view_direction};
use rayon::prelude::*;

/// Transmittance below which nothing behind a pixel is looked for.
const NEGLIGIBLE: f32 = 1.0 / 512.0;
const AREA: usize = TILE * TILE;

/// A scene ready to be rendered.
#[derive(Clone, Debug)]
pub struct SceneRenderer<'a> {
    flat: &'a FlatScene,
    library: &'a SurfaceLibrary,
    /// What is drawn of each triangle.
    sides: Vec<Sides>,
    opaque: bool,
}

/// Derivatives of an attribute along X and along Y.
fn axes(d: [Vec2f; 2]) -> (Vec2f, Vec2f) {
    (vec2(d[0].x, d[1].x), vec2(d[0].y, d[1].y))
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

    /// Renders linear, premultiplied RGBA of `width` x `height` pixels, each the average of `supersample`^2 samples
    /// (1, 2, 4 or 8 per axis) that are shaded one by one. The backs of single-sided materials are not drawn ([`Sides`]).
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
}

impl Default for TileWork {
    fn default() -> Self {
        Self {
            layer: Layer::default(),
            front: Layer::default(),
            rgb: [Vec3f::default(); AREA],
            transmittance: [1.0; AREA],
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
        let triangles = &self.renderer.flat.mesh.triangles;
        work.rgb.fill(Vec3f::default());
        work.transmittance.fill(1.0);
        for layer in 0..MOST_LAYERS {
            let front = (layer > 0).then_some(&work.front);
            tile.rasterize(self.clip, triangles, front, &mut work.layer);
            let mut more = false;
            for y in 0..tile.height {
                for x in 0..tile.width {
                    let i = y * TILE + x;
                    if work.layer.triangle[i] == NONE {
                        continue;
                    }
                    let t = work.transmittance[i];
                    let (radiance, alpha) =
                        self.pixel(work.layer.triangle[i] as usize, tile.x + x, tile.y + y);
                    work.rgb[i] += radiance * (t * alpha);
                    work.transmittance[i] = t * (1.0 - alpha);
                    if work.transmittance[i] > NEGLIGIBLE {
                        more = true;
                    } else {
                        work.transmittance[i] = 0.0;
                        work.layer.triangle[i] = NONE;
                    }
                }
            }
            if !more || self.renderer.opaque {
                return;
            }
            std::mem::swap(&mut work.layer, &mut work.front);
        }
    }

    /// Radiance and alpha of one fragment.
    #[inline(always)]
    fn pixel(&self, triangle: usize, x: usize, y: usize) -> (Vec3f, f32) {
        let (flat, library) = (self.renderer.flat, self.renderer.library);
        let mesh = &flat.mesh;
        let material = flat.triangle_material[triangle] as usize;
        let id = mesh.triangles[triangle].map(|i| i as usize);
        let b = barycentrics(&id.map(|i| self.clip[i]), self.grid.ndc(x, y), self.grid);
        let of3 = |v: &[Vec3f]| {
            let [p, q, r] = id.map(|i| v[i].to_array());
            Vec3f::from_array(interpolate([&p, &q, &r], &b))
        };
        let uv_of = |v: &[Vec2f]| {
            if v.is_empty() || library.is_constant(material) {
                return (Vec2f::zero(), (Vec2f::zero(), Vec2f::zero()));
            }
            let [p, q, r] = id.map(|i| v[i].to_array());
            (Vec2f::from_array(interpolate([&p, &q, &r], &b)), axes(derivatives([&p, &q, &r], &b)))
        };
        let (uv0, (dx0, dy0)) = uv_of(&mesh.uvs);
        let (uv1, (dx1, dy1)) = uv_of(&mesh.uvs1);
        let color = if mesh.colors.is_empty() {
            Vec4f::splat(1.0)
        } else {
            let [p, q, r] = id.map(|i| mesh.colors[i].to_array());
            Vec4f::from_array(interpolate([&p, &q, &r], &b))
        };
        let footprint = UvDerivatives { dx: [dx0, dx1], dy: [dy0, dy1] };
        let s = library.lookup(material, uv0, uv1, color, Some(&footprint));
        if s.alpha <= 0.0 {
            return (Vec3f::zero(), 0.0);
        }
        if s.unlit {
            return (s.base_color, s.alpha);
        }
        let [p0, p1, p2] = id.map(|i| mesh.positions[i]);
        let position = of3(&mesh.positions);
        let mut normal = of3(&mesh.normals);
        if library.has_normal_map(material) && !mesh.tangents.is_empty() {
            let [t0, t1, t2] = id.map(|i| mesh.tangents[i].xyz().to_array());
            let tangent = Vec3f::from_array(interpolate([&t0, &t1, &t2], &b));
            normal = perturb(normal, tangent, mesh.tangents[id[0]].w, s.normal);
        } else {
            normal = normal.normalize_or_zero();
        }
        let wo = view_direction(self.eye, position);
        let n = face_viewer(normal, (p1 - p0).cross(p2 - p0), wo);
        let surface =
            Surface { base_color: s.base_color, roughness: s.roughness, metallic: s.metallic, gamma: 0.0 };
        (shade(&surface, ENERGY, position, n, wo, self.lights) + s.emissive, s.alpha)
    }
}
