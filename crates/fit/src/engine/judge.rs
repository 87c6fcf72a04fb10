//! Quality of candidates on views and lights that no fit saw.

use super::reference::Painter;
use crate::candidate::Candidate;
use crate::scene_render::SceneRenderer;
use crate::simplify::{Normalised, SimplifyOptions, drawn, to_scene};
use crate::views::{Set, setup};
use crate::{FitError, Progress};
use photofit_geometry::Mesh;
use photofit_image::{Image, dilate, flip, psnr_from_mse, squared_error, ssim, to_display};
use photofit_scene::{FlatScene, Scene, SurfaceLibrary};

/// Grey behind the asset, sRGB.
const BACKGROUND: f32 = 0.5;
/// The foreground is grown by this many pixels.
const MARGIN: usize = 6;
/// Coverages of a pixel that differ by more than this are another outline.
const OUTLINE: f32 = 0.1;
/// Pixels per degree of the FLIP viewer.
const PIXELS_PER_DEGREE: f32 = 67.02;
/// Quality of equal pictures: what 8 bits can tell apart, rounded up.
const BEST_PSNR: f64 = 60.0;
/// Views by which the result is chosen.
const CHOICE_VIEWS: u64 = 4;
/// Samples per axis of a pixel.
const SUPERSAMPLE: usize = 4;

/// Mean quality over the foreground: the union of both silhouettes, dilated.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Quality {
    /// Peak signal to noise of sRGB images, decibels.
    pub psnr: f64,
    /// Structural similarity.
    pub ssim: f64,
    /// Mean LDR-FLIP.
    pub flip: f64,
    /// Share of the squared error, in [0, 1], in pixels that one asset covers and the other does not: what no map can
    /// mend.
    pub outline: f64,
}

impl Quality {
    /// Mean over views.
    pub fn mean<'a>(views: impl Iterator<Item = &'a ViewQuality>) -> Self {
        let (mut sum, mut n) = (Self::default(), 0.0);
        for v in views {
            sum.psnr += v.quality.psnr;
            sum.ssim += v.quality.ssim;
            sum.flip += v.quality.flip;
            sum.outline += v.quality.outline;
            n += 1.0;
        }
        let n = f64::max(n, 1.0);
        Self { psnr: sum.psnr / n, ssim: sum.ssim / n, flip: sum.flip / n, outline: sum.outline / n }
    }
}

/// Quality of one candidate in one view.
#[derive(Clone, Debug)]
pub struct ViewQuality {
    /// Figures over the foreground.
    pub quality: Quality,
    /// FLIP per pixel.
    pub flip: Image,
    /// Display picture (sRGB) of the candidate over grey.
    pub picture: Image,
}

/// One view of the report.
#[derive(Clone, Debug)]
pub struct ReportView {
    /// Display picture (sRGB) of the reference.
    pub reference: Image,
    /// Each candidate against it.
    pub quality: Vec<ViewQuality>,
}

/// A candidate ready to be rendered.
#[derive(Debug)]
pub(crate) struct Prepared {
    flat: FlatScene,
    library: SurfaceLibrary,
    normalised: bool,
}

impl Prepared {
    /// A candidate in the asset's frame.
    pub(crate) fn of_scene(scene: &Scene) -> Self {
        Self { flat: scene.flatten(), library: SurfaceLibrary::new(&drawn(scene)), normalised: false }
    }

    /// A candidate in the normalised frame with the reference's materials.
    pub(crate) fn of_flat(n: &Normalised, mesh: Mesh, triangle_material: Vec<u32>) -> Self {
        // Through a scene, so that tangents are made where a normal map needs them.
        let scene = Scene {
            primitives: split_by_material(&mesh, &triangle_material, n.materials.len()),
            materials: n.materials.clone(),
            images: n.images.clone(),
            ..Scene::default()
        };
        let instances = (0..scene.primitives.len())
            .map(|primitive| photofit_scene::Instance { primitive, transform: glam::Affine3A::IDENTITY })
            .collect();
        let scene = Scene { instances, ..scene };
        Self { flat: scene.flatten(), library: SurfaceLibrary::new(&scene), normalised: true }
    }
}

fn split_by_material(mesh: &Mesh, material: &[u32], count: usize) -> Vec<photofit_scene::Primitive> {
    (0..count)
        .filter_map(|m| {
            let triangles: Vec<[u32; 3]> = mesh
                .triangles
                .iter()
                .zip(material)
                .filter(|(_, k)| **k as usize == m)
                .map(|(t, _)| *t)
                .collect();
            (!triangles.is_empty()).then(|| photofit_scene::Primitive {
                mesh: Mesh { triangles, tangents: Vec::new(), ..mesh.clone() },
                material: m,
            })
        })
        .collect()
}

