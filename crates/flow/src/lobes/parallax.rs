//! Lobes that look at places rather than along directions: within a leaf the direction of near light changes with the
//! position, and a lobe that follows it fits the records of the whole leaf (parallax-aware mixtures, Ruppert et al. 2020).
//!
//! There the distance of a place is the mean length of the rays that found light. Here it follows from how directions turn with
//! positions, by weighted least squares: that also tells light that comes from far away through a near opening.

use super::mixture::{Each, LOBES, Mixture, each};
use super::vmf::mean_length;
use crate::guide::Record;
use photofit_scalar::Vec3f;

/// Largest offset of a position from the pivot over the distance of a place: beyond, the place is thought to be so far away.
const OFFSET_MAX: f32 = 0.8;
/// Standard deviation of inverse distances before anything was seen, over the inverse extent of the records.
const SPREAD: f32 = 2.0;

/// Where the lobes of a leaf look.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Parallax {
    /// The lobes are stored as they are seen from here.
    pub(super) pivot: Vec3f,
    /// Inverse distances of the places of the lobes from the pivot; 0 for those that are far away.
    pub(super) inverse: Each,
    /// What records told of [`Self::inverse`]: the sum of their precisions, and of what each found times its precision.
    pub(super) precision: Each,
    pub(super) information: Each,
}

/// The lobes at a position.
pub(super) struct Moved {
    pub(super) lobes: Mixture,
    /// Distances of the places over those from the pivot.
    pub(super) distance: Each,
    /// The inverse distances from the pivot that were used: [`OFFSET_MAX`] bounds them.
    pub(super) inverse: Each,
}

impl Parallax {
    /// All places far away.
    pub(super) fn none() -> Self {
        let nothing = [0.0; LOBES];
        Self { pivot: Vec3f::zero(), inverse: nothing, precision: nothing, information: nothing }
    }

    /// The lobes as they are at a position.
    #[inline(always)]
    pub(super) fn at(&self, lobes: &Mixture, position: Vec3f) -> Moved {
        let offset = position - self.pivot;
        let usable = offset.is_finite() && self.inverse != [0.0; LOBES];
        if !usable {
            return Moved { lobes: *lobes, distance: [1.0; LOBES], inverse: [0.0; LOBES] };
        }
        let most = OFFSET_MAX / offset.length();
        let inverse = each(|k| if self.inverse[k] > most { most } else { self.inverse[k] });
        let (lobes, distance) = lobes.moved(&inverse, offset);
        Moved { lobes, distance, inverse }
    }

    /// Makes `pivot` the pivot. The lobes stay as they are everywhere, where neither [`OFFSET_MAX`] nor the bounds of
    /// concentrations act.
    pub(super) fn move_to(&mut self, lobes: &mut Mixture, pivot: Vec3f) {
        let moved = self.at(lobes, pivot);
        *lobes = moved.lobes;
        self.inverse = each(|k| moved.inverse[k] / moved.distance[k]);
        // The inverse distance from there changes with that from here as one over the square.
        self.precision = each(|k| self.precision[k] * moved.distance[k].powi(4));
        self.information = each(|k| self.information[k] * moved.distance[k].powi(3));
        self.pivot = pivot;
    }

    /// The same with a part of what records told.
    #[must_use]
    pub(super) fn fading(self, part: f32) -> Self {
        let scaled = |v: Each| v.map(|x| part * x);
        Self { precision: scaled(self.precision), information: scaled(self.information), ..self }
    }

    /// Sets the inverse distance of a lobe by what was told `before` and by `found` (precision and information of records).
    /// Before, most light is not much nearer than the records, which have this extent, are apart.
    pub(super) fn learn(&mut self, k: usize, before: &Self, found: [f32; 2], extent: f32) {
        let (precision, information) = (before.precision[k] + found[0], before.information[k] + found[1]);
        let inverse = information / (precision + (extent / SPREAD).powi(2));
        if inverse.is_finite() && precision.is_finite() {
            (self.inverse[k], self.precision[k], self.information[k]) =
                (inverse.max(0.0), precision, information);
        }
    }
}

/// Sums of a weighted regression, lobe by lobe, of how directions turn with positions.
#[derive(Clone, Copy, Debug)]
pub(super) struct Turning {
    mass: Each,
    /// Of squared weights.
    mass_squares: Each,
    offset: [Vec3f; LOBES],
    turn: [Vec3f; LOBES],
    squares: Each,
    products: Each,
}

