//! Initial quadrics, borders and components of a cleaned mesh.

use super::Options;
use super::clean::Soup;
use super::engine::{Engine, Scratch};
use super::part::{Members, parts};
use super::quadric::Quadric;
use super::refine::Original;
use super::topology::Topology;
use super::wedge::Wedges;
use crate::Mesh;
use glam::DVec3;

/// Smallest weight of a triangle relative to the mean: keeps quadrics of unseen regions well defined.
const LEAST_IMPORTANCE: f64 = 1e-6;

fn corner_points(positions: &[DVec3], t: [u32; 3]) -> [DVec3; 3] {
    t.map(|i| positions[i as usize])
}

fn area_of(p: [DVec3; 3]) -> f64 {
    0.5 * (p[1] - p[0]).cross(p[2] - p[0]).length()
}

/// Importance of each triangle over its area-weighted mean.
fn relative_importance(soup: &Soup, importance: &[f32]) -> Vec<f64> {
    let of = |k: usize| importance.get(soup.source[k] as usize).map_or(1.0, |&w| f64::from(w));
    let (mut sum, mut total) = (0.0, 0.0);
    for (k, &t) in soup.triangles.iter().enumerate() {
        let area = area_of(corner_points(&soup.positions, t));
        sum += area * of(k);
        total += area;
    }
    let mean = if sum > 0.0 { sum / total } else { 1.0 };
    (0..soup.triangles.len()).map(|k| (of(k) / mean).max(LEAST_IMPORTANCE)).collect()
}

/// Drops triangles of importance zero none of whose vertices is locked or on a visible triangle; returns how many.
pub(super) fn drop_unseen(soup: &mut Soup, importance: &[f32]) -> usize {
    let seen: Vec<bool> =
        soup.source.iter().map(|&s| importance.get(s as usize).is_none_or(|&w| w > 0.0)).collect();
    let mut near = soup.locked.clone();
    for (t, _) in soup.triangles.iter().zip(&seen).filter(|(_, s)| **s) {
        for &v in t {
            near[v as usize] = true;
        }
    }
    let keep: Vec<bool> = soup.triangles.iter().map(|t| t.iter().any(|&v| near[v as usize])).collect();
    let before = soup.triangles.len();
    if !seen.contains(&true) {
        return 0;
    }
    let mut k = keep.iter().copied();
    soup.triangles.retain(|_| k.next().unwrap_or(true));
    let mut k = keep.iter().copied();
    soup.source.retain(|_| k.next().unwrap_or(true));
    before - soup.triangles.len()
}

/// Builds the state for a cleaned mesh.
pub(super) fn engine<'a>(
    mesh: &Mesh,
    soup: Soup,
    group: &[u32],
    importance: &[f32],
    options: &'a Options,
) -> (Engine<'a>, Option<Original>) {
    let mut weight = relative_importance(&soup, importance);
    let topology = Topology::new(soup.triangles.clone(), soup.positions.len());
    let edges = topology.edges();
    let (part, parts) = parts(&soup, &edges, &mut weight, options.thin_power);
    let group: Vec<u32> = soup.source.iter().map(|&s| group.get(s as usize).copied().unwrap_or(0)).collect();
    let mut wedges = options
        .keep_uvs
        .then(|| Wedges::new(mesh, &soup, &group, options.normal_weight, options.uv_weight))
        .filter(|w| w.width > 0);
    let n = soup.positions.len();
    let mut quadrics = vec![Quadric::default(); n];
    let mut areas = vec![0.0; n];
    for (k, &t) in soup.triangles.iter().enumerate() {
        let p = corner_points(&soup.positions, t);
        let cross = (p[1] - p[0]).cross(p[2] - p[0]);
        let area = 0.5 * cross.length();
        let w = weight[k] * area / 3.0;
        let normal = cross.normalize_or_zero();
        let centre = (p[0] + p[1] + p[2]) / 3.0;
        let mut q = Quadric::linear(normal, -normal.dot(p[0]), w);
        q.add(&Quadric::point(centre, w * options.regularity));
        q.weight = w;
        if let Some(wedges) = &mut wedges {
            q.add(&wedges.add_face(k, p, w));
        }
        for i in t {
            quadrics[i as usize].add(&q);
            areas[i as usize] += area / 3.0;
        }
    }
    let attributes = wedges.as_ref().map(Wedges::attributes);
    let original = (options.refine_rounds > 0 || attributes.is_some()).then(|| Original {
        positions: soup.positions.clone(),
        triangles: soup.triangles,
        weight: weight.clone(),
        attributes,
    });
    let mut engine = Engine {
        options,
        topology,
        positions: soup.positions,
        origin: soup.origin,
        quadrics,
        area: areas,
        version: vec![0; n],
        border: vec![false; n],
        fixed: soup.locked,
        any_fixed: false,
        group,
        members: Members::new(&part, parts.len()),
        part,
        parts,
        wedges,
        parent: (0..n as u32).collect(),
        worst: 0.0,
        scratch: Scratch { mark: vec![0; n], ..Scratch::default() },
    };
    hold_edges(&mut engine, &edges, &weight);
    engine.any_fixed = engine.fixed.contains(&true);
    hold_parts(&mut engine);
    (engine, original)
}

