//! Attributes along seams and edges after a decimation that keeps them.

use super::super::*;
use super::{append, sphere, to};
use photofit_scalar::{Vec3f, vec2, vec3};
use std::collections::BTreeMap;

/// Vertices at each position.
fn at_positions(mesh: &Mesh) -> BTreeMap<[u32; 3], Vec<usize>> {
    let mut at: BTreeMap<[u32; 3], Vec<usize>> = BTreeMap::new();
    for (v, p) in mesh.positions.iter().enumerate() {
        at.entry(p.to_array().map(f32::to_bits)).or_default().push(v);
    }
    at
}

#[test]
fn a_seam_of_coordinates_is_not_seen_in_normals() {
    // Each face of the octahedron has coordinates of its own; normals are smooth all over.
    let mut mesh = sphere(24);
    let per_face = mesh.positions.len() / 8;
    mesh.normals = mesh.positions.clone();
    mesh.uvs = (0..mesh.positions.len())
        .map(|v| {
            let p = mesh.positions[v];
            vec2(0.1 * (v / per_face) as f32 + 0.04 * p.x.abs(), 0.5 + 0.4 * p.y)
        })
        .collect();
    let light = to(&mesh, 300, |o| o.keep_uvs = true).mesh;
    let seams: Vec<Vec<usize>> = at_positions(&light).into_values().filter(|v| v.len() > 1).collect();
    assert!(seams.len() > 20, "{}", seams.len());
    let mut worst = 1.0_f32;
    for seam in &seams {
        worst = seam.iter().fold(worst, |w, v| w.min(light.normals[*v].dot(light.normals[seam[0]])));
    }
    assert!(worst > 0.9995, "{worst}");
    for (n, p) in light.normals.iter().zip(&light.positions) {
        assert!(n.dot(p.normalize_or_zero()) > 0.99, "{n:?} at {p:?}");
    }
}

#[test]
fn both_sides_of_an_edge_keep_their_normals() {
    // A roof of two slopes that meet at a right angle, with a normal of its own on each.
    let mut mesh = Mesh::default();
    let mut plane = super::grid(12, |_, _| 0.0);
    plane.uvs.clear();
    let half = plane.positions.len();
    append(&mut mesh, &plane, vec3(1.0, 1.0, 0.0), vec3(0.0, 0.0, 0.0));
    append(&mut mesh, &plane, vec3(1.0, 1.0, 0.0), vec3(0.0, 0.0, 0.0));
    let tilt = |v: usize, p: Vec3f| if v < half { vec3(p.x, p.y, p.x) } else { vec3(-p.x, p.y, p.x) };
    mesh.positions = mesh.positions.iter().enumerate().map(|(v, p)| tilt(v, *p)).collect();
    for t in mesh.triangles.iter_mut().filter(|t| t[0] as usize >= half) {
        t.swap(1, 2);
    }
    let s = 0.5_f32.sqrt();
    let normals = [vec3(-s, 0.0, s), vec3(s, 0.0, s)];
    mesh.normals = (0..2 * half).map(|v| normals[usize::from(v >= half)]).collect();
    // A little relief, so that there is something to fit.
    for p in &mut mesh.positions {
        p.z += 0.01 * (9.0 * p.y).sin();
    }
    let light = to(&mesh, 40, |o| o.keep_uvs = true).mesh;
    for t in &light.triangles {
        let side = t.iter().map(|v| light.positions[*v as usize].x).sum::<f32>() < 0.0;
        for v in t {
            let n = light.normals[*v as usize];
            assert!((n - normals[usize::from(side)]).length() < 1e-3, "{n:?}");
        }
    }
}

#[test]
fn groups_keep_their_colors_apart() {
    // Two halves of one plane: black and white, each a group.
    let mut mesh = super::grid(16, |x, y| 0.02 * (8.0 * x).sin() * (6.0 * y).cos());
    mesh.uvs.clear();
    let group: Vec<u32> = mesh
        .triangles
        .iter()
        .map(|t| u32::from(t.iter().map(|v| mesh.positions[*v as usize].x).sum::<f32>() > 1.5))
        .collect();
    let (old, mut split) = (mesh.positions.len() as u32, mesh.triangles.clone());
    mesh.positions.extend(mesh.positions.clone());
    for (t, g) in split.iter_mut().zip(&group) {
        *t = t.map(|v| v + old * g);
    }
    mesh.triangles = split;
    mesh.colors = (0..mesh.positions.len())
        .map(|v| photofit_scalar::Vec4f::splat(if v < old as usize { 0.0 } else { 1.0 }))
        .collect();
    let options = Options { keep_uvs: true, ..Options::new(Target::Triangles(60)) };
    let light = decimate(&mesh, &group, &[], &options).unwrap();
    for (t, g) in light.mesh.triangles.iter().zip(&light.group) {
        for v in t {
            let c = light.mesh.colors[*v as usize].x;
            assert!((c - *g as f32).abs() < 1e-3, "group {g}: {c}");
        }
    }
}

