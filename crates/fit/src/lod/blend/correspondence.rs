//! Where the vertices of a level go on the surface of the next one.
//!
//! Each goes to the closest point of the next level on a matching connected part that faces the same way, those on open borders
//! and between materials to the closest point of such a line. Sharp corners that the moved surface would miss draw the nearest of
//! its vertices; then vertices move along their normals until both surfaces lie about each other. Texels hardly move along the
//! surface, and no triangle turns over.

use super::surface::{NONE, Surface, accel, area_normal, nearest_where};
use crate::FitError;
use crate::engine::asset::bits;
use photofit_geometry::Csr;
use photofit_rays::NearestPoint;
use photofit_scalar::Vec3f;
use rayon::prelude::*;
use std::collections::{BTreeMap, HashSet};

/// A part of the next level stands for each part that at least this share of its vertices is nearest to.
const LEAST_SHARE: f64 = 0.25;
/// Fewest votes that make a partner of a part that has none by [`LEAST_SHARE`].
const FEWEST_VOTES: usize = 3;
/// Triangles lower than this share of their longest edge count as without area.
const FLAT: f32 = 1e-3;
/// Rounds in which vertices of triangles that turn over stay behind.
const SETTLINGS: usize = 16;
/// Rounds in which vertices of triangles that turn over go between their neighbours.
const RELAXATIONS: usize = 16;

/// A corner that is missed draws a vertex from at most so many times as far as it is missed: where the surface is smooth that would
/// move its texture far along it for little.
const STEEP: f32 = 2.0;
/// How far the fit along normals may move a vertex, in lengths of the edges around it.
const LEEWAY: f32 = 0.15;
/// Rounds of the fit along normals, and the barycentric weights of the points of each triangle that it looks at.
const BALANCES: usize = 8;
const SPREAD: [[f32; 3]; 7] = [
    [1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0],
    [0.5, 0.5, 0.0],
    [0.0, 0.5, 0.5],
    [0.5, 0.0, 0.5],
    [1.0, 0.0, 0.0],
    [0.0, 1.0, 0.0],
    [0.0, 0.0, 1.0],
];

/// A triangle of the moved surface, the weights of its corners at a place, and what this place misses of the next level.
type Miss = (u32, [f32; 3], Vec3f);

/// The vertices of a level on their way to the next.
struct Correspondence<'a> {
    fine: &'a Surface,
    coarse: &'a Surface,
    /// Parts of the next level that stand for each part.
    partners: Vec<Vec<u32>>,
    /// Triangles at each vertex.
    around: Csr,
    /// Where each vertex goes.
    to: Vec<Vec3f>,
    /// Vertices that stay where they are put.
    fixed: Vec<bool>,
}

/// A point of the next level that the moved surface should not miss.
struct Corner {
    point: Vec3f,
    part: u32,
    on_line: bool,
}

/// Where each welded vertex of `fine` goes on `coarse`. What is missed by more than `tolerance` is drawn towards.
pub(super) fn correspondence(
    fine: &Surface,
    coarse: &Surface,
    tolerance: f32,
) -> Result<Vec<Vec3f>, FitError> {
    let mut map = Correspondence::new(fine, coarse);
    map.relax();
    let corners = (0..coarse.positions.len()).filter(|v| coarse.part_of[*v] != NONE).map(|v| Corner {
        point: coarse.positions[v],
        part: coarse.part_of[v],
        on_line: coarse.lines.kinds(v as u32).next().is_some(),
    });
    map.draw(&corners.collect::<Vec<_>>(), tolerance)?;
    for share in [0.5, 0.25, 0.75] {
        let on_edge = |(e, &[a, b]): (usize, &[u32; 2])| {
            let [a, b] = [a, b].map(|v| coarse.positions[v as usize]);
            let triangle = coarse.edges.half_edges.row(e)[0] as usize / 3;
            Corner {
                point: a + (b - a) * share,
                part: coarse.part[triangle],
                on_line: coarse.lines.is_line(e),
            }
        };
        let points: Vec<Corner> = coarse.edges.vertices.iter().enumerate().map(on_edge).collect();
        map.draw(&points, tolerance)?;
    }
    map.balance()?;
    map.settle();
    Ok(map.to)
}

fn mixed(positions: &[Vec3f], t: &[u32; 3], [u, v, w]: [f32; 3]) -> Vec3f {
    let [a, b, c] = t.map(|v| positions[v as usize]);
    a * u + b * v + c * w
}

/// Whether a triangle turns over: it has an area afterwards, and its normal turned by more than 90 degrees.
pub(super) fn turned(before: &[Vec3f], after: &[Vec3f], t: &[u32; 3]) -> bool {
    !flat(after, t) && area_normal(before, t).dot(area_normal(after, t)) < 0.0
}

