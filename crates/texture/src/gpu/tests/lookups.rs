//! Lookups, their adjoints, and sums of texel gradients.

use super::*;
use crate::{
    Filter, LevelOfDetail, Sampler, Scatter, ScatterQueue, Wrap, level_of_detail, lookup, sample, sample_vjp,
};
use photofit_gpu::{FIXED, FIXED_LIMITED, FIXED_LOST};
use photofit_scalar::{Vec2, vec2};

const SOURCE: &[&str] = &[INDEX, photofit_scalar::WGSL, FIXED, LOOKUP, SCATTER, include_str!("lookups.wgsl")];
pub(super) const FORWARD: Kernel = Kernel { name: "lookup", source: SOURCE, entry: "forward" };
pub(super) const REVERSE: Kernel = Kernel { name: "lookup_vjp", source: SOURCE, entry: "reverse" };

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Params {
    maps: MipTable,
    count: u32,
    wrap_u: u32,
    wrap_v: u32,
    filtering: u32,
    bias: f32,
    pad: [u32; 3],
}

/// uv, then the derivatives of u and of v by X and Y.
type Place = [f32; 6];

struct Lookups {
    values: Vec<f32>,
    /// (d/du, d/dv, d/dlevel) of each.
    derivatives: Vec<[f32; 3]>,
    texels: Vec<f32>,
    status: u32,
}

fn on_device(
    gpu: &Gpu,
    p: &Pyramid<f32, CHANNELS>,
    s: &Sampler,
    places: &[Place],
    g: &[f32],
    fitted: [bool; CHANNELS],
) -> Lookups {
    let maps = MipBuffers::new(gpu, p, fitted).expect("fits");
    let [wrap_u, wrap_v, filtering] = crate::stored::gpu::sampler_codes(s);
    let n = places.len();
    let params = Params {
        maps: maps.table(SUM_SCALE),
        count: n as u32,
        wrap_u,
        wrap_v,
        filtering,
        bias: 0.3,
        pad: [0; 3],
    };
    let at = gpu.upload("places", places).expect("fits");
    let values = gpu.zeros::<[f32; 4]>("values", 4 * n).expect("fits");
    let g = gpu.upload("g", g).expect("fits");
    let derivatives = gpu.zeros::<[f32; 4]>("derivatives", n).expect("fits");
    run(gpu, |r| {
        r.dispatch(&FORWARD, &params, &[maps.texels.bind(), at.bind(), values.bind()], n)?;
        let buffers = [maps.texels.bind(), at.bind(), g.bind(), derivatives.bind(), maps.sums.bind()];
        r.dispatch(&REVERSE, &params, &buffers, n)?;
        maps.record_collect(r, SUM_SCALE).map(|_| ())
    });
    Lookups {
        values: words(gpu, &values),
        derivatives: gpu.read(&derivatives).expect("read").iter().map(|d| [d[0], d[1], d[2]]).collect(),
        texels: words(gpu, &maps.gradient),
        status: gpu.read(&maps.status).expect("read")[0],
    }
}

fn on_cpu(
    p: &Pyramid<f32, CHANNELS>,
    s: &Sampler,
    places: &[Place],
    g: &[f32],
    fitted: [bool; CHANNELS],
) -> Lookups {
    let base = &p.levels[0];
    let mut queue = ScatterQueue::default();
    let mut out = Lookups { values: Vec::new(), derivatives: Vec::new(), texels: Vec::new(), status: 0 };
    for (q, g) in places.iter().zip(g.as_chunks::<CHANNELS>().0) {
        let duv: [Vec2<f32>; 2] = [vec2(q[2], q[3]), vec2(q[4], q[5])];
        let lod: LevelOfDetail<f32> = level_of_detail(&duv, base.width, base.height, 0.3, p.levels.len() - 1);
        let at = lookup(p, vec2(q[0], q[1]), Some(&lod), s);
        out.values.extend(sample(p, &at));
        let (uv, level) = sample_vjp(p, &at, g);
        out.derivatives.push([uv.x, uv.y, level]);
        let mut g = *g;
        g.iter_mut().zip(fitted).filter(|(_, f)| !f).for_each(|(g, _)| *g = 0.0);
        queue.push(p, &[at], &[g]);
    }
    let mut texels = Pyramid::zeros_like(p);
    Scatter::accumulate(&[&queue], &mut texels);
    out.texels = flat(&texels);
    out
}

