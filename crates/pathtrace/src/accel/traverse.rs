//! Rays through the tree.

use super::stack::Stack;
use super::triangle::{Packet, PacketHits, Shear};
use super::wide::{LEAF, Node};
use super::{Accel, Hit};
use glam::{Vec3, Vec4};
use photofit_scalar::{Vec3f, vec3};

/// A ray with the range of distances that count.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where it starts, in the asset's units.
    pub origin: Vec3f,
    /// Where it goes; need not be a unit vector. Its largest component must lie in [1e-12, 1e12]: other directions
    /// (zero, NaN) hit nothing.
    pub direction: Vec3f,
    /// Smallest distance that counts, in lengths of `direction`.
    pub t_min: f32,
    /// Largest distance that counts (inclusive; may be infinite).
    pub t_max: f32,
}

impl Ray {
    /// A ray without limits: `t` in `[0, inf]`.
    pub fn new(origin: Vec3f, direction: Vec3f) -> Self {
        Self { origin, direction, t_min: 0.0, t_max: f32::INFINITY }
    }

    /// The same ray with `t` limited to `[t_min, t_max]`.
    #[must_use]
    pub fn within(self, t_min: f32, t_max: f32) -> Self {
        Self { t_min, t_max, ..self }
    }

    /// The point at distance `t`.
    pub fn at(&self, t: f32) -> Vec3f {
        vec3(
            self.direction.x.mul_add(t, self.origin.x),
            self.direction.y.mul_add(t, self.origin.y),
            self.direction.z.mul_add(t, self.origin.z),
        )
    }
}

/// What the box tests need of a ray.
pub(super) struct Slabs {
    /// Origins for the lower and the upper planes; apart by the rounding of the tests.
    near_origin: [Vec4; 3],
    far_origin: [Vec4; 3],
    inverse: [Vec4; 3],
    negative: [bool; 3],
    t_min: f32,
}

impl Slabs {
    /// `d` is finite and not zero; the slabs are widened by `pad` on both sides.
    #[inline(always)]
    pub(super) fn new(o: Vec3, d: Vec3, pad: f32, t_min: f32) -> Self {
        let floor = d.abs().max_element() * 1e-12;
        let mut slabs = Self {
            near_origin: [Vec4::ZERO; 3],
            far_origin: [Vec4::ZERO; 3],
            inverse: [Vec4::ZERO; 3],
            negative: [false; 3],
            t_min,
        };
        for k in 0..3 {
            // A finite inverse: 0 * inf would be NaN. The pad times 1e12 exceeds every distance in question.
            let inverse = 1.0 / if d[k].abs() > floor { d[k] } else { floor.copysign(d[k]) };
            let negative = inverse < 0.0;
            let shift = if negative { -pad } else { pad };
            slabs.negative[k] = negative;
            slabs.inverse[k] = Vec4::splat(inverse);
            slabs.near_origin[k] = Vec4::splat(o[k] + shift);
            slabs.far_origin[k] = Vec4::splat(o[k] - shift);
        }
        slabs
    }
}

/// A ray in the frame of the structure.
pub(super) struct Local {
    shear: Shear,
    slabs: Slabs,
    t_max: f32,
}

impl Local {
    #[inline(always)]
    fn new(accel: &Accel, ray: &Ray) -> Option<Self> {
        let scale = accel.scale as f32;
        let (t_min, t_max) = (ray.t_min * scale, (ray.t_max * scale).min(f32::MAX));
        let d = Vec3::from_array(ray.direction.to_array());
        Self::in_frame(accel, accel.local(ray.origin), d, t_min, t_max)
    }

    /// From an origin and a direction in the structure's own frame; `t` counts lengths of `d`.
    #[inline(always)]
    pub(super) fn in_frame(accel: &Accel, o: Vec3, d: Vec3, t_min: f32, t_max: f32) -> Option<Self> {
        let largest = d.abs().max_element();
        // Written so that NaN fails.
        let usable = d.is_finite() && (1e-12..=1e12).contains(&largest) && o.is_finite() && t_min <= t_max;
        if !usable || accel.nodes.is_empty() {
            return None;
        }
        // The sheared corners and the slab distances are off by at most 6 ulp of the largest coordinate involved.
        let pad = (o.abs().max_element() + accel.extent) * (8.0 * 0.5 * f32::EPSILON);
        Some(Self { shear: Shear::new(o, d), slabs: Slabs::new(o, d, pad, t_min), t_max })
    }
}

