//! Tests of texture lookup and its adjoints.

use super::*;
use photofit_gradcheck::{Uniform, check};
use photofit_scalar::{Real, vec2};

fn sampler(wrap: Wrap, filter: Filter) -> Sampler {
    Sampler { wrap_u: wrap, wrap_v: wrap, filter }
}

fn random(width: usize, height: usize, seed: u64) -> Texture<f64, 2> {
    let mut rng = Uniform::new(seed);
    let texels = (0..width * height).map(|_| [rng.range(-1.0, 1.0), rng.range(-1.0, 1.0)]).collect();
    Texture { width, height, texels }
}

#[test]
fn texel_centres_are_exact_and_halfway_is_the_mean() {
    let t = Pyramid::new(random(4, 4, 1));
    let s = sampler(Wrap::Repeat, Filter::Bilinear);
    let at = |u: f64, v: f64| sample(&t, &lookup(&t, vec2(u, v), None, &s));
    assert_eq!(at(1.5 / 4.0, 2.5 / 4.0), t.levels[0].texels[2 * 4 + 1]);
    let mean = 0.5 * (t.levels[0].texels[0][0] + t.levels[0].texels[3][0]);
    assert!((at(0.0, 0.5 / 4.0)[0] - mean).abs() < 1e-12, "repeat joins the ends");
    let n = lookup(&t, vec2(0.99, 0.01), None, &sampler(Wrap::Repeat, Filter::Nearest));
    assert_eq!(sample(&t, &n), t.levels[0].texels[3]);
}

#[test]
fn every_level_keeps_the_mean_even_for_odd_sizes() {
    for (w, h) in [(8, 8), (7, 5), (13, 1), (1, 1), (3, 10)] {
        let p = Pyramid::new(random(w, h, 2));
        let mean = |t: &Texture<f64, 2>| t.texels.iter().map(|t| t[0]).sum::<f64>() / t.texels.len() as f64;
        for l in &p.levels {
            assert!((mean(l) - mean(&p.levels[0])).abs() < 1e-12, "{w}x{h} at {}x{}", l.width, l.height);
        }
        assert_eq!((p.levels.last().unwrap().width, p.levels.last().unwrap().height), (1, 1));
    }
}

/// Loss of a few trilinear lookups as a function of (texels, uv, level).
fn trilinear(base: &Texture<f64, 2>, x: &[f64], w: &[f64]) -> f64 {
    let t = Pyramid::new(base.clone());
    let s = sampler(Wrap::MirroredRepeat, Filter::Trilinear);
    let mut sum = 0.0;
    for (k, q) in x.chunks(3).enumerate() {
        let lod = LevelOfDetail { level: q[2] };
        let v = sample(&t, &lookup(&t, vec2(q[0], q[1]), Some(&lod), &s));
        sum += v[0] * w[2 * k] + v[1] * w[2 * k + 1];
    }
    sum
}

