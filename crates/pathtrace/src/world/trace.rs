//! Rays through the world.

use super::top::{Entry, EntryKind};
use super::{Interaction, Kind, World, sphere};
use photofit_rays::{BoxRay, DistanceHit, FrameRay};
use photofit_scalar::Vec3f;

/// A ray in the render frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorldRay {
    /// Where it starts.
    pub origin: Vec3f,
    /// Where it goes: a unit vector.
    pub direction: Vec3f,
    /// Largest distance that counts.
    pub t_max: f32,
}

/// Where a ray meets the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorldHit {
    /// Distance along the ray.
    pub t: f32,
    /// Barycentric weight of the second corner; 0 on spheres and grids.
    pub u: f32,
    /// Barycentric weight of the third corner; 0 on spheres and grids.
    pub v: f32,
    /// Index of the instance.
    pub instance: u32,
    /// Index of the triangle in the shape, or of the cell of a grid; 0 on spheres.
    pub piece: u32,
    /// The ray comes from the front (the outer side).
    pub front: bool,
}

impl World {
    /// The first surface along a ray; everything is opaque to it.
    pub fn closest(&self, ray: &WorldRay) -> Option<WorldHit> {
        self.closest_where::<true>(ray, |_| true)
    }

    /// Whether any surface lies on a ray.
    pub fn occluded(&self, ray: &WorldRay) -> bool {
        self.occluded_where::<true>(ray, |_| true)
    }

    /// The point at which a ray meets a surface.
    ///
    /// # Panics
    /// If the hit is not one of this world.
    pub fn point(&self, ray: &WorldRay, hit: &WorldHit) -> Interaction {
        self.interaction::<true>(ray, hit)
    }

    /// The first hit that `accept` lets pass; `TWO_LEVEL` is false for worlds of one structure.
    /// Of hits at the same distance that of the lowest instance and piece counts.
    ///
    /// `accept` sees candidates in no particular order, and some of them only.
    #[inline(always)]
    pub(crate) fn closest_where<const TWO_LEVEL: bool>(
        &self,
        ray: &WorldRay,
        accept: impl Fn(&WorldHit) -> bool,
    ) -> Option<WorldHit> {
        let mut best: Option<WorldHit> = None;
        let visit = |entry: &Entry, mut limit: f32| {
            self.candidates::<TWO_LEVEL>(entry, ray, limit, |hit, limit_now| {
                let nearer = hit.t < limit_now
                    || best.is_none_or(|b| (hit.instance, hit.piece) < (b.instance, b.piece) && hit.t <= b.t);
                if nearer && accept(&hit) {
                    limit = hit.t;
                    best = Some(hit);
                }
                Some(limit)
            });
            Some(limit)
        };
        self.visit_entries::<TWO_LEVEL>(ray, visit);
        best
    }

    /// Whether anything that `accept` lets pass lies on the ray.
    #[inline(always)]
    pub(crate) fn occluded_where<const TWO_LEVEL: bool>(
        &self,
        ray: &WorldRay,
        accept: impl Fn(&WorldHit) -> bool,
    ) -> bool {
        let mut occluded = false;
        let visit = |entry: &Entry, limit: f32| {
            self.candidates::<TWO_LEVEL>(entry, ray, limit, |hit, limit| {
                if accept(&hit) {
                    occluded = true;
                    None
                } else {
                    Some(limit)
                }
            });
            if occluded { None } else { Some(limit) }
        };
        self.visit_entries::<TWO_LEVEL>(ray, visit);
        occluded
    }

    /// Calls `visit` with the entries on a ray nearer than the limit that it returns; `None` ends the walk.
    #[inline(always)]
    fn visit_entries<const TWO_LEVEL: bool>(
        &self,
        ray: &WorldRay,
        mut visit: impl FnMut(&Entry, f32) -> Option<f32>,
    ) {
        let (tree, entries) = (&self.hierarchy.tree, &self.hierarchy.entries);
        if TWO_LEVEL {
            let top = BoxRay::new(tree, ray.origin, ray.direction);
            tree.walk(&top, ray.t_max, |entry, limit| visit(&entries[entry as usize], limit));
        } else if let Some(entry) = entries.first() {
            visit(entry, ray.t_max);
        }
    }

    /// Calls `found` with the hits of an entry nearer than the limit that it returns; `None` ends the walk.
    #[inline(always)]
    fn candidates<const TWO_LEVEL: bool>(
        &self,
        entry: &Entry,
        ray: &WorldRay,
        limit: f32,
        mut found: impl FnMut(WorldHit, f32) -> Option<f32>,
    ) {
        let (accel, owner) = match entry.kind {
            EntryKind::Merged => (0, None),
            EntryKind::Mesh { accel, instance } => (accel, Some(instance)),
            EntryKind::DistanceGrid { instance } => {
                // Worlds of one level have none.
                if TWO_LEVEL {
                    self.grid_candidates(entry, instance, ray, limit, &mut found);
                }
                return;
            }
            EntryKind::Sphere { instance } => {
                let (o, d) = entry.inward.ray_f64(ray.origin, ray.direction);
                let mut limit = limit;
                for t in sphere::intersect(o, d).into_iter().flatten() {
                    let front = (o + d * t).dot(d) < 0.0;
                    let hit = WorldHit { t: t as f32, u: 0.0, v: 0.0, instance, piece: 0, front };
                    if t >= 0.0 && hit.t <= limit {
                        match found(hit, limit) {
                            Some(new) => limit = new,
                            None => return,
                        }
                    }
                }
                return;
            }
        };
        let accel = &self.hierarchy.accels[accel as usize];
        let (o, d) = entry.inward.ray(ray.origin, ray.direction);
        let local = FrameRay::new(accel, o, d, limit);
        accel.candidates(&local, |hit, limit| {
            let (instance, piece) = match owner {
                Some(instance) => (instance, hit.triangle),
                None => {
                    let [instance, triangle] = self.hierarchy.merged[hit.triangle as usize];
                    (instance, triangle)
                }
            };
            // Merged triangles of mirrored instances are wound the other way.
            let turned = owner.is_none() && self.placed[instance as usize].mirrored;
            found(
                WorldHit { t: hit.t, u: hit.u, v: hit.v, instance, piece, front: hit.front != turned },
                limit,
            )
        });
    }

    /// As [`Self::candidates`] of a grid of distances.
    #[inline(never)]
    fn grid_candidates(
        &self,
        entry: &Entry,
        instance: u32,
        ray: &WorldRay,
        limit: f32,
        found: &mut dyn FnMut(WorldHit, f32) -> Option<f32>,
    ) {
        let Kind::DistanceGrid { grid, .. } =
            &self.shapes[self.placed[instance as usize].shape as usize].kind
        else {
            return;
        };
        let (o, d) = entry.inward.ray_f64(ray.origin, ray.direction);
        grid.candidates(o, d, limit, &mut |DistanceHit { t, cell, front }, limit| {
            let t = t as f32;
            // Rounding may have moved it beyond.
            let t = t.min(limit);
            found(WorldHit { t, u: 0.0, v: 0.0, instance, piece: cell, front }, limit)
        });
    }
}
