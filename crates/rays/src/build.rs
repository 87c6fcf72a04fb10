//! Building: checks, own frame, binary tree, collapse, packets.

use super::binary::{self, Item};
use super::buffer::Buffer;
use super::triangle::Packet;
use super::{Accel, AccelError, Builder, MAX_COORDINATE, ploc, wide};
use glam::{BVec4A, Vec3A, Vec4};
use photofit_scalar::{Vec3f, vec3};
use rayon::prelude::*;

const MAX_TRIANGLES: usize = 1 << 30;
/// Least number of triangles that a thread takes at once.
const CHUNK: usize = 1 << 13;

/// What coordinates of single precision between these bounds are moved by: their middle if all are on one side of 0 and the
/// nearest is at least a third of the farthest, else 0. All differences are exact then: they are multiples of the last place
/// of the nearest one, and at most 2^24 of them. Bounds are in order, and not subnormal; those that are not finite give 0.
///
/// A middle between other bounds would round what is near 0, and rays that leave a surface there by its own rounding would meet
/// it again.
///
/// ```
/// use photofit_rays::exact_center;
///
/// assert_eq!(exact_center([1e6, 1e6 + 1.0]), 1e6 + 0.5);
/// assert_eq!(exact_center([-1.0, 1e6]), 0.0);
/// ```
pub fn exact_center([lo, hi]: [f64; 2]) -> f64 {
    let far = lo.abs().max(hi.abs());
    let is_far = lo * hi > 0.0 && lo.abs().min(hi.abs()) >= 0.5 * (hi - lo);
    if !is_far {
        return 0.0;
    }
    // One unit in the last place of the largest coordinate.
    let unit = (far.log2().floor() - 23.0).exp2();
    (0.5 * (lo + hi) / unit).round() * unit
}

pub(super) fn build(
    positions: &[Vec3f],
    triangles: &[[u32; 3]],
    builder: Builder,
) -> Result<Accel, AccelError> {
    if triangles.len() > MAX_TRIANGLES {
        return Err(AccelError::TooMany { triangles: triangles.len() });
    }
    let (lo, hi) = check(positions, triangles)?;
    let range = |k: usize| [f64::from(lo[k]), f64::from(hi[k])];
    let center: [f64; 3] = std::array::from_fn(|k| exact_center(range(k)));
    let half = (0..3).flat_map(|k| range(k).map(|x| (x - center[k]).abs())).fold(0.0, f64::max);
    // A power of two changes no mantissa. One point alone has no size.
    let scale = if half > 0.0 { (-half.log2().ceil()).clamp(-100.0, 100.0).exp2() } else { 1.0 };
    let mut accel = Accel {
        nodes: Buffer::default(),
        packets: Buffer::default(),
        center,
        scale,
        back: (1.0 / scale) as f32,
        extent: 0.0,
        triangles: triangles.len(),
    };
    if triangles.is_empty() {
        return Ok(accel);
    }
    let local: Vec<Vec3A> =
        positions.par_iter().with_min_len(CHUNK).map(|&p| accel.local(p).into()).collect();
    let corners = |t: u32| triangles[t as usize].map(|i| local[i as usize]);
    let item = |t: u32| {
        let [a, b, c] = corners(t);
        Item::new(a.min(b).min(c), a.max(b).max(c), t)
    };
    let mut items = Buffer::from_fn(triangles.len(), |t| item(t as u32));
    let clustered = match builder {
        Builder::Binned => None,
        Builder::Clustered => ploc::build(&mut items, false),
        Builder::Reinserted => ploc::build(&mut items, true),
    };
    let tree = clustered.unwrap_or_else(|| binary::build(&mut items));
    accel.extent = tree.root.lo.iter().chain(&tree.root.hi).fold(0.0, |e, x| x.abs().max(e));
    let wide = wide::collapse(&tree);
    let packet = |i: usize| {
        let set = &wide.leaves[i];
        let items = &items[set.first as usize..][..set.count as usize];
        Packet::new(items.iter().map(Item::number), corners)
    };
    accel.packets = Buffer::from_fn(wide.leaves.len(), packet);
    accel.nodes = Buffer::from_fn(wide.nodes.len(), |i| wide.nodes[i]);
    Ok(accel)
}

/// Checks indices and coordinates; the box of the named vertices.
fn check(positions: &[Vec3f], triangles: &[[u32; 3]]) -> Result<(Vec3f, Vec3f), AccelError> {
    if triangles.is_empty() {
        return Ok(<(Vec3f, Vec3f)>::default());
    }
    let named = |triangles: &[[u32; 3]]| {
        let mut named = Named::NONE;
        triangles.as_flattened().iter().for_each(|&i| named.add(positions.get(i as usize)));
        named
    };
    let all = triangles.par_chunks(CHUNK).map(named).reduce(|| Named::NONE, Named::union);
    if all.unsound.any()
        && let Some(fault) = fault(positions, triangles)
    {
        return Err(fault);
    }
    let corner = |p: Vec4| vec3(p.x, p.y, p.z);
    Ok((corner(all.lo), corner(all.hi)))
}

/// The vertices that triangles name.
#[derive(Clone, Copy)]
struct Named {
    lo: Vec4,
    hi: Vec4,
    /// Set where a coordinate is not finite or too large, or a vertex is not there.
    unsound: BVec4A,
}

impl Named {
    const NONE: Self = Self { lo: Vec4::INFINITY, hi: Vec4::NEG_INFINITY, unsound: BVec4A::splat(false) };

    #[inline(always)]
    fn add(&mut self, position: Option<&Vec3f>) {
        let p = position.map_or(Vec4::NAN, |p| Vec4::new(p.x, p.y, p.z, 0.0));
        self.lo = self.lo.min(p);
        self.hi = self.hi.max(p);
        // Written so that NaN counts.
        self.unsound |= !p.abs().cmple(Vec4::splat(MAX_COORDINATE));
    }

    fn union(self, other: Self) -> Self {
        Self { lo: self.lo.min(other.lo), hi: self.hi.max(other.hi), unsound: self.unsound | other.unsound }
    }
}

/// The first fault.
fn fault(positions: &[Vec3f], triangles: &[[u32; 3]]) -> Option<AccelError> {
    let mut corners = triangles.iter().enumerate().flat_map(|(t, corners)| corners.map(|index| (t, index)));
    corners.find_map(|(triangle, index)| {
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
}
