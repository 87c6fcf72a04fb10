//! Levels of detail in one file: `MSFT_lod`.

use super::{Compression, Writer, extensions, geometry, material, write, write_camera};
use crate::error::{Fault, fault};
use crate::{Scene, SceneError};
use serde_json::json;
use std::path::Path;

/// Writes levels of detail of one asset as one `.glb`, finest first, with `MSFT_lod`: the scene lists the node of the
/// finest level, which names those of the others. Readers without the extension show the finest level alone. Cameras,
/// lights and what the file says about itself are those of the finest level; node hierarchies are not written.
///
/// `coverage` goes into the extras `MSFT_screencoverage`: for each level the smallest share of the screen that the asset
/// covers while this level is shown, falling; 0 for the last: it never vanishes.
///
/// # Errors
/// If a scene is not valid (see [`Scene::validate`]), there is not one coverage in `[0, 1]` for each level, falling, the
/// file would be larger than 4 GiB, or it cannot be written.
pub fn save_glb_lods(
    path: impl AsRef<Path>,
    levels: &[Scene],
    coverage: &[f64],
    compression: Compression,
) -> Result<(), SceneError> {
    levels.iter().try_for_each(Scene::validate)?;
    let bytes = encode(levels, coverage, compression).map_err(Fault::in_scene)?;
    write(path.as_ref(), &bytes)
}

fn encode(levels: &[Scene], coverage: &[f64], compression: Compression) -> Result<Vec<u8>, Fault> {
    let Some(finest) = levels.first() else {
        return Err(fault("the levels of detail", "are none; there must be at least one"));
    };
    if coverage.len() != levels.len() {
        let rule = format!("are {} for {} levels; there must be one for each", coverage.len(), levels.len());
        return Err(fault("the screen coverages", rule));
    }
    let falling = coverage.windows(2).all(|w| w[0] > w[1]);
    if !falling || !coverage.iter().all(|c| (0.0..=1.0).contains(c)) {
        let rule = format!("are {coverage:?}; they must fall, within 0 and 1");
        return Err(fault("the screen coverages", rule));
    }
    let (merged, ends) = merged(levels);
    let mut writer = Writer::new(compression, merged.primitives.iter().map(|p| &p.mesh));
    let (mut nodes, mut first) = (Vec::with_capacity(levels.len()), 0);
    for (k, end) in ends.into_iter().enumerate() {
        geometry::write(&merged, &merged.instances[first..end], &mut writer)?;
        // The node of a level stands for all of it; the scene does not list its parts.
        let parts = std::mem::take(&mut writer.roots);
        nodes.push(writer.nodes.len());
        writer.nodes.push(match parts.is_empty() {
            true => json!({"name": format!("level {k}")}),
            false => json!({"name": format!("level {k}"), "children": parts}),
        });
        first = end;
    }
    let root = &mut writer.nodes[nodes[0]];
    if nodes.len() > 1 {
        root["extensions"] = json!({"MSFT_lod": {"ids": nodes[1..]}});
        root["extras"] = json!({"MSFT_screencoverage": coverage});
        writer.extensions.insert("MSFT_lod");
    }
    writer.roots.push(nodes[0]);
    finest.cameras.iter().for_each(|c| write_camera(c, &mut writer));
    extensions::write_lights(&finest.lights, &mut writer)?;
    material::write(&merged, &mut writer)?;
    writer.finish(&merged)
}

