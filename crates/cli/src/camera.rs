//! Cameras and lights of pictures as JSON, with the keys of a frame of `transforms.json`.

use photofit_pathtrace::{Projection, View};
use photofit_shading::Light;
use serde_json::{Value, json};

/// A camera of a picture of `width` x `height` pixels: `transform_matrix` (rows; camera, y up and looking down -z, to world)
/// and, in pixels, `fl_x`, `fl_y`, `cx`, `cy`; a camera without perspective has the extent of its view instead.
pub(crate) fn to_json(view: &View, width: u32, height: u32) -> Value {
    let [x, y, z] = view.axes;
    let eye = view.eye.to_array();
    let row = |k: usize| json!([x[k], y[k], z[k], eye[k]]);
    let matrix = json!([row(0), row(1), row(2), [0, 0, 0, 1]]);
    let [left, upper, w, h] = view.window.map(f64::from);
    let [half_x, half_y] = view.half.map(f64::from);
    let (width, height) = (f64::from(width), f64::from(height));
    match view.projection {
        Projection::Perspective => json!({
            "transform_matrix": matrix,
            "fl_x": width / (2.0 * half_x * w),
            "fl_y": height / (2.0 * half_y * h),
            "cx": (0.5 - left) / w * width,
            "cy": (0.5 - upper) / h * height,
        }),
        Projection::Orthographic => json!({
            "transform_matrix": matrix,
            "projection": "orthographic",
            "extent": [2.0 * half_x * w, 2.0 * half_y * h],
        }),
    }
}

/// Lights without a picture, as the list `lights` of `transforms.json`; `None` where there is an environment map.
pub(crate) fn lights(lights: &[Light<'_>]) -> Option<Value> {
    let one = |light: &Light<'_>| match light {
        Light::Point { position, intensity } => Some(
            json!({ "type": "point", "position": position.to_array(), "intensity": intensity.to_array() }),
        ),
        Light::Directional { direction, irradiance } => Some(
            json!({ "type": "directional", "direction": direction.to_array(), "irradiance": irradiance.to_array() }),
        ),
        Light::Ambient { radiance } => Some(json!({ "type": "ambient", "radiance": radiance.to_array() })),
        Light::Environment { .. } => None,
    };
    lights.iter().map(one).collect::<Option<Vec<Value>>>().map(Value::Array)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Vec3, vec3};
    use photofit_scene::Camera;

    #[test]
    fn the_matrix_and_the_lens_are_those_of_the_picture() {
        let camera = Camera::look_at(vec3(1.0, 2.0, 7.0), vec3(1.0, 2.0, 0.0), Vec3::Y, 0.8, 1.5, 0.1, 9.0);
        let camera = Camera { principal: [0.25, -0.5], ..camera };
        let json = to_json(&View::pinhole(&camera), 300, 200);
        let number = |v: &Value| v.as_f64().unwrap();
        assert_eq!(json["transform_matrix"][2], json!([0.0, 0.0, 1.0, 7.0]));
        assert_eq!(json["transform_matrix"][0][3], 1.0);
        let focal = 100.0 / (0.4_f64).tan();
        assert!((number(&json["fl_x"]) - focal).abs() < 1e-3 && (number(&json["fl_y"]) - focal).abs() < 1e-3);
        // Off the centre to the right, and downwards.
        assert!(
            (number(&json["cx"]) - 187.5).abs() < 1e-3 && (number(&json["cy"]) - 150.0).abs() < 1e-3,
            "{json}"
        );
    }
}
