//! The finished atlas: charts scaled, packed, and written as corner uvs; statistics; the split mesh.

use super::chart::{Chart, singular};
use super::pack::{Place, Shape, pack, turn_point};
use super::topology::{NONE, Topology};
use super::{AtlasError, UnwrapOptions};
use crate::Mesh;
use photofit_scalar::{Vec2, Vec2f, Vec3f, vec2};
use std::collections::HashMap;

/// How far the map is from an isometry; all values are at least 1.
///
/// The stretch of a triangle is `max(s1, 1 / s2)` for the singular values `s1 >= s2` of its map from the surface to
/// the texture, relative to the density of its chart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stretch {
    /// Largest stretch of any triangle.
    pub max: f32,
    /// Mean stretch, weighted by surface area.
    pub mean: f32,
    /// Root of the area-weighted mean of `(s1^2 + s2^2) / 2`.
    pub rms: f32,
}

/// A texture atlas of a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Atlas {
    /// Texture coordinates of the corners of each triangle, in `[0, 1]`, origin upper left.
    pub corner_uv: Vec<[Vec2f; 3]>,
    /// Chart of each triangle.
    pub triangle_chart: Vec<u32>,
    /// Number of charts.
    pub charts: u32,
    /// Side of the square, in texels.
    pub size: u32,
    /// Texels kept free between charts and at the border.
    pub padding: u32,
    /// Part of the square inside charts.
    pub occupancy: f32,
    /// Distortion statistics.
    pub stretch: Stretch,
    /// Texels per unit of length of the asset, for an importance of 1.
    pub texels_per_unit: f32,
}

impl Atlas {
    /// The mesh with uvs: a vertex of the input is split only where its uvs differ.
    ///
    /// Returns the mesh (positions, uvs, triangles in the input order) and, for each of its vertices, the index of
    /// the input position it came from.
    ///
    /// # Panics
    /// When `triangles` has another length than the atlas, or an index is outside `positions`.
    pub fn build_mesh(&self, positions: &[Vec3f], triangles: &[[u32; 3]]) -> (Mesh, Vec<u32>) {
        assert_eq!(triangles.len(), self.corner_uv.len(), "one entry of the atlas per triangle");
        let mut known: HashMap<(u32, u32, u32), u32> = HashMap::with_capacity(positions.len() * 2);
        let mut mesh = Mesh::default();
        let mut source = Vec::new();
        for (tri, uv) in triangles.iter().zip(&self.corner_uv) {
            let mut corner = [0; 3];
            for k in 0..3 {
                let key = (tri[k], uv[k].x.to_bits(), uv[k].y.to_bits());
                corner[k] = *known.entry(key).or_insert_with(|| {
                    mesh.positions.push(positions[tri[k] as usize]);
                    mesh.uvs.push(uv[k]);
                    source.push(tri[k]);
                    source.len() as u32 - 1
                });
            }
            mesh.triangles.push(corner);
        }
        (mesh, source)
    }
}

/// Scales the charts by importance, packs them and collects the result.
pub(super) fn lay_out(
    topo: &Topology,
    mut charts: Vec<Chart>,
    group: &[u32],
    options: &UnwrapOptions,
) -> Result<Atlas, AtlasError> {
    let size = options.size;
    let padding = options.padding.unwrap_or((size / 256).max(2));
    let stretch = statistics(topo, &mut charts);
    let mut shapes = Vec::with_capacity(charts.len());
    for c in &mut charts {
        let density = (c.weighted / c.area).sqrt();
        c.uv.iter_mut().for_each(|p| *p *= density);
        let box_size = c.align();
        let outline = c.border.iter().map(|b| [b.from, b.to].map(|v| c.uv[v as usize])).collect();
        shapes.push(Shape { outline, size: box_size, area: c.uv_area() });
    }
    let lost = Lost::new(topo, group, charts.len());
    for _ in 0..lost.groups.len() {
        shapes.push(Shape { outline: vec![[Vec2::zero(); 2]], size: Vec2::zero(), area: 0.0 });
    }
    let layout =
        pack(&shapes, size, padding).ok_or(AtlasError::TooManyCharts { charts: shapes.len(), size })?;

    let mut corner_uv = vec![[Vec2f::zero(); 3]; topo.rest.len()];
    let mut triangle_chart = vec![NONE; topo.rest.len()];
    let mut used = 0.0;
    for (id, (c, shape)) in charts.iter().zip(&shapes).enumerate() {
        let place = layout.places[id];
        let uv: Vec<Vec2f> =
            c.uv.iter()
                .map(|&p| to_uv(turn_point(p, shape.size, place.turn) * layout.scale, place, size))
                .collect();
        used += shape.area * layout.scale * layout.scale;
        for (corners, &t) in c.corners.iter().zip(&c.triangles) {
            corner_uv[t as usize] = corners.map(|v| uv[v as usize]);
            triangle_chart[t as usize] = id as u32;
        }
    }
    lost.assign(topo, group, &mut corner_uv, &mut triangle_chart, |i| {
        to_uv(vec2(0.5, 0.5), layout.places[charts.len() + i], size)
    });
    Ok(Atlas {
        corner_uv,
        triangle_chart,
        charts: shapes.len() as u32,
        size,
        padding: layout.padding,
        occupancy: (used / (f64::from(size) * f64::from(size))) as f32,
        stretch,
        texels_per_unit: (layout.scale * topo.scale) as f32,
    })
}

