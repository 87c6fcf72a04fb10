//! Nanoseconds of the learned samplers on one thread: a sample, a density, and the parts that they are made of.

use anyhow::Result;
use photofit_flow::network::Hidden;
use photofit_flow::spline::{Family, Spline};
use photofit_flow::{
    Chart, Domain, Encoding, FlowGuide, FlowOptions, Grid, Guide, Learn, LobeGuide, LobeOptions, Query,
    Record, Tensor,
};
use photofit_sampling::{Rng, uniform_sphere, uniform_sphere_pdf};
use photofit_scalar::{Vec3f, vec3};

use crate::context::Context;
use crate::timing;

/// Vertices of a timed pass.
const VERTICES: usize = 1 << 10;
/// The density is asked for in this direction.
const DIRECTION: Vec3f = vec3(0.6, 0.0, 0.8);

pub(crate) fn run(ctx: &mut Context) -> Result<()> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    pool.install(|| {
        let plain = FlowOptions::default();
        parts(ctx, plain);
        let rational = FlowOptions::of(Family::Rational);
        for (name, options) in [
            ("flow, 15 bins", plain),
            ("flow, hash grid", FlowOptions { encoding: Encoding::Hash(Grid::default()), ..plain }),
            ("flow, 31 bins", FlowOptions { bins: 31, ..plain }),
            ("flow, rational, 10 bins", rational),
        ] {
            let mut guide = FlowGuide::new(Vec3f::zero(), Vec3f::splat(1.0), options)?;
            guide.randomize(0.2, 1);
            whole(ctx, name, &guide);
        }
        whole(ctx, "lobes", &lobes()?);
        ctx.note(format!(
            "One thread, {VERTICES} vertices at random places; weights of the flow are random, lobes learned of a near lamp. \"Sample\" and \"density\" include \
             the features of the vertex, \"at a vertex\" leaves them out, \"among all\" too and answers for all vertices together. A sample or a density needs the network, a spline \
             and its use twice, the features of the place and the chart once."
        ));
        Ok(())
    })
}

/// Lobes that learned of a lamp near the vertices, so that they follow its parallax.
fn lobes() -> Result<LobeGuide> {
    let mut rng = Rng::new(3, 0);
    let mut guide = LobeGuide::new(LobeOptions::default());
    let records: Vec<Record> = (0..40 * VERTICES)
        .map(|_| {
            let mut next = || rng.next_f32();
            let position = vec3(next(), next(), next());
            let wi: Vec3f = uniform_sphere([next(), next()]);
            let towards = (vec3(0.3, 0.6, 2.0) - position).normalize_or_zero();
            let incident = (20.0 * (towards.dot(wi) - 1.0)).exp();
            let normal = vec3(0.0, 0.0, 1.0);
            let query = Query { position, normal, wo: normal, roughness: 1.0 };
            Record { query, wi, pdf: uniform_sphere_pdf(), value: incident, incident }
        })
        .collect();
    guide.learn(&records)?;
    Ok(guide)
}

fn vertices() -> Vec<(Query, [f32; 2])> {
    let mut rng = Rng::new(1, 0);
    let normal = vec3(0.0, 0.0, 1.0);
    (0..VERTICES)
        .map(|_| {
            let position = vec3(rng.next_f32(), rng.next_f32(), rng.next_f32());
            let wo = photofit_sampling::cosine_hemisphere([rng.next_f32(), rng.next_f32()]);
            (Query { position, normal, wo, roughness: 1.0 }, [rng.next_f32(), rng.next_f32()])
        })
        .collect()
}

/// Times one pass over all vertices and records what one of them takes.
fn each(ctx: &mut Context, method: &str, case: &str, work: impl FnMut() -> f32) {
    let (timing, _) = timing::time(work);
    ctx.record(method, case, VERTICES, timing, vec![("ns", 1e9 * timing.median / VERTICES as f64)]);
}

