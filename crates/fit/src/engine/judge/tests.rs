//! What the judge sees, and by whose pictures.

use super::*;
use crate::Silent;
use crate::engine::reference::SUPERSAMPLE;
use photofit_geometry::shapes::icosphere;
use photofit_scene::{Clearcoat, Extensions, Material, Sheen, Specular, Transmission};

/// A black sphere with what `extensions` say.
fn sphere(extensions: Option<Extensions>) -> Scene {
    let material = Material {
        base_color: [0.02, 0.02, 0.02, 1.0],
        roughness: 0.9,
        extensions: extensions.map(Box::new),
        ..Material::clay()
    };
    Scene {
        primitives: vec![Primitive { mesh: icosphere(12), material: 0 }],
        instances: vec![Instance { primitive: 0, transform: glam::Affine3A::IDENTITY }],
        materials: vec![material],
        ..Scene::default()
    }
}

fn psnr(reference: &Scene, stages: Vec<Scene>) -> (Judged, Vec<f64>) {
    judged(reference, stages, JudgeRenderer::Auto, 64)
}

fn judged(reference: &Scene, stages: Vec<Scene>, renderer: JudgeRenderer, spp: u32) -> (Judged, Vec<f64>) {
    let n = Normalised::new(reference).unwrap();
    let judge = Judge {
        scene: reference,
        n: &n,
        reference: &Rasterized::new(&n.flat, &n.library),
        renderer,
        spp,
        lighting: &Lighting::Mixed,
        size: 48,
        samples: [SUPERSAMPLE; 2],
        seed: 0,
    };
    let stages: Vec<Stage> = stages.into_iter().map(|s| Stage::new("stage", s)).collect();
    let views = judge.views(&stages, 2, &Silent).unwrap();
    let mean = |k: usize| views.iter().map(|v| v.quality[k].quality.psnr).sum::<f64>() / 2.0;
    (judge.method(&stages), (0..stages.len()).map(mean).collect())
}

#[test]
fn a_brighter_asset_has_the_luminance_ratio_of_its_light() {
    // Half of the picture is empty.
    let grey = |x: f32| Image::from_data(2, 2, 4, [x, x, x, 1.0, 0.0, 0.0, 0.0, 0.0].repeat(2));
    let ratio = |a: f32, b: f32| view_quality(&grey(a), &grey(b)).quality.luminance;
    assert!((ratio(0.2, 0.3) - 1.5).abs() < 1e-4 && (ratio(0.4, 0.1) - 0.25).abs() < 1e-4);
    assert!((ratio(0.5, 3.0) - 6.0).abs() < 1e-4, "highlights count");
}

#[test]
fn a_lost_extension_is_seen() {
    let velvet = Extensions {
        sheen: Some(Sheen { color: [0.2, 0.3, 1.0], roughness: 0.4, ..Sheen::default() }),
        ..Extensions::default()
    };
    let coated = Extensions {
        clearcoat: Some(Clearcoat { factor: 1.0, ..Clearcoat::default() }),
        ..Extensions::default()
    };
    let dull = Extensions {
        specular: Some(Specular { factor: 0.0, ..Specular::default() }),
        ..Extensions::default()
    };
    let glass = Extensions {
        transmission: Some(Transmission { factor: 1.0, texture: None }),
        ..Extensions::default()
    };
    for extensions in [velvet, coated, dull, glass] {
        let names = extensions.names();
        let kept = sphere(Some(extensions));
        let (method, psnr) = psnr(&kept, vec![kept.clone(), sphere(None)]);
        assert_eq!(method, Judged::PathTraced);
        let found = psnr[0] > psnr[1] + 10.0 && psnr[1] < 35.0;
        assert!(found, "{names:?}: kept {}, lost {}", psnr[0], psnr[1]);
    }
    assert_eq!(psnr(&sphere(None), vec![sphere(None)]), (Judged::Rasterized, vec![BEST_PSNR]));
}