pub(super) fn places(n: usize, rng: &mut Uniform) -> Vec<Place> {
    let footprint = |rng: &mut Uniform| {
        let size = 10_f64.powf(rng.range(-4.0, 0.5));
        (rng.range(-1.0, 1.0) * size) as f32
    };
    let mut out: Vec<Place> = Vec::new();
    for _ in 0..n {
        let uv = [rng.range(-1.5, 2.5) as f32, rng.range(-1.5, 2.5) as f32];
        out.push([uv[0], uv[1], footprint(rng), footprint(rng), footprint(rng), footprint(rng)]);
    }
    out
}

fn check(gpu: &Gpu, size: (usize, usize), places: &[Place], g: &[f32], fitted: [bool; CHANNELS]) {
    let p = pyramid(size, MipRule::Area, 31);
    for wrap in [Wrap::Repeat, Wrap::MirroredRepeat, Wrap::ClampToEdge] {
        for filter in [Filter::Nearest, Filter::Bilinear, Filter::Trilinear] {
            let s = Sampler { wrap_u: wrap, wrap_v: wrap, filter };
            let what = format!("{size:?} {s:?}");
            let found = on_device(gpu, &p, &s, places, g, fitted);
            let expected = on_cpu(&p, &s, places, g, fitted);
            assert_eq!(found.status, 0, "{what}");
            assert_close(
                "LOOKUP",
                &format!("{what} values"),
                &found.values,
                &expected.values,
                tolerances::LOOKUP,
            );
            for k in 0..3 {
                let of = |l: &Lookups| l.derivatives.iter().map(|d| d[k]).collect::<Vec<_>>();
                let what = format!("{what} derivative {k}");
                assert_close("LOOKUP_VJP", &what, &of(&found), &of(&expected), tolerances::LOOKUP_VJP);
            }
            assert_close(
                "SCATTER",
                &format!("{what} texels"),
                &found.texels,
                &expected.texels,
                tolerances::SCATTER,
            );
        }
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn lookups_and_their_adjoints_agree() {
    let gpu = test_device();
    let mut rng = Uniform::new(5);
    for size in [(32, 32), (37, 21), (1, 9)] {
        let at = places(2000, &mut rng);
        let g: Vec<f32> = rng.vec(2000 * CHANNELS, -1.0, 1.0).iter().map(|x| *x as f32).collect();
        check(gpu, size, &at, &g, std::array::from_fn(|c| c < 13 && c != 4));
    }
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn extreme_places_agree() {
    let gpu = test_device();
    let odd =
        [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, -1e30, 3e9, -0.0, 0.0, 1.0, f32::MIN_POSITIVE];
    let mut at: Vec<Place> = Vec::new();
    for a in odd {
        at.extend(odd.map(|b| [a, b, 0.01, 0.0, 0.0, 0.01]));
        at.extend(odd.map(|b| [0.3, 0.4, a, b, 0.1, 0.1]));
        at.push([0.3, 0.4, a, a, a, a]);
    }
    let mut rng = Uniform::new(6);
    let g: Vec<f32> = rng.vec(at.len() * CHANNELS, -1.0, 1.0).iter().map(|x| *x as f32).collect();
    check(gpu, (16, 8), &at, &g, [true; CHANNELS]);
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn sums_carry_small_and_large_gradients() {
    let gpu = test_device();
    let p = pyramid((4, 4), MipRule::Area, 8);
    let s = Sampler { filter: Filter::Nearest, ..Sampler::default() };
    // One texel each, in turns: 400 terms a texel.
    let at: Vec<Place> = (0..16 * 400)
        .map(|i| [(i % 4) as f32 / 4.0 + 0.1, (i / 4 % 4) as f32 / 4.0 + 0.1, 0.0, 0.0, 0.0, 0.0])
        .collect();
    // The largest in one channel: all have one count of large terms.
    for (size, one) in [(1e-9, false), (1e-5, false), (1.0, false), (1e3, true)] {
        let g: Vec<f32> = (0..at.len() * CHANNELS)
            .map(|i| (size * (1.0 + (i % 7) as f64 / 7.0) * if i % 3 == 0 { -0.5 } else { 0.5 }) as f32)
            .enumerate()
            .map(|(i, g)| if one && i % CHANNELS != 3 { 0.0 } else { g })
            .collect();
        let found = on_device(gpu, &p, &s, &at, &g, [true; CHANNELS]);
        let mut expected = vec![0.0_f64; 16 * CHANNELS];
        for (i, g) in g.iter().enumerate() {
            let texel = (i / CHANNELS) % 16;
            expected[texel * CHANNELS + i % CHANNELS] += f64::from(*g);
        }
        let expected: Vec<f32> = expected.iter().map(|x| *x as f32).collect();
        assert_eq!(found.status, 0, "{size}");
        // Half a unit of 2^-44 a term.
        let bound = 1e-6 + 400.0 * 0.5 * f64::from(SUM_SCALE).recip() / (size * 10.0);
        assert_close("SUMS", &format!("{size}"), &found.texels[..16 * CHANNELS], &expected, bound);
    }
    for (bad, status) in [(3e3, FIXED_LIMITED), (f32::NAN, 1), (f32::INFINITY, 1)] {
        let mut g = vec![1.0; at.len() * CHANNELS];
        g[77] = bad;
        assert_eq!(on_device(gpu, &p, &s, &at, &g, [true; CHANNELS]).status, status, "{bad} is told");
    }
    // Terms that fit, and a sum that does not.
    let many = vec![900.0; 16 * 1600 * CHANNELS];
    let at: Vec<Place> = at.iter().cycle().take(16 * 1600).copied().collect();
    let found = on_device(gpu, &p, &s, &at, &many, [true; CHANNELS]).status;
    assert_ne!(found & FIXED_LOST, 0, "a sum that overflows is told");
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn sums_have_the_same_bits_in_every_run() {
    let gpu = test_device();
    let p = pyramid((8, 8), MipRule::Area, 8);
    let mut rng = Uniform::new(9);
    let at = places(5000, &mut rng);
    let g: Vec<f32> = rng.vec(5000 * CHANNELS, -1.0, 1.0).iter().map(|x| *x as f32).collect();
    let s = Sampler::default();
    let once = || on_device(gpu, &p, &s, &at, &g, [true; CHANNELS]).texels;
    let first = once();
    assert!(first.iter().any(|x| *x != 0.0));
    assert_eq!(first, once());
}

#[test]
#[ignore = "gpu: needs an adapter"]
fn a_perturbed_side_is_found() {
    let gpu = test_device();
    let p = pyramid((32, 32), MipRule::Area, 8);
    let mut other = p.clone();
    other.levels[0].texels[40][5] += 1e-3;
    let mut rng = Uniform::new(10);
    let at = places(4000, &mut rng);
    let g: Vec<f32> = rng.vec(4000 * CHANNELS, -1.0, 1.0).iter().map(|x| *x as f32).collect();
    let s = Sampler { filter: Filter::Bilinear, ..Sampler::default() };
    let found = on_device(gpu, &other, &s, &at, &g, [true; CHANNELS]);
    let expected = on_cpu(&p, &s, &at, &g, [true; CHANNELS]);
    assert!(worst_difference(&found.values, &expected.values) > tolerances::LOOKUP);
}
