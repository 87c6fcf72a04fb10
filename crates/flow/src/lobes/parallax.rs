//! Lobes that look at places rather than along directions: within a leaf the direction of near light changes with the
//! position, and a lobe that follows it fits the records of the whole leaf (parallax-aware mixtures, Ruppert et al. 2020).
//!
//! How near the place of a lobe is follows from how directions turn with positions, by regression: distances along rays would
//! say how far the light is, but not that it comes through a near opening.

use super::mixture::{Each, LOBES, Mixture, each};
use crate::guide::Record;
use photofit_scalar::{Vec3f, vec3};

/// Largest offset of a position from the pivot over the distance of a place: beyond, directions are those at this offset.
pub(super) const OFFSET_MAX: f32 = 0.8;
/// Standard deviation of the inverse distance before anything was seen, in units of the inverse extent of the records.
const NEAR_FIRST: f32 = 2.0;

/// Where the lobes of a leaf look.
#[derive(Clone, Copy, Debug)]
pub(super) struct Parallax {
    /// Where the lobes are as they are stored.
    pub(super) pivot: Vec3f,
    /// Inverse distances of the places of the lobes from the pivot; 0 for those that are far away.
    pub(super) near: Each,
    /// What is known of [`Self::near`]: one over its variance.
    pub(super) known: Each,
}

/// The lobes at a position, and the distances of their places over those from the pivot.
pub(super) struct Moved {
    pub(super) lobes: Mixture,
    pub(super) distance: Each,
}

impl Parallax {
    /// All places far away.
    pub(super) fn none() -> Self {
        Self { pivot: Vec3f::zero(), near: [0.0; LOBES], known: [0.0; LOBES] }
    }

    /// The lobes as they are at a position.
    #[inline(always)]
    pub(super) fn at(&self, lobes: &Mixture, position: Vec3f) -> Moved {
        let offset = position - self.pivot;
        let usable = offset.is_finite() && self.near != [0.0; LOBES];
        if !usable {
            return Moved { lobes: *lobes, distance: [1.0; LOBES] };
        }
        let length = offset.length();
        let near =
            each(|k| if self.near[k] * length > OFFSET_MAX { OFFSET_MAX / length } else { self.near[k] });
        lobes.moved(&near, offset)
    }

    /// Makes `pivot` the pivot: the same lobes everywhere, but for what is farther from it than the places are.
    pub(super) fn move_to(&mut self, lobes: &mut Mixture, pivot: Vec3f) {
        let moved = self.at(lobes, pivot);
        *lobes = moved.lobes;
        self.near = each(|k| self.near[k] / moved.distance[k]);
        self.pivot = pivot;
    }
}

/// Sums of a weighted regression, lobe by lobe, of how directions turn with positions.
#[derive(Clone, Copy, Debug)]
pub(super) struct Turning {
    mass: Each,
    offset: [Vec3f; LOBES],
    turn: [Vec3f; LOBES],
    squares: Each,
    products: Each,
}

impl Turning {
    pub(super) fn none() -> Self {
        let nothing = [0.0; LOBES];
        Self {
            mass: nothing,
            offset: [Vec3f::zero(); LOBES],
            turn: [Vec3f::zero(); LOBES],
            squares: nothing,
            products: nothing,
        }
    }

    /// Adds `weight` of a direction that was seen at `offset` from the pivot under a lobe of this mean, whose place is
    /// `distance` times as far from there as from the pivot.
    #[inline]
    pub(super) fn add(
        &mut self,
        k: usize,
        weight: f32,
        (wi, offset): (Vec3f, Vec3f),
        mean: Vec3f,
        distance: f32,
    ) {
        let along = mean.dot(wi);
        // Beyond a right angle directions do not turn as near the mean.
        if along <= 0.0 {
            return;
        }
        let across = offset - mean * mean.dot(offset);
        let turn = (wi - mean * along) * distance;
        self.mass[k] += weight;
        self.offset[k] += across * weight;
        self.turn[k] += turn * weight;
        self.squares[k] += weight * across.dot(across);
        self.products[k] += weight * across.dot(turn);
    }

    /// The inverse distance that explains how directions turn, and what is known of it then: `known` of `near` before, the
    /// records at the concentration `kappa`, and that most light is not much nearer than the records are far apart.
    pub(super) fn nearness(&self, k: usize, kappa: f32, (near, known): (f32, f32), extent: f32) -> [f32; 2] {
        let mass = self.mass[k];
        let usable = mass > 0.0 && extent > 0.0 && extent.is_finite();
        if !usable {
            return [near, known];
        }
        let squares = (self.squares[k] - self.offset[k].dot(self.offset[k]) / mass).max(0.0);
        let products = self.products[k] - self.offset[k].dot(self.turn[k]) / mass;
        let first = (extent / NEAR_FIRST).powi(2);
        let known_after = known + kappa * squares;
        let found = (known * near - kappa * products) / (known_after + first);
        if found.is_finite() { [found.max(0.0), known_after] } else { [near, known] }
    }
}

