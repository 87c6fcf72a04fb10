//! A vertex-coloured mesh through the differentiable primitives: what the benchmarks of the rasterizer render.

use photofit_geometry::{Edges, Mesh, weld::weld_exact};
use photofit_raster::antialias::{Pair, Topology, antialias, antialias_vjp, silhouettes};
use photofit_raster::interpolate::{interpolate, interpolate_vjp};
use photofit_raster::project::{Matrix4, project, project_vjp};
use photofit_raster::rasterize::{NONE, PixelGrid, Visibility, barycentrics, barycentrics_vjp, rasterize};
use photofit_scalar::{Vec3f, Vec4f, vec3};
use rayon::prelude::*;

/// A mesh with its topology.
pub(crate) struct Model {
    pub(crate) positions: Vec<Vec3f>,
    pub(crate) colors: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
    opposite: Vec<[u32; 3]>,
    neighbour: Vec<[u32; 3]>,
}

/// One picture and what its adjoint needs.
pub(crate) struct Picture {
    pub(crate) color: Vec<[f32; 3]>,
    clip: Vec<Vec4f>,
    visibility: Visibility,
    flat: Vec<[f32; 3]>,
    pairs: Vec<Pair<f32>>,
}

impl Model {
    pub(crate) fn new(mesh: &Mesh, colors: Vec<[f32; 3]>) -> Self {
        let weld = weld_exact(&mesh.positions);
        let edges = Edges::new(&mesh.triangles, &weld);
        Self {
            positions: mesh.positions.clone(),
            colors,
            triangles: mesh.triangles.clone(),
            opposite: edges.opposite_vertices(&mesh.triangles, &weld),
            neighbour: edges.triangle_neighbours(),
        }
    }

    fn topology(&self) -> Topology<'_> {
        Topology { triangles: &self.triangles, opposite: &self.opposite, neighbour: &self.neighbour }
    }

    /// Renders over black.
    pub(crate) fn render(&self, camera: &Matrix4<f32>, size: usize, smooth: bool) -> Picture {
        let mut clip = vec![Vec4f::zero(); self.positions.len()];
        project(camera, &self.positions, &mut clip);
        let visibility = rasterize(&clip, &self.triangles, size, size, None);
        let grid = PixelGrid::new(size, size);
        let mut flat = vec![[0.0; 3]; size * size];
        flat.par_chunks_mut(size.max(1)).enumerate().for_each(|(y, row)| {
            for (x, out) in row.iter_mut().enumerate() {
                let id = visibility.triangle[y * size + x];
                if id != NONE {
                    let t = self.triangles[id as usize].map(|i| i as usize);
                    let b = barycentrics(&t.map(|i| clip[i]), grid.ndc(x, y), &grid);
                    *out = interpolate(t.map(|i| &self.colors[i]), &b);
                }
            }
        });
        let pairs = if smooth { silhouettes(&visibility, &clip, &self.topology()) } else { Vec::new() };
        let mut color = flat.clone();
        antialias(&pairs, &flat, &mut color);
        Picture { color, clip, visibility, flat, pairs }
    }

    /// Gradients of positions and colours.
    pub(crate) fn render_vjp(
        &self,
        camera: &Matrix4<f32>,
        size: usize,
        p: &Picture,
        g: &[[f32; 3]],
    ) -> (Vec<Vec3f>, Vec<[f32; 3]>) {
        let mut g_clip = vec![Vec4f::zero(); self.positions.len()];
        let mut g_colors = vec![[0.0; 3]; self.colors.len()];
        let mut g_flat = g.to_vec();
        antialias_vjp(&p.pairs, &p.clip, (size, size), &p.flat, g, &mut g_flat, &mut g_clip);
        let grid = PixelGrid::new(size, size);
        for (i, id) in p.visibility.triangle.iter().enumerate().filter(|(_, id)| **id != NONE) {
            let t = self.triangles[*id as usize].map(|i| i as usize);
            let (f, corners) = (grid.ndc(i % size, i / size), t.map(|i| p.clip[i]));
            let b = barycentrics(&corners, f, &grid);
            let mut part = [[0.0; 3]; 3];
            let [g0, g1, g2] = &mut part;
            let uv = interpolate_vjp(t.map(|i| &self.colors[i]), &b, &g_flat[i], [g0, g1, g2]);
            let corner = barycentrics_vjp(&corners, f, uv.x, uv.y);
            for k in 0..3 {
                g_clip[t[k]] += corner[k];
                (0..3).for_each(|c| g_colors[t[k]][c] += part[k][c]);
            }
        }
        let mut g_positions = vec![Vec3f::zero(); self.positions.len()];
        project_vjp(camera, &g_clip, &mut g_positions);
        (g_positions, g_colors)
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
