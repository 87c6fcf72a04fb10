//! Vertex attributes as wedges with attribute quadrics (Hoppe 1999).
//!
//! A wedge is one set of attributes at a position; the corners of triangles point to wedges. Over a face each
//! attribute is `s(x) = g.x + d`. For a wedge with value `s` the error is `sum area (g.x + d - s)^2`; its best value
//! `s = sum area (g.x + d) / sum area` is linear in the position, so `s` is eliminated and a plain quadric is left.

use super::clean::Soup;
use super::quadric::Quadric;
use super::refit::Attributes;
use crate::Mesh;
use glam::DVec3;
use std::collections::BTreeMap;
use std::ops::Range;

/// Attributes per corner, scaled so that one unit counts as one bounding diagonal.
#[derive(Debug)]
pub(super) struct Wedges {
    /// Attributes per wedge.
    pub(super) width: usize,
    /// Wedge of each corner.
    pub(super) corners: Vec<[u32; 3]>,
    /// Scaled values, `width` per wedge.
    pub(super) values: Vec<f64>,
    /// Per wedge: area, then `width` times `(sum area g, sum area d)`.
    forms: Vec<f64>,
    /// Where the uvs start within a wedge.
    pub(super) uv: Option<usize>,
    /// Which values are texture coordinates.
    coordinates: Range<usize>,
    /// Bounds of the texture coordinates of each wedge: where all of a group lie in one tile of the texture, they stay there.
    bounds: Vec<[f64; 2]>,
    scale: Vec<f64>,
    /// How far each attribute of the input may be off in wedges that count as one.
    alike: Vec<f32>,
}

/// How far components of normals, texture coordinates and colours may be off in wedges that count as one: by what exporters lose when
/// they round, which is not seen: .6 degrees at most, a tenth of a texel of 8192, and less than a step of eight bits of dark sRGB.
const ALIKE_NORMALS: f32 = 0.006;
const ALIKE_COORDINATES: f32 = 1e-5;
const ALIKE_COLORS: f32 = 1e-4;

/// Whether all attributes of two wedges lie within bounds of each other.
fn are_alike(a: impl Iterator<Item = f32>, b: impl Iterator<Item = f32>, bounds: &[f32]) -> bool {
    a.zip(b).zip(bounds).all(|((a, b), most)| (a - b).abs() <= *most)
}

/// Joins what is alike at each vertex. Pairs of a vertex and what stands at it come in the order of vertices; `begin` is told the
/// first pair of each that others join. The number of its first for each pair, in the order that they began in.
pub(super) fn join_alike(
    pairs: &[(u32, u32)],
    alike: impl Fn(u32, u32) -> bool,
    mut begin: impl FnMut((u32, u32)),
) -> Vec<u32> {
    let mut out = Vec::with_capacity(pairs.len());
    let mut count = 0;
    // Those of the vertex, each with its number.
    let mut own: Vec<(u32, u32)> = Vec::new();
    for same in pairs.chunk_by(|a, b| a.0 == b.0) {
        own.clear();
        for &(vertex, what) in same {
            let known = own.iter().find(|(first, _)| alike(*first, what)).map(|(_, number)| *number);
            out.push(known.unwrap_or_else(|| {
                begin((vertex, what));
                own.push((what, count));
                count += 1;
                count - 1
            }));
        }
    }
    out
}

/// Wedges at the two ends of an edge that become one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pairing {
    /// Wedge.
    pub(super) wedge: u32,
    /// First wedge of its class.
    pub(super) class: u32,
    /// Whether it sits at the second end.
    pub(super) second: bool,
}

/// Bounds of a value that may be any.
const FREE: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];
/// How far coordinates may reach beyond a tile of the texture: what exporters lose by rounding.
const ROUNDING: f64 = 1e-3;

/// What lies within both bounds; where nothing does, neither holds.
fn meet(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    let both = [a[0].max(b[0]), a[1].min(b[1])];
    if both[0] <= both[1] { both } else { FREE }
}

/// The tile that coordinates of this `reach` lie in, widened to the reach; free where they need more than one tile.
pub(super) fn tile(reach: [f64; 2], scale: f64) -> [f64; 2] {
    let least = (reach[0] / scale + ROUNDING).floor();
    let most = (reach[1] / scale - ROUNDING).ceil();
    if most - least > 1.0 { FREE } else { [reach[0].min(least * scale), reach[1].max(most * scale)] }
}

