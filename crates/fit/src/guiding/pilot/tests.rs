//! Both samplers tell the same of each other as their own paths do.

use super::super::tests::{grey, inside, options, rooms, small, two_rooms};
use super::super::{Guidance, Guiding, Trained};
use super::*;
use photofit_flow::Guided;
use photofit_pathtrace::{Material, Shape, World};
use photofit_scalar::vec3;
use photofit_shading::Surface;
use photofit_shading::bsdf::{Bsdf, Energy, MetallicRoughness};

/// All paths of a small picture under both samplers.
fn paths<D: DirectionSampler + Sync>(renderer: &Renderer<'_>, guide: &D, chooser: Chooser) -> Vec<Path> {
    let densities = Densities { chosen: Cell::new(1.0), light: Cell::new(1.0) };
    let sampler = Watched { guide, chooser, densities: &densities };
    let mut sink = Follower { chooser, densities: &densities, path: Path::default(), last: 1.0, vertices: 0 };
    let own = renderer.options();
    let mut all = Vec::new();
    for pixel in 0..own.width * own.height {
        for sample in 0..own.spp {
            sink.begin();
            renderer.walk([pixel % own.width, pixel / own.width], sample, &sampler, &mut sink);
            all.push(sink.path);
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

fn agree(told: &str, [a, ea]: [f64; 2], [b, eb]: [f64; 2]) {
    let sigma = ea.hypot(eb);
    assert!((a - b).abs() < 4.0 * sigma, "{told}: {a} +- {ea}, {b} +- {eb}");
    assert!(sigma < 0.15 * a, "{told}: {a} +- {ea}, {b} +- {eb} says nothing");
}

fn compared<D: DirectionSampler + Sync>(renderer: &Renderer<'_>, guide: &D) {
    let plain = paths(renderer, guide, Chooser::Scattering);
    let guided = paths(renderer, guide, Chooser::Guide);
    assert!(plain.iter().chain(&guided).any(|p| (p.ratio - 1.0).abs() > 0.3), "the guide does something");
    let of = |all: &[Path], f: &dyn Fn(&Path) -> f64| mean(all.iter().map(f));
    agree("mean", of(&plain, &|p| p.values[0]), of(&guided, &|p| p.values[1]));
    agree("mean told", of(&plain, &|p| p.values[0]), of(&guided, &|p| p.values[0] / p.ratio));
    agree("mean told back", of(&guided, &|p| p.values[1]), of(&plain, &|p| p.values[1] * p.ratio));
    let square = |v: f64| v * v;
    let direct = of(&plain, &|p| square(p.values[0]));
    agree("second moment without", direct, of(&guided, &|p| square(p.values[0]) / p.ratio));
    let direct = of(&guided, &|p| square(p.values[1]));
    agree("second moment with", direct, of(&plain, &|p| square(p.values[1]) * p.ratio));
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
                Trained::Flow(guide) => compared(&renderer, &Guided(&**guide)),
                Trained::Lobes(guide) => compared(&renderer, &Guided(guide)),
            }
        }
    }
}

#[test]
fn moments_are_without_bias() {
    // A path brings 0 or 3; without the guide it is one of two alike, with it the second in three of four.
    let probability = [[0.5, 0.5], [0.25, 0.75]];
    let f = [0.0, 1.5];
    let path = |k: usize| {
        let [p, q] = [probability[0][k], probability[1][k]];
        Path { values: [f[k] / p, f[k] / q], ratio: q / p }
    };
    let mut expected = (0.0, 0.0, [0.0; 2]);
    for outcome in 0..16_usize {
        let mut sums = [Sums::default(); 2];
        let mut weight = 1.0;
        for i in 0..4 {
            let (chooser, k) = (i / 2, outcome >> i & 1);
            sums[chooser].add(&path(k));
            weight *= probability[chooser][k];
        }
        let (mean, square, second) = moments(&sums[0], &sums[1]);
        expected.0 += weight * mean;
        expected.1 += weight * square;
        (0..2).for_each(|k| expected.2[k] += weight * second[k]);
    }
    let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
    close(expected.0, 1.5);
    close(expected.1, 2.25);
    // (3 / 2)^2 / p and / q.
    close(expected.2[0], 4.5);
    close(expected.2[1], 3.0);
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
    let trial = |sums| Trial { columns: 1, pixels: vec![sums], ..Trial::default() };
    let [without, with] = variances(&trial(plain), &trial(guided));
    assert!((without / with / 1e6 - 1.0).abs() < 0.2, "{without} {with}");
}
