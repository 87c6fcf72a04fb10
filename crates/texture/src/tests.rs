//! Tests of texture lookup and its adjoints.

use super::*;
use photofit_gradcheck::{Uniform, check};
use photofit_scalar::vec2;

fn sampler(wrap: Wrap, filter: Filter) -> Sampler {
    Sampler { wrap_u: wrap, wrap_v: wrap, filter }
}

fn random(width: usize, height: usize, seed: u64) -> Texture<f64, 2> {
    let mut rng = Uniform::new(seed);
    let texels = (0..width * height).map(|_| [rng.range(-1.0, 1.0), rng.range(-1.0, 1.0)]).collect();
    Texture { width, height, texels }
}

#[test]
fn wrap_modes() {
    let all = |m| (-5..8).map(|i| wrap(i, 4, m)).collect::<Vec<_>>();
    assert_eq!(all(Wrap::Repeat), [3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3]);
    assert_eq!(all(Wrap::ClampToEdge), [0, 0, 0, 0, 0, 0, 1, 2, 3, 3, 3, 3, 3]);
    assert_eq!(all(Wrap::MirroredRepeat), [3, 3, 2, 1, 0, 0, 1, 2, 3, 3, 2, 1, 0]);
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

/// Loss of a few trilinear lookups as a function of (texels, uv, duv).
fn trilinear(base: &Texture<f64, 2>, x: &[f64], w: &[f64]) -> f64 {
    let t = Pyramid::new(base.clone());
    let s = sampler(Wrap::MirroredRepeat, Filter::Trilinear);
    let mut sum = 0.0;
    for (k, q) in x.chunks(6).enumerate() {
        let duv = [vec2(q[2], q[3]), vec2(q[4], q[5])];
        let lod = level_of_detail(&duv, base.width, base.height, 0.0, t.levels.len() - 1);
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
        x.extend([rng.range(-1.0, 2.0), rng.range(-1.0, 2.0)]);
        x.extend(rng.vec(4, -0.25, 0.25));
    }
    let w = rng.vec(12, -1.0, 1.0);
    let t = Pyramid::new(base.clone());
    let s = sampler(Wrap::MirroredRepeat, Filter::Trilinear);
    let max = t.levels.len() - 1;
    let mut g_x = vec![];
    let mut queues = [ScatterQueue::default(), ScatterQueue::default()];
    for (k, q) in x.chunks(6).enumerate() {
        let duv = [vec2(q[2], q[3]), vec2(q[4], q[5])];
        let lod = level_of_detail(&duv, 13, 9, 0.0, max);
        let at = lookup(&t, vec2(q[0], q[1]), Some(&lod), &s);
        let g = [w[2 * k], w[2 * k + 1]];
        let (g_uv, g_level) = sample_vjp(&t, &at, &g);
        let g_duv = level_of_detail_vjp(&duv, 13, 9, &lod, max, g_level);
        g_x.extend([g_uv.x, g_uv.y, g_duv[0].x, g_duv[0].y, g_duv[1].x, g_duv[1].y]);
        queues[k % 2].push(&t, &at, &g);
    }
    check("uv and derivatives", &x, &g_x, 1e-7, 1e-5, |x| trilinear(&base, x, &w));
    let mut g = Pyramid::zeros_like(&t);
    Scatter::accumulate(&queues.each_ref(), &mut g);
    let smooth = {
        let mut s = g.clone();
        s.collapse_vjp(MipAdjoint::Smooth);
        s.levels[0].texels.iter().map(|t| t[0]).sum::<f64>()
    };
    g.collapse_vjp(MipAdjoint::Exact);
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
                queues[i % 5].push(&t, &lookup(&t, uv, Some(&lod), &s), &[1.1, -0.3]);
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
