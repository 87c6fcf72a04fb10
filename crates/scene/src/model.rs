//! The scene: primitives, their placements, materials and images.

use crate::{Camera, Material};
use photofit_geometry::Mesh;

/// An 8-bit image of a texture, RGBA, row 0 at the top; its encoding follows from the slot that uses it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TextureImage {
    /// Name in the file.
    pub name: String,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `height * width` texels.
    pub texels: Vec<[u8; 4]>,
}

/// A mesh with one material.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Primitive {
    /// Geometry in its own frame.
    pub mesh: Mesh,
    /// Index into [`Scene::materials`].
    pub material: usize,
}

/// A placed primitive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instance {
    /// Index into [`Scene::primitives`].
    pub primitive: usize,
    /// Own frame to world.
    pub transform: glam::Affine3A,
}

/// An asset in memory.
///
/// Invariant: every index is in range (loaders check it).
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// Name, usually the file's stem.
    pub name: String,
    /// Meshes with one material each.
    pub primitives: Vec<Primitive>,
    /// Placements; the same primitive may appear many times.
    pub instances: Vec<Instance>,
    /// Materials.
    pub materials: Vec<Material>,
    /// Texture images.
    pub images: Vec<TextureImage>,
    /// Cameras of the file, in world space.
    pub cameras: Vec<Camera>,
}
