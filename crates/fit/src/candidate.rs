//! The asset being fitted: welded vertex positions and material maps, and the chain from them to a loss.
//!
//! The data of a fit goes one way: positions -> normals -> stages of the picture (a pose) -> tangents -> rasterize -> shade
//! -> mean of each pixel's samples -> loss; [`Candidate::pull_back`] writes it forward and, reversed line by line, backward.
//! The whole chain is generic over the scalar: `f32` in production, `f64` in its gradient check.

mod mips;
mod stages;

pub use stages::{OrientedPoints, VertexStage};

use crate::bake::BakeClass;
use crate::engine::loss::PictureLoss;
use crate::views::{Sampling, Shot};
use photofit_geometry::atlas::mesh_coverage;
use photofit_geometry::normals::{Weighting, vertex_normals, vertex_normals_vjp};
use photofit_geometry::tangents::{UvFrames, vertex_tangents, vertex_tangents_vjp};
use photofit_geometry::weld::weld_exact;
use photofit_geometry::{Csr, Edges, Incidence, Mesh, Weld, laplacian};
use photofit_raster::antialias::Topology;
use photofit_raster::deferred::{self, Frame, Geometry, Gradients, Passes, View};
use photofit_raster::loss::LossScalar;
use photofit_raster::project::matrix_rows;
use photofit_raster::texture::{MipAdjoint, MipRule, Pyramid};
use photofit_raster::{CHANNELS, Maps, channel};
use photofit_scalar::{Real, Vec2, Vec3, Vec4, vec3};
use photofit_scene::AlphaMode;
use photofit_shading::Sides;
use rayon::prelude::*;
use std::cell::LazyCell;

/// How a class of triangles is drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SurfaceClass {
    /// What alpha means.
    pub alpha: AlphaMode,
    /// The sides that are seen.
    pub sides: Sides,
    /// Vertex normals point to the back.
    pub opposed: bool,
    /// Another alpha is drawn than is written, as of glass: it is no parameter.
    pub see_through: bool,
}

impl SurfaceClass {
    /// Whether its alpha is a parameter.
    pub fn has_alpha(&self) -> bool {
        self.alpha != AlphaMode::Opaque && !self.see_through
    }

    pub(crate) fn is_masked(&self) -> bool {
        matches!(self.alpha, AlphaMode::Mask { .. })
    }
}

impl From<SurfaceClass> for BakeClass {
    fn from(class: SurfaceClass) -> Self {
        Self { alpha: class.alpha.into(), opposed: class.opposed, see_through: class.see_through }
    }
}

/// Topology and parameters of a fitted mesh.
#[derive(Clone, Debug)]
pub struct Candidate<T = f32> {
    /// Positions by welded id: the shape's parameters.
    pub positions: Vec<Vec3<T>>,
    /// The maps with their mip levels: level 0 holds the parameters, or, after [`Candidate::free_mips`], all of them.
    pub maps: Pyramid<T, CHANNELS>,
    /// How gradients of the chain's coarse levels return to level 0.
    pub mip_adjoint: MipAdjoint,
    /// Texture coordinates, one per vertex.
    pub uvs: Vec<Vec2<T>>,
    /// Vertex indices.
    pub triangles: Vec<[u32; 3]>,
    /// Index of the class of each triangle (see [`Candidate::classes`]).
    pub class: Vec<u32>,
    /// How the triangles of each class are drawn.
    pub classes: Vec<SurfaceClass>,
    /// Neighbours of each welded vertex.
    pub rings: Csr,
    /// Edges between welded vertices, each once.
    pub edges: Vec<[u32; 2]>,
    /// Welded vertices that stay where they are.
    pub(crate) locked: Vec<(u32, Vec3<T>)>,
    pub(crate) alpha: Vec<AlphaMode>,
    /// Texels whose alpha is no parameter; empty = none.
    pub(crate) solid: Vec<bool>,
    /// Texels of masked triangles, where there are transparent ones.
    pub(crate) masked: Vec<bool>,
    /// The same of each coarse level, where these are free and something is transparent.
    pub(crate) held_coarse: Vec<mips::Held>,
    pub(crate) sides: Vec<Sides>,
    /// Vertices to positions.
    pub(crate) weld: Weld,
    /// Vertices to normals.
    pub(crate) smooth: Incidence,
    pub(crate) unique: Incidence,
    pub(crate) frames: UvFrames,
    pub(crate) opposite: Vec<[u32; 3]>,
    pub(crate) neighbour: Vec<[u32; 3]>,
}