/// Bounds of the `coordinates` of wedges: the tiles of the groups that use them.
fn bounds(
    values: &[f64],
    scale: &[f64],
    coordinates: Range<usize>,
    corners: &[[u32; 3]],
    group: &[u32],
) -> Vec<[f64; 2]> {
    let (width, first, count) = (scale.len(), coordinates.start, coordinates.len());
    let scales = &scale[coordinates];
    let mut tiles: BTreeMap<u32, Vec<[f64; 2]>> = BTreeMap::new();
    for (corners, g) in corners.iter().zip(group) {
        let reach = tiles.entry(*g).or_insert_with(|| vec![[f64::INFINITY, f64::NEG_INFINITY]; count]);
        for w in corners {
            for (j, reach) in reach.iter_mut().enumerate() {
                let x = values[*w as usize * width + first + j];
                *reach = [reach[0].min(x), reach[1].max(x)];
            }
        }
    }
    for reach in tiles.values_mut() {
        for (reach, scale) in reach.iter_mut().zip(scales) {
            *reach = tile(*reach, *scale);
        }
    }
    let wedges = values.len().checked_div(width).unwrap_or(0);
    let mut out = vec![FREE; wedges * count];
    for (corners, g) in corners.iter().zip(group) {
        for w in corners {
            let of_wedge = &mut out[*w as usize * count..][..count];
            for (bound, tile) in of_wedge.iter_mut().zip(&tiles[g]) {
                *bound = meet(*bound, *tile);
            }
        }
    }
    out
}

impl Wedges {
    /// Wedges of a cleaned mesh: input vertices of one position whose attributes are alike share one, which has those of the first.
    pub(super) fn new(mesh: &Mesh, soup: &Soup, group: &[u32], normal_weight: f64, uv_weight: f64) -> Self {
        let (mut scale, mut alike) = (Vec::new(), Vec::new());
        let mut block = |there: bool, components: usize, weight: f64, bound: f32| {
            if there {
                scale.extend(std::iter::repeat_n(weight.max(1e-6), components));
                alike.extend(std::iter::repeat_n(bound, components));
            }
            scale.len()
        };
        let first = block(!mesh.normals.is_empty(), 3, normal_weight, ALIKE_NORMALS);
        let uv = (!mesh.uvs.is_empty()).then_some(first);
        block(!mesh.uvs.is_empty(), 2, uv_weight, ALIKE_COORDINATES);
        let coordinates = first..block(!mesh.uvs1.is_empty(), 2, uv_weight, ALIKE_COORDINATES);
        block(!mesh.colors.is_empty(), 4, normal_weight, ALIKE_COLORS);
        let row = |i: u32| {
            let i = i as usize;
            let n = mesh.normals.get(i).into_iter().flat_map(|v| v.to_array());
            let u = mesh.uvs.get(i).into_iter().flat_map(|v| v.to_array());
            let u1 = mesh.uvs1.get(i).into_iter().flat_map(|v| v.to_array());
            let c = mesh.colors.get(i).into_iter().flat_map(|v| v.to_array());
            n.chain(u).chain(u1).chain(c).map(|x| x + 0.0)
        };
        let mut order: Vec<(u32, u32)> = Vec::with_capacity(soup.triangles.len() * 3);
        for (t, c) in soup.triangles.iter().enumerate() {
            let input = mesh.triangles[soup.source[t] as usize];
            order.extend((0..3).map(|k| (c[k], input[k])));
        }
        order.sort_unstable();
        order.dedup();
        order.sort_by(|a, b| {
            a.0.cmp(&b.0).then_with(|| row(a.1).map(f32::to_bits).cmp(row(b.1).map(f32::to_bits)))
        });
        let mut values = Vec::new();
        let mut count = 0_u32;
        let wedges = join_alike(
            &order,
            |a, b| are_alike(row(a), row(b), &alike),
            |(_, i)| {
                values.extend(row(i).zip(&scale).map(|(x, s)| f64::from(x) * s));
                count += 1;
            },
        );
        let mut named: Vec<((u32, u32), u32)> = order.into_iter().zip(wedges).collect();
        named.sort_unstable();
        let find = |v: u32, i: u32| named.binary_search_by_key(&(v, i), |e| e.0).map_or(0, |k| named[k].1);
        let corners: Vec<[u32; 3]> = soup
            .triangles
            .iter()
            .zip(&soup.source)
            .map(|(c, &s)| {
                let input = mesh.triangles[s as usize];
                [find(c[0], input[0]), find(c[1], input[1]), find(c[2], input[2])]
            })
            .collect();
        let width = scale.len();
        let bounds = bounds(&values, &scale, coordinates.clone(), &corners, group);
        let forms = vec![0.0; count as usize * (1 + 4 * width)];
        Self { width, corners, values, forms, uv, coordinates, bounds, scale, alike }
    }

