//! Values of media that pictures depend on: read, replaced in place, and counted.

use super::bounded::Extinction;
use super::grid::is_share;
use super::{InteriorMedium, Media};
use crate::PathtraceError;
use crate::error::{absent, invalid};
use photofit_scalar::{Vec3f, vec3};

/// A medium of a world.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MediumRef {
    /// One in a box of its own: an index into [`crate::Parts::volumes`].
    Volume(usize),
    /// One that surfaces bound: an index into [`crate::Parts::media`].
    Bounded(usize),
}

impl MediumRef {
    /// What errors call it.
    pub(super) fn name(self) -> String {
        match self {
            Self::Volume(i) => format!("volume {i}"),
            Self::Bounded(i) => format!("medium {i}"),
        }
    }
}

/// A value of a medium.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MediumValue {
    /// [`crate::Volume::density`] (one channel), or [`crate::BoundedMedium::extinction`] before its scale: three channels
    /// where it is the same everywhere, one on a grid.
    Extinction,
    /// [`crate::Volume::albedos`], without those [`crate::Volume::albedo`]; or [`crate::BoundedMedium::albedo`]. Three
    /// channels.
    Albedo,
    /// [`crate::Volume::emission`] or [`crate::BoundedMedium::emission`], which must be there. Three channels.
    Emission,
}

impl Media {
    /// How many there are of the kind of `medium`.
    fn count(&self, medium: MediumRef) -> usize {
        match medium {
            MediumRef::Volume(_) => self.boxes.len(),
            MediumRef::Bounded(_) => self.bounded.len(),
        }
    }

    /// Number of values and of their channels, or the rule that the reference breaks.
    pub(crate) fn size(&self, medium: MediumRef, value: MediumValue) -> Result<(usize, usize), String> {
        let (MediumRef::Volume(index) | MediumRef::Bounded(index)) = medium;
        let count = self.count(medium);
        if index >= count {
            return Err(absent(medium.name(), count));
        }
        Ok(match (medium, value) {
            (_, MediumValue::Emission) => match self.emissions(medium).len() {
                0 => return Err("has no emission; it must have one, if only of zeros".into()),
                count => (count, 3),
            },
            (MediumRef::Volume(i), MediumValue::Extinction) => (self.boxes[i].density().len(), 1),
            (MediumRef::Volume(i), MediumValue::Albedo) => (self.boxes[i].albedos().len(), 3),
            (MediumRef::Bounded(i), MediumValue::Extinction) => match &self.bounded[i].extinction {
                Extinction::Even { .. } => (1, 3),
                Extinction::Grid(grid) => (grid.density().len(), 1),
            },
            (MediumRef::Bounded(i), MediumValue::Albedo) => (self.bounded[i].albedo.values().len(), 3),
        })
    }

    /// The values, channel by channel.
    ///
    /// # Panics
    /// If there is no such medium.
    pub(crate) fn values(&self, medium: MediumRef, value: MediumValue) -> Vec<f32> {
        let colors = |values: &[Vec3f]| values.iter().flat_map(|v| v.to_array()).collect();
        match (medium, value) {
            (_, MediumValue::Emission) => colors(self.emissions(medium)),
            (MediumRef::Volume(i), MediumValue::Extinction) => self.boxes[i].density().to_vec(),
            (MediumRef::Volume(i), MediumValue::Albedo) => colors(self.boxes[i].albedos()),
            (MediumRef::Bounded(i), MediumValue::Extinction) => match &self.bounded[i].extinction {
                Extinction::Even { given, .. } => given.to_array().to_vec(),
                Extinction::Grid(grid) => grid.density().to_vec(),
            },
            (MediumRef::Bounded(i), MediumValue::Albedo) => colors(self.bounded[i].albedo.values()),
        }
    }

