//! Lights of `KHR_lights_punctual`.

use crate::error::{Fault, fault};
use crate::load::file::clip;
use crate::{LightKind, MAX_COORDINATE, PunctualLight};
use glam::{Affine3A, Vec3};
use serde_json::Value;

/// Light `index` of the document, placed by the `world` transform of `node`: it shines along the node's -z.
pub(super) fn read(
    lights: &[Value],
    index: usize,
    world: Affine3A,
    node: usize,
) -> Result<PunctualLight, Fault> {
    let json = lights
        .get(index)
        .ok_or_else(|| fault(format!("node {node}"), format!("light {index} is one of {}", lights.len())))?;
    let name = json.get("name").and_then(Value::as_str).unwrap_or_default();
    let place =
        || if name.is_empty() { format!("light {index}") } else { format!("light {index} `{}`", clip(name)) };
    let number = |path: &str, default: f32| match json.pointer(path) {
        None => Some(default),
        Some(v) => v.as_f64().map(|x| x as f32),
    };
    let checked = |path: &str, default: f32, rule: &str, holds: &dyn Fn(f32) -> bool| {
        number(path, default)
            .filter(|x| x.is_finite() && holds(*x))
            .ok_or_else(|| fault(place(), format!("{} {rule}", path[1..].replace('/', "."))))
    };
    let intensity = checked("/intensity", 1.0, "is finite and not negative", &|x| x >= 0.0)?;
    let mut color = [1.0; 3];
    if json.get("color").is_some_and(|c| c.as_array().is_none_or(|c| c.len() != 3)) {
        return Err(fault(place(), "color has three channels"));
    }
    for (k, channel) in color.iter_mut().enumerate() {
        *channel = checked(&format!("/color/{k}"), 1.0, "is finite and not negative", &|x| x >= 0.0)?;
    }
    let range = match json.get("range") {
        None => None,
        Some(_) => Some(checked("/range", 1.0, "is positive and finite", &|x| x > 0.0)?),
    };
    let kind = match json.get("type").and_then(Value::as_str) {
        Some("directional") => LightKind::Directional,
        Some("point") => LightKind::Point,
        Some("spot") => {
            let right = std::f32::consts::FRAC_PI_2 * (1.0 + 1e-6);
            let outer =
                checked("/spot/outerConeAngle", std::f32::consts::FRAC_PI_4, "lies in (0, pi / 2]", &|x| {
                    x > 0.0 && x <= right
                })?;
            let inner =
                checked("/spot/innerConeAngle", 0.0, "is not negative and less than outerConeAngle", &|x| {
                    x >= 0.0 && x < outer
                })?;
            LightKind::Spot { inner, outer }
        }
        _ => return Err(fault(place(), "type is `directional`, `point` or `spot`")),
    };
    let position: Vec3 = world.translation.into();
    if !(position.is_finite() && position.abs().max_element() <= MAX_COORDINATE) {
        return Err(fault(place(), format!("the position has coordinates of at most {MAX_COORDINATE:e}")));
    }
    let light = PunctualLight {
        name: name.to_owned(),
        kind,
        intensity: color.map(|c| c * intensity),
        position,
        direction: world.transform_vector3(Vec3::NEG_Z).try_normalize().unwrap_or(Vec3::NEG_Z),
        range,
    };
    if light.intensity.iter().all(|x| x.is_finite()) {
        Ok(light)
    } else {
        Err(fault(place(), "color times intensity is finite"))
    }
}
