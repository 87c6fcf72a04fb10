//! Rays through the tree.

use super::triangle::{Packet, PacketHits, Shear};
use super::walk::{PAD, Slabs};
#[cfg(target_arch = "x86_64")]
use super::width::Avx2;
use super::width::{Portable, Width};
use super::{Accel, Hit};
use glam::Vec3A;
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

/// A ray in the frame of the structure.
#[derive(Debug)]
pub(super) struct Local {
    shear: Shear,
    slabs: Slabs,
    t_max: f32,
    /// False for rays that hit nothing; the rest is meaningless then. (An optional ray would be moved in memory, which
    /// waits for its parts to be written.)
    usable: bool,
}

impl Local {
    #[inline(always)]
    fn new(accel: &Accel, ray: &Ray) -> Self {
        let scale = accel.scale as f32;
        let (t_min, t_max) = (ray.t_min * scale, (ray.t_max * scale).min(f32::MAX));
        let d = Vec3A::from_array(ray.direction.to_array());
        Self::in_frame(accel, accel.local(ray.origin).into(), d, t_min, t_max)
    }

    /// From an origin and a direction in the structure's own frame; `t` counts lengths of `d`.
    #[inline(always)]
    pub(super) fn in_frame(accel: &Accel, o: Vec3A, d: Vec3A, t_min: f32, t_max: f32) -> Self {
        let (largest, farthest) = (d.abs().max_element(), o.abs().max_element());
        // Written so that NaN fails.
        let usable = d.is_finite()
            && (1e-12..=1e12).contains(&largest)
            && o.is_finite()
            && t_min <= t_max
            && !accel.nodes.is_empty();
        let pad = (farthest + accel.extent) * PAD;
        let slabs = Slabs::new(o, d, largest, pad, t_min);
        Self { shear: Shear::new(o, d, &slabs), slabs, t_max, usable }
    }

    /// The largest distance that counts.
    pub(super) fn t_max(&self) -> f32 {
        self.t_max
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
    pub fn closest_hit_where(&self, ray: &Ray, accept: impl FnMut(&Hit) -> bool) -> Option<Hit> {
        #[cfg(target_arch = "x86_64")]
        if let Some(width) = Avx2::detect() {
            return width.run(|| self.closest_with(width, ray, accept));
        }
        self.closest_with(Portable, ray, accept)
    }

    /// [`Self::closest_hit_where`] with given instructions.
    #[inline(always)]
    pub(super) fn closest_with(
        &self,
        width: impl Width,
        ray: &Ray,
        mut accept: impl FnMut(&Hit) -> bool,
    ) -> Option<Hit> {
        let local = Local::new(self, ray);
        let back = self.back;
        let mut best: Option<Hit> = None;
        let mut limit = local.t_max;
        self.traverse(width, &local, |packet, hits| {
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
    pub fn occluded_where(&self, ray: &Ray, accept: impl FnMut(&Hit) -> bool) -> bool {
        #[cfg(target_arch = "x86_64")]
        if let Some(width) = Avx2::detect() {
            return width.run(|| self.occluded_with(width, ray, accept));
        }
        self.occluded_with(Portable, ray, accept)
    }

    /// [`Self::occluded_where`] with given instructions.
    #[inline(always)]
    pub(super) fn occluded_with(
        &self,
        width: impl Width,
        ray: &Ray,
        mut accept: impl FnMut(&Hit) -> bool,
    ) -> bool {
        let mut occluded = false;
        self.visit_with(width, ray, |hit| {
            occluded = accept(&hit);
            !occluded
        });
        occluded
    }

    /// Calls `visit` with every hit along the ray, in no particular order.
    #[inline]
    pub fn for_each_hit(&self, ray: &Ray, mut visit: impl FnMut(Hit)) {
        let visit = |hit| {
            visit(hit);
            true
        };
        #[cfg(target_arch = "x86_64")]
        if let Some(width) = Avx2::detect() {
            return width.run(|| self.visit_with(width, ray, visit));
        }
        self.visit_with(Portable, ray, visit);
    }

    /// Calls `visit` with the hits along the ray until it returns false.
    #[inline(always)]
    pub(super) fn visit_with(&self, width: impl Width, ray: &Ray, mut visit: impl FnMut(Hit) -> bool) {
        let local = Local::new(self, ray);
        if !local.usable {
            return;
        }
        let back = self.back;
        let packets: &[Packet] = &self.packets;
        width.walk_any(&self.nodes, packets, &local.slabs, local.t_max, |index| {
            let packet = &packets[index as usize];
            let hits = packet.intersect(&local.shear, local.slabs.t_min, local.t_max);
            let mut mask = hits.mask;
            while mask != 0 {
                let hit = hits.lane(packet, mask.trailing_zeros() as usize);
                mask &= mask - 1;
                if !visit(Hit { t: hit.t * back, ..hit }) {
                    return false;
                }
            }
            true
        });
    }

    /// Visits the leaves along the ray that have hits, near ones first; `leaf` returns the new limit or ends
    /// the walk.
    #[inline(always)]
    pub(super) fn traverse(
        &self,
        width: impl Width,
        ray: &Local,
        mut leaf: impl FnMut(&Packet, &PacketHits) -> Option<f32>,
    ) {
        if !ray.usable {
            return;
        }
        let packets: &[Packet] = &self.packets;
        width.walk_near(&self.nodes, packets, &ray.slabs, ray.t_max, |index, limit| {
            let packet = &packets[index as usize];
            let hits = packet.intersect(&ray.shear, ray.slabs.t_min, limit);
            if hits.mask == 0 { Some(limit) } else { leaf(packet, &hits) }
        });
    }
}
