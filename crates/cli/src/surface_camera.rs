//! The camera of `photofit surface`: from a JSON file, from the options, or from the cloud.

use crate::args::{Surface, UpAxis};
use anyhow::{Result, anyhow, bail};
use photofit_denoise::surface::Pinhole;
use photofit_scene::{Points, Sensor};
use serde_json::{Value, json};
use std::path::Path;

/// Vertical field of view without `--fov`, degrees, as `photofit render` has it.
const FIELD_OF_VIEW: f64 = 40.0;
/// Share of the points that the default camera frames: the rest is taken for strays.
const FRAMED: f64 = 0.98;
/// Share of half of the picture that they fill.
const MARGIN: f64 = 0.95;
/// Largest camera file, bytes.
const MOST_BYTES: u64 = 1 << 20;

/// A camera file in world coordinates.
pub(crate) struct File {
    name: String,
    value: Value,
}

/// Reads a camera file: a JSON object with `eye`, and either `target`, `up` and `fov_y_degrees` or `right`, `down`,
/// `forward` and `fx`, `fy`, `cx`, `cy`; `width` and `height` as well, unless the options give them.
///
/// # Errors
/// If the file cannot be read or is no JSON object.
pub(crate) fn read(path: &Path) -> Result<File> {
    let name = path.display().to_string();
    let bytes = photofit_image::file_bytes(path, MOST_BYTES)?;
    let value: Value =
        serde_json::from_slice(&bytes).map_err(|e| anyhow!("{name}: is no JSON, which it must be: {e}"))?;
    match value.is_object() {
        true => Ok(File { name, value }),
        false => bail!("{name}: is {}; it must be an object", kind(&value)),
    }
}

/// What a JSON value is, in words.
pub(crate) fn kind(value: &Value) -> String {
    match value {
        Value::Null => "null".into(),
        Value::Bool(_) | Value::Number(_) => value.to_string(),
        Value::String(text) => format!("the text \"{}\"", text.chars().take(40).collect::<String>()),
        Value::Array(values) if values.len() <= 4 && !values.iter().any(Value::is_array) => value.to_string(),
        Value::Array(values) => format!("an array of {}", values.len()),
        Value::Object(_) => "an object".into(),
    }
}

impl File {
    fn vector(&self, key: &str) -> Result<Option<[f64; 3]>> {
        let Some(value) = self.value.get(key) else { return Ok(None) };
        let numbers: Vec<f64> = value.as_array().into_iter().flatten().filter_map(Value::as_f64).collect();
        match <[f64; 3]>::try_from(numbers) {
            Ok(v) if value.as_array().is_some_and(|a| a.len() == 3) => Ok(Some(v)),
            _ => bail!("{}: `{key}` is {}; it must be an array of three numbers", self.name, kind(value)),
        }
    }

    fn number(&self, key: &str) -> Result<Option<f64>> {
        let Some(value) = self.value.get(key) else { return Ok(None) };
        let number = value.as_f64().map(Some);
        number.ok_or_else(|| anyhow!("{}: `{key}` is {}; it must be a number", self.name, kind(value)))
    }

    fn size(&self, key: &str, option: Option<u32>) -> Result<usize> {
        match (option, self.number(key)?) {
            (Some(n), _) => Ok(n as usize),
            (None, Some(n)) if (1.0..=16384.0).contains(&n) && n.fract() == 0.0 => Ok(n as usize),
            (None, Some(n)) => {
                bail!("{}: `{key}` is {n}; it must be a whole number, 1 to 16384", self.name)
            }
            (None, None) => bail!("{}: has no `{key}`; it must have one, or --{key} be given", self.name),
        }
    }

