//! Depth, normals and colours as images.

use super::{Cloud, Pinhole, Samples};
use photofit_image::Image;
use photofit_scalar::Vec3f;
use rayon::prelude::*;

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
        let rows = |image: &mut Image, value: &(dyn Fn(usize) -> Vec3f + Sync)| {
            image.data.par_chunks_mut(3 * w).enumerate().for_each(|(y, row)| {
                for (x, out) in row.chunks_exact_mut(3).enumerate() {
                    if samples.is_valid(y * w + x) {
                        out.copy_from_slice(&value(y * w + x).to_array());
                    }
                }
            });
        };
        rows(&mut maps.normal, &|i| camera.direction_to_world(samples.normal[i]));
        if let Some(albedo) = &mut maps.albedo {
            rows(albedo, &|i| cloud.colors()[samples.index[i] as usize]);
        }
        maps
    }

    /// The layers of a multi-layer OpenEXR file, for `photofit_image::write_exr` (its feature `files`).
    pub fn exr_layers(&self) -> Vec<(&'static str, &Image, &'static [&'static str])> {
        let mut layers: Vec<(&'static str, &Image, &'static [&'static str])> =
            vec![("depth", &self.depth, &["Z"]), ("normal", &self.normal, &["X", "Y", "Z"])];
        if let Some(albedo) = &self.albedo {
            layers.push(("albedo", albedo, &["R", "G", "B"]));
        }
        layers
    }
}