#[test]
fn gradients_of_trilinear_lookup() {
    let base = random(13, 9, 4);
    let mut rng = Uniform::new(8);
    let mut x = vec![];
    for _ in 0..6 {
        x.extend([rng.range(-1.0, 2.0), rng.range(-1.0, 2.0), rng.range(0.1, 2.9)]);
    }
    let w = rng.vec(12, -1.0, 1.0);
    let t = Pyramid::new(base.clone());
    let s = sampler(Wrap::MirroredRepeat, Filter::Trilinear);
    let mut g_x = vec![];
    let mut queues = [ScatterQueue::default(), ScatterQueue::default()];
    for (k, q) in x.chunks(3).enumerate() {
        let lod = LevelOfDetail { level: q[2] };
        let at = lookup(&t, vec2(q[0], q[1]), Some(&lod), &s);
        let g = [w[2 * k], w[2 * k + 1]];
        let (g_uv, g_level) = sample_vjp(&t, &at, &g);
        g_x.extend([g_uv.x, g_uv.y, g_level]);
        queues[k % 2].push(&t, &[at], &[g]);
    }
    check("uv and level", &x, &g_x, 1e-7, 1e-5, |x| trilinear(&base, x, &w));
    let mut g = Pyramid::zeros_like(&t);
    Scatter::accumulate(&queues.each_ref(), &mut g);
    let smooth = {
        let mut s = g.clone();
        t.collapse_vjp(&mut s, MipAdjoint::Smooth);
        s.levels[0].texels.iter().map(|t| t[0]).sum::<f64>()
    };
    t.collapse_vjp(&mut g, MipAdjoint::Exact);
    let flat: Vec<f64> = base.texels.concat();
    check("texels", &flat, &g.levels[0].texels.concat(), 1e-4, 1e-7, |f| {
        let texels = f.chunks(2).map(|c| [c[0], c[1]]).collect();
        trilinear(&Texture { width: 13, height: 9, texels }, &x, &w)
    });
    let exact: f64 = g.levels[0].texels.iter().map(|t| t[0]).sum();
    assert!(
        (smooth - exact).abs() < 0.1 * exact.abs() + 0.05,
        "smooth {smooth} and exact {exact} sums agree roughly"
    );
}

#[test]
fn scatter_has_the_same_bits_for_any_thread_count() {
    let t = Pyramid::new(Texture {
        width: 64,
        height: 64,
        texels: random(64, 64, 3).texels.iter().map(|t| t.map(|x| x as f32)).collect(),
    });
    let s = sampler(Wrap::Repeat, Filter::Trilinear);
    let run = |threads: usize| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
            let mut queues: Vec<ScatterQueue<f32, 2>> = vec![ScatterQueue::default(); 5];
            let mut rng = Uniform::new(77);
            for i in 0..4000 {
                let uv = vec2(rng.range(0.0, 1.0) as f32, rng.range(0.0, 1.0) as f32);
                let lod = LevelOfDetail { level: rng.range(-1.0, 4.0) as f32 };
                queues[i % 5].push(&t, &[lookup(&t, uv, Some(&lod), &s)], &[[1.1, -0.3]]);
            }
            let mut g = Pyramid::zeros_like(&t);
            Scatter::accumulate(&queues.iter().collect::<Vec<_>>(), &mut g);
            g
        })
    };
    let (a, b) = (run(1), run(3));
    assert_eq!(a, b);
    let sum: f32 = a.levels.iter().flat_map(|l| &l.texels).map(|t| t[0]).sum();
    assert!((sum - 4400.0).abs() < 1.0, "every lookup's weights sum to one: {sum}");
}

#[test]
fn lookups_side_by_side_give_what_they_give_alone() {
    let t = Pyramid::new(random(8, 8, 5));
    let s = sampler(Wrap::ClampToEdge, Filter::Trilinear);
    let mut rng = Uniform::new(3);
    // Ten to a texel along a row of an enlarged texture, with a few that read two levels between them.
    let at: Vec<_> = (0..80)
        .map(|i| {
            let lod = LevelOfDetail { level: if i % 17 == 0 { 0.4 } else { 0.0 } };
            lookup(&t, vec2((f64::from(i) + 0.5) / 80.0, 0.47), Some(&lod), &s)
        })
        .collect();
    let g: Vec<[f64; 2]> = at.iter().map(|_| [rng.range(-1.0, 1.0), rng.range(-1.0, 1.0)]).collect();
    let (mut together, mut alone) = (ScatterQueue::default(), ScatterQueue::default());
    together.push(&t, &at, &g);
    at.iter().zip(&g).for_each(|(at, g)| alone.push(&t, &[*at], &[*g]));
    let [a, b] = [together, alone].map(|queue| {
        let mut g = Pyramid::zeros_like(&t);
        Scatter::accumulate(&[&queue], &mut g);
        g.levels.iter().flat_map(|l| l.texels.concat()).collect::<Vec<f64>>()
    });
    assert!(a.iter().filter(|x| x.abs() > 1e-3).count() > 20, "texels have gradients");
    for (a, b) in a.iter().zip(&b) {
        assert!((a - b).abs() < 1e-12, "{a} together, {b} alone");
    }
}