/// Whether a triangle is without area.
pub(super) fn flat(positions: &[Vec3f], t: &[u32; 3]) -> bool {
    let [a, b, c] = t.map(|v| positions[v as usize]);
    let longest = [b - a, c - b, a - c].iter().map(|e| e.length_squared()).fold(0.0, f32::max);
    area_normal(positions, t).length() <= FLAT * longest
}

/// The parts of `coarse` that stand for each part of `fine`.
fn partners(fine: &Surface, coarse: &Surface) -> Vec<Vec<u32>> {
    let vote = |v: usize| {
        let (p, n, part) = (coarse.positions[v], coarse.normals[v], coarse.part_of[v]);
        if part == NONE {
            return None;
        }
        let facing = |at: &NearestPoint| fine.face[at.triangle as usize].dot(n) > 0.0;
        let found = nearest_where(&fine.accel, p, fine.reach, facing);
        let found = found.or_else(|| fine.accel.closest_point(p, f32::INFINITY))?;
        Some((part, fine.part[found.triangle as usize]))
    };
    let votes: Vec<Option<(u32, u32)>> = (0..coarse.positions.len()).into_par_iter().map(vote).collect();
    let (mut count, mut all) = (BTreeMap::<(u32, u32), usize>::new(), vec![0_usize; coarse.parts]);
    for (c, f) in votes.into_iter().flatten() {
        *count.entry((c, f)).or_default() += 1;
        all[c as usize] += 1;
    }
    let mut partners = vec![Vec::new(); fine.parts];
    for ((c, f), n) in &count {
        if *n as f64 >= LEAST_SHARE * all[*c as usize] as f64 {
            partners[*f as usize].push(*c);
        }
    }
    // One part of the next level may stand for many: of those without a partner, the one that gives a part the most votes, if these
    // are a fair share for the part's vertices.
    let mut vertices = vec![0_usize; fine.parts];
    fine.part_of.iter().filter(|p| **p != NONE).for_each(|p| vertices[*p as usize] += 1);
    let mut most = vec![(0_usize, NONE); fine.parts];
    for ((c, f), n) in count {
        if n > most[f as usize].0 {
            most[f as usize] = (n, c);
        }
    }
    let (total, votes) = (fine.positions.len().max(1) as f64, all.iter().sum::<usize>() as f64);
    for (f, (n, c)) in most.into_iter().enumerate() {
        let fair = LEAST_SHARE * votes * vertices[f] as f64 / total;
        if partners[f].is_empty() && n >= FEWEST_VOTES && n as f64 >= fair {
            partners[f].push(c);
        }
    }
    partners
}

impl<'a> Correspondence<'a> {
    fn new(fine: &'a Surface, coarse: &'a Surface) -> Self {
        let partners = partners(fine, coarse);
        let around = Csr::group(fine.positions.len(), fine.triangles.as_flattened().iter().copied());
        let n = fine.positions.len();
        let (to, fixed) = (Vec::new(), vec![false; n]);
        let mut map = Self { fine, coarse, partners, around, to, fixed };
        let there: HashSet<[u32; 3]> = coarse.positions.iter().map(|p| bits(*p)).collect();
        map.fixed =
            (0..n).map(|v| fine.part_of[v] == NONE || there.contains(&bits(fine.positions[v]))).collect();
        let vanished = map.vanished();
        let to = |v: usize| {
            let p = fine.positions[v];
            match vanished.get(fine.part_of[v] as usize) {
                Some(Some(point)) => *point,
                _ if map.fixed[v] => p,
                _ => map.closest(v, p),
            }
        };
        map.to = (0..n).into_par_iter().map(to).collect();
        for v in 0..n {
            map.fixed[v] |= vanished.get(fine.part_of[v] as usize).is_some_and(Option::is_some);
        }
        map
    }

    /// The point to which each part shrinks that the next level lacks: the closest one to its middle.
    fn vanished(&self) -> Vec<Option<Vec3f>> {
        let fine = self.fine;
        let mut sums = vec![(Vec3f::zero(), 0.0_f32); fine.parts];
        for (p, part) in fine.positions.iter().zip(&fine.part_of).filter(|(_, part)| **part != NONE) {
            let (sum, n) = &mut sums[*part as usize];
            *sum += *p;
            *n += 1.0;
        }
        let point = |((sum, n), partners): (&(Vec3f, f32), &Vec<u32>)| {
            let lost = partners.is_empty() && *n > 0.0;
            let found = lost.then(|| self.coarse.accel.closest_point(*sum * (1.0 / n), f32::INFINITY));
            found.flatten().map(|at| self.coarse.point(&at))
        };
        sums.iter().zip(&self.partners).map(point).collect()
    }

