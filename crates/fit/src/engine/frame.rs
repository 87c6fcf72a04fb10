//! The coordinate frame of a fit.

use glam::{Affine3A, DAffine3, Vec3};
use photofit_geometry::Mesh;
use photofit_scalar::Vec3f;

/// The coordinate frame of a fit: a sphere of the world becomes the unit sphere about the origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitFrame {
    /// Centre of the sphere, in the world.
    pub center: Vec3f,
    /// Its radius, in units of the world: the unit of length of the frame.
    pub radius: f32,
}

impl FitFrame {
    /// The world itself.
    pub const WORLD: Self = Self { center: Vec3f { x: 0.0, y: 0.0, z: 0.0 }, radius: 1.0 };

    /// The frame about the centre of the box around the used vertices of all meshes, whose unit is the largest distance from
    /// it; `None` for meshes without extent.
    pub(crate) fn around<'a>(meshes: &[&'a Mesh]) -> Option<Self> {
        let of = |m: &'a Mesh| m.triangles.iter().flatten().map(|i| m.positions[*i as usize]);
        let used = || meshes.iter().copied().flat_map(of);
        let first = used().next()?;
        let (lo, hi) = used().fold((first, first), |(lo, hi), p| (lo.min(p), hi.max(p)));
        let center = (lo + hi) * 0.5;
        let radius = used().map(|p| (p - center).length()).fold(0.0, f32::max);
        (radius > 0.0 && radius.is_finite()).then_some(Self { center, radius })
    }

    /// A point of the world, in the frame.
    pub fn to_frame(self, p: Vec3f) -> Vec3f {
        (p - self.center) / self.radius
    }

    /// A point of the frame, in the world.
    pub fn to_world(self, p: Vec3f) -> Vec3f {
        p * self.radius + self.center
    }

    /// The map from the world to the frame.
    pub(crate) fn transform(self) -> DAffine3 {
        let center = Vec3::from_array(self.center.to_array());
        let m = Affine3A::from_scale(Vec3::splat(1.0 / self.radius)) * Affine3A::from_translation(-center);
        DAffine3 { matrix3: m.matrix3.as_dmat3(), translation: m.translation.as_dvec3() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_scalar::vec3;

    #[test]
    fn points_go_to_the_frame_and_back() {
        let frame = FitFrame { center: vec3(3.0, -1.0, 0.5), radius: 4.0 };
        assert_eq!(frame.to_frame(vec3(7.0, -1.0, 0.5)), vec3(1.0, 0.0, 0.0));
        assert_eq!(frame.to_world(vec3(0.0, 0.5, 0.0)), vec3(3.0, 1.0, 0.5));
        let there = frame.transform().transform_point3(glam::dvec3(3.0, 3.0, 0.5));
        assert!(there.abs_diff_eq(glam::DVec3::Y, 1e-6), "{there}");
        let p = vec3(0.1, -7.0, 3e-9);
        assert_eq!((FitFrame::WORLD.to_frame(p), FitFrame::WORLD.to_world(p)), (p, p));
    }

    #[test]
    fn a_frame_holds_what_is_used_of_its_meshes() {
        let triangle = |x: f32| Mesh {
            positions: vec![
                vec3(x, 0.0, 0.0),
                vec3(x + 2.0, 0.0, 0.0),
                vec3(x, 0.0, 0.0),
                vec3(99.0, 0.0, 0.0),
            ],
            triangles: vec![[0, 1, 2]],
            ..Mesh::default()
        };
        let (a, b) = (triangle(0.0), triangle(4.0));
        let frame = FitFrame::around(&[&a, &b]).unwrap();
        assert_eq!(frame, FitFrame { center: vec3(3.0, 0.0, 0.0), radius: 3.0 });
        assert_eq!(FitFrame::around(&[&Mesh::default()]), None);
    }
}