/// Both sides of a seam have normals of their own that differ by noise, of which little is left in the mean over many.
#[test]
fn sides_of_a_seam_that_have_become_alike_are_one_vertex() {
    let mut mesh = super::grid(48, |x, y| 0.02 * (5.0 * x).sin() * (4.0 * y).cos());
    mesh.uvs.clear();
    let plain = mesh.positions.clone();
    let middle = 0.5 * plain.iter().fold(0.0_f32, |m, p| m.max(p.x));
    // Copies of all vertices for the second half; those inside of the halves go unused.
    mesh.positions.extend(&plain);
    for t in &mut mesh.triangles {
        let second = t.iter().map(|v| plain[*v as usize].x).sum::<f32>() > 3.0 * middle;
        *t = t.map(|v| v + if second { plain.len() as u32 } else { 0 });
    }
    let off = |v: usize, j: usize| ((v * (7 + j) + v * v % 5) % 11) as f32 / 11.0 - 0.5;
    mesh.normals = (0..mesh.positions.len())
        .map(|v| (vec3(0.0, 0.0, 1.0) + vec3(off(v, 0), off(v, 1), 0.0) * 0.02).normalize_or_zero())
        .collect();
    let light = to(&mesh, 24, |o| o.keep_uvs = true).mesh;
    let crossing: Vec<usize> = at_positions(&light)
        .into_values()
        .filter(|at| (light.positions[at[0]].x - middle).abs() < 0.02)
        .map(|at| at.len())
        .collect();
    let seams = crossing.iter().filter(|n| **n > 1).count();
    assert!(!crossing.is_empty() && 2 * seams < crossing.len(), "{seams} of {}", crossing.len());
}

/// What exporters lose by rounding makes no seam: a smooth mesh whose triangles have corners of their own, off by little, collapses like
/// one that shares them.
#[test]
fn rounding_makes_no_seams() {
    let mut smooth = sphere(24);
    smooth.normals = smooth.positions.clone();
    smooth.uvs = smooth.positions.iter().map(|p| vec2(0.5 + 0.4 * p.x, 0.5 + 0.4 * p.y)).collect();
    let corners: Vec<usize> = smooth.triangles.as_flattened().iter().map(|v| *v as usize).collect();
    // Another offset in each corner.
    let off = |k: usize, j: usize| ((k * 7 + j * 3) % 11) as f32 / 11.0 - 0.5;
    let split = Mesh {
        positions: corners.iter().map(|v| smooth.positions[*v]).collect(),
        normals: corners
            .iter()
            .enumerate()
            .map(|(k, v)| {
                (smooth.normals[*v] + vec3(off(k, 0), off(k, 1), off(k, 2)) * 1e-3).normalize_or_zero()
            })
            .collect(),
        uvs: corners
            .iter()
            .enumerate()
            .map(|(k, v)| vec2(smooth.uvs[*v].x + off(k, 3) * 1e-6, smooth.uvs[*v].y + off(k, 4) * 1e-6))
            .collect(),
        triangles: (0..smooth.triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
        ..Mesh::default()
    };
    let [shared, own] = [&smooth, &split].map(|mesh| to(mesh, 300, |o| o.keep_uvs = true));
    assert_eq!(shared.mesh.positions.len(), own.mesh.positions.len(), "one vertex at each position");
    assert!(
        own.relative_error < 1.1 * shared.relative_error,
        "{} {}",
        own.relative_error,
        shared.relative_error
    );
    // A degree between faces is an edge that somebody made.
    let mut faceted = split.clone();
    for (k, n) in faceted.normals.iter_mut().enumerate() {
        *n = (*n + vec3(off(k / 3, 0), off(k / 3, 1), off(k / 3, 2)) * 0.1).normalize_or_zero();
    }
    let kept = to(&faceted, 4608, |o| o.keep_uvs = true).mesh;
    assert!(kept.positions.len() > 3 * shared.mesh.positions.len(), "{}", kept.positions.len());
}
