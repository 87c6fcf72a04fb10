//! The registry of golden images: name, file format, tolerance and the function that makes the image.

mod geometry;
mod image;
mod raster;
mod sampling;
mod scene;
mod shading;

use photofit_image::Image;

use crate::store::Format;
use crate::tolerances::{EDGES, EXACT, LIBRARY_FUNCTIONS, METRICS, Tolerance};

/// One golden image.
#[derive(Debug)]
pub struct Case {
    /// Name of the case and of its file, lower case with hyphens.
    pub name: &'static str,
    /// How the image is stored.
    pub format: Format,
    /// How far it may lie from the file.
    pub tolerance: Tolerance,
    /// Makes the image, by the CPU path, without reading files.
    pub make: fn() -> Image,
}

const fn png(name: &'static str, tolerance: Tolerance, make: fn() -> Image) -> Case {
    Case { name, format: Format::Png, tolerance, make }
}

const fn exr(name: &'static str, tolerance: Tolerance, make: fn() -> Image) -> Case {
    Case { name, format: Format::Exr, tolerance, make }
}

/// All golden images.
pub const CASES: &[Case] = &[
    png("image-pyramid", EXACT, image::pyramid_levels),
    png("image-resize", EXACT, image::resized),
    png("image-srgb-heat", LIBRARY_FUNCTIONS, image::srgb_heat),
    exr("image-flip", METRICS, image::flip_map),
    exr("image-ssim", METRICS, image::ssim_map),
    png("sampling-sobol", EXACT, sampling::sobol),
    png("sampling-cosine", EDGES, sampling::cosine),
    png("geometry-atlas", EDGES, geometry::atlas),
    png("geometry-decimate", EDGES, geometry::decimated),
    png("raster-normals", EDGES, raster::normals),
    png("raster-texture", EDGES, raster::textured_floor),
    png("raster-antialias", EDGES, raster::silhouettes),
    png("raster-layers", EDGES, raster::depth_layers),
    exr("shading-point", LIBRARY_FUNCTIONS, shading::point_light),
    exr("shading-ambient", LIBRARY_FUNCTIONS, shading::ambient_light),
    exr("shading-environment", LIBRARY_FUNCTIONS, shading::environment_light),
    png("scene-materials", EDGES, scene::materials),
    png("raster-deferred", EDGES, scene::deferred),
];
