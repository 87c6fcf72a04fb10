//! A rasterized reference whose pictures are drawn on a device. Poses are drawn on the CPU, as is everything once the device has no
//! room for the asset or for a picture.

use crate::FitError;
use crate::engine::reference::{Rasterized, Reference, ReferenceKind, ReferencePicture};
use crate::engine::views::{Moment, Setup, Sphere};
use crate::scene_render::gpu::{Asked, DeviceScene};
use photofit_gpu::{Gpu, GpuError};
use photofit_image::Image;
use std::sync::{Mutex, PoisonError};

/// The reference.
#[derive(Debug)]
pub(crate) struct DrawnThere<'a> {
    gpu: Gpu,
    /// Whether nothing but a GPU will do.
    required: bool,
    on_cpu: Rasterized<'a>,
    course: Mutex<Course>,
}

/// What came of it so far.
#[derive(Debug, Default)]
struct Course {
    /// From the first picture on.
    scene: Option<DeviceScene>,
    /// Pictures that the device drew.
    drawn: u64,
    /// Whether poses were asked for.
    posed: bool,
    /// Why the device draws no more.
    left: Option<String>,
}

impl Course {
    fn picture(&mut self, gpu: &Gpu, of: &Rasterized<'_>, asked: &Asked<'_>) -> Result<Image, GpuError> {
        if self.scene.is_none() {
            let (flat, library) = of.asset();
            self.scene = Some(DeviceScene::new(gpu, flat, library)?);
        }
        let image = self.scene.as_mut().map(|scene| scene.draw(asked)).expect("it was just made")?;
        self.drawn += 1;
        Ok(image)
    }
}

impl<'a> DrawnThere<'a> {
    /// A reference whose asset is uploaded with its first picture.
    pub(crate) fn new(gpu: &Gpu, on_cpu: Rasterized<'a>, required: bool) -> Self {
        Self { gpu: gpu.clone(), required, on_cpu, course: Mutex::default() }
    }

    /// Draws a picture on the device, unless that is left to the CPU.
    fn draw(&self, setup: &Setup) -> Result<Option<Image>, FitError> {
        let mut course = self.course.lock().unwrap_or_else(PoisonError::into_inner);
        if setup.moment.animation.is_some() {
            course.posed = true;
            return Ok(None);
        }
        if course.left.is_some() {
            return Ok(None);
        }
        let asked = Asked {
            camera: &setup.camera.pinhole(),
            lights: &setup.lights,
            size: [setup.width, setup.height],
            samples: self.on_cpu.samples_of(setup),
            backs: setup.backs,
        };
        if let Some(why) = DeviceScene::refused(&asked) {
            course.left = Some(why);
            return Ok(None);
        }
        match course.picture(&self.gpu, &self.on_cpu, &asked) {
            Ok(image) => Ok(Some(image)),
            Err(e) if may_leave(&e, self.required, course.drawn) => {
                (course.left, course.scene) = (Some(e.to_string()), None);
                Ok(None)
            }
            Err(source) => Err(FitError::Drawing { device: self.gpu.report().name.clone(), source }),
        }
    }
}

/// Whether the CPU goes on after an error: for want of room, and where a device that is not required fails before its first
/// picture.
fn may_leave(e: &GpuError, required: bool, drawn: u64) -> bool {
    e.is_of_size() || (!required && drawn == 0)
}

