//! Light that media emit.

use super::field::Lookup;
use super::{Derivatives, Media, MediumRef, Segment};
use crate::PathtraceError;
use crate::error::invalid;
use photofit_scalar::Vec3f;

/// A part of a ray along which a medium emits light.
pub(crate) struct EmittingPart<'a> {
    pub(crate) emission: &'a Lookup,
    /// Distances along the ray.
    pub(crate) from: f32,
    pub(crate) to: f32,
}

/// The rule that emission must keep.
pub(super) const RULE: (&str, fn(f32) -> bool) =
    ("finite and not negative", |x: f32| (0.0..=f32::MAX).contains(&x));

impl Media {
    /// The media that a ray may meet in the bounded medium `around`.
    #[inline(always)]
    pub(crate) fn along(&self, around: Option<u32>) -> impl Iterator<Item = MediumRef> + use<> {
        let boxes = (0..self.boxes.len()).map(MediumRef::Volume);
        boxes.chain(around.map(|i| MediumRef::Bounded(i as usize)))
    }

    /// The emission of a medium, if it has one.
    fn emission(&self, medium: MediumRef) -> Option<&Lookup> {
        match medium {
            MediumRef::Volume(i) => self.boxes[i].emission.as_ref(),
            MediumRef::Bounded(i) => self.bounded[i].emission.as_ref(),
        }
    }

    /// Whether a medium along a ray in the bounded medium `around` sends out light.
    #[inline]
    pub(crate) fn emits_along(&self, around: Option<u32>) -> bool {
        self.along(around).any(|m| self.emission(m).is_some())
    }

    /// Whether any medium emits light, if only as a value that may change.
    pub(crate) fn emits(&self) -> bool {
        let bounded = (0..self.bounded.len()).map(MediumRef::Bounded);
        self.along(None).chain(bounded).any(|m| self.emission(m).is_some())
    }

    /// Where on a ray a medium emits light.
    pub(crate) fn emitting_part(&self, medium: MediumRef, ray: &Segment) -> Option<EmittingPart<'_>> {
        let emission = self.emission(medium)?;
        let [mut from, mut to] = emission.span(ray)?;
        if let MediumRef::Volume(i) = medium {
            let own = self.boxes[i].clip(ray.origin, ray.direction, ray.length)?;
            (from, to) = (from.max(own.from), to.min(own.to));
        }
        (from < to).then_some(EmittingPart { emission, from, to })
    }

    /// The values of an emission; empty without one.
    pub(super) fn emissions(&self, medium: MediumRef) -> &[Vec3f] {
        self.emission(medium).map_or(&[], Lookup::values)
    }

    /// Replaces them; on an error everything is as it was.
    ///
    /// # Panics
    /// If their number is another one.
    pub(super) fn set_emissions(
        &mut self,
        medium: MediumRef,
        values: &[Vec3f],
    ) -> Result<(), PathtraceError> {
        if let Some(i) = values.iter().position(|v| !v.to_array().into_iter().all(RULE.1)) {
            let found = values[i].to_array();
            let rule = format!("emission of voxel {i} is {found:?}; it must be {}", RULE.0);
            return Err(invalid(medium.name(), rule));
        }
        let place = match medium {
            MediumRef::Volume(i) => &mut self.boxes[i].emission,
            MediumRef::Bounded(i) => &mut self.bounded[i].emission,
        };
        if let Some(emission) = place {
            emission.set_values(values);
        }
        Ok(())
    }
}

impl Derivatives<'_> {
    /// Adjoint of the emission at a point of the render frame with respect to its values, for its gradient `g`.
    pub(crate) fn emission_vjp(self, p: Vec3f, g: Vec3f, add: impl FnMut(usize, Vec3f)) {
        let emission = match self {
            Self::Volume(medium) => &medium.emission,
            Self::Bounded(medium) => &medium.emission,
        };
        if let Some(emission) = emission {
            emission.vjp(p, g, add);
        }
    }
}
