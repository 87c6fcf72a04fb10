//! Both samplers tell the same of each other as their own paths do.

use super::super::tests::{grey, inside, open, options, rooms, small, two_rooms};
use super::super::{Guidance, Guiding, Trained};
use super::*;
use glam::Vec3;
use photofit_pathtrace::{Material, Shape, View, World};
use photofit_scalar::vec3;
use photofit_scene::Camera;
use photofit_shading::Surface;
use photofit_shading::bsdf::{Bsdf, Energy, MetallicRoughness};

/// All paths of a small picture under both samplers.
fn paths<G: Guide>(renderer: &Renderer<'_>, guide: &G, chooser: Chooser) -> Vec<Path> {
    let densities = Densities { chosen: Cell::new(1.0), light: Cell::new(1.0) };
    let mut follower = Follower::new(chooser, &densities);
    let own = renderer.options();
    let mut all = Vec::new();
    for pixel in 0..own.width * own.height {
        for sample in 0..own.spp {
            all.push(follower.follow(renderer, guide, [pixel % own.width, pixel / own.width], sample));
        }
    }
    all
}

/// Mean and standard error.
fn mean(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let (mut n, mut sum, mut squares) = (0.0, 0.0, 0.0);
    for v in values {
        (n, sum, squares) = (n + 1.0, sum + v, squares + v * v);
    }
    let mean = sum / n;
    [mean, ((squares / n - mean * mean).max(0.0) / n).sqrt()]
}

/// Equal within four standard errors, which are at most `most` of the first.
fn agree(told: &str, most: f64, [a, ea]: [f64; 2], [b, eb]: [f64; 2]) {
    let sigma = ea.hypot(eb);
    assert!((a - b).abs() < 4.0 * sigma, "{told}: {a} +- {ea}, {b} +- {eb}");
    assert!(sigma < most * a, "{told}: {a} +- {ea}, {b} +- {eb} says nothing");
}

fn compared<G: Guide>(renderer: &Renderer<'_>, guide: &G) {
    let plain = paths(renderer, guide, Chooser::Scattering);
    let guided = paths(renderer, guide, Chooser::Guide);
    assert!(plain.iter().chain(&guided).any(|p| (p.ratio - 1.0).abs() > 0.3), "the guide does something");
    let of = |all: &[Path], f: &dyn Fn(&Path) -> f64| mean(all.iter().map(f));
    let of_weight = |f: &dyn Fn(&Path) -> f64| {
        let [a, ea] = of(&plain, f);
        let [b, eb] = of(&guided, f);
        [a + b, ea.hypot(eb)]
    };
    agree("weights without", 0.01, [1.0, 0.0], of_weight(&|p| 1.0 / (1.0 + p.ratio)));
    agree("weights with", 0.01, [1.0, 0.0], of_weight(&|p| p.ratio / (1.0 + p.ratio)));
    agree("mean", 0.03, of(&plain, &|p| p.values[0]), of(&guided, &|p| p.values[1]));
    agree("mean told", 0.03, of(&plain, &|p| p.values[0]), of(&guided, &|p| p.values[0] / p.ratio));
    agree("mean told back", 0.03, of(&guided, &|p| p.values[1]), of(&plain, &|p| p.values[1] * p.ratio));
    let square = |v: f64| v * v;
    let direct = of(&plain, &|p| square(p.values[0]));
    agree("second moment without", 0.1, direct, of(&guided, &|p| square(p.values[0]) / p.ratio));
    let direct = of(&guided, &|p| square(p.values[1]));
    agree("second moment with", 0.1, direct, of(&plain, &|p| square(p.values[1]) * p.ratio));
}

#[test]
fn each_chooser_tells_what_the_other_would_have_brought() {
    // Light of the sky through a gap, which paths meet and light sampling finds; a lamp, and a surface with two lobes.
    let shining = {
        let mut parts = two_rooms();
        let lamp = grey(0.2).emitting(Vec3f::splat(4.0));
        parts.add(Shape::Sphere { center: vec3(0.2, 0.8, -0.2), radius: 0.15 }, lamp);
        let surface = Surface { base_color: Vec3f::splat(0.8), roughness: 0.4, metallic: 0.3, gamma: 0.0 };
        let gloss = Bsdf::MetallicRoughness(MetallicRoughness::new(&surface, Energy::Compensated));
        parts.add(Shape::Sphere { center: vec3(0.6, 0.3, -0.1), radius: 0.25 }, Material::new(gloss));
        World::new(parts).unwrap()
    };
    for (world, spp) in [(rooms(), 4096), (shining, 1024)] {
        for guiding in [Guiding::Flow, Guiding::Lobes] {
            let renderer = Renderer::new(&world, &inside(), options(8, spp, 3)).unwrap();
            let guidance = Guidance::train(&renderer, &small(guiding), || false).unwrap();
            match guidance.trained.as_ref().unwrap() {
                Trained::Flow(guide) => compared(&renderer, &**guide),
                Trained::Lobes(guide) => compared(&renderer, guide),
            }
        }
    }
}