    /// What the input surface has.
    pub(super) fn attributes(&self) -> Attributes {
        Attributes { width: self.width, values: self.values.clone(), corners: self.corners.clone() }
    }

    /// Attributes that belong together, and whether they are texture coordinates.
    pub(super) fn blocks(&self) -> Vec<(Range<usize>, bool)> {
        let (first, end) = (self.coordinates.start, self.coordinates.end);
        let sets = (first..end).step_by(2).map(|k| (k..k + 2, true));
        let others = [(0..first, false), (end..self.width, false)];
        sets.chain(others.into_iter().filter(|(block, _)| !block.is_empty())).collect()
    }

    /// Whether a block holds normals: nothing but colours comes after coordinates, and they have four components.
    pub(super) fn are_normals(&self, block: &Range<usize>) -> bool {
        block.len() == 3
    }

    /// Adds to attribute `j` of a wedge, within its bounds, and those of colours, which are what a file may hold.
    pub(super) fn change(&mut self, wedge: u32, j: usize, by: f64) {
        let [lo, hi] = if j < self.coordinates.end { self.bound(wedge, j) } else { [0.0, self.scale[j]] };
        let value = &mut self.values[wedge as usize * self.width + j];
        *value = (*value + by).clamp(lo, hi);
    }

    /// Value of attribute `j` of a wedge.
    #[inline]
    pub(super) fn value(&self, wedge: u32, j: usize) -> f64 {
        self.values[wedge as usize * self.width + j]
    }

    /// Bounds of attribute `j` of a wedge.
    fn bound(&self, wedge: u32, j: usize) -> [f64; 2] {
        if !self.coordinates.contains(&j) {
            return FREE;
        }
        self.bounds[wedge as usize * self.coordinates.len() + j - self.coordinates.start]
    }

    #[inline]
    fn form(&self, wedge: u32) -> &[f64] {
        let n = 1 + 4 * self.width;
        &self.forms[wedge as usize * n..][..n]
    }

    /// Adds a face: its forms go to its three wedges, its gradient part is returned for the vertices.
    pub(super) fn add_face(&mut self, t: usize, p: [DVec3; 3], area: f64) -> Quadric {
        let (e, f) = (p[1] - p[0], p[2] - p[0]);
        let (ee, ef, ff) = (e.length_squared(), e.dot(f), f.length_squared());
        let det = ee * ff - ef * ef;
        // Gradients of slivers explode; they count as constant.
        let regular = det > 1e-6 * (ee + ff) * (ee + ff);
        let mut sum = Quadric::default();
        let n = 1 + 4 * self.width;
        for j in 0..self.width {
            let s = self.corners[t].map(|w| self.value(w, j));
            let (mut g, mut d) = (DVec3::ZERO, (s[0] + s[1] + s[2]) / 3.0);
            if regular {
                let (a, b) = (s[1] - s[0], s[2] - s[0]);
                g = e * ((a * ff - b * ef) / det) + f * ((b * ee - a * ef) / det);
                d = s[0] - g.dot(p[0]);
            }
            sum.add(&Quadric::linear(g, d, area));
            for w in self.corners[t] {
                let at = &mut self.forms[w as usize * n + 1 + 4 * j..][..4];
                at[0] += area * g.x;
                at[1] += area * g.y;
                at[2] += area * g.z;
                at[3] += area * d;
            }
        }
        for w in self.corners[t] {
            self.forms[w as usize * n] += area;
        }
        sum
    }

