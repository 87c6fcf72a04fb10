//! Triangles and vertices in an order that compresses well: triangles beside those that they share vertices with, vertices as
//! they are first used.

use crate::skin::{Bind, Influences, MorphTarget};
use photofit_geometry::Mesh;

/// Vertices that are taken to be still at hand, as in a small vertex cache.
const RECENT: usize = 16;
/// Triangles whose edges the codec remembers at least.
const EDGES: usize = 5;
/// Triangles of a fan that are looked at for the next one: a vertex may be in all triangles of a mesh.
const LOOKED_AT: usize = 64;

/// The same primitive with reordered triangles and vertices.
pub(super) fn ordered(bind: &Bind) -> Bind {
    let mesh = &bind.mesh;
    let mut triangles = by_fans(&mesh.triangles, mesh.positions.len());
    let order = first_use(&mut triangles, mesh.positions.len());
    let influences = bind
        .influences
        .iter()
        .map(|set| Influences { joints: pick(&set.joints, &order), weights: pick(&set.weights, &order) });
    let targets = bind.targets.iter().map(|t| MorphTarget {
        positions: pick(&t.positions, &order),
        normals: pick(&t.normals, &order),
        tangents: pick(&t.tangents, &order),
    });
    Bind {
        mesh: Mesh {
            positions: pick(&mesh.positions, &order),
            normals: pick(&mesh.normals, &order),
            tangents: pick(&mesh.tangents, &order),
            uvs: pick(&mesh.uvs, &order),
            uvs1: pick(&mesh.uvs1, &order),
            colors: pick(&mesh.colors, &order),
            triangles,
        },
        influences: influences.collect(),
        targets: targets.collect(),
    }
}

/// The elements of an attribute in another order; an attribute that is not there stays away.
fn pick<T: Copy>(list: &[T], order: &[u32]) -> Vec<T> {
    if list.is_empty() { Vec::new() } else { order.iter().map(|&v| list[v as usize]).collect() }
}

/// Renumbers vertices as triangles use them, those that none uses last; the old index of each.
fn first_use(triangles: &mut [[u32; 3]], vertices: usize) -> Vec<u32> {
    let mut new = vec![u32::MAX; vertices];
    let mut order = Vec::with_capacity(vertices);
    for v in triangles.as_flattened_mut() {
        let at = &mut new[*v as usize];
        if *at == u32::MAX {
            *at = order.len() as u32;
            order.push(*v);
        }
        *v = *at;
    }
    order.extend((0..vertices as u32).filter(|v| new[*v as usize] == u32::MAX));
    order
}

/// Triangles fan by fan around vertices, the next fan around a vertex that was used lately (`sander2007tipsify`).
fn by_fans(triangles: &[[u32; 3]], vertices: usize) -> Vec<[u32; 3]> {
    let mut starts = vec![0; vertices + 1];
    for v in triangles.as_flattened() {
        starts[*v as usize + 1] += 1;
    }
    for v in 0..vertices {
        starts[v + 1] += starts[v];
    }
    let mut around = vec![0; 3 * triangles.len()];
    let mut at = starts.clone();
    for (t, triangle) in triangles.iter().enumerate() {
        for v in triangle {
            around[at[*v as usize]] = t;
            at[*v as usize] += 1;
        }
    }
    let mut open: Vec<usize> = starts.windows(2).map(|w| w[1] - w[0]).collect();
    let mut used = vec![0; vertices];
    let mut now = RECENT + 1;
    let mut done = vec![false; triangles.len()];
    let mut out = Vec::with_capacity(triangles.len());
    let (mut passed, mut cursor) = (Vec::new(), 0);
    let (mut candidates, mut fan): (Vec<usize>, Vec<usize>) = (Vec::new(), Vec::new());
    loop {
        let center = best(&candidates, &open, &used, now)
            .or_else(|| {
                while let Some(v) = passed.pop() {
                    if open[v] > 0 {
                        return Some(v);
                    }
                }
                None
            })
            .or_else(|| {
                cursor += open[cursor..].iter().position(|n| *n > 0)?;
                Some(cursor)
            });
        let Some(center) = center else { return out };
        candidates.clear();
        fan.clear();
        fan.extend(around[starts[center]..starts[center + 1]].iter().copied().filter(|t| !done[*t]));
        while let Some(t) = take_next(&mut fan, triangles, &out) {
            done[t] = true;
            out.push(triangles[t]);
            for v in triangles[t].map(|v| v as usize) {
                open[v] -= 1;
                candidates.push(v);
                passed.push(v);
                if now - used[v] > RECENT {
                    used[v] = now;
                    now += 1;
                }
            }
        }
    }
}