impl Accel {
    /// The first triangle along the ray.
    ///
    /// Two triangles at the same distance: the one with the lower index.
    pub fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        self.closest_hit_where(ray, |_| true)
    }

    /// The first triangle along the ray whose hit `accept` lets pass (back faces, texels that are cut out, ...).
    ///
    /// `accept` sees candidates in no particular order, and some of them only.
    #[inline]
    pub fn closest_hit_where(&self, ray: &Ray, mut accept: impl FnMut(&Hit) -> bool) -> Option<Hit> {
        let local = Local::new(self, ray)?;
        let back = (1.0 / self.scale) as f32;
        let mut best: Option<Hit> = None;
        let mut limit = local.t_max;
        self.traverse(&local, local.t_max, |packet, hits| {
            let mut mask = hits.mask;
            while mask != 0 {
                let lane = mask.trailing_zeros() as usize;
                mask &= mask - 1;
                let hit = hits.lane(packet, lane);
                let nearer =
                    hit.t < limit || (hit.t <= limit && best.is_none_or(|b| hit.triangle < b.triangle));
                if nearer && accept(&Hit { t: hit.t * back, ..hit }) {
                    limit = hit.t;
                    best = Some(hit);
                }
            }
            Some(limit)
        });
        best.map(|hit| Hit { t: hit.t * back, ..hit })
    }

    /// True when any triangle lies on the ray.
    pub fn occluded(&self, ray: &Ray) -> bool {
        self.occluded_where(ray, |_| true)
    }

    /// True when any triangle lies on the ray whose hit `accept` lets pass.
    #[inline]
    pub fn occluded_where(&self, ray: &Ray, mut accept: impl FnMut(&Hit) -> bool) -> bool {
        let Some(local) = Local::new(self, ray) else { return false };
        let back = (1.0 / self.scale) as f32;
        let mut occluded = false;
        self.traverse(&local, local.t_max, |packet, hits| {
            let mut mask = hits.mask;
            while mask != 0 {
                let hit = hits.lane(packet, mask.trailing_zeros() as usize);
                mask &= mask - 1;
                if accept(&Hit { t: hit.t * back, ..hit }) {
                    occluded = true;
                    return None;
                }
            }
            Some(local.t_max)
        });
        occluded
    }

    /// Calls `visit` with every hit along the ray, in no particular order.
    #[inline]
    pub fn for_each_hit(&self, ray: &Ray, mut visit: impl FnMut(Hit)) {
        let Some(local) = Local::new(self, ray) else { return };
        let back = (1.0 / self.scale) as f32;
        self.traverse(&local, local.t_max, |packet, hits| {
            let mut mask = hits.mask;
            while mask != 0 {
                let hit = hits.lane(packet, mask.trailing_zeros() as usize);
                mask &= mask - 1;
                visit(Hit { t: hit.t * back, ..hit });
            }
            Some(local.t_max)
        });
    }

    /// Visits the leaves along the ray, near ones first; `leaf` returns the new limit or ends the walk.
    #[inline(always)]
    pub(super) fn traverse(
        &self,
        ray: &Local,
        limit: f32,
        mut leaf: impl FnMut(&Packet, &PacketHits) -> Option<f32>,
    ) {
        walk(&self.nodes, &ray.slabs, limit, |index, limit| {
            let packet = &self.packets[index as usize];
            let hits = packet.intersect(&ray.shear, ray.slabs.t_min, limit);
            if hits.mask == 0 { Some(limit) } else { leaf(packet, &hits) }
        });
    }
}

/// Visits the leaves of a tree that the ray's boxes lead to, near ones first, with the limit so far; `leaf` returns the
/// new limit or ends the walk.
#[inline(always)]
pub(super) fn walk(
    nodes: &[Node],
    ray: &Slabs,
    mut limit: f32,
    mut leaf: impl FnMut(u32, f32) -> Option<f32>,
) {
    let mut stack = Stack::new();
    let mut at = 0_u32;
    loop {
        if at & LEAF == 0 {
            let node = &nodes[at as usize];
            let mut near = Vec4::splat(ray.t_min);
            let mut far = Vec4::splat(limit);
            for k in 0..3 {
                let (a, b) =
                    if ray.negative[k] { (node.hi[k], node.lo[k]) } else { (node.lo[k], node.hi[k]) };
                near = near.max((a - ray.near_origin[k]) * ray.inverse[k]);
                far = far.min((b - ray.far_origin[k]) * ray.inverse[k]);
            }
            let mut mask = near.cmple(far).bitmask();
            if mask != 0 {
                let near = near.to_array();
                let first = mask.trailing_zeros() as usize;
                mask &= mask - 1;
                let mut next = (node.child[first], near[first]);
                // The nearest child is walked next; the others wait, the farthest at the bottom.
                let mut waiting = [(0_u32, 0.0_f32); 3];
                let mut count = 0;
                while mask != 0 {
                    let lane = mask.trailing_zeros() as usize;
                    mask &= mask - 1;
                    let mut entry = (node.child[lane], near[lane]);
                    if entry.1 < next.1 {
                        std::mem::swap(&mut entry, &mut next);
                    }
                    let mut i = count;
                    while i > 0 && waiting[i - 1].1 < entry.1 {
                        waiting[i] = waiting[i - 1];
                        i -= 1;
                    }
                    waiting[i] = entry;
                    count += 1;
                }
                for &entry in &waiting[..count] {
                    stack.push(entry);
                }
                at = next.0;
                continue;
            }
        } else {
            match leaf(at & !LEAF, limit) {
                Some(new) => limit = new,
                None => return,
            }
        }
        at = loop {
            match stack.pop() {
                None => return,
                Some((node, near)) if near <= limit => break node,
                Some(_) => {}
            }
        };
    }
}