    /// The closest point to `p` of the next level where a vertex may go.
    fn closest(&self, v: usize, p: Vec3f) -> Vec3f {
        let (fine, coarse) = (self.fine, self.coarse);
        let partners = &self.partners[fine.part_of[v] as usize];
        let allowed = |part: u32| partners.binary_search(&part).is_ok();
        let kinds: Vec<_> = fine.lines.kinds(v as u32).collect();
        let lengths = [fine.lines.longest(&fine.positions, v as u32), coarse.reach];
        if !kinds.is_empty()
            && let Some(at) = coarse.lines.closest(&coarse.positions, p, lengths, &kinds, allowed)
        {
            return at;
        }
        let part = |at: &NearestPoint| allowed(coarse.part[at.triangle as usize]);
        let facing =
            |at: &NearestPoint| part(at) && coarse.face[at.triangle as usize].dot(fine.normals[v]) > 0.0;
        let found = nearest_where(&coarse.accel, p, coarse.reach, facing);
        // There are such parts: `vanished` has the others.
        let found = found.or_else(|| coarse.accel.closest_point_where(p, f32::INFINITY, part));
        found.map_or(p, |at| coarse.point(&at))
    }

    fn turns(&self, t: u32) -> bool {
        turned(&self.fine.positions, &self.to, &self.fine.triangles[t as usize])
    }

    /// Triangles that turn over.
    fn turning(&self) -> Vec<u32> {
        (0..self.fine.triangles.len() as u32).into_par_iter().filter(|t| self.turns(*t)).collect()
    }

    /// Vertices of triangles that turn over go between their neighbours, as long as that helps.
    fn relax(&mut self) {
        let rings = self.fine.edges.one_rings();
        let mut bad = self.turning();
        let mut best = (bad.len(), self.to.clone());
        for _ in 0..RELAXATIONS {
            if bad.is_empty() {
                break;
            }
            let mut moving: Vec<u32> = bad.iter().flat_map(|t| self.fine.triangles[*t as usize]).collect();
            moving.sort_unstable();
            moving.dedup();
            let between = |&v: &u32| {
                let ring = rings.row(v as usize);
                let sum = ring.iter().fold(Vec3f::zero(), |sum, u| sum + self.to[*u as usize]);
                self.closest(v as usize, sum * (1.0 / ring.len().max(1) as f32))
            };
            let moved: Vec<Vec3f> = moving.par_iter().map(between).collect();
            for (v, to) in moving.iter().zip(moved).filter(|(v, _)| !self.fixed[**v as usize]) {
                self.to[*v as usize] = to;
            }
            bad = self.turning();
            if bad.len() < best.0 {
                best = (bad.len(), self.to.clone());
            }
        }
        self.to = best.1;
    }

