//! The judge: quality of written assets on views and lights that no fit saw, drawn as other programs draw them.
//!
//! Where materials need what the rasterizer lacks (coats, sheen, glass and so on) reference and candidates are path
//! traced, extensions included.

mod flicker;
mod method;
mod moments;
mod popping;
mod ranking;

pub use flicker::flicker;
pub(crate) use method::method;
pub use popping::{Popping, popping};
pub(crate) use ranking::CLEAR_GAIN;
pub use ranking::{Certainty, Ranking, highest, ranking, scores};

use super::animated::Animated;
use super::asset::Normalised;
use super::classes::{drawn, placed_materials};
use super::light_asset::LightAsset;
use super::reference::{
    MaterialFeatures, PathTraced, Rasterized, Reference, ReferenceKind, ReferencePicture,
};
use super::views::{Lighting, Orbit, Set, Views};
use crate::{FitError, Progress};
use photofit_geometry::{Mesh, Split};
use photofit_image::{
    ErrorMap, Image, dilate, flip, luminance, psnr_from_mse, squared_error, squared_error_of_halves, ssim,
    to_display,
};
use photofit_scalar::Vec3f;
use photofit_scene::{FlatScene, Instance, Primitive, Scene, SurfaceLibrary};
use std::collections::{BTreeMap, BTreeSet};

/// Grey behind the asset, sRGB.
const BACKGROUND: f32 = 0.5;
/// The foreground is grown by this many pixels, in proportion by fewer in pictures of less than [`SMALL`] pixels.
const MARGIN: usize = 6;
const SMALL: usize = 256;
/// Coverages of a pixel that differ by more than this are another outline.
pub(crate) const OUTLINE: f32 = 0.1;
/// Pixels per degree of the FLIP viewer.
const PIXELS_PER_DEGREE: f32 = 67.02;
/// Largest PSNR of a [`Quality`], and that of equal pictures: what 8 bits can tell apart, rounded up.
pub const BEST_PSNR: f64 = 60.0;
/// Widest path traced picture of the judge.
pub const WIDEST_TRACED: usize = 256;

/// Mean quality over the foreground: the union of both silhouettes, dilated.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Quality {
    /// Peak signal to noise of sRGB images, decibels, at most [`BEST_PSNR`]; of path traced ones as the square of [`ViewQuality::rmse`] has
    /// it.
    pub psnr: f64,
    /// Structural similarity.
    pub ssim: f64,
    /// Mean LDR-FLIP.
    pub flip: f64,
    /// Share of the squared error, in [0, 1], in pixels that one asset covers and the other does not: what no map can
    /// mend.
    pub outline: f64,
    /// Luminance of the picture relative to that of the reference: linear, premultiplied, not clamped.
    pub luminance: f64,
}

impl Quality {
    /// The PSNR for people: with `digits` decimals, or `60 or more` where it is as large as is told apart.
    pub fn decibels(&self, digits: usize) -> String {
        if self.psnr >= BEST_PSNR {
            format!("{BEST_PSNR} or more")
        } else {
            format!("{:.digits$}", self.psnr)
        }
    }

    /// Means of the first two stages over views.
    pub(crate) fn of_two_stages(views: &[ReportView]) -> [Self; 2] {
        [0, 1].map(|k| Self::mean(views.iter().map(|v| &v.quality[k].quality)))
    }

    /// Mean over views; zero without any.
    pub fn mean<'a>(views: impl Iterator<Item = &'a Self>) -> Self {
        let (mut sum, mut n) = (Self::default(), 0.0);
        for q in views {
            sum.psnr += q.psnr;
            sum.ssim += q.ssim;
            sum.flip += q.flip;
            sum.outline += q.outline;
            sum.luminance += q.luminance;
            n += 1.0;
        }
        let n = f64::max(n, 1.0);
        Self {
            psnr: sum.psnr / n,
            ssim: sum.ssim / n,
            flip: sum.flip / n,
            outline: sum.outline / n,
            luminance: sum.luminance / n,
        }
    }
}

/// Quality of one candidate in one view.
#[derive(Clone, Debug)]
pub struct ViewQuality {
    /// Figures over the foreground.
    pub quality: Quality,
    /// Root of the mean squared error over the foreground, of sRGB values in [0, 1]. Of path traced pictures the square is an estimate
    /// for such without noise, or its standard error over the pixels where that is larger.
    pub rmse: f64,
    /// FLIP per pixel.
    pub flip: Image,
    /// Display picture (sRGB) of the candidate over grey.
    pub picture: Image,
}

