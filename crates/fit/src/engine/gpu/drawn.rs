//! A rasterized reference whose pictures are drawn on a device. Poses are drawn on the CPU, as are pictures that the device does
//! not draw, and everything where it has no room for the asset.
//!
//! Who draws a picture is decided by the picture and the limits of the device, but where memory is used up: a picture without
//! room, and all later ones that take as much, are drawn on the CPU for as long as the reference is there. A fit that is
//! resumed asks the device anew, and may find room: its pictures then differ from those before by what the renderers
//! differ by, as they do on another device.

use crate::FitError;
use crate::engine::reference::{Rasterized, Reference, ReferenceKind, ReferencePicture};
use crate::engine::views::{Moment, Setup, Sphere};
use crate::scene_render::gpu::{DeviceScene, PictureRequest};
use photofit_gpu::{Gpu, GpuError};
use photofit_image::Image;
use std::sync::{Arc, Mutex, PoisonError};

/// The reference.
#[derive(Debug)]
pub(crate) struct DrawnThere<'a> {
    gpu: Gpu,
    /// Whether nothing but a GPU will do.
    required: bool,
    on_cpu: Rasterized<'a>,
    course: Arc<Mutex<Course>>,
}

/// What a reference holds on a device, given back where a fit has no room.
#[derive(Clone, Debug)]
pub struct DeviceMemory(Arc<Mutex<Course>>);

impl DeviceMemory {
    /// Gives back the buffers of pictures or, where there are none, the asset, which the next picture uploads again; whether there
    /// was anything.
    pub(super) fn give_back(&self) -> bool {
        let mut course = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(scene) = &mut course.scene else { return false };
        if !scene.give_back() {
            course.scene = None;
        }
        true
    }
}

/// What came of it so far.
#[derive(Debug, Default)]
struct Course {
    /// From the first picture on.
    scene: Option<DeviceScene>,
    /// Pictures that the device drew, and the most bands of one.
    drawn: u64,
    bands: usize,
    /// Pictures that it did not draw, and why not the first of them.
    refused: u64,
    why: Option<String>,
    /// Bytes of the least picture that it had no room for.
    full: Option<usize>,
    /// Whether poses were asked for.
    posed: bool,
    /// Why the device draws no more.
    left: Option<String>,
}

impl Course {
    /// A picture; none where the device cannot draw it.
    fn picture(
        &mut self,
        gpu: &Gpu,
        of: &Rasterized<'_>,
        asked: &PictureRequest<'_>,
    ) -> Result<Option<Image>, GpuError> {
        if let Some(why) = DeviceScene::refused(gpu, asked) {
            return Ok(self.refuse(why));
        }
        let scene = match &mut self.scene {
            Some(scene) => scene,
            none => {
                let (flat, library) = of.asset();
                none.insert(DeviceScene::new(gpu, flat, library)?)
            }
        };
        let bytes = scene.bytes(asked);
        if self.full.is_some_and(|full| bytes >= full) {
            self.refused += 1;
            return Ok(None);
        }
        match scene.draw(asked) {
            Ok(image) => {
                self.drawn += 1;
                self.bands = self.bands.max(scene.bands());
                Ok(Some(image))
            }
            Err(e) if e.is_of_size() => {
                self.full = Some(bytes);
                Ok(self.refuse(e.to_string()))
            }
            Err(e) => Err(e),
        }
    }

    fn refuse(&mut self, why: String) -> Option<Image> {
        self.refused += 1;
        self.why.get_or_insert(why);
        None
    }
}

impl<'a> DrawnThere<'a> {
    /// A reference whose asset is uploaded with its first picture.
    pub(crate) fn new(gpu: &Gpu, on_cpu: Rasterized<'a>, required: bool) -> Self {
        Self { gpu: gpu.clone(), required, on_cpu, course: Arc::default() }
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
        let asked = PictureRequest {
            camera: &setup.camera.pinhole(),
            lights: &setup.lights,
            size: [setup.width, setup.height],
            samples: self.on_cpu.samples_of(setup),
            backs: setup.backs,
        };
        match course.picture(&self.gpu, &self.on_cpu, &asked) {
            Ok(image) => Ok(image),
            Err(e) if may_leave(&e, self.required, course.drawn) => {
                (course.left, course.scene) = (Some(e.to_string()), None);
                Ok(None)
            }
            Err(source) => Err(FitError::Drawing { device: self.gpu.report().name.clone(), source }),
        }
    }
}

