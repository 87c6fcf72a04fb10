//! Tracking through a medium: collisions by delta tracking, transmittance by ratio tracking, both along the cells of a
//! grid of upper bounds (Szirmay-Kalos et al. 2011; Novák, Selle and Jarosz 2014).

use super::Medium;
use crate::world::to_glam;
use glam::{Affine3A, Vec3A};
use photofit_sampling::Rng;
use photofit_scalar::{Vec3f, vec3};

/// Transmittance below which it is decided by chance whether a ratio-tracked ray goes on.
const ROULETTE: f32 = 0.05;

/// The part of a ray inside of the box of a medium.
pub(crate) struct Inside {
    /// Where the ray starts, in the unit cube.
    origin: Vec3A,
    /// Where it goes, in the unit cube per unit of length of the world.
    direction: Vec3A,
    inverse: [f32; 3],
    /// Distances along the ray, in the world.
    pub(crate) from: f32,
    pub(crate) to: f32,
}

impl Inside {
    /// Place in the unit cube at a distance along the ray.
    #[inline(always)]
    pub(crate) fn at(&self, t: f32) -> Vec3f {
        let q = self.origin + self.direction * t;
        vec3(q.x, q.y, q.z)
    }
}

/// A small transmittance lives on by chance, larger for those that do not.
#[inline(always)]
fn survive(through: f32, rng: &mut Rng) -> f32 {
    if through < ROULETTE {
        if rng.next_f32() * ROULETTE < through { ROULETTE } else { 0.0 }
    } else {
        through
    }
}

/// The part of a ray from 0 to `t_max` inside of the unit cube that `inward` leads to, if it has any.
#[inline]
pub(super) fn clip(inward: &Affine3A, origin: Vec3f, direction: Vec3f, t_max: f32) -> Option<Inside> {
    // In the unit cube; `t` stays in units of the world because the transform is affine.
    let origin = inward.transform_point3a(to_glam(origin));
    let direction = inward.transform_vector3a(to_glam(direction));
    let (mut from, mut to) = (0.0_f32, t_max);
    let mut inverse = [0.0_f32; 3];
    for k in 0..3 {
        if direction[k] == 0.0 {
            if !(0.0..=1.0).contains(&origin[k]) {
                return None;
            }
            inverse[k] = f32::INFINITY;
            continue;
        }
        inverse[k] = 1.0 / direction[k];
        let (a, b) = (-origin[k] * inverse[k], (1.0 - origin[k]) * inverse[k]);
        from = from.max(a.min(b));
        to = to.min(a.max(b));
    }
    // Also where something is not a number.
    let passes = from < to;
    passes.then_some(Inside { origin, direction, inverse, from, to })
}

impl Medium {
    /// Distance of the first real collision within `t_max`, with the place in the unit cube.
    pub(crate) fn collide(
        &self,
        origin: Vec3f,
        direction: Vec3f,
        t_max: f32,
        rng: &mut Rng,
    ) -> Option<(f32, Vec3f)> {
        let mut found = None;
        self.walk(origin, direction, t_max, rng, |t, q, majorant, rng| {
            let real = rng.next_f32() * majorant < self.extinction(q);
            if real {
                found = Some((t, q));
            }
            !real
        });
        found
    }

    /// Unbiased estimate of the transmittance along the ray.
    pub(crate) fn transmittance(&self, origin: Vec3f, direction: Vec3f, t_max: f32, rng: &mut Rng) -> f32 {
        let mut through = 1.0_f32;
        self.walk(origin, direction, t_max, rng, |_, q, majorant, rng| {
            through = survive(through * (1.0 - self.extinction(q) / majorant), rng);
            through > 0.0
        });
        through.max(0.0)
    }

    /// The part of a ray from 0 to `t_max` inside of the box, if it has any.
    #[inline]
    pub(crate) fn clip(&self, origin: Vec3f, direction: Vec3f, t_max: f32) -> Option<Inside> {
        clip(&self.inward, origin, direction, t_max)
    }