/// One view of the judgement.
#[derive(Clone, Debug)]
pub struct ReportView {
    /// Display picture (sRGB) of the reference.
    pub reference: Image,
    /// Each stage against it, in their order.
    pub quality: Vec<ViewQuality>,
}

/// How the pictures of a judgement were made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Judged {
    /// All by the rasterizer.
    Rasterized,
    /// The stages by the rasterizer; the pictures of the reference are those that the fit had, of this other kind.
    RasterizedAgainst(ReferenceKind),
    /// All by the path tracer, extensions of materials included.
    PathTraced,
}

/// Who draws the pictures of a judgement.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum JudgeRenderer {
    /// The path tracer where materials need what the rasterizer lacks, else the rasterizer.
    #[default]
    Auto,
    /// The rasterizer, whatever the materials hold.
    Raster,
    /// The path tracer, whatever they hold.
    Path,
}

/// Path traced pictures of stages have the same noise, and that of the reference another: with the same, what has the reference's own
/// materials would be near it by its noise, too.
const OF_REFERENCE: u64 = 0;
const OF_STAGES: u64 = 1;

/// Divides the samples of a path traced pixel where stages are only put in order.
const CHOICE_COARSER: u32 = 4;

/// Views that are compared even after the user has stopped the work, who waits for these alone; fewer where they are path
/// traced, which takes long.
const AFTER_STOP: u64 = 2;
const TRACED_AFTER_STOP: u64 = 1;

/// A named asset on its way to the written file.
#[derive(Clone, Debug)]
pub struct Stage {
    /// Its name in tables.
    pub name: &'static str,
    /// The asset.
    pub scene: Scene,
    /// Whether it lies in the normalised frame; else in that of the reference.
    pub normalised: bool,
}

/// A stage that the rasterizer can draw.
struct Drawn<'a> {
    flat: FlatScene,
    library: SurfaceLibrary,
    animated: Animated<'a>,
}

impl Drawn<'_> {
    fn sampled(&self, samples: usize) -> Rasterized<'_> {
        Rasterized::new(&self.flat, &self.library).animated(&self.animated).sampled(samples)
    }
}

impl Stage {
    /// A stage in the frame of the reference.
    pub fn new(name: &'static str, scene: Scene) -> Self {
        Self { name, scene, normalised: false }
    }

    /// A mesh in the normalised frame with the reference's materials `scene.materials`.
    pub fn of_mesh(name: &'static str, scene: &Scene, mesh: &Mesh, triangle_material: &[u32]) -> Self {
        // Through a scene, so that tangents are made where a normal map needs them.
        let primitives = split_by_material(mesh, triangle_material, scene.materials.len());
        let place = |primitive| Instance { primitive, transform: glam::Affine3A::IDENTITY };
        let scene = Scene {
            instances: (0..primitives.len()).map(place).collect(),
            primitives,
            materials: placed_materials(scene),
            images: scene.images.clone(),
            ..Scene::default()
        };
        Self { name, scene, normalised: true }
    }

    /// The asset in the frame of the reference, as it is written.
    pub fn placed(&self, light: &LightAsset) -> Scene {
        let mut scene = Scene { name: light.name.clone(), ..self.scene.clone() };
        if self.normalised {
            let place = |p: &mut Vec3f| *p = light.frame.to_world(*p);
            scene.primitives.iter_mut().for_each(|p| p.mesh.positions.iter_mut().for_each(place));
        }
        scene
    }

    /// Runs `with` on the stage as the rasterizer draws it, with so many samples per axis of a pixel.
    pub(crate) fn rasterized<R>(
        &self,
        light: &LightAsset,
        samples: usize,
        with: impl FnOnce(&dyn Reference) -> R,
    ) -> R {
        with(&self.drawn(light).sampled(samples))
    }

    fn drawn(&self, light: &LightAsset) -> Drawn<'_> {
        let mut flat = self.scene.flatten();
        if !self.normalised {
            for p in &mut flat.mesh.positions {
                *p = light.frame.to_frame(*p);
            }
        }
        let library = SurfaceLibrary::new(&drawn(&self.scene));
        Drawn { flat, library, animated: self.animated(light) }
    }

    fn traced(&self, n: &Normalised, seed: u64) -> Result<PathTraced<'static>, FitError> {
        if self.normalised {
            PathTraced::in_frame(&self.scene, n, MaterialFeatures::All, seed)
        } else {
            PathTraced::new(&self.scene, n, MaterialFeatures::All, seed)
        }
    }
}