/// All levels as one scene, and where the instances of each end.
fn merged(levels: &[Scene]) -> (Scene, Vec<usize>) {
    let mut out = Scene { name: levels[0].name.clone(), about: levels[0].about.clone(), ..Scene::default() };
    let mut ends = Vec::with_capacity(levels.len());
    for level in levels {
        let [primitives, materials, images] = [out.primitives.len(), out.materials.len(), out.images.len()];
        out.images.extend_from_slice(&level.images);
        out.materials.extend_from_slice(&level.materials);
        for m in &mut out.materials[materials..] {
            m.texture_slots_mut().for_each(|slot| slot.image += images);
        }
        out.primitives.extend_from_slice(&level.primitives);
        out.primitives[primitives..].iter_mut().for_each(|p| p.material += materials);
        out.instances.extend_from_slice(&level.instances);
        let added = out.instances.len() - level.instances.len();
        out.instances[added..].iter_mut().for_each(|i| i.primitive += primitives);
        ends.push(out.instances.len());
    }
    (out, ends)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Instance, Material, Primitive, Sampler, TextureImage, TextureSlot, load};
    use photofit_geometry::shapes;
    use serde_json::Value;

    /// A sphere with a picture of one colour; every other level has two parts.
    fn level(frequency: u32, color: u8, parts: usize) -> Scene {
        let mut mesh = shapes::icosphere(frequency);
        mesh.uvs = mesh.positions.iter().map(|p| photofit_scalar::vec2(p.x, p.y)).collect();
        let slot = TextureSlot {
            image: 0,
            sampler: Sampler::default(),
            tex_coord: 0,
            transform: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        };
        let material = Material { base_color_texture: Some(slot), ..Material::clay() };
        let image = TextureImage { width: 1, height: 1, texels: vec![[color; 4]], ..TextureImage::default() };
        let instance = |primitive| Instance { primitive, transform: glam::Affine3A::IDENTITY };
        Scene {
            primitives: vec![Primitive { mesh, material: 0 }; parts],
            instances: (0..parts).map(instance).collect(),
            materials: vec![material],
            images: vec![image],
            ..Scene::default()
        }
    }

    fn document(bytes: &[u8]) -> Value {
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        serde_json::from_slice(&bytes[20..20 + length]).unwrap()
    }

    #[test]
    fn every_level_has_its_own_mesh_and_texture() {
        let levels = [level(4, 10, 1), level(2, 20, 2), level(1, 30, 1)];
        let json = document(&encode(&levels, &[0.25, 0.01, 0.0], Compression::None).unwrap());
        let nodes = json["nodes"].as_array().unwrap();
        let root = json["scenes"][0]["nodes"].as_array().unwrap();
        assert_eq!(root.len(), 1, "other levels are no part of the scene");
        let finest = &nodes[root[0].as_u64().unwrap() as usize];
        assert_eq!(finest["extras"]["MSFT_screencoverage"], json!([0.25, 0.01, 0.0]));
        let mut ids = vec![root[0].clone()];
        ids.extend(finest["extensions"]["MSFT_lod"]["ids"].as_array().unwrap().iter().cloned());
        assert_eq!(ids.len(), 3);
        assert_eq!(json["extensionsUsed"], json!(["MSFT_lod"]));
        for (k, id) in ids.iter().enumerate() {
            let parts = nodes[id.as_u64().unwrap() as usize]["children"].as_array().unwrap();
            assert_eq!(parts.len(), levels[k].instances.len());
            for part in parts {
                let at = |v: &Value, i: &Value| v[i.as_u64().unwrap() as usize].clone();
                let mesh = at(&json["meshes"], &at(&json["nodes"], part)["mesh"]);
                let primitive = &mesh["primitives"][0];
                let indices = at(&json["accessors"], &primitive["indices"])["count"].clone();
                assert_eq!(indices, json!(3 * levels[k].primitives[0].mesh.triangles.len()));
                let material = at(&json["materials"], &primitive["material"]);
                let texture =
                    at(&json["textures"], &material["pbrMetallicRoughness"]["baseColorTexture"]["index"]);
                assert_eq!(texture["source"], json!(k), "level {k}");
            }
        }
    }

    #[test]
    fn other_readers_show_the_finest_level() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("lods.glb");
        save_glb_lods(&path, &[level(3, 1, 2), level(1, 2, 1)], &[0.1, 0.0], Compression::None).unwrap();
        assert_eq!(load(&path).unwrap().triangle_count(), 2 * 20 * 9);
    }

    #[test]
    fn coverages_are_checked() {
        let levels = [level(2, 1, 1), level(1, 2, 1)];
        for (coverage, part) in [
            (&[0.1][..], "one for each"),
            (&[0.1, 0.1], "must fall"),
            (&[2.0, 0.0], "within 0 and 1"),
            (&[f64::NAN, 0.0], "must fall"),
        ] {
            let text = encode(&levels, coverage, Compression::None)
                .map_err(Fault::in_scene)
                .unwrap_err()
                .to_string();
            assert!(text.contains(part), "{coverage:?}: {text}");
        }
        assert!(encode(&[], &[], Compression::None).is_err());
    }
}
