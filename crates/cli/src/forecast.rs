//! What a fit of an asset would run and what it would skip, read off the asset alone.

use photofit_scene::{AlphaMode, Material, Scene};
use serde_json::{Value, json};
use std::collections::BTreeSet;

/// One pass or piece of data, and whether it is needed.
#[derive(Debug)]
pub(crate) struct Item {
    pub(crate) what: &'static str,
    pub(crate) runs: bool,
    pub(crate) why: String,
}

/// The materials that something visible uses.
fn used(scene: &Scene) -> Vec<&Material> {
    let indices: BTreeSet<usize> =
        scene.instances.iter().map(|i| scene.primitives[i.primitive].material).collect();
    indices.into_iter().map(|m| &scene.materials[m]).collect()
}

fn of(n: usize, total: usize, what: &str) -> String {
    format!("{n} of {total} materials {what}")
}

/// The passes of a fit of this asset. What follows from the baked maps (metalness) is known only when they exist and
/// is told as what may run.
pub(crate) fn forecast(scene: &Scene) -> Vec<Item> {
    let materials = used(scene);
    let total = materials.len();
    let count = |f: &dyn Fn(&Material) -> bool| materials.iter().filter(|m| f(m)).count();
    let meshes = || scene.instances.iter().map(|i| &scene.primitives[i.primitive].mesh);
    let mut items = Vec::new();
    let mut item = |what, runs, why: String| items.push(Item { what, runs, why });

    let masked = count(&|m| matches!(m.alpha_mode, AlphaMode::Mask { .. }));
    let blended = count(&|m| m.alpha_mode == AlphaMode::Blend);
    let transparent = masked + blended > 0;
    item(
        "transparent layers",
        transparent,
        if transparent {
            of(masked + blended, total, "are cut out or blended: layers until nothing shows through")
        } else {
            "every surface is opaque: one layer, no blending".into()
        },
    );
    item(
        "alpha gradients",
        blended > 0,
        if blended > 0 { of(blended, total, "are blended") } else { "nothing is blended".into() },
    );
    let mapped = count(&|m| m.normal_texture.is_some() && !m.unlit);
    item(
        "reference tangents",
        mapped > 0,
        if mapped > 0 {
            of(mapped, total, "have a normal map")
        } else {
            "no material has a normal map".into()
        },
    );
    item("normal map", true, "detail of the reference goes into the normals of the light asset".into());
    let metals = count(&|m| m.metallic > 0.0 && !m.unlit);
    item(
        "metalness gradients",
        metals > 0,
        if metals > 0 {
            of(metals, total, "may be metallic: decided on the baked map")
        } else {
            "no material is metallic".into()
        },
    );
    let emitting = count(&|m| m.unlit || m.emissive.iter().any(|e| *e > 0.0));
    item(
        "emission",
        emitting > 0,
        if emitting > 0 { of(emitting, total, "emit or are unlit") } else { "nothing emits".into() },
    );
    let unlit = count(&|m| m.unlit);
    item("unlit surfaces", unlit > 0, of(unlit, total, "show their base colour as it is"));
    let colored = meshes().any(|m| !m.colors.is_empty());
    item(
        "vertex colours",
        colored,
        if colored { "read, and baked into the base colour" } else { "none" }.into(),
    );
    item_uvs(scene, &materials, &mut items);
    item_textures(scene, &materials, &mut items);
    let mut item = |what, runs, why: &str| items.push(Item { what, runs, why: why.into() });
    item("position gradients", true, "while the shape is fitted; the last phase freezes it");
    item("silhouette search", true, "only where neighbouring pixels show different triangles");
    item("environment sampling", false, "runs with --light env");
    item("occlusion textures", false, "the light asset is judged without indirect light");
    item("volumes", false, "the asset has none");
    items
}

/// Sets of texture coordinates that some texture reads.
fn item_uvs(scene: &Scene, materials: &[&Material], items: &mut Vec<Item>) {
    let read: BTreeSet<u32> = materials.iter().flat_map(|m| slots(m)).map(|s| s.tex_coord).collect();
    let has = |set: u32| {
        scene
            .instances
            .iter()
            .map(|i| &scene.primitives[i.primitive].mesh)
            .any(|m| !(if set == 0 { &m.uvs } else { &m.uvs1 }).is_empty())
    };
    for (set, what) in [(0, "texture coordinates 0"), (1, "texture coordinates 1")] {
        let why = match (has(set), read.contains(&set)) {
            (true, true) => "read by textures; the light asset gets new ones",
            (true, false) => "no texture reads them",
            (false, true) => "missing though a texture reads them: the texel at (0, 0) is shown",
            (false, false) => "none",
        };
        items.push(Item { what, runs: has(set) && read.contains(&set), why: why.into() });
    }
}

fn item_textures(scene: &Scene, materials: &[&Material], items: &mut Vec<Item>) {
    let read: BTreeSet<usize> = materials.iter().flat_map(|m| slots(m)).map(|s| s.image).collect();
    let why = match (read.len(), scene.images.len()) {
        (0, 0) => "none".into(),
        (0, n) => format!("none of {n} images is read"),
        (r, n) => format!("{r} of {n} images are read"),
    };
    items.push(Item { what: "textures", runs: !read.is_empty(), why });
}

/// The texture slots that a fit reads.
fn slots(m: &Material) -> Vec<&photofit_scene::TextureSlot> {
    let lit = [&m.metallic_roughness_texture, &m.normal_texture, &m.emissive_texture];
    let lit = lit.into_iter().filter(|_| !m.unlit);
    [&m.base_color_texture].into_iter().chain(lit).flatten().collect()
}

/// One line per item.
pub(crate) fn text(items: &[Item]) -> String {
    items
        .iter()
        .map(|i| format!("  {} {:<22} {}\n", if i.runs { "run " } else { "skip" }, i.what, i.why))
        .collect()
}

/// The items as JSON.
pub(crate) fn to_json(items: &[Item]) -> Value {
    items.iter().map(|i| json!({ "what": i.what, "runs": i.runs, "why": i.why })).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_geometry::shapes::cube;
    use photofit_scene::{Instance, Primitive};

    fn scene(material: Material) -> Scene {
        Scene {
            primitives: vec![Primitive { mesh: cube(), material: 0 }],
            instances: vec![Instance { primitive: 0, transform: glam::Affine3A::IDENTITY }],
            materials: vec![material],
            ..Scene::default()
        }
    }

    fn runs(scene: &Scene, what: &str) -> bool {
        forecast(scene).iter().find(|i| i.what == what).unwrap_or_else(|| panic!("no item {what}")).runs
    }

    #[test]
    fn passes_follow_from_the_materials() {
        let clay = scene(Material::clay());
        let glass = scene(Material { alpha_mode: AlphaMode::Blend, ..Material::clay() });
        let lamp = scene(Material { emissive: [1.0, 0.0, 0.0], ..Material::clay() });
        let gold = scene(Material { metallic: 1.0, ..Material::clay() });
        for (what, with) in [
            ("transparent layers", &glass),
            ("alpha gradients", &glass),
            ("emission", &lamp),
            ("metalness gradients", &gold),
        ] {
            assert!(!runs(&clay, what), "clay skips {what}");
            assert!(runs(with, what), "{what} runs where it is needed");
        }
        assert!(!runs(&clay, "texture coordinates 0"), "uvs without a texture are skipped");
    }

    #[test]
    fn unplaced_materials_do_not_count() {
        let mut s = scene(Material::clay());
        s.materials.push(Material { alpha_mode: AlphaMode::Blend, ..Material::clay() });
        assert!(!runs(&s, "transparent layers"));
    }
}