    /// The camera relative to the origin of the points.
    ///
    /// # Errors
    /// A member that is missing or broken.
    pub(crate) fn camera(&self, origin: [f64; 3], sizes: (Option<u32>, Option<u32>)) -> Result<Pinhole> {
        let needed = |key: &str| {
            let rule = || anyhow!("{}: has no `{key}`; it must have one, three numbers", self.name);
            self.vector(key)?.ok_or_else(rule)
        };
        let (width, height) = (self.size("width", sizes.0)?, self.size("height", sizes.1)?);
        let relative = |p: [f64; 3]| [p[0] - origin[0], p[1] - origin[1], p[2] - origin[2]];
        let eye = relative(needed("eye")?);
        if let Some(target) = self.vector("target")? {
            let up = self.vector("up")?.unwrap_or([0.0, 1.0, 0.0]);
            let degrees = self.number("fov_y_degrees")?.unwrap_or(FIELD_OF_VIEW);
            if !(0.1..=179.0).contains(&degrees) {
                bail!("{}: `fov_y_degrees` is {degrees}; it must be 0.1 to 179", self.name);
            }
            let camera = Pinhole::look_at(eye, relative(target), up, degrees.to_radians(), width, height);
            return self.checked(camera);
        }
        let axes = [needed("right")?, needed("down")?, needed("forward")?];
        let focal = |key: &str| {
            let rule = || anyhow!("{}: has no `target` and no `{key}`; it must have one of them", self.name);
            self.number(key)?.ok_or_else(rule)
        };
        let camera = Pinhole {
            width,
            height,
            fx: focal("fx")?,
            fy: focal("fy")?,
            cx: self.number("cx")?.unwrap_or(0.5 * width as f64),
            cy: self.number("cy")?.unwrap_or(0.5 * height as f64),
            eye,
            axes,
        };
        self.checked(camera)
    }

    fn checked(&self, camera: Pinhole) -> Result<Pinhole> {
        camera.check().map_err(|e| anyhow!("{}: {e}", self.name))?;
        Ok(camera)
    }
}

/// The camera in world coordinates, as [`read`] takes it.
pub(crate) fn to_json(c: &Pinhole, origin: [f64; 3]) -> Value {
    let eye = [c.eye[0] + origin[0], c.eye[1] + origin[1], c.eye[2] + origin[2]];
    json!({
        "width": c.width, "height": c.height, "fx": c.fx, "fy": c.fy, "cx": c.cx, "cy": c.cy,
        "eye": eye, "right": c.axes[0], "down": c.axes[1], "forward": c.axes[2],
    })
}

/// The camera of the options; without any of them the sensor's own view where the file has one, else a view of the
/// whole cloud.
pub(crate) fn chosen(a: &Surface, points: &Points) -> Pinhole {
    let (width, height) = (a.width.unwrap_or(960) as usize, a.height.unwrap_or(720) as usize);
    let placed = a.azimuth.is_some() || a.elevation.is_some() || a.distance.is_some() || a.up.is_some();
    if let (false, Some(sensor)) = (placed, &points.sensor) {
        return sensor_view(sensor, points, a.fov, width, height);
    }
    let fov = a.fov.map_or(FIELD_OF_VIEW, f64::from).to_radians();
    let (center, radius) = framed(points);
    let (az, el) = (a.azimuth.unwrap_or(30.0).to_radians(), a.elevation.unwrap_or(20.0).to_radians());
    let ((sa, ca), (se, ce)) = (f64::from(az).sin_cos(), f64::from(el).sin_cos());
    // With y up; up itself turns with the elevation, so that the poles are no exception.
    let (back, up) = ([ce * sa, se, ce * ca], [-se * sa, ce, -se * ca]);
    let turned = |v: [f64; 3]| match a.up.unwrap_or(UpAxis::Y) {
        UpAxis::Y => v,
        UpAxis::Z => [v[0], -v[2], v[1]],
        UpAxis::NegativeY => [v[0], -v[1], -v[2]],
    };
    let (back, up) = (turned(back), turned(up));
    let at = |distance: f64| {
        let eye = std::array::from_fn(|k| center[k] + distance * back[k]);
        Pinhole::look_at(eye, center, up, fov, width, height)
    };
    match a.distance {
        Some(d) => at(f64::from(d) * radius),
        None => at(filling(&at(radius), radius, points)),
    }
}