#[test]
fn the_renderer_of_the_judge_can_be_chosen() {
    let coat = Clearcoat { factor: 1.0, ..Clearcoat::default() };
    let coated = sphere(Some(Extensions { clearcoat: Some(coat), ..Extensions::default() }));
    // The rasterizer draws no coats, and so sees no difference.
    let raster = judged(&coated, vec![sphere(None)], JudgeRenderer::Raster, 8);
    assert_eq!(raster, (Judged::Rasterized, vec![BEST_PSNR]));
    let (method, few) = judged(&coated, vec![sphere(None)], JudgeRenderer::Auto, 8);
    assert!(method == Judged::PathTraced && few[0] < 35.0, "{few:?}");
    let path = judged(&sphere(None), vec![sphere(None)], JudgeRenderer::Path, 8);
    assert_eq!(path.0, Judged::PathTraced);
}

#[test]
fn stages_are_put_in_order_by_the_pictures_of_the_report() {
    let coat = Clearcoat { factor: 1.0, ..Clearcoat::default() };
    let coated = sphere(Some(Extensions { clearcoat: Some(coat), ..Extensions::default() }));
    // The same core without its coat; and a coat over a core that differs a little.
    let mut other = coated.clone();
    other.materials[0].base_color = [0.03, 0.02, 0.02, 1.0];
    let stages = [sphere(None), other].map(|s| Stage::new("stage", s));
    let n = Normalised::new(&coated).unwrap();
    let rasterized = Rasterized::new(&n.flat, &n.library);
    let judge = Judge {
        scene: &coated,
        n: &n,
        reference: &rasterized,
        renderer: JudgeRenderer::Auto,
        spp: 32,
        lighting: &Lighting::Mixed,
        size: 32,
        samples: [SUPERSAMPLE; 2],
        seed: 0,
    };
    for (renderer, wanted) in [(JudgeRenderer::Auto, 1), (JudgeRenderer::Path, 1), (JudgeRenderer::Raster, 0)]
    {
        let judge = Judge { renderer, ..judge.clone() };
        let ranking = judge.ranking(&stages, (2, None), 2, &Silent).unwrap();
        let shown = judge.views(&stages, 2, &Silent).unwrap();
        let psnr = |k: usize| shown.iter().map(|v| v.quality[k].quality.psnr).sum::<f64>();
        assert_eq!(ranking.best(), wanted, "{renderer:?}: {ranking:?}");
        assert!(psnr(wanted) > psnr(1 - wanted), "{renderer:?}: the report agrees");
    }
    // Where the report is rasterized, the pictures of a fit to all light have no say.
    let lit = PathTraced::new(&coated, &n, MaterialFeatures::All, 0).unwrap().sampled(4);
    let judge = Judge { reference: &lit, renderer: JudgeRenderer::Raster, ..judge };
    assert_eq!(judge.ranking(&stages, (2, None), 2, &Silent).unwrap().best(), 0);
}

#[test]
fn what_is_fitted_to_all_light_is_judged_by_the_pictures_of_its_fit() {
    // Its maps hold the shadows: a path traced judgement would cast them again, extensions or not.
    let coat = Clearcoat { factor: 1.0, ..Clearcoat::default() };
    let coated = sphere(Some(Extensions { clearcoat: Some(coat), ..Extensions::default() }));
    let n = Normalised::new(&coated).unwrap();
    let fitted_to = PathTraced::new(&coated, &n, MaterialFeatures::Core, 3).unwrap().sampled(4);
    let judge = Judge {
        scene: &coated,
        n: &n,
        reference: &fitted_to,
        renderer: JudgeRenderer::Auto,
        spp: 1,
        lighting: &Lighting::Mixed,
        size: 32,
        samples: [SUPERSAMPLE; 2],
        seed: 3,
    };
    let stages = [Stage::new("stage", coated.clone())];
    let kind = ReferenceKind::path_traced(4);
    assert_eq!((judge.method(&stages), fitted_to.kind()), (Judged::RasterizedAgainst(kind), kind));
    let shown = judge.views(&stages, 1, &Silent).unwrap();
    let s = Orbit::new(3, &Lighting::Mixed, 32).setup(Set::Report, 0, 1);
    // With the samples of the fit, whatever those of the judge are.
    assert!(shown[0].reference == display(&fitted_to.picture(&s).unwrap().image));
    let asked = Judge { renderer: JudgeRenderer::Path, ..judge };
    assert_eq!(asked.method(&stages), Judged::PathTraced);
}

