//! Derivatives of flights through one medium, with respect to its extinction and albedo; its emission has `emission`.
//!
//! Light along a segment is the integral of `T sigma_t a L_s` up to its end, plus `T L` of what lies there: `T` is
//! transmittance, `a` the albedo, `L_s` what the phase function gathers. The derivative of `T` at a distance is `-T`
//! times the integral of `d sigma_t` up to there ([`Derivatives::transmittance_vjp`]); that of `sigma_t a` has to be
//! sampled where light could be scattered, also where there is nothing yet ([`Derivatives::sample`]).

use super::bounded::{Extinction, of_chosen, survival};
use super::grid::Taps;
use super::untold::Untold;
use super::{InteriorMedium, Medium, MediumRef, Segment};
use crate::world::World;
use photofit_sampling::Rng;
use photofit_scalar::{Vec3f, vec3};

/// Points at which the change of the optical thickness of a segment that dims all of a path's light is looked up, one in
/// each equal part; one that dims less of it has fewer.
const POINTS: f32 = 4.0;
/// An albedo below which collisions tell its derivative badly, and the albedo at which they count half of what they count
/// otherwise.
const DARK: f32 = 0.05;
const DARK_HALF: f32 = 0.02;

/// A medium, as its derivatives see it.
#[derive(Clone, Copy)]
pub(crate) enum Derivatives<'a> {
    Volume(&'a Medium),
    Bounded(&'a InteriorMedium),
}

/// An extinction that varies, or is the same everywhere.
enum ExtinctionRef<'a> {
    Grid(&'a Medium),
    Even(Vec3f),
}

/// A distance at which light could be scattered.
pub(crate) struct Sample {
    pub(crate) t: f32,
    /// Transmittance over the density of `t`, per channel.
    pub(crate) weight: Vec3f,
}

impl<'a> Derivatives<'a> {
    pub(crate) fn of(world: &'a World, medium: MediumRef) -> Self {
        match medium {
            MediumRef::Volume(i) => Self::Volume(&world.media.boxes[i]),
            MediumRef::Bounded(i) => Self::Bounded(&world.media.bounded[i]),
        }
    }

    fn extinction(self) -> ExtinctionRef<'a> {
        match self {
            Self::Volume(grid) => ExtinctionRef::Grid(grid),
            Self::Bounded(medium) => match &medium.extinction {
                Extinction::Grid(grid) => ExtinctionRef::Grid(grid),
                Extinction::Even { sigma, .. } => ExtinctionRef::Even(*sigma),
            },
        }
    }

    /// Mean cosine of scattering.
    pub(crate) fn g(self) -> f32 {
        match self {
            Self::Volume(medium) => medium.g,
            Self::Bounded(medium) => medium.g,
        }
    }

    /// Whether nothing of it scatters.
    pub(crate) fn absorbs_only(self) -> bool {
        match self {
            Self::Volume(medium) => medium.albedos().iter().all(|a| *a == Vec3f::zero()),
            Self::Bounded(medium) => medium.absorbs_only,
        }
    }

    /// The medium at a point of the render frame.
    #[inline]
    pub(crate) fn at(self, p: Vec3f) -> MediumPoint<'a> {
        match (self, self.extinction()) {
            (Self::Volume(grid), _) => MediumPoint::Volume(grid, grid.taps(grid.to_unit(p))),
            (Self::Bounded(medium), ExtinctionRef::Grid(grid)) => {
                MediumPoint::Bounded { medium, p, grid, taps: grid.taps(grid.to_unit(p)) }
            }
            (Self::Bounded(medium), ExtinctionRef::Even(sigma)) => MediumPoint::Even { medium, p, sigma },
        }
    }

    /// What collisions leave to tell of it.
    pub(crate) fn untold(self) -> Untold {
        match self.extinction() {
            ExtinctionRef::Grid(grid) => Untold::of_voxels(grid.extinctions()),
            ExtinctionRef::Even(sigma) => Untold::Even(sigma),
        }
    }

    /// Transmittance of a segment, per channel: exact, or an unbiased estimate for grids.
    pub(crate) fn transmittance(self, along: &Segment, rng: &mut Rng) -> Vec3f {
        match self {
            Self::Volume(grid) => {
                Vec3f::splat(grid.transmittance(along.origin, along.direction, along.length, rng))
            }
            Self::Bounded(medium) => medium.transmittance(along, rng),
        }
    }

    /// Adjoint of the logarithm of the transmittance of a segment with respect to the values of the extinction, for its
    /// gradient `g`: exact, or an unbiased estimate for grids. `carried` is the part of what the path counts for the loss
    /// that passes through: the number of lookups goes by it, and by nothing that is random for them.
    pub(crate) fn transmittance_vjp(
        self,
        along: &Segment,
        g: Vec3f,
        carried: f32,
        rng: &mut Rng,
        mut add: impl FnMut(usize, Vec3f),
    ) {
        let ExtinctionRef::Grid(grid) = self.extinction() else {
            // Through an even medium without an end comes no light: what is left of it is rounding.
            if along.length.is_finite() {
                self.at(along.origin).extinction_vjp(g * -along.length, add);
            }
            return;
        };
        let Some(inside) = grid.clip(along.origin, along.direction, along.length) else { return };
        let points = (POINTS * carried.min(1.0)).ceil().max(1.0);
        let step = (inside.to - inside.from) / points;
        let g = -g.sum() * step;
        for i in 0..points as u32 {
            let q = inside.at(inside.from + (i as f32 + rng.next_f32()) * step);
            grid.extinction_vjp(&grid.taps(q), g, |i, g| add(i, vec3(g, 0.0, 0.0)));
        }
    }

    /// Length of a segment in the medium: one over the extinction at which scattering is told half by the light of
    /// collisions and half by that of [`Self::sample`]. `None` where it is not finite: by collisions alone.
    pub(crate) fn reach(self, along: &Segment) -> Option<f32> {
        let length = match self.extinction() {
            ExtinctionRef::Grid(grid) => {
                grid.clip(along.origin, along.direction, along.length).map_or(0.0, |i| i.to - i.from)
            }
            ExtinctionRef::Even(_) => along.length,
        };
        (length > 0.0 && length.is_finite()).then_some(length)
    }

    /// A distance along a segment, with a density proportional to transmittance; of media of a coloured extinction by
    /// the `share` of light of each colour.
    pub(crate) fn sample(self, along: &Segment, share: Vec3f, rng: &mut Rng) -> Option<Sample> {
        match self.extinction() {
            ExtinctionRef::Grid(grid) => {
                let (t, weight) =
                    grid.sample_transmittance(along.origin, along.direction, along.length, rng)?;
                Some(Sample { t, weight: Vec3f::splat(weight) })
            }
            ExtinctionRef::Even(sigma) => {
                sample_evenly(sigma, along.length, share, [rng.next_f32(), rng.next_f32()])
            }
        }
    }

    /// The albedo at which collisions count half of what they count otherwise for its derivative; 0: as much as otherwise at any.
    pub(crate) fn dark_albedo(self) -> f32 {
        let (values, factor) = match self {
            Self::Volume(medium) => (medium.albedos(), medium.factor_of_albedos()),
            Self::Bounded(medium) => (medium.albedo.values(), Vec3f::splat(1.0)),
        };
        let dark = values.iter().any(|a| a.mul(factor).to_array().iter().any(|x| *x < DARK));
        if dark { DARK_HALF } else { 0.0 }
    }
}

