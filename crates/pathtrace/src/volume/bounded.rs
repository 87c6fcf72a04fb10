//! A medium that surfaces bound: free flights and transmittance, in closed form where it is the same everywhere.
//!
//! Colours of a homogeneous medium have mean free paths of their own. A flight is drawn for one of them, by the share of
//! light that it carries, and weighted by the density over all (the balance heuristic; Wilkie et al. 2014).

use super::derivative::sample_evenly;
use super::field::Lookup;
use super::{Field, Medium, Volume, emission};
use crate::PathtraceError;
use crate::error::invalid;
use glam::DVec3;
use photofit_sampling::Rng;
use photofit_scalar::Vec3f;

/// A medium that fills what surfaces enclose (see [`crate::Boundary`]).
#[derive(Clone, Debug)]
pub struct BoundedMedium {
    /// Extinction, per unit of length of the world. A grid is grey, and there is nothing outside of its box.
    pub extinction: Field,
    /// Factor of the extinction.
    pub scale: f32,
    /// Part of the extinction that scatters, in `[0, 1]`; beyond the box of a grid its border goes on.
    pub albedo: Field,
    /// Mean cosine of scattering (Henyey and Greenstein), in `(-1, 1)`; positive scatters forward, 0 is isotropic.
    pub g: f32,
    /// Light that it emits per unit of length, W/(m^3 sr), whatever its extinction; beyond the box of a grid none. `None`:
    /// none, and its derivative is not known.
    pub emission: Option<Field>,
}

impl BoundedMedium {
    /// The same everywhere.
    pub fn homogeneous(extinction: Vec3f, albedo: Vec3f, g: f32) -> Self {
        Self {
            extinction: Field::constant(extinction),
            scale: 1.0,
            albedo: Field::constant(albedo),
            g,
            emission: None,
        }
    }
}

/// Extinction, ready for tracking.
#[derive(Debug)]
pub(super) enum Extinction {
    /// Per unit of length, and before its scale.
    Even {
        sigma: Vec3f,
        given: Vec3f,
    },
    Grid(Box<Medium>),
}

/// A bounded medium, ready for tracking.
#[derive(Debug)]
pub(crate) struct InteriorMedium {
    pub(super) extinction: Extinction,
    /// Factor of the extinction.
    pub(super) scale: f32,
    pub(super) albedo: Lookup,
    /// It scatters nowhere.
    pub(crate) absorbs_only: bool,
    pub(crate) g: f32,
    pub(super) emission: Option<Lookup>,
}

/// The part of a ray in a medium.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Segment {
    pub(crate) origin: Vec3f,
    /// Unit vector.
    pub(crate) direction: Vec3f,
    pub(crate) length: f32,
}

/// What became of light that flew through a medium.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Flight {
    /// Distance of the collision; `None`: it came through.
    pub(crate) collision: Option<f32>,
    /// Factor of the throughput.
    pub(crate) weight: Vec3f,
}

impl InteriorMedium {
    pub(crate) fn new(
        index: usize,
        medium: BoundedMedium,
        origin: DVec3,
        factor: f32,
    ) -> Result<Self, PathtraceError> {
        let fail = |rule: String| Err(invalid(format!("medium {index}"), rule));
        let BoundedMedium { extinction, scale, albedo, g, emission } = medium;
        if g.is_nan() || g.abs() >= 1.0 {
            return fail(format!("its anisotropy is {g}; it must lie in (-1, 1)"));
        }
        if !(scale >= 0.0 && scale.is_finite()) {
            return fail(format!("its scale is {scale}; it must be finite and not negative"));
        }
        let share = ("in [0, 1]", |x: f32| (0.0..=1.0).contains(&x));
        let fault = extinction.fault("extinction", emission::RULE).or_else(|| albedo.fault("albedo", share));
        let fault = fault.or_else(|| emission.as_ref().and_then(|e| e.fault("emission", emission::RULE)));
        if let Some(rule) = fault {
            return fail(rule);
        }
        if extinction.values.iter().any(|e| !(*e * scale).is_finite()) {
            return fail(format!("extinction times the scale, {scale}, overflows; it must be finite"));
        }
        let extinction = match extinction.single() {
            Some(e) => Extinction::Even { sigma: e * scale, given: e },
            None => Extinction::Grid(Box::new(Self::grid(index, extinction, scale, (origin, factor))?)),
        };
        let absorbs_only = albedo.values.iter().all(|a| *a == Vec3f::zero());
        let emission = emission.map(|e| Lookup::new(e, origin));
        Ok(Self { extinction, scale, albedo: Lookup::new(albedo, origin), absorbs_only, g, emission })
    }

    fn grid(
        index: usize,
        field: Field,
        scale: f32,
        (origin, factor): (DVec3, f32),
    ) -> Result<Medium, PathtraceError> {
        if let Some(i) = field.values.iter().position(|v| !is_grey(*v)) {
            let found = field.values[i].to_array();
            let rule = format!("extinction of voxel {i} is {found:?}; a grid of extinction must be grey");
            return Err(invalid(format!("medium {index}"), rule));
        }
        let volume = Volume {
            size: field.size,
            density: field.values.iter().map(|v| v.x).collect(),
            scale,
            albedo: Vec3f::splat(1.0),
            albedos: Vec::new(),
            g: 0.0,
            emission: None,
            transform: field.transform,
        };
        Medium::new(index, volume, origin, factor)
    }

