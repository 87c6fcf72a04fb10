//! Turns the end state into a mesh.

use super::engine::Engine;
use super::topology::NONE;
use super::wedge::join_alike;
use crate::Mesh;
use glam::DVec3;
use photofit_scalar::{Vec2f, Vec3f, Vec4f, vec2, vec3, vec4};

/// The live triangles as a mesh.
pub(super) struct Output {
    pub(super) mesh: Mesh,
    /// Group of each triangle.
    pub(super) group: Vec<u32>,
    /// Input triangle of each triangle.
    pub(super) source: Vec<u32>,
    /// Vertices that were locked; empty where none was to be.
    pub(super) locked: Vec<bool>,
}

/// Mesh, group and source of the live triangles.
pub(super) fn output(
    engine: &Engine<'_>,
    input: &Mesh,
    source: &[u32],
    centre: DVec3,
    diagonal: f64,
) -> Output {
    let live: Vec<usize> = (0..source.len()).filter(|&t| engine.topology.is_live(t as u32)).collect();
    let mut mesh = Mesh::default();
    let mut locked = Vec::new();
    let mut lock = |v: u32| {
        if engine.options.lock_border || !engine.options.locked.is_empty() {
            locked.push(engine.fixed[v as usize]);
        }
    };
    let mut triangles = Vec::with_capacity(live.len());
    let point = |v: u32| position(engine, input, v, centre, diagonal);
    if let Some(wedges) = &engine.wedges {
        let mut keys: Vec<(u32, u32)> = live
            .iter()
            .flat_map(|&t| {
                let c = engine.topology.triangles[t];
                let w = wedges.corners[t];
                [(c[0], w[0]), (c[1], w[1]), (c[2], w[2])]
            })
            .collect();
        keys.sort_unstable();
        keys.dedup();
        // Wedges that have become alike are one vertex.
        let named = join_alike(
            &keys,
            |a, b| wedges.are_alike(a, b),
            |(v, w)| {
                mesh.positions.push(point(v));
                lock(v);
                let row: Vec<f32> = wedges.unscaled(w).collect();
                push_attributes(&mut mesh, input, &row);
            },
        );
        for &t in &live {
            let (c, w) = (engine.topology.triangles[t], wedges.corners[t]);
            let find = |k: usize| named[keys.binary_search(&(c[k], w[k])).unwrap_or(0)];
            triangles.push([find(0), find(1), find(2)]);
        }
    } else {
        let mut name = vec![NONE; engine.positions.len()];
        for &t in &live {
            triangles.push(engine.topology.triangles[t].map(|v| {
                let slot = &mut name[v as usize];
                if *slot == NONE {
                    *slot = mesh.positions.len() as u32;
                    mesh.positions.push(point(v));
                    lock(v);
                }
                *slot
            }));
        }
    }
    mesh.triangles = triangles;
    let group = live.iter().map(|&t| engine.group[t]).collect();
    let source = live.iter().map(|&t| source[t]).collect();
    Output { mesh, group, source, locked }
}

/// The very input position where the vertex never moved.
fn position(engine: &Engine<'_>, input: &Mesh, v: u32, centre: DVec3, diagonal: f64) -> Vec3f {
    let origin = engine.origin[v as usize];
    if origin != NONE {
        return input.positions[origin as usize];
    }
    let p = engine.positions[v as usize] * diagonal + centre;
    let clamp = |x: f64| x.clamp(f64::from(f32::MIN), f64::from(f32::MAX)) as f32;
    vec3(clamp(p.x), clamp(p.y), clamp(p.z))
}

fn push_attributes(mesh: &mut Mesh, input: &Mesh, row: &[f32]) {
    let mut row = row.iter().copied();
    let mut next = || row.next().unwrap_or(0.0);
    if !input.normals.is_empty() {
        let n: Vec3f = vec3(next(), next(), next());
        mesh.normals.push(n.normalize_or_zero());
    }
    if !input.uvs.is_empty() {
        let uv: Vec2f = vec2(next(), next());
        mesh.uvs.push(uv);
    }
    if !input.uvs1.is_empty() {
        mesh.uvs1.push(vec2(next(), next()));
    }
    if !input.colors.is_empty() {
        let c: Vec4f = vec4(next(), next(), next(), next());
        mesh.colors.push(c);
    }
}
