//! State of a decimation: placement, cost and execution of one edge collapse.

use super::Options;
use super::part::{Members, Part};
use super::quadric::Quadric;
use super::topology::{NONE, Topology};
use super::wedge::{Pairing, Wedges};
use glam::DVec3;

/// Most triangles around an edge for which the change of area is looked at.
const AREA_FAN: usize = 128;

/// Where the merged vertex of an edge goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Place {
    /// The minimum of the quadric.
    Best,
    /// The first end.
    First,
    /// The second end.
    Second,
    /// Half way.
    Middle,
}

impl Place {
    pub(super) const ALL: [Self; 4] = [Self::Best, Self::First, Self::Second, Self::Middle];
}

/// Everything that changes while edges collapse.
#[derive(Debug)]
pub(super) struct Engine<'a> {
    pub(super) options: &'a Options,
    pub(super) topology: Topology,
    pub(super) positions: Vec<DVec3>,
    /// Input vertex of a position that never moved, or [`NONE`].
    pub(super) origin: Vec<u32>,
    pub(super) quadrics: Vec<Quadric>,
    /// Unweighted area behind each vertex.
    pub(super) area: Vec<f64>,
    /// Counts the collapses into a vertex; heap entries of older versions are stale.
    pub(super) version: Vec<u32>,
    /// Whether a vertex lies on an open border.
    pub(super) border: Vec<bool>,
    /// Whether a vertex stays where it is under all rules.
    pub(super) fixed: Vec<bool>,
    /// Whether any does.
    pub(super) any_fixed: bool,
    /// Group of each triangle.
    pub(super) group: Vec<u32>,
    /// Component of each triangle.
    pub(super) part: Vec<u32>,
    pub(super) parts: Vec<Part>,
    /// Triangles of each component.
    pub(super) members: Members,
    pub(super) wedges: Option<Wedges>,
    /// Vertex that a vertex was merged into; itself while it lives.
    pub(super) parent: Vec<u32>,
    /// Largest mean squared error of a collapse so far.
    pub(super) worst: f64,
    pub(super) scratch: Scratch,
}

/// Buffers reused by every evaluation.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    /// Corners around the first end.
    pub(super) first: Vec<u32>,
    /// Corners around the second end.
    pub(super) second: Vec<u32>,
    /// Wedge classes of the edge.
    pub(super) pairs: Vec<Pairing>,
    pub(super) form: Vec<f64>,
    pub(super) solved: Vec<f64>,
    /// Neighbours of a merged vertex.
    pub(super) near: Vec<u32>,
    /// Stamp per vertex for neighbour tests.
    pub(super) mark: Vec<u32>,
    pub(super) stamp: u32,
}

/// A priced collapse.
#[derive(Clone, Copy, Debug)]
pub(super) struct Priced {
    pub(super) cost: f64,
    /// Quadric part of the cost over the weight of the quadric.
    pub(super) error2: f64,
    pub(super) at: DVec3,
    /// What the merged quadric gains on top of the sum of both.
    pub(super) extra: f64,
}