const COVERAGE: MipRule = MipRule::Coverage { colors: 3, alpha: 3 };

/// A pyramid of three colours, alpha, and a channel that is no colour.
fn covered(width: usize, height: usize, x: &[f64], rule: MipRule) -> Pyramid<f64, 5> {
    let texels = x.as_chunks::<5>().0.to_vec();
    Pyramid::with_rule(Texture { width, height, texels }, rule)
}

fn random_covered(width: usize, height: usize, seed: u64) -> Vec<f64> {
    let mut rng = Uniform::new(seed);
    (0..width * height)
        .flat_map(|i| {
            // Every fifth texel cannot be seen.
            let alpha = if i % 5 == 0 { 0.0 } else { rng.range(0.05, 1.0) };
            [rng.range(0.0, 2.0), rng.range(0.0, 1.0), rng.range(-1.0, 1.0), alpha, rng.range(-1.0, 1.0)]
        })
        .collect()
}

#[test]
fn coverage_keeps_the_mean_of_premultiplied_colour() {
    for (w, h) in [(8, 8), (7, 5), (13, 1), (3, 10)] {
        let p = covered(w, h, &random_covered(w, h, 5), COVERAGE);
        let mean = |t: &Texture<f64, 5>, f: &dyn Fn(&[f64; 5]) -> f64| {
            t.texels.iter().map(f).sum::<f64>() / t.texels.len() as f64
        };
        for l in &p.levels {
            let same = |f: &dyn Fn(&[f64; 5]) -> f64| (mean(l, f) - mean(&p.levels[0], f)).abs() < 1e-12;
            for c in 0..3 {
                assert!(
                    same(&|t| t[c] * t[3]),
                    "{w}x{h}: colour {c} times alpha at {}x{}",
                    l.width,
                    l.height
                );
            }
            assert!(same(&|t| t[3]) && same(&|t| t[4]), "{w}x{h}: channels that are no colour");
        }
    }
}

