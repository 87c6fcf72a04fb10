//! One image: layers, blending, antialiasing; and the reverse pass.

use super::tile::{Strip, StripGradients};
use super::{Geometry, Passes, View};
use crate::antialias::{Pair, antialias, antialias_vjp, silhouettes};
use crate::maps::CHANNELS;
use crate::project::{project, project_vjp};
use crate::rasterize::{NONE, TILE, Visibility, rasterize};
use crate::texture::{Pyramid, Scatter};
use photofit_scalar::{Real, Vec3, Vec4};
use photofit_scene::AlphaMode;
use rayon::prelude::*;

/// Transparency below which nothing behind a pixel is looked for.
const OPAQUE_ENOUGH: f64 = 1.0 - 1.0 / 512.0;

/// One depth layer of an image.
#[derive(Clone, Debug)]
pub struct FrameLayer<T> {
    /// What the layer shows.
    pub visibility: Visibility,
    pairs: Vec<Pair<T>>,
    /// Radiance and alpha of the layer's fragments.
    shaded: Vec<[T; 4]>,
    /// This layer over those behind it, before antialiasing.
    blended: Vec<[T; 4]>,
}

/// A rendered image and what its reverse pass needs.
#[derive(Clone, Debug)]
pub struct Frame<T> {
    /// Radiance over the background and coverage, row 0 at the top.
    pub color: Vec<[T; 4]>,
    /// Layers, front first.
    pub layers: Vec<FrameLayer<T>>,
    clip: Vec<Vec4<T>>,
}

/// Gradients of one or more images; accumulated.
#[derive(Clone, Debug)]
pub struct Gradients<T> {
    /// Of the world positions, without their influence on normals and tangents.
    pub positions: Vec<Vec3<T>>,
    /// Of the vertex normals.
    pub normals: Vec<Vec3<T>>,
    /// Of the tangents (xyz).
    pub tangents: Vec<Vec3<T>>,
    /// Of the texels, level by level.
    pub maps: Pyramid<T, CHANNELS>,
}

impl<T: Real> Gradients<T> {
    /// Zero gradients.
    pub fn new(vertices: usize, maps: &Pyramid<T, CHANNELS>) -> Self {
        let zero = vec![Vec3::zero(); vertices];
        Self {
            positions: zero.clone(),
            normals: zero.clone(),
            tangents: zero,
            maps: Pyramid::zeros_like(maps),
        }
    }

    /// Sets everything to zero.
    pub fn clear(&mut self) {
        for g in [&mut self.positions, &mut self.normals, &mut self.tangents] {
            g.fill(Vec3::zero());
        }
        self.maps.clear();
    }
}

/// Renders a mesh over `background` `[H*W]` (radiance; its coverage counts as zero).
///
/// # Panics
/// If array lengths disagree with the geometry or the view, or an index is out of range.
pub fn render<T: Real>(
    geometry: &Geometry<'_, T>,
    maps: &Pyramid<T, CHANNELS>,
    view: &View<'_, T>,
    background: &[[T; 3]],
    passes: &Passes,
) -> Frame<T> {
    let n = view.width * view.height;
    assert_eq!(background.len(), n, "one background colour per pixel");
    let mut clip = vec![Vec4::zero(); geometry.positions.len()];
    project(&view.view_projection, geometry.positions, &mut clip);
    let clip32: Vec<Vec4<f32>> = clip.iter().map(|c| c.cast()).collect();
    let mut layers: Vec<FrameLayer<T>> = Vec::new();
    let mut front: Option<Visibility> = None;
    while layers.len() < passes.max_layers.max(1) {
        let visibility =
            rasterize(&clip32, geometry.topology.triangles, view.width, view.height, front.as_ref());
        if !layers.is_empty() && visibility.triangle.iter().all(|t| *t == NONE) {
            break;
        }
        let mut shaded = vec![[T::zero(); 4]; n];
        shaded.par_chunks_mut(view.width.max(1) * TILE).enumerate().for_each(|(s, out)| {
            let strip =
                Strip { geometry, view, passes, maps, clip: &clip, visibility: &visibility, y: s * TILE };
            strip.shade(&mut Vec::new(), out);
        });
        let pairs =
            if passes.antialias { silhouettes(&visibility, &clip, &geometry.topology) } else { Vec::new() };
        front = transparent_part(geometry, &visibility, &shaded);
        layers.push(FrameLayer { visibility, pairs, shaded, blended: Vec::new() });
        if front.is_none() {
            break;
        }
    }
    let mut color: Vec<[T; 4]> = background.iter().map(|b| [b[0], b[1], b[2], T::zero()]).collect();
    for layer in layers.iter_mut().rev() {
        blend(layer, &mut color);
        layer.blended.clone_from(&color);
        antialias(&layer.pairs, &layer.blended, &mut color);
    }
    Frame { color, layers, clip }
}

