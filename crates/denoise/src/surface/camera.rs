//! The pinhole camera of the maps: x to the right, y down, z forward, pixel centres at +.5.

use super::SurfaceError;
use photofit_scalar::{Vec3, Vec3f, vec3};

/// Most pixels of a map.
const MOST_PIXELS: usize = 1 << 28;
/// Bound of lengths and places; squares of them are finite in single precision.
const MOST: f64 = 1e15;
/// Bound of focal lengths from below, pixels.
const LEAST_FOCAL: f64 = 1e-3;

/// A pinhole camera as plain numbers.
///
/// Pixel `(x, y)` looks along `X right + Y down + forward` with `X = (x + .5 - cx) / fx`, `Y = (y + .5 - cy) / fy`;
/// depth is measured along `forward`, not along the ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pinhole {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Focal length over the width of a pixel.
    pub fx: f64,
    /// Focal length over the height of a pixel.
    pub fy: f64,
    /// Column of the optical axis, pixels; `width / 2` is the middle.
    pub cx: f64,
    /// Row of the optical axis, pixels.
    pub cy: f64,
    /// The eye in the frame of the points.
    pub eye: [f64; 3],
    /// The unit axes right, down and forward in the frame of the points.
    pub axes: [[f64; 3]; 3],
}

impl Pinhole {
    /// A camera at `eye` that looks at `target`, with `up` towards the top and `fov_y` radians from top to bottom.
    ///
    /// `up` parallel to the view direction is replaced by another axis.
    ///
    /// ```
    /// use photofit_denoise::surface::Pinhole;
    /// let camera = Pinhole::look_at([0.0, 0.0, 3.0], [0.0; 3], [0.0, 1.0, 0.0], 0.8, 640, 480);
    /// let p = camera.to_camera([0.0, 1.0, 0.0]);
    /// assert!((p[1] + 1.0).abs() < 1e-12 && (p[2] - 3.0).abs() < 1e-12, "up is -y, ahead is +z");
    /// ```
    pub fn look_at(
        eye: [f64; 3],
        target: [f64; 3],
        up: [f64; 3],
        fov_y: f64,
        width: usize,
        height: usize,
    ) -> Self {
        let [e, t, u] = [eye, target, up].map(Vec3::from_array);
        let forward = (t - e).normalize_or_zero();
        let forward = if forward == Vec3::zero() { vec3(0.0, 0.0, -1.0) } else { forward };
        let cross = |u: Vec3<f64>| forward.cross(u.normalize_or_zero());
        let candidates = [u, vec3(0.0, 0.0, 1.0), vec3(1.0, 0.0, 0.0)];
        let right =
            candidates.map(cross).into_iter().find(|r| r.length() > 1e-9).unwrap_or(vec3(1.0, 0.0, 0.0));
        let right = right.normalize_or_zero();
        let down = forward.cross(right);
        let f = 0.5 * height as f64 / (0.5 * fov_y).tan();
        Self {
            width,
            height,
            fx: f,
            fy: f,
            cx: 0.5 * width as f64,
            cy: 0.5 * height as f64,
            eye,
            axes: [right, down, forward].map(Vec3::to_array),
        }
    }

    /// Checks sizes, numbers and axes.
    ///
    /// # Errors
    /// The rule that is broken.
    pub fn check(&self) -> Result<(), SurfaceError> {
        let bad = |rule: String| Err(SurfaceError::Camera { rule });
        let pixels = self.width.checked_mul(self.height).filter(|n| (1..=MOST_PIXELS).contains(n));
        if pixels.is_none() {
            return bad(format!(
                "the size is {} x {}; it must have 1 to {MOST_PIXELS} pixels",
                self.width, self.height
            ));
        }
        let [x, y, z] = self.eye;
        let places = [("cx", self.cx), ("cy", self.cy), ("eye x", x), ("eye y", y), ("eye z", z)];
        if let Some((name, value)) = places.iter().find(|(_, v)| v.is_nan() || v.abs() >= MOST) {
            return bad(format!("{name} is {value}; it must lie between -{MOST:e} and {MOST:e}"));
        }
        let lengths = [("fx", self.fx), ("fy", self.fy)];
        if let Some((name, value)) = lengths.iter().find(|(_, v)| !(*v > LEAST_FOCAL && *v < MOST)) {
            return bad(format!("{name} is {value}; it must lie between {LEAST_FOCAL} and {MOST:e}"));
        }
        let a = self.axes.map(Vec3::from_array);
        let unit = |v: Vec3<f64>| (v.length() - 1.0).abs() < 1e-4;
        let handed = (a[0].cross(a[1]) - a[2]).length() < 1e-3;
        if !(a.iter().all(|v| unit(*v)) && handed) {
            let rule = "they must be orthonormal and right-handed";
            return bad(format!("the axes right, down and forward are {:?}; {rule}", self.axes));
        }
        Ok(())
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.width * self.height
    }