/// Takes a triangle of a fan, one that shares an edge with the latest of those that are out where there is one.
fn take_next(fan: &mut Vec<usize>, triangles: &[[u32; 3]], out: &[[u32; 3]]) -> Option<usize> {
    let since = |t: usize| {
        let on_edge = |o: &[u32; 3]| o.iter().filter(|v| triangles[t].contains(v)).count() == 2;
        out.iter().rev().take(EDGES).position(on_edge).unwrap_or(EDGES)
    };
    let next = (0..fan.len().min(LOOKED_AT)).min_by_key(|k| since(fan[*k]))?;
    Some(fan.swap_remove(next))
}

/// The vertex that has been at hand for the longest of those whose fan still fits.
fn best(candidates: &[usize], open: &[usize], used: &[usize], now: usize) -> Option<usize> {
    let age = |v: usize| if now - used[v] + 2 * open[v] <= RECENT { now - used[v] } else { 0 };
    // The first of equals, so that the order does not depend on how ties are broken elsewhere.
    candidates.iter().copied().filter(|v| open[*v] > 0).rev().max_by_key(|v| age(*v))
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_scalar::vec3;

    #[test]
    fn nothing_is_lost_and_neighbours_come_together() {
        let n = 30;
        let vertex = |i: usize| vec3((i % (n + 1)) as f32, (i / (n + 1)) as f32, 0.0);
        let mut triangles = Vec::new();
        for i in (0..n * n).map(|k| k * 7919 % (n * n)) {
            let a = (i / n * (n + 1) + i % n) as u32;
            let b = a + n as u32 + 1;
            triangles.extend([[a, a + 1, b], [a + 1, b + 1, b]]);
        }
        let positions: Vec<_> = (0..(n + 1) * (n + 1) + 2).map(vertex).collect();
        let corners = |m: &Mesh| {
            let mut all: Vec<_> = m
                .triangles
                .iter()
                .map(|t| t.map(|v| m.positions[v as usize].to_array().map(f32::to_bits)))
                .collect();
            all.sort_unstable();
            all
        };
        let given = Bind { mesh: Mesh { positions, triangles, ..Mesh::default() }, ..Bind::default() };
        let got = ordered(&given);
        assert_eq!(got.mesh.positions.len(), given.mesh.positions.len());
        assert_eq!(corners(&got.mesh), corners(&given.mesh));
        let mut next = 0;
        for &v in got.mesh.triangles.as_flattened() {
            assert!(v <= next, "vertex {v} is used before {next}");
            next = next.max(v + 1);
        }
        let bytes = |m: &Mesh| crate::meshopt::encode_triangles(&m.triangles).len();
        assert!(bytes(&got.mesh) < 2 * got.mesh.triangles.len(), "{} bytes", bytes(&got.mesh));
        assert!(2 * bytes(&got.mesh) < bytes(&given.mesh), "{} of {}", bytes(&got.mesh), bytes(&given.mesh));
        // Most triangles follow on an edge of one that the codec remembers.
        let t = &got.mesh.triangles;
        let on_edge = |k: &usize| {
            (1..=EDGES.min(*k)).any(|back| t[*k].iter().filter(|v| t[k - back].contains(v)).count() == 2)
        };
        let follow = (1..t.len()).filter(on_edge).count();
        assert!(follow * 20 > t.len() * 19, "{follow} of {}", t.len());
    }
}