/// The layer restricted to pixels that let something through; `None` if there is none.
fn transparent_part<T: Real>(g: &Geometry<'_, T>, v: &Visibility, shaded: &[[T; 4]]) -> Option<Visibility> {
    if g.alpha.iter().all(|a| *a == AlphaMode::Opaque) {
        return None;
    }
    let mut front = v.clone();
    let mut any = false;
    for (t, s) in front.triangle.iter_mut().zip(shaded) {
        if *t != NONE && s[3] > T::of(OPAQUE_ENOUGH) {
            *t = NONE;
        }
        any |= *t != NONE;
    }
    any.then_some(front)
}

/// `color = alpha (rgb, 1) + (1 - alpha) color` where the layer has a fragment.
fn blend<T: Real>(layer: &FrameLayer<T>, color: &mut [[T; 4]]) {
    for ((c, s), t) in color.iter_mut().zip(&layer.shaded).zip(&layer.visibility.triangle) {
        if *t != NONE {
            let a = s[3];
            let over = [s[0], s[1], s[2], T::one()];
            for k in 0..4 {
                c[k] += a * (over[k] - c[k]);
            }
        }
    }
}

/// Adjoint of [`render`]: accumulates into `out` the gradients for `g` `[H*W]`, the gradient of `frame.color`.
///
/// # Panics
/// If array lengths disagree.
pub fn render_vjp<T: Real>(
    geometry: &Geometry<'_, T>,
    maps: &Pyramid<T, CHANNELS>,
    view: &View<'_, T>,
    passes: &Passes,
    frame: &Frame<T>,
    g: &[[T; 4]],
    out: &mut Gradients<T>,
) {
    assert_eq!(g.len(), frame.color.len(), "one gradient per pixel");
    let mut g_clip = vec![Vec4::zero(); geometry.positions.len()];
    let mut g = g.to_vec();
    for layer in &frame.layers {
        let g_out = g.clone();
        let size = (view.width, view.height);
        antialias_vjp(&layer.pairs, &frame.clip, size, &layer.blended, &g_out, &mut g, &mut g_clip);
        let g_shaded = blend_vjp(layer, &mut g);
        shade_vjp(geometry, maps, view, passes, frame, layer, &g_shaded, &mut g_clip, out);
    }
    if passes.position_gradients {
        project_vjp(&view.view_projection, &g_clip, &mut out.positions);
    }
}

/// Adjoint of [`blend`]: returns the gradient of the layer's fragments and turns `g` into that of what lies behind.
///
/// What lies behind is recovered from the blended colour; where alpha leaves nothing of it, alpha gets no gradient.
fn blend_vjp<T: Real>(layer: &FrameLayer<T>, g: &mut [[T; 4]]) -> Vec<[T; 4]> {
    let mut out = vec![[T::zero(); 4]; g.len()];
    let fragments = layer.shaded.iter().zip(&layer.visibility.triangle).zip(&layer.blended);
    for (((s, t), c), (g, o)) in fragments.zip(g.iter_mut().zip(&mut out)) {
        if *t == NONE {
            continue;
        }
        let (a, rest) = (s[3], T::one() - s[3]);
        let over = [s[0], s[1], s[2], T::one()];
        for k in 0..4 {
            if k < 3 {
                o[k] = a * g[k];
            }
            if rest > T::zero() {
                // d/da = over - back, with back = (c - a over) / (1 - a), so over - back = (over - c) / (1 - a).
                o[3] += g[k] * (over[k] - c[k]) / rest;
            }
            g[k] *= rest;
        }
    }
    out
}

/// Adjoint of shading one layer.
fn shade_vjp<T: Real>(
    geometry: &Geometry<'_, T>,
    maps: &Pyramid<T, CHANNELS>,
    view: &View<'_, T>,
    passes: &Passes,
    frame: &Frame<T>,
    layer: &FrameLayer<T>,
    g_shaded: &[[T; 4]],
    g_clip: &mut [Vec4<T>],
    out: &mut Gradients<T>,
) {
    let strips: Vec<StripGradients<T>> = g_shaded
        .par_chunks(view.width.max(1) * TILE)
        .enumerate()
        .map(|(s, g)| {
            let mut strip_out = StripGradients::default();
            let v = &layer.visibility;
            let strip = Strip { geometry, view, passes, maps, clip: &frame.clip, visibility: v, y: s * TILE };
            strip.shade_vjp(g, &mut strip_out);
            strip_out
        })
        .collect();
    if passes.map_gradients {
        let queues: Vec<_> = strips.iter().map(|s| &s.texels).collect();
        Scatter::accumulate(&queues, &mut out.maps);
    }
    for (triangle, c) in strips.iter().flat_map(|s| &s.corners) {
        for k in 0..3 {
            let i = geometry.topology.triangles[*triangle as usize][k] as usize;
            g_clip[i] += c.clip[k];
            out.positions[i] += Vec3::from_array(c.position[k]);
            out.normals[i] += Vec3::from_array(c.normal[k]);
            out.tangents[i] += Vec3::from_array(c.tangent[k]);
        }
    }
}
