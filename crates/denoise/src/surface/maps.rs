//! Depth, normals and colours as images.

use super::{Cloud, Pinhole, Samples};
use photofit_image::Image;
use photofit_scalar::Vec3f;

/// The maps of one view; pixels without a surface are 0 in all of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Maps {
    /// One channel: depth along the optical axis, in the units of the points; 0 = no surface.
    pub depth: Image,
    /// Three channels: unit normals in the frame of the points, facing the camera.
    pub normal: Image,
    /// Three channels: linear RGB; absent for clouds without colours.
    pub albedo: Option<Image>,
}

impl Maps {
    /// The raw maps: what fell on each pixel and nothing between.
    pub fn of_samples(samples: &Samples, cloud: &Cloud, camera: &Pinhole) -> Self {
        let (w, h) = (samples.width, samples.height);
        let mut maps = Self {
            depth: Image::from_data(w, h, 1, samples.z.clone()),
            normal: Image::new(w, h, 3),
            albedo: (!cloud.colors().is_empty()).then(|| Image::new(w, h, 3)),
        };
        for i in (0..w * h).filter(|i| samples.is_valid(*i)) {
            maps.set_normal(i, camera.direction_to_world(samples.normal[i]));
            if let Some(albedo) = &mut maps.albedo {
                let c = cloud.colors()[samples.index[i] as usize];
                albedo.data[3 * i..3 * i + 3].copy_from_slice(&c.to_array());
            }
        }
        maps
    }

    pub(super) fn set_normal(&mut self, i: usize, n: Vec3f) {
        self.normal.data[3 * i..3 * i + 3].copy_from_slice(&n.to_array());
    }

    /// The layers of a multi-layer OpenEXR file, for [`photofit_image::write_exr`].
    pub fn exr_layers(&self) -> Vec<(&'static str, &Image, &'static [&'static str])> {
        let mut layers: Vec<(&'static str, &Image, &'static [&'static str])> =
            vec![("depth", &self.depth, &["Z"]), ("normal", &self.normal, &["X", "Y", "Z"])];
        if let Some(albedo) = &self.albedo {
            layers.push(("albedo", albedo, &["R", "G", "B"]));
        }
        layers
    }
}
