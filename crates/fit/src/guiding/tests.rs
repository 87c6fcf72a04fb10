//! Guided renders: unbiased at every stage, reproducible, off where it is no use.

use super::pilot::Path;
use super::*;
use glam::Vec3;
use photofit_flow::Query;
use photofit_geometry::shapes::parallelogram;
use photofit_pathtrace::{EnvironmentMap, Material, MaterialValue, Parameter, Parts, Shape, View, World};
use photofit_scalar::{Vec3f, vec3};
use photofit_scene::Camera;
use photofit_shading::bsdf::{Bsdf, Diffuse};
use std::cell::Cell;

pub(super) fn grey(v: f32) -> Material {
    Material::new(Bsdf::Diffuse(Diffuse { reflectance: Vec3f::splat(v) }))
}

/// A closed room under an even sky that is seen through one gap in its far wall.
pub(super) fn rooms() -> World {
    World::new(two_rooms()).unwrap()
}

/// Its parts.
pub(super) fn two_rooms() -> Parts {
    let (y, z) = (vec3(0.0, 1.0, 0.0), vec3(0.0, 0.0, 1.0));
    let o = vec3(-1.0, 0.0, -0.5);
    // The far wall around the gap.
    room(&[
        (o, y * 0.3, z),
        (o + y * 0.7, y * 0.3, z),
        (o + y * 0.3, y * 0.4, z * 0.3),
        (o + y * 0.3 + z * 0.7, y * 0.4, z * 0.3),
    ])
}

/// A room under an even sky, closed but for its far wall.
fn room(wall: &[(Vec3f, Vec3f, Vec3f)]) -> Parts {
    let sky = Some(EnvironmentMap::constant(Vec3f::splat(10.0)));
    let mut parts = Parts { environment: sky, ..Parts::default() };
    let (x, y, z) = (vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0), vec3(0.0, 0.0, 1.0));
    let o = vec3(-1.0, 0.0, -0.5);
    let others =
        [(o, z, x * 2.0), (o + y, x * 2.0, z), (o, x * 2.0, y), (o + z, y, x * 2.0), (o + x * 2.0, z, y)];
    for (corner, a, b) in others.iter().chain(wall) {
        parts.add(Shape::Mesh(parallelogram(*corner, *a, *b)), grey(0.5));
    }
    parts
}

/// A camera in the room.
pub(super) fn inside() -> View {
    let eye = Vec3::new(0.15, 0.5, 0.4);
    View::pinhole(&Camera::look_at(eye, Vec3::new(0.9, 0.4, -0.3), Vec3::Y, 1.2, 1.0, 0.01, 10.0))
}

/// A floor under an even sky: nothing to learn.
pub(super) fn open() -> World {
    let mut parts = Parts::default();
    parts.add(
        Shape::Mesh(parallelogram(vec3(-1.0, 0.0, -1.0), vec3(0.0, 0.0, 2.0), vec3(2.0, 0.0, 0.0))),
        grey(0.5),
    );
    parts.environment = Some(EnvironmentMap::constant(Vec3f::splat(1.0)));
    World::new(parts).unwrap()
}

pub(super) fn options(side: usize, spp: u32, seed: u64) -> RenderOptions {
    let mut options = RenderOptions { width: side, height: side, spp, seed, ..RenderOptions::default() };
    options.path.max_depth = 8;
    options
}

pub(super) fn small(guiding: Guiding) -> GuidingOptions {
    GuidingOptions { side: 32, least_gain: 0.0, ..GuidingOptions::new(guiding) }
}

/// Mean luminance of a picture and its standard error by the variance of samples.
fn mean(renderer: &Renderer<'_>, spp: u32) -> (f64, f64) {
    let (picture, variance) = (renderer.picture(), renderer.sample_variance());
    let n = picture.pixels() as f64;
    let sum = picture.data.chunks_exact(4).map(|p| f64::from(p[1])).sum::<f64>();
    let spread = variance.data.chunks_exact(3).map(|p| f64::from(p[1])).sum::<f64>();
    (sum / n, (spread / f64::from(spp)).sqrt() / n)
}

fn rendered<'a>(world: &'a World, guidance: &Guidance, seed: u64, spp: u32) -> Renderer<'a> {
    let mut renderer = Renderer::new(world, &inside(), options(24, spp, seed)).unwrap();
    while !guidance.pass(&mut renderer, || false).done {}
    renderer
}

