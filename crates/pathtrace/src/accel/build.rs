//! Building: checks, own frame, obvhs' binary tree, collapse.

use super::triangle::Packet;
use super::{Accel, AccelError, MAX_COORDINATE, wide};
use glam::Vec3A;
use obvhs::aabb::Aabb;
use obvhs::bvh2::leaf_collapser::collapse;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use photofit_scalar::Vec3f;

const MAX_TRIANGLES: usize = 1 << 30;

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
        nodes: Vec::new(),
        packets: Vec::new(),
        center,
        scale,
        extent: 0.0,
        triangles: triangles.len(),
    };
    if triangles.is_empty() {
        return Ok(accel);
    }
    let local: Vec<Vec3A> = positions.iter().map(|&p| accel.local(p).into()).collect();
    let corners = |t: u32| triangles[t as usize].map(|i| local[i as usize]);
    let boxes: Vec<Aabb> = (0..triangles.len() as u32).map(|t| Aabb::from_points(&corners(t))).collect();
    accel.extent = boxes.iter().fold(0.0, |e, b| b.min.abs().max(b.max.abs()).max_element().max(e));
    let indices = (0..triangles.len() as u32).collect();
    let mut tree = PlocBuilder::with_capacity(boxes.len()).build(
        PlocSearchDistance::Medium,
        &boxes,
        indices,
        SortPrecision::U64,
        3,
    );
    let mut reinsertion = ReinsertionOptimizer::default();
    reinsertion.run(&mut tree, 0.05, None);
    // Four triangles cost one packet test: leaves are filled wherever the boxes allow it.
    collapse(&mut tree, Packet::SIZE as u32, 3.0);
    reinsertion.run(&mut tree, 0.1, None);
    accel.packets.reserve(tree.nodes.len() / 2 + 1);
    let packets = &mut accel.packets;
    accel.nodes = wide::collapse(&tree, |triangles| {
        packets.push(Packet::new(triangles, corners));
        (packets.len() - 1) as u32
    });
    Ok(accel)
}

/// Checks indices and coordinates; the box of the named vertices.
fn check(positions: &[Vec3f], triangles: &[[u32; 3]]) -> Result<(Vec3f, Vec3f), AccelError> {
    let mut bounds: Option<(Vec3f, Vec3f)> = None;
    for (triangle, corners) in triangles.iter().enumerate() {
        for &index in corners {
            let vertex = index as usize;
            let Some(&p) = positions.get(vertex) else {
                return Err(AccelError::Index { triangle, index, vertices: positions.len() });
            };
            if !p.is_finite() {
                return Err(AccelError::NonFinite { vertex });
            }
            if p.to_array().iter().any(|x| x.abs() > MAX_COORDINATE) {
                return Err(AccelError::TooFar { vertex });
            }
            bounds = Some(bounds.map_or((p, p), |(lo, hi)| (lo.min(p), hi.max(p))));
        }
    }
    Ok(bounds.unwrap_or_default())
}