#[test]
fn a_capped_psnr_is_told_as_such() {
    let told = |psnr: f64| Quality { psnr, ..Quality::default() }.decibels(2);
    assert_eq!((told(60.0).as_str(), told(59.994).as_str()), ("60 or more", "59.99"));
}

#[test]
fn rmse_goes_below_what_the_psnr_tells_apart() {
    let grey = |x: f32| Image::from_data(2, 2, 4, [x, x, x, 1.0].repeat(4));
    let compared = view_quality(&grey(0.5), &grey(0.5001));
    assert_eq!(compared.quality.psnr.to_bits(), BEST_PSNR.to_bits());
    let e = |x: f32| f64::from(photofit_image::srgb_encode(x));
    assert!((compared.rmse / (e(0.5001) - e(0.5)) - 1.0).abs() < 1e-2, "{}", compared.rmse);
}

/// Of pictures in halves the product of both differences counts, down to its standard error.
#[test]
fn the_error_of_halves_is_that_without_their_noise() {
    let picture = |of: &dyn Fn(usize) -> f32| {
        let texels = (0..64).flat_map(|k| [of(k), of(k), of(k), 1.0]).collect();
        Image::from_data(8, 8, 4, texels)
    };
    let decoded = photofit_image::srgb_decode;
    // Display values: grey, off by `off`, with noise that halves have with opposite signs.
    let halves = |off: f32, noise: f32| {
        let sign = |k: usize| if k.is_multiple_of(2) { 1.0 } else { -1.0 };
        let half = |s: f32| picture(&|k| decoded(0.5 + off + s * sign(k) * noise));
        let halves = [half(1.0), half(-1.0)];
        let image = picture(&|_| decoded(0.5 + off));
        ReferencePicture { image, noise: None, halves: Some(Box::new(halves)) }
    };
    let of =
        |reference: &ReferencePicture, candidate: &ReferencePicture| picture_quality(reference, candidate);
    // (off + noise) (off - noise): noise with the same sign in both halves of one picture alone would add to it.
    let plain = of(&halves(0.0, 0.0), &halves(0.1, 0.0)).rmse;
    assert!((plain - 0.1).abs() < 1e-5, "{plain}");
    let noisy = of(&halves(0.0, 0.0), &halves(0.1, 0.06)).rmse;
    assert!((noisy - f64::sqrt(0.1 * 0.1 - 0.06 * 0.06)).abs() < 1e-4, "{noisy}");
    // Below zero, all alike: no spread, no error that could be told; nothing divides by zero.
    let none = of(&halves(0.0, 0.0), &halves(0.0, 0.06));
    assert!(none.rmse < 1e-4 && none.quality.psnr >= BEST_PSNR && none.quality.outline == 0.0, "{none:?}");
    // Where products differ from pixel to pixel, the error is that of their mean.
    let uneven = |s: f32| picture(&|k| decoded(0.5 + s * if k < 16 { 0.08 } else { 0.0 }));
    let uneven = ReferencePicture { halves: Some(Box::new([uneven(1.0), uneven(-1.0)])), ..halves(0.0, 0.0) };
    let (quarter, all) = (0.08_f64.powi(2), 64.0);
    let variance = quarter * quarter * 0.25 * 0.75 * all / (all - 1.0);
    let least = of(&halves(0.0, 0.0), &uneven).rmse;
    assert!((least / (variance / all).sqrt().sqrt() - 1.0).abs() < 1e-3, "{least}");
}

