//! Joining of neighbouring charts while the joint map stays within the rules.

use super::chart::{Chart, Fill, Places};
use super::cluster::similar_weight;
use super::flatten::flatten;
use super::topology::{NONE, Topology};
use photofit_scalar::{Vec2, vec2};
use std::cmp::Ordering;
use std::collections::{BinaryHeap, HashMap};

/// Triangles that the joining step may flatten, per triangle of the mesh: bounds its time.
const WORK_PER_TRIANGLE: usize = 40;
/// Least part of its bounding rectangle that a joint chart fills.
const MIN_FILL: f64 = 0.6;
/// Least part of its convex hull that a joint chart fills.
const MIN_SOLIDITY: f64 = 0.84;
/// Least mean cosine of the dihedral angle along the border of two charts that join, unless one is tiny.
const MAX_CREASE: f64 = 0.5;
/// A chart with less than this part of the whole area is tiny.
const TINY: f64 = 0.002;
/// A chart with less than this part of the whole area may spoil the shape of its neighbour a little.
const SMALL: f64 = 0.01;
/// Largest part of the whole area that a joint chart may have, unless it fills its rectangle well.
const MAX_SHARE: f64 = 0.1;

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
pub(super) struct Joiner<'a> {
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
    pub(super) fn new(topo: &'a Topology, bound: f64, charts: Vec<Chart>, sewn: Vec<bool>) -> Self {
        let count = charts.len();
        let mut joiner = Self {
            topo,
            bound,
            perimeter: charts.iter().map(|c| c.perimeter(topo)).collect(),
            fill: charts.iter().map(Chart::fill).collect(),
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
        let mut total = 0.0;
        let (mut ma, mut mb) = (Vec2::zero(), Vec2::zero());
        for &(weight, p, q) in &points {
            total += weight;
            ma += p * weight;
            mb += q * weight;
        }
        (ma, mb) = (ma * (1.0 / total), mb * (1.0 / total));
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

    /// Joins the best pair again and again until none is left.
    pub(super) fn run(mut self) -> Vec<Chart> {
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
        let slack = if cb.area < SMALL * self.total { 0.9 } else { 1.0 };
        let small = cb.area < 0.05 * ca.area;
        place_parts(&mut chart, ca, cb, motion, small);
        let fine = self.shape_rule(&chart, parts, 0.85 * slack)
            && flatten(&mut chart, self.topo, self.bound, 6)
            && self.shape_rule(&chart, parts, slack);
        if fine {
            let fill = chart.fill();
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
        let new = chart.fill();
        // A part that breaks a rule by itself may grow as long as it does not get worse.
        let fill = MIN_FILL.min(parts.0.rectangle).min(parts.1.rectangle.max(0.8 * MIN_FILL));
        let solidity = MIN_SOLIDITY.min(parts.0.hull).min(parts.1.hull.max(0.8 * MIN_SOLIDITY));
        let longest = new.max_length() * self.total.sqrt();
        let longest = longest.max(1.05 * parts.0.long.max(parts.1.long));
        let share = chart.area / self.total;
        new.rectangle >= fill * slack
            && new.hull >= solidity * slack
            && new.long * slack <= longest
            && (share <= MAX_SHARE || new.rectangle >= 0.9)
    }
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
