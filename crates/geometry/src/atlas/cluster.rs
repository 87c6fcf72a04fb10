//! First segmentation: greedy merging of neighbours by normal deviation and compactness, then boundary smoothing.
//!
//! The deviation of a cluster is the L2,1 error of variational shape approximation (Cohen-Steiner et al. 2004): with
//! `S` the area-weighted sum of normals and `A` the area, `sum area |n - S/|S||^2 = 2 (A - |S|)`. The greedy order is
//! that of hierarchical face clustering (Garland et al. 2001).

use super::topology::{NONE, Topology};
use photofit_scalar::Vec3;
use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;
use std::f64::consts::PI;

/// Largest mean of `1 - cos` between the normals of a cluster and their mean.
const MAX_DEVIATION: f64 = 0.10;
/// Weight of non-compactness against deviation.
const COMPACTNESS: f64 = 0.03;
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

/// Moves boundary triangles to a neighbouring patch where that lowers normal deviation plus boundary length. A
/// length along a crease counts less, so that boundaries settle on creases.
fn smooth(topo: &Topology, label: &mut [u32]) {
    let count = label.len();
    let mut sums = vec![Vec3::<f64>::zero(); count];
    let mut size = vec![0_u32; count];
    for t in 0..count {
        if label[t] != NONE {
            sums[label[t] as usize] += topo.normal[t] * topo.area(t as u32);
            size[label[t] as usize] += 1;
        }
    }
    for _ in 0..4 {
        let proxy: Vec<_> = sums.iter().map(|s| s.normalize_or_zero()).collect();
        let mut moved = 0;
        for t in 0..count {
            let from = label[t];
            if from == NONE || size[from as usize] == 1 {
                continue;
            }
            let to = best_label(topo, label, &proxy, t);
            if to != from {
                let share = topo.normal[t] * topo.area(t as u32);
                sums[from as usize] = sums[from as usize] - share;
                sums[to as usize] += share;
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

fn best_label(topo: &Topology, label: &[u32], proxy: &[Vec3<f64>], t: usize) -> u32 {
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
        area * (1.0 - topo.normal[t].dot(proxy[l as usize])) + 0.25 * area.sqrt() * cut
    };
    let mut best = (cost(label[t]) - 1e-9 * area, label[t]);
    for (l, _) in sides {
        if l != NONE && l != label[t] {
            let c = cost(l);
            if c < best.0 {
                best = (c, l);
            }
        }
    }
    best.1
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