#[test]
fn guided_pictures_are_unbiased_at_every_stage() {
    let world = rooms();
    let spp = 512;
    let plain = rendered(&world, &Guidance::off(), 1, spp);
    let (expected, error) = mean(&plain, spp);
    for guiding in [Guiding::Flow, Guiding::Lobes] {
        for rounds in [1, 2, 5] {
            let stage = GuidingOptions { rounds, ..small(guiding) };
            let renderer = Renderer::new(&world, &inside(), options(24, spp, 2)).unwrap();
            let guidance = Guidance::train(&renderer, &stage, || false).unwrap();
            let guided = rendered(&world, &guidance, 2, spp);
            let (found, own) = mean(&guided, spp);
            let z = (found - expected) / (error * error + own * own).sqrt();
            assert!(z.abs() < 4.0, "{guiding:?}, {rounds} rounds: {found} +- {own}, {expected} +- {error}");
            let report = guidance.report().unwrap();
            assert!(report.used && report.records > 0 && report.gain.is_finite(), "{}", report.sentence());
            assert!(guided.picture().data != plain.picture().data, "{guiding:?}: other directions");
        }
    }
}

/// Mean and standard error of independent estimates.
fn mean_of(estimates: &[f64]) -> (f64, f64) {
    let n = estimates.len() as f64;
    let mean = estimates.iter().sum::<f64>() / n;
    let squares = estimates.iter().map(|e| (e - mean).powi(2)).sum::<f64>();
    (mean, (squares / (n * (n - 1.0))).sqrt())
}

#[test]
fn guided_gradients_are_the_differences_of_pictures() {
    const SIDE: usize = 12;
    const STEP: f32 = 0.02;
    const ESTIMATES: u64 = 12;
    let mut world = rooms();
    let materials = (0..9).collect();
    let parameters =
        [Parameter::Material { materials, value: MaterialValue::Reflectance }, Parameter::Environment];
    // Weights of a loss that is no mean.
    let weights = Image::from_fn(SIDE, SIDE, 3, |x, y, c| {
        photofit_sampling::unit_f32(
            (photofit_sampling::hash(7, (y * SIDE + x) as u64, c as u64) >> 32) as u32,
        )
    });
    // Central differences of the loss, of the red of both, with the same numbers on both sides.
    let plain: Vec<(f64, f64)> = {
        let loss = |world: &World, seed: u64| {
            let mut renderer = Renderer::new(world, &inside(), options(SIDE, 256, seed)).unwrap();
            renderer.finish();
            let picture = renderer.picture();
            let pixels = picture.data.chunks_exact(4).zip(weights.data.chunks_exact(3));
            pixels.map(|(p, w)| (0..3).map(|c| f64::from(p[c] * w[c])).sum::<f64>()).sum::<f64>()
        };
        let one = |p: &Parameter| {
            let start = world.parameter(p).unwrap();
            let step = f64::from(STEP * start[0]);
            let mut at = |sign: f64, seed: u64| {
                let mut moved = start.clone();
                moved[0] += (sign * step) as f32;
                world.set_parameter(p, &moved).unwrap();
                let loss = loss(&world, seed);
                world.set_parameter(p, &start).unwrap();
                loss
            };
            let estimate = |k: u64| (at(1.0, 100 + k) - at(-1.0, 100 + k)) / (2.0 * step);
            mean_of(&(0..ESTIMATES).map(estimate).collect::<Vec<_>>())
        };
        parameters.iter().map(one).collect()
    };
    for guiding in [Guiding::Flow, Guiding::Lobes] {
        let guidance = {
            let world = rooms();
            let renderer = Renderer::new(&world, &inside(), options(24, 4, 2)).unwrap();
            Guidance::train(&renderer, &small(guiding), || false).unwrap()
        };
        assert!(guidance.is_on());
        let world = rooms();
        let adjoint = Adjoint::new(&world, &inside(), options(SIDE, 1, 3), &parameters).unwrap();
        let estimates: Vec<Gradient> = (0..ESTIMATES)
            .map(|k| {
                let samples = GradientSamples { spp: 128, seed: Some(k) };
                let found = guidance.gradient(&adjoint, &weights, samples).unwrap();
                assert!(found.residual < 1e-6 && found.not_finite == 0, "{guiding:?}: {}", found.residual);
                found
            })
            .collect();
        for k in 0..parameters.len() {
            let reds: Vec<f64> = estimates.iter().map(|g| g.parameters[k].values[0]).collect();
            let (found, own) = mean_of(&reds);
            let (expected, error) = plain[k];
            let sigma = error.hypot(own);
            let told = format!("{guiding:?} {k}: {found} +- {own}, {expected} +- {error}");
            assert!((found - expected).abs() < 4.5 * sigma, "{told}");
            assert!(sigma < 0.1 * expected.abs(), "{told} says nothing");
        }
        let other = adjoint.render_vjp(&weights, GradientSamples { spp: 128, seed: Some(0) }).unwrap();
        assert!(other != estimates[0], "{guiding:?}: other directions");
    }
}

