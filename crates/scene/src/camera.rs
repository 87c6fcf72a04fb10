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
    /// Width over height.
    pub aspect: f32,
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
        let right = up
            .cross(back)
            .try_normalize()
            .or_else(|| Vec3::Z.cross(back).try_normalize())
            .unwrap_or(Vec3::X);
        let true_up = back.cross(right);
        let view = Mat4::from_cols(
            glam::vec4(right.x, true_up.x, back.x, 0.0),
            glam::vec4(right.y, true_up.y, back.y, 0.0),
            glam::vec4(right.z, true_up.z, back.z, 0.0),
            glam::vec4(-right.dot(eye), -true_up.dot(eye), -back.dot(eye), 1.0),
        );
        Self { eye, view, fov_y, aspect, near, far }
    }

    /// Camera frame to clip space, z in [0, w].
    pub fn projection(&self) -> Mat4 {
        let f = 1.0 / (0.5 * self.fov_y).tan();
        let r = self.far / (self.near - self.far);
        Mat4::from_cols(
            glam::vec4(f / self.aspect, 0.0, 0.0, 0.0),
            glam::vec4(0.0, f, 0.0, 0.0),
            glam::vec4(0.0, 0.0, r, -1.0),
            glam::vec4(0.0, 0.0, r * self.near, 0.0),
        )
    }

    /// World to clip space, z in [0, w].
    pub fn view_projection(&self) -> Mat4 {
        self.projection() * self.view
    }
}
