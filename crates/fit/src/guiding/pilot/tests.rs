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

/// Two paths: with these probabilities without the guide and with it, and `f` over them.
fn either(probability: [[f64; 2]; 2], f: [f64; 2]) -> [Path; 2] {
    [0, 1].map(|k| {
        let [p, q] = [probability[0][k], probability[1][k]];
        Path { values: [f[k] / p, f[k] / q], ratio: q / p }
    })
}

#[test]
fn variances_of_few_paths_are_without_bias() {
    // Light that the guide takes nine times in ten and the scattering function one time in ten; and what varies with it alone.
    for (probability, f) in [([[0.9, 0.1], [0.1, 0.9]], [0.0, 1.5]), ([[0.5, 0.5], [0.25, 0.75]], [0.5, 0.5])]
    {
        let paths = either(probability, f);
        let mean = f[0] + f[1];
        let variance = |p: [f64; 2]| (0..2).map(|k| f[k] * f[k] / p[k]).sum::<f64>() - mean * mean;
        // All outcomes of three paths of each, by their probabilities.
        let (mut found, mut found_second, mut found_mean, mut all) = ([0.0; 2], [0.0; 2], 0.0, 0.0);
        for outcome in 0..64_usize {
            let choice: Vec<usize> = (0..6).map(|i| outcome >> i & 1).collect();
            let part: f64 = (0..6).map(|i| probability[i / 3][choice[i]]).product();
            let of = |own: &[usize]| -> Vec<Path> { own.iter().map(|k| paths[*k]).collect() };
            let (mean, around, second) = moments([&of(&choice[..3]), &of(&choice[3..])]);
            (0..2).for_each(|k| found[k] += part * around[k]);
            (0..2).for_each(|k| found_second[k] += part * second[k]);
            (found_mean, all) = (found_mean + part * mean, all + part);
        }
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
        close(all, 1.0);
        close(found_mean, mean);
        (0..2).for_each(|k| close(found[k], variance(probability[k])));
        (0..2).for_each(|k| close(found_second[k], variance(probability[k]) + mean * mean));
    }
}

#[test]
fn what_hardly_varies_has_no_variance() {
    // Light of the first vertex, behind which paths end more often with the guide than without: 1 each time.
    for (ends, goes_on) in [(1e30, 0.5), (1e30, 0.9), (1.0, 1.0)] {
        let path = |ratio| Path { values: [1.0; 2], ratio };
        let plain = [path(goes_on); 4];
        let guided = [path(ends), path(goes_on), path(goes_on), path(goes_on)];
        let (mean, around, _) = moments([&plain, &guided]);
        assert!((mean - 1.0).abs() < 1e-12 && around.iter().all(|v| v.abs() < 1e-12), "{mean} {around:?}");
    }
}

#[test]
fn light_around_a_pixel_is_that_of_its_own_picture() {
    // Two pictures whose heights are no multiple of a block's: a dark one, and a bright one of the same relative noise.
    let of = |mean: f64| Path::varied(mean, [mean * mean, 0.25 * mean * mean]).repeat(12);
    let each = Path::varied(1.0, [0.0; 2]).len();
    let trial = || Trial { size: [4, 3], each, paths: [of(1.0), of(100.0)].concat(), ..Trial::default() };
    let [found, _] = told(&trial(), &trial());
    let darkness = DARKNESS * 50.5;
    let expected = [1.0_f64, 100.0].map(|m| (m / (m + darkness)).powi(2)).iter().sum::<f64>() / 2.0;
    for (found, part) in found.into_iter().zip([1.0, 0.25]) {
        assert!((found / (part * expected) - 1.0).abs() < 1e-9, "{found}, {expected}");
    }
}

#[test]
fn a_guide_must_pay_in_the_dark_and_in_the_bright() {
    // A dark picture and a bright one: what is told is the variance ratio of the worse.
    let each = Path::varied(1.0, [0.0; 2]).len();
    let told = |dark: [f64; 2], bright: [f64; 2]| {
        let paths = [Path::varied(0.1, dark).repeat(4), Path::varied(10.0, bright).repeat(4)].concat();
        let trial = || Trial { size: [2, 2], each, paths: paths.clone(), ..Trial::default() };
        let [without, with] = variances(&trial(), &trial());
        without / with
    };
    let in_the_dark = told([4.0, 1.0], [100.0, 100.0]);
    assert!((0.99..1.1).contains(&in_the_dark), "{in_the_dark}");
    let in_the_bright = told([1.0, 1.0], [4.0, 1.0]);
    assert!((0.99..1.5).contains(&in_the_bright), "{in_the_bright}");
    let in_both = told([4.0, 1.0], [400.0, 100.0]);
    assert!((3.9..4.1).contains(&in_both), "{in_both}");
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
        // Each trial has numbers of its own.
        let trial = |side: usize, spp: u32, k: usize, seed: u64| {
            let own = renderer.again(options(side, spp, seed + k as u64)).unwrap();
            Trial::run(&own, spp, guide, choosers[k])
        };
        let [relative, whole] = told(&trial(4, spp / 4, 0, 5), &trial(4, spp / 4, 1, 5));
        for found in [relative.map(|v| v * (1.1 * brightness).powi(2)), whole] {
            for k in 0..2 {
                assert!((found[k] / direct[k] - 1.0).abs() < 0.15, "{found:?} {direct:?}");
            }
        }
        // Few paths of many pixels, as pilot runs have them.
        let [_, found] = told(&trial(64, 4, 0, 7), &trial(64, 4, 1, 7));
        let [_, expected] = told(&trial(64, 64, 0, 9), &trial(64, 64, 1, 9));
        for k in 0..2 {
            assert!((found[k] / expected[k] - 1.0).abs() < 0.25, "{found:?} {expected:?}");
        }
    }
}

#[test]
fn rare_light_is_told_by_the_paths_that_look_for_it() {
    // One path in 10^6 brings a million; the guide takes it every second time. No path of its own tells the variance without.
    let bright = Path { values: [1e6, 2.0], ratio: 0.5e6 };
    let dark = Path { values: [0.0; 2], ratio: 0.5 };
    let trial = |paths: [Path; 8]| Trial { size: [1; 2], each: 8, paths: paths.to_vec(), ..Trial::default() };
    let guided = [bright, dark, bright, dark, bright, dark, bright, dark];
    let [without, with] = variances(&trial([dark; 8]), &trial(guided));
    assert!((without / with / 1e6 - 1.0).abs() < 0.2, "{without} {with}");
}