#[test]
fn a_guide_learns_from_several_cameras() {
    let world = rooms();
    let back = {
        let eye = Vec3::new(-0.2, 0.5, 0.0);
        View::pinhole(&Camera::look_at(eye, Vec3::new(-0.9, 0.4, 0.1), Vec3::Y, 1.2, 1.0, 0.01, 10.0))
    };
    for guiding in [Guiding::Flow, Guiding::Lobes] {
        let trained = |views: &[View]| {
            let renderer = |v: &View| Renderer::new(&world, v, options(16, 4, 2)).unwrap();
            let renderers: Vec<Renderer<'_>> = views.iter().map(renderer).collect();
            let stage = GuidingOptions { side: 16, rounds: 3, ..small(guiding) };
            Guidance::train_over(&renderers, &stage, || false).unwrap().report().unwrap().clone()
        };
        let (one, two) = (trained(&[inside()]), trained(&[inside(), back]));
        assert_eq!(two.paths, 2 * one.paths, "{guiding:?}");
        assert!(two.records > one.records && two.gain.is_finite(), "{guiding:?}: {one:?} {two:?}");
    }
    assert!(!Guidance::train_over(&[], &small(Guiding::Flow), || false).unwrap().is_on());
}

#[test]
fn training_and_pictures_have_the_same_bits_for_any_number_of_threads() {
    let world = rooms();
    for guiding in [Guiding::Flow, Guiding::Lobes] {
        let bits = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let renderer = Renderer::new(&world, &inside(), options(24, 4, 2)).unwrap();
                let stage = GuidingOptions { rounds: 3, ..small(guiding) };
                let guidance = Guidance::train(&renderer, &stage, || false).unwrap();
                rendered(&world, &guidance, 2, 4).picture().data
            })
        };
        assert!(bits(1) == bits(3), "{guiding:?}: other bits with other threads");
    }
}

#[test]
fn a_guide_that_does_not_pay_switches_itself_off() {
    let world = open();
    let view = {
        let eye = Vec3::new(0.0, 1.0, 2.0);
        View::pinhole(&Camera::look_at(eye, Vec3::ZERO, Vec3::Y, 0.8, 1.0, 0.01, 10.0))
    };
    for guiding in [Guiding::Flow, Guiding::Lobes] {
        let renderer = Renderer::new(&world, &view, options(16, 4, 1)).unwrap();
        let stage = GuidingOptions { side: 16, rounds: 3, ..GuidingOptions::new(guiding) };
        let guidance = Guidance::train(&renderer, &stage, || false).unwrap();
        let report = guidance.report().unwrap();
        assert!(!report.used && guidance.trained.is_none(), "{}", report.sentence());
        let mut again = Renderer::new(&world, &view, options(16, 4, 1)).unwrap();
        let mut plain = Renderer::new(&world, &view, options(16, 4, 1)).unwrap();
        while !guidance.pass(&mut again, || false).done {}
        while !plain.pass(|| false).done {}
        assert!(again.picture().data == plain.picture().data, "the picture is that of no guide");
    }
}

/// Work of training and pilot run, in paths of the picture.
fn work(stage: &GuidingOptions, paths: u64, pixels: u64) -> f64 {
    // The first round is walked without a guide.
    pixels as f64 + (paths - pixels) as f64 * stage.guiding.single_cost()
}