    /// A distance inside of the box with a density proportional to an unbiased estimate of the transmittance from the
    /// start of the ray, and the integral of the estimate: with `(t, w)`, the expectation of `w f(t)` is the integral of
    /// transmittance times `f` along the ray.
    pub(crate) fn sample_transmittance(
        &self,
        origin: Vec3f,
        direction: Vec3f,
        t_max: f32,
        rng: &mut Rng,
    ) -> Option<(f32, f32)> {
        let inside = self.clip(origin, direction, t_max)?;
        let (mut through, mut since) = (1.0_f32, inside.from);
        let (mut sum, mut picked) = (0.0_f32, [inside.from; 2]);
        // The estimate is constant between collisions with the medium of the upper bound.
        let mut offer = |through: f32, from: f32, to: f32, rng: &mut Rng| {
            let weight = through * (to - from);
            sum += weight;
            if weight > 0.0 && rng.next_f32() * sum < weight {
                picked = [from, to];
            }
        };
        self.walk(origin, direction, t_max, rng, |t, q, majorant, rng| {
            offer(through, since, t, rng);
            since = t;
            through = survive(through * (1.0 - self.extinction(q) / majorant), rng);
            through > 0.0
        });
        offer(through, since, inside.to, rng);
        let [from, to] = picked;
        (sum > 0.0).then(|| (from + (to - from) * rng.next_f32(), sum))
    }

    /// Walks the cells along a ray and calls `collision` with distance, place and upper bound at the collisions with a
    /// medium of the upper bound, until it says false.
    #[inline]
    fn walk(
        &self,
        origin: Vec3f,
        direction: Vec3f,
        t_max: f32,
        rng: &mut Rng,
        mut collision: impl FnMut(f32, Vec3f, f32, &mut Rng) -> bool,
    ) {
        let Some(inside) = self.clip(origin, direction, t_max) else { return };
        let Inside { origin, direction: d, inverse, from, to } = inside;
        // Distances from where the ray enters the box: those from a far origin would swallow short steps.
        let start = origin + d * from;
        let (mut t, end) = (0.0, to - from);
        let mut cell = [0_usize; 3];
        let mut next = [f32::INFINITY; 3];
        let mut step = [0.0_f32; 3];
        for k in 0..3 {
            // Cells cover BLOCK voxels each; the last one may stick out of the cube.
            let per = self.cells_per_unit(k);
            cell[k] = ((start[k] * per) as usize).min(self.cells[k] - 1);
            if d[k] != 0.0 {
                let wall = if d[k] > 0.0 { (cell[k] + 1) as f32 } else { cell[k] as f32 };
                next[k] = (wall / per - start[k]) * inverse[k];
                step[k] = (inverse[k] / per).abs();
            }
        }
        loop {
            let k = if next[0] < next[1] {
                if next[0] < next[2] { 0 } else { 2 }
            } else if next[1] < next[2] {
                1
            } else {
                2
            };
            let leave = next[k].min(end);
            let majorant = self.majorants[(cell[2] * self.cells[1] + cell[1]) * self.cells[0] + cell[0]];
            loop {
                // An empty cell is left at once: the quotient is infinite, or not a number.
                t -= (1.0 - rng.next_f32()).ln() / majorant;
                let inside = t < leave;
                if !inside {
                    break;
                }
                let q = start + d * t;
                if !collision((from + t).min(to), vec3(q.x, q.y, q.z), majorant, rng) {
                    return;
                }
            }
            if leave >= end {
                return;
            }
            t = leave;
            let inside = if d[k] > 0.0 { cell[k] + 1 < self.cells[k] } else { cell[k] > 0 };
            if !inside {
                return;
            }
            cell[k] = if d[k] > 0.0 { cell[k] + 1 } else { cell[k] - 1 };
            next[k] += step[k];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Volume;
    use super::*;
    use glam::DVec3;

    /// In a cell whose upper bound is ten thousand times the extinction, near by and from afar.
    #[test]
    fn transmittance_beside_a_thick_voxel_from_any_distance() {
        let mut volume = Volume::homogeneous(DVec3::ZERO, DVec3::ONE, 1.0, Vec3f::zero(), 0.0);
        volume.size = [4, 1, 1];
        for thick in [1.0, 1e4, 1e30] {
            volume.density = vec![1.0, 1.0, 1.0, thick];
            let medium = Medium::new(0, volume.clone(), DVec3::ZERO, 1.0).unwrap();
            let n = if thick > 1.0 { 60 } else { 6000 };
            for distance in [0.5_f32, 1e4] {
                let through = |i: u64| {
                    let origin = vec3(0.1, -distance, 0.5);
                    f64::from(medium.transmittance(origin, vec3(0.0, 1.0, 0.0), 2e4, &mut Rng::new(i, 7)))
                };
                let mean = (0..n).map(through).sum::<f64>() / n as f64;
                // Ratio tracking of many steps has little variance; of few, that of chance.
                let bound = if thick > 1.0 { 0.01 } else { 0.03 };
                assert!((mean - (-1.0_f64).exp()).abs() < bound, "{thick} from {distance}: {mean}");
            }
        }
    }
}