/// A medium at a point; voxels of the grid of its extinction are looked up once.
pub(crate) enum MediumPoint<'a> {
    Volume(&'a Medium, Taps),
    Bounded {
        medium: &'a InteriorMedium,
        p: Vec3f,
        grid: &'a Medium,
        taps: Taps,
    },
    /// A bounded medium with an extinction that is the same everywhere.
    Even {
        medium: &'a InteriorMedium,
        p: Vec3f,
        sigma: Vec3f,
    },
}

impl MediumPoint<'_> {
    /// Extinction.
    #[inline]
    pub(crate) fn extinction(&self) -> Vec3f {
        match self {
            Self::Volume(grid, taps) | Self::Bounded { grid, taps, .. } => {
                Vec3f::splat(grid.extinction_among(taps))
            }
            Self::Even { sigma, .. } => *sigma,
        }
    }

    /// Adjoint of [`Self::extinction`] with respect to the values before their scale; `add` gets cells and gradients, of
    /// grids in the first channel.
    #[inline]
    pub(crate) fn extinction_vjp(&self, g: Vec3f, mut add: impl FnMut(usize, Vec3f)) {
        match self {
            Self::Volume(grid, taps) | Self::Bounded { grid, taps, .. } => {
                grid.extinction_vjp(taps, g.sum(), |i, g| add(i, vec3(g, 0.0, 0.0)));
            }
            Self::Even { medium, .. } => add(0, g * medium.scale),
        }
    }

    /// Albedo.
    #[inline]
    pub(crate) fn albedo(&self) -> Vec3f {
        match self {
            Self::Volume(grid, taps) => grid.albedo_among(taps),
            Self::Bounded { medium, p, .. } | Self::Even { medium, p, .. } => medium.albedo(*p),
        }
    }

    /// Adjoint of [`Self::albedo`].
    #[inline]
    pub(crate) fn albedo_vjp(&self, g: Vec3f, add: impl FnMut(usize, Vec3f)) {
        match self {
            Self::Volume(grid, taps) => grid.albedo_vjp(taps, g, add),
            Self::Bounded { medium, p, .. } | Self::Even { medium, p, .. } => medium.albedo.vjp(*p, g, add),
        }
    }
}

