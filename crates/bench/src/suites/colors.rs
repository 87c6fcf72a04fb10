//! Meshes that shine in the colours of a map, without lights, through the pass that the fit renders with: what the
//! benchmarks of silhouettes draw, and the nearest that the product has to the vertex colours of other rasterizers.

use crate::context::Context;
use anyhow::Result;
use photofit_geometry::{Mesh, shapes};
use photofit_raster::antialias::MeshTopology;
use photofit_raster::deferred::{Frame, Geometry, Gradients, Passes, View, render_into, render_vjp};
use photofit_raster::project::{Matrix4, matrix_rows};
use photofit_raster::rasterize::NONE;
use photofit_raster::texture::Pyramid;
use photofit_raster::{CHANNELS, Maps, channel};
use photofit_scalar::{Vec2f, Vec3f, Vec4f, vec2, vec3, vec4};
use photofit_scene::Camera;
use photofit_shading::Sides;
use rayon::prelude::*;

/// Meshes for the comparison with other programs, separated by colons (PLY); procedural ones without it.
const MESHES: &str = "PHOTOFIT_BENCH_MESHES";
/// Texels per side of the map.
const TEXELS: usize = 256;
/// Texture coordinates per length.
const UV_SCALE: f32 = 0.2;

/// What runs where colours are all there is.
pub(crate) const PASSES: Passes = Passes {
    normal_map: false,
    emissive: true,
    antialias: true,
    max_layers: 1,
    masks: photofit_raster::deferred::Masks::Cut,
    position_gradients: true,
    map_gradients: true,
    alpha_gradients: false,
    energy: photofit_shading::Energy::Single,
};

/// The case that other differentiable rasterizers offer too.
pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    let meshes: Vec<Mesh> = match std::env::var(MESHES) {
        Ok(paths) => paths
            .split(':')
            .map(|p| photofit_scene::load(p).map(|s| s.flatten().mesh))
            .collect::<Result<_, _>>()?,
        Err(_) => [16, 71].map(|f| shapes::displaced_sphere(f, 0.12, 6, 7)).to_vec(),
    };
    let camera = Camera::look_at(
        glam::vec3(0.0, 0.0, 3.0),
        glam::Vec3::ZERO,
        glam::Vec3::Y,
        std::f32::consts::FRAC_PI_4,
        1.0,
        0.1,
        10.0,
    );
    let camera = matrix_rows(&camera.view_projection());
    for mesh in meshes {
        let model = Model::new(&mesh);
        for threads in [1_usize, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
            let case = format!("{} tri, 512^2", mesh.triangles.len());
            let (mut frame, mut gradients) = (Frame::default(), model.gradients());
            let mut g = Vec::new();
            pool.install(|| {
                ctx.measure(
                    &format!("both, {threads} thread(s)"),
                    &case,
                    mesh.triangles.len(),
                    || {
                        model.render(&camera, 512, 1, &PASSES, &mut frame);
                        let seed = |c: &[f32; 4]| {
                            [0, 1, 2, 3].map(|k| if k < 3 { 2.0 * (c[k] - 0.25) } else { 0.0 })
                        };
                        frame.color.par_iter().map(seed).collect_into_vec(&mut g);
                        gradients.clear();
                        model.render_vjp(&camera, 512, 1, &frame, &g, &mut gradients);
                        let norm =
                            gradients.positions.iter().map(|g| f64::from(g.length_squared())).sum::<f64>();
                        norm.sqrt()
                    },
                    |positions| vec![("position gradient", *positions)],
                );
            });
        }
    }
    ctx.note("Forward and reverse of positions and of a map of colours with antialiasing, by the pass that the fit renders with: no lights, no normal map.");
    Ok(())
}

