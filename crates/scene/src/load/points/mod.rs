//! Point clouds: PLY and PCD files with optional colours and normals, as untrusted as assets.

mod lzf;
mod pcd;
#[cfg(test)]
mod tests;

use super::{Limits, file, ply};
use crate::SceneError;
use crate::error::{Fault, fault};
use photofit_scalar::{Vec3, Vec3f, vec3};
use std::path::Path;

/// Largest coordinate of a point that is read, in the units of the file.
const MAX_POINT: f64 = 1e15;
/// A cloud whose centre is farther from the origin than this many of its diagonals is moved to its centre.
const FAR: f64 = 8.0;

/// A cloud of points in memory.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Points {
    /// What was subtracted from every position of the file, in double precision: zero, or the centre of a cloud that
    /// lies far from the origin (survey coordinates), where single precision would cost accuracy.
    pub origin: [f64; 3],
    /// Positions relative to [`Self::origin`], in the units of the file; all finite.
    pub positions: Vec<Vec3f>,
    /// Unit normals (zero where the file has none for a point), one per position, or empty.
    pub normals: Vec<Vec3f>,
    /// Linear RGB in `[0, 1]`, one per position, or empty. Integer colours of the file are sRGB.
    pub colors: Vec<Vec3f>,
    /// Points of the file that were left out because a coordinate is NaN or infinite, as sensors write "no return".
    pub skipped: usize,
    /// Pose of the sensor that saw the cloud as an image, where the file tells.
    pub sensor: Option<Sensor>,
    /// Things of the file that are ignored.
    pub warnings: Vec<String>,
}

/// The pose of a depth camera: x to the right, y down, z forward.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensor {
    /// The eye, relative to [`Points::origin`].
    pub eye: [f64; 3],
    /// The axes right, down and forward in the world; unit vectors.
    pub axes: [[f64; 3]; 3],
}

impl Sensor {
    /// This pose if nearly all points lie in front of it; else the identity, if they lie in front of that: programs
    /// disagree on whether the points of a file are already turned by its pose.
    fn facing(self, positions: &[Vec3<f64>]) -> Option<Self> {
        let identity = Self { eye: [0.0; 3], axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] };
        [self, identity].into_iter().find(|s| {
            let (eye, forward) = (Vec3::from_array(s.eye), Vec3::from_array(s.axes[2]));
            let before = positions.iter().filter(|p| (**p - eye).dot(forward) > 0.0).count();
            before * 50 >= positions.len() * 49
        })
    }
}

/// A cloud as a reader finds it, before it is moved and checked as a whole.
#[derive(Debug, Default)]
pub(crate) struct RawPoints {
    pub(crate) positions: Vec<Vec3<f64>>,
    pub(crate) normals: Vec<Vec3f>,
    pub(crate) colors: Vec<Vec3f>,
    pub(crate) skipped: usize,
    pub(crate) sensor: Option<Sensor>,
    pub(crate) warnings: Vec<String>,
}

impl RawPoints {
    /// Adds a point unless a coordinate is not finite.
    pub(crate) fn push(&mut self, p: [f64; 3], normal: Option<[f64; 3]>, color: Option<Vec3f>) {
        let p = Vec3::from_array(p);
        if !(p.is_finite() && p.x.abs().max(p.y.abs()).max(p.z.abs()) <= MAX_POINT) {
            self.skipped += 1;
            return;
        }
        self.positions.push(p);
        if let Some(n) = normal {
            self.normals.push(Vec3::from_array(n).cast::<f32>().normalize_or_zero());
        }
        if let Some(c) = color {
            self.colors.push(c);
        }
    }

    fn finish(self) -> Result<Points, Fault> {
        let Some(&first) = self.positions.first() else {
            let rule = match self.skipped {
                0 => "the cloud has no point; it must have at least one point".into(),
                n => format!(
                    "none of {n} points has finite coordinates up to {MAX_POINT:e}; at least one point must have some"
                ),
            };
            return Err(fault("points", rule));
        };
        let (lo, hi) = self.positions.iter().fold((first, first), |(lo, hi), &p| (lo.min(p), hi.max(p)));
        let center = (lo + hi) * 0.5;
        let far = center.length() > FAR * (hi - lo).length();
        let origin = if far { center } else { Vec3::zero() };
        let sensor = self.sensor.and_then(|s| s.facing(&self.positions));
        let sensor = sensor.map(|s| Sensor { eye: (Vec3::from_array(s.eye) - origin).to_array(), ..s });
        let mut normals = self.normals;
        if normals.iter().all(|n| *n == Vec3f::zero()) {
            normals.clear();
        }
        Ok(Points {
            origin: origin.to_array(),
            positions: self.positions.iter().map(|p| (*p - origin).cast()).collect(),
            normals,
            colors: self.colors,
            skipped: self.skipped,
            sensor,
            warnings: self.warnings,
        })
    }
}

/// Loads a point cloud: PLY (`.ply`; faces are ignored) or PCD (`.pcd`; ASCII, binary and compressed binary), with
/// the default [`Limits`].
///
/// Normals (`nx ny nz`, `normal_x ...`) and colours (`red green blue`; `rgb` or `rgba` of PCD) are read where the
/// file has them. Points with a coordinate that is not a finite number are left out and counted: organised clouds
/// mark pixels without a measurement so.
///
/// ```
/// let folder = std::env::temp_dir().join(format!("photofit-points-{}", std::process::id()));
/// std::fs::create_dir_all(&folder)?;
/// let file = folder.join("two.pcd");
/// let text = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 2\nHEIGHT 1\nDATA ascii\n1 2 3\nnan nan nan\n";
/// std::fs::write(&file, text)?;
/// let points = photofit_scene::load_points(&file)?;
/// assert_eq!((points.positions.len(), points.skipped), (1, 1));
/// # std::fs::remove_dir_all(&folder)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// If the file cannot be read, breaks a rule of its format, claims more than the limits or its own size allow, or
/// holds no finite point; the message names file, place and rule.
pub fn load_points(path: impl AsRef<Path>) -> Result<Points, SceneError> {
    load_points_with(path, &Limits::default())
}

/// As [`load_points`], with other limits (`file_bytes` and `vertices` apply).
///
/// # Errors
/// As [`load_points`].
pub fn load_points_with(path: impl AsRef<Path>, limits: &Limits) -> Result<Points, SceneError> {
    let path = path.as_ref();
    let bytes = file::read(path, limits.file_bytes)?;
    parse(path, &bytes, limits).and_then(RawPoints::finish).map_err(|f| f.in_file(path))
}

fn parse(path: &Path, bytes: &[u8], limits: &Limits) -> Result<RawPoints, Fault> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    if bytes.is_empty() {
        return Err(fault("byte 0", "the file is empty"));
    }
    if text.starts_with(b"ply\n") || text.starts_with(b"ply\r") {
        return ply::parse_points(text, limits);
    }
    if extension == "pcd" || pcd::is_pcd(text) {
        return pcd::parse(text, limits);
    }
    match extension.as_str() {
        "ply" => Err(fault("byte 0", "the file does not begin with the line `ply`; a .ply file must")),
        other => Err(fault(
            "the file's name",
            format!("the extension is `.{other}`; point clouds must be .ply or .pcd files"),
        )),
    }
}

/// An sRGB colour of eight bits a channel, in linear light.
fn srgb(rgb: [u8; 3]) -> Vec3f {
    let [r, g, b] = rgb.map(photofit_image::srgb_u8_to_linear);
    vec3(r, g, b)
}
