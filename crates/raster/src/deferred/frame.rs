//! One image: layers, blending, antialiasing; and the reverse pass.

use super::packet::{NORMAL, POSITION, TANGENT};
use super::tile::{Strip, StripGradients, StripSpans};
use super::{Geometry, LEAST_TRANSMITTANCE, Masks, Passes, View};
use crate::antialias::{Pair, antialias, antialias_vjp, silhouettes};
use crate::maps::CHANNELS;
use crate::project::{project, project_vjp};
use crate::rasterize::{NONE, TILE, Visibility, rasterize_into};
use crate::texture::{Pyramid, Scatter};
use photofit_scalar::wide::Width;
use photofit_scalar::{Real, Vec3, Vec4, vec3, vec4};
use photofit_texture::AlphaMode;
use rayon::prelude::*;

/// One depth layer of an image.
#[derive(Clone, Debug)]
pub struct FrameLayer<T> {
    /// What the layer shows.
    pub visibility: Visibility,
    pairs: Vec<Pair<T>>,
    /// Radiance and alpha of the layer's fragments.
    pub(super) shaded: Vec<[T; 4]>,
    /// This layer over those behind it, before antialiasing.
    blended: Vec<[T; 4]>,
    /// What lies behind the layer, where alpha has gradients; else empty.
    behind: Vec<[T; 4]>,
    strips: Vec<StripSpans>,
}

impl<T> Default for FrameLayer<T> {
    fn default() -> Self {
        Self {
            visibility: Visibility::default(),
            pairs: Vec::new(),
            shaded: Vec::new(),
            blended: Vec::new(),
            behind: Vec::new(),
            strips: Vec::new(),
        }
    }
}

/// A rendered image and what its reverse pass needs. [`render_into`] uses its memory again.
#[derive(Clone, Debug)]
pub struct Frame<T> {
    /// Radiance over the background and coverage, one per pixel (the mean of its samples), row 0 at the top.
    pub color: Vec<[T; 4]>,
    /// Layers, front first.
    pub layers: Vec<FrameLayer<T>>,
    clip: Vec<Vec4<T>>,
    clip32: Vec<Vec4<f32>>,
    /// Samples of the pixels, where these have several.
    samples: Vec<[T; 4]>,
    /// Layers of earlier images, for their memory.
    spare: Vec<FrameLayer<T>>,
}

impl<T> Default for Frame<T> {
    fn default() -> Self {
        Self {
            color: Vec::new(),
            layers: Vec::new(),
            clip: Vec::new(),
            clip32: Vec::new(),
            samples: Vec::new(),
            spare: Vec::new(),
        }
    }
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
    scratch: Scratch<T>,
}

/// Memory of the reverse pass, kept from image to image.
#[derive(Clone, Debug)]
struct Scratch<T> {
    /// Gradient of the colours in front of the layer at work.
    g: Vec<[T; 4]>,
    /// Gradient of the layer's fragments.
    shaded: Vec<[T; 4]>,
    clip: Vec<Vec4<T>>,
    strips: Vec<StripGradients<T>>,
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
            scratch: Scratch { g: Vec::new(), shaded: Vec::new(), clip: Vec::new(), strips: Vec::new() },
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

/// Renders a mesh over `background` `[H/s*W/s]` (radiance per pixel; its coverage counts as zero), with `s =
/// view.samples`.
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
    let mut frame = Frame::default();
    render_into(geometry, maps, view, background, passes, &mut frame);
    frame
}