/// Asks for the stop while the first picture of view `view` is made, in reports and choices.
struct StopsWithin {
    view: u64,
    asked: std::sync::Mutex<Option<u32>>,
}

impl Progress for StopsWithin {
    fn report(&self, stage: &'static str, done: u64, _: u64, _: &str) {
        if ["report", "choose"].contains(&stage) && done == self.view {
            *self.asked.lock().unwrap() = Some(0);
        }
    }

    fn is_cancelled(&self) -> bool {
        let mut asked = self.asked.lock().unwrap();
        // The first question comes before the view begins.
        asked.as_mut().is_some_and(|n| std::mem::replace(n, *n + 1) > 0)
    }
}

#[test]
fn a_stop_within_a_path_traced_view_does_not_wait_for_it() {
    let scene = sphere(None);
    let n = Normalised::new(&scene).unwrap();
    let judge = Judge {
        scene: &scene,
        n: &n,
        reference: &Rasterized::new(&n.flat, &n.library),
        renderer: JudgeRenderer::Path,
        spp: 4,
        lighting: &Lighting::Mixed,
        size: 32,
        samples: [SUPERSAMPLE; 2],
        seed: 0,
    };
    let stages = [Stage::new("stage", scene.clone())];
    for view in [1, 2] {
        let progress = StopsWithin { view, asked: std::sync::Mutex::default() };
        let whole = judge.views(&stages, 4, &progress).unwrap();
        assert_eq!(whole.len() as u64, view, "the view at work is dropped, those before count");
    }
    // One view there must be: the first is finished.
    let at_once = || StopsWithin { view: u64::MAX, asked: std::sync::Mutex::new(Some(1)) };
    assert_eq!(judge.views(&stages, 4, &at_once()).unwrap().len(), 1);
    // A choice, too, does not wait for the view at work.
    let mut other = scene.clone();
    other.materials[0].base_color = [0.1, 0.02, 0.02, 1.0];
    let stages = [Stage::new("stage", other)];
    let ranking = |progress: &dyn Progress| judge.ranking(&stages, (4, None), 2, progress).unwrap();
    let within = |view| ranking(&StopsWithin { view, asked: std::sync::Mutex::default() });
    let first = ranking(&at_once());
    assert_eq!(within(1), first);
    assert_ne!(within(2), first, "the second view counts");
}

/// What has the reference's own materials is no nearer to it by the noise of its pictures than what looks the same otherwise.
#[test]
fn no_stage_shares_the_noise_of_the_reference() {
    let coat = |roughness| Extensions {
        clearcoat: Some(Clearcoat { factor: 1.0, roughness, ..Clearcoat::default() }),
        ..Extensions::default()
    };
    let (asset, other) = (sphere(Some(coat(0.3))), sphere(Some(coat(0.9))));
    let n = Normalised::new(&asset).unwrap();
    let judge = Judge {
        scene: &asset,
        n: &n,
        reference: &Rasterized::new(&n.flat, &n.library),
        renderer: JudgeRenderer::Auto,
        spp: 8,
        lighting: &Lighting::Mixed,
        size: 64,
        samples: [SUPERSAMPLE; 2],
        seed: 0,
    };
    let stages = [asset.clone(), other].map(|s| Stage::new("stage", s));
    let moments = judge.at_moments(&stages, &[], 4, &Silent).unwrap();
    for views in [judge.views(&stages, 4, &Silent).unwrap(), moments] {
        let means = Quality::of_two_stages(&views);
        let [same, other] = means.map(|q| (q.psnr, q.flip));
        let plain =
            views.iter().map(|v| photofit_image::psnr(&v.reference, &v.quality[0].picture)).sum::<f64>()
                / 4.0;
        assert!(same.1 > 1e-3 && plain < 45.0, "its pictures are of other samples: {same:?}, {plain}");
        assert!(same.0 > plain + 6.0, "their noise is no error: {same:?}, {plain}");
        assert!(same.0 > other.0 + 6.0 && same.1 < other.1, "{same:?} {other:?}");
    }
}
