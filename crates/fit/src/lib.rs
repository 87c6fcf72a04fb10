//! Fitting 3D assets to images: the tasks that join the other crates.
//!
//! [`simplify`] takes a heavy asset and gives back a light one that looks the same; [`lod`] a chain of such levels of
//! detail; [`recover`] fits the textures of an asset to pictures of it, [`recover_mesh`] a shape and its colours,
//! [`recover_material`] the materials of a mesh and the light around it through the path tracer,
//! [`retexture`] the textures of a light animated asset to a heavy one in motion, [`recover_scene`] materials, lights and
//! media of a scene through the path tracer, [`recover_volume`] a cloud on a grid from pictures alone, [`traced_maps`] the
//! maps of a light asset through the path tracer. All are assembled from the parts in [`engine`].

pub mod bake;
pub mod candidate;
pub mod compare;
pub mod engine;
mod error;
pub mod footprint;
pub mod guiding;
pub mod lod;
pub mod outline;
pub mod pictures;
mod progress;
pub mod recover;
pub mod recover_material;
pub mod recover_mesh;
pub mod recover_scene;
pub mod recover_volume;
pub mod report;
pub mod retexture;
pub mod scene_render;
pub mod simplify;
#[cfg(test)]
mod texture_agreement;
pub mod traced_maps;
pub mod visibility;

pub use engine::views;
pub use error::{Difference, FitError};
pub use progress::{Progress, Silent};