impl Engine<'_> {
    /// Loads the corners around both ends and the wedge classes of the edge.
    pub(super) fn load(&mut self, u: u32, v: u32) {
        self.topology.corners(u, &mut self.scratch.first);
        self.load_second(u, v);
    }

    /// As [`Self::load`], with the corners of `u` loaded already.
    pub(super) fn load_second(&mut self, u: u32, v: u32) {
        self.topology.corners(v, &mut self.scratch.second);
        let Some(wedges) = &self.wedges else { return };
        let s = &mut self.scratch;
        s.pairs.clear();
        wedges.collect(&s.first, false, &mut s.pairs);
        wedges.collect(&s.second, true, &mut s.pairs);
        // Corners of one face at both ends merge.
        for &c in &s.first {
            let t = &self.topology.triangles[c as usize / 3];
            let Some(k) = t.iter().position(|&x| x == v) else { continue };
            debug_assert_eq!(t[c as usize % 3], u, "corner list of another vertex");
            let of = &wedges.corners[c as usize / 3];
            join(&mut s.pairs, of[c as usize % 3], of[k]);
        }
    }

    /// Sum of both quadrics with the attributes eliminated.
    fn quadric(&mut self, u: u32, v: u32) -> Quadric {
        let mut q = self.quadrics[u as usize];
        q.add(&self.quadrics[v as usize]);
        if let Some(wedges) = &self.wedges {
            wedges.eliminate(&self.scratch.pairs, &mut q, &mut self.scratch.form);
        }
        q
    }

    /// Whether a vertex must stay where it is; those on borders where these do.
    pub(super) fn is_pinned(&self, v: u32, pin_border: bool) -> bool {
        self.fixed[v as usize] || (pin_border && self.border[v as usize])
    }

    /// Price of a collapse of the loaded edge to a place.
    pub(super) fn price(&mut self, u: u32, v: u32, place: Place, pin_border: bool) -> Priced {
        let q = self.quadric(u, v);
        let (p, r) = (self.positions[u as usize], self.positions[v as usize]);
        let at = match (place, self.is_pinned(u, pin_border), self.is_pinned(v, pin_border)) {
            (_, true, false) => p,
            (_, false, true) => r,
            (Place::First, ..) => p,
            (Place::Second, ..) => r,
            (Place::Middle, ..) => (p + r) * 0.5,
            (Place::Best, ..) => best(&q, p, r),
        };
        let value = q.eval(at);
        let move2 = at.distance_squared(p).max(at.distance_squared(r));
        let few = self.scratch.first.len() + self.scratch.second.len() <= AREA_FAN;
        let extra = if few && self.options.area_weight > 0.0 {
            self.options.area_weight * self.area_change(u, v, at) * move2
        } else {
            0.0
        };
        let weight = q.weight.max(f64::MIN_POSITIVE);
        // The last term only orders collapses that cost nothing.
        let cost = value + extra + 1e-12 * p.distance_squared(r) * weight;
        Priced { cost: if cost.is_finite() { cost } else { f64::MAX }, error2: value / weight, at, extra }
    }

    /// Weighted change of the area around the loaded edge when both ends move to `at`.
    fn area_change(&self, u: u32, v: u32, at: DVec3) -> f64 {
        let mut change = 0.0;
        for (list, own, other) in [(&self.scratch.first, u, v), (&self.scratch.second, v, u)] {
            let p = self.positions[own as usize];
            for &c in list {
                let (a, b) = self.topology.others(c);
                let (pa, pb) = (self.positions[a as usize], self.positions[b as usize]);
                let before = (pa - p).cross(pb - p).length();
                if a == other || b == other {
                    // Counted from both ends.
                    change -= 0.5 * before;
                } else {
                    change += (pa - at).cross(pb - at).length() - before;
                }
            }
        }
        let (qu, qv) = (&self.quadrics[u as usize], &self.quadrics[v as usize]);
        0.5 * change.abs() * self.importance(qu.weight + qv.weight, u, v)
    }

    /// Mean importance around an edge: weight of its quadrics over their area.
    fn importance(&self, weight: f64, u: u32, v: u32) -> f64 {
        let area = self.area[u as usize] + self.area[v as usize];
        if area > 0.0 { weight / area } else { 0.0 }
    }

    /// Merges the loaded edge into `u`.
    pub(super) fn collapse(&mut self, u: u32, v: u32, priced: &Priced) {
        let at = priced.at;
        if let Some(wedges) = &mut self.wedges {
            let s = &mut self.scratch;
            let ends = [self.positions[u as usize], self.positions[v as usize]];
            wedges.solve(&s.pairs, at, ends, &mut s.form, &mut s.solved);
            wedges.merge(&s.pairs, &s.solved, &mut s.form);
            for &c in s.first.iter().chain(&s.second) {
                let w = &mut wedges.corners[c as usize / 3][c as usize % 3];
                *w = s.pairs.iter().find(|p| p.wedge == *w).map_or(*w, |p| p.class);
            }
        }
        if at != self.positions[u as usize] {
            self.origin[u as usize] =
                if at == self.positions[v as usize] { self.origin[v as usize] } else { NONE };
        }
        self.positions[u as usize] = at;
        let q = self.quadrics[v as usize];
        self.quadrics[u as usize].add(&q);
        self.quadrics[u as usize].c += priced.extra;
        self.area[u as usize] += self.area[v as usize];
        self.border[u as usize] |= self.border[v as usize];
        self.fixed[u as usize] |= self.fixed[v as usize];
        self.worst = self.worst.max(priced.error2);
        self.version[u as usize] += 1;
        self.version[v as usize] += 1;
        self.parent[v as usize] = u;
        let first = std::mem::take(&mut self.scratch.first);
        let second = std::mem::take(&mut self.scratch.second);
        for &c in &second {
            let (a, b) = self.topology.others(c);
            if a == u || b == u {
                self.kill(c / 3);
            }
        }
        self.drop_doubles(&first, &second);
        self.topology.merge(u, &first, &second);
        self.scratch.first = first;
        self.scratch.second = second;
    }

    /// Quadric of a vertex with the attributes of its own corners at their best, for its corner list.
    pub(super) fn memory(&mut self, v: u32, list: &[u32]) -> Quadric {
        let mut q = self.quadrics[v as usize];
        if let Some(wedges) = &self.wedges {
            let s = &mut self.scratch;
            s.pairs.clear();
            wedges.collect(list, false, &mut s.pairs);
            wedges.eliminate(&s.pairs, &mut q, &mut s.form);
        }
        q
    }

    /// Moves a vertex whose wedges [`Self::memory`] has just collected; its attributes follow.
    pub(super) fn shift(&mut self, v: u32, to: DVec3) {
        let from = self.positions[v as usize];
        if let Some(wedges) = &mut self.wedges {
            let s = &mut self.scratch;
            wedges.solve(&s.pairs, to, [from; 2], &mut s.form, &mut s.solved);
            wedges.merge(&s.pairs, &s.solved, &mut s.form);
        }
        self.positions[v as usize] = to;
        self.origin[v as usize] = NONE;
    }

    /// The vertex that a vertex was merged into in the end.
    pub(super) fn root(&mut self, mut v: u32) -> u32 {
        while self.parent[v as usize] != v {
            let up = self.parent[self.parent[v as usize] as usize];
            self.parent[v as usize] = up;
            v = up;
        }
        v
    }

    /// Removes a triangle from its component too.
    pub(super) fn kill(&mut self, t: u32) {
        if self.topology.is_live(t) {
            self.topology.kill(t);
            self.parts[self.part[t as usize] as usize].live -= 1;
        }
    }

    /// Kills triangles of the second end that the collapse turns into copies of triangles of the first.
    fn drop_doubles(&mut self, first: &[u32], second: &[u32]) {
        for &c in second {
            if !self.topology.is_live(c / 3) {
                continue;
            }
            let (a, b) = self.topology.others(c);
            for &d in first {
                if !self.topology.is_live(d / 3) {
                    continue;
                }
                let other = self.topology.others(d);
                let double = |t: u32| {
                    let g = self.group[t as usize] as usize;
                    self.options.double_sided.get(g).copied().unwrap_or(false)
                };
                if other == (a, b) || (other == (b, a) && double(c / 3) && double(d / 3)) {
                    self.kill(c / 3);
                    break;
                }
            }
        }
    }
}

