//! Charts of a mesh: first patches, each flattened or cut until it can be, then joined while the joint map stays
//! within the rules.

use super::chart::{Chart, Places, hull};
use super::cluster::{bisect, cluster, similar_weight};
use super::flatten::{flatten, polish, project};
use super::topology::{NONE, Topology, cross2};
use photofit_scalar::{Vec2, vec2};
use rayon::prelude::*;
use std::cmp::Ordering;
use std::collections::{BinaryHeap, HashMap};

/// Triangles that the joining step may flatten, per triangle of the mesh: bounds its time.
const WORK_PER_TRIANGLE: usize = 40;
/// Least part of its bounding rectangle that a joint chart fills.
const MIN_FILL: f64 = 0.5;
/// Least part of its convex hull that a joint chart fills.
const MIN_SOLIDITY: f64 = 0.78;
/// Least mean cosine of the dihedral angle along the border of two charts that join, unless one is tiny.
const MAX_CREASE: f64 = 0.5;
/// A chart with less than this part of the whole area is tiny.
const TINY: f64 = 0.002;
/// Largest part of the whole area that a joint chart may have, unless it fills its rectangle well.
const MAX_SHARE: f64 = 0.1;
/// Assumed occupancy of the square when the longest useful chart is estimated.
const ASSUMED_OCCUPANCY: f64 = 0.7;

/// The charts of all non-degenerate triangles, in the order of their first triangle; `bound` is the largest stretch.
pub(super) fn charts(topo: &Topology, bound: f64) -> Vec<Chart> {
    let mut sewn = vec![false; topo.opposite.len()];
    let flat = initial(topo, bound, &mut sewn);
    let mut charts = Joiner::new(topo, bound, flat, sewn).run();
    charts.par_iter_mut().for_each(|c| polish(c, topo, bound));
    charts.sort_by_key(|c| c.triangles.iter().copied().min());
    charts
}

/// Patches of the first segmentation, flattened; a patch that cannot be flattened is cut in two and tried again.
fn initial(topo: &Topology, bound: f64, sewn: &mut [bool]) -> Vec<Chart> {
    let (label, count) = cluster(topo);
    let mut parts = vec![Vec::new(); count as usize];
    for (t, &l) in label.iter().enumerate() {
        if l != NONE {
            parts[l as usize].push(t as u32);
        }
    }
    let mut places = Places::new(label.len());
    let mut member = vec![NONE; label.len()];
    let mut done = Vec::new();
    while !parts.is_empty() {
        let mut tried: Vec<Chart> = parts
            .drain(..)
            .map(|triangles| {
                sew_inside(topo, &triangles, sewn, &mut member);
                Chart::build(topo, triangles, sewn, &mut places)
            })
            .collect();
        let fine: Vec<bool> = tried
            .par_iter_mut()
            .map(|c| {
                project(c, topo);
                flatten(c, topo, bound, 8)
            })
            .collect();
        for (c, fine) in tried.into_iter().zip(fine) {
            if fine || c.triangles.len() == 1 {
                done.push(c);
                continue;
            }
            for &t in &c.triangles {
                (0..3).for_each(|e| sewn[(3 * t + e) as usize] = false);
            }
            let (a, b) = bisect(topo, &c.triangles, &mut member);
            for part in [a, b] {
                parts.extend(components(topo, &part, &mut member));
            }
        }
    }
    done
}