#[test]
fn training_is_a_part_of_the_picture() {
    for (guiding, side, spp, trained, rounds) in [
        (Guiding::Lobes, 96, 16, 24, 3),
        (Guiding::Lobes, 96, 64, 48, 3),
        (Guiding::Lobes, 96, 256, 96, 3),
        (Guiding::Lobes, 96, 1024, 96, 5),
        (Guiding::Lobes, 96, 4096, 96, 7),
        (Guiding::Lobes, 960, 16, 96, 6),
        (Guiding::Lobes, 16, 16, 24, 3),
        (Guiding::Lobes, 16, 256, 96, 3),
        (Guiding::Flow, 96, 64, 24, 3),
        (Guiding::Flow, 960, 64, 96, 6),
    ] {
        let found = GuidingOptions::for_picture(guiding, &options(side, spp, 0));
        let told = format!("{guiding:?}, {side} pixels, {spp} samples: {found:?}");
        assert_eq!((found.side, found.rounds), (trained, rounds), "{told}");
        let pixels = (side.min(found.side) as u64).pow(2);
        let paths = ((1 << rounds) - 1 + 2 * u64::from(found.pilot)) * pixels;
        let all = f64::from(spp) * (side * side) as f64;
        assert!(work(&found, paths, pixels) <= PART * all || spp == 16 && trained == 24, "{told}");
    }
    // Small pictures pay for three rounds and a pilot run, 7 and twice 4 paths a pixel.
    let world = rooms();
    let renderer = Renderer::new(&world, &inside(), options(16, 4, 1)).unwrap();
    let least = GuidingOptions::for_picture(Guiding::Lobes, renderer.options());
    let guidance = Guidance::train(&renderer, &least, || false).unwrap();
    assert_eq!(guidance.report().unwrap().paths, (7 + 8) * 16 * 16);
}

#[test]
fn a_guide_that_is_off_cost_a_tenth_of_the_work_at_most() {
    let world = open();
    let view = {
        let eye = Vec3::new(0.0, 1.0, 2.0);
        View::pinhole(&Camera::look_at(eye, Vec3::ZERO, Vec3::Y, 0.8, 1.0, 0.01, 10.0))
    };
    for (guiding, spp) in
        [(Guiding::Lobes, 64), (Guiding::Lobes, 256), (Guiding::Lobes, 1024), (Guiding::Flow, 256)]
    {
        let renderer = Renderer::new(&world, &view, options(96, spp, 1)).unwrap();
        let stage = GuidingOptions::for_picture(guiding, renderer.options());
        let guidance = Guidance::train(&renderer, &stage, || false).unwrap();
        let report = guidance.report().unwrap();
        assert!(!report.used && report.gain < 0.85, "{}", report.sentence());
        let (pilot, pixels) = (u64::from(stage.pilot), (stage.side as u64).pow(2));
        assert_eq!(report.paths, ((1 << stage.rounds) - 1 + 2 * pilot) * pixels, "{}", report.sentence());
        assert_eq!(report.rounds, stage.rounds);
        let all = f64::from(spp) * 96.0 * 96.0;
        assert!(work(&stage, report.paths, pixels) <= PART * all, "{guiding:?}: {} paths", report.paths);
    }
}

#[test]
fn a_guide_that_diverges_is_off() {
    let world = rooms();
    let renderer = Renderer::new(&world, &inside(), options(32, 64, 1)).unwrap();
    let own = GuidingOptions::new(Guiding::Flow);
    let flow = FlowOptions { rates: [f32::MAX; 2], ..own.flow };
    let guidance = Guidance::train(&renderer, &GuidingOptions { flow, ..own }, || false).unwrap();
    assert!(guidance.has_diverged() && !guidance.is_on() && guidance.report().is_none());
}

#[test]
fn training_stops_where_it_is_told_to() {
    let world = rooms();
    let renderer = Renderer::new(&world, &inside(), options(16, 4, 1)).unwrap();
    let stage = GuidingOptions { side: 16, rounds: 2, ..small(Guiding::Lobes) };
    // Two rounds and the pilot run without the guide and with it.
    for after in 0..=4 {
        let asked = Cell::new(0);
        let stop = || asked.replace(asked.get() + 1) == after;
        let guidance = Guidance::train(&renderer, &stage, stop).unwrap();
        assert_eq!(guidance.report().is_some(), after == 4, "stopped at question {after}");
        assert_eq!(asked.get(), (after + 1).min(4), "questions");
    }
}