/// A sample and a density, with the features of the vertex and without.
fn whole<G: Guide>(ctx: &mut Context, name: &str, guide: &G) {
    let at = vertices();
    let locals: Vec<(G::Local, [f32; 2])> = at.iter().map(|(q, u)| (guide.local(q), *u)).collect();
    each(ctx, name, "sample", || {
        at.iter().filter_map(|(q, u)| guide.sample(&guide.local(q), *u)).map(|s| s.1).sum()
    });
    each(ctx, name, "density", || at.iter().map(|(q, _)| guide.pdf(&guide.local(q), DIRECTION)).sum());
    each(ctx, name, "sample at a vertex", || {
        locals.iter().filter_map(|(l, u)| guide.sample(l, *u)).map(|s| s.1).sum()
    });
    each(ctx, name, "density at a vertex", || locals.iter().map(|(l, _)| guide.pdf(l, DIRECTION)).sum());
    let points: Vec<(&G::Local, [f32; 2])> = locals.iter().map(|(l, u)| (l, *u)).collect();
    let directions: Vec<(&G::Local, Vec3f)> = locals.iter().map(|(l, _)| (l, DIRECTION)).collect();
    let (mut samples, mut densities) = (vec![None; VERTICES], vec![0.0; VERTICES]);
    each(ctx, name, "sample among all", || {
        guide.sample_all(&points, &mut samples);
        samples.iter().flatten().map(|s: &(Vec3f, f32)| s.1).sum()
    });
    each(ctx, name, "density among all", || {
        guide.pdf_all(&directions, &mut densities);
        densities.iter().sum()
    });
}

/// The parts of a flow of these options.
fn parts(ctx: &mut Context, options: FlowOptions) {
    let mut rng = Rng::new(2, 0);
    let mut random =
        |n: usize, spread: f32| -> Vec<f32> { (0..n).map(|_| rng.uniform(-spread, spread)).collect() };
    let at = vertices();
    for (name, encoding) in [
        ("hash grid", Encoding::Hash(Grid::default())),
        ("planes and lines", Encoding::Tensor(Tensor::default())),
    ] {
        let table = random(encoding.len(), 1.0);
        let mut features = vec![0.0; encoding.features()];
        each(ctx, "parts", name, || {
            let sums = at.iter().map(|(q, _)| {
                encoding.forward(&table, q.position.to_array(), &mut features);
                features[0]
            });
            sums.sum()
        });
    }
    let logits = options.family.logits(options.bins);
    let network = options.couplings().network();
    let (weights, input) = (random(network.len(), 0.2), random(network.inputs + VERTICES, 1.0));
    let (mut hidden, mut outputs) = (Hidden::default(), vec![0.0; network.outputs]);
    each(ctx, "parts", "network", || {
        let sums = (0..VERTICES).map(|i| {
            network.forward(&weights, &input[i..i + network.inputs], &mut hidden, &mut outputs);
            outputs[0]
        });
        sums.sum()
    });
    let logits = random(logits + VERTICES, 2.0);
    each(ctx, "parts", "spline and a point", || {
        (0..VERTICES)
            .map(|i| Spline::new(options.family, options.bins, &logits[i..]).forward(at[i].1[0]).1)
            .sum()
    });
    each(ctx, "parts", "spline and its inverse", || {
        (0..VERTICES)
            .map(|i| Spline::new(options.family, options.bins, &logits[i..]).inverse(at[i].1[0]).1)
            .sum()
    });
    let chart = |q: &Query| Chart::new(Domain::Hemisphere, q.normal, q.wo, 1.0);
    each(ctx, "parts", "chart and a direction", || {
        at.iter().filter_map(|(q, u)| chart(q).direction(*u)).map(|d| d.0.x).sum()
    });
    each(ctx, "parts", "chart and a point", || {
        at.iter().filter_map(|(q, _)| chart(q).point(q.wo)).map(|p| p.0[0]).sum()
    });
}