impl Reference for DrawnThere<'_> {
    fn kind(&self) -> ReferenceKind {
        self.on_cpu.kind()
    }

    fn picture(&self, setup: &Setup) -> Result<ReferencePicture, FitError> {
        match self.draw(setup)? {
            Some(image) => Ok(ReferencePicture::clean(image)),
            None => self.on_cpu.picture(setup),
        }
    }

    fn bounds(&self, moment: Moment) -> Sphere {
        self.on_cpu.bounds(moment)
    }

    fn where_drawn(&self) -> Option<String> {
        let course = self.course.lock().unwrap_or_else(PoisonError::into_inner);
        let bands = course.scene.as_ref().map_or(1, DeviceScene::bands);
        Some(match &course.left {
            Some(why) if course.drawn == 0 => {
                format!("pictures of the reference are drawn on the CPU: {why}")
            }
            Some(why) => {
                let there = course.drawn;
                format!(
                    "pictures of the reference are drawn on the CPU, after {there} that were drawn there: {why}"
                )
            }
            None if course.posed => "poses of the reference are drawn on the CPU".into(),
            None if bands > 1 => {
                format!("pictures of the reference are drawn there, in {bands} bands of rows")
            }
            None => "pictures of the reference are drawn there".into(),
        })
    }

    fn leave_device(&self, why: &str) {
        let mut course = self.course.lock().unwrap_or_else(PoisonError::into_inner);
        course.left.get_or_insert_with(|| why.into());
        course.scene = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::Normalised;
    use crate::engine::views::{Lighting, Orbit, Set, Views};
    use crate::scene_render::tests::spheres;
    use photofit_gpu::{Caps, Choice, test_device};

    fn setup(size: usize) -> Setup {
        Orbit::new(0, &Lighting::Mixed, size).setup(Set::Train, 2, 0)
    }

    /// A device of its own, as if it had this much memory.
    fn with_memory(memory: u64) -> Gpu {
        let named = Choice::Named(test_device().report().name.clone());
        Gpu::within(&named, Caps { memory, ..Caps::NONE }).unwrap()
    }

    #[test]
    #[ignore = "gpu: needs an adapter"]
    fn what_a_device_has_no_room_for_is_drawn_on_the_cpu_and_told() {
        let n = Normalised::new(&spheres()).unwrap();
        let on_cpu = Rasterized::new(&n.flat, &n.library).sampled(2);
        for required in [false, true] {
            let drawn = DrawnThere::new(&with_memory(1 << 16), on_cpu, required);
            assert_eq!(drawn.picture(&setup(40)).unwrap().image, on_cpu.picture(&setup(40)).unwrap().image);
            let told = drawn.where_drawn().unwrap();
            assert!(told.starts_with("pictures of the reference are drawn on the CPU: out of"), "{told}");
        }
        // Some pictures there, then one that it has no room for.
        let gpu = with_memory(12 << 20);
        let drawn = DrawnThere::new(&gpu, on_cpu, true);
        drawn.picture(&setup(40)).unwrap();
        assert_eq!(drawn.where_drawn().unwrap(), "pictures of the reference are drawn there");
        assert_eq!(drawn.picture(&setup(900)).unwrap().image, on_cpu.picture(&setup(900)).unwrap().image);
        let told = drawn.where_drawn().unwrap();
        assert!(told.starts_with("pictures of the reference are drawn on the CPU, after 1 that"), "{told}");
        assert_eq!(gpu.held(), 0, "it is given back");
        // More samples along an axis than kernels number.
        let wide = Setup { width: 40_000, height: 1, ..setup(8) };
        let drawn = DrawnThere::new(test_device(), on_cpu, true);
        drawn.picture(&wide).unwrap();
        assert!(drawn.where_drawn().unwrap().contains("80000 samples along an axis"));
    }

    #[test]
    #[ignore = "gpu: needs an adapter"]
    fn a_device_that_is_lost_is_an_error_of_the_step() {
        let n = Normalised::new(&spheres()).unwrap();
        let on_cpu = Rasterized::new(&n.flat, &n.library).sampled(1);
        let gpu = with_memory(u64::MAX);
        let [drawn, required, other] =
            [false, true, false].map(|required| DrawnThere::new(&gpu, on_cpu, required));
        drawn.picture(&setup(20)).unwrap();
        gpu.destroy();
        let error = drawn.picture(&setup(20)).unwrap_err();
        let FitError::Device { step: 7, kept, source } = error.at_step(7, || "kept".into()) else {
            panic!("not of the step")
        };
        assert!(kept == "kept" && source.to_string().contains("the device was lost"), "{source}");
        assert!(matches!(required.picture(&setup(20)), Err(FitError::Drawing { .. })));
        // Before the first picture the CPU goes on where it may; and where it is told to.
        assert!(other.picture(&setup(20)).is_ok());
        drawn.leave_device("the fit did");
        assert!(drawn.picture(&setup(20)).is_ok());
    }
}
