//! Edge flips that bring the decimated surface closer to the samples of the input.

use super::engine::Engine;
use super::refine::{Sample, nearest};
use super::topology::NONE;
use glam::DVec3;

/// A flip must lower the squared distances to this share.
const GAIN: f64 = 0.98;
/// Smallest compactness of a new triangle that is below that of the old ones.
const MIN_COMPACTNESS: f64 = 0.05;

/// Squared distance of a sample to a triangle.
fn distance2(s: &Sample, p: [DVec3; 3]) -> f64 {
    let at = nearest(s.point, p);
    (p[0] * at.x + p[1] * at.y + p[2] * at.z).distance_squared(s.point)
}

fn compactness(p: [DVec3; 3]) -> f64 {
    let sum = p[0].distance_squared(p[1]) + p[1].distance_squared(p[2]) + p[2].distance_squared(p[0]);
    2.0 * 3.0_f64.sqrt() * (p[1] - p[0]).cross(p[2] - p[0]).length() / sum.max(f64::MIN_POSITIVE)
}

/// Flips every edge that gains; no two flips of a pass share a vertex. Returns the number of flips.
///
/// `of` gives the samples of a live triangle.
pub(super) fn flip<'s>(engine: &mut Engine<'_>, of: impl Fn(u32) -> &'s [Sample]) -> usize {
    let edges = engine.topology.edges();
    let mut locked = vec![false; engine.positions.len()];
    let mut flips = 0;
    for run in edges.chunk_by(|a, b| a.0 == b.0) {
        let &[(key, s), (_, t)] = run else { continue };
        let (u, v) = ((key >> 32) as u32, key as u32);
        if locked[u as usize] || locked[v as usize] || engine.group[s as usize] != engine.group[t as usize] {
            continue;
        }
        let Some((i, j)) = facing(engine, s, t, u, v) else { continue };
        let (a, b) = (engine.topology.triangles[s as usize][i], engine.topology.triangles[t as usize][j]);
        if a == b || locked[a as usize] || locked[b as usize] || has_edge(&edges, a, b) {
            continue;
        }
        // Corners of `s` are (p, q, a) and of `t` (q, p, b), in order.
        let (p, q) = (corner(engine, s, i + 1), corner(engine, s, i + 2));
        let place = |v: u32| engine.positions[v as usize];
        let old = [[place(p), place(q), place(a)], [place(q), place(p), place(b)]];
        let new = [[place(a), place(p), place(b)], [place(b), place(q), place(a)]];
        if !is_shapely(old, new) {
            continue;
        }
        let (mut before, mut after) = (0.0, 0.0);
        for sample in of(s).iter().chain(of(t)) {
            before += sample.weight * distance2(sample, old[0]).min(distance2(sample, old[1]));
            after += sample.weight * distance2(sample, new[0]).min(distance2(sample, new[1]));
        }
        if after >= GAIN * before {
            continue;
        }
        if let Some(wedges) = &mut engine.wedges {
            let (ws, wt) = (wedges.corners[s as usize], wedges.corners[t as usize]);
            let (wa, wb) = (ws[i], wt[j]);
            let (wp, wq) = (ws[(i + 1) % 3], ws[(i + 2) % 3]);
            if wt[(j + 1) % 3] != wq || wt[(j + 2) % 3] != wp {
                continue;
            }
            wedges.corners[s as usize] = [wa, wp, wb];
            wedges.corners[t as usize] = [wb, wq, wa];
        }
        engine.topology.triangles[s as usize] = [a, p, b];
        engine.topology.triangles[t as usize] = [b, q, a];
        for x in [a, b, p, q] {
            locked[x as usize] = true;
        }
        flips += 1;
    }
    if flips > 0 {
        engine.topology.relink();
    }
    flips
}

fn corner(engine: &Engine<'_>, t: u32, k: usize) -> u32 {
    engine.topology.triangles[t as usize][k % 3]
}

/// Positions of the far corners of two triangles that meet at `u v` with opposite directions.
fn facing(engine: &Engine<'_>, s: u32, t: u32, u: u32, v: u32) -> Option<(usize, usize)> {
    let far = |t: u32| (0..3).find(|&k| corner(engine, t, k) != u && corner(engine, t, k) != v);
    let (i, j) = (far(s)?, far(t)?);
    (corner(engine, s, i + 1) == corner(engine, t, j + 2) && corner(engine, s, i) != NONE).then_some((i, j))
}

fn has_edge(edges: &[(u64, u32)], a: u32, b: u32) -> bool {
    let key = (u64::from(a.min(b)) << 32) | u64::from(a.max(b));
    let k = edges.partition_point(|e| e.0 < key);
    edges.get(k).is_some_and(|e| e.0 == key)
}

/// Whether the new pair neither folds nor is thinner than the old pair without need.
fn is_shapely(old: [[DVec3; 3]; 2], new: [[DVec3; 3]; 2]) -> bool {
    let normal = |p: [DVec3; 3]| (p[1] - p[0]).cross(p[2] - p[0]);
    let mean = (normal(old[0]) + normal(old[1])).normalize_or_zero();
    let upright = |p: [DVec3; 3]| {
        let n = normal(p);
        n.dot(mean) > 0.2 * n.length()
    };
    let worst_new = compactness(new[0]).min(compactness(new[1]));
    let worst_old = compactness(old[0]).min(compactness(old[1]));
    upright(new[0]) && upright(new[1]) && (worst_new >= MIN_COMPACTNESS || worst_new >= worst_old)
}