#[test]
fn a_limit_of_time_leaves_out_rounds_or_the_guide() {
    let world = rooms();
    let seconds = Duration::from_secs;
    // By a clock that goes on by a second whenever it is looked at.
    let trained = |stage: &GuidingOptions| {
        let asked = Cell::new(0);
        let now = || seconds(asked.replace(asked.get() + 1));
        let renderer = Renderer::new(&world, &inside(), options(16, 4, 1)).unwrap();
        Guidance::train_by(&now, std::slice::from_ref(&renderer), stage, || false).unwrap()
    };
    let picture = |guidance: &Guidance| rendered(&world, guidance, 1, 4).picture().data;
    // The pilot run judges otherwise with another number of paths.
    for guiding in [Guiding::Flow, Guiding::Lobes] {
        for least_gain in [0.0, 0.02] {
            let stage = GuidingOptions { side: 16, least_gain, ..small(guiding).with_rounds(7) };
            for (limit, rounds) in [(1 << 20, 7), (30, 4), (22, 3)] {
                let limited = trained(&GuidingOptions { limit: Some(seconds(limit)), ..stage });
                let again = trained(&stage.with_rounds(rounds));
                let told = format!("{guiding:?}, {limit} s: {:?} {:?}", limited.report(), again.report());
                assert!(limited.report().is_some_and(|r| r.rounds == rounds && r.used), "{told}");
                assert_eq!(limited.report(), again.report(), "{told}");
                assert!(picture(&limited) == picture(&again), "{told}: other bits");
            }
        }
    }
    let none = trained(&GuidingOptions { limit: Some(seconds(3)), ..small(Guiding::Lobes) });
    assert!(none.report().is_none() && !none.is_on());
    let renderer = Renderer::new(&world, &inside(), options(16, 4, 1)).unwrap();
    let by_the_clock = GuidingOptions { limit: Some(Duration::ZERO), ..small(Guiding::Lobes) };
    let none = Guidance::train(&renderer, &by_the_clock, || false).unwrap();
    assert!(none.report().is_none() && none.seconds() > 0.0);
}

#[test]
fn a_limit_of_time_makes_the_pictures_of_training_smaller() {
    let world = rooms();
    let seconds = Duration::from_secs;
    let renderer = Renderer::new(&world, &inside(), options(96, 4, 1)).unwrap();
    let trained = |stage: &GuidingOptions| {
        let asked = Cell::new(0);
        let now = || seconds(asked.replace(asked.get() + 1));
        Guidance::train_by(&now, std::slice::from_ref(&renderer), stage, || false).unwrap()
    };
    let stage = GuidingOptions { side: 96, ..small(Guiding::Lobes).with_rounds(4) };
    // A path a pixel of the smallest picture takes two seconds by this clock, and three rounds with their pilot run as long as 23.4 paths.
    for (limit, side, rounds) in
        [(1 << 20, 96, 4), (1400, 64, 3), (700, 64, 3), (600, 48, 3), (200, 32, 3), (60, 24, 3)]
    {
        let limited = trained(&GuidingOptions { limit: Some(seconds(limit)), ..stage });
        let report = limited.report().unwrap();
        assert_eq!((report.side, report.rounds), (side, rounds), "{limit} s");
        let again = trained(&stage.as_trained(report));
        assert_eq!(Some(report), again.report(), "{limit} s");
        let known = GuidingOptions::stages().any(|s| s == (side, rounds));
        assert!(known, "{side} pixels, {rounds} rounds: no render knows");
    }
    // Fewer rounds than three and another pilot run stay what they are.
    let fewer = GuidingOptions { rounds: 2, pilot: 3, ..stage };
    let limited = trained(&GuidingOptions { limit: Some(seconds(60)), ..fewer });
    let report = limited.report().unwrap();
    assert_eq!((report.side, report.rounds, report.paths), (24, 2, (1 + 2 + 2 * 3) * 24 * 24));
    assert_eq!(Some(report), trained(&fewer.as_trained(report)).report());
}