/// Marks the half-edges between triangles of the set.
fn sew_inside(topo: &Topology, triangles: &[u32], sewn: &mut [bool], member: &mut [u32]) {
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
fn components(topo: &Topology, triangles: &[u32], member: &mut [u32]) -> Vec<Vec<u32>> {
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

/// A pair of neighbouring charts; the higher score is tried first.
#[derive(PartialEq)]
struct Pair {
    score: f64,
    a: u32,
    b: u32,
    version: (u32, u32),
}

impl Eq for Pair {}
impl PartialOrd for Pair {
    fn partial_cmp(&self, o: &Self) -> Option<Ordering> {
        Some(self.cmp(o))
    }
}
impl Ord for Pair {
    fn cmp(&self, o: &Self) -> Ordering {
        self.score.total_cmp(&o.score).then((o.a, o.b, o.version).cmp(&(self.a, self.b, self.version)))
    }
}

/// A rigid motion of the plane: rotation (cosine, sine), then translation.
#[derive(Clone, Copy)]
struct Motion {
    turn: Vec2<f64>,
    shift: Vec2<f64>,
}

impl Motion {
    fn apply(self, p: Vec2<f64>) -> Vec2<f64> {
        vec2(self.turn.x * p.x - self.turn.y * p.y, self.turn.y * p.x + self.turn.x * p.y) + self.shift
    }
}

/// Greedy joining of neighbouring charts.
struct Joiner<'a> {
    topo: &'a Topology,
    bound: f64,
    charts: Vec<Option<Chart>>,
    perimeter: Vec<f64>,
    fill: Vec<Fill>,
    version: Vec<u32>,
    chart_of: Vec<u32>,
    sewn: Vec<bool>,
    /// Local vertices of each half-edge's start and end in its chart.
    ends: Vec<(u32, u32)>,
    failures: HashMap<(u32, u32), u32>,
    queue: BinaryHeap<Pair>,
    places: Places,
    total: f64,
}

impl<'a> Joiner<'a> {
    fn new(topo: &'a Topology, bound: f64, charts: Vec<Chart>, sewn: Vec<bool>) -> Self {
        let count = charts.len();
        let mut joiner = Self {
            topo,
            bound,
            perimeter: charts.iter().map(|c| c.perimeter(topo)).collect(),
            fill: charts.iter().map(fill_of).collect(),
            version: vec![0; count],
            chart_of: vec![NONE; topo.rest.len()],
            ends: vec![(0, 0); topo.opposite.len()],
            failures: HashMap::new(),
            queue: BinaryHeap::new(),
            places: Places::new(topo.rest.len()),
            total: charts.iter().map(|c| c.area).sum(),
            charts: charts.into_iter().map(Some).collect(),
            sewn,
        };
        for i in 0..count as u32 {
            joiner.register(i);
        }
        for i in 0..count as u32 {
            joiner.queue_neighbours(i, true);
        }
        joiner
    }

    fn chart(&self, i: u32) -> &Chart {
        self.charts[i as usize].as_ref().expect("a live chart")
    }

    fn register(&mut self, i: u32) {
        let chart = self.charts[i as usize].as_ref().expect("a live chart");
        for &t in &chart.triangles {
            self.chart_of[t as usize] = i;
        }
        for b in &chart.border {
            self.ends[b.half_edge as usize] = (b.from, b.to);
        }
    }

    /// Border half-edges of `a` whose partner belongs to `b`.
    fn shared(&self, a: u32, b: u32) -> Vec<u32> {
        let border = &self.chart(a).border;
        border.iter().map(|x| x.half_edge).filter(|&h| self.beyond(h) == b).collect()
    }

    /// Chart on the other side of a half-edge.
    fn beyond(&self, h: u32) -> u32 {
        let o = self.topo.opposite[h as usize];
        if o == NONE { NONE } else { self.chart_of[(o / 3) as usize] }
    }

    fn queue_neighbours(&mut self, a: u32, only_larger: bool) {
        let mut shared: Vec<(u32, u32)> = self
            .chart(a)
            .border
            .iter()
            .map(|x| (self.beyond(x.half_edge), x.half_edge))
            .filter(|&(b, _)| b != NONE && b != a && (!only_larger || b > a))
            .collect();
        shared.sort_unstable();
        for run in shared.chunk_by(|x, y| x.0 == y.0) {
            let edges: Vec<u32> = run.iter().map(|x| x.1).collect();
            let b = run[0].0;
            let score = self.score(a, b, &edges);
            if score > 0.0 {
                let version = (self.version[a as usize], self.version[b as usize]);
                self.queue.push(Pair { score, a, b, version });
            }
        }
    }

    /// Shared part of the shorter perimeter, lowered where the borders do not match in the plane, at creases, and
    /// after failed tries; zero where the pair may not join.
    fn score(&self, a: u32, b: u32, edges: &[u32]) -> f64 {
        let (ca, cb) = (self.chart(a), self.chart(b));
        if !similar_weight(ca.area, ca.weighted, cb.area, cb.weighted) {
            return 0.0;
        }
        let tries = self.failures.get(&(a.min(b), a.max(b))).copied().unwrap_or(0);
        if tries >= 2 {
            return 0.0;
        }
        let lengths = edges.iter().map(|&h| self.topo.length(h));
        let length: f64 = lengths.clone().sum();
        let mean: f64 = edges.iter().zip(lengths.clone()).map(|(&h, l)| l * self.topo.crease(h)).sum();
        if mean < MAX_CREASE * length && ca.area.min(cb.area) > TINY * self.total {
            return 0.0;
        }
        let crease: f64 = edges.iter().zip(lengths).map(|(&h, l)| l * self.topo.crease(h).max(0.0)).sum();
        let (_, mismatch) = self.motion(a, b, edges);
        let part = length / self.perimeter[a as usize].min(self.perimeter[b as usize]);
        let match_factor = 1.0 / (1.0 + 8.0 * mismatch / length.max(1e-30));
        part * (0.3 + 0.7 * crease / length.max(1e-30)) * match_factor * 0.5_f64.powi(tries as i32)
    }

    /// The rigid motion of chart `b` that best fits its shared border to that of `a`, and the root-mean-square
    /// distance left.
    fn motion(&self, a: u32, b: u32, edges: &[u32]) -> (Motion, f64) {
        let (ua, ub) = (&self.chart(a).uv, &self.chart(b).uv);
        let mut points = Vec::with_capacity(edges.len() * 2);
        for &h in edges {
            let (a0, a1) = self.ends[h as usize];
            let (b1, b0) = self.ends[self.topo.opposite[h as usize] as usize];
            let weight = self.topo.length(h);
            points.push((weight, ua[a0 as usize], ub[b0 as usize]));
            points.push((weight, ua[a1 as usize], ub[b1 as usize]));
        }
        let total: f64 = points.iter().map(|p| p.0).sum();
        let mean = |f: fn(&(f64, Vec2<f64>, Vec2<f64>)) -> Vec2<f64>| {
            points.iter().fold(Vec2::zero(), |s, p| s + f(p) * p.0) * (1.0 / total)
        };
        let (ma, mb) = (mean(|p| p.1), mean(|p| p.2));
        let turn = points.iter().fold(Vec2::zero(), |s, p| {
            let (x, y) = (p.1 - ma, p.2 - mb);
            s + vec2(x.dot(y), y.x * x.y - y.y * x.x) * p.0
        });
        let turn = turn.normalize_or_zero();
        let turn = if turn == Vec2::zero() { vec2(1.0, 0.0) } else { turn };
        let mut motion = Motion { turn, shift: Vec2::zero() };
        motion.shift = ma - motion.apply(mb);
        let left: f64 = points.iter().map(|p| (p.1 - motion.apply(p.2)).length_squared() * p.0).sum();
        (motion, (left / total).sqrt())
    }

    fn run(mut self) -> Vec<Chart> {
        let mut work = WORK_PER_TRIANGLE * self.topo.rest.len();
        while let Some(pair) = self.queue.pop() {
            let (a, b) = (pair.a, pair.b);
            if (self.version[a as usize], self.version[b as usize]) != pair.version {
                continue;
            }
            let size = self.chart(a).triangles.len() + self.chart(b).triangles.len();
            if size > work {
                continue;
            }
            let (a, b) = if self.chart(a).area >= self.chart(b).area { (a, b) } else { (b, a) };
            let edges = self.shared(a, b);
            let arc = self.longest_arc(&edges);
            let mut joint = self.join(a, b, &edges);
            work -= size;
            if joint.is_none() && arc.len() < edges.len() && size <= work {
                joint = self.join(a, b, &arc);
                work -= size;
            }
            let Some((chart, fill)) = joint else {
                *self.failures.entry((a.min(b), a.max(b))).or_insert(0) += 1;
                continue;
            };
            self.perimeter[a as usize] = chart.perimeter(self.topo);
            self.fill[a as usize] = fill;
            self.charts[a as usize] = Some(chart);
            self.charts[b as usize] = None;
            self.version[a as usize] += 1;
            self.version[b as usize] = NONE;
            self.register(a);
            self.queue_neighbours(a, false);
        }
        self.charts.into_iter().flatten().collect()
    }

    /// The longest connected run of the shared half-edges.
    fn longest_arc(&self, edges: &[u32]) -> Vec<u32> {
        let mut next: HashMap<u32, usize> = HashMap::new();
        for (i, &h) in edges.iter().enumerate() {
            next.insert(self.ends[h as usize].0, i);
        }
        let mut arc = vec![usize::MAX; edges.len()];
        let mut lengths: Vec<f64> = Vec::new();
        for i in 0..edges.len() {
            let mut at = i;
            let mut id = lengths.len();
            let mut chain = Vec::new();
            while arc[at] == usize::MAX {
                arc[at] = id;
                chain.push(at);
                match next.get(&self.ends[edges[at] as usize].1) {
                    Some(&n) => at = n,
                    None => break,
                }
            }
            // Running into an earlier run makes this its beginning.
            if arc[at] != id {
                id = arc[at];
                chain.iter().for_each(|&c| arc[c] = id);
            } else if !chain.is_empty() {
                lengths.push(0.0);
            }
            for c in chain {
                lengths[id] += self.topo.length(edges[c]);
            }
        }
        let mut best = 0;
        for (i, l) in lengths.iter().enumerate() {
            if *l > lengths[best] {
                best = i;
            }
        }
        edges.iter().zip(&arc).filter(|x| *x.1 == best).map(|x| *x.0).collect()
    }

    /// Sews `b` to `a` along `edges` and flattens the union; `None`, with nothing changed, where a rule is broken.
    fn join(&mut self, a: u32, b: u32, edges: &[u32]) -> Option<(Chart, Fill)> {
        let (motion, _) = self.motion(a, b, edges);
        self.sew(edges, true);
        let (ca, cb) = (
            self.charts[a as usize].as_ref().expect("a live chart"),
            self.charts[b as usize].as_ref().expect("a live chart"),
        );
        let triangles: Vec<u32> = ca.triangles.iter().chain(&cb.triangles).copied().collect();
        let mut chart = Chart::build(self.topo, triangles, &self.sewn, &mut self.places);
        let parts = (self.fill[a as usize], self.fill[b as usize]);
        let small = cb.area < 0.05 * ca.area;
        place_parts(&mut chart, ca, cb, motion, small);
        let fine = self.shape_rule(&chart, parts, 0.85)
            && flatten(&mut chart, self.topo, self.bound, 6)
            && self.shape_rule(&chart, parts, 1.0);
        if fine {
            let fill = fill_of(&chart);
            return Some((chart, fill));
        }
        self.sew(edges, false);
        None
    }

    fn sew(&mut self, edges: &[u32], on: bool) {
        for &h in edges {
            self.sewn[h as usize] = on;
            self.sewn[self.topo.opposite[h as usize] as usize] = on;
        }
    }

    /// The chart must be compact enough to pack well; `slack < 1` loosens the rule.
    fn shape_rule(&self, chart: &Chart, parts: (Fill, Fill), slack: f64) -> bool {
        let new = fill_of(chart);
        let longest = (self.total / ASSUMED_OCCUPANCY).sqrt();
        // A part that breaks a rule by itself may grow as long as it does not get worse.
        let fill = MIN_FILL.min(parts.0.rectangle).min(parts.1.rectangle.max(0.8 * MIN_FILL));
        let solidity = MIN_SOLIDITY.min(parts.0.hull).min(parts.1.hull.max(0.8 * MIN_SOLIDITY));
        let share = chart.area / self.total;
        new.rectangle >= fill * slack
            && new.hull >= solidity * slack
            && new.long * slack <= longest
            && (share <= MAX_SHARE || new.rectangle >= 0.9)
    }
}

/// How much of its surroundings a chart fills.
#[derive(Clone, Copy)]
struct Fill {
    /// Part of the least rectangle.
    rectangle: f64,
    /// Part of the convex hull.
    hull: f64,
    /// Longer side of the least rectangle.
    long: f64,
}

fn fill_of(chart: &Chart) -> Fill {
    let hull = hull(&chart.uv);
    let area = chart.uv_area();
    let hull_area: f64 =
        (1..hull.len().max(1) - 1).map(|i| 0.5 * cross2(hull[0], hull[i], hull[i + 1])).sum();
    let size = Chart { uv: hull, ..Chart::default() }.align();
    Fill { rectangle: area / (size.x * size.y).max(1e-300), hull: area / hull_area.max(1e-300), long: size.x }
}

/// Fills the plane positions of a joint chart (triangles of `a`, then of `b`) from those of its parts.
fn place_parts(chart: &mut Chart, a: &Chart, b: &Chart, motion: Motion, keep_a: bool) {
    let mut seen = vec![0_u8; chart.uv.len()];
    for (i, c) in a.corners.iter().enumerate() {
        for k in 0..3 {
            let v = chart.corners[i][k] as usize;
            chart.uv[v] = a.uv[c[k] as usize];
            seen[v] = 1;
        }
    }
    for (i, c) in b.corners.iter().enumerate() {
        for k in 0..3 {
            let v = chart.corners[a.corners.len() + i][k] as usize;
            let p = motion.apply(b.uv[c[k] as usize]);
            match seen[v] {
                0 => chart.uv[v] = p,
                1 if !keep_a => chart.uv[v] = (chart.uv[v] + p) * 0.5,
                _ => {}
            }
            seen[v] |= 2;
        }
    }
}
