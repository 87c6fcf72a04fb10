//! Lights of `KHR_lights_punctual`.

use crate::error::{Fault, fault};
use crate::load::file::clip;
use crate::nodes::NodeLight;
use crate::{LightKind, PunctualLight};
use glam::Vec3;
use serde_json::Value;

/// Light `index` of the document in the frame of its node: it shines along -z.
pub(super) fn read(lights: &[Value], index: usize) -> Result<NodeLight, Fault> {
    let json = &lights[index];
    let name = json.get("name").and_then(Value::as_str).unwrap_or_default();
    let place =
        || if name.is_empty() { format!("light {index}") } else { format!("light {index} `{}`", clip(name)) };
    let number = |path: &str, default: f32| match json.pointer(path) {
        None => Some(default),
        Some(v) => v.as_f64().map(|x| x as f32),
    };
    let checked = |path: &str, default: f32, rule: &str, holds: &dyn Fn(f32) -> bool| {
        number(path, default).filter(|x| x.is_finite() && holds(*x)).ok_or_else(|| {
            let found = json.pointer(path).unwrap_or(&Value::Null).to_string();
            let key = path[1..].replace('/', ".");
            fault(place(), format!("{key} is {}; it must {rule}", clip(&found)))
        })
    };
    let intensity = checked("/intensity", 1.0, "be finite and not negative", &|x| x >= 0.0)?;
    let mut color = [1.0; 3];
    if json.get("color").is_some_and(|c| c.as_array().is_none_or(|c| c.len() != 3)) {
        return Err(fault(place(), "color is not a list of three numbers; it must have three channels"));
    }
    for (k, channel) in color.iter_mut().enumerate() {
        *channel = checked(&format!("/color/{k}"), 1.0, "be finite and not negative", &|x| x >= 0.0)?;
    }
    let range = match json.get("range") {
        None => None,
        Some(_) => Some(checked("/range", 1.0, "be positive and finite", &|x| x > 0.0)?),
    };
    let kind = match json.get("type").and_then(Value::as_str) {
        Some("directional") => LightKind::Directional,
        Some("point") => LightKind::Point,
        Some("spot") => {
            let right = std::f32::consts::FRAC_PI_2 * (1.0 + 1e-6);
            let outer =
                checked("/spot/outerConeAngle", std::f32::consts::FRAC_PI_4, "lie in (0, pi / 2]", &|x| {
                    x > 0.0 && x <= right
                })?;
            let inner =
                checked("/spot/innerConeAngle", 0.0, "be from 0 to less than outerConeAngle", &|x| {
                    x >= 0.0 && x < outer
                })?;
            LightKind::Spot { inner, outer }
        }
        other => {
            let rule = format!(
                "type is `{}`; it must be directional, point or spot",
                clip(other.unwrap_or_default())
            );
            return Err(fault(place(), rule));
        }
    };
    let light = PunctualLight {
        name: name.to_owned(),
        kind,
        intensity: color.map(|c| c * intensity),
        position: Vec3::ZERO,
        direction: Vec3::NEG_Z,
        range,
        picture: None,
    };
    if light.intensity.iter().all(|x| x.is_finite()) {
        Ok(NodeLight { light, extras: json.get("extras").cloned() })
    } else {
        Err(fault(place(), format!("color times intensity is {:?}; it must be finite", light.intensity)))
    }
}