/// [`render`] into a frame whose memory is used again.
///
/// # Panics
/// As [`render`].
pub fn render_into<T: Real>(
    geometry: &Geometry<'_, T>,
    maps: &Pyramid<T, CHANNELS>,
    view: &View<'_, T>,
    background: &[[T; 3]],
    passes: &Passes,
    frame: &mut Frame<T>,
) {
    let n = view.width * view.height;
    let triangles = geometry.topology.triangles.len();
    assert!([0, triangles].contains(&geometry.alpha.len()), "alpha modes: one per triangle, or none");
    let Frame { color, layers, clip, clip32, samples, spare } = frame;
    let fits_alpha = passes.fits_alpha() && geometry.alpha.iter().any(|a| passes.masks.fades(*a));
    spare.append(layers);
    clip.resize(geometry.positions.len(), Vec4::zero());
    project(&view.view_projection, geometry.positions, clip);
    clip.par_iter().map(|c| c.cast()).collect_into_vec(clip32);
    let mut front: Option<Visibility> = None;
    while layers.len() < passes.max_layers.max(1) {
        let mut layer = spare.pop().unwrap_or_default();
        let (triangles, visibility) = (geometry.topology.triangles, &mut layer.visibility);
        let (w, h) = (view.width, view.height);
        rasterize_into(clip32, triangles, geometry.sides, w, h, front.as_ref(), visibility);
        if !layers.is_empty() && visibility.triangle.iter().all(|t| *t == NONE) {
            spare.push(layer);
            break;
        }
        layer.shaded.resize(n, [T::zero(); 4]);
        let FrameLayer { visibility, shaded, strips, .. } = &mut layer;
        strips.resize_with(view.height.div_ceil(TILE), StripSpans::default);
        let parts = shaded.par_chunks_mut(view.width.max(1) * TILE).zip(strips);
        parts.enumerate().for_each(|(s, (out, kept))| {
            let strip = Strip { geometry, view, passes, maps, clip, visibility, y: s * TILE };
            strip.shade(Width::Avx512, kept, out);
        });
        let visibility = &layer.visibility;
        layer.pairs.clear();
        if passes.antialias {
            layer.pairs.append(&mut silhouettes(visibility, clip, &geometry.topology));
        }
        front = transparent_part(geometry, visibility, &layer.shaded, hides(passes, fits_alpha));
        layers.push(layer);
        if front.is_none() {
            break;
        }
    }
    let several = view.samples > 1;
    let out = if several { &mut *samples } else { &mut *color };
    out.resize(n, [T::zero(); 4]);
    assert_pixels(background, view, out);
    for (i, layer) in layers.iter_mut().rev().enumerate() {
        let under = |y: usize, rows: &mut [[T; 4]]| {
            if i == 0 {
                magnify_rows(background, view, y, rows, |b| [b[0], b[1], b[2], T::zero()]);
            }
        };
        blend(layer, fits_alpha, view.width, out, under);
        antialias(&layer.pairs, &layer.blended, out);
    }
    if several {
        average(samples, view, color);
    }
}

/// Writes the mean of each pixel's samples; its adjoint is [`magnify`], divided by their number.
pub(super) fn average<T: Real>(samples: &[[T; 4]], view: &View<'_, T>, out: &mut Vec<[T; 4]>) {
    let (s, share) = (view.samples, T::one() / T::of((view.samples * view.samples) as f64));
    let width = view.width / s;
    out.clear();
    out.resize(width * (view.height / s), [T::zero(); 4]);
    out.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
        for line in samples[y * s * view.width..].chunks(view.width).take(s) {
            for (o, samples) in row.iter_mut().zip(line.chunks(s)) {
                samples.iter().for_each(|c| (0..4).for_each(|k| o[k] += c[k] * share));
            }
        }
    });
}

/// Writes one value per pixel to all samples of the pixel.
pub(super) fn magnify<P: Sync, T: Real>(
    pixels: &[P],
    view: &View<'_, T>,
    out: &mut [[T; 4]],
    value: impl Fn(&P) -> [T; 4] + Sync,
) {
    assert_pixels(pixels, view, out);
    let strips = out.par_chunks_mut(view.width.max(1) * TILE).enumerate();
    strips.for_each(|(s, rows)| magnify_rows(pixels, view, s * TILE, rows, &value));
}

fn assert_pixels<P, T: Real>(pixels: &[P], view: &View<'_, T>, out: &[[T; 4]]) {
    let s = view.samples.max(1);
    assert!(view.width.is_multiple_of(s) && view.height.is_multiple_of(s), "whole pixels");
    assert_eq!(pixels.len() * s * s, out.len(), "one value per pixel");
}

/// [`magnify`] of whole rows of samples from row `y` on.
fn magnify_rows<P, T: Real>(
    pixels: &[P],
    view: &View<'_, T>,
    y: usize,
    out: &mut [[T; 4]],
    value: impl Fn(&P) -> [T; 4],
) {
    let (s, w) = (view.samples.max(1), view.width);
    if s == 1 {
        return out.iter_mut().zip(&pixels[y * w..]).for_each(|(o, p)| *o = value(p));
    }
    for (y, row) in (y..).zip(out.chunks_mut(w.max(1))) {
        for (o, p) in row.chunks_mut(s).zip(&pixels[(y / s) * (w / s)..]) {
            o.fill(value(p));
        }
    }
}

