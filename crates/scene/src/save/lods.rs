//! Levels of detail in one file: `MSFT_lod`.

use super::{Compression, Writer, extensions, geometry, material, write, write_camera};
use crate::error::{Fault, fault};
use crate::nodes::Hierarchy;
use crate::{Scene, SceneError};
use geometry::Morphed;
use serde_json::json;
use std::collections::BTreeMap;
use std::path::Path;

/// Writes levels of detail of one asset as one `.glb`, finest first, with `MSFT_lod`: the scene lists the node of the
/// finest level, which names those of the others. Readers without the extension show the finest level alone. Cameras,
/// lights and what the file says about itself are those of the finest level; of node hierarchies morph targets alone are written,
/// with the weights, names and extras of their meshes, where no skin moves them.
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
    let morphed = morphed(levels);
    let (mut nodes, mut first) = (Vec::with_capacity(levels.len()), 0);
    for (k, end) in ends.into_iter().enumerate() {
        geometry::write(&merged, &merged.instances[first..end], &morphed, &mut writer)?;
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

/// The primitives of all levels as one scene that have morph targets and no skin.
fn morphed(levels: &[Scene]) -> BTreeMap<usize, Morphed<'_>> {
    let (mut out, mut first) = (BTreeMap::new(), 0);
    for level in levels {
        let placed = level.hierarchy.iter().flat_map(|h| level.instances.iter().zip(placed(h)));
        out.extend(placed.filter_map(|(i, morphed)| Some((first + i.primitive, morphed?))));
        first += level.primitives.len();
    }
    out
}

/// What nodes place, where it has morph targets and no skin.
fn placed(hierarchy: &Hierarchy) -> impl Iterator<Item = Option<Morphed<'_>>> {
    hierarchy.placements.iter().map(|place| {
        let node = &hierarchy.nodes[place.node];
        let mesh = &hierarchy.meshes[node.mesh.filter(|_| node.skin.is_none())?];
        let bind = mesh.primitives[place.part].bind.as_ref()?;
        (!bind.targets.is_empty()).then_some(Morphed { bind, mesh })
    })
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
    use crate::{
        Bind, Instance, Material, MorphTarget, Precision, Primitive, TextureImage, TextureSlot, load,
    };
    use photofit_geometry::shapes;
    use serde_json::Value;

    /// A sphere with a picture of one colour; every other level has two parts.
    fn level(frequency: u32, color: u8, parts: usize) -> Scene {
        let mut mesh = shapes::icosphere(frequency);
        mesh.uvs = mesh.positions.iter().map(|p| photofit_scalar::vec2(p.x, p.y)).collect();
        let slot = TextureSlot::new(0);
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
    fn morph_targets_of_levels_are_written() {
        for compression in [Compression::None, Compression::Meshopt(Precision::Fine)] {
            let dir = tempfile::tempdir().unwrap();
            let path = dir.path().join("a.glb");
            // Through a file, which has a hierarchy.
            let mut levels = [level(3, 10, 2), level(1, 20, 1)].map(|scene| {
                crate::save_glb(&path, &scene).unwrap();
                load(&path).unwrap()
            });
            let outward = |scene: &mut Scene, weight: f32| {
                let hierarchy = std::sync::Arc::make_mut(scene.hierarchy.as_mut().unwrap());
                for mesh in &mut hierarchy.meshes {
                    (mesh.weights, mesh.extras) = (vec![weight], Some(json!({"targetNames": ["out"]})));
                    for part in &mut mesh.primitives {
                        let mesh = scene.primitives[part.primitive].mesh.clone();
                        let positions = mesh.positions.iter().map(|p| *p * 0.5).collect();
                        let targets = vec![MorphTarget { positions, ..MorphTarget::default() }];
                        part.bind = Some(Bind { mesh, targets, ..Bind::default() });
                    }
                }
            };
            outward(&mut levels[0], 0.0);
            save_glb_lods(&path, &levels, &[0.1, 0.0], compression).unwrap();
            let json = document(&std::fs::read(&path).unwrap());
            let targets: Vec<usize> = json["meshes"]
                .as_array()
                .unwrap()
                .iter()
                .map(|m| m["primitives"][0]["targets"].as_array().map_or(0, Vec::len))
                .collect();
            assert_eq!(targets, [1, 1, 0], "both parts of the first level, and not the second");
            assert_eq!(json["meshes"][1]["extras"]["targetNames"], json!(["out"]));
            let mut read = load(&path).unwrap();
            let radius = |scene: &Scene| {
                let mesh = &scene.primitives[scene.instances[1].primitive].mesh;
                mesh.positions.iter().map(|p| p.length()).fold(0.0, f32::max)
            };
            assert!((radius(&read) - 1.0).abs() < 1e-3);
            let hierarchy = std::sync::Arc::make_mut(read.hierarchy.as_mut().unwrap());
            hierarchy.meshes.iter_mut().for_each(|m| m.weights = vec![1.0]);
            let pose = read.pose(None, 0.0);
            read.set_pose(pose);
            assert!((radius(&read) - 1.5).abs() < 1e-3, "{}", radius(&read));
        }
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