    /// A point in camera axes: right, down, depth.
    #[inline]
    pub fn to_camera(&self, p: [f64; 3]) -> [f64; 3] {
        let d = [p[0] - self.eye[0], p[1] - self.eye[1], p[2] - self.eye[2]];
        self.axes.map(|a| a[0] * d[0] + a[1] * d[1] + a[2] * d[2])
    }

    /// A direction in camera axes.
    #[inline]
    pub(super) fn direction_to_camera(&self, v: Vec3f) -> Vec3f {
        let v: Vec3<f64> = v.cast();
        Vec3::from_array(self.axes.map(|a| Vec3::from_array(a).dot(v))).cast()
    }

    /// A direction given in camera axes in the frame of the points.
    #[inline]
    pub(super) fn direction_to_world(&self, v: Vec3f) -> Vec3f {
        let [r, d, f] = self.axes.map(|a| Vec3::from_array(a).cast::<f32>());
        r * v.x + d * v.y + f * v.z
    }

    /// The ray through the centre of pixel `i`, counted row by row, in camera axes; its depth is 1.
    #[inline]
    pub fn ray(&self, i: usize) -> Vec3f {
        vec3(self.ray_x((i % self.width) as f64), self.ray_y((i / self.width) as f64), 1.0)
    }

    /// `X` of a pixel's ray `(X, Y, 1)` at the centre of column `x`.
    #[inline]
    pub(super) fn ray_x(&self, x: f64) -> f32 {
        ((x + 0.5 - self.cx) / self.fx) as f32
    }

    /// `Y` of a pixel's ray at the centre of row `y`.
    #[inline]
    pub(super) fn ray_y(&self, y: f64) -> f32 {
        ((y + 0.5 - self.cy) / self.fy) as f32
    }

    /// Steps of `X` and `Y` from one pixel to the next.
    #[inline]
    pub(super) fn ray_steps(&self) -> (f32, f32) {
        ((1.0 / self.fx) as f32, (1.0 / self.fy) as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_right_down_forward() {
        let c = Pinhole::look_at([1.0, 2.0, 3.0], [1.0, 2.0, -3.0], [0.0, 1.0, 0.0], 1.0, 64, 32);
        c.check().unwrap();
        let expected: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]];
        for (a, e) in c.axes.as_flattened().iter().zip(expected.as_flattened()) {
            assert!((a - e).abs() < 1e-12);
        }
        let half = 16.0 / c.fy;
        assert!((half - 0.5_f64.tan()).abs() < 1e-12, "the field of view is vertical");
        for up in [[0.0, 0.0, 1.0], [0.0; 3]] {
            Pinhole::look_at([0.0, 0.0, 3.0], [0.0; 3], up, 1.0, 8, 8).check().unwrap();
        }
        let v = vec3(0.3_f32, -0.5, 0.2);
        assert!((c.direction_to_world(c.direction_to_camera(v)) - v).length() < 1e-6);
    }

    #[test]
    fn bad_cameras_are_refused() {
        let good = Pinhole::look_at([0.0, 0.0, 3.0], [0.0; 3], [0.0, 1.0, 0.0], 1.0, 8, 8);
        let rule = |c: Pinhole| c.check().unwrap_err().to_string();
        let size = |size: &str| format!("camera: the size is {size}; it must have 1 to {MOST_PIXELS} pixels");
        assert_eq!(rule(Pinhole { width: 0, ..good }), size("0 x 8"));
        assert_eq!(rule(Pinhole { width: 1 << 40, ..good }), size("1099511627776 x 8"));
        assert_eq!(rule(Pinhole { width: usize::MAX, ..good }), size(&format!("{} x 8", usize::MAX)));
        for value in [0.0, -3.0, f64::NAN, f64::INFINITY] {
            let expected = format!("fx is {value}; it must lie between 0.001 and 1e15");
            assert_eq!(rule(Pinhole { fx: value, ..good }), format!("camera: {expected}"));
        }
        let expected = "camera: cx is NaN; it must lie between -1e15 and 1e15";
        assert_eq!(rule(Pinhole { cx: f64::NAN, ..good }), expected);
        let eye = [0.0, -1e16, 0.0];
        assert!(rule(Pinhole { eye, ..good }).starts_with("camera: eye y is -10000000000000000; it must"));
        let expected = "are [[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]; they must be orthonormal";
        assert!(rule(Pinhole { axes: [[1.0, 0.0, 0.0]; 3], ..good }).contains(expected));
    }
}