impl Turning {
    pub(super) fn none() -> Self {
        let (nothing, nowhere) = ([0.0; LOBES], [Vec3f::zero(); LOBES]);
        Self {
            mass: nothing,
            mass_squares: nothing,
            offset: nowhere,
            turn: nowhere,
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
        let across = offset - mean * mean.dot(offset);
        let turn = (wi - mean * mean.dot(wi)) * distance;
        self.mass[k] += weight;
        self.mass_squares[k] += weight * weight;
        self.offset[k] += across * weight;
        self.turn[k] += turn * weight;
        self.squares[k] += weight * across.dot(across);
        self.products[k] += weight * across.dot(turn);
    }

    /// Precision and information that the records give of the inverse distance of a lobe of this concentration.
    ///
    /// A direction across the mean is on average that of the mean times the mean length `A` of the lobe, and its variance along
    /// each axis is `A / kappa`. Few heavy records count for as many equal ones as have the same variance.
    pub(super) fn found(&self, k: usize, kappa: f32) -> [f32; 2] {
        let mass = self.mass[k];
        if mass <= 0.0 {
            return [0.0; 2];
        }
        let squares = (self.squares[k] - self.offset[k].dot(self.offset[k]) / mass).max(0.0);
        let products = self.products[k] - self.offset[k].dot(self.turn[k]) / mass;
        let each = kappa * (mass / self.mass_squares[k]).min(1.0);
        [each * mean_length(kappa) * squares, -each * products]
    }
}

/// The mean of the positions of records.
pub(super) fn center<'a>(own: impl ExactSizeIterator<Item = &'a Record> + Clone) -> Vec3f {
    let n = own.len().max(1) as f64;
    let mean = |axis: usize| (own.clone().map(|r| f64::from(r.query.position[axis])).sum::<f64>() / n) as f32;
    Vec3f::from_array([0, 1, 2].map(mean))
}

/// How far apart records are: the diagonal of the box, for even ones in a box, by medians of distances from the median along each
/// axis, which a few that are far away do not move.
pub(super) fn extent<'a>(own: impl Iterator<Item = &'a Record> + Clone) -> f32 {
    let along = |axis: usize| {
        let mut values: Vec<f32> = own.clone().map(|r| r.query.position[axis]).collect();
        let middle = median(&mut values);
        values.iter_mut().for_each(|v| *v = (*v - middle).abs());
        median(&mut values)
    };
    4.0 * [0, 1, 2].map(|axis| along(axis).powi(2)).iter().sum::<f32>().sqrt()
}

