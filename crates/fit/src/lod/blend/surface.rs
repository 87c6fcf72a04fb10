//! A level as a welded surface: its connected parts, and the lines at which it ends or another material begins.

use crate::FitError;
use crate::bake::BakeError;
use photofit_geometry::Edges;
use photofit_geometry::decimate::components;
use photofit_geometry::weld::weld_exact;
use photofit_rays::{Accel, NearestPoint};
use photofit_scalar::Vec3f;
use photofit_scene::{FlatScene, Scene};

/// How far a point may be that is looked for, in distances of the nearest one, beyond [`Surface::reach`].
const FARTHER: f32 = 4.0;
/// [`Surface::reach`] as a share of the diagonal.
const REACH: f32 = 0.05;

/// No part, no material.
pub(super) const NONE: u32 = u32::MAX;

/// Materials on the sides of a line, by their places in the list of names, ascending; both [`NONE`] on open borders.
type Key = [u32; 2];

/// A level, welded by position.
pub(super) struct Surface {
    pub(super) edges: Edges,
    /// Of each welded vertex.
    pub(super) positions: Vec<Vec3f>,
    /// Welded, in the order of the level.
    pub(super) triangles: Vec<[u32; 3]>,
    /// Unit normals of triangles; zero where there is no area.
    pub(super) face: Vec<Vec3f>,
    /// Unit normals of vertices, weighted by area.
    pub(super) normals: Vec<Vec3f>,
    /// Connected part of each triangle, and their number.
    pub(super) part: Vec<u32>,
    pub(super) parts: usize,
    /// Connected part of each vertex; [`NONE`] for loose ones.
    pub(super) part_of: Vec<u32>,
    pub(super) accel: Accel,
    pub(super) lines: Lines,
    /// Farther than this beyond the nearest point no other one is looked for.
    pub(super) reach: f32,
}

/// The closest point to `p` that `accept` lets pass and that is not much farther than the closest of all: what is asked for need
/// not be anywhere, and a search for it would visit every triangle.
pub(super) fn nearest_where(
    accel: &Accel,
    p: Vec3f,
    reach: f32,
    accept: impl Fn(&NearestPoint) -> bool,
) -> Option<NearestPoint> {
    let nearest = accel.closest_point(p, f32::INFINITY)?;
    if accept(&nearest) {
        return Some(nearest);
    }
    accel.closest_point_where(p, FARTHER * nearest.distance + reach, accept)
}

/// Edges at which a surface ends or another material begins.
pub(super) struct Lines {
    /// Ends of each, welded.
    ends: Vec<[u32; 2]>,
    keys: Vec<Key>,
    /// Connected part of each.
    part: Vec<u32>,
    /// The segments as triangles without area.
    accel: Accel,
    /// Lines at each vertex.
    at: Vec<Vec<u32>>,
    /// Whether each edge is one.
    is_line: Vec<bool>,
}

pub(super) fn accel(positions: &[Vec3f], triangles: &[[u32; 3]]) -> Result<Accel, FitError> {
    Ok(Accel::build(positions, triangles).map_err(|source| BakeError::Geometry { mesh: "level", source })?)
}

impl Surface {
    /// `names` are those of the materials that were met so far.
    pub(super) fn new(scene: &Scene, flat: &FlatScene, names: &mut Vec<String>) -> Result<Self, FitError> {
        let weld = weld_exact(&flat.mesh.positions);
        let edges = Edges::new(&flat.mesh.triangles, &weld);
        let positions = weld.pick(&flat.mesh.positions);
        let triangles = weld.triangles(&flat.mesh.triangles);
        let area: Vec<Vec3f> = triangles.iter().map(|t| area_normal(&positions, t)).collect();
        let mut normals = vec![Vec3f::zero(); positions.len()];
        let (part, parts) = components(&triangles, positions.len());
        let mut part_of = vec![NONE; positions.len()];
        for ((t, a), part) in triangles.iter().zip(&area).zip(&part) {
            for v in t {
                normals[*v as usize] += *a;
                part_of[*v as usize] = *part;
            }
        }
        normals.iter_mut().for_each(|n| *n = n.normalize_or_zero());
        let accel = accel(&positions, &triangles)?;
        let name = |m: &u32| {
            let name = &scene.materials[*m as usize].name;
            // Names are optional.
            let name = if name.is_empty() { format!("#{m}") } else { name.clone() };
            names.iter().position(|n| *n == name).unwrap_or_else(|| {
                names.push(name);
                names.len() - 1
            }) as u32
        };
        let material: Vec<u32> = flat.triangle_material.iter().map(name).collect();
        let lines = Lines::new(&positions, &edges, &material, &part)?;
        let face = area.iter().map(|a| a.normalize_or_zero()).collect();
        let first = positions.first().copied().unwrap_or_default();
        let (lo, hi) = positions.iter().fold((first, first), |(lo, hi), p| (lo.min(*p), hi.max(*p)));
        let reach = REACH * (hi - lo).length();
        Ok(Self { edges, positions, triangles, face, normals, part, parts, part_of, accel, lines, reach })
    }

