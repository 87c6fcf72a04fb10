//! Cameras, lights, materials and asset files.

mod camera;
mod flat;
mod material;
mod model;

pub use camera::Camera;
pub use flat::FlatScene;
pub use material::{AlphaMode, Filter, Material, Sampler, TextureSlot, Wrap};
pub use model::{Instance, Primitive, Scene, TextureImage};
