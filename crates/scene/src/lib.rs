//! Cameras, lights, materials and asset files.
//!
//! [`load`] reads a glTF, OBJ or PLY asset into a [`Scene`]; [`Scene::flatten`] makes one world-space mesh of it.

mod camera;
mod error;
mod flat;
mod load;
mod material;
mod model;

pub use camera::Camera;
pub use error::SceneError;
pub use flat::FlatScene;
pub use load::{Limits, MAX_COORDINATE, load, load_with};
pub use material::{AlphaMode, Filter, Material, Sampler, TextureSlot, Wrap};
pub use model::{Instance, MAX_FLAT, Memory, Primitive, Scene, TextureImage};