/// Texels with y up to uv with v down.
fn to_uv(p: Vec2<f64>, place: Place, size: u32) -> Vec2f {
    let r = 1.0 / f64::from(size);
    let (x, y) = ((p.x + f64::from(place.x)) * r, 1.0 - (p.y + f64::from(place.y)) * r);
    vec2(x.clamp(0.0, 1.0) as f32, y.clamp(0.0, 1.0) as f32)
}

fn statistics(topo: &Topology, charts: &mut [Chart]) -> Stretch {
    let (mut max, mut mean, mut square, mut area) = (1.0_f64, 0.0, 0.0, 0.0);
    for c in charts {
        c.rescale();
        for i in 0..c.triangles.len() {
            let (s1, s2) = singular(c.jacobian(topo, i));
            let a = topo.area(c.triangles[i]);
            let s = s1.max(1.0 / s2);
            max = max.max(s);
            mean += a * s;
            square += a * 0.5 * (s1 * s1 + s2 * s2);
            area += a;
        }
    }
    if area > 0.0 {
        Stretch { max: max as f32, mean: (mean / area) as f32, rms: (square / area).sqrt() as f32 }
    } else {
        Stretch { max: 1.0, mean: 1.0, rms: 1.0 }
    }
}

/// Degenerate triangles: each lies on an edge of a neighbour, or in the spare texel of its group.
struct Lost {
    /// Per degenerate triangle, in order of dependence: itself and the corners `(own, neighbour's half-edge)`.
    attached: Vec<(u32, u32)>,
    /// Degenerate triangles without such a neighbour.
    alone: Vec<u32>,
    /// Their groups, sorted.
    groups: Vec<u32>,
    first_chart: u32,
}

impl Lost {
    fn new(topo: &Topology, group: &[u32], charts: usize) -> Self {
        let mut lost =
            Self { attached: Vec::new(), alone: Vec::new(), groups: Vec::new(), first_chart: charts as u32 };
        let all: Vec<u32> = (0..topo.rest.len() as u32).filter(|&t| topo.degenerate[t as usize]).collect();
        if all.is_empty() {
            return lost;
        }
        let edge = |t: u32, e: usize| {
            let v = topo.vertex[t as usize];
            let (a, b) = (v[e], v[(e + 1) % 3]);
            (group[t as usize], a.min(b), a.max(b))
        };
        let mut wanted: HashMap<(u32, u32, u32), u32> = HashMap::new();
        for &t in &all {
            (0..3).for_each(|e| {
                wanted.insert(edge(t, e), NONE);
            });
        }
        for t in (0..topo.rest.len() as u32).filter(|&t| !topo.degenerate[t as usize]) {
            for e in 0..3 {
                if let Some(h) = wanted.get_mut(&edge(t, e)) {
                    *h = (*h).min(3 * t + e as u32);
                }
            }
        }
        // The longest edge carries the whole triangle, so try it first.
        for &t in &all {
            let mut sides = [0, 1, 2];
            let length = |e: usize| topo.length(3 * t + e as u32);
            sides.sort_by(|&a, &b| length(b).total_cmp(&length(a)).then(a.cmp(&b)));
            match sides.iter().map(|&e| wanted[&edge(t, e)]).find(|&h| h != NONE) {
                Some(h) => lost.attached.push((t, h)),
                None => lost.alone.push(t),
            }
        }
        lost.groups = lost.alone.iter().map(|&t| group[t as usize]).collect();
        lost.groups.sort_unstable();
        lost.groups.dedup();
        lost
    }

    fn assign(
        &self,
        topo: &Topology,
        group: &[u32],
        corner_uv: &mut [[Vec2f; 3]],
        triangle_chart: &mut [u32],
        spare: impl Fn(usize) -> Vec2f,
    ) {
        for &(t, h) in &self.attached {
            let (n, e) = ((h / 3) as usize, (h % 3) as usize);
            let (p, q) = (topo.corner(h / 3, e), topo.corner(h / 3, (e + 1) % 3));
            let (a, b) = (corner_uv[n][e], corner_uv[n][(e + 1) % 3]);
            let d = q - p;
            for k in 0..3 {
                let s = (topo.corner(t, k) - p).dot(d) / d.length_squared();
                let s = if s > 0.0 { s.min(1.0) } else { 0.0 } as f32;
                // The ends are taken as they are, so that the vertices stay joined.
                corner_uv[t as usize][k] = if s >= 1.0 { b } else { a + (b - a) * s };
            }
            triangle_chart[t as usize] = triangle_chart[n];
        }
        for &t in &self.alone {
            let i = self.groups.partition_point(|&g| g < group[t as usize]);
            corner_uv[t as usize] = [spare(i); 3];
            triangle_chart[t as usize] = self.first_chart + i as u32;
        }
    }
}
