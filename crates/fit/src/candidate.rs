//! The asset being fitted: welded vertex positions and material maps, and the chain from them to a loss.
//!
//! The data of a fit goes one way: positions -> normals -> tangents -> rasterize -> shade -> loss; [`Candidate::step`]
//! writes it forward and, reversed line by line, backward.

use crate::views::Shot;
use photofit_geometry::atlas::mesh_coverage;
use photofit_geometry::normals::{Weighting, vertex_normals, vertex_normals_vjp};
use photofit_geometry::tangents::{UvFrames, vertex_tangents, vertex_tangents_vjp};
use photofit_geometry::weld::weld_exact;
use photofit_geometry::{Csr, Edges, Incidence, Mesh, Weld, laplacian};
use photofit_raster::antialias::Topology;
use photofit_raster::deferred::{self, Frame, Geometry, Gradients, Passes, View};
use photofit_raster::loss::{self, Loss};
use photofit_raster::project::matrix_rows;
use photofit_raster::texture::{MipAdjoint, MipRule, Pyramid};
use photofit_raster::{CHANNELS, Maps, channel};
use photofit_scalar::{Vec2f, Vec3f, Vec4f, vec3};
use photofit_scene::AlphaMode;
use rayon::prelude::*;

/// Topology and parameters of a fitted mesh.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// Positions by welded id: the shape's parameters.
    pub positions: Vec<Vec3f>,
    /// The maps with their mip chain: level 0 holds the parameters.
    pub maps: Pyramid<f32, CHANNELS>,
    /// Texture coordinates, one per vertex.
    pub uvs: Vec<Vec2f>,
    /// Vertex indices.
    pub triangles: Vec<[u32; 3]>,
    /// Index of the class of each triangle (see [`Candidate::classes`]).
    pub class: Vec<u32>,
    /// What alpha means in each class.
    pub classes: Vec<AlphaMode>,
    /// Neighbours of each welded vertex.
    pub rings: Csr,
    /// Edges between welded vertices, each once.
    pub edges: Vec<[u32; 2]>,
    alpha: Vec<AlphaMode>,
    /// Texels whose alpha is no parameter; empty = none.
    solid: Vec<bool>,
    /// Vertices to positions.
    weld: Weld,
    /// Vertices to normals.
    smooth: Incidence,
    unique: Incidence,
    frames: UvFrames,
    opposite: Vec<[u32; 3]>,
    neighbour: Vec<[u32; 3]>,
}

/// Vertex arrays that follow from the positions.
#[derive(Clone, Debug)]
pub struct Vertices {
    /// One per vertex.
    pub positions: Vec<Vec3f>,
    /// Smooth unit normals.
    pub normals: Vec<Vec3f>,
    /// Tangents with handedness.
    pub tangents: Vec<Vec4f>,
}

/// Gradients of the parameters, and scratch of the chain.
#[derive(Debug)]
pub struct ParameterGradients {
    /// Of the welded positions.
    pub positions: Vec<Vec3f>,
    /// Of everything the renderer reads; its map gradients, once collapsed, are those of level 0.
    pub rendered: Gradients<f32>,
    /// The picture at work.
    frame: Frame<f32>,
}

impl Candidate {
    /// Prepares the topology of an atlas mesh (`positions`, `uvs`, `triangles`; vertices split only where uvs differ
    /// and at creases). Vertices of one id in `smoothing` share their normal.
    ///
    /// # Panics
    /// If an index is out of range or the arrays disagree in length.
    pub fn new(mesh: &Mesh, smoothing: &Weld, class: Vec<u32>, classes: Vec<AlphaMode>, maps: Maps) -> Self {
        assert_eq!(class.len(), mesh.triangles.len(), "one class per triangle");
        let weld = weld_exact(&mesh.positions);
        let edges = Edges::new(&mesh.triangles, &weld);
        let unique = Incidence::new(&mesh.triangles, &Weld::identity(mesh.positions.len()));
        let frames = UvFrames::new(&unique, &mesh.uvs);
        let transparent = class.iter().any(|c| classes[*c as usize] != AlphaMode::Opaque);
        let alpha = class.iter().filter(|_| transparent).map(|c| classes[*c as usize]).collect();
        let solid = if transparent { solid_texels(mesh, &class, &classes, &maps) } else { Vec::new() };
        Self {
            positions: weld.pick(&mesh.positions),
            maps: Pyramid::with_rule(maps, mip_rule(transparent)),
            uvs: mesh.uvs.clone(),
            triangles: mesh.triangles.clone(),
            class,
            classes,
            rings: edges.one_rings(),
            opposite: edges.opposite_vertices(&mesh.triangles, &weld),
            neighbour: edges.triangle_neighbours(),
            edges: edges.vertices,
            alpha,
            solid,
            smooth: Incidence::new(&mesh.triangles, smoothing),
            weld,
            unique,
            frames,
        }
    }