#[test]
fn useful_records_are_kept_up_to_the_number_that_is_wanted() {
    let query = Query { position: Vec3f::zero(), normal: Vec3f::zero(), wo: Vec3f::zero(), roughness: 1.0 };
    // Every third has light; its density tells its place.
    let all: Vec<Record> = (0..9000)
        .map(|i| {
            let value = f32::from(u8::from(i % 3 == 0));
            Record { query, wi: Vec3f::zero(), pdf: 1.0 + i as f32, value, incident: value }
        })
        .collect();
    for (most, expected) in [(0, 0), (1, 1), (999, 999), (2000, 2000), (3000, 3000), (9000, 3000)] {
        let kept = thinned(all.clone(), most);
        assert_eq!(kept.len(), expected);
        assert!(kept.iter().all(|r| r.value > 0.0) && kept.windows(2).all(|w| w[0].pdf < w[1].pdf));
    }
    let kept = thinned(all, 1000);
    let steps: Vec<f32> = kept.windows(2).map(|w| w[1].pdf - w[0].pdf).collect();
    assert!(steps.iter().all(|s| *s <= 15.0) && steps.iter().any(|s| *s != 9.0), "even, without a beat");
}

#[test]
fn no_light_and_no_noise_are_judged_and_told() {
    // Pixels of a mean luminance and a variance without the guide and with it.
    let judged = |mean: f64, variances, found, least_gain| {
        let options = GuidingOptions { least_gain, ..GuidingOptions::new(Guiding::Lobes) };
        let trial = |found_light| Trial { found_light, ..trial(mean, variances) };
        let [plain, guided] = [found, mean > 0.0].map(trial);
        GuidingReport::judge(&plain, &guided, &options)
    };
    for (mean, variances, found, used, gain, why) in [
        (1.0, [4.0, 1.0], true, true, 2.5, "gain 2.50"),
        (1.0, [4.0, 4.0], true, false, 0.625, "gain 0.62"),
        (1.0, [4.0, 0.0], true, true, f64::INFINITY, "no noise with it"),
        (1.0, [0.0, 4.0], true, false, 0.0, "gain 0.00"),
        (1.0, [0.0, 0.0], true, false, f64::NAN, "no noise"),
        (0.0, [0.0, 0.0], false, false, f64::NAN, "no light"),
    ] {
        for (least_gain, used) in [(1.15, used), (0.0, true)] {
            let report = judged(mean, variances, found, least_gain);
            let sentence = report.sentence();
            let same = (report.gain - gain).abs() < 1e-9
                || report.gain == gain
                || report.gain.is_nan() && gain.is_nan();
            assert!(same && report.used == used, "{variances:?}: {report:?}");
            assert_eq!(sentence.contains(" is on: "), used, "{sentence}");
            assert_eq!(sentence.contains(" off"), !used, "{sentence}");
            assert!(sentence.ends_with(why), "{sentence}");
        }
    }
}

/// 4 x 4 pixels.
fn trial(mean: f64, variances: [f64; 2]) -> Trial {
    let one = Path::varied(mean, variances);
    Trial { size: [4; 2], work: 16, each: one.len(), paths: one.repeat(16), ..Trial::default() }
}

#[test]
fn a_room_without_light_has_no_guide() {
    let wall = [(vec3(-1.0, 0.0, -0.5), vec3(0.0, 1.0, 0.0), vec3(0.0, 0.0, 1.0))];
    let world = World::new(room(&wall)).unwrap();
    for guiding in [Guiding::Flow, Guiding::Lobes] {
        let renderer = Renderer::new(&world, &inside(), options(16, 4, 1)).unwrap();
        let stage = GuidingOptions { side: 16, rounds: 3, ..GuidingOptions::new(guiding) };
        let guidance = Guidance::train(&renderer, &stage, || false).unwrap();
        let report = guidance.report().unwrap();
        assert!(!report.used && report.found == [false; 2] && report.records == 0, "{}", report.sentence());
        assert!(
            guidance.trained.is_none() && report.sentence().ends_with("is off: the pilot run found no light")
        );
    }
}

#[test]
fn light_through_a_gap_is_found_with_less_variance() {
    let world = rooms();
    for guiding in [Guiding::Flow, Guiding::Lobes] {
        let renderer = Renderer::new(&world, &inside(), options(48, 16, 2)).unwrap();
        let stage = GuidingOptions { side: 48, ..small(guiding) };
        let guidance = Guidance::train(&renderer, &stage, || false).unwrap();
        let report = guidance.report().unwrap();
        // Roulette that saw the small weights of guided directions would undo the guide.
        assert!(report.variance_ratio > 1.5, "{}", report.sentence());
    }
}
