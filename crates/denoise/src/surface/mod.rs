//! Surfaces from points: dense depth, normals and colours of a point cloud as one camera sees it.

mod attributes;
mod blend;
mod camera;
mod cloud;
mod error;
mod interpolate;
mod maps;
mod neighbors;
mod normal_target;
mod options;
mod orient;
mod preview;
mod pull_push;
mod reconstruct;
mod render;
mod solve;
mod splat;
pub mod synthetic;
#[cfg(test)]
mod tests;
mod window;

pub use blend::{BlendOptions, blend, blend_weight, box_mean, guided_filter, local_variance};
pub use camera::Pinhole;
pub use cloud::Cloud;
pub use error::SurfaceError;
pub use interpolate::{InterpolateOptions, fill_channels, interpolate};
pub use maps::Maps;
pub use normal_target::normal_target;
pub use options::{Method, SurfaceOptions, Weights};
pub use preview::{
    albedo_preview, before_after_sheet, depth_preview, depth_range, normal_preview, shaded_preview,
};
pub use pull_push::{PullPushOptions, pull_push};
pub use reconstruct::{Figures, Surface, reconstruct};
pub use render::{Samples, render_points};
pub use splat::{SplatRadius, prune, splat_depth};
