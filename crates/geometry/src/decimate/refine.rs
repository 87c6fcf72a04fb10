//! Least-squares refinement of the vertex positions against the input surface after the collapses.
//!
//! Samples of the input surface are tied to the nearest place on the decimated surface, found by walking from where
//! their own vertices were merged to (so that no sample crosses to another sheet); then every vertex moves to the
//! minimum of the squared distances of its samples along their normals, with the others held (Gauss-Seidel), and so
//! on in rounds. Hoppe et al., "Mesh optimization", 1993, without the changes of topology.

use super::DecimateError;
use super::engine::Engine;
use super::flip::flip;
use super::quadric::Quadric;
use super::refit::{Attributes, refit};
use super::topology::{NONE, Topology};
use glam::DVec3;
use rayon::prelude::*;
use std::ops::ControlFlow;

/// Share of the squared distance across the normal: holds vertices in place along the surface.
const TANGENTIAL: f64 = 0.02;
/// Weight of the accumulated quadric of a vertex against its samples.
const MEMORY: f64 = 0.2;
/// The same where the quadric holds a border or an edge between groups, which samples do not see.
const HELD_MEMORY: f64 = 0.3;
/// Mean squared distance, in diagonals, that a move must gain.
const LEAST_GAIN: f64 = 1e-12;
/// Gauss-Seidel sweeps per round.
const SWEEPS: usize = 2;
/// Most triangles around a vertex that a sample looks at.
const NEAR: usize = 64;
/// Samples per output triangle, and the bounds of their number.
const DENSITY: usize = 24;
const MIN_SAMPLES: usize = 4_000;
const MOST: usize = 250_000;

/// A point of the input surface and its place on the output surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    pub(super) point: DVec3,
    normal: DVec3,
    pub(super) weight: f64,
    /// Output triangle that it lies nearest to, and the barycentric coordinates of its place there.
    pub(super) triangle: u32,
    pub(super) at: DVec3,
    /// Input triangle, and the barycentric coordinates of the second and third corner there.
    pub(super) source: u32,
    pub(super) within: [f64; 2],
}

/// The input surface as it was before the collapses.
#[derive(Debug)]
pub(super) struct Original {
    pub(super) positions: Vec<DVec3>,
    pub(super) triangles: Vec<[u32; 3]>,
    /// Weight per area of each triangle.
    pub(super) weight: Vec<f64>,
    /// What its vertices hold beside positions.
    pub(super) attributes: Option<Attributes>,
}

/// Nearest point of a triangle: its barycentric coordinates (Ericson, Real-Time Collision Detection, 5.1.5).
pub(super) fn nearest(p: DVec3, [a, b, c]: [DVec3; 3]) -> DVec3 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return DVec3::X;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return DVec3::Y;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let t = d1 / (d1 - d3);
        return DVec3::new(1.0 - t, t, 0.0);
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return DVec3::Z;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let t = d2 / (d2 - d6);
        return DVec3::new(1.0 - t, 0.0, t);
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return DVec3::new(0.0, 1.0 - t, t);
    }
    let scale = 1.0 / (va + vb + vc);
    DVec3::new(1.0 - (vb + vc) * scale, vb * scale, vc * scale)
}