    /// Whether any triangle may be transparent.
    pub fn is_transparent(&self) -> bool {
        !self.alpha.is_empty()
    }

    /// Replaces the maps (of the same size).
    ///
    /// # Panics
    /// If the size differs.
    pub fn set_maps(&mut self, maps: Maps) {
        let base = &mut self.maps.levels[0];
        assert_eq!((base.width, base.height), (maps.width, maps.height), "maps of the same size");
        *base = maps;
        self.maps.rebuild();
    }

    /// The vertex arrays for the present positions.
    pub fn vertices(&self) -> Vertices {
        let positions = self.weld.expand(&self.positions);
        let normals = vertex_normals(&self.smooth, &positions, Weighting::Angle);
        let tangents = vertex_tangents(&self.unique, &self.frames, &positions, &normals);
        Vertices { positions, normals, tangents }
    }

    /// The mesh as it would be exported.
    pub fn mesh(&self) -> Mesh {
        let v = self.vertices();
        Mesh {
            positions: v.positions,
            normals: v.normals,
            uvs: self.uvs.clone(),
            tangents: v.tangents,
            triangles: self.triangles.clone(),
            ..Mesh::default()
        }
    }

    /// Normals that know no creases, one per vertex: along them a bake leaves no gaps.
    pub fn round_normals(&self) -> Vec<Vec3f> {
        let round = Incidence::new(&self.triangles, &self.weld);
        vertex_normals(&round, &self.weld.expand(&self.positions), Weighting::Angle)
    }

    fn geometry<'a>(&'a self, v: &'a Vertices) -> Geometry<'a, f32> {
        Geometry {
            positions: &v.positions,
            normals: &v.normals,
            tangents: &v.tangents,
            uvs: &self.uvs,
            topology: Topology {
                triangles: &self.triangles,
                opposite: &self.opposite,
                neighbour: &self.neighbour,
            },
            alpha: &self.alpha,
        }
    }

    /// Zero gradients of the right size.
    pub fn gradients(&self) -> ParameterGradients {
        ParameterGradients {
            positions: vec![Vec3f::zero(); self.positions.len()],
            rendered: Gradients::new(self.uvs.len(), &self.maps),
            frame: Frame::default(),
        }
    }

    /// Renders one shot over its background, `samples` times finer per axis than its picture.
    pub fn render(&self, vertices: &Vertices, shot: &Shot, passes: &Passes) -> Frame<f32> {
        let lights = shot.lights.lights();
        let geometry = self.geometry(vertices);
        deferred::render(&geometry, &self.maps, &view(shot, &lights), &shot.background, passes)
    }