/// A mesh with its topology and a map of colours.
pub(crate) struct Model {
    pub(crate) positions: Vec<Vec3f>,
    normals: Vec<Vec3f>,
    tangents: Vec<Vec4f>,
    uvs: Vec<Vec2f>,
    topology: MeshTopology,
    sides: Vec<Sides>,
    maps: Pyramid<f32, CHANNELS>,
}

impl Model {
    pub(crate) fn new(mesh: &Mesh) -> Self {
        let topology = MeshTopology::new(&mesh.triangles, &mesh.positions);
        // The cameras here stand outside.
        let closed = topology.topology().neighbour.as_flattened().iter().all(|t| *t != NONE);
        let n = mesh.positions.len();
        Self {
            positions: mesh.positions.clone(),
            normals: vec![vec3(0.0, 0.0, 1.0); n],
            tangents: vec![vec4(1.0, 0.0, 0.0, 1.0); n],
            uvs: mesh.positions.iter().map(|p| uv_at(*p)).collect(),
            topology,
            sides: vec![Sides::of(!closed); mesh.triangles.len()],
            maps: colors(),
        }
    }

    pub(crate) fn gradients(&self) -> Gradients<f32> {
        Gradients::new(self.positions.len(), &self.maps)
    }

    /// Renders `size` x `size` pixels of `samples` x `samples` over black.
    pub(crate) fn render(
        &self,
        camera: &Matrix4<f32>,
        size: usize,
        samples: usize,
        passes: &Passes,
        frame: &mut Frame<f32>,
    ) {
        let background = vec![[0.0; 3]; size * size];
        render_into(&self.geometry(), &self.maps, &view(camera, size, samples), &background, passes, frame);
    }

    /// Accumulates the gradients for the gradient `g` of the pixels.
    pub(crate) fn render_vjp(
        &self,
        camera: &Matrix4<f32>,
        size: usize,
        samples: usize,
        frame: &Frame<f32>,
        g: &[[f32; 4]],
        out: &mut Gradients<f32>,
    ) {
        render_vjp(&self.geometry(), &self.maps, &view(camera, size, samples), &PASSES, frame, g, out);
    }

    fn geometry(&self) -> Geometry<'_, f32> {
        Geometry {
            positions: &self.positions,
            normals: &self.normals,
            tangents: &self.tangents,
            uvs: &self.uvs,
            topology: self.topology.topology(),
            alpha: &[],
            sides: &self.sides,
        }
    }
}

fn view(camera: &Matrix4<f32>, size: usize, samples: usize) -> View<'static, f32> {
    View {
        view_projection: *camera,
        eye: vec3(0.0, 0.0, 3.0),
        lights: &[],
        width: size * samples,
        height: size * samples,
        samples,
        shade_per_pixel: false,
        lod_bias: 0.0,
    }
}

/// Oblique, so that the front and the back of a body differ.
fn uv_at(p: Vec3f) -> Vec2f {
    vec2(p.x + 0.5 * p.z, 0.4 * p.z - p.y) * UV_SCALE + vec2(0.5, 0.5)
}

/// A map of colours, smooth and within [0.1, 0.9].
fn colors() -> Pyramid<f32, CHANNELS> {
    let texel = |i: usize| {
        let [u, v] = [i % TEXELS, i / TEXELS].map(|x| ((x as f32 + 0.5) / TEXELS as f32 - 0.5) / UV_SCALE);
        let mut t = [0.0; CHANNELS];
        let c = vec3((3.0 * u + 0.4).sin(), (2.0 * v - 0.7).cos(), (2.5 * (u + v)).sin());
        let rgb = (c * 0.4 + Vec3f::splat(0.5)).to_array();
        t[channel::EMISSIVE..channel::EMISSIVE + 3].copy_from_slice(&rgb);
        t[channel::ALPHA] = 1.0;
        t[channel::ROUGHNESS] = 1.0;
        t
    };
    Pyramid::new(Maps { width: TEXELS, height: TEXELS, texels: (0..TEXELS * TEXELS).map(texel).collect() })
}
