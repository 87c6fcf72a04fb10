//! Material extensions and lights.

use super::material::{Tables, info};
use super::{Writer, named};
use crate::error::{Fault, fault};
use crate::{Extensions, LightKind, PunctualLight, TextureSlot};
use glam::{Quat, Vec3};
use serde_json::{Map, Value, json};

/// Adds the extensions of a material to its JSON ones.
pub(super) fn write(
    e: &Extensions,
    out: &mut Map<String, Value>,
    tables: &mut Tables,
    writer: &mut Writer,
) -> Result<(), String> {
    let mut write = |name: &'static str, values: &[(&str, Value)], slots: &[(&str, &Option<TextureSlot>)]| {
        let mut object = Map::new();
        for (key, value) in values {
            // JSON has no infinite numbers: they become null, and are left out as defaults.
            if has_null(value) {
                return Err(format!("{name}: {key} is not finite; it must be"));
            }
            object.insert((*key).to_owned(), value.clone());
        }
        for (key, slot) in slots {
            if let Some(slot) = slot {
                object.insert((*key).to_owned(), info(slot, tables, writer)?);
            }
        }
        out.insert(name.to_owned(), Value::Object(object));
        writer.extensions.insert(name);
        Ok(())
    };
    if e.ior.to_bits() != Extensions::IOR.to_bits() {
        write("KHR_materials_ior", &[("ior", json!(e.ior))], &[])?;
    }
    if let Some(s) = &e.specular {
        let values = [("specularFactor", json!(s.factor)), ("specularColorFactor", json!(s.color))];
        let slots = [("specularTexture", &s.texture), ("specularColorTexture", &s.color_texture)];
        write("KHR_materials_specular", &values, &slots)?;
    }
    if let Some(t) = &e.transmission {
        let slots = [("transmissionTexture", &t.texture)];
        write("KHR_materials_transmission", &[("transmissionFactor", json!(t.factor))], &slots)?;
    }
    if let Some(v) = &e.volume {
        let mut values =
            vec![("thicknessFactor", json!(v.thickness)), ("attenuationColor", json!(v.attenuation_color))];
        if v.attenuation_distance < f32::INFINITY {
            values.push(("attenuationDistance", json!(v.attenuation_distance)));
        }
        write("KHR_materials_volume", &values, &[("thicknessTexture", &v.thickness_texture)])?;
    }
    if let Some(c) = &e.clearcoat {
        let values = [("clearcoatFactor", json!(c.factor)), ("clearcoatRoughnessFactor", json!(c.roughness))];
        let slots = [
            ("clearcoatTexture", &c.texture),
            ("clearcoatRoughnessTexture", &c.roughness_texture),
            ("clearcoatNormalTexture", &c.normal_texture),
        ];
        write("KHR_materials_clearcoat", &values, &slots)?;
    }
    if let Some(s) = &e.sheen {
        let values = [("sheenColorFactor", json!(s.color)), ("sheenRoughnessFactor", json!(s.roughness))];
        let slots =
            [("sheenColorTexture", &s.color_texture), ("sheenRoughnessTexture", &s.roughness_texture)];
        write("KHR_materials_sheen", &values, &slots)?;
    }
    if let Some(a) = &e.anisotropy {
        let values = [("anisotropyStrength", json!(a.strength)), ("anisotropyRotation", json!(a.rotation))];
        write("KHR_materials_anisotropy", &values, &[("anisotropyTexture", &a.texture)])?;
    }
    if let Some(c) = e.clearcoat.as_ref().filter(|c| c.normal_texture.is_some()) {
        if !c.normal_scale.is_finite() {
            return Err("KHR_materials_clearcoat: the normal scale is not finite; it must be".into());
        }
        out["KHR_materials_clearcoat"]["clearcoatNormalTexture"]["scale"] = json!(c.normal_scale);
    }
    Ok(())
}

fn has_null(value: &Value) -> bool {
    value.is_null() || value.as_array().is_some_and(|a| a.iter().any(Value::is_null))
}

/// Adds lights, each with a node that places it.
pub(super) fn write_lights(lights: &[PunctualLight], writer: &mut Writer) -> Result<(), Fault> {
    for (i, light) in lights.iter().enumerate() {
        let value = self::light(light).map_err(|rule| fault(format!("light {i}"), rule))?;
        let node = json!({
            "translation": light.position.to_array(),
            "rotation": Quat::from_rotation_arc(Vec3::NEG_Z, light.direction).normalize().to_array(),
            "extensions": {"KHR_lights_punctual": {"light": writer.lights.len()}},
        });
        writer.top(node);
        writer.lights.push(value);
    }
    Ok(())
}

/// The JSON of a light without its place.
pub(super) fn light(light: &PunctualLight) -> Result<Value, &'static str> {
    let strength = light.intensity.iter().fold(0.0_f32, |a, &x| a.max(x));
    let range = light.range.is_none_or(f32::is_finite);
    let usable = light.intensity.iter().all(|x| x.is_finite() && *x >= 0.0)
        && light.position.is_finite()
        && light.direction.is_normalized();
    if !usable || !range {
        return Err(
            "has a negative or infinite number, or a direction of another length than 1; intensities must be finite \
             and not negative, places finite, directions unit vectors",
        );
    }
    const THROWS: &str = "throws a picture; lights of glTF must not";
    if light.picture.is_some() {
        return Err(THROWS);
    }
    // The colour is at most 1, as the specification asks.
    let color = light.intensity.map(|x| if strength > 0.0 { x / strength } else { 1.0 });
    let mut value = json!({"color": color, "intensity": strength});
    value["type"] = json!(match light.kind {
        LightKind::Directional => "directional",
        LightKind::Point => "point",
        LightKind::Spot { .. } => "spot",
        LightKind::Projector => return Err(THROWS),
    });
    if let LightKind::Spot { inner, outer } = light.kind {
        if !(inner >= 0.0 && inner < outer && outer.is_finite()) {
            return Err("has cone angles out of order; they must be 0 <= inner < outer");
        }
        value["spot"] = json!({"innerConeAngle": inner, "outerConeAngle": outer});
    }
    if let Some(range) = light.range {
        value["range"] = json!(range);
    }
    Ok(named(value, &light.name))
}