/// Vertex arrays that follow from the positions.
#[derive(Clone, Debug)]
pub struct Vertices<T = f32> {
    /// One per vertex.
    pub positions: Vec<Vec3<T>>,
    /// Smooth unit normals, on the front of the triangles unless their class is [`SurfaceClass::opposed`].
    pub normals: Vec<Vec3<T>>,
    /// Tangents with handedness.
    pub tangents: Vec<Vec4<T>>,
}

/// Where the vertices of a picture come from.
#[derive(Clone, Copy, Debug)]
pub enum VertexSource<'a, T = f32> {
    /// From the positions through these stages; none: the shape as it stands.
    Stages(&'a [&'a dyn VertexStage<T>]),
    /// They are given, and positions have no gradients.
    Given(&'a Vertices<T>),
}

impl<T> VertexSource<'_, T> {
    /// The shape as it stands.
    pub const SHAPE: Self = Self::Stages(&[]);
}

/// A picture that a candidate draws: camera, lights and what stands behind the asset.
#[derive(Clone, Copy, Debug)]
pub struct CandidateView<'a, T = f32> {
    /// Camera, lights and samples.
    pub view: View<'a, T>,
    /// Radiance behind the asset, one per pixel.
    pub background: &'a [[T; 3]],
    /// Where its vertices come from.
    pub vertices: VertexSource<'a, T>,
    /// Whether backs of single-sided triangles are drawn, too.
    pub backs: bool,
}

/// Gradients of the parameters, and scratch of the chain.
#[derive(Debug)]
pub struct ParameterGradients<T = f32> {
    /// Of the welded positions.
    pub positions: Vec<Vec3<T>>,
    /// Of everything the renderer reads; its map gradients, once collapsed, are those of level 0.
    pub rendered: Gradients<T>,
    /// The picture at work.
    frame: Frame<T>,
    /// The gradient of its pixels.
    pixels: Vec<[T; 4]>,
    /// The gradient of its vertices, where they come through stages.
    staged: VertexGradients<T>,
}

/// Gradients of vertex arrays.
#[derive(Debug, Default)]
struct VertexGradients<T> {
    placed: OrientedPoints<T>,
    tangents: Vec<Vec3<T>>,
}

impl<T: Real> VertexGradients<T> {
    /// Zeros for so many vertices.
    fn clear(&mut self, vertices: usize) {
        for g in [&mut self.placed.positions, &mut self.placed.normals, &mut self.tangents] {
            g.clear();
            g.resize(vertices, Vec3::zero());
        }
    }

    /// Changes places with those that the renderer adds to.
    fn swap(&mut self, rendered: &mut Gradients<T>) {
        std::mem::swap(&mut self.placed.positions, &mut rendered.positions);
        std::mem::swap(&mut self.placed.normals, &mut rendered.normals);
        std::mem::swap(&mut self.tangents, &mut rendered.tangents);
    }
}

impl<T: LossScalar> Candidate<T> {
    /// Prepares the topology of an atlas mesh (`positions`, `uvs`, `triangles`; vertices split only where uvs differ
    /// and at creases). Vertices of one id in `smoothing` share their normal.
    ///
    /// # Panics
    /// If an index is out of range or the arrays disagree in length.
    pub fn new(
        mesh: &Mesh,
        smoothing: &Weld,
        class: Vec<u32>,
        classes: Vec<SurfaceClass>,
        maps: Maps<T>,
    ) -> Self {
        assert_eq!(class.len(), mesh.triangles.len(), "one class per triangle");
        let weld = weld_exact(&mesh.positions);
        let edges = Edges::new(&mesh.triangles, &weld);
        let unique = Incidence::new(&mesh.triangles, &Weld::identity(mesh.positions.len()));
        let frames = UvFrames::new(&unique, &mesh.uvs);
        let of = |c: &u32| classes[*c as usize];
        let transparent = class.iter().any(|c| of(c).alpha != AlphaMode::Opaque);
        let alpha = class.iter().filter(|_| transparent).map(|c| of(c).alpha).collect();
        let culls = class.iter().any(|c| of(c).sides == Sides::Front);
        let sides = class.iter().filter(|_| culls).map(|c| of(c).sides).collect();
        // Normals that point to the back are those of the same triangles wound the other way round.
        let turn = |(t, c): (&[u32; 3], &u32)| if of(c).opposed { [t[0], t[2], t[1]] } else { *t };
        let turned: Vec<[u32; 3]> = mesh.triangles.iter().zip(&class).map(turn).collect();
        let size = (maps.width, maps.height);
        let texels_of = |which: fn(&SurfaceClass) -> bool| {
            let shape = (&mesh.uvs[..], &mesh.triangles[..]);
            if transparent { texels_of(shape, &class, &classes, size, which) } else { Vec::new() }
        };
        let solid = texels_of(|class| !class.has_alpha());
        let masked = texels_of(SurfaceClass::is_masked);
        // Upsampling a gradient by coverage to texels that their parent does not hold has no bound.
        let mip_adjoint = if transparent { MipAdjoint::Exact } else { MipAdjoint::Smooth };
        Self {
            positions: weld.pick(&mesh.positions).iter().map(|p| p.cast()).collect(),
            maps: Pyramid::with_rule(maps, mip_rule(transparent)),
            mip_adjoint,
            uvs: mesh.uvs.iter().map(|uv| uv.cast()).collect(),
            triangles: mesh.triangles.clone(),
            class,
            classes,
            rings: edges.one_rings(),
            opposite: edges.opposite_vertices(&mesh.triangles, &weld),
            neighbour: edges.triangle_neighbours(),
            edges: edges.vertices,
            locked: Vec::new(),
            alpha,
            solid,
            masked,
            held_coarse: Vec::new(),
            sides,
            smooth: Incidence::new(&turned, smoothing),
            weld,
            unique,
            frames,
        }
    }