fn split_by_material(mesh: &Mesh, material: &[u32], count: usize) -> Vec<Primitive> {
    (0..count)
        .filter_map(|m| {
            let triangles: Vec<[u32; 3]> = mesh
                .triangles
                .iter()
                .zip(material)
                .filter(|(_, k)| **k as usize == m)
                .map(|(t, _)| *t)
                .collect();
            (!triangles.is_empty()).then(|| Primitive {
                mesh: Mesh { tangents: Vec::new(), ..part(mesh, triangles) },
                material: m,
            })
        })
        .collect()
}

/// Some triangles of a mesh with the vertices that they use.
fn part(mesh: &Mesh, mut triangles: Vec<[u32; 3]>) -> Mesh {
    let mut new = vec![u32::MAX; mesh.positions.len()];
    let mut source = Vec::new();
    for v in triangles.as_flattened_mut() {
        let at = &mut new[*v as usize];
        if *at == u32::MAX {
            *at = source.len() as u32;
            source.push(*v);
        }
        *v = *at;
    }
    Split { triangles, source }.apply(mesh)
}

/// What of a scene's visible materials the rasterizer does not draw, by name of the extension.
pub fn beyond_rasterizer(scene: &Scene) -> BTreeSet<&'static str> {
    visible_materials(scene).into_iter().flat_map(|m| scene.materials[m].acting_extensions()).collect()
}

/// The same with the number of materials that have each, and the number of all visible ones.
pub fn count_beyond_rasterizer(scene: &Scene) -> (BTreeMap<&'static str, usize>, usize) {
    let (visible, mut counts) = (visible_materials(scene), BTreeMap::new());
    for name in visible.iter().flat_map(|m| scene.materials[*m].acting_extensions()) {
        *counts.entry(name).or_insert(0) += 1;
    }
    (counts, visible.len())
}

/// The materials that something shows.
pub(crate) fn visible_materials(scene: &Scene) -> BTreeSet<usize> {
    scene.instances.iter().map(|i| scene.primitives[i.primitive].material).collect()
}

/// How to judge.
#[derive(Clone)]
pub struct Judge<'a> {
    /// The asset as it was read, with all that its file means.
    pub scene: &'a Scene,
    /// The same in the normalised frame.
    pub n: &'a Normalised,
    /// The reference as the fit had it. What is fitted to light between surfaces is judged by it, since its maps hold that
    /// light already.
    pub reference: &'a dyn Reference,
    /// Who draws.
    pub renderer: JudgeRenderer,
    /// Samples of a path traced pixel.
    pub spp: u32,
    /// Light of the views.
    pub lighting: &'a Lighting,
    /// Width and height of the pictures.
    pub size: usize,
    /// Samples per axis that the rasterizer takes of a pixel of the reference and of the stages.
    pub samples: [usize; 2],
    /// Seed of the views.
    pub seed: u64,
}

impl std::fmt::Debug for Judge<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let kind = self.reference.kind();
        f.debug_struct("Judge")
            .field("reference", &kind)
            .field("renderer", &self.renderer)
            .finish_non_exhaustive()
    }
}