/// The upper median; 0 of nothing.
pub(super) fn median(values: &mut [f32]) -> f32 {
    if values.is_empty() {
        return 0.0;
    }
    *values.select_nth_unstable_by(values.len() / 2, f32::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::super::vmf::Lobe;
    use super::*;
    use photofit_sampling::{Rng, uniform_sphere};
    use photofit_scalar::vec3;

    fn eight(mean: Vec3f, kappa: f32) -> Mixture {
        Mixture::new([Lobe::new(1.0 / LOBES as f32, mean, kappa); LOBES])
    }

    #[test]
    fn moved_pivots_leave_lobes_as_they_are() {
        let mut rng = Rng::new(3, 3);
        let mut next = || rng.next_f32();
        let lobe = |_| Lobe::new(1.0 / LOBES as f32, uniform_sphere([next(), next()]), 40.0);
        let lobes = Mixture::new(std::array::from_fn(lobe));
        let inverse = std::array::from_fn(|k| 0.1 * k as f32);
        let before = Parallax { pivot: vec3(1.0, 2.0, 3.0), inverse, ..Parallax::none() };
        let (mut after, mut moved) = (before, lobes);
        after.move_to(&mut moved, vec3(1.2, 2.1, 2.7));
        for position in [vec3(1.0, 2.0, 3.0), vec3(1.2, 2.1, 2.7), vec3(0.6, 2.3, 3.1)] {
            let (old, new) = (before.at(&lobes, position), after.at(&moved, position));
            for k in 0..LOBES {
                let (a, b) = (old.lobes.lobe(k), new.lobes.lobe(k));
                assert!((a.mean - b.mean).length() < 1e-5 && (a.kappa / b.kappa - 1.0).abs() < 1e-4);
                // The same place from both pivots.
                let place = |p: &Parallax, d: f32| d / p.inverse[k];
                let distances = [place(&before, old.distance[k]), place(&after, new.distance[k])];
                assert!(k == 0 || (distances[0] / distances[1] - 1.0).abs() < 1e-4, "{distances:?}");
            }
        }
        // Where the bound acts, the place that was used is kept: .8 of the way back from the new pivot.
        let near = Parallax { inverse: [2.0; LOBES], ..Parallax::none() };
        let (mut after, mut moved) = (near, eight(vec3(0.0, 0.0, 1.0), 40.0));
        after.move_to(&mut moved, vec3(0.8, 0.0, 0.0));
        let back = moved.lobe(0).mean * (1.0 / after.inverse[0]) + vec3(0.8, 0.0, 0.0);
        assert!((back - vec3(0.0, 0.0, 1.0)).length() < 1e-5, "{back:?}");
    }

    #[test]
    fn pivots_keep_what_is_known_of_places() {
        // Straight towards the place: from distance 2 to 1, with which its error changes by a quarter.
        let told = Parallax {
            inverse: [0.5; LOBES],
            precision: [100.0; LOBES],
            information: [50.0; LOBES],
            ..Parallax::none()
        };
        let (mut moved, mut lobes) = (told, eight(vec3(0.0, 0.0, 1.0), 40.0));
        moved.move_to(&mut lobes, vec3(0.0, 0.0, 1.0));
        assert!((moved.inverse[3] - 1.0).abs() < 1e-6);
        assert!((moved.precision[3] - 6.25).abs() < 1e-4, "{}", moved.precision[3]);
        assert!((moved.information[3] / moved.precision[3] - 1.0).abs() < 1e-5);
    }

    /// What records of a lobe at this inverse distance give.
    fn regression(kappa: f32, inverse: f32, weight: impl Fn(u64) -> f32) -> [f32; 2] {
        let mean = vec3(0.0, 0.6, 0.8);
        let mut turning = Turning::none();
        for i in 0..20_000 {
            let mut rng = Rng::new(4, i);
            // Far from even around the pivot.
            let offset = vec3(rng.next_f32(), rng.next_f32(), -rng.next_f32()) * 0.1;
            let to = mean - offset * inverse;
            let (to, distance) = (to * (1.0 / to.length()), to.length());
            let lobe = Lobe::new(1.0, to, kappa * distance * distance);
            let wi = lobe.sample([rng.next_f32(), rng.next_f32()]);
            turning.add(2, weight(i), (wi, offset), mean, distance);
        }
        turning.found(2, kappa)
    }

    #[test]
    fn turning_directions_tell_how_near_a_place_is() {
        for kappa in [3.0, 30.0, 1e3] {
            for inverse in [0.0, 0.4, 1.5] {
                let [precision, information] = regression(kappa, inverse, |_| 1.0);
                let (found, error) = (information / precision, precision.powf(-0.5));
                assert!((found - inverse).abs() < 4.0 * error, "{kappa}: {found} +- {error}, {inverse}");
            }
        }
        // Heavy records do not count as many.
        let even = regression(30.0, 0.4, |_| 1.0)[0];
        let few = regression(30.0, 0.4, |i| if i % 10 == 0 { 10.0 } else { 0.0 })[0];
        assert!((few / even - 0.1).abs() < 0.01, "{few} {even}");
    }

    #[test]
    fn what_is_told_is_summed_and_drawn_to_far_away() {
        let mut parallax = Parallax::none();
        // The prior has a precision of (6 / 2)^2.
        parallax.learn(1, &Parallax::none(), [9.0, 9.0], 6.0);
        assert!((parallax.inverse[1] - 0.5).abs() < 1e-6 && parallax.inverse[0] == 0.0);
        let before = parallax.fading(0.5);
        parallax.learn(1, &before, [9.0, 9.0], 6.0);
        // 4.5 + 9 of precision by now: nothing is drawn to far away twice.
        assert!((parallax.inverse[1] - 13.5 / 22.5).abs() < 1e-6, "{}", parallax.inverse[1]);
        let kept = parallax;
        parallax.learn(1, &kept, [0.0, 0.0], 6.0);
        assert_eq!(parallax, kept, "nothing new");
        parallax.learn(1, &kept, [f32::NAN, 1.0], 6.0);
        parallax.learn(1, &kept, [f32::INFINITY, 1.0], 6.0);
        assert_eq!(parallax, kept, "nothing usable");
        parallax.learn(1, &kept, [9.0, -90.0], 6.0);
        assert_eq!(parallax.inverse[1], 0.0, "no place behind");
    }

    #[test]
    fn extents_do_not_see_a_few_far_records() {
        let query = crate::Query {
            position: Vec3f::zero(),
            normal: Vec3f::zero(),
            wo: Vec3f::zero(),
            roughness: 1.0,
        };
        let none = Record { query, wi: Vec3f::zero(), pdf: 1.0, value: 1.0, incident: 1.0 };
        let mut all = vec![none; 4000];
        for (i, r) in all.iter_mut().enumerate() {
            let mut rng = Rng::new(1, i as u64);
            r.query.position = vec3(2.0 * rng.next_f32(), rng.next_f32(), 5.0);
        }
        assert!((extent(all.iter()) / 5.0_f32.sqrt() - 1.0).abs() < 0.05, "{}", extent(all.iter()));
        all[..40].iter_mut().for_each(|r| r.query.position.x = 1e6);
        assert!((extent(all.iter()) / 5.0_f32.sqrt() - 1.0).abs() < 0.05, "{}", extent(all.iter()));
        assert_eq!(extent(all[..0].iter()), 0.0);
    }

    #[test]
    fn offsets_beyond_the_place_and_not_finite_ones_have_lobes() {
        let (lobes, z) = (eight(vec3(0.0, 0.0, 1.0), 1e4), |z: f32| vec3(0.0, 0.0, z));
        let parallax = Parallax { inverse: [0.5; LOBES], ..Parallax::none() };
        for position in [z(0.0), z(1.9), z(2.0), z(2.1), z(1e30), z(-1e30), z(f32::NAN), z(f32::INFINITY)] {
            let moved = parallax.at(&lobes, position).lobes;
            let density = moved.density(vec3(0.0, 0.0, 1.0));
            assert!(density > 0.0 && density.is_finite(), "{position:?}: {density}");
        }
    }
}