    /// Loss of a batch of shots against their references, and its gradients (overwritten). Returns the loss, the mean
    /// over the shots.
    pub fn step(&self, shots: &[Shot], loss: Loss, passes: &Passes, out: &mut ParameterGradients) -> f64 {
        out.positions.fill(Vec3f::zero());
        out.rendered.clear();
        let vertices = self.vertices();
        let mut total = 0.0;
        let weight = 1.0 / shots.len().max(1) as f64;
        for shot in shots {
            let lights = shot.lights.lights();
            let (view, geometry) = (view(shot, &lights), self.geometry(&vertices));
            let frame = &mut out.frame;
            deferred::render_into(&geometry, &self.maps, &view, &shot.background, passes, frame);
            let picture = average(&frame.color, shot);
            let mut g = vec![[0.0; 4]; picture.len()];
            let shape = loss::Frame::new(shot.width, shot.height, 4).only(0..3);
            let (x, y) = (picture.as_flattened(), shot.reference.as_flattened());
            total += loss.value_and_gradient(x, y, &shape, weight, g.as_flattened_mut());
            deferred::render_vjp(&geometry, &self.maps, &view, passes, frame, &g, &mut out.rendered);
        }
        if passes.position_gradients {
            self.vertices_vjp(&vertices, out);
        }
        if passes.map_gradients {
            self.maps.collapse_vjp(&mut out.rendered.maps, MipAdjoint::Smooth);
            let texels = out.rendered.maps.levels[0].texels.iter_mut().zip(&self.solid);
            texels.filter(|(_, solid)| **solid).for_each(|(g, _)| g[channel::ALPHA] = 0.0);
        }
        total
    }

    /// Adjoint of [`Self::vertices`].
    fn vertices_vjp(&self, v: &Vertices, out: &mut ParameterGradients) {
        let g = &mut out.rendered;
        let tangents: Vec<Vec4f> = g.tangents.iter().map(|t| t.extend(0.0)).collect();
        vertex_tangents_vjp(
            &self.unique,
            &self.frames,
            &v.positions,
            &v.normals,
            &tangents,
            &mut g.positions,
            &mut g.normals,
        );
        vertex_normals_vjp(&self.smooth, &v.positions, Weighting::Angle, &g.normals, &mut g.positions);
        self.weld.expand_vjp(&g.positions, &mut out.positions);
    }

    /// Uniform differential coordinates of the present shape.
    pub fn differential(&self) -> Vec<Vec3f> {
        laplacian::differential(&self.rings, &self.positions)
    }
}

/// The texels of opaque triangles: their alpha stays 1, although it weighs colours in coarse levels that transparent
/// triangles may share with them.
fn solid_texels(mesh: &Mesh, class: &[u32], classes: &[AlphaMode], maps: &Maps) -> Vec<bool> {
    let opaque = mesh.triangles.iter().zip(class).filter(|(_, c)| classes[**c as usize] == AlphaMode::Opaque);
    let triangles: Vec<[u32; 3]> = opaque.map(|(t, _)| *t).collect();
    if triangles.is_empty() {
        return Vec::new();
    }
    mesh_coverage(&mesh.uvs, &triangles, maps.width, maps.height, true).mask()
}

/// How the mip chain of the maps follows from its base: as renderers build that of the written textures, by coverage
/// where alpha is written.
fn mip_rule(transparent: bool) -> MipRule {
    if transparent {
        MipRule::Coverage { colors: channel::BASE_COLOR + 3, alpha: channel::ALPHA }
    } else {
        MipRule::Area
    }
}

/// Averages the samples of each pixel of a shot.
pub fn average(color: &[[f32; 4]], shot: &Shot) -> Vec<[f32; 4]> {
    let (n, share) = (shot.samples, 1.0 / (shot.samples * shot.samples) as f32);
    let mut out = vec![[0.0; 4]; shot.width * shot.height];
    out.par_chunks_mut(shot.width).enumerate().for_each(|(y, row)| {
        for line in color[y * n * shot.width * n..].chunks(shot.width * n).take(n) {
            for (o, samples) in row.iter_mut().zip(line.chunks(n)) {
                samples.iter().for_each(|s| (0..4).for_each(|k| o[k] += s[k] * share));
            }
        }
    });
    out
}

/// The renderer's view of a shot.
fn view<'a>(shot: &Shot, lights: &'a [photofit_shading::Light<'a, f32>]) -> View<'a, f32> {
    let eye = shot.camera.eye;
    View {
        view_projection: matrix_rows(&shot.camera.view_projection()),
        eye: vec3(eye.x, eye.y, eye.z),
        lights,
        width: shot.width * shot.samples,
        height: shot.height * shot.samples,
        samples: shot.samples,
        lod_bias: 0.0,
    }
}