    /// Whether any triangle may be transparent.
    pub fn is_transparent(&self) -> bool {
        !self.alpha.is_empty()
    }

    /// Locks the welded vertices whose present positions are `wanted`: a fit leaves them there.
    pub fn lock(&mut self, wanted: impl Fn(&Vec3<T>) -> bool) {
        let all = self.positions.iter().enumerate();
        self.locked = all.filter(|(_, p)| wanted(p)).map(|(v, p)| (v as u32, *p)).collect();
    }

    /// Puts locked vertices back.
    pub(crate) fn hold_locked(&mut self) {
        for (v, p) in &self.locked {
            self.positions[*v as usize] = *p;
        }
    }

    /// Replaces the maps (of the same size); their mip levels are those of [`Self::levels_of`].
    ///
    /// # Panics
    /// If the size differs.
    pub fn set_maps(&mut self, maps: Maps<T>) {
        let base = &self.maps.levels[0];
        assert_eq!((base.width, base.height), (maps.width, maps.height), "maps of the same size");
        self.maps = self.levels_of(maps);
    }

    /// The vertex arrays for the present positions.
    pub fn vertices(&self) -> Vertices<T> {
        self.vertices_of(self.shape())
    }

    /// The vertex arrays for the present positions after these stages.
    pub fn vertices_through(&self, stages: &[&dyn VertexStage<T>]) -> Vertices<T> {
        self.vertices_of(stages.iter().fold(self.shape(), |placed, stage| stage.forward(&placed)))
    }

    /// Positions and normals of the vertices for the present positions.
    pub fn shape(&self) -> OrientedPoints<T> {
        let positions = self.weld.expand(&self.positions);
        let normals = vertex_normals(&self.smooth, &positions, Weighting::Angle);
        OrientedPoints { positions, normals }
    }

    /// The vertex arrays for positions and unit normals.
    ///
    /// # Panics
    /// If their numbers differ from that of the vertices.
    pub fn vertices_of(&self, OrientedPoints { positions, normals }: OrientedPoints<T>) -> Vertices<T> {
        assert!([positions.len(), normals.len()] == [self.uvs.len(); 2], "one of each per vertex");
        let tangents = vertex_tangents(&self.unique, &self.frames, &positions, &normals);
        Vertices { positions, normals, tangents }
    }

    /// The mesh as it would be exported.
    pub fn mesh(&self) -> Mesh {
        let v = self.vertices();
        Mesh {
            positions: single(&v.positions),
            normals: single(&v.normals),
            uvs: self.uvs.iter().map(|uv| uv.cast()).collect(),
            tangents: v.tangents.iter().map(|t| t.cast()).collect(),
            triangles: self.triangles.clone(),
            ..Mesh::default()
        }
    }

    /// Normals on the front that know no creases, one per vertex: along them a bake leaves no gaps.
    pub fn round_normals(&self) -> Vec<Vec3<f32>> {
        let round = Incidence::new(&self.triangles, &self.weld);
        vertex_normals(&round, &self.weld.expand(&single(&self.positions)), Weighting::Angle)
    }

