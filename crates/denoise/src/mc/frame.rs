//! A noisy picture with its guides, as planes.

use super::RUN;
use super::pipeline::LEFT_OUT;
use super::plan::Plan;
use super::stage::{Stage, Stages};
use crate::{DenoiseError, Shape};
use rayon::prelude::{IndexedParallelIterator, IntoParallelRefIterator, ParallelIterator, ParallelSlice};
use std::borrow::Cow;

/// Noise-free (or nearly so) first-hit features of each pixel. All are optional; what is there is used.
#[derive(Clone, Copy, Debug, Default)]
pub struct Guides<'a> {
    /// Diffuse reflectance, 3 planes, linear.
    pub albedo: Option<&'a [f32]>,
    /// Unit normals, 3 planes, any frame; 0 where the ray meets nothing.
    pub normal: Option<&'a [f32]>,
    /// Distance from the camera, 1 plane; 0 (or more than 1e9) where the ray meets nothing.
    pub depth: Option<&'a [f32]>,
    /// World position, 3 planes; 0 where the ray meets nothing.
    pub position: Option<&'a [f32]>,
}

/// One noisy picture: linear radiance of `shape.channels == 3` planes, pixels with a NaN or infinity are holes.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// Width, height and 3 channels.
    pub shape: Shape,
    /// Radiance. With [`Self::half`]: of the first half of the samples.
    pub color: &'a [f32],
    /// Radiance of the second half of the samples (as many as the first): the noise is then known and the strength
    /// of a model is chosen by cross-validation.
    pub half: Option<&'a [f32]>,
    /// Variance of [`Self::color`] (of the mean, not of a sample), 3 planes.
    pub variance: Option<&'a [f32]>,
    /// Features.
    pub guides: Guides<'a>,
}

impl<'a> Frame<'a> {
    /// A picture of `width x height` without guides.
    pub fn new(width: usize, height: usize, color: &'a [f32]) -> Self {
        let shape = Shape::new(width, height, 3);
        Self { shape, color, half: None, variance: None, guides: Guides::default() }
    }

    /// With features.
    #[must_use]
    pub fn with_guides(mut self, guides: Guides<'a>) -> Self {
        self.guides = guides;
        self
    }

    /// Checks the lengths of all planes.
    ///
    /// # Errors
    /// The first plane with a wrong length, or a size without pixels.
    pub fn check(&self) -> Result<(), DenoiseError> {
        let shape = self.shape;
        shape.check()?;
        DenoiseError::setting("the number of channels", shape.channels as f64, "3", shape.channels == 3)?;
        DenoiseError::length("the colour", self.color.len(), shape.len(), shape)?;
        let g = &self.guides;
        for (name, plane, channels) in [
            ("the second half", self.half, 3),
            ("the variance", self.variance, 3),
            ("the albedo", g.albedo, 3),
            ("the normal", g.normal, 3),
            ("the depth", g.depth, 1),
            ("the position", g.position, 3),
        ] {
            if let Some(plane) = plane {
                DenoiseError::length(name, plane.len(), channels * shape.pixels(), shape)?;
            }
        }
        Ok(())
    }
}

/// The guides without values that are not finite; copied only where there are such values.
#[derive(Clone, Debug, Default)]
pub(crate) struct Features<'a> {
    pub(crate) albedo: Option<Cow<'a, [f32]>>,
    pub(crate) normal: Option<Cow<'a, [f32]>>,
    pub(crate) depth: Option<Cow<'a, [f32]>>,
    pub(crate) position: Option<Cow<'a, [f32]>>,
}

/// What a look at the planes of a guide tells.
#[derive(Clone, Copy)]
struct Seen {
    /// Values that are not finite.
    bad: usize,
    /// Whether some plane is not constant.
    varies: bool,
    /// Whether no value is larger than the most, or not a number.
    within: bool,
}

fn seen(planes: &[f32], pixels: usize, most: f32) -> Seen {
    let one = |run: &[f32], first: f32| {
        let mut seen = Seen { bad: 0, varies: false, within: true };
        for v in run {
            seen.bad += usize::from(!v.is_finite());
            seen.varies |= *v != first;
            seen.within &= v.abs() <= most;
        }
        seen
    };
    let of_plane = |plane: &[f32]| plane.par_chunks(RUN).map(|run| one(run, plane[0])).reduce(NOTHING, both);
    planes.chunks(pixels).map(of_plane).fold(NOTHING(), both)
}

/// Before anything is looked at.
const NOTHING: fn() -> Seen = || Seen { bad: 0, varies: false, within: true };

fn both(a: Seen, b: Seen) -> Seen {
    Seen { bad: a.bad + b.bad, varies: a.varies || b.varies, within: a.within && b.within }
}

/// Depths beyond count as nothing hit: renderers write 1e10 and the like.
const FARTHEST: f32 = 1e9;

impl<'a> Features<'a> {
    /// Takes what is there, is not left out, and is not constant.
    pub(crate) fn of(guides: &Guides<'a>, without: Stages, pixels: usize, plan: &mut Plan) -> Self {
        let mut take = |name: &'static str, stage: Stage, plane: Option<&'a [f32]>, most: f32| {
            let Some(plane) = plane else {
                plan.skip(name, "not given");
                return None;
            };
            if without.has(stage) {
                plan.skip(name, LEFT_OUT);
                return None;
            }
            let Seen { bad, varies, within } = seen(plane, pixels, most);
            if !varies {
                plan.skip(name, "constant");
                return None;
            }
            match bad {
                0 => plan.run(name, "guide"),
                _ => plan.run(name, format!("guide; {bad} values that are not finite became 0")),
            }
            if within {
                return Some(Cow::Borrowed(plane));
            }
            let good = |v: &f32| if v.abs() <= most { *v } else { 0.0 };
            Some(plane.par_iter().with_min_len(RUN).map(good).collect::<Vec<f32>>().into())
        };
        Self {
            albedo: take("albedo", Stage::Albedo, guides.albedo, f32::MAX),
            normal: take("normal", Stage::Normal, guides.normal, f32::MAX),
            depth: take("depth", Stage::Position, guides.depth, FARTHEST),
            position: take("position", Stage::Position, guides.position, f32::MAX),
        }
    }

    /// Whether there is a guide beside the albedo.
    pub(crate) fn has_edges(&self) -> bool {
        [&self.normal, &self.depth, &self.position].iter().any(|f| f.is_some())
    }

    /// The same without copies.
    pub(crate) fn borrowed(&self) -> Features<'_> {
        fn of<'b>(plane: &'b Option<Cow<'_, [f32]>>) -> Option<Cow<'b, [f32]>> {
            plane.as_deref().map(Cow::Borrowed)
        }
        Features {
            albedo: of(&self.albedo),
            normal: of(&self.normal),
            depth: of(&self.depth),
            position: of(&self.position),
        }
    }

    /// Own copies.
    pub(crate) fn into_owned(self) -> Features<'static> {
        let of = |plane: Option<Cow<'a, [f32]>>| plane.map(|p| Cow::Owned(p.into_owned()));
        Features {
            albedo: of(self.albedo),
            normal: of(self.normal),
            depth: of(self.depth),
            position: of(self.position),
        }
    }
}
