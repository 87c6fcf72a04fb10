//! First segmentation: greedy merging of neighbours by normal deviation and compactness, then boundary smoothing.
//!
//! The deviation of a cluster is the L2,1 error of variational shape approximation (Cohen-Steiner et al. 2004): with
//! `S` the area-weighted sum of normals and `A` the area, `sum area |n - S/|S||^2 = 2 (A - |S|)`. The greedy order is
//! that of hierarchical face clustering (Garland et al. 2001).

use super::regrow::{regrow, smooth};
use super::topology::{NONE, Topology};
use photofit_scalar::Vec3;
use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;
use std::f64::consts::PI;

/// Largest mean of `1 - cos` between the normals of a cluster and their mean.
const MAX_DEVIATION: f64 = 0.05;
/// Weight of non-compactness against deviation.
const COMPACTNESS: f64 = 0.1;
/// Repetitions of the regrowth.
const LLOYD_STEPS: usize = 3;
/// Largest ratio of the mean importance of two clusters that may join.
pub(super) const MAX_WEIGHT_RATIO: f64 = 2.25;

/// Marks of a cluster that add up.
#[derive(Clone, Copy, Default)]
struct Sums {
    normal: Vec3<f64>,
    area: f64,
    weighted: f64,
    perimeter: f64,
}

impl Sums {
    fn join(&self, o: &Self, shared: f64) -> Self {
        Self {
            normal: self.normal + o.normal,
            area: self.area + o.area,
            weighted: self.weighted + o.weighted,
            perimeter: (self.perimeter + o.perimeter - 2.0 * shared).max(0.0),
        }
    }

    fn deviation(&self) -> f64 {
        1.0 - self.normal.length() / self.area
    }

    /// Cost of this cluster as the result of a merge; `None` where it is not allowed.
    fn cost(&self) -> Option<f64> {
        let deviation = self.deviation();
        // A closed surface has no boundary to flatten it from.
        if deviation > MAX_DEVIATION || self.perimeter * self.perimeter < 0.5 * self.area {
            return None;
        }
        let roundness = self.perimeter * self.perimeter / (4.0 * PI * self.area);
        Some(deviation + COMPACTNESS * roundness.ln())
    }
}

/// True when the mean importances may share one texel density.
pub(super) fn similar_weight(area_a: f64, weighted_a: f64, area_b: f64, weighted_b: f64) -> bool {
    let (a, b) = (weighted_a * area_b, weighted_b * area_a);
    a <= b * MAX_WEIGHT_RATIO && b <= a * MAX_WEIGHT_RATIO
}

#[derive(PartialEq)]
struct Candidate {
    cost: f64,
    a: u32,
    b: u32,
    version: (u32, u32),
}

impl Eq for Candidate {}
impl PartialOrd for Candidate {
    fn partial_cmp(&self, o: &Self) -> Option<Ordering> {
        Some(self.cmp(o))
    }
}
impl Ord for Candidate {
    fn cmp(&self, o: &Self) -> Ordering {
        self.cost.total_cmp(&o.cost).then((self.a, self.b, self.version).cmp(&(o.a, o.b, o.version)))
    }
}

/// Label of each triangle ([`NONE`] for degenerate ones); every label is one connected patch. Returns the number
/// of labels too.
pub(super) fn cluster(topo: &Topology) -> (Vec<u32>, u32) {
    let mut label = merge(topo);
    for _ in 0..LLOYD_STEPS {
        let count = relabel(topo, &mut label);
        regrow(topo, &mut label, count);
    }
    relabel(topo, &mut label);
    smooth(topo, &mut label);
    let count = relabel(topo, &mut label);
    (label, count)
}

