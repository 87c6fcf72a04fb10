//! What the written file holds: bytes of each part, materials, texel density, and what of the asset it does not keep.

use super::page::{bytes, count, counted, escape};
use photofit_scene::{AlphaMode, Material, Scene};
use serde_json::Value;

/// Names of parts and their bytes; they add up to the file.
pub(super) type Parts = Vec<(String, u64)>;

/// The parts of a binary glTF file: geometry, one for each map, the description.
///
/// `None` for bytes that are no such file.
pub(super) fn parts(glb: &[u8]) -> Option<Parts> {
    let word = |at: usize| Some(u32::from_le_bytes(glb.get(at..at + 4)?.try_into().ok()?) as usize);
    if glb.get(..4)? != b"glTF" || glb.get(16..20)? != b"JSON" {
        return None;
    }
    let json: Value = serde_json::from_slice(glb.get(20..20_usize.checked_add(word(12)?)?)?).ok()?;
    let list = |name: &str| json.get(name).and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    // Of compressed views the file holds the bytes that their extension names.
    let size = |view: &Value| {
        let compressed = view.pointer("/extensions/EXT_meshopt_compression");
        compressed.unwrap_or(view).get("byteLength").and_then(Value::as_u64).unwrap_or(0)
    };
    let views = list("bufferViews");
    let mut out: Parts = Vec::new();
    let mut maps = 0_u64;
    for image in list("images") {
        let view = image.get("bufferView").and_then(Value::as_u64).and_then(|v| views.get(v as usize));
        let bytes = view.map_or(0, size);
        let name = image.get("name").and_then(Value::as_str).unwrap_or("map");
        // Of new maps; images of the asset have names of their own.
        let name = if name == "base-color" { "base colour".to_owned() } else { name.to_owned() };
        match out.iter_mut().find(|p| p.0 == name) {
            Some(part) => part.1 += bytes,
            None => out.push((name, bytes)),
        }
        maps += bytes;
    }
    let geometry = views.iter().map(size).sum::<u64>().checked_sub(maps)?;
    out.insert(0, ("geometry".into(), geometry));
    out.push(("description".into(), (glb.len() as u64).checked_sub(geometry + maps)?));
    Some(out)
}

/// Texels per unit of length of the base colour: the square root of texels per area, over all surfaces that have such a
/// texture. `None` where none has.
pub(super) fn texel_density(scene: &Scene) -> Option<f64> {
    let (mut texels, mut area) = (0.0, 0.0);
    for instance in &scene.instances {
        let primitive = &scene.primitives[instance.primitive];
        let slot = scene.materials.get(primitive.material).and_then(|m| m.base_color_texture);
        let Some(slot) = slot else { continue };
        let (image, mesh) = (&scene.images[slot.image], &primitive.mesh);
        let uvs = if slot.tex_coord == 0 { &mesh.uvs } else { &mesh.uvs1 };
        if uvs.is_empty() {
            continue;
        }
        let [[a, b, _], [c, d, _]] = slot.transform.map(|row| row.map(f64::from));
        let size = image.width as f64 * image.height as f64 * (a * d - b * c).abs();
        let world = |i: u32| {
            let p = mesh.positions[i as usize];
            instance.transform.transform_point3(glam::vec3(p.x, p.y, p.z))
        };
        for [a, b, c] in &mesh.triangles {
            let (p, q, r) = (world(*a), world(*b), world(*c));
            area += 0.5 * f64::from((q - p).cross(r - p).length());
            let [p, q, r] = [a, b, c].map(|i| uvs[*i as usize]);
            texels += 0.5 * size * f64::from((q.x - p.x) * (r.y - p.y) - (q.y - p.y) * (r.x - p.x)).abs();
        }
    }
    (area > 0.0 && texels > 0.0).then(|| (texels / area).sqrt())
}