/// The distance from which most of the points fill the picture, for a camera that looks at their centre from
/// `radius`.
fn filling(camera: &Pinhole, radius: f64, points: &Points) -> f64 {
    let (x, y) = (camera.fx / (MARGIN * camera.cx), camera.fy / (MARGIN * camera.cy));
    let mut needed: Vec<f64> = points
        .positions
        .iter()
        .map(|p| camera.to_camera([p.x, p.y, p.z].map(f64::from)))
        .map(|p| (p[0].abs() * x).max(p[1].abs() * y) - (p[2] - radius))
        .collect();
    let k = ((needed.len() - 1) as f64 * FRAMED) as usize;
    needed.select_nth_unstable_by(k, f64::total_cmp).1.max(0.1 * radius)
}

/// Centre and radius of a sphere that holds most of the points.
fn framed(points: &Points) -> ([f64; 3], f64) {
    let at = |mut values: Vec<f32>, share: f64| {
        let k = ((values.len() - 1) as f64 * share) as usize;
        f64::from(*values.select_nth_unstable_by(k, f32::total_cmp).1)
    };
    let center: [f64; 3] = std::array::from_fn(|k| {
        let axis: Vec<f32> = points.positions.iter().map(|p| p.to_array()[k]).collect();
        0.5 * (at(axis.clone(), 1.0 - FRAMED) + at(axis, FRAMED))
    });
    let distance = |p: &photofit_scalar::Vec3f| {
        let d = [p.x, p.y, p.z].iter().zip(center).map(|(p, c)| (f64::from(*p) - c).powi(2)).sum::<f64>();
        d.sqrt() as f32
    };
    let radius = at(points.positions.iter().map(distance).collect(), FRAMED);
    (center, if radius > 0.0 { radius } else { 1.0 })
}

/// The view of the sensor, wide enough for most of the points.
fn sensor_view(sensor: &Sensor, points: &Points, fov: Option<f32>, width: usize, height: usize) -> Pinhole {
    let mut camera = Pinhole {
        width,
        height,
        fx: 1.0,
        fy: 1.0,
        cx: 0.5 * width as f64,
        cy: 0.5 * height as f64,
        eye: sensor.eye,
        axes: sensor.axes,
    };
    let mut slopes: Vec<f64> = points
        .positions
        .iter()
        .map(|p| camera.to_camera([p.x, p.y, p.z].map(f64::from)))
        .filter(|p| p[2] > 0.0)
        .map(|[x, y, z]| (x.abs() / (0.5 * width as f64)).max(y.abs() / (0.5 * height as f64)) / z)
        .collect();
    let seen = match slopes.len() {
        0 => 1.0 / height as f64,
        n => *slopes.select_nth_unstable_by(((n - 1) as f64 * FRAMED) as usize, f64::total_cmp).1,
    };
    let focal = match fov {
        Some(degrees) => 0.5 * height as f64 / (0.5 * f64::from(degrees).to_radians()).tan(),
        None => (1.0 / seen).clamp(0.05 * height as f64, 1e4 * height as f64),
    };
    (camera.fx, camera.fy) = (focal, focal);
    camera
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_mutants::{Shape, Target};

    #[test]
    fn mutants_are_read_or_refused() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("camera.json");
        let seeds = [
            json!({"eye": [1, 2, 3], "target": [0, 0, 0], "up": [0, 0, 1], "fov_y_degrees": 50, "width": 64, "height": 48}),
            json!({"eye": [1, 2, 3], "right": [1, 0, 0], "down": [0, 1, 0], "forward": [0, 0, 1], "fx": 90, "fy": 91,
                "cx": 30, "cy": 20, "width": 64, "height": 48}),
        ]
        .map(|v| v.to_string().into_bytes());
        let seen = Target { name: "surface-camera", shape: Shape::Json, seeds: &seeds }.run(
            |n| n == 2000,
            |bytes| {
                std::fs::write(&file, bytes).unwrap();
                let camera = read(&file).and_then(|f| f.camera([0.5, 0.0, 1e6], (None, None)));
                camera.map(drop).map_err(|e| e.to_string())
            },
        );
        seen.assert_deep("surface-camera", 25);
    }
}