    /// Moves vertices along their normals, so that the moved surface lies about the next level instead of in its convex and out of its
    /// concave edges: a least-squares fit of points of both to each other.
    fn balance(&mut self) -> Result<(), FitError> {
        let (fine, coarse) = (self.fine, self.coarse);
        let points: Vec<(Vec3f, u32, Vec3f)> = coarse
            .triangles
            .iter()
            .zip(coarse.part.iter().zip(&coarse.face))
            .flat_map(|(t, (part, n))| {
                let [a, b, c] = t.map(|v| coarse.positions[v as usize]);
                SPREAD.map(|[u, v, w]| (a * u + b * v + c * w, *part, *n))
            })
            .collect();
        let mut is_partner = vec![false; coarse.parts];
        self.partners.iter().flatten().for_each(|c| is_partner[*c as usize] = true);
        let free: Vec<bool> = (0..fine.positions.len())
            .map(|v| !self.fixed[v] && fine.lines.kinds(v as u32).next().is_none())
            .collect();
        let rings = fine.edges.one_rings();
        let limit: Vec<f32> = (0..fine.positions.len())
            .map(|v| {
                let ring = rings.row(v);
                let length = |u: &u32| (fine.positions[*u as usize] - fine.positions[v]).length();
                LEEWAY * ring.iter().map(length).sum::<f32>() / ring.len().max(1) as f32
            })
            .collect();
        let mut offset = vec![0.0_f32; fine.positions.len()];
        for _ in 0..BALANCES {
            let moved = accel(&self.to, &fine.triangles)?;
            let face: Vec<Vec3f> = fine.triangles.par_iter().map(|t| area_normal(&self.to, t)).collect();
            let onto = |(p, part, n): &(Vec3f, u32, Vec3f)| {
                let same = |at: &NearestPoint| {
                    let t = at.triangle as usize;
                    self.partners[fine.part[t] as usize].binary_search(part).is_ok() && face[t].dot(*n) > 0.0
                };
                if !is_partner[*part as usize] || *n == Vec3f::zero() {
                    return None;
                }
                let at = nearest_where(&moved, *p, fine.reach, same)?;
                let weights = [1.0 - at.u - at.v, at.u, at.v];
                let m = mixed(&self.to, &fine.triangles[at.triangle as usize], weights);
                Some((at.triangle, weights, *p - m))
            };
            let from = |(t, triangle): (usize, &[u32; 3])| {
                let partners = &self.partners[fine.part[t] as usize];
                let n = face[t];
                SPREAD.map(|weights| {
                    if partners.is_empty() || n == Vec3f::zero() {
                        return None;
                    }
                    let m = mixed(&self.to, triangle, weights);
                    let facing = |at: &NearestPoint| {
                        let k = at.triangle as usize;
                        partners.binary_search(&coarse.part[k]).is_ok() && coarse.face[k].dot(n) > 0.0
                    };
                    let at = nearest_where(&coarse.accel, m, coarse.reach, facing)?;
                    Some((t as u32, weights, coarse.point(&at) - m))
                })
            };
            let mut misses: Vec<Option<Miss>> = points.par_iter().map(onto).collect();
            misses.par_extend(fine.triangles.par_iter().enumerate().flat_map_iter(from));
            let mut sums = vec![(Vec3f::zero(), 0.0_f32); fine.positions.len()];
            for (t, weights, miss) in misses.into_iter().flatten() {
                for (v, w) in fine.triangles[t as usize].iter().zip(weights) {
                    let (sum, all) = &mut sums[*v as usize];
                    *sum += miss * w;
                    *all += w;
                }
            }
            for (v, (sum, all)) in sums.into_iter().enumerate().filter(|(v, s)| free[*v] && s.1 > 0.0) {
                let n = fine.normals[v];
                let next = (offset[v] + n.dot(sum) / all).clamp(-limit[v], limit[v]);
                self.to[v] += n * (next - offset[v]);
                offset[v] = next;
            }
        }
        Ok(())
    }

    /// Vertices of triangles that still turn over stay behind, half of the way at a time and in the end where they are.
    fn settle(&mut self) {
        for round in 0..SETTLINGS {
            let mut moving: Vec<u32> =
                self.turning().iter().flat_map(|t| self.fine.triangles[*t as usize]).collect();
            moving.sort_unstable();
            moving.dedup();
            let share = if round < SETTLINGS / 2 { 0.5 } else { 0.0 };
            for v in moving.into_iter().map(|v| v as usize) {
                let from = self.fine.positions[v];
                self.to[v] = from + (self.to[v] - from) * share;
            }
        }
    }

    /// Draws the nearest vertices to points that the moved surface misses by more than `tolerance`; vertices of lines to points on
    /// lines alone.
    fn draw(&mut self, points: &[Corner], tolerance: f32) -> Result<(), FitError> {
        let fine = self.fine;
        let moved = accel(&self.to, &fine.triangles)?;
        let pull = |c: &Corner| {
            let same = |at: &NearestPoint| {
                self.partners[fine.part[at.triangle as usize] as usize].binary_search(&c.part).is_ok()
            };
            let at = nearest_where(&moved, c.point, fine.reach, same)?;
            let on_line = |v: u32| fine.lines.kinds(v).next().is_some();
            let free = |v: &u32| !self.fixed[*v as usize] && (c.on_line || !on_line(*v));
            let near = |v: &u32| (self.to[*v as usize] - c.point).length_squared();
            let corners = fine.triangles[at.triangle as usize];
            let nearest = corners.into_iter().filter(free).min_by(|a, b| near(a).total_cmp(&near(b)))?;
            let sharp = STEEP * at.distance >= near(&nearest).sqrt();
            (at.distance > tolerance && sharp).then(|| (near(&nearest), nearest, c.point))
        };
        let mut pulls: Vec<(f32, u32, Vec3f)> = points.par_iter().filter_map(pull).collect();
        // The sort is stable: the first of equals wins.
        pulls.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (_, v, p) in pulls {
            let v = v as usize;
            if self.fixed[v] {
                continue;
            }
            let turning = |map: &Self| map.around.row(v).iter().filter(|c| map.turns(**c / 3)).count();
            let (was, before) = (self.to[v], turning(self));
            self.to[v] = p;
            if turning(self) > before {
                self.to[v] = was;
            } else {
                self.fixed[v] = true;
            }
        }
        Ok(())
    }
}