/// Whether the CPU goes on after an error: for want of room for the asset, and where a device that is not required fails before
/// its first picture.
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
        let Course { drawn, bands, refused, .. } = *course;
        Some(match (&course.left, &course.why) {
            (Some(why), _) | (None, Some(why)) if drawn == 0 => {
                format!("pictures of the reference are drawn on the CPU: {why}")
            }
            (Some(why), _) => {
                format!(
                    "pictures of the reference are drawn on the CPU, after {drawn} that were drawn there: {why}"
                )
            }
            (None, why) => {
                let who = if course.posed {
                    "poses of the reference are drawn on the CPU"
                } else {
                    "pictures of the reference are drawn there"
                };
                let bands =
                    if bands > 1 { format!(", in up to {bands} bands of rows") } else { String::new() };
                let others = why
                    .as_ref()
                    .map(|why| format!(", but for {refused} of {} on the CPU: {why}", refused + drawn));
                who.to_owned() + &bands + &others.unwrap_or_default()
            }
        })
    }

    fn device_memory(&self) -> Option<DeviceMemory> {
        Some(DeviceMemory(self.course.clone()))
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
    use crate::engine::views::{Lighting, Orbit, Set, ViewLight, ViewLights, Views};
    use crate::scene_render::tests::spheres;
    use photofit_gpu::{Caps, Choice, test_device};
    use photofit_scalar::{Vec3f, vec3};

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
    }

    #[test]
    #[ignore = "gpu: needs an adapter"]
    fn a_picture_that_a_device_does_not_draw_leaves_the_others_there() {
        let n = Normalised::new(&spheres()).unwrap();
        let on_cpu = Rasterized::new(&n.flat, &n.library).sampled(2);
        let same = |drawn: &DrawnThere<'_>, setup: &Setup, by: &dyn Reference| {
            drawn.picture(setup).unwrap().image == by.picture(setup).unwrap().image
        };
        let there = "pictures of the reference are drawn there";
        // No room for one: nor is it tried for another one as large.
        let gpu = with_memory(12 << 20);
        let (drawn, other) =
            (DrawnThere::new(&gpu, on_cpu, true), DrawnThere::new(test_device(), on_cpu, true));
        assert!(same(&drawn, &setup(40), &other));
        assert_eq!(drawn.where_drawn().unwrap(), there);
        let before = gpu.held();
        assert!(same(&drawn, &setup(900), &on_cpu));
        assert!(gpu.held() < before, "the buffers of pictures are given back");
        assert!(same(&drawn, &setup(40), &other));
        assert!(same(&drawn, &setup(901), &on_cpu));
        let told = drawn.where_drawn().unwrap();
        assert!(told.starts_with(&format!("{there}, but for 2 of 4 on the CPU: out of")), "{told}");
        // More samples along an axis than kernels number, and more lights than they take.
        let drawn = DrawnThere::new(test_device(), on_cpu, true);
        let wide = Setup { width: 40_000, height: 1, ..setup(8) };
        assert!(same(&drawn, &wide, &on_cpu));
        let told = drawn.where_drawn().unwrap();
        assert!(told.contains("on the CPU: 80000 samples along an axis"), "{told}");
        let light = ViewLight::Point { position: vec3(3.0, 4.0, 5.0), intensity: Vec3f::splat(1.0) };
        let many = Setup { lights: ViewLights(vec![light; 65]), ..setup(8) };
        assert!(same(&drawn, &many, &on_cpu) && same(&drawn, &setup(40), &other));
        let told = drawn.where_drawn().unwrap();
        assert!(told.starts_with(&format!("{there}, but for 2 of 3 on the CPU: 80000 samples")), "{told}");
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

    #[test]
    #[ignore = "gpu: needs an adapter"]
    fn a_reference_gives_back_its_buffers_then_its_asset() {
        let n = Normalised::new(&spheres()).unwrap();
        let on_cpu = Rasterized::new(&n.flat, &n.library).sampled(2);
        let gpu = with_memory(u64::MAX);
        let drawn = DrawnThere::new(&gpu, on_cpu, true);
        let lent = drawn.device_memory().unwrap();
        assert!(!lent.give_back(), "nothing is there");
        let first = drawn.picture(&setup(40)).unwrap().image;
        let all = gpu.held();
        assert!(lent.give_back());
        let asset = gpu.held();
        assert!(asset > 0 && asset < all);
        assert!(lent.give_back() && gpu.held() == 0 && !lent.give_back());
        assert!(drawn.picture(&setup(40)).unwrap().image == first, "uploaded again");
    }
}
