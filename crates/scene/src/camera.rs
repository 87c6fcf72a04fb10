//! The pinhole camera.

use glam::{Mat4, Vec3};

/// A perspective camera: looks down -z of its own frame, y up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Position of the eye in the world.
    pub eye: Vec3,
    /// World to camera frame (rigid).
    pub view: Mat4,
    /// Vertical field of view, radians.
    pub fov_y: f32,
    /// Width over height of a pixel grid with square pixels; else of the fields of view.
    pub aspect: f32,
    /// Where the optical axis meets the picture, off its centre: to the right in halves of its width, upwards in halves
    /// of its height.
    pub principal: [f32; 2],
    /// Distance of the near plane.
    pub near: f32,
    /// Distance of the far plane.
    pub far: f32,
}

impl Camera {
    /// A camera at `eye` that looks at `target`, with `up` towards the top of the picture.
    ///
    /// `up` parallel to the view direction is replaced by another axis.
    pub fn look_at(eye: Vec3, target: Vec3, up: Vec3, fov_y: f32, aspect: f32, near: f32, far: f32) -> Self {
        let back = (eye - target).try_normalize().unwrap_or(Vec3::Z);
        let right =
            up.cross(back).try_normalize().or_else(|| Vec3::Z.cross(back).try_normalize()).unwrap_or(Vec3::X);
        let true_up = back.cross(right);
        let view = Mat4::from_cols(
            glam::vec4(right.x, true_up.x, back.x, 0.0),
            glam::vec4(right.y, true_up.y, back.y, 0.0),
            glam::vec4(right.z, true_up.z, back.z, 0.0),
            glam::vec4(-right.dot(eye), -true_up.dot(eye), -back.dot(eye), 1.0),
        );
        Self { eye, view, fov_y, aspect, principal: [0.0; 2], near, far }
    }

    /// A camera on a sphere of `distance` around `center`, which it looks at.
    ///
    /// `azimuth` turns around +y from +z towards +x; `elevation` lifts towards +y; radians. `radius` bounds the scene
    /// around `center` and sets the near and far planes, which leave some space around it.
    pub fn orbit(
        center: Vec3,
        radius: f32,
        azimuth: f32,
        elevation: f32,
        distance: f32,
        fov_y: f32,
        aspect: f32,
    ) -> Self {
        let ((sa, ca), (se, ce)) = (azimuth.sin_cos(), elevation.sin_cos());
        let eye = center + Vec3::new(ce * sa, se, ce * ca) * distance;
        // Exact at the poles, where the direction of +y alone says nothing.
        let up = Vec3::new(-se * sa, ce, -se * ca);
        let space = 1.05 * radius.max(f32::MIN_POSITIVE);
        let near = (distance - space).max(1e-3 * distance.max(space));
        let far = (distance + space).max(near * 1.001);
        Self::look_at(eye, center, up, fov_y, aspect, near, far)
    }

    /// Distance from the centre at which a sphere of `radius` just fills the narrower side of the view:
    /// `radius / sin(half angle)`.
    pub fn framing_distance(radius: f32, fov_y: f32, aspect: f32) -> f32 {
        let half_y = 0.5 * fov_y;
        let half_x = (half_y.tan() * aspect).atan();
        radius / half_y.min(half_x).sin()
    }

    /// An orbit camera at the distance at which the sphere just fills the view; see [`Self::orbit`].
    ///
    /// ```
    /// use photofit_scene::Camera;
    /// use glam::Vec3;
    /// let camera = Camera::framing(Vec3::ZERO, 2.0, 0.3, 0.2, 0.8, 1.5);
    /// assert!((camera.eye.length() - 2.0 / 0.4_f32.sin()).abs() < 1e-4);
    /// ```
    pub fn framing(center: Vec3, radius: f32, azimuth: f32, elevation: f32, fov_y: f32, aspect: f32) -> Self {
        let distance = Self::framing_distance(radius, fov_y, aspect);
        Self::orbit(center, radius, azimuth, elevation, distance, fov_y, aspect)
    }

    /// Camera frame to clip space, z in [0, w].
    pub fn projection(&self) -> Mat4 {
        let f = 1.0 / (0.5 * self.fov_y).tan();
        let r = self.far / (self.near - self.far);
        Mat4::from_cols(
            glam::vec4(f / self.aspect, 0.0, 0.0, 0.0),
            glam::vec4(0.0, f, 0.0, 0.0),
            glam::vec4(-self.principal[0], -self.principal[1], r, -1.0),
            glam::vec4(0.0, 0.0, r * self.near, 0.0),
        )
    }

    /// World to clip space, z in [0, w].
    pub fn view_projection(&self) -> Mat4 {
        self.projection() * self.view
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::FRAC_PI_2;

    #[test]
    fn the_optical_axis_meets_the_picture_at_the_principal_point() {
        let mut c = Camera::look_at(Vec3::Z * 3.0, Vec3::ZERO, Vec3::Y, 0.8, 1.5, 0.1, 10.0);
        c.principal = [0.25, -0.5];
        for depth in [0.0, 1.5] {
            let p = c.view_projection().project_point3(Vec3::Z * depth);
            assert!((p.x - 0.25).abs() < 1e-6 && (p.y + 0.5).abs() < 1e-6, "{p}");
        }
    }

    #[test]
    fn orbits_turn_the_stated_way() {
        for (azimuth, elevation, expected) in [
            (0.0, 0.0, Vec3::Z),
            (FRAC_PI_2, 0.0, Vec3::X),
            (0.7, FRAC_PI_2, Vec3::Y),
            (0.7, -FRAC_PI_2, Vec3::NEG_Y),
        ] {
            let c = Camera::orbit(Vec3::ONE, 1.0, azimuth, elevation, 3.0, 0.8, 1.0);
            assert!(
                (c.eye - (Vec3::ONE + expected * 3.0)).length() < 1e-5,
                "{azimuth} {elevation}: {}",
                c.eye
            );
            let m = c.view_projection();
            let p = m * Vec3::ONE.extend(1.0);
            assert!(p.x.abs() < 1e-5 && p.y.abs() < 1e-5 && p.z > 0.0 && p.z < p.w, "{p}");
            assert!(m.is_finite());
        }
    }

    #[test]
    fn framed_spheres_touch_the_border() {
        for aspect in [0.5, 1.0, 2.0] {
            let c = Camera::framing(Vec3::ZERO, 1.5, 0.4, 0.3, 0.7, aspect);
            let half = (0.35_f32.tan() * aspect.min(1.0)).atan();
            let touching = (1.5 / c.eye.length()).asin();
            assert!((touching - half).abs() < 1e-5, "aspect {aspect}");
            assert!(c.near < c.eye.length() - 1.5 && c.far > c.eye.length() + 1.5, "planes leave space");
        }
    }
}
