//! The camera: pinhole, or a thin lens with an aperture.

use crate::PathtraceError;
use crate::error::invalid;
use crate::world::{World, WorldRay};
use glam::{DVec3, Vec3};
use photofit_sampling::concentric_disk;
use photofit_scalar::{Vec2f, Vec3f, vec2, vec3};
use photofit_scene::Camera;

/// A lens with a finite aperture: what lies off the plane of focus is blurred.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Radius of the aperture, in units of the scene.
    pub radius: f32,
    /// Distance of the plane that is sharp, along the axis.
    pub focus: f32,
}

/// How the rays of a picture leave the camera.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Projection {
    /// From the eye.
    #[default]
    Perspective,
    /// In parallel, along the view.
    Orthographic,
}

/// A camera that makes rays: [`photofit_scene::Camera`] with an optional lens, in double precision.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Position of the eye in the world.
    pub eye: DVec3,
    /// Unit axes of the camera's frame in the world: right, up, back.
    pub axes: [Vec3; 3],
    /// Tangents of half the fields of view, horizontal and vertical; half the width and height of the picture where
    /// rays are parallel.
    pub half: [f32; 2],
    /// How rays leave.
    pub projection: Projection,
    /// The part of the view that the picture shows: left, upper, width and height, each as a share of the whole.
    pub window: [f32; 4],
    /// Distances along the axis between which surfaces are seen.
    pub clip: [f32; 2],
    /// The lens; `None`: everything is sharp.
    pub lens: Option<Lens>,
}

impl View {
    /// The rays of a rasterizer's camera.
    pub fn pinhole(camera: &Camera) -> Self {
        let m = camera.view;
        let row = |k: usize| Vec3::new(m.x_axis[k], m.y_axis[k], m.z_axis[k]);
        let tan = (0.5 * camera.fov_y).tan();
        Self {
            eye: camera.eye.as_dvec3(),
            axes: [row(0), row(1), row(2)],
            half: [tan * camera.aspect, tan],
            projection: Projection::Perspective,
            window: [-0.5 * camera.principal[0], 0.5 * camera.principal[1], 1.0, 1.0],
            clip: [0.0, f32::INFINITY],
            lens: None,
        }
    }

    /// The same camera with a lens.
    #[must_use]
    pub fn with_lens(self, lens: Lens) -> Self {
        Self { lens: Some(lens), ..self }
    }

    /// Checks that the camera can make rays.
    ///
    /// # Errors
    /// If something is not finite, the axes are no unit vectors at right angles, the field of view is empty, or the
    /// lens has a negative radius or no focus in front of it.
    pub fn check(&self) -> Result<(), PathtraceError> {
        let fail = |rule: String| Err(invalid("camera", rule));
        if !self.eye.is_finite() || self.axes.iter().any(|a| !a.is_finite()) {
            return fail(format!(
                "the eye is {} and the axes are {:?}; they must be finite",
                self.eye, self.axes
            ));
        }
        let [r, u, b] = self.axes;
        let skew = [r.dot(u), u.dot(b), b.dot(r)].into_iter().fold(0.0_f32, |m, d| m.max(d.abs()));
        if skew > 1e-3 || [r, u, b].iter().any(|a| (a.length() - 1.0).abs() > 1e-3) {
            return fail(format!("its axes are {:?}; they must be unit vectors at right angles", self.axes));
        }
        if !self.half.iter().all(|t| *t > 0.0 && t.is_finite()) {
            return fail(format!(
                "the field of view has half tangents of {:?}; it must lie between 0 and 180 degrees",
                self.half
            ));
        }
        if !self.window.iter().all(|x| x.is_finite()) || self.window[2] <= 0.0 || self.window[3] <= 0.0 {
            return fail(format!("its window is {:?}; it must be finite and have an extent", self.window));
        }
        // Written so that NaN fails.
        if !(self.clip[0] >= 0.0 && self.clip[0] < self.clip[1]) {
            return fail(format!(
                "surfaces are seen between {:?}; the distances must rise, from 0 or more",
                self.clip
            ));
        }
        match self.lens {
            Some(l) if !(l.radius >= 0.0 && l.radius.is_finite() && l.focus > 0.0 && l.focus.is_finite()) => {
                fail(format!(
                    "the lens is {l:?}; its radius must be finite and not negative, its focus positive and finite"
                ))
            }
            _ => Ok(()),
        }
    }

    /// The camera in the render frame of `world`.
    pub(crate) fn prepare(&self, world: &World) -> Prepared {
        let [right, up, back] = self.axes.map(|a| vec3(a.x, a.y, a.z));
        // The picture's own centre and extent, in the plane at distance 1.
        let [x, y, w, h] = self.window;
        let center = [(2.0 * x + w - 1.0) * self.half[0], (1.0 - 2.0 * y - h) * self.half[1]];
        Prepared {
            eye: world.to_render(self.eye),
            right,
            up,
            back,
            half: [w * self.half[0], h * self.half[1]],
            center,
            parallel: self.projection == Projection::Orthographic,
            clip: self.clip,
            lens: self.lens,
        }
    }
}

