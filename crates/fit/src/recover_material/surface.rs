//! The surface that is painted: the shape of an asset with blank maps of its own.

use super::RecoverMaterialOptions;
use crate::engine::Normalised;
use crate::engine::export::{atlas_slot, to_scene};
use crate::recover::{bare, grey};
use crate::{FitError, Progress};
use photofit_image::linear_to_srgb_u8;
use photofit_scene::{Material, Scene, TextureImage, TextureSlot, Wrap};

/// What all materials start from: base colour, roughness, metalness.
const START: [f32; 3] = [0.5, 0.5, 0.0];

/// A scene of the same shape whose materials have maps that pictures may paint, and whether it has texture coordinates of its
/// own making. Those of the asset are kept where all of its parts have some, with a set of maps for each of its materials; else,
/// or where the options ask for it, it gets an atlas with one set.
///
/// # Errors
/// An asset without a surface, or one that cannot be unwrapped.
pub(super) fn blank(
    mesh: &Scene,
    options: &RecoverMaterialOptions,
    progress: &dyn Progress,
) -> Result<(Scene, bool), FitError> {
    mesh.validate_for_fit()?;
    let has_uvs = |i: usize| {
        let mesh = &mesh.primitives[i].mesh;
        mesh.uvs.len() == mesh.positions.len()
    };
    if !options.unwrap && mesh.instances.iter().all(|i| has_uvs(i.primitive)) {
        return Ok((with_own_uvs(mesh, options), false));
    }
    let n = Normalised::new(&bare(mesh, false))?;
    let shape = (&n.flat.mesh, &n.triangle_classes()[..]);
    let surface = grey(&n.light_asset, shape, true, options.texture_size, progress)?;
    let mut scene = to_scene(&surface.candidate, &n.light_asset);
    scene.images.clear();
    let slots = slots(&mut scene.images, options, "");
    for material in &mut scene.materials {
        *material = dressed(material, &slots, Wrap::ClampToEdge);
    }
    Ok((scene, true))
}

fn with_own_uvs(mesh: &Scene, options: &RecoverMaterialOptions) -> Scene {
    let mut scene = Scene { images: Vec::new(), hierarchy: None, ..mesh.clone() };
    scene.primitives.iter_mut().for_each(|p| p.mesh.colors.clear());
    for (i, material) in scene.materials.iter_mut().enumerate() {
        let of = |k: &photofit_scene::Instance| &mesh.primitives[k.primitive];
        let parts: Vec<_> = mesh.instances.iter().map(of).filter(|p| p.material == i).collect();
        if parts.is_empty() {
            *material = Material { name: material.name.clone(), ..Material::clay() };
            continue;
        }
        let inside = |x: f32| (0.0..=1.0).contains(&x);
        let unit = parts.iter().flat_map(|p| &p.mesh.uvs).all(|uv| inside(uv.x) && inside(uv.y));
        let slots = slots(&mut scene.images, options, &material.name);
        *material = dressed(material, &slots, if unit { Wrap::ClampToEdge } else { Wrap::Repeat });
    }
    scene
}

/// Adds the images of a set of maps; their slots.
fn slots(
    images: &mut Vec<TextureImage>,
    options: &RecoverMaterialOptions,
    of: &str,
) -> [Option<TextureSlot>; 3] {
    let [color, roughness, metallic] = START;
    let unorm = |x: f32| (255.0 * x + 0.5) as u8;
    let grey = linear_to_srgb_u8(color);
    let kinds = [
        ("base-color", [grey, grey, grey, 255], true),
        ("roughness-metallic", [255, unorm(roughness), unorm(metallic), 255], true),
        ("normal", [128, 128, 255, 255], options.normal_map),
    ];
    kinds.map(|(kind, texel, wanted)| {
        wanted.then(|| {
            let size = options.texture_size;
            images.push(TextureImage {
                name: if of.is_empty() { kind.into() } else { format!("{of}-{kind}") },
                width: size,
                height: size,
                texels: vec![texel; size * size],
                ..TextureImage::default()
            });
            atlas_slot(images.len() - 1)
        })
    })
}

/// An opaque material that is all maps; name and sides stay.
fn dressed(material: &Material, slots: &[Option<TextureSlot>; 3], wrap: Wrap) -> Material {
    let [base_color_texture, metallic_roughness_texture, normal_texture] = slots.map(|slot| {
        slot.map(|mut slot| {
            (slot.sampler.wrap_u, slot.sampler.wrap_v) = (wrap, wrap);
            slot
        })
    });
    Material {
        name: material.name.clone(),
        double_sided: material.double_sided,
        base_color_texture,
        metallic_roughness_texture,
        normal_texture,
        ..Material::default()
    }
}