impl Judge<'_> {
    /// How pictures of the reference and of `stages` are made.
    pub fn method(&self, stages: &[Stage]) -> Judged {
        self.method_and_reason(stages).0
    }

    /// The same, and why.
    pub(crate) fn method_and_reason(&self, stages: &[Stage]) -> (Judged, String) {
        let scenes = stages.iter().map(|s| &s.scene).chain([self.scene]);
        method(self.renderer, self.reference.kind(), &scenes.flat_map(beyond_rasterizer).collect())
    }

    /// Compares stages with the reference in the `views` views of a report; in fewer, but one at least, when the user stops
    /// it meanwhile.
    ///
    /// # Errors
    /// If a picture cannot be made.
    pub fn views(
        &self,
        stages: &[Stage],
        views: u64,
        progress: &dyn Progress,
    ) -> Result<Vec<ReportView>, FitError> {
        let method = self.method(stages);
        let size = if method == Judged::PathTraced { self.size.min(WIDEST_TRACED) } else { self.size };
        let orbit = Orbit::new(self.seed, self.lighting, size);
        let judge = |reference: &dyn Reference, stages: &[&dyn Reference]| {
            compared(reference, stages, &orbit, Set::Report, views, progress)
        };
        let n = self.n;
        if method == Judged::PathTraced {
            let (reference, traced) = self.traced(stages, self.spp)?;
            return judge(&reference, &traced.iter().map(|t| t as &dyn Reference).collect::<Vec<_>>());
        }
        let rasterized = Rasterized::new(&n.flat, &n.library).sampled(self.samples[0]);
        let as_fitted = matches!(method, Judged::RasterizedAgainst(_));
        let reference: &dyn Reference = if as_fitted { self.reference } else { &rasterized };
        rasterized_views(
            &n.light_asset,
            reference,
            stages,
            &orbit,
            Set::Report,
            views,
            self.samples[1],
            progress,
        )
    }

    /// The reference and stages through the path tracer.
    fn traced(
        &self,
        stages: &[Stage],
        spp: u32,
    ) -> Result<(PathTraced<'static>, Vec<PathTraced<'static>>), FitError> {
        let reference = PathTraced::new(self.scene, self.n, MaterialFeatures::All, self.seed)?;
        let reference = reference.sampled(spp).in_halves(OF_REFERENCE);
        let stages =
            stages.iter().map(|s| Ok(s.traced(self.n, self.seed)?.sampled(spp).in_halves(OF_STAGES)));
        Ok((reference, stages.collect::<Result<_, FitError>>()?))
    }

    /// [`ranking`] of stages in `count` held-out views or more, by pictures made as those of the report are ([`Self::method`]), but of
    /// fewer samples: a quarter of those of a path traced pixel, `samples` per axis of a rasterized one. They are of the size of the
    /// report, or rasterized and of all sizes
    /// from `smallest` pixels a side on ([`Orbit::smallest`]).
    ///
    /// # Errors
    /// If a picture cannot be made.
    pub fn ranking(
        &self,
        stages: &[Stage],
        (count, smallest): (u64, Option<usize>),
        samples: usize,
        progress: &dyn Progress,
    ) -> Result<Ranking, FitError> {
        let method = self.method(stages);
        let views = |size| Orbit { smallest, ..Orbit::new(self.seed, self.lighting, size) };
        // The path tracer reads the finest mip level alone: pictures of several sizes are rasterized.
        if method == Judged::PathTraced && smallest.is_none() {
            let (reference, traced) = self.traced(stages, self.spp.div_ceil(CHOICE_COARSER))?;
            let traced: Vec<&dyn Reference> = traced.iter().map(|t| t as &dyn Reference).collect();
            return ranking::all_rounds(
                &reference,
                &traced,
                &views(self.size.min(WIDEST_TRACED)),
                count,
                progress,
            );
        }
        let rasterized = Rasterized::new(&self.n.flat, &self.n.library);
        let rasterized = match smallest {
            Some(_) => rasterized.sampled_by_size(1),
            None => rasterized.sampled(self.samples[0]),
        };
        let holds_more = method == Judged::Rasterized && self.reference.kind().indirect_light;
        let reference: &dyn Reference = if holds_more { &rasterized } else { self.reference };
        ranking(&self.n.light_asset, reference, stages, &views(self.size), count, samples, progress)
    }
}

/// Compares stages, drawn by the rasterizer with `samples` samples per axis of a pixel, with a reference in `count` views
/// of a set.
///
/// # Errors
/// If a picture of the reference cannot be made.
pub fn rasterized_views(
    light: &LightAsset,
    reference: &dyn Reference,
    stages: &[Stage],
    views: &dyn Views,
    set: Set,
    count: u64,
    samples: usize,
    progress: &dyn Progress,
) -> Result<Vec<ReportView>, FitError> {
    let drawn: Vec<Drawn<'_>> = stages.iter().map(|s| s.drawn(light)).collect();
    let drawn: Vec<Rasterized<'_>> = drawn.iter().map(|d| d.sampled(samples)).collect();
    let drawn: Vec<&dyn Reference> = drawn.iter().map(|d| d as &dyn Reference).collect();
    compared(reference, &drawn, views, set, count, progress)
}

/// Compares pictures of several with those of a reference in `count` views of a set.
fn compared(
    reference: &dyn Reference,
    stages: &[&dyn Reference],
    views: &dyn Views,
    set: Set,
    count: u64,
    progress: &dyn Progress,
) -> Result<Vec<ReportView>, FitError> {
    let least = after_stop(stages);
    let mut out = Vec::new();
    for i in 0..count {
        progress.report("report", i, count, "");
        let stop = || i >= least && progress.is_cancelled();
        if stop() {
            break;
        }
        let s = views.setup(set, i, count);
        let picture = |of: &dyn Reference| of.picture_unless(&s, &stop);
        let Some(seen) = picture(reference)? else { break };
        let quality = stages.iter().map(|c| Ok(picture(*c)?.map(|p| picture_quality(&seen, &p))));
        // A view that was stopped half way counts for none.
        let Some(quality) = quality.collect::<Result<Option<_>, FitError>>()? else { break };
        out.push(ReportView { reference: display(&seen.image), quality });
    }
    Ok(out)
}