/// Joins the classes of two wedges; the class is named by its first wedge in the list.
fn join(pairs: &mut [Pairing], a: u32, b: u32) {
    let class = |w: u32| pairs.iter().position(|p| p.wedge == w).map_or((0, w), |k| (k, pairs[k].class));
    let (ca, cb) = (class(a).1, class(b).1);
    if ca != cb {
        let (keep, drop) = if class(ca).0 < class(cb).0 { (ca, cb) } else { (cb, ca) };
        for p in pairs.iter_mut().filter(|p| p.class == drop) {
            p.class = keep;
        }
    }
}

/// Minimum of the quadric if it is near the edge, else the minimum on the edge.
fn best(q: &Quadric, p: DVec3, r: DVec3) -> DVec3 {
    let middle = (p + r) * 0.5;
    let reach = 4.0 * p.distance_squared(r);
    match q.minimise(middle) {
        Some(x) if x.distance_squared(middle) <= reach => {
            // An end as good as the minimum (a corner, say) is kept exactly.
            let (value, slack) = (q.eval(x), 1e-9 * p.distance_squared(r) * q.weight);
            let (at_p, at_r) = (q.eval(p), q.eval(r));
            match at_p.min(at_r) <= value + slack {
                true if at_p <= at_r => p,
                true => r,
                false => x,
            }
        }
        _ => match q.minimise_on(p, r) {
            Some(t) if t <= 0.0 => p,
            Some(t) if t >= 1.0 => r,
            Some(t) => p + (r - p) * t,
            None => middle,
        },
    }
}