    /// Takes the render frame at an origin.
    pub(crate) fn see_from(&mut self, origin: DVec3) {
        self.albedo.see_from(origin);
        self.emission.iter_mut().for_each(|e| e.see_from(origin));
        if let Extinction::Grid(grid) = &mut self.extinction {
            grid.see_from(origin);
        }
    }

    /// Albedo at a point of the render frame.
    #[inline]
    pub(crate) fn albedo(&self, p: Vec3f) -> Vec3f {
        self.albedo.at(p)
    }

    /// Follows light of a throughput along a segment up to a collision. The numbers are for closed forms, the generator for
    /// grids.
    pub(crate) fn fly(&self, along: &Segment, throughput: Vec3f, numbers: [f32; 2], rng: &mut Rng) -> Flight {
        match &self.extinction {
            Extinction::Even { sigma, .. } => fly_evenly(*sigma, along.length, throughput, numbers),
            Extinction::Grid(grid) => {
                let found = grid.collide(along.origin, along.direction, along.length, rng);
                Flight { collision: found.map(|f| f.0), weight: Vec3f::splat(1.0) }
            }
        }
    }

    /// Whether its extinction is the same everywhere.
    pub(crate) fn is_even(&self) -> bool {
        matches!(self.extinction, Extinction::Even { .. })
    }

    /// In an even medium, a distance along a ray with a density proportional to transmittance, of colours by their share of the
    /// throughput, with the transmittance over the density. `None` where no colour has a finite way.
    pub(crate) fn distance(
        &self,
        [from, to]: [f32; 2],
        throughput: Vec3f,
        u: f32,
        rng: &mut Rng,
    ) -> Option<(f32, Vec3f)> {
        let Extinction::Even { sigma, .. } = &self.extinction else { return None };
        let sample = sample_evenly(*sigma, to - from, throughput, [rng.next_f32(), u])?;
        Some((from + sample.t, sample.weight.mul(sigma.map(|s| survival(s, from)))))
    }

    /// Weight of light at a distance that a flight of this throughput ([`Self::fly`]) came to.
    pub(crate) fn share_at(&self, t: f32, throughput: Vec3f) -> Vec3f {
        match &self.extinction {
            Extinction::Even { sigma, .. } if !is_grey(*sigma) => {
                balanced(sigma.map(|s| survival(s, t)), throughput * (1.0 / throughput.sum()))
            }
            _ => Vec3f::splat(1.0),
        }
    }

    /// Transmittance of a segment, per channel: exact, or an unbiased estimate for grids.
    pub(crate) fn transmittance(&self, along: &Segment, rng: &mut Rng) -> Vec3f {
        match &self.extinction {
            Extinction::Even { sigma, .. } => sigma.map(|s| survival(s, along.length)),
            Extinction::Grid(grid) => {
                Vec3f::splat(grid.transmittance(along.origin, along.direction, along.length, rng))
            }
        }
    }
}

/// `exp(-sigma t)`, 1 without extinction however far.
#[inline(always)]
pub(super) fn survival(sigma: f32, t: f32) -> f32 {
    if sigma == 0.0 { 1.0 } else { (-sigma * t).exp() }
}

/// A flight through a homogeneous medium.
fn fly_evenly(sigma: Vec3f, length: f32, throughput: Vec3f, [choice, u]: [f32; 2]) -> Flight {
    let total = throughput.x + throughput.y + throughput.z;
    let share = throughput * (1.0 / total);
    let drawn = of_chosen(sigma, share, choice);
    let t = -(1.0 - u).ln() / drawn;
    let collides = t < length;
    if is_grey(sigma) {
        return Flight { collision: collides.then_some(t), weight: Vec3f::splat(1.0) };
    }
    let distance = if collides { t } else { length };
    let mut value = sigma.map(|s| survival(s, distance));
    if collides {
        value = value.mul(sigma);
    }
    let weight = balanced(value, share);
    // Rounding may choose a colour that carries nothing.
    let lives = weight != Vec3f::zero();
    Flight { collision: (collides && lives).then_some(t), weight }
}

/// The value of the colour that `choice` falls on, in `[0, 1)` times the sum of the shares.
#[inline(always)]
pub(super) fn of_chosen(values: Vec3f, share: Vec3f, choice: f32) -> f32 {
    if choice < share.x {
        values.x
    } else if choice < share.x + share.y {
        values.y
    } else {
        values.z
    }
}

#[inline(always)]
fn is_grey(v: Vec3f) -> bool {
    v.x == v.y && v.y == v.z
}

/// What each channel has over what all have together, by their shares; 0 where that is nothing.
#[inline(always)]
fn balanced(value: Vec3f, share: Vec3f) -> Vec3f {
    let weight = value * (1.0 / value.dot(share));
    if weight.is_finite() { weight } else { Vec3f::zero() }
}