    /// The largest coordinate.
    pub(super) fn scale(&self) -> f32 {
        self.positions.iter().flat_map(|p| p.to_array()).fold(0.0, |m, x| m.max(x.abs()))
    }

    /// The place of a nearest point.
    pub(super) fn point(&self, p: &NearestPoint) -> Vec3f {
        let [a, b, c] = self.triangles[p.triangle as usize].map(|v| self.positions[v as usize]);
        // Corners to the bit, which exact matches and pins rely on.
        match (p.u, p.v) {
            (u, v) if u <= 0.0 && v <= 0.0 => a,
            (u, _) if u >= 1.0 => b,
            (_, v) if v >= 1.0 => c,
            (u, v) => a * (1.0 - u - v) + b * u + c * v,
        }
    }
}

/// Normal of a triangle times twice its area.
pub(super) fn area_normal(positions: &[Vec3f], t: &[u32; 3]) -> Vec3f {
    let [a, b, c] = t.map(|v| positions[v as usize]);
    (b - a).cross(c - a)
}

impl Lines {
    fn new(positions: &[Vec3f], edges: &Edges, material: &[u32], part: &[u32]) -> Result<Self, FitError> {
        let (mut ends, mut keys, mut parts) = (Vec::new(), Vec::new(), Vec::new());
        let mut at = vec![Vec::new(); positions.len()];
        let mut is_line = vec![false; edges.len()];
        for (e, &[a, b]) in edges.vertices.iter().enumerate() {
            let halves = edges.half_edges.row(e);
            let of = |h: &u32| material[*h as usize / 3];
            let (lo, hi) = halves.iter().map(of).fold((NONE, 0), |(lo, hi), m| (lo.min(m), hi.max(m)));
            let key = match halves.len() {
                1 => [NONE; 2],
                _ if lo != hi => [lo, hi],
                _ => continue,
            };
            for v in [a, b] {
                at[v as usize].push(ends.len() as u32);
            }
            is_line[e] = true;
            ends.push([a, b]);
            keys.push(key);
            parts.push(part[halves[0] as usize / 3]);
        }
        let segments: Vec<[u32; 3]> = ends.iter().map(|&[a, b]| [a, b, b]).collect();
        Ok(Self { accel: accel(positions, &segments)?, ends, keys, part: parts, at, is_line })
    }

    /// Whether an edge is one.
    pub(super) fn is_line(&self, edge: usize) -> bool {
        self.is_line[edge]
    }

    /// The kinds of the lines at a vertex.
    pub(super) fn kinds(&self, vertex: u32) -> impl Iterator<Item = Key> + '_ {
        self.at[vertex as usize].iter().map(|l| self.keys[*l as usize])
    }

    /// The length of the longest line at a vertex.
    pub(super) fn longest(&self, positions: &[Vec3f], vertex: u32) -> f32 {
        let length = |l: &u32| {
            let [a, b] = self.ends[*l as usize].map(|v| positions[v as usize]);
            (b - a).length()
        };
        self.at[vertex as usize].iter().map(length).fold(0.0, f32::max)
    }

    /// The closest point, of lines of these kinds on `allowed` parts, to `p`, which lies at lines of the length `own`; not much farther
    /// than the closest of all lines ([`nearest_where`]).
    pub(super) fn closest(
        &self,
        positions: &[Vec3f],
        p: Vec3f,
        [own, reach]: [f32; 2],
        kinds: &[Key],
        allowed: impl Fn(u32) -> bool,
    ) -> Option<Vec3f> {
        let wanted = |n: &NearestPoint| {
            let l = n.triangle as usize;
            allowed(self.part[l]) && kinds.contains(&self.keys[l])
        };
        let found = nearest_where(&self.accel, p, reach.max(own), wanted)?;
        let [a, b] = self.ends[found.triangle as usize].map(|v| positions[v as usize]);
        // What is farther than both are long is another line, such as that of a hole that was closed.
        let t = found.u + found.v;
        let at = if t <= 0.0 {
            a
        } else if t >= 1.0 {
            b
        } else {
            a + (b - a) * t
        };
        (found.distance <= (b - a).length().max(own)).then_some(at)
    }
}