/// Stratified samples by weighted area, with the output triangle of the nearest merged vertex to start from.
fn samples(engine: &mut Engine<'_>, original: &Original) -> Vec<Sample> {
    let count = (engine.topology.live * DENSITY).clamp(MIN_SAMPLES, MOST);
    let corners = |t: usize| original.triangles[t].map(|i| original.positions[i as usize]);
    let area = |t: usize| {
        let [a, b, c] = corners(t);
        0.5 * (b - a).cross(c - a).length() * original.weight[t]
    };
    let total: f64 = (0..original.triangles.len()).map(area).sum();
    let step = total / count as f64;
    let mut out = Vec::with_capacity(count + 1);
    if step <= 0.0 || !step.is_finite() {
        return out;
    }
    let mut walked = 0.0;
    let mut list = Vec::new();
    for t in 0..original.triangles.len() {
        let before = walked;
        walked += area(t);
        let (first, last) = ((before / step) as usize, (walked / step) as usize);
        let [a, b, c] = corners(t);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        for k in first..last {
            let mut own = NONE;
            for v in original.triangles[t] {
                let root = engine.root(v);
                engine.topology.corners(root, &mut list);
                if let Some(&corner) = list.first() {
                    own = corner / 3;
                    break;
                }
            }
            if own == NONE {
                continue;
            }
            // The R2 sequence folded into the triangle: even and reproducible.
            let (mut u, mut v) =
                ((k as f64 * 0.754_877_666_246_692_7).fract(), (k as f64 * 0.569_840_290_998_053_2).fract());
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            let point = a + (b - a) * u + (c - a) * v;
            let (source, within) = (t as u32, [u, v]);
            out.push(Sample { point, normal, weight: step, triangle: own, at: DVec3::ZERO, source, within });
        }
    }
    out
}

/// Moves samples to the nearest place on the surface as it is now.
fn place_all(engine: &Engine<'_>, samples: &mut [Sample]) {
    let (topology, positions) = (&engine.topology, &engine.positions);
    samples.par_iter_mut().with_min_len(1 << 12).for_each(|s| place(topology, positions, s));
}

/// Refines; the engine has finished its collapses. `report` hears the finished share.
pub(super) fn refine(
    engine: &mut Engine<'_>,
    original: &Original,
    rounds: u32,
    report: &dyn Fn(f32) -> ControlFlow<()>,
) -> Result<(), DecimateError> {
    engine.topology.relink();
    let mut samples = samples(engine, original);
    if samples.is_empty() {
        return Ok(());
    }
    let held = held(engine);
    let hold_border = engine.options.keep_border;
    let live: Vec<u32> =
        (0..engine.topology.triangles.len() as u32).filter(|&t| engine.topology.is_live(t)).collect();
    let mut slot = vec![NONE; engine.topology.triangles.len()];
    for (k, &t) in live.iter().enumerate() {
        slot[t as usize] = k as u32;
    }
    let mut vertices: Vec<u32> = live.iter().flat_map(|&t| engine.topology.triangles[t as usize]).collect();
    vertices.sort_unstable();
    vertices.dedup();
    for round in 0..rounds {
        if report(round as f32 / rounds as f32).is_break() {
            return Err(DecimateError::Stopped);
        }
        place_all(engine, &mut samples);
        samples.sort_by_key(|s| slot[s.triangle as usize]);
        let mut start = vec![0_usize; live.len() + 1];
        for s in &samples {
            start[slot[s.triangle as usize] as usize + 1] += 1;
        }
        for k in 0..live.len() {
            start[k + 1] += start[k];
        }
        let of = |t: u32| &samples[start[slot[t as usize] as usize]..start[slot[t as usize] as usize + 1]];
        // Flips need samples in place again, so they have rounds of their own.
        if round % 2 == 1 && round + 1 < rounds && flip(engine, of) > 0 {
            continue;
        }
        for _ in 0..SWEEPS {
            for &v in &vertices {
                if !engine.is_pinned(v, hold_border) {
                    relax(engine, v, held[v as usize], of);
                }
            }
        }
    }
    if original.attributes.is_some() {
        place_all(engine, &mut samples);
        refit(engine, original, &samples);
    }
    Ok(())
}

/// Vertices whose quadric holds something that samples do not see: borders, edges between groups, seams.
fn held(engine: &mut Engine<'_>) -> Vec<bool> {
    let mut held = vec![false; engine.positions.len()];
    let edges = engine.topology.edges();
    for run in edges.chunk_by(|a, b| a.0 == b.0) {
        let group = |t: u32| engine.group[t as usize];
        if run.len() != 2 || group(run[0].1) != group(run[1].1) {
            held[(run[0].0 >> 32) as usize] = true;
            held[run[0].0 as u32 as usize] = true;
        }
    }
    held
}