    fn geometry<'a>(&'a self, v: &'a Vertices<T>, backs: bool) -> Geometry<'a, T> {
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
            sides: if backs { &[] } else { &self.sides },
        }
    }

    /// Zero gradients of the right size.
    pub fn gradients(&self) -> ParameterGradients<T> {
        ParameterGradients {
            positions: vec![Vec3::zero(); self.positions.len()],
            rendered: Gradients::new(self.uvs.len(), &self.maps),
            frame: Frame::default(),
            pixels: Vec::new(),
            staged: VertexGradients::default(),
        }
    }

    /// Draws one picture.
    pub fn draw(&self, vertices: &Vertices<T>, picture: &CandidateView<'_, T>, passes: &Passes) -> Frame<T> {
        deferred::render(
            &self.geometry(vertices, picture.backs),
            &self.maps,
            &picture.view,
            picture.background,
            passes,
        )
    }

    /// Draws all pictures, asks `value` for each, and pulls its gradients back to the parameters (overwriting `out`).
    /// Returns the sum of the values.
    ///
    /// `value(i, pixels, g)` gets the pixels `[H*W]` of picture `i` and adds the gradient of its value to `g` `[H*W]`,
    /// which is zero.
    ///
    /// # Panics
    /// If positions are to have gradients in a picture whose vertices are given.
    pub fn pull_back<'a>(
        &self,
        pictures: impl IntoIterator<Item = CandidateView<'a, T>>,
        mut value: impl FnMut(usize, &[[T; 4]], &mut [[T; 4]]) -> f64,
        passes: &Passes,
        out: &mut ParameterGradients<T>,
    ) -> f64 {
        out.positions.fill(Vec3::zero());
        out.rendered.clear();
        let shape = LazyCell::new(|| self.shape());
        let own = LazyCell::new(|| self.vertices_of(shape.clone()));
        let mut total = 0.0;
        for (i, CandidateView { view, background, vertices, backs }) in pictures.into_iter().enumerate() {
            let (stages, given) = match vertices {
                VertexSource::Stages(stages) => (stages, None),
                VertexSource::Given(given) => (&[][..], Some(given)),
            };
            assert!(
                given.is_none() || !passes.position_gradients,
                "given vertices pass no gradient to positions"
            );
            let staged = (!stages.is_empty()).then(|| stages::through(stages, &shape));
            let posed = staged.as_ref().map(|s| self.vertices_of(s[stages.len()].clone()));
            let drawn = posed.as_ref().or(given).unwrap_or_else(|| &own);
            let geometry = self.geometry(drawn, backs);
            let ParameterGradients { frame, pixels, rendered, staged: own_gradients, .. } = &mut *out;
            deferred::render_into(&geometry, &self.maps, &view, background, passes, frame);
            pixels.clear();
            pixels.resize(frame.color.len(), [T::zero(); 4]);
            total += value(i, &frame.color, pixels);
            let apart = posed.is_some() && passes.position_gradients;
            if apart {
                own_gradients.clear(drawn.positions.len());
                own_gradients.swap(rendered);
            }
            deferred::render_vjp(&geometry, &self.maps, &view, passes, frame, pixels, rendered);
            if let Some(passed) = staged.filter(|_| apart) {
                own_gradients.swap(rendered);
                let VertexGradients { placed, tangents } = own_gradients;
                self.tangents_vjp(drawn, tangents, placed);
                let g = stages::through_vjp(stages, &passed, std::mem::take(placed));
                add(&mut rendered.positions, &g.positions);
                add(&mut rendered.normals, &g.normals);
            }
        }
        if passes.position_gradients {
            self.shape_vjp(&own, out);
        }
        if passes.map_gradients {
            self.maps.collapse_vjp(&mut out.rendered.maps, self.mip_adjoint);
            self.hold_alpha(&mut out.rendered.maps, passes.masks);
        }
        total
    }

    /// Adds to the gradients of positions and normals what those of the tangents say: adjoint of [`Self::vertices_of`].
    fn tangents_vjp(&self, v: &Vertices<T>, d_tangents: &[Vec3<T>], g: &mut OrientedPoints<T>) {
        let d_tangents: Vec<Vec4<T>> = d_tangents.iter().map(|t| t.extend(T::zero())).collect();
        let to = (&mut g.positions, &mut g.normals);
        vertex_tangents_vjp(&self.unique, &self.frames, &v.positions, &v.normals, &d_tangents, to.0, to.1);
    }

    /// Adjoint of [`Self::vertices`].
    fn shape_vjp(&self, v: &Vertices<T>, out: &mut ParameterGradients<T>) {
        let rendered = &mut out.rendered;
        let mut g = OrientedPoints {
            positions: std::mem::take(&mut rendered.positions),
            normals: std::mem::take(&mut rendered.normals),
        };
        self.tangents_vjp(v, &rendered.tangents, &mut g);
        vertex_normals_vjp(&self.smooth, &v.positions, Weighting::Angle, &g.normals, &mut g.positions);
        self.weld.expand_vjp(&g.positions, &mut out.positions);
        (rendered.positions, rendered.normals) = (g.positions, g.normals);
    }

    /// Uniform differential coordinates of the present shape.
    pub fn differential(&self) -> Vec<Vec3<T>> {
        laplacian::differential(&self.rings, &self.positions)
    }
}

