//! Refinement of the first segmentation: patches grown anew from their middles, then boundaries straightened.

use super::cluster::similar_weight;
use super::topology::{NONE, Topology};
use photofit_scalar::Vec3;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Cost of a step against the mean normal of the patch, and of one across a crease.
const BEND: f64 = 8.0;
const FOLD: f64 = 8.0;

/// Grows every patch anew from its middle (Lloyd's step of Cohen-Steiner et al., with the path cost of Sander et al.,
/// "Multi-chart geometry images", 2003): a step costs its length, more where the normal leaves that of the patch and
/// across creases.
pub(super) fn regrow(topo: &Topology, label: &mut [u32], count: u32) {
    let count = count as usize;
    let patches = Proxy::of_patches(topo, label, count);
    let mut seed = vec![(f64::INFINITY, NONE); count];
    for (t, &l) in label.iter().enumerate().filter(|x| *x.1 != NONE) {
        let patch = &patches[l as usize];
        let off = (topo.centroid(t as u32) - patch.middle).length_squared();
        let key = off + patch.area * (1.0 - topo.normal[t].dot(patch.normal));
        if key < seed[l as usize].0 {
            seed[l as usize] = (key, t as u32);
        }
    }
    let mut distance = vec![f64::INFINITY; label.len()];
    let mut heap = BinaryHeap::new();
    for (l, &(_, t)) in seed.iter().enumerate() {
        distance[t as usize] = 0.0;
        heap.push(Reverse((0_u64, t, l as u32)));
    }
    let old = label.to_vec();
    label.fill(NONE);
    while let Some(Reverse((bits, t, l))) = heap.pop() {
        if label[t as usize] != NONE {
            continue;
        }
        label[t as usize] = l;
        for h in 3 * t..3 * t + 3 {
            let o = topo.opposite[h as usize];
            let n = (o / 3) as usize;
            if o == NONE || label[n] != NONE || !patches[l as usize].accepts(topo, n) {
                continue;
            }
            let bend = 1.0 - topo.normal[n].dot(patches[l as usize].normal);
            let fold = 1.0 - topo.crease(h);
            let step = (topo.centroid(o / 3) - topo.centroid(t)).length();
            let next = f64::from_bits(bits) + step * (1.0 + BEND * bend + FOLD * fold);
            if next < distance[n] {
                distance[n] = next;
                // The bits of non-negative floats order as the floats do.
                heap.push(Reverse((next.to_bits(), o / 3, l)));
            }
        }
    }
    // Cut off by importance: these stay with the others of their old patch.
    for (l, &o) in label.iter_mut().zip(&old) {
        if *l == NONE && o != NONE {
            *l = count as u32 + o;
        }
    }
}

/// What a patch is, as a whole.
#[derive(Clone, Copy, Default)]
struct Proxy {
    normal: Vec3<f64>,
    middle: Vec3<f64>,
    area: f64,
    weighted: f64,
}

impl Proxy {
    fn of_patches(topo: &Topology, label: &[u32], count: usize) -> Vec<Self> {
        let mut all = vec![Self::default(); count];
        for (t, &l) in label.iter().enumerate().filter(|x| *x.1 != NONE) {
            let area = topo.area(t as u32);
            let p = &mut all[l as usize];
            p.normal += topo.normal[t] * area;
            p.middle += topo.centroid(t as u32) * area;
            p.area += area;
            p.weighted += area * topo.weight[t];
        }
        for p in &mut all {
            p.normal = p.normal.normalize_or_zero();
            p.middle *= 1.0 / p.area.max(1e-300);
        }
        all
    }

    /// True when the importance of triangle `t` suits the patch.
    fn accepts(&self, topo: &Topology, t: usize) -> bool {
        similar_weight(self.area, self.weighted, 1.0, topo.weight[t])
    }
}

/// Moves boundary triangles to a neighbouring patch where that lowers normal deviation plus boundary length. A
/// length along a crease counts less, so that boundaries settle on creases.
pub(super) fn smooth(topo: &Topology, label: &mut [u32]) {
    let count = label.len();
    let mut size = vec![0_u32; count];
    label.iter().filter(|l| **l != NONE).for_each(|&l| size[l as usize] += 1);
    for _ in 0..4 {
        let proxy = Proxy::of_patches(topo, label, count);
        let mut moved = 0;
        for t in 0..count {
            let from = label[t];
            if from == NONE || size[from as usize] == 1 {
                continue;
            }
            let to = best_label(topo, label, &proxy, t);
            if to != from {
                size[from as usize] -= 1;
                size[to as usize] += 1;
                label[t] = to;
                moved += 1;
            }
        }
        if moved == 0 {
            break;
        }
    }
}

fn best_label(topo: &Topology, label: &[u32], proxy: &[Proxy], t: usize) -> u32 {
    let area = topo.area(t as u32);
    let mut sides = [(NONE, 0.0); 3];
    for e in 0..3 {
        let h = 3 * t + e;
        let o = topo.opposite[h];
        if o != NONE {
            let weight = 0.1 + 0.9 * topo.crease(h as u32).max(0.0);
            sides[e] = (label[(o / 3) as usize], topo.length(h as u32) * weight);
        }
    }
    let cost = |l: u32| {
        let cut: f64 = sides.iter().filter(|s| s.0 != NONE && s.0 != l).map(|s| s.1).sum();
        area * (1.0 - topo.normal[t].dot(proxy[l as usize].normal)) + 0.25 * area.sqrt() * cut
    };
    let mut best = (cost(label[t]) - 1e-9 * area, label[t]);
    for (l, _) in sides {
        if l != NONE && l != label[t] && proxy[l as usize].accepts(topo, t) {
            let c = cost(l);
            if c < best.0 {
                best = (c, l);
            }
        }
    }
    best.1
}
