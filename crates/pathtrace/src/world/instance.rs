//! Placed shapes: transforms between a shape's frame and the frame in which light is carried.

use super::material::CompiledMaterial;
use super::shape::{Kind, Stored};
use crate::PathtraceError;
use crate::error::invalid;
use glam::{Affine3A, DAffine3, DMat3, DVec3, Mat3A, Vec3, Vec3A};
use photofit_scalar::{Vec3f, vec3};

/// Smallest and largest size of a placed shape, and largest distance from the centre of the world, in units.
pub(crate) const SIZE_MIN: f64 = 1e-10;
pub(crate) const SIZE_MAX: f64 = 1e10;

/// What is wrong with a transform that has infinite numbers.
pub(crate) const NOT_FINITE: &str = "its transform has a number that is not finite; all must be";

/// A shape in its place, in the render frame.
#[derive(Clone, Debug)]
pub(crate) struct Placed {
    /// Index of the shape.
    pub(crate) shape: u32,
    /// Index of the material.
    pub(crate) material: u32,
    /// The shape's own centred frame to the render frame.
    pub(crate) to_render: Affine3A,
    /// Takes normals to the render frame, up to a positive factor.
    pub(crate) normals: Mat3A,
    /// `normals` keeps lengths.
    pub(crate) rigid: bool,
    /// The transform turns handedness around.
    pub(crate) mirrored: bool,
    /// The shape may let rays pass.
    pub(crate) alpha: bool,
    /// Its material has to be looked up.
    pub(crate) varies: bool,
    /// Largest factor by which lengths grow.
    pub(crate) stretch: f32,
    /// Index of the first of its emitters, or [`Placed::DARK`].
    pub(crate) emitter: u32,
}

impl Placed {
    /// The value of `emitter` for shapes that give no light.
    pub(crate) const DARK: u32 = u32::MAX;

    /// A shape that is centred at `center` in its own frame, under `transform`, seen from `origin`.
    pub(crate) fn new(
        index: usize,
        (shape, material): (usize, usize),
        transform: &DAffine3,
        center: DVec3,
        origin: DVec3,
    ) -> Result<Self, PathtraceError> {
        let place = || format!("instance {index}");
        if !transform.is_finite() {
            return Err(invalid(place(), NOT_FINITE));
        }
        let m = transform.matrix3;
        // In proportion to the longest axis, so that small shapes are no flat ones.
        let longest = m.x_axis.length().max(m.y_axis.length()).max(m.z_axis.length());
        let volume = m.determinant() / (longest * longest * longest);
        if !(volume.abs() > 1e-12 && longest > 0.0) {
            return Err(invalid(
                place(),
                "its transform flattens space, an axis is scaled by 0 or axes coincide; it must keep three dimensions",
            ));
        }
        let to_render = DAffine3 { matrix3: m, translation: transform.transform_point3(center) - origin };
        let unit = m * (1.0 / longest);
        let sign = volume.signum();
        let cofactors = DMat3::from_cols(
            unit.y_axis.cross(unit.z_axis) * sign,
            unit.z_axis.cross(unit.x_axis) * sign,
            unit.x_axis.cross(unit.y_axis) * sign,
        );
        // The Frobenius norm bounds the largest singular value.
        let stretch =
            (m.x_axis.length_squared() + m.y_axis.length_squared() + m.z_axis.length_squared()).sqrt();
        Ok(Self {
            shape: shape as u32,
            material: material as u32,
            to_render: affine(&to_render),
            normals: Mat3A::from_cols_array(&cofactors.to_cols_array().map(|x| x as f32)),
            rigid: (unit.transpose() * unit).abs_diff_eq(DMat3::IDENTITY, 1e-7),
            mirrored: volume < 0.0,
            alpha: false,
            varies: false,
            stretch: stretch as f32,
            emitter: Self::DARK,
        })
    }

    /// Takes up what instances know of their material and of the colours of their shape.
    pub(super) fn take_material(&mut self, material: &CompiledMaterial, shape: &Stored) {
        let colored = matches!(&shape.kind, Kind::Mesh(m) if !m.colors.is_empty());
        self.alpha = material.alpha;
        self.varies = material.varies || (material.library.is_some() && colored);
    }

    /// A point of the shape's centred frame in the render frame.
    #[inline(always)]
    pub(crate) fn point(&self, p: Vec3f) -> Vec3f {
        from_glam(self.to_render.transform_point3a(to_glam(p)))
    }

    /// A vector (an edge, a tangent).
    #[inline(always)]
    pub(crate) fn vector(&self, v: Vec3f) -> Vec3f {
        from_glam(self.to_render.transform_vector3a(to_glam(v)))
    }

    /// A normal, not normalised.
    #[inline(always)]
    pub(crate) fn normal(&self, n: Vec3f) -> Vec3f {
        from_glam(self.normals * to_glam(n))
    }
}

/// How rays of the render frame reach a structure's own frame.
#[derive(Clone, Debug)]
pub(crate) struct Inward {
    /// Points, in double precision: what is subtracted is large.
    matrix: DMat3,
    translation: DVec3,
    /// Directions.
    directions: Mat3A,
}

impl Inward {
    /// From the transform of points.
    pub(crate) fn new(points: &DAffine3) -> Self {
        Self {
            matrix: points.matrix3,
            translation: points.translation,
            directions: Mat3A::from_cols_array(&points.matrix3.to_cols_array().map(|x| x as f32)),
        }
    }

    /// Origin and direction in the structure's frame.
    #[inline(always)]
    pub(crate) fn ray(&self, origin: Vec3f, direction: Vec3f) -> (Vec3, Vec3) {
        let o = self.matrix * dvec3(origin) + self.translation;
        (o.as_vec3(), (self.directions * to_glam(direction)).into())
    }

    /// The same in double precision.
    #[inline(always)]
    pub(crate) fn ray_f64(&self, origin: Vec3f, direction: Vec3f) -> (DVec3, DVec3) {
        (self.matrix * dvec3(origin) + self.translation, self.matrix * dvec3(direction))
    }
}

/// A transform in single precision.
pub(crate) fn affine(t: &DAffine3) -> Affine3A {
    Affine3A::from_cols_array(&t.to_cols_array().map(|x| x as f32))
}

#[inline(always)]
pub(crate) fn dvec3(v: Vec3f) -> DVec3 {
    DVec3::new(f64::from(v.x), f64::from(v.y), f64::from(v.z))
}

#[inline(always)]
pub(crate) fn to_glam(v: Vec3f) -> Vec3A {
    Vec3A::new(v.x, v.y, v.z)
}

#[inline(always)]
pub(crate) fn from_glam(v: Vec3A) -> Vec3f {
    vec3(v.x, v.y, v.z)
}