/// A camera in the render frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Prepared {
    pub(crate) eye: Vec3f,
    right: Vec3f,
    up: Vec3f,
    back: Vec3f,
    half: [f32; 2],
    center: [f32; 2],
    parallel: bool,
    clip: [f32; 2],
    lens: Option<Lens>,
}

impl Prepared {
    /// The ray through a point of the picture in `[0, 1]^2`, the origin at the upper left, and of the lens if there is
    /// one.
    #[inline]
    pub(crate) fn ray(&self, at: Vec2f, lens: impl FnOnce() -> [f32; 2]) -> WorldRay {
        let x = self.center[0] + (2.0 * at.x - 1.0) * self.half[0];
        let y = self.center[1] + (1.0 - 2.0 * at.y) * self.half[1];
        if self.parallel {
            let origin = self.eye + self.right * x + self.up * y;
            return self.clipped(WorldRay { origin, direction: -self.back, t_max: f32::INFINITY });
        }
        let through = self.right * x + self.up * y - self.back;
        let ray = match self.lens {
            None => {
                WorldRay { origin: self.eye, direction: through.normalize_or_zero(), t_max: f32::INFINITY }
            }
            Some(l) => {
                let d: Vec2f = concentric_disk(lens());
                let offset = (self.right * d.x + self.up * d.y) * l.radius;
                let direction = (through * l.focus - offset).normalize_or_zero();
                WorldRay { origin: self.eye + offset, direction, t_max: f32::INFINITY }
            }
        };
        self.clipped(ray)
    }

    /// The part of a ray between the distances of clipping.
    #[inline(always)]
    fn clipped(&self, ray: WorldRay) -> WorldRay {
        let [near, far] = self.clip;
        if near == 0.0 && far == f32::INFINITY {
            return ray;
        }
        let per = 1.0 / -ray.direction.dot(self.back);
        let origin = ray.origin + ray.direction * (near * per);
        WorldRay { origin, direction: ray.direction, t_max: (far - near) * per }
    }

    /// Distance along the axis of a point.
    #[inline]
    pub(crate) fn depth(&self, p: Vec3f) -> f32 {
        (self.eye - p).dot(self.back)
    }

    /// Where a point lies in the picture, in `[0, 1]^2`; `None` behind the camera.
    pub(crate) fn project(&self, p: Vec3f) -> Option<Vec2f> {
        let v = p - self.eye;
        let depth = -v.dot(self.back);
        (depth > 0.0).then(|| {
            let per = if self.parallel { 1.0 } else { 1.0 / depth };
            let x = (v.dot(self.right) * per - self.center[0]) / self.half[0];
            let y = (v.dot(self.up) * per - self.center[1]) / self.half[1];
            vec2(0.5 + 0.5 * x, 0.5 - 0.5 * y)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::Parts;

    #[test]
    fn rays_go_where_the_rasterizer_projects() {
        let camera = Camera::look_at(Vec3::new(1.0, 2.0, 5.0), Vec3::ZERO, Vec3::Y, 0.8, 1.5, 0.1, 100.0);
        let world = World::new(Parts::default()).unwrap();
        let view = View::pinhole(&camera);
        view.check().unwrap();
        let lens = view.with_lens(Lens { radius: 0.2, focus: 4.0 });
        for at in [vec2(0.1, 0.2), vec2(0.5, 0.5), vec2(0.9, 0.8)] {
            let ray = view.prepare(&world).ray(at, || [0.5; 2]);
            let p = ray.origin + ray.direction * 3.0;
            let clip = camera.view_projection() * glam::vec4(p.x, p.y, p.z, 1.0);
            let found = vec2(0.5 + 0.5 * clip.x / clip.w, 0.5 - 0.5 * clip.y / clip.w);
            assert!((found - at).length() < 1e-5, "{at:?} {found:?}");
            let again = view.prepare(&world).project(p).unwrap();
            assert!((again - at).length() < 1e-5, "{at:?} {again:?}");
            assert!((view.prepare(&world).depth(p) - clip.w).abs() < 1e-4);
            // All rays of a lens meet in the plane of focus.
            let meet = |u: [f32; 2]| {
                let r = lens.prepare(&world).ray(at, || u);
                let back = lens.prepare(&world).back;
                r.origin
                    + r.direction
                        * ((4.0 - (view.prepare(&world).eye - r.origin).dot(back)) / -r.direction.dot(back))
            };
            assert!((meet([0.1, 0.9]) - meet([0.8, 0.3])).length() < 1e-5);
        }
        for bad in [
            View { half: [0.0, 1.0], ..view },
            View { eye: DVec3::NAN, ..view },
            View { axes: [Vec3::X, Vec3::X, Vec3::Z], ..view },
            view.with_lens(Lens { radius: 1.0, focus: 0.0 }),
        ] {
            assert!(bad.check().is_err(), "{bad:?}");
        }
    }
}