/// The section: bytes of the parts, materials, what is left out and what was not fitted.
pub(super) fn section(
    parts: Option<&Parts>,
    asset: &Scene,
    light: &Scene,
    [left_out, not_fitted]: [&[String]; 2],
) -> String {
    let mut out = "<h2>What the file holds</h2>\n<div class=pair>\n".to_owned();
    if let Some(parts) = parts {
        let total = parts.iter().map(|p| p.1).sum::<u64>();
        let row = |(name, n): &(String, u64)| {
            let share = 100.0 * *n as f64 / total.max(1) as f64;
            format!("<tr><th>{}</th><td>{}</td><td>{share:.0} %</td></tr>\n", escape(name), bytes(*n))
        };
        let rows: String = parts.iter().map(row).collect();
        out += &format!(
            "<table>\n<tr><th>part</th><th>bytes</th><th>share</th></tr>\n{rows}<tr><th>file</th><td>{}</td>\
             <td></td></tr>\n</table>\n",
            bytes(total)
        );
    }
    let row = |(k, m): (usize, &Material)| {
        let name = if m.name.is_empty() { format!("material {}", k + 1) } else { m.name.clone() };
        format!("<tr><th>{}</th><td class=what>{}</td></tr>\n", escape(&name), escape(&describe(m)))
    };
    let rows: String = light.materials.iter().enumerate().map(row).collect();
    let (before, after) = (asset.materials.len(), light.materials.len());
    out += &format!(
        "<div><table>\n<tr><th>material</th><th></th></tr>\n{rows}</table>\n<p class=note>{} of the asset became {}.\
         </p></div>\n</div>\n",
        counted(before, "material"),
        count(after)
    );
    let list = |title: &str, lines: &[String]| {
        let lines: String = lines.iter().map(|l| format!("<li>{}</li>\n", escape(l))).collect();
        format!("<h3>{title}</h3>\n<ul class=left>\n{lines}</ul>\n")
    };
    if left_out.is_empty() {
        out += "<p class=note>Nothing that was read of the asset was left out.</p>\n";
    } else {
        out += &list("Left out", left_out);
    }
    if !not_fitted.is_empty() {
        out += &list("Kept, but not drawn while fitting", not_fitted);
    }
    if !asset.warnings.is_empty() {
        out += &list("Not read, or repaired", &asset.warnings);
    }
    out
}

