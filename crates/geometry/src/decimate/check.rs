//! Which collapses keep the surface in shape.

use super::engine::Engine;
use glam::DVec3;

/// Rules of a stage.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rules {
    /// Smallest cosine between normals before and after; below -1 everything passes.
    pub(super) min_cosine: f64,
    /// Smallest compactness.
    pub(super) min_compactness: f64,
    /// Whether pinching is refused.
    pub(super) keep_manifold: bool,
    /// Whether open borders stay where they are.
    pub(super) keep_border: bool,
    /// Largest mean squared error.
    pub(super) max_error2: f64,
}

/// Most triangles around a merged vertex, unless one end has more already.
const MAX_FAN: usize = 48;

impl Engine<'_> {
    /// Whether the loaded edge can collapse to `at` without folding, slivers or flipped uvs.
    pub(super) fn is_shapely(&mut self, u: u32, v: u32, at: DVec3, rules: &Rules) -> bool {
        let (n, m) = (self.scratch.first.len(), self.scratch.second.len());
        // Fans may not grow beyond bounds under any rules: time per collapse goes with them.
        if (n + m).saturating_sub(4) > n.max(m).max(MAX_FAN) {
            return false;
        }
        if rules.min_cosine < -1.0 {
            return true;
        }
        for (list, own, other) in [(&self.scratch.first, u, v), (&self.scratch.second, v, u)] {
            let p = self.positions[own as usize];
            for &c in list {
                let (a, b) = self.topology.others(c);
                if a == other || b == other {
                    continue;
                }
                let (pa, pb) = (self.positions[a as usize], self.positions[b as usize]);
                let before = (pa - p).cross(pb - p);
                let after = (pa - at).cross(pb - at);
                let edge2 = pa.distance_squared(pb);
                let sum_before = edge2 + pa.distance_squared(p) + pb.distance_squared(p);
                let sum_after = edge2 + pa.distance_squared(at) + pb.distance_squared(at);
                let (n0, n1) = (before.length(), after.length());
                // Degenerate triangles have no normal to keep.
                if n0 <= 1e-9 * sum_before {
                    continue;
                }
                if before.dot(after) < rules.min_cosine * n0 * n1 || n1 <= 1e-9 * sum_after {
                    return false;
                }
                let compact = |n: f64, s: f64| 2.0 * 3.0_f64.sqrt() * n / s;
                let (c0, c1) = (compact(n0, sum_before), compact(n1, sum_after));
                if c1 < rules.min_compactness && c1 < c0 {
                    return false;
                }
            }
        }
        self.keeps_uvs(u, v, at)
    }

    /// Whether no uv triangle around the loaded edge turns over.
    fn keeps_uvs(&mut self, u: u32, v: u32, at: DVec3) -> bool {
        let Some(wedges) = &self.wedges else { return true };
        let Some(offset) = wedges.uv else { return true };
        let s = &mut self.scratch;
        let ends = [self.positions[u as usize], self.positions[v as usize]];
        wedges.solve(&s.pairs, at, ends, &mut s.form, &mut s.solved);
        let width = wedges.width;
        let uv = |w: u32| {
            let x = &wedges.values[w as usize * width + offset..][..2];
            [x[0], x[1]]
        };
        let turn = |t: [[f64; 2]; 3]| {
            (t[1][0] - t[0][0]) * (t[2][1] - t[0][1]) - (t[2][0] - t[0][0]) * (t[1][1] - t[0][1])
        };
        for (list, other) in [(&s.first, v), (&s.second, u)] {
            for &c in list {
                let (a, b) = self.topology.others(c);
                if a == other || b == other {
                    continue;
                }
                let of = wedges.corners[c as usize / 3];
                let k = c as usize % 3;
                let class = s.pairs.iter().find(|p| p.wedge == of[k]).map_or(of[k], |p| p.class);
                let row = s.pairs.iter().filter(|p| p.class == p.wedge).position(|p| p.class == class);
                let Some(row) = row else { continue };
                let mut corners = of.map(uv);
                let before = turn(corners);
                corners[k] = [s.solved[row * width + offset], s.solved[row * width + offset + 1]];
                if before * turn(corners) < 0.0 {
                    return false;
                }
            }
        }
        true
    }

    /// Whether the collapse of the loaded edge would pinch the surface: the ends have a common neighbour that is no
    /// apex of a triangle at the edge, or an inner edge joins two borders.
    pub(super) fn pinches(&mut self, u: u32, v: u32) -> bool {
        let s = &mut self.scratch;
        s.stamp += 2;
        let (near, apex) = (s.stamp, s.stamp + 1);
        let mut faces = 0;
        for &c in &s.first {
            let (a, b) = self.topology.others(c);
            if a == v || b == v {
                faces += 1;
                s.mark[if a == v { b } else { a } as usize] = apex;
            }
        }
        for &c in &s.first {
            let (a, b) = self.topology.others(c);
            for w in [a, b] {
                if s.mark[w as usize] != apex {
                    s.mark[w as usize] = near;
                }
            }
        }
        if faces > 1 && self.border[u as usize] && self.border[v as usize] {
            return true;
        }
        let (mark, topology) = (&s.mark, &self.topology);
        s.second.iter().any(|&c| {
            let (a, b) = topology.others(c);
            let common = |w: u32| mark[w as usize] == near && w != v && w != u;
            // A face of which both far corners are apexes closes a tetrahedron.
            common(a)
                || common(b)
                || (a != u && b != u && mark[a as usize] == apex && mark[b as usize] == apex)
        })
    }

    /// Whether the collapse of the loaded edge would take the last triangle of a vertex that stays: at an end, or opposite.
    pub(super) fn strands_fixed(&mut self, u: u32, v: u32) -> bool {
        let apex = |c: &u32| {
            let (a, b) = self.topology.others(*c);
            let far = if a == v { b } else { a };
            ((a == v || b == v) && self.fixed[far as usize]).then_some(far)
        };
        let dies = |triangles: &[[u32; 3]], c: u32| {
            let triangle = &triangles[c as usize / 3];
            triangle.contains(&u) && triangle.contains(&v)
        };
        let mut ends = self.scratch.first.iter().chain(&self.scratch.second);
        let fixed = self.fixed[u as usize] || self.fixed[v as usize];
        if fixed && ends.all(|c| dies(&self.topology.triangles, *c)) {
            return true;
        }
        let apexes: Vec<u32> = self.scratch.first.iter().filter_map(apex).collect();
        apexes.into_iter().any(|w| {
            let mut near = std::mem::take(&mut self.scratch.near);
            self.topology.corners(w, &mut near);
            let stranded = near.iter().all(|c| dies(&self.topology.triangles, *c));
            self.scratch.near = near;
            stranded
        })
    }

    /// Whether a triangle at the loaded edge's ends touches a vertex that stays.
    pub(super) fn is_near_fixed(&self) -> bool {
        let touches =
            |c: &u32| self.topology.triangles[*c as usize / 3].iter().any(|&v| self.fixed[v as usize]);
        self.scratch.first.iter().chain(&self.scratch.second).any(touches)
    }

    /// Whether the collapse of the loaded edge would leave a component without triangles.
    pub(super) fn vanishes(&self, v: u32) -> bool {
        let shared = |c: u32| {
            let (a, b) = self.topology.others(c);
            a == v || b == v
        };
        let mut first = None;
        let mut faces = 0;
        for &c in &self.scratch.first {
            if shared(c) {
                faces += 1;
                first = Some(c / 3);
            }
        }
        first.is_some_and(|t| self.parts[self.part[t as usize] as usize].live <= faces)
    }
}