#[test]
fn sums_are_without_bias() {
    // A path brings 0 or 3; without the guide it is one of two alike, with it the second in three of four.
    let probability = [[0.5, 0.5], [0.25, 0.75]];
    let f = [0.0, 1.5];
    let path = |k: usize| {
        let [p, q] = [probability[0][k], probability[1][k]];
        Path { values: [f[k] / p, f[k] / q], ratio: q / p }
    };
    let mut expected = Sums::default();
    for (chooser, k) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
        let mut one = Sums::default();
        one.add(&path(k));
        let part = probability[chooser][k];
        (0..2).for_each(|k| expected.mean[k] += part * one.mean[k]);
        (0..2).for_each(|k| expected.weight[k] += part * one.weight[k]);
        (0..2).for_each(|k| expected.second[k] += part * one.second[k]);
    }
    let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
    (0..2).for_each(|k| close(expected.mean[k], 1.5));
    // (3 / 2)^2 / p and / q.
    let second = [4.5, 3.0];
    (0..2).for_each(|k| close(expected.weight[k], 1.0));
    (0..2).for_each(|k| close(expected.second[k], second[k]));
    let (mean, around, all) = moments(&expected, &Sums::default());
    close(mean, 1.5);
    (0..2).for_each(|k| close(all[k], second[k]));
    (0..2).for_each(|k| close(around[k], second[k] - 2.25));
}

#[test]
fn what_hardly_varies_has_no_negative_variance() {
    // Light of the first vertex, behind which paths end more often with the guide than without: 1 each time.
    for (ends, goes_on) in [(1e30, 0.5), (1e30, 0.9), (1.0, 1.0)] {
        let mut sums = [Sums::default(); 2];
        for i in 0..4 {
            let ratio = [goes_on, if i == 0 { ends } else { goes_on }];
            (0..2).for_each(|k| sums[k].add(&Path { values: [1.0; 2], ratio: ratio[k] }));
        }
        let (mean, around, _) = moments(&sums[0], &sums[1]);
        assert!(mean > 0.5 && around.iter().all(|v| *v > -1e-12 && *v < 0.5), "{mean} {around:?}");
    }
}

#[test]
fn light_around_a_pixel_is_that_of_its_own_picture() {
    // Two pictures whose heights are no multiple of a block's: a dark one, and a bright one of the same relative noise.
    let of = |mean: f64, n: usize| vec![Sums::of(mean, [mean * mean, 0.25 * mean * mean]); n];
    let trial = || Trial { size: [4, 3], pixels: [of(1.0, 12), of(100.0, 12)].concat(), ..Trial::default() };
    let found = variances(&trial(), &trial());
    let darkness = DARKNESS * 50.5;
    let expected = [1.0_f64, 100.0].map(|m| (m / (m + darkness)).powi(2)).iter().sum::<f64>() / 2.0;
    for (found, part) in found.into_iter().zip([1.0, 0.25]) {
        assert!((found / (part * expected) - 1.0).abs() < 1e-9, "{found}, {expected}");
    }
}

#[test]
fn variances_are_those_of_many_samples() {
    // 4 x 4 pixels are one block.
    let above = {
        let eye = Vec3::new(0.0, 1.0, 2.0);
        View::pinhole(&Camera::look_at(eye, Vec3::ZERO, Vec3::Y, 0.8, 1.0, 0.01, 10.0))
    };
    for (world, view, spp) in [(rooms(), inside(), 16_384), (open(), above, 1024)] {
        let renderer = Renderer::new(&world, &view, options(4, spp, 3)).unwrap();
        let guidance = Guidance::train(&renderer, &small(Guiding::Lobes), || false).unwrap();
        let Some(Trained::Lobes(guide)) = &guidance.trained else { panic!("lobes") };
        let choosers = [Chooser::Scattering, Chooser::Guide];
        let direct = [0, 1].map(|k| {
            let all = paths(&renderer, guide, choosers[k]);
            let pixels = all.chunks_exact(spp as usize).map(|own| {
                let [_, error] = mean(own.iter().map(|p| p.values[k]));
                error * error * f64::from(spp)
            });
            pixels.sum::<f64>() / 16.0
        });
        let brightness = mean(paths(&renderer, guide, Chooser::Guide).iter().map(|p| p.values[1]))[0];
        let run = |k: usize| Trial::run(&renderer, spp / 4, guide, choosers[k]);
        let found = variances(&run(0), &run(1)).map(|v| v * (1.1 * brightness).powi(2));
        for k in 0..2 {
            assert!((found[k] / direct[k] - 1.0).abs() < 0.15, "{found:?} {direct:?}");
        }
    }
}

#[test]
fn rare_light_is_told_by_the_paths_that_look_for_it() {
    // One path in 10^6 brings a million; the guide takes it every second time. No path of its own tells the variance without.
    let bright = Path { values: [1e6, 2.0], ratio: 0.5e6 };
    let dark = Path { values: [0.0; 2], ratio: 0.5 };
    let (mut plain, mut guided) = (Sums::default(), Sums::default());
    for _ in 0..4 {
        (0..2).for_each(|_| plain.add(&dark));
        guided.add(&bright);
        guided.add(&dark);
    }
    let trial = |sums| Trial { size: [1; 2], pixels: vec![sums], ..Trial::default() };
    let [without, with] = variances(&trial(plain), &trial(guided));
    assert!((without / with / 1e6 - 1.0).abs() < 0.2, "{without} {with}");
}