/// What is special about a material, in words.
fn describe(m: &Material) -> String {
    let alpha = match m.alpha_mode {
        AlphaMode::Opaque => "opaque".to_owned(),
        AlphaMode::Mask { cutoff } => format!("cut out at alpha {cutoff}"),
        AlphaMode::Blend => "blended".to_owned(),
    };
    let maps: Vec<&str> = m.textures().map(|(name, _)| name).collect();
    let mut words = vec![alpha];
    words.extend(m.double_sided.then(|| "double-sided".to_owned()));
    words.extend(m.unlit.then(|| "unlit".to_owned()));
    words.extend((!maps.is_empty()).then(|| format!("maps: {}", maps.join(", "))));
    let extensions = m.extensions.as_ref().map_or_else(Vec::new, |e| e.names());
    words.extend((!extensions.is_empty()).then(|| format!("extensions: {}", extensions.join(", "))));
    words.join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Affine3A, Vec3};
    use photofit_geometry::Mesh;
    use photofit_scalar::{vec2, vec3};
    use photofit_scene::{Instance, Primitive, TextureImage, TextureSlot, to_glb};

    /// A square of 2 units whose texture coordinates cover a quarter of a 64 x 32 texture.
    fn square() -> Scene {
        let corners = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)];
        let mesh = Mesh {
            positions: corners.iter().map(|(x, y)| vec3(*x, *y, 0.0)).collect(),
            normals: vec![vec3(0.0, 0.0, 1.0); 4],
            uvs: corners.iter().map(|(x, y)| vec2(x / 4.0, y / 4.0)).collect(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Mesh::default()
        };
        let slot = TextureSlot::new(0);
        Scene {
            primitives: vec![Primitive { mesh, material: 0 }],
            instances: vec![Instance { primitive: 0, transform: Affine3A::IDENTITY }],
            materials: vec![Material { base_color_texture: Some(slot), ..Material::default() }],
            images: vec![TextureImage {
                name: "base-color".into(),
                width: 64,
                height: 32,
                texels: (0..2048).map(noise).collect(),
                ..TextureImage::default()
            }],
            ..Scene::default()
        }
    }

    fn noise(i: u32) -> [u8; 4] {
        let h = i.wrapping_mul(0x85eb_ca6b);
        let h = (h ^ (h >> 13)).wrapping_mul(0xc2b2_ae35);
        let [a, b, c, _] = (h ^ (h >> 16)).to_le_bytes();
        [a, b, c, 255]
    }

    #[test]
    fn parts_add_up_to_the_file() {
        let glb = to_glb(&square()).unwrap();
        let parts = parts(&glb).unwrap();
        let names: Vec<&str> = parts.iter().map(|p| p.0.as_str()).collect();
        assert_eq!(names, ["geometry", "base colour", "description"]);
        assert_eq!(parts.iter().map(|p| p.1).sum::<u64>(), glb.len() as u64);
        // Four vertices with position, normal and texture coordinates, and six indices of at least two bytes.
        assert!((140..=200).contains(&parts[0].1), "{parts:?}");
        assert!(parts[1].1 > 1000, "a picture of noise: {parts:?}");
        for cut in [0, 3, 12, 19, 40] {
            assert!(super::parts(&glb[..cut]).is_none(), "{cut} bytes");
        }
    }

    #[test]
    fn parts_of_compressed_geometry_are_those_that_are_stored() {
        use photofit_scene::{Compression, Precision, to_glb_with};
        let (plain, small) = [Compression::None, Compression::Meshopt(Precision::Coarse)]
            .map(|how| to_glb_with(&square(), how).unwrap())
            .into();
        let of = |glb: &[u8]| parts(glb).expect("parts");
        assert_eq!(of(&small).iter().map(|p| p.1).sum::<u64>(), small.len() as u64);
        assert_eq!(of(&small)[1], of(&plain)[1], "the image is the same");
    }

    #[test]
    fn density_is_texels_per_unit() {
        // 512 texels on 4 square units.
        let mut scene = square();
        let density = |s: &Scene| texel_density(s).unwrap();
        assert!((density(&scene) - 128_f64.sqrt()).abs() < 1e-4, "{}", density(&scene));
        scene.instances[0].transform = Affine3A::from_scale(Vec3::splat(2.0));
        assert!((density(&scene) - 32_f64.sqrt()).abs() < 1e-4, "twice as large: half of it");
        if let Some(slot) = &mut scene.materials[0].base_color_texture {
            slot.transform = [[0.0, -2.0, 0.5], [2.0, 0.0, 0.0]];
        }
        assert!((density(&scene) - 128_f64.sqrt()).abs() < 1e-4, "coordinates twice as far apart");
        scene.materials[0].base_color_texture = None;
        assert!(texel_density(&scene).is_none());
    }

    #[test]
    fn materials_and_losses_are_escaped_and_listed() {
        let mut scene = square();
        scene.materials[0].name = "<gold>".into();
        scene.materials[0].alpha_mode = AlphaMode::Mask { cutoff: 0.5 };
        let html = section(None, &scene, &scene, [&["2 animations (run & jump)".into()], &["sheen".into()]]);
        for part in [
            "&lt;gold&gt;",
            "cut out at alpha 0.5; maps: base colour",
            "<li>2 animations (run &amp; jump)</li>",
            "<h3>Kept, but not drawn while fitting</h3>\n<ul class=left>\n<li>sheen</li>",
        ] {
            assert!(html.contains(part), "{part} in {html}");
        }
        assert!(
            section(None, &scene, &scene, [&[]; 2])
                .contains("Nothing that was read of the asset was left out")
        );
        scene.warnings = vec!["normals of <2> faces were made".into()];
        assert!(
            section(None, &scene, &scene, [&[]; 2]).contains("<li>normals of &lt;2&gt; faces were made</li>")
        );
    }
}