    /// Appends the wedges of corners, each in a class of its own.
    pub(super) fn collect(&self, corners: &[u32], second: bool, pairs: &mut Vec<Pairing>) {
        for &c in corners {
            let wedge = self.corners[c as usize / 3][c as usize % 3];
            if !pairs.iter().any(|p| p.wedge == wedge) {
                pairs.push(Pairing { wedge, class: wedge, second });
            }
        }
    }

    /// Sum of the forms of a class into `out` (`1 + 4 width` numbers).
    fn gather(&self, pairs: &[Pairing], class: u32, out: &mut Vec<f64>) {
        out.clear();
        out.resize(1 + 4 * self.width, 0.0);
        for p in pairs.iter().filter(|p| p.class == class) {
            for (o, x) in out.iter_mut().zip(self.form(p.wedge)) {
                *o += x;
            }
        }
    }

    /// Takes from `q` what choosing the best attribute values saves.
    pub(super) fn eliminate(&self, pairs: &[Pairing], q: &mut Quadric, scratch: &mut Vec<f64>) {
        for p in pairs.iter().filter(|p| p.class == p.wedge) {
            self.gather(pairs, p.class, scratch);
            if scratch[0] > 0.0 {
                let w = 1.0 / scratch[0];
                for f in scratch[1..].chunks_exact(4) {
                    q.sub(&Quadric::linear(DVec3::new(f[0], f[1], f[2]), f[3], w));
                }
            }
        }
    }

    /// Best values of every class for a collapse to `x` from `ends`, `width` per class in the order of `pairs`.
    pub(super) fn solve(
        &self,
        pairs: &[Pairing],
        x: DVec3,
        ends: [DVec3; 2],
        scratch: &mut Vec<f64>,
        out: &mut Vec<f64>,
    ) {
        out.clear();
        for p in pairs.iter().filter(|p| p.class == p.wedge) {
            self.gather(pairs, p.class, scratch);
            let area = scratch[0];
            for j in 0..self.width {
                let f = &scratch[1 + 4 * j..][..4];
                let g = DVec3::new(f[0], f[1], f[2]);
                let slope = if area > 0.0 { g.length() / area } else { 0.0 };
                let (mut lo, mut hi, mut mean, mut n) = (f64::INFINITY, f64::NEG_INFINITY, 0.0, 0.0);
                for m in pairs.iter().filter(|m| m.class == p.class) {
                    let reach = slope * x.distance(ends[usize::from(m.second)]);
                    let s = self.value(m.wedge, j);
                    (lo, hi) = (lo.min(s - reach), hi.max(s + reach));
                    (mean, n) = (mean + s, n + 1.0);
                }
                let best = if area > 0.0 { (g.dot(x) + f[3]) / area } else { mean / n };
                let best = best.clamp(lo, hi);
                let class = pairs.iter().filter(|m| m.class == p.class);
                let [lo, hi] = class.fold(FREE, |both, m| meet(both, self.bound(m.wedge, j)));
                out.push(best.clamp(lo, hi));
            }
        }
    }

    /// Merges every class into its first wedge with the values of [`Self::solve`].
    pub(super) fn merge(&mut self, pairs: &[Pairing], solved: &[f64], scratch: &mut Vec<f64>) {
        let n = 1 + 4 * self.width;
        for p in pairs.iter().filter(|p| p.class != p.wedge) {
            let count = self.coordinates.len();
            for j in 0..count {
                let (class, wedge) = (p.class as usize * count + j, p.wedge as usize * count + j);
                self.bounds[class] = meet(self.bounds[class], self.bounds[wedge]);
            }
        }
        for (k, p) in pairs.iter().filter(|p| p.class == p.wedge).enumerate() {
            self.gather(pairs, p.class, scratch);
            self.forms[p.class as usize * n..][..n].copy_from_slice(scratch);
            self.values[p.class as usize * self.width..][..self.width]
                .copy_from_slice(&solved[k * self.width..][..self.width]);
        }
    }

    /// Whether two wedges of a vertex count as one.
    pub(super) fn are_alike(&self, a: u32, b: u32) -> bool {
        are_alike(self.unscaled(a), self.unscaled(b), &self.alike)
    }

    /// Attributes of a wedge in the input's scale.
    pub(super) fn unscaled(&self, wedge: u32) -> impl Iterator<Item = f32> {
        let row = &self.values[wedge as usize * self.width..][..self.width];
        row.iter().zip(&self.scale).map(|(x, s)| (x / s) as f32)
    }
}