fn add<T: Real>(to: &mut [Vec3<T>], what: &[Vec3<T>]) {
    to.iter_mut().zip(what).for_each(|(t, w)| *t += *w);
}

/// Takes the gradient of alpha from the texels that are marked.
fn hold_alpha<T: Real>(texels: &mut [[T; CHANNELS]], held: &[bool]) {
    texels.iter_mut().zip(held).filter(|(_, held)| **held).for_each(|(g, _)| g[channel::ALPHA] = T::zero());
}

/// The texels of the triangles of the classes that are meant. Alpha of opaque ones stays 1, although it weighs colours in
/// coarse levels that transparent triangles may share with them, and that of glass stays what it is drawn with.
fn texels_of(
    (uvs, triangles): (&[Vec2<f32>], &[[u32; 3]]),
    class: &[u32],
    classes: &[SurfaceClass],
    (width, height): (usize, usize),
    which: fn(&SurfaceClass) -> bool,
) -> Vec<bool> {
    let wanted = triangles.iter().zip(class).filter(|(_, c)| which(&classes[**c as usize]));
    let triangles: Vec<[u32; 3]> = wanted.map(|(t, _)| *t).collect();
    if triangles.is_empty() {
        return Vec::new();
    }
    mesh_coverage(uvs, &triangles, width, height, true).mask()
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

/// Vectors in single precision.
fn single<T: Real>(v: &[Vec3<T>]) -> Vec<Vec3<f32>> {
    v.iter().map(|v| v.cast()).collect()
}

impl Candidate {
    /// Draws one shot over its background.
    pub fn render(&self, vertices: &Vertices, shot: &Shot, passes: &Passes) -> Frame<f32> {
        let lights = shot.lights.lights();
        let background = shot.background();
        let (view, backs) = (view(shot, &lights), shot.backs);
        let picture = CandidateView { view, background: &background, vertices: VertexSource::SHAPE, backs };
        self.draw(vertices, &picture, passes)
    }

    /// Loss of a batch of shots against their references, and its gradients (overwritten). Returns the loss, the mean
    /// over the shots.
    pub fn step(
        &self,
        shots: &[Shot],
        loss: PictureLoss,
        passes: &Passes,
        out: &mut ParameterGradients,
    ) -> f64 {
        self.step_at(shots, |_| VertexSource::SHAPE, loss, passes, out)
    }

    /// The same; `vertices(i)` says where those of shot `i` come from.
    pub fn step_at<'a>(
        &self,
        shots: &'a [Shot],
        vertices: impl Fn(usize) -> VertexSource<'a>,
        loss: PictureLoss,
        passes: &Passes,
        out: &mut ParameterGradients,
    ) -> f64 {
        let lights: Vec<_> = shots.iter().map(|s| s.lights.lights()).collect();
        let over: Vec<_> = shots.par_iter().map(Shot::over_noise).collect();
        let pictures = shots.iter().zip(&lights).enumerate().map(|(i, (shot, lights))| CandidateView {
            view: view(shot, lights),
            background: &over[i].background,
            vertices: vertices(i),
            backs: shot.backs,
        });
        let weight = 1.0 / shots.len().max(1) as f64;
        let value = |i: usize, pixels: &[[f32; 4]], g: &mut [[f32; 4]]| {
            let size = (shots[i].width, shots[i].height);
            loss.value_and_gradient(size, pixels, &over[i].reference, weight, g)
        };
        self.pull_back(pictures, value, passes, out)
    }
}

/// The renderer's view of a shot.
pub(crate) fn view<'a>(shot: &Shot, lights: &'a [photofit_shading::Light<'a, f32>]) -> View<'a, f32> {
    let camera = shot.camera.pinhole();
    let Sampling { per_axis, shade_per_pixel } = shot.sampling;
    View {
        view_projection: matrix_rows(&camera.view_projection()),
        eye: vec3(camera.eye.x, camera.eye.y, camera.eye.z),
        lights,
        width: shot.width * per_axis,
        height: shot.height * per_axis,
        samples: per_axis,
        shade_per_pixel,
        lod_bias: 0.0,
    }
}

#[cfg(test)]
mod tests;