/// Whether a fragment of a class with some drawn alpha hides what lies behind, where alpha has a gradient or not.
pub(super) fn hides<T: Real>(passes: &Passes, fits_alpha: bool) -> impl Fn(AlphaMode, T) -> bool {
    let masks = passes.masks;
    move |alpha, drawn| match (alpha, masks) {
        (AlphaMode::Blend, _) if fits_alpha => false,
        (AlphaMode::Mask { .. }, Masks::Faded { slope }) if fits_alpha => slope > 1.0 && drawn >= T::one(),
        _ => T::one() - drawn < T::of(f64::from(LEAST_TRANSMITTANCE)),
    }
}

/// The layer restricted to pixels that do not hide what lies behind; `None` if there is none. `hides(class, alpha)` is
/// false also where alpha is 1 and has a gradient.
pub(super) fn transparent_part<T: Real>(
    g: &Geometry<'_, T>,
    v: &Visibility,
    shaded: &[[T; 4]],
    hides: impl Fn(AlphaMode, T) -> bool,
) -> Option<Visibility> {
    if g.alpha.iter().all(|a| *a == AlphaMode::Opaque) {
        return None;
    }
    let mut front = v.clone();
    let mut any = false;
    for (t, s) in front.triangle.iter_mut().zip(shaded) {
        if *t != NONE && hides(g.alpha[*t as usize], s[3]) {
            *t = NONE;
        }
        any |= *t != NONE;
    }
    any.then_some(front)
}

/// `color = alpha (rgb, 1) + (1 - alpha) color` where the layer has a fragment; kept as the layer's blended colour, and
/// what it was before too if alpha has gradients. `under(y, rows)` may write what lies behind into rows from row `y` on
/// before.
pub(super) fn blend<T: Real>(
    layer: &mut FrameLayer<T>,
    keep_behind: bool,
    width: usize,
    color: &mut [[T; 4]],
    under: impl Fn(usize, &mut [[T; 4]]) + Sync,
) {
    let FrameLayer { visibility, shaded, blended, behind, .. } = layer;
    let strip = width.max(1) * TILE;
    blended.resize(color.len(), [T::zero(); 4]);
    behind.resize(if keep_behind { color.len() } else { 0 }, [T::zero(); 4]);
    let mut kept: Vec<Option<&mut [[T; 4]]>> = behind.chunks_mut(strip).map(Some).collect();
    kept.resize_with(color.len().div_ceil(strip), || None);
    let fragments = shaded.par_chunks(strip).zip(visibility.triangle.par_chunks(strip));
    let colors = color.par_chunks_mut(strip).zip(blended.par_chunks_mut(strip)).zip(kept);
    colors.zip(fragments).enumerate().for_each(|(s, (((color, blended), behind), (shaded, triangle)))| {
        under(s * TILE, color);
        if let Some(behind) = behind {
            behind.copy_from_slice(color);
        }
        for ((c, s), t) in color.iter_mut().zip(shaded).zip(triangle) {
            if *t != NONE {
                let a = s[3];
                let over = [s[0], s[1], s[2], T::one()];
                for k in 0..4 {
                    c[k] += a * (over[k] - c[k]);
                }
            }
        }
        blended.copy_from_slice(color);
    });
}

/// Adjoint of [`render`] with the same arguments (`passes` asking for no more gradients): accumulates into `out` the
/// gradients for `g` `[H/s*W/s]`, the gradient of `frame.color`.
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
    let n = view.width * view.height;
    let Scratch { g: g_color, shaded: g_shaded, clip: g_clip, .. } = &mut out.scratch;
    g_clip.clear();
    g_clip.resize(geometry.positions.len(), Vec4::zero());
    g_color.resize(n, [T::zero(); 4]);
    g_shaded.resize(n, [T::zero(); 4]);
    let share = T::one() / T::of((view.samples * view.samples).max(1) as f64);
    magnify(g, view, g_color, |g| g.map(|g| g * share));
    for layer in &frame.layers {
        let Scratch { g: g_color, clip: g_clip, .. } = &mut out.scratch;
        let size = (view.width, view.height);
        let g_clip = passes.position_gradients.then_some(&mut g_clip[..]);
        antialias_vjp(&layer.pairs, &frame.clip, size, &layer.blended, g_color, g_clip);
        shade_vjp(geometry, maps, view, passes, frame, layer, out);
    }
    if passes.position_gradients {
        project_vjp(&view.view_projection, &out.scratch.clip, &mut out.positions);
    }
}