/// Moves a sample to the nearest triangle, walking over neighbours from the present one.
fn place(topology: &Topology, positions: &[DVec3], s: &mut Sample) {
    let mut best = f64::INFINITY;
    let mut from = s.triangle;
    let mut chosen = from;
    for _ in 0..8 {
        let corners = topology.triangles[from as usize];
        for (k, &v) in corners.iter().enumerate() {
            for c in topology.around(v).take(NEAR) {
                let t = c / 3;
                let ids = topology.triangles[t as usize];
                // Seen from an earlier corner already.
                if corners[..k].iter().any(|x| ids.contains(x)) {
                    continue;
                }
                let p = ids.map(|i| positions[i as usize]);
                let at = nearest(s.point, p);
                let q = p[0] * at.x + p[1] * at.y + p[2] * at.z;
                let normal = (p[1] - p[0]).cross(p[2] - p[0]);
                // Back sides count as far away, but still as something where there is nothing else.
                let factor = if normal.dot(s.normal) > 0.0 { 1.0 } else { 16.0 };
                let d = factor * q.distance_squared(s.point);
                if d < best {
                    (best, chosen, s.at) = (d, t, at);
                }
            }
        }
        if chosen == from {
            break;
        }
        from = chosen;
    }
    s.triangle = chosen;
}

/// Moves one vertex to the minimum of its samples and its memory, unless a triangle would turn.
fn relax<'s>(engine: &mut Engine<'_>, v: u32, held: bool, of: impl Fn(u32) -> &'s [Sample]) {
    let mut list = std::mem::take(&mut engine.scratch.first);
    engine.topology.corners(v, &mut list);
    let own = engine.positions[v as usize];
    let mut sum = Quadric::default();
    for &c in &list {
        let corners = engine.topology.triangles[c as usize / 3].map(|i| engine.positions[i as usize]);
        let k = c as usize % 3;
        for s in of(c / 3) {
            let b = s.at[k];
            if b < 1e-3 {
                continue;
            }
            // b (x - own) + q - point: the sample sees the vertex at (point - q) / b + own.
            let q = corners[0] * s.at.x + corners[1] * s.at.y + corners[2] * s.at.z;
            let target = own + (s.point - q) / b;
            let w = s.weight * b * b;
            sum.add(&Quadric::linear(s.normal, -s.normal.dot(target), w));
            sum.add(&Quadric::point(target, w * TANGENTIAL));
        }
    }
    let memory = engine.memory(v, &list);
    sum.add(&memory.scaled(if held { HELD_MEMORY } else { MEMORY }));
    if let Some(x) = sum.minimise(own) {
        // Vertices that are right already stay where they are, to the bit.
        let gain = sum.eval(own) - sum.eval(x);
        let mut step = x - own;
        let tries = if gain > LEAST_GAIN * memory.weight { 3 } else { 0 };
        for _ in 0..tries {
            if keeps_shape(engine, &list, own, own + step) {
                engine.shift(v, own + step);
                break;
            }
            step *= 0.5;
        }
    }
    engine.scratch.first = list;
}

/// Whether no triangle around the vertex turns by more than 60 degrees or becomes a sliver.
fn keeps_shape(engine: &Engine<'_>, list: &[u32], from: DVec3, to: DVec3) -> bool {
    list.iter().all(|&c| {
        let (a, b) = engine.topology.others(c);
        let (a, b) = (engine.positions[a as usize], engine.positions[b as usize]);
        let (before, after) = ((a - from).cross(b - from), (a - to).cross(b - to));
        let (l0, l1) = (before.length(), after.length());
        before.dot(after) >= 0.5 * l0 * l1 && l1 >= 0.2 * l0
    })
}
