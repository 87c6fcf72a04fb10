//! Building: checks, own frame, binary tree, collapse, packets.

use super::binary::{self, Item};
use super::table::Table;
use super::triangle::Packet;
use super::{Accel, AccelError, MAX_COORDINATE, wide};
use glam::Vec3;
use photofit_scalar::Vec3f;
use rayon::prelude::*;

const MAX_TRIANGLES: usize = 1 << 30;
/// Least number of triangles that a thread takes at once.
const CHUNK: usize = 1 << 13;

pub(super) fn build(positions: &[Vec3f], triangles: &[[u32; 3]]) -> Result<Accel, AccelError> {
    if triangles.len() > MAX_TRIANGLES {
        return Err(AccelError::TooMany { triangles: triangles.len() });
    }
    let (lo, hi) = check(positions, triangles)?;
    let center: [f64; 3] = std::array::from_fn(|k| 0.5 * (f64::from(lo[k]) + f64::from(hi[k])));
    let half = (0..3).map(|k| 0.5 * (f64::from(hi[k]) - f64::from(lo[k]))).fold(0.0, f64::max);
    // A power of two changes no mantissa. One point alone has no size.
    let scale = if half > 0.0 { (-half.log2().ceil()).clamp(-100.0, 100.0).exp2() } else { 1.0 };
    let mut accel = Accel {
        nodes: Table::default(),
        packets: Table::default(),
        center,
        scale,
        back: (1.0 / scale) as f32,
        extent: 0.0,
        triangles: triangles.len(),
    };
    if triangles.is_empty() {
        return Ok(accel);
    }
    let local: Vec<Vec3> = positions.par_iter().with_min_len(CHUNK).map(|&p| accel.local(p)).collect();
    let corners = |t: u32| triangles[t as usize].map(|i| local[i as usize]);
    let item = |t: u32| {
        let [a, b, c] = corners(t);
        Item::new(a.min(b).min(c).to_array(), a.max(b).max(c).to_array(), t)
    };
    let count = triangles.len() as u32;
    let mut items: Vec<Item> = (0..count).into_par_iter().with_min_len(CHUNK).map(item).collect();
    let tree = binary::build(&mut items);
    accel.extent = tree.root.lo.iter().chain(&tree.root.hi).fold(0.0, |e, x| x.abs().max(e));
    let wide = wide::collapse(&tree);
    let packet = |i: usize| {
        let set = &wide.leaves[i];
        let items = &items[set.first as usize..][..set.count as usize];
        Packet::new(items.iter().map(Item::number), corners)
    };
    accel.packets = Table::from_fn(wide.leaves.len(), packet);
    accel.nodes = Table::from_fn(wide.nodes.len(), |i| wide.nodes[i]);
    Ok(accel)
}

/// Checks indices and coordinates; the box of the named vertices.
fn check(positions: &[Vec3f], triangles: &[[u32; 3]]) -> Result<(Vec3f, Vec3f), AccelError> {
    let faulty = |(triangle, corners): (usize, &[u32; 3])| {
        corners.iter().find_map(|&index| {
            let vertex = index as usize;
            match positions.get(vertex) {
                None => Some(AccelError::Index { triangle, index, vertices: positions.len() }),
                Some(p) if !p.is_finite() => Some(AccelError::NonFinite { vertex }),
                Some(p) if p.to_array().iter().any(|x| x.abs() > MAX_COORDINATE) => {
                    Some(AccelError::TooFar { vertex })
                }
                Some(_) => None,
            }
        })
    };
    if let Some(fault) = triangles.par_iter().with_min_len(CHUNK).enumerate().find_map_first(faulty) {
        return Err(fault);
    }
    let range = |(lo, hi): (Vec3f, Vec3f), corners: &[u32; 3]| {
        corners.iter().map(|&i| positions[i as usize]).fold((lo, hi), |(lo, hi), p| (lo.min(p), hi.max(p)))
    };
    let Some(first) = triangles.first().map(|t| positions[t[0] as usize]) else {
        return Ok(<(Vec3f, Vec3f)>::default());
    };
    let ranges = triangles.par_iter().with_min_len(CHUNK).fold(|| (first, first), range);
    Ok(ranges.reduce(|| (first, first), |a, b| (a.0.min(b.0), a.1.max(b.1))))
}
