//! The scene as one mesh in world space.

use photofit_geometry::Mesh;

/// All instances of a scene as one world-space mesh; built by [`crate::Scene::flatten`].
///
/// Attributes are present for all vertices when any primitive has them (absent ones are filled: normals and tangents
/// computed, uv zero, colours white).
#[derive(Clone, Debug, Default)]
pub struct FlatScene {
    /// World-space geometry.
    pub mesh: Mesh,
    /// Index into [`crate::Scene::materials`] for each triangle.
    pub triangle_material: Vec<u32>,
}