    /// Length across a medium; `size` where it has no box of its own.
    ///
    /// # Panics
    /// If there is no such medium.
    pub(crate) fn length(&self, medium: MediumRef, size: f32) -> f32 {
        match medium {
            MediumRef::Volume(i) => self.boxes[i].extent(),
            MediumRef::Bounded(i) => match &self.bounded[i].extinction {
                Extinction::Even { .. } => size,
                Extinction::Grid(grid) => grid.extent().min(size),
            },
        }
    }

    /// The value of an extinction at which a ray across the whole medium has optical thickness 1; across `size` where the
    /// medium has no box of its own. 1 where nothing can have that.
    ///
    /// # Panics
    /// If there is no such medium.
    pub(crate) fn unit_extinction(&self, medium: MediumRef, size: f32) -> f32 {
        let scale = match medium {
            MediumRef::Volume(i) => self.boxes[i].scale(),
            MediumRef::Bounded(i) => self.bounded[i].scale,
        };
        let value = 1.0 / (scale * self.length(medium, size));
        if value.is_finite() && value > 0.0 { value } else { 1.0 }
    }

    /// The value of [`MediumValue::Extinction`] beyond which nothing changes: infinite where it is the same everywhere, or nothing.
    pub(crate) fn thickest(&self, medium: MediumRef) -> f32 {
        let grid = match medium {
            MediumRef::Volume(i) => self.boxes.get(i),
            MediumRef::Bounded(i) => match self.bounded.get(i).map(|b| &b.extinction) {
                Some(Extinction::Grid(grid)) => Some(&**grid),
                _ => None,
            },
        };
        grid.map_or(f32::INFINITY, |g| g.thickest() / g.scale())
    }

    /// Replaces the values, as many as [`Self::values`] gives; upper bounds for tracking follow, looser by `factor`.
    ///
    /// # Errors
    /// If one is not valid; everything is then as it was.
    ///
    /// # Panics
    /// If there is no such medium.
    pub(crate) fn set_values(
        &mut self,
        (medium, value): (MediumRef, MediumValue),
        values: &[f32],
        factor: f32,
    ) -> Result<(), PathtraceError> {
        let colors = || -> Vec<Vec3f> { values.chunks_exact(3).map(|v| vec3(v[0], v[1], v[2])).collect() };
        match (medium, value) {
            (_, MediumValue::Emission) => self.set_emissions(medium, &colors()),
            (MediumRef::Volume(i), MediumValue::Extinction) => self.boxes[i].set_density(i, values, factor),
            (MediumRef::Volume(i), MediumValue::Albedo) => self.boxes[i].set_albedos(i, &colors()),
            (MediumRef::Bounded(i), MediumValue::Extinction) => {
                self.bounded[i].set_extinction(i, values, factor)
            }
            (MediumRef::Bounded(i), MediumValue::Albedo) => self.bounded[i].set_albedos(i, &colors()),
        }
    }
}

impl InteriorMedium {
    fn set_extinction(&mut self, index: usize, values: &[f32], factor: f32) -> Result<(), PathtraceError> {
        match &mut self.extinction {
            Extinction::Grid(grid) => grid.set_density(index, values, factor),
            Extinction::Even { sigma, given } => {
                let new = vec3(values[0], values[1], values[2]);
                let scaled = new * self.scale;
                if !(scaled.is_finite() && values.iter().all(|v| *v >= 0.0)) {
                    let found = new.to_array();
                    let rule = format!("extinction is {found:?}; it must be finite and not negative");
                    return Err(invalid(format!("medium {index}"), rule));
                }
                (*sigma, *given) = (scaled, new);
                Ok(())
            }
        }
    }

    fn set_albedos(&mut self, index: usize, albedos: &[Vec3f]) -> Result<(), PathtraceError> {
        if let Some(i) = albedos.iter().position(|a| !is_share(a)) {
            let found = albedos[i].to_array();
            let rule = format!("albedo of voxel {i} is {found:?}; it must lie in [0, 1]");
            return Err(invalid(format!("medium {index}"), rule));
        }
        self.albedo.set_values(albedos);
        self.absorbs_only = albedos.iter().all(|a| *a == Vec3f::zero());
        Ok(())
    }
}
