//! A vertex-coloured mesh through the differentiable primitives: what the benchmarks of the rasterizer render.

use crate::context::Context;
use anyhow::Result;
use photofit_geometry::{Edges, Mesh, shapes, weld::weld_exact};
use photofit_raster::antialias::{Pair, Topology, antialias, antialias_vjp, silhouettes};
use photofit_raster::interpolate::{Pieces, interpolate_picture, interpolate_picture_vjp};
use photofit_raster::project::{Matrix4, matrix_rows, project, project_vjp};
use photofit_raster::rasterize::{Faces, NONE, Visibility, rasterize_into};
use photofit_scalar::{Vec3f, Vec4f, vec3};
use photofit_scene::Camera;
use rayon::prelude::*;

/// Meshes for the comparison with other programs, separated by colons (PLY); procedural ones without it.
const MESHES: &str = "PHOTOFIT_BENCH_MESHES";

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
        let model = Model::new(&mesh, mesh.positions.iter().map(|p| color_at(*p)).collect());
        for threads in [1_usize, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
            let case = format!("{} tri, 512^2", mesh.triangles.len());
            let mut work = (Picture::default(), Reverse::default());
            pool.install(|| {
                ctx.measure(
                    &format!("both, {threads} thread(s)"),
                    &case,
                    mesh.triangles.len(),
                    || {
                        let (p, r) = &mut work;
                        model.render(&camera, 512, true, p);
                        model.render_vjp(&camera, 512, p, |_, c| c.map(|c| 2.0 * (c - 0.25)), r);
                        let norm = r.positions.iter().map(|g| f64::from(g.length_squared())).sum::<f64>();
                        let colors = r.colors.iter().flatten().map(|c| f64::from(c * c)).sum::<f64>();
                        (norm.sqrt(), colors.sqrt())
                    },
                    |(positions, colors)| {
                        vec![("position gradient", *positions), ("colour gradient", *colors)]
                    },
                );
            });
        }
    }
    ctx.note("Forward and reverse of positions and vertex colours with antialiasing, by the primitives of the rasterizer.");
    Ok(())
}

/// A mesh with its topology.
pub(crate) struct Model {
    pub(crate) positions: Vec<Vec3f>,
    pub(crate) colors: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
    opposite: Vec<[u32; 3]>,
    neighbour: Vec<[u32; 3]>,
    faces: Faces,
}

/// One picture and what its adjoint needs; its memory is used again.
#[derive(Default)]
pub(crate) struct Picture {
    pub(crate) color: Vec<[f32; 3]>,
    clip: Vec<Vec4f>,
    visibility: Visibility,
    flat: Vec<[f32; 3]>,
    pieces: Pieces<f32, 3>,
    pairs: Vec<Pair<f32>>,
}

/// Gradients, and memory of the reverse pass.
#[derive(Default)]
pub(crate) struct Reverse {
    pub(crate) positions: Vec<Vec3f>,
    pub(crate) colors: Vec<[f32; 3]>,
    clip: Vec<Vec4f>,
    pixels: Vec<[f32; 3]>,
}

impl Model {
    pub(crate) fn new(mesh: &Mesh, colors: Vec<[f32; 3]>) -> Self {
        let weld = weld_exact(&mesh.positions);
        let edges = Edges::new(&mesh.triangles, &weld);
        let neighbour = edges.triangle_neighbours();
        // The cameras here stand outside.
        let closed = neighbour.as_flattened().iter().all(|t| *t != NONE);
        Self {
            positions: mesh.positions.clone(),
            colors,
            triangles: mesh.triangles.clone(),
            opposite: edges.opposite_vertices(&mesh.triangles, &weld),
            neighbour,
            faces: if closed { Faces::Front } else { Faces::All },
        }
    }

    fn topology(&self) -> Topology<'_> {
        Topology { triangles: &self.triangles, opposite: &self.opposite, neighbour: &self.neighbour }
    }

    /// Renders over black.
    pub(crate) fn render(&self, camera: &Matrix4<f32>, size: usize, smooth: bool, out: &mut Picture) {
        let Picture { color, clip, visibility, flat, pieces, pairs } = out;
        clip.resize(self.positions.len(), Vec4f::zero());
        project(camera, &self.positions, clip);
        rasterize_into(clip, &self.triangles, size, size, self.faces, None, visibility);
        flat.resize(size * size, [0.0; 3]);
        interpolate_picture(visibility, clip, &self.triangles, &self.colors, pieces, flat);
        *pairs = if smooth { silhouettes(visibility, clip, &self.topology()) } else { Vec::new() };
        color.clone_from(flat);
        antialias(pairs, flat, color);
    }

    /// Gradients of positions and colours for the gradient `g` of the picture.
    pub(crate) fn render_vjp(
        &self,
        camera: &Matrix4<f32>,
        size: usize,
        p: &mut Picture,
        g: impl Fn(usize, [f32; 3]) -> [f32; 3] + Sync,
        out: &mut Reverse,
    ) {
        let Reverse { positions, colors, clip, pixels } = out;
        clip.clear();
        clip.resize(self.positions.len(), Vec4f::zero());
        colors.clear();
        colors.resize(self.colors.len(), [0.0; 3]);
        p.color.par_iter().enumerate().map(|(i, c)| g(i, *c)).collect_into_vec(pixels);
        antialias_vjp(&p.pairs, &p.clip, (size, size), &p.flat, pixels, clip);
        let Picture { visibility, clip: at, pieces, .. } = p;
        interpolate_picture_vjp(visibility, at, &self.triangles, &self.colors, pieces, pixels, clip, colors);
        positions.clear();
        positions.resize(self.positions.len(), Vec3f::zero());
        project_vjp(camera, clip, positions);
    }
}

/// Averages `n` x `n` samples.
pub(crate) fn average(color: &[[f32; 3]], size: usize, n: usize) -> Vec<[f64; 3]> {
    let small = size / n;
    let mut out = vec![[0.0; 3]; small * small];
    for (i, c) in color.iter().enumerate() {
        let o = &mut out[(i / size / n) * small + (i % size) / n];
        (0..3).for_each(|k| o[k] += f64::from(c[k]) / (n * n) as f64);
    }
    out
}

/// A colour from a position, smooth and within [0.1, 0.9].
pub(crate) fn color_at(p: Vec3f) -> [f32; 3] {
    let c = vec3((3.0 * p.x + 0.4).sin(), (2.0 * p.y - 0.7).cos(), (2.5 * p.z + p.x).sin());
    (c * 0.4 + Vec3f::splat(0.5)).to_array()
}