/// Adds the planes that hold borders, group edges and seams, and marks border vertices.
fn hold_edges(engine: &mut Engine<'_>, edges: &[(u64, u32)], weight: &[f64]) {
    for faces in edges.chunk_by(|a, b| a.0 == b.0) {
        let (a, b) = ((faces[0].0 >> 32) as u32, faces[0].0 as u32);
        if faces.len() == 1 {
            for v in [a, b].map(|v| v as usize) {
                engine.border[v] = true;
                engine.fixed[v] |= engine.options.lock_border;
            }
        }
        let strength = edge_weight(engine, a, b, faces);
        if strength <= 0.0 {
            continue;
        }
        let (p, r) = (engine.positions[a as usize], engine.positions[b as usize]);
        for &(_, t) in faces {
            let c = corner_points(&engine.positions, engine.topology.triangles[t as usize]);
            let normal = (c[1] - c[0]).cross(c[2] - c[0]).normalize_or_zero();
            let side = (r - p).cross(normal).normalize_or_zero();
            let w = strength * weight[t as usize] * p.distance_squared(r);
            let q = Quadric::linear(side, -side.dot(p), w);
            engine.quadrics[a as usize].add(&q);
            engine.quadrics[b as usize].add(&q);
        }
    }
}

/// Components with a vertex that stays are not removed.
fn hold_parts(engine: &mut Engine<'_>) {
    if !engine.any_fixed {
        return;
    }
    for (t, triangle) in engine.topology.triangles.iter().enumerate() {
        if triangle.iter().any(|v| engine.fixed[*v as usize]) {
            engine.parts[engine.part[t] as usize].held = true;
        }
    }
}

/// Weight of the planes along an edge with these faces; 0 for an ordinary edge.
fn edge_weight(engine: &Engine<'_>, a: u32, b: u32, faces: &[(u64, u32)]) -> f64 {
    let o = engine.options;
    if faces.len() == 1 {
        return o.border_weight;
    }
    let first = faces[0].1 as usize;
    if faces.iter().any(|f| engine.group[f.1 as usize] != engine.group[first]) {
        return o.group_weight;
    }
    let Some(wedges) = &engine.wedges else { return 0.0 };
    let at = |t: usize, v: u32| {
        let k = engine.topology.triangles[t].iter().position(|&x| x == v).unwrap_or(0);
        wedges.corners[t][k]
    };
    let seam = faces[1..].iter().any(|f| {
        let t = f.1 as usize;
        at(t, a) != at(first, a) || at(t, b) != at(first, b)
    });
    if seam { o.seam_weight } else { 0.0 }
}