/// Renders the reference and the candidates and compares them.
pub(crate) fn evaluate(
    n: &Normalised,
    painter: &Painter<'_>,
    candidates: &[Prepared],
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<Vec<ReportView>, FitError> {
    let size = options.resolution;
    let candidates: Vec<InFrame<'_>> = candidates.iter().map(|c| InFrame::new(c, n)).collect();
    (0..options.report_views)
        .map(|i| {
            progress.report("report", i, options.report_views, "");
            let s = setup(Set::Report, i, options.report_views, options.seed, &options.lighting);
            let lights = s.lights.lights();
            let render = |flat: &FlatScene, library: &SurfaceLibrary| {
                SceneRenderer::new(flat, library).render(&s.camera, &lights, size, size, SUPERSAMPLE)
            };
            let reference = painter.picture(&s, size)?;
            let quality =
                candidates.iter().map(|c| compare(&reference, &render(&c.flat, c.library))).collect();
            Ok(ReportView { reference: display(&reference), quality })
        })
        .collect()
}

/// The candidate with the best pictures in the held-out views: PSNR and FLIP, both in decibels, count the same. The
/// first wins a tie.
pub(crate) fn best_of(
    n: &Normalised,
    painter: &Painter<'_>,
    candidates: [Candidate; 3],
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<Candidate, FitError> {
    let size = options.resolution;
    let scenes = candidates.each_ref().map(|c| Prepared::of_scene(&to_scene(c, n, "")));
    let scenes = scenes.each_ref().map(|c| InFrame::new(c, n));
    let mut score = [0.0; 3];
    for i in 0..CHOICE_VIEWS {
        progress.report("choose", i, CHOICE_VIEWS, "");
        let s = setup(Set::HeldOut, i, CHOICE_VIEWS, options.seed, &options.lighting);
        let lights = s.lights.lights();
        let render = |flat: &FlatScene, library: &SurfaceLibrary| {
            SceneRenderer::new(flat, library).render(&s.camera, &lights, size, size, SUPERSAMPLE)
        };
        let reference = painter.picture(&s, size)?;
        for (score, c) in score.iter_mut().zip(&scenes) {
            let q = compare(&reference, &render(&c.flat, c.library)).quality;
            *score += q.psnr - 20.0 * q.flip.max(1e-6).log10();
        }
    }
    let best = (0..3).fold(0, |best, k| if score[k] > score[best] { k } else { best });
    let [a, b, c] = candidates;
    Ok([a, b, c].into_iter().nth(best).expect("one of three"))
}

/// A candidate in the normalised frame.
struct InFrame<'a> {
    flat: FlatScene,
    library: &'a SurfaceLibrary,
}

impl<'a> InFrame<'a> {
    fn new(c: &'a Prepared, n: &Normalised) -> Self {
        let mut flat = c.flat.clone();
        if !c.normalised {
            for p in &mut flat.mesh.positions {
                *p = (*p - n.center) / n.radius;
            }
        }
        Self { flat, library: &c.library }
    }
}

/// Linear premultiplied RGBA as a display picture over grey.
fn display(rgba: &Image) -> Image {
    let grey = photofit_image::srgb_decode(BACKGROUND);
    let over = |p: &[f32]| [0, 1, 2].map(|k| p[k] + (1.0 - p[3]) * grey);
    let rgb: Vec<[f32; 3]> = rgba.data.chunks_exact(4).map(over).collect();
    to_display(&Image::from_data(rgba.width, rgba.height, 3, rgb.into_flattened()))
}

/// Compares two renderings (linear premultiplied RGBA).
///
/// # Panics
/// If the sizes differ.
pub fn compare(reference: &Image, candidate: &Image) -> ViewQuality {
    let (r, c) = (display(reference), display(candidate));
    let coverages =
        || reference.data.chunks_exact(4).zip(candidate.data.chunks_exact(4)).map(|(a, b)| (a[3], b[3]));
    let covered: Vec<bool> = coverages().map(|(a, b)| a > 0.02 || b > 0.02).collect();
    let mask = dilate(&covered, reference.width, reference.height, MARGIN);
    let over = |m: Option<f64>| m.unwrap_or(0.0);
    let flip_map = flip(&r, &c, PIXELS_PER_DEGREE);
    let squares = squared_error(&r, &c);
    let outline = coverages().zip(&squares.map.data).filter(|((a, b), _)| (a - b).abs() > OUTLINE);
    let at_outline: f64 = outline.map(|(_, e)| f64::from(*e)).sum();
    let everywhere = squares.mean * squares.map.data.len() as f64;
    let quality = Quality {
        psnr: psnr_from_mse(over(squares.mean_over(&mask))).min(BEST_PSNR),
        ssim: ssim(&r, &c).mean_over(&mask).unwrap_or(1.0),
        flip: over(flip_map.mean_over(&mask)),
        outline: if everywhere > 0.0 { at_outline / everywhere } else { 0.0 },
    };
    ViewQuality { quality, flip: flip_map.map, picture: c }
}
