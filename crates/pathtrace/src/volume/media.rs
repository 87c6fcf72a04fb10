//! All media of a world, and the surfaces between them.

use super::{BoundedMedium, InteriorMedium, Medium, Volume};
use crate::PathtraceError;
use crate::error::{absent, invalid};
use glam::DVec3;

/// A placed shape that separates media: who crosses it, is in the medium of the side that is reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Boundary {
    /// Index of the placed shape, into [`crate::Parts::instances`].
    pub instance: usize,
    /// Medium behind the surface, an index into [`crate::Parts::media`]; `None`: empty space.
    pub interior: Option<usize>,
    /// Medium in front of it.
    pub exterior: Option<usize>,
}

/// Behind and in front of a surface.
type Sides = [Option<u32>; 2];

/// All media of a world.
#[derive(Debug, Default)]
pub(crate) struct Media {
    /// Media in boxes of their own.
    pub(crate) boxes: Vec<Medium>,
    /// Media that surfaces bound.
    pub(crate) bounded: Vec<InteriorMedium>,
    /// By instance; empty without bounded media.
    sides: Vec<Option<Sides>>,
    /// The medium that cameras are in.
    pub(crate) around_camera: Option<u32>,
}

impl Media {
    pub(crate) fn boxes(volumes: Vec<Volume>, origin: DVec3, factor: f32) -> Result<Self, PathtraceError> {
        let boxes = volumes.into_iter().enumerate().map(|(i, v)| Medium::new(i, v, origin, factor));
        Ok(Self { boxes: boxes.collect::<Result<_, _>>()?, ..Self::default() })
    }

    /// Adds media that surfaces bound; `has_holes` says of an instance whether rays pass parts of it.
    pub(crate) fn with_bounded(
        mut self,
        media: Vec<BoundedMedium>,
        boundaries: &[Boundary],
        camera: Option<usize>,
        has_holes: &[bool],
        (origin, factor): (DVec3, f32),
    ) -> Result<Self, PathtraceError> {
        let bounded = media.into_iter().enumerate().map(|(i, m)| InteriorMedium::new(i, m, origin, factor));
        self.bounded = bounded.collect::<Result<_, _>>()?;
        let count = self.bounded.len();
        let known = |place: &dyn Fn() -> String, medium: Option<usize>| match medium {
            Some(m) if m >= count => Err(invalid(place(), absent(format!("medium {m}"), count))),
            other => Ok(other.map(|m| m as u32)),
        };
        self.around_camera = known(&|| "camera".into(), camera)?;
        if boundaries.is_empty() {
            return Ok(self);
        }
        self.sides = vec![None; has_holes.len()];
        for (i, b) in boundaries.iter().enumerate() {
            let place = || format!("boundary {i}");
            let Some(side) = self.sides.get_mut(b.instance) else {
                let rule = absent(format!("instance {}", b.instance), has_holes.len());
                return Err(invalid(place(), rule));
            };
            if has_holes[b.instance] {
                let place = format!("instance {}", b.instance);
                return Err(invalid(
                    place,
                    "it has cut-outs and bounds a medium; surfaces that bound media must be whole",
                ));
            }
            *side = Some([known(&place, b.interior)?, known(&place, b.exterior)?]);
        }
        Ok(self)
    }

    /// The instances that a medium fills.
    pub(crate) fn filled_by(&self, medium: usize) -> impl Iterator<Item = usize> {
        let fills = move |s: &Option<Sides>| s.is_some_and(|s| s[0] == Some(medium as u32));
        (0..self.sides.len()).filter(move |i| fills(&self.sides[*i]))
    }

    /// Takes the render frame at an origin.
    pub(crate) fn see_from(&mut self, origin: DVec3) {
        self.boxes.iter_mut().for_each(|m| m.see_from(origin));
        self.bounded.iter_mut().for_each(|m| m.see_from(origin));
    }

    /// Whether an instance bounds a medium.
    pub(crate) fn bounds_medium(&self, instance: usize) -> bool {
        self.sides.get(instance).is_some_and(Option::is_some)
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.boxes.is_empty() && self.bounded.is_empty()
    }

    /// Whether surfaces bound media.
    #[inline(always)]
    pub(crate) fn is_bounded(&self) -> bool {
        !self.bounded.is_empty()
    }

    /// The box of all media with boxes in the render frame.
    pub(crate) fn bounds(&self) -> Option<[DVec3; 2]> {
        self.boxes.iter().map(|m| m.bounds).reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
    }

    /// The medium on a side of an instance, where the one around it is `current`.
    #[inline(always)]
    pub(crate) fn beside(&self, instance: u32, in_front: bool, current: Option<u32>) -> Option<u32> {
        match self.sides.get(instance as usize) {
            Some(Some(sides)) => sides[usize::from(in_front)],
            _ => current,
        }
    }

    /// A medium by its index.
    #[inline(always)]
    pub(crate) fn bounded(&self, index: Option<u32>) -> Option<&InteriorMedium> {
        index.map(|i| &self.bounded[i as usize])
    }
}
