//! Sets of triangles: sewing, connected parts, and cutting in two.

use super::topology::{NONE, Topology};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Marks the half-edges between triangles of the set.
pub(super) fn sew_inside(topo: &Topology, triangles: &[u32], sewn: &mut [bool], member: &mut [u32]) {
    triangles.iter().for_each(|&t| member[t as usize] = 0);
    for &t in triangles {
        for h in 3 * t..3 * t + 3 {
            let o = topo.opposite[h as usize];
            sewn[h as usize] = o != NONE && member[(o / 3) as usize] == 0;
        }
    }
    triangles.iter().for_each(|&t| member[t as usize] = NONE);
}

/// Connected parts of a set of triangles.
pub(super) fn components(topo: &Topology, triangles: &[u32], member: &mut [u32]) -> Vec<Vec<u32>> {
    triangles.iter().for_each(|&t| member[t as usize] = 0);
    let mut parts = Vec::new();
    for &seed in triangles {
        if member[seed as usize] == NONE {
            continue;
        }
        member[seed as usize] = NONE;
        let mut part = vec![seed];
        let mut at = 0;
        while at < part.len() {
            for h in 3 * part[at]..3 * part[at] + 3 {
                let o = topo.opposite[h as usize];
                if o != NONE && member[(o / 3) as usize] == 0 {
                    member[(o / 3) as usize] = NONE;
                    part.push(o / 3);
                }
            }
            at += 1;
        }
        part.sort_unstable();
        parts.push(part);
    }
    parts
}

/// Cuts a set of at least two triangles into two non-empty parts around two far-apart seeds; steps across creases
/// are longer, so that the cut prefers them. The parts need not hang together.
pub(super) fn bisect(topo: &Topology, triangles: &[u32], member: &mut [u32]) -> (Vec<u32>, Vec<u32>) {
    for (i, &t) in triangles.iter().enumerate() {
        member[t as usize] = i as u32;
    }
    let first = farthest(&distances(topo, triangles, member, 0));
    let from_a = distances(topo, triangles, member, first);
    let from_b = distances(topo, triangles, member, farthest(&from_a));
    for &t in triangles {
        member[t as usize] = NONE;
    }
    let key = |i: usize| match (from_a[i].is_finite(), from_b[i].is_finite()) {
        (true, true) => from_a[i] - from_b[i],
        (true, false) => f64::MIN,
        _ => f64::MAX,
    };
    let mut order: Vec<usize> = (0..triangles.len()).collect();
    order.sort_by(|&i, &j| key(i).total_cmp(&key(j)).then(i.cmp(&j)));
    let n = order.len();
    let natural = order.partition_point(|&i| key(i) < 0.0);
    // Keep the parts balanced, so that repeated cutting ends soon.
    let at = natural.clamp((n / 8).max(1), n - (n / 8).max(1));
    let take = |part: &[usize]| {
        let mut v: Vec<u32> = part.iter().map(|&i| triangles[i]).collect();
        v.sort_unstable();
        v
    };
    (take(&order[..at]), take(&order[at..]))
}

fn farthest(distance: &[f64]) -> usize {
    let mut best = 0;
    for (i, d) in distance.iter().enumerate() {
        if *d > distance[best] {
            best = i;
        }
    }
    best
}

fn distances(topo: &Topology, triangles: &[u32], member: &[u32], seed: usize) -> Vec<f64> {
    let mut distance = vec![f64::INFINITY; triangles.len()];
    let mut heap = BinaryHeap::new();
    distance[seed] = 0.0;
    heap.push((Reverse(0_u64), seed as u32));
    while let Some((Reverse(bits), i)) = heap.pop() {
        let d = f64::from_bits(bits);
        if d > distance[i as usize] {
            continue;
        }
        let t = triangles[i as usize];
        for e in 0..3 {
            let o = topo.opposite[(3 * t + e) as usize];
            if o == NONE || member[(o / 3) as usize] == NONE {
                continue;
            }
            let j = member[(o / 3) as usize];
            let fold = 1.0 + 4.0 * (1.0 - topo.crease(3 * t + e));
            let next = d + (topo.centroid(o / 3) - topo.centroid(t)).length() * fold;
            if next < distance[j as usize] {
                distance[j as usize] = next;
                // The bits of non-negative floats order as the floats do.
                heap.push((Reverse(next.to_bits()), j));
            }
        }
    }
    distance
}
