//! Colours in space.

use super::Segment;
use super::grid::{MAX_VOXELS, taps};
use super::track::clip;
use crate::world::to_glam;
use glam::{Affine3A, DAffine3, DVec3};
use photofit_scalar::{Vec3f, vec3};

/// Numbers in space, three channels: the same everywhere, or on a grid over a box.
///
/// Values of a grid sit at the centres of voxels and are interpolated linearly.
#[derive(Clone, Debug)]
pub struct Field {
    /// Voxels along x, y and z; 1 x 1 x 1 where nothing varies.
    pub size: [usize; 3],
    /// Value of every voxel, x fastest.
    pub values: Vec<Vec3f>,
    /// The unit cube, over which the grid lies, to the world.
    pub transform: DAffine3,
}

impl Field {
    /// The same value everywhere.
    pub fn constant(value: Vec3f) -> Self {
        Self { size: [1; 3], values: vec![value], transform: DAffine3::IDENTITY }
    }

    /// The value, where it does not vary.
    pub(super) fn single(&self) -> Option<Vec3f> {
        match self.values[..] {
            [value] => Some(value),
            _ => None,
        }
    }

    /// What is wrong with it, if anything; `rule` must hold for every number, in words and as a function.
    pub(super) fn fault(&self, name: &str, rule: (&str, impl Fn(f32) -> bool)) -> Option<String> {
        let [nx, ny, nz] = self.size;
        let voxels = nx.checked_mul(ny).and_then(|n| n.checked_mul(nz)).filter(|n| *n <= MAX_VOXELS);
        let found = self.values.len();
        if voxels.is_none_or(|n| n == 0 || n != found) {
            return Some(format!(
                "{name} has {found} values for {nx} x {ny} x {nz} voxels; there must be one for each of 1 to {MAX_VOXELS}"
            ));
        }
        if let Some(i) = self.values.iter().position(|v| !v.to_array().into_iter().all(&rule.1)) {
            let (at, value) = ((i % nx, i / nx % ny, i / nx / ny), self.values[i].to_array());
            return Some(format!("{name} of voxel {at:?} is {value:?}; it must be {}", rule.0));
        }
        let t = &self.transform;
        if !(t.is_finite() && t.inverse().is_finite() && t.matrix3.determinant() != 0.0) {
            return Some(format!(
                "the transform of {name} flattens space or has a number that is not finite; it must be finite and keep three dimensions"
            ));
        }
        None
    }
}

/// A field ready to be looked up; beyond the box of a grid the value at its border goes on.
#[derive(Debug)]
pub(crate) struct Lookup {
    size: [usize; 3],
    values: Vec<Vec3f>,
    /// The unit cube to the world.
    transform: DAffine3,
    /// Render frame to the unit cube.
    inward: Affine3A,
}

impl Lookup {
    pub(super) fn new(field: Field, origin: DVec3) -> Self {
        let Field { size, values, transform } = field;
        let mut out = Self { size, values, transform, inward: Affine3A::IDENTITY };
        out.see_from(origin);
        out
    }

    /// Takes the render frame at an origin.
    pub(super) fn see_from(&mut self, origin: DVec3) {
        let transform = DAffine3::from_translation(-origin) * self.transform;
        self.inward = crate::world::affine(&transform.inverse());
    }

    /// The values, x fastest.
    pub(super) fn values(&self) -> &[Vec3f] {
        &self.values
    }

    /// Replaces the values.
    ///
    /// # Panics
    /// If their number is another one.
    pub(super) fn set_values(&mut self, values: &[Vec3f]) {
        self.values.copy_from_slice(values);
    }

    /// Adjoint of [`Self::at`] with respect to the values, for its gradient `g`: `add` gets voxels and gradients.
    #[inline]
    pub(super) fn vjp(&self, p: Vec3f, g: Vec3f, mut add: impl FnMut(usize, Vec3f)) {
        if self.values.len() == 1 {
            return add(0, g);
        }
        let q = self.inward.transform_point3a(to_glam(p));
        let (at, weight) = taps(self.size, vec3(q.x, q.y, q.z));
        (0..8).filter(|i| weight[*i] != 0.0).for_each(|i| add(at[i], g * weight[i]));
    }

    /// Distances along a ray between which it is in the box of a grid; the whole ray where nothing varies.
    pub(super) fn span(&self, ray: &Segment) -> Option<[f32; 2]> {
        if self.values.len() == 1 {
            return Some([0.0, ray.length]);
        }
        clip(&self.inward, ray.origin, ray.direction, ray.length).map(|part| [part.from, part.to])
    }

    /// The value at a point of the render frame.
    #[inline]
    pub(crate) fn at(&self, p: Vec3f) -> Vec3f {
        if let [constant] = self.values[..] {
            return constant;
        }
        let q = self.inward.transform_point3a(to_glam(p));
        let (at, weight) = taps(self.size, vec3(q.x, q.y, q.z));
        (0..8).fold(Vec3f::zero(), |sum, i| sum + self.values[at[i]] * weight[i])
    }
}