/// A distance below `length`, which may be infinite, with a density proportional to transmittance, of colours by their
/// `share`; those that have no extinction count on finite ways alone.
pub(super) fn sample_evenly(
    sigma: Vec3f,
    length: f32,
    share: Vec3f,
    [choice, u]: [f32; 2],
) -> Option<Sample> {
    let mut share = share;
    if !length.is_finite() {
        (0..3).filter(|c| sigma[*c] == 0.0).for_each(|c| share[c] = 0.0);
    }
    let total = share.sum();
    let t = truncated_exponential(of_chosen(sigma, share, choice * total), length, u);
    let mut pdf = 0.0;
    for c in (0..3).filter(|c| share[*c] > 0.0) {
        pdf += share[c] / total * truncated_pdf(sigma[c], length, t);
    }
    let weight = sigma.map(|s| survival(s, t)) * (1.0 / pdf);
    weight.is_finite().then_some(Sample { t, weight })
}

/// An exponential distance of extinction `sigma`, below `length`.
fn truncated_exponential(sigma: f32, length: f32, u: f32) -> f32 {
    let thickness = sigma * length;
    let t = if thickness < 1e-6 { u * length } else { -(u * (-thickness).exp_m1()).ln_1p() / sigma };
    t.min(length)
}

/// Its density.
fn truncated_pdf(sigma: f32, length: f32, t: f32) -> f32 {
    let thickness = sigma * length;
    if thickness < 1e-6 { 1.0 / length } else { sigma * (-sigma * t).exp() / -(-thickness).exp_m1() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::Volume;
    use glam::DVec3;

    #[test]
    fn albedos_are_dark_with_their_factor() {
        let of = |factor: Vec3f, albedos: Vec<Vec3f>| {
            let volume = Volume::homogeneous(DVec3::ZERO, DVec3::ONE, 1.0, factor, 0.0);
            let medium = Medium::new(0, Volume { albedos, ..volume }, DVec3::ZERO, 1.0).unwrap();
            Derivatives::Volume(&medium).dark_albedo()
        };
        let grey = Vec3f::splat;
        assert_eq!(of(grey(0.3), Vec::new()), 0.0);
        assert_eq!(of(grey(0.03), Vec::new()), DARK_HALF);
        assert_eq!(of(grey(0.1), Vec::new()), 0.0);
        assert_eq!(of(grey(1.0), vec![vec3(0.3, 0.1, 0.06)]), 0.0);
        assert_eq!(of(grey(1.0), vec![vec3(0.3, 0.1, 0.04)]), DARK_HALF);
        assert_eq!(of(vec3(1.0, 1.0, 0.5), vec![vec3(0.3, 0.1, 0.06)]), DARK_HALF);
    }

    #[test]
    fn truncated_distances_have_their_density() {
        for (sigma, length) in [(0.0, 2.0), (1e-9, 3.0), (0.4, 1.0), (3.0, 2.0), (200.0, 5.0)] {
            let n = 4000;
            let (mut mean, mut whole) = (0.0, 0.0);
            for i in 0..n {
                let u = (f64::from(i) + 0.5) / f64::from(n);
                let t = truncated_exponential(sigma, length, u as f32);
                assert!((0.0..=length).contains(&t), "{sigma} {length}: {t}");
                mean += f64::from(t) / f64::from(n);
                // The density of a distance is one over its derivative by the number that it is made of.
                let h = 1e-3;
                let [a, b] =
                    [u - h, u + h].map(|u| f64::from(truncated_exponential(sigma, length, u as f32)));
                if (0.01..0.9).contains(&u) {
                    let pdf = f64::from(truncated_pdf(sigma, length, t)) * (b - a) / (2.0 * h);
                    whole += pdf - 1.0;
                    assert!((pdf - 1.0).abs() < 0.02, "{sigma} {length} {u}: {pdf}");
                }
            }
            let (s, l) = (f64::from(sigma), f64::from(length));
            let expected = if s * l < 1e-6 { 0.5 * l } else { 1.0 / s - l / ((s * l).exp_m1()) };
            assert!((mean - expected).abs() < 2e-3 * l, "{sigma} {length}: {mean}, not {expected}");
            assert!(whole.abs() < 0.01 * f64::from(n), "{sigma} {length}: {whole}");
        }
    }
}