#[test]
fn colours_without_any_coverage_are_averaged_by_area() {
    let texels = vec![[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [1.0, 1.0, 1.0, 0.0]];
    let p = Pyramid::with_rule(Texture { width: 2, height: 2, texels }, COVERAGE);
    assert_eq!(p.levels[1].texels, [[0.5, 0.5, 0.5, 0.0]]);
}

/// The adjoint of the whole chain of averages by coverage, for gradients on every level.
#[test]
fn gradients_of_averages_by_coverage() {
    for (w, h) in [(8, 8), (13, 6), (5, 9), (1, 7)] {
        for rule in [COVERAGE, MipRule::Area, MipRule::Coverage { colors: 2, alpha: 4 }] {
            let mut x = random_covered(w, h, 11);
            if let MipRule::Coverage { alpha: 4, .. } = rule {
                x.chunks_mut(5).for_each(|t| t[4] = t[4].abs() + 0.1);
            }
            let values = covered(w, h, &x, rule);
            let mut rng = Uniform::new(6);
            let mut seeds = Pyramid::zeros_like(&values);
            for t in seeds.levels.iter_mut().flat_map(|l| &mut l.texels) {
                t.iter_mut().for_each(|g| *g = rng.range(-1.0, 1.0));
            }
            let mut g = seeds.clone();
            values.collapse_vjp(&mut g, MipAdjoint::Exact);
            let name = format!("{w}x{h} {rule:?}");
            check(&name, &x, g.levels[0].texels.as_flattened(), 1e-6, 1e-6, |x| {
                let p = covered(w, h, x, rule);
                let pairs =
                    p.levels.iter().zip(&seeds.levels).flat_map(|(p, s)| p.texels.iter().zip(&s.texels));
                pairs.map(|(p, s)| p.iter().zip(s).map(|(p, s)| p * s).sum::<f64>()).sum()
            });
        }
    }
}

/// In terms of premultiplied colour `c a` and alpha the average is linear, with the gradients `g_c / a` and
/// `g_a - sum c g_c / a`. Both adjoints pass their sums on unchanged (even sizes).
#[test]
fn adjoints_of_coverage_keep_the_sums_of_premultiplied_gradients() {
    let (w, h) = (16, 8);
    let mut x = random_covered(w, h, 21);
    x.chunks_mut(5).for_each(|t| t[3] = 0.1 + 0.9 * t[3]);
    let values = covered(w, h, &x, COVERAGE);
    let mut rng = Uniform::new(2);
    let mut seeds = Pyramid::zeros_like(&values);
    for t in &mut seeds.levels[1].texels {
        t.iter_mut().for_each(|g| *g = rng.range(-1.0, 1.0));
    }
    let sums = |g: &Pyramid<f64, 5>, level: usize| {
        let mut sums = [0.0; 5];
        for (g, v) in g.levels[level].texels.iter().zip(&values.levels[level].texels) {
            let linear = [g[0] / v[3], g[1] / v[3], g[2] / v[3]];
            let alpha = g[3] - (0..3).map(|c| v[c] * linear[c]).sum::<f64>();
            for (s, g) in sums.iter_mut().zip([linear[0], linear[1], linear[2], alpha, g[4]]) {
                *s += g;
            }
        }
        sums
    };
    let expected = sums(&seeds, 1);
    let collapsed = [MipAdjoint::Smooth, MipAdjoint::Exact].map(|adjoint| {
        let mut g = seeds.clone();
        values.collapse_vjp(&mut g, adjoint);
        let got = sums(&g, 0);
        for c in 0..5 {
            assert!((got[c] - expected[c]).abs() < 1e-11, "{adjoint:?} {c}: {} {}", got[c], expected[c]);
        }
        g
    });
    assert!(collapsed[0] != collapsed[1], "the two spread them differently");
}

#[test]
fn free_levels_stay_and_keep_their_gradients() {
    let mut p = covered(8, 8, &random_covered(8, 8, 1), MipRule::Free);
    p.levels[1].texels[0] = [7.0; 5];
    let before = p.clone();
    p.rebuild();
    assert_eq!(p, before);
    let mut g = before.clone();
    p.collapse_vjp(&mut g, MipAdjoint::Exact);
    assert_eq!(g, before);
}

#[test]
fn footprints_that_are_no_numbers_have_the_base_level() {
    for x in [0.0_f32, f32::NAN, -f32::NAN] {
        let duv = [vec2(x, x), vec2(x, x)];
        assert_eq!(level_of_detail(&duv, 64, 64, 0.0, 6).level, 0.0, "{x}");
    }
    let far = [vec2(f32::INFINITY, 0.0), vec2(0.0, 0.0)];
    assert!([0.0, 6.0].contains(&level_of_detail(&far, 64, 64, 0.0, 6).level), "inside of the chain");
    assert_eq!(level_of_detail(&[vec2(1e9_f32, 0.0), vec2(0.0, 1e9)], 64, 64, 0.0, 6).level, 6.0);
}

/// What each mode shows of an alpha.
fn coverages<T: Real + std::fmt::Debug>() {
    let alphas = [-0.1, 0.0, 0.25, 0.5, 1.0, 1.1, f64::NAN].map(T::of);
    let shown = |mode: AlphaMode| alphas.map(|a| mode.coverage(a));
    assert_eq!(shown(AlphaMode::Opaque), [T::one(); 7]);
    assert_eq!(shown(AlphaMode::Blend), [0.0, 0.0, 0.25, 0.5, 1.0, 1.0, 0.0].map(T::of));
    assert_eq!(shown(AlphaMode::Mask { cutoff: 0.25 }), [0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 0.0].map(T::of));
}

#[test]
fn coverage_stays_within_its_range() {
    coverages::<f32>();
    coverages::<f64>();
}
