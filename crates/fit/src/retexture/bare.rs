//! The light asset as what its maps are painted on.

use crate::FitError;
use photofit_geometry::Mesh;
use photofit_scalar::Vec2f;
use photofit_scene::{Material, Primitive, Scene, TextureSlot};
use std::collections::BTreeSet;
use std::sync::Arc;

/// How far texture coordinates may lie outside of the unit square: what programs that pack them lose by rounding.
const ROUNDING: f32 = 1e-3;

/// The first texture of a material, which tells where all of them are read.
fn slot_of(material: &Material) -> Option<&TextureSlot> {
    let Material { base_color_texture, metallic_roughness_texture, normal_texture, .. } = material;
    let slots = [base_color_texture, metallic_roughness_texture, normal_texture];
    slots.into_iter().chain([&material.emissive_texture, &material.occlusion_texture]).flatten().next()
}

/// Moves texture coordinates to where the textures of a material are read, the maps' place in the unit square; else what
/// they are and must be.
fn move_uvs(mesh: &mut Mesh, material: &Material) -> Result<(), (String, &'static str)> {
    let slot = slot_of(material);
    if slot.is_some_and(|s| s.tex_coord == 1) {
        mesh.uvs = std::mem::take(&mut mesh.uvs1);
    }
    if mesh.uvs.len() != mesh.positions.len() {
        return Err(("no texture coordinates".into(), "they must be there"));
    }
    let [u, v] = slot.map_or([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], |s| s.transform);
    let along = u[0] > 0.0 && v[1] > 0.0 && u[1] == 0.0 && v[0] == 0.0;
    if !along || slot.is_some_and(|s| s.tex_coord == 1) {
        // Those of the file belong to the other coordinates.
        mesh.tangents.clear();
    }
    for uv in &mut mesh.uvs {
        let read = [u, v].map(|row: [f32; 3]| row[0] * uv.x + row[1] * uv.y + row[2]);
        if !read.iter().all(|x| (-ROUNDING..=1.0 + ROUNDING).contains(x)) {
            return Err((format!("the texture coordinates {read:?}"), "they must lie in the unit square"));
        }
        *uv = Vec2f::from_array(read.map(|x| x.clamp(0.0, 1.0)));
    }
    Ok(())
}

/// The light asset without materials, which its maps will be.
pub(super) fn bare(light: &Scene) -> Result<Scene, FitError> {
    let wrong = |i: usize, is: &str, must: &str| {
        Err(FitError::Setting { field: "light_asset", rule: format!("has {is} in primitive {i}; {must}") })
    };
    let (mut primitives, mut hierarchy) = (light.primitives.clone(), light.hierarchy.clone());
    let placed: BTreeSet<usize> = light.instances.iter().map(|i| i.primitive).collect();
    for i in placed {
        let Primitive { mesh, material } = &mut primitives[i];
        move_uvs(mesh, &light.materials[*material]).or_else(|(is, must)| wrong(i, &is, must))?;
    }
    // Meshes with skins or morph targets are written from what is posed.
    for part in
        hierarchy.iter_mut().flat_map(|h| &mut Arc::make_mut(h).meshes).flat_map(|m| &mut m.primitives)
    {
        if let Some(bind) = &mut part.bind {
            let material = &light.materials[light.primitives[part.primitive].material];
            let moved = move_uvs(&mut bind.mesh, material);
            moved.or_else(|(is, must)| wrong(part.primitive, &is, must))?;
        }
    }
    let mut out = Scene {
        name: light.name.clone(),
        primitives,
        instances: light.instances.clone(),
        materials: vec![Material::clay()],
        hierarchy,
        ..Scene::default()
    };
    out.primitives.iter_mut().for_each(|p| p.material = 0);
    Ok(out)
}
