//! Cameras, lights, materials and asset files.
//!
//! [`load`] reads a glTF, OBJ or PLY asset into a [`Scene`]; [`Scene::flatten`] makes one world-space mesh of it.
//! [`Scene::hierarchy`] holds what a glTF places its parts with: nodes, skins, morph targets and animations;
//! [`Scene::pose`] gives the scene at a time of one of these animations.

mod animation;
mod camera;
mod environment;
mod error;
mod extensions;
mod flat;
pub mod graph;
mod left_out;
mod light;
mod load;
mod material;
mod meshopt;
#[cfg(feature = "mitsuba")]
pub mod mitsuba;
mod model;
mod nodes;
mod pose;
mod save;
mod skin;
pub mod surface;
mod surface_points;

pub use animation::{Animation, Channel, Curve, Interpolation, Property};
pub use camera::Camera;
pub use environment::load_environment;
pub use error::SceneError;
pub use extensions::{Anisotropy, Clearcoat, Extensions, Sheen, Specular, Transmission, Volume};
pub use flat::FlatScene;
pub use light::{LightKind, LightPicture, PunctualLight};
pub use load::{
    Limits, MAX_COORDINATE, Points, Sensor, from_glb, load, load_points, load_points_with, load_with,
};
pub use material::{AlphaMode, Filter, Material, Sampler, TextureSlot, Wrap};
pub use model::{
    Instance, MAX_FLAT, Memory, Primitive, Scene, TextureEncoding, TextureImage, VertexAttribute,
};
pub use nodes::{
    AssetInfo, Hierarchy, Lens, Node, NodeCamera, NodeLight, NodeMesh, NodePrimitive, NodeTransform,
    Placement,
};
pub use pose::Pose;
pub use save::{
    Compression, Precision, save_glb, save_glb_lods, save_glb_with, to_glb, to_glb_with, write_glb,
};
pub use skin::{Bind, Influences, MorphTarget, Skin};
#[cfg(feature = "gpu")]
pub use surface::gpu;
pub use surface::{
    ExtensionSample, MapKind, SampleGradient, SampleSink, SurfaceLibrary, SurfacePacket, SurfaceSample,
    UvDerivatives,
};
pub use surface_points::SurfacePoints;