fn merge(topo: &Topology) -> Vec<u32> {
    let count = topo.rest.len();
    let mut sums = vec![Sums::default(); count];
    let mut links: Vec<Vec<(u32, f64)>> = vec![Vec::new(); count];
    for t in 0..count {
        if topo.degenerate[t] {
            continue;
        }
        let area = topo.area(t as u32);
        for e in 0..3 {
            let h = (3 * t + e) as u32;
            let length = topo.length(h);
            sums[t].perimeter += length;
            let o = topo.opposite[h as usize];
            if o != NONE {
                add_link(&mut links[t], o / 3, length);
            }
        }
        sums[t].normal = topo.normal[t] * area;
        sums[t].area = area;
        sums[t].weighted = area * topo.weight[t];
    }
    let mut version = vec![0_u32; count];
    let mut parent: Vec<u32> = (0..count as u32).collect();
    let mut heap = BinaryHeap::new();
    for t in 0..count as u32 {
        push_candidates(&mut heap, &sums, &links, &version, t, true);
    }
    while let Some(Reverse(c)) = heap.pop() {
        let (a, b) = (c.a as usize, c.b as usize);
        if (version[a], version[b]) != c.version {
            continue;
        }
        // The cluster with more neighbours absorbs the other one.
        let (a, b) = if links[a].len() >= links[b].len() { (a, b) } else { (b, a) };
        let shared = links[a].iter().find(|l| l.0 == b as u32).map_or(0.0, |l| l.1);
        sums[a] = sums[a].join(&sums[b], shared);
        parent[b] = a as u32;
        version[a] += 1;
        version[b] = NONE;
        let moved = std::mem::take(&mut links[b]);
        links[a].retain(|l| l.0 != b as u32);
        for (n, length) in moved {
            if n != a as u32 {
                add_link(&mut links[a], n, length);
                let back = &mut links[n as usize];
                back.retain(|l| l.0 != b as u32);
                add_link(back, a as u32, length);
            }
        }
        push_candidates(&mut heap, &sums, &links, &version, a as u32, false);
    }
    (0..count as u32).map(|t| if topo.degenerate[t as usize] { NONE } else { root(&mut parent, t) }).collect()
}

fn add_link(links: &mut Vec<(u32, f64)>, to: u32, length: f64) {
    match links.iter_mut().find(|l| l.0 == to) {
        Some(l) => l.1 += length,
        None => links.push((to, length)),
    }
}

fn push_candidates(
    heap: &mut BinaryHeap<Reverse<Candidate>>,
    sums: &[Sums],
    links: &[Vec<(u32, f64)>],
    version: &[u32],
    a: u32,
    only_larger: bool,
) {
    let sa = &sums[a as usize];
    for &(b, shared) in &links[a as usize] {
        let sb = &sums[b as usize];
        if b == a || only_larger && b < a || !similar_weight(sa.area, sa.weighted, sb.area, sb.weighted) {
            continue;
        }
        if let Some(cost) = sa.join(sb, shared).cost() {
            heap.push(Reverse(Candidate { cost, a, b, version: (version[a as usize], version[b as usize]) }));
        }
    }
}

fn root(parent: &mut [u32], mut t: u32) -> u32 {
    while parent[t as usize] != t {
        parent[t as usize] = parent[parent[t as usize] as usize];
        t = parent[t as usize];
    }
    t
}

/// Numbers the connected patches from 0 in the order of their first triangle.
fn relabel(topo: &Topology, label: &mut [u32]) -> u32 {
    let old = label.to_vec();
    label.fill(NONE);
    let mut count = 0;
    let mut stack = Vec::new();
    for seed in 0..old.len() {
        if old[seed] == NONE || label[seed] != NONE {
            continue;
        }
        label[seed] = count;
        stack.push(seed);
        while let Some(t) = stack.pop() {
            for e in 0..3 {
                let o = topo.opposite[3 * t + e];
                let n = (o / 3) as usize;
                if o != NONE && label[n] == NONE && old[n] == old[seed] {
                    label[n] = count;
                    stack.push(n);
                }
            }
        }
        count += 1;
    }
    count
}