/// The mean of the positions of records, and the largest distance from it.
pub(super) fn center<'a>(own: impl ExactSizeIterator<Item = &'a Record> + Clone) -> (Vec3f, f32) {
    let n = own.len().max(1) as f64;
    let mean = |of: fn(&Record) -> f32| (own.clone().map(|r| f64::from(of(r))).sum::<f64>() / n) as f32;
    let center =
        vec3(mean(|r| r.query.position.x), mean(|r| r.query.position.y), mean(|r| r.query.position.z));
    let far = own.map(|r| (r.query.position - center).length()).fold(0.0, f32::max);
    (center, far)
}

#[cfg(test)]
mod tests {
    use super::super::vmf::Lobe;
    use super::*;
    use photofit_sampling::{Rng, uniform_sphere};

    #[test]
    fn moved_pivots_leave_lobes_as_they_are() {
        let mut rng = Rng::new(3, 3);
        let mut next = || rng.next_f32();
        let lobe = |_| Lobe::new(1.0 / LOBES as f32, uniform_sphere([next(), next()]), 40.0);
        let lobes = Mixture::new(std::array::from_fn(lobe));
        let near = std::array::from_fn(|k| 0.1 * k as f32);
        let before = Parallax { pivot: vec3(1.0, 2.0, 3.0), near, known: [0.0; LOBES] };
        let (mut after, mut moved) = (before, lobes);
        after.move_to(&mut moved, vec3(1.2, 2.1, 2.7));
        for position in [vec3(1.0, 2.0, 3.0), vec3(1.2, 2.1, 2.7), vec3(0.6, 2.3, 3.1)] {
            let (old, new) = (before.at(&lobes, position), after.at(&moved, position));
            for k in 0..LOBES {
                let (a, b) = (old.lobes.lobe(k), new.lobes.lobe(k));
                assert!((a.mean - b.mean).length() < 1e-5 && (a.kappa / b.kappa - 1.0).abs() < 1e-4);
                // The same place from both pivots.
                let place = |p: &Parallax, d: f32| d / p.near[k];
                let distances = [place(&before, old.distance[k]), place(&after, new.distance[k])];
                assert!(k == 0 || (distances[0] / distances[1] - 1.0).abs() < 1e-4, "{distances:?}");
            }
        }
    }

    #[test]
    fn turning_directions_tell_how_near_a_place_is() {
        let mean = vec3(0.0, 0.6, 0.8);
        for distance in [2.0, 10.0, f32::INFINITY] {
            let (mut rng, mut turning) = (Rng::new(4, 1), Turning::none());
            for _ in 0..200 {
                // Far from even around the pivot.
                let offset = vec3(rng.next_f32(), rng.next_f32(), -rng.next_f32()) * 0.1;
                let to = mean - offset * (1.0 / distance);
                let wi = to * (1.0 / to.length());
                turning.add(2, 1.0 + rng.next_f32(), (wi, offset), mean, to.length());
            }
            let [near, known] = turning.nearness(2, 1e6, (0.0, 0.0), 1.0);
            assert!((near - 1.0 / distance).abs() < 0.01, "{near} for {distance}");
            assert!(known > 1e5);
            // What nothing is known of stays far away, and what is known stays.
            let noise = turning.nearness(2, 0.1, (0.0, 0.0), 10.0);
            assert!(noise[0] < 0.05, "{noise:?}");
            assert_eq!(Turning::none().nearness(2, 1e6, (0.3, 7.0), 1.0), [0.3, 7.0]);
        }
    }

    #[test]
    fn offsets_beyond_the_place_and_not_finite_ones_have_lobes() {
        let lobes = Mixture::new([Lobe::new(1.0 / LOBES as f32, vec3(0.0, 0.0, 1.0), 1e4); LOBES]);
        let parallax = Parallax { near: [0.5; LOBES], ..Parallax::none() };
        let z = |z: f32| vec3(0.0, 0.0, z);
        for position in [z(0.0), z(1.9), z(2.0), z(2.1), z(1e30), z(-1e30), z(f32::NAN), z(f32::INFINITY)] {
            let moved = parallax.at(&lobes, position).lobes;
            let density = moved.density(vec3(0.0, 0.0, 1.0));
            assert!(density > 0.0 && density.is_finite(), "{position:?}: {density}");
        }
    }
}