/// Views that are compared even after a stop.
fn after_stop(stages: &[&dyn Reference]) -> u64 {
    let traced = stages.iter().any(|s| s.kind().spp.is_some());
    if traced { TRACED_AFTER_STOP } else { AFTER_STOP }
}

/// Linear premultiplied RGBA as a display picture over grey.
fn display(rgba: &Image) -> Image {
    let grey = photofit_image::srgb_decode(BACKGROUND);
    let over = |p: &[f32]| [0, 1, 2].map(|k| p[k] + (1.0 - p[3]) * grey);
    let rgb: Vec<[f32; 3]> = rgba.data.chunks_exact(4).map(over).collect();
    to_display(&Image::from_data(rgba.width, rgba.height, 3, rgb.into_flattened()))
}

/// Sum of the luminance of a rendering relative to that of the reference; 1 for two black ones.
fn luminance_ratio(reference: &Image, candidate: &Image) -> f64 {
    let sum =
        |i: &Image| i.data.chunks_exact(4).map(|p| f64::from(luminance([p[0], p[1], p[2]]))).sum::<f64>();
    let (r, c) = (sum(reference), sum(candidate));
    if r > 0.0 || c > 0.0 { c / r.max(1e-12) } else { 1.0 }
}

/// How near two renderings are (linear premultiplied RGBA).
///
/// # Panics
/// If the sizes differ.
pub fn view_quality(reference: &Image, candidate: &Image) -> ViewQuality {
    let (r, c) = (display(reference), display(candidate));
    let squares = squared_error(&r, &c);
    quality((reference, r), (candidate, c), (&squares, false))
}

/// The same of pictures of references. Of those that were made in halves noise does not count in PSNR (of display values, and no
/// further than it can be told from an estimate); it does in SSIM and FLIP.
pub(crate) fn picture_quality(reference: &ReferencePicture, candidate: &ReferencePicture) -> ViewQuality {
    let (Some(r), Some(c)) = (&reference.halves, &candidate.halves) else {
        return view_quality(&reference.image, &candidate.image);
    };
    let [r1, r2] = r.each_ref().map(display);
    let [c1, c2] = c.each_ref().map(display);
    let squares = squared_error_of_halves([&r1, &r2], [&c1, &c2]);
    let shown = |p: &ReferencePicture| display(&p.image);
    let (reference, candidate) = ((&reference.image, shown(reference)), (&candidate.image, shown(candidate)));
    quality(reference, candidate, (&squares, true))
}

/// How near two renderings are, each of which is given linear and as it is shown. `squares` are the squared differences of each pixel, or
/// `estimated` ones, of what the pictures would be without noise.
fn quality(
    (reference, r): (&Image, Image),
    (candidate, c): (&Image, Image),
    (squares, estimated): (&ErrorMap, bool),
) -> ViewQuality {
    let coverages =
        || reference.data.chunks_exact(4).zip(candidate.data.chunks_exact(4)).map(|(a, b)| (a[3], b[3]));
    let covered: Vec<bool> = coverages().map(|(a, b)| a > 0.02 || b > 0.02).collect();
    let margin = (reference.width * MARGIN).div_ceil(SMALL).clamp(1, MARGIN);
    let mask = dilate(&covered, reference.width, reference.height, margin);
    let over = |m: Option<f64>| m.unwrap_or(0.0);
    let flip_map = flip(&r, &c, PIXELS_PER_DEGREE);
    let outline = coverages().zip(&squares.map.data).filter(|((a, b), _)| (a - b).abs() > OUTLINE);
    let at_outline: f64 = outline.map(|(_, e)| f64::from(*e)).sum();
    // An estimate tells no errors below its own, and may come out below zero.
    let least = if estimated { over(squares.standard_error_over(&mask)) } else { 0.0 };
    let pixels = mask.iter().filter(|m| **m).count() as f64;
    let everywhere = (squares.mean * squares.map.data.len() as f64).max(least * pixels);
    let mse = over(squares.mean_over(&mask)).max(least);
    let quality = Quality {
        psnr: psnr_from_mse(mse).min(BEST_PSNR),
        ssim: ssim(&r, &c).mean_over(&mask).unwrap_or(1.0).min(1.0),
        flip: over(flip_map.mean_over(&mask)),
        // Without a sign: an estimate may be below zero.
        outline: if everywhere > 0.0 { (at_outline / everywhere).clamp(0.0, 1.0).abs() } else { 0.0 },
        luminance: luminance_ratio(reference, candidate),
    };
    ViewQuality { quality, rmse: mse.sqrt(), flip: flip_map.map, picture: c }
}

#[cfg(test)]
mod tests;