/// Adjoint of [`blend`] for the samples from number `first` on: writes the gradient of the layer's fragments and turns `g`
/// into that of what lies behind. Alpha has a gradient where `blend` kept what lies behind.
pub(super) fn blend_vjp<T: Real>(layer: &FrameLayer<T>, first: usize, g: &mut [[T; 4]], out: &mut [[T; 4]]) {
    let behind = layer.behind.get(first..).unwrap_or_default();
    let fragments = layer.shaded[first..].iter().zip(&layer.visibility.triangle[first..]);
    for (i, ((s, t), (g, o))) in fragments.zip(g.iter_mut().zip(out)).enumerate() {
        *o = [T::zero(); 4];
        if *t != NONE {
            fragment_vjp(s, behind.get(i), g, o);
        }
    }
}

#[inline(always)]
fn fragment_vjp<T: Real>(s: &[T; 4], behind: Option<&[T; 4]>, g: &mut [T; 4], o: &mut [T; 4]) {
    let (a, rest) = (s[3], T::one() - s[3]);
    if let Some(behind) = behind {
        let over = [s[0], s[1], s[2], T::one()];
        o[3] = (0..4).fold(T::zero(), |sum, k| sum + g[k] * (over[k] - behind[k]));
    }
    for k in 0..4 {
        if k < 3 {
            o[k] = a * g[k];
        }
        g[k] *= rest;
    }
}

/// Adjoint of shading and of [`blend`] for one layer; the gradient of the colours in front is in the scratch memory.
fn shade_vjp<T: Real>(
    geometry: &Geometry<'_, T>,
    maps: &Pyramid<T, CHANNELS>,
    view: &View<'_, T>,
    passes: &Passes,
    frame: &Frame<T>,
    layer: &FrameLayer<T>,
    out: &mut Gradients<T>,
) {
    let Scratch { g, shaded, clip: g_clip, strips } = &mut out.scratch;
    let rows = view.width.max(1) * TILE;
    strips.resize_with(shaded.len().div_ceil(rows), StripGradients::default);
    let parts =
        strips.par_iter_mut().zip(&layer.strips).zip(g.par_chunks_mut(rows).zip(shaded.par_chunks_mut(rows)));
    parts.enumerate().for_each(|(s, ((strip_out, kept), (front, g)))| {
        let v = &layer.visibility;
        blend_vjp(layer, s * rows, front, g);
        let strip = Strip { geometry, view, passes, maps, clip: &frame.clip, visibility: v, y: s * TILE };
        strip.shade_vjp(Width::Avx512, kept, g, strip_out);
    });
    if passes.map_gradients {
        let queues: Vec<_> = strips.iter().map(|s| &s.texels).collect();
        Scatter::accumulate(&queues, &mut out.maps);
    }
    if !passes.position_gradients {
        return;
    }
    // One task per attribute: each adds in the same fixed order.
    let (strips, triangles) = (&*strips, geometry.topology.triangles);
    let (positions, normals, tangents) = (&mut out.positions, &mut out.normals, &mut out.tangents);
    let add = |g: &mut [Vec3<T>], at: usize| {
        for ((triangle, _), c) in strips.iter().flat_map(|s| s.clips.iter().zip(&s.attributes)) {
            for (i, a) in triangles[*triangle as usize].iter().zip(c) {
                g[*i as usize] += vec3(a[at], a[at + 1], a[at + 2]);
            }
        }
    };
    rayon::scope(|s| {
        s.spawn(|_| add(positions, POSITION));
        s.spawn(|_| add(normals, NORMAL));
        s.spawn(|_| add(tangents, TANGENT));
        for (triangle, c) in strips.iter().flat_map(|s| &s.clips) {
            for (k, i) in triangles[*triangle as usize].iter().enumerate() {
                g_clip[*i as usize] += vec4(c[3 * k], c[3 * k + 1], T::zero(), c[3 * k + 2]);
            }
        }
    });
}
