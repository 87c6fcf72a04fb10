//! What stands in a `transforms.json`, checked.

use crate::engine::FitFrame;
use crate::engine::views::{ViewLight, ViewLights};
use photofit_scalar::{Vec3f, vec3};
use serde::Deserialize;

/// How far from rigid a matrix may be.
const SLACK: f64 = 1e-3;

/// The file.
#[derive(Debug, Deserialize)]
#[serde(expecting = "an object with `frames`")]
pub(super) struct Transforms {
    #[serde(flatten)]
    pub(super) lens: Intrinsics,
    applied_transform: Option<Vec<Vec<f64>>>,
    pub(super) lights: Option<Vec<Light>>,
    pub(super) frames: Vec<Frame>,
}

/// One picture.
#[derive(Debug, Deserialize)]
#[serde(expecting = "an object with `file_path` and `transform_matrix`")]
pub(super) struct Frame {
    pub(super) file_path: String,
    pub(super) transform_matrix: Vec<Vec<f64>>,
    #[serde(flatten)]
    pub(super) lens: Intrinsics,
    pub(super) lights: Option<Vec<Light>>,
}

/// A light of our own key `lights`, in the world of the matrices.
#[derive(Debug, Deserialize)]
#[serde(expecting = "an object with `type`", tag = "type", rename_all = "lowercase", deny_unknown_fields)]
pub(super) enum Light {
    /// Radiant intensity, W/sr.
    Point { position: [f64; 3], intensity: [f64; 3] },
    /// Towards the light; irradiance on what faces it.
    Directional { direction: [f64; 3], irradiance: [f64; 3] },
    /// From everywhere.
    Ambient { radiance: [f64; 3] },
}

/// The lens, as the file or a frame gives it.
#[derive(Clone, Debug, Default, Deserialize)]
pub(super) struct Intrinsics {
    camera_model: Option<String>,
    camera_angle_x: Option<f64>,
    camera_angle_y: Option<f64>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    w: Option<f64>,
    h: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
}

/// A lens without distortion, in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lens {
    /// Focal lengths, horizontal and vertical.
    pub(super) focal: [f64; 2],
    /// Principal point from the upper left corner.
    pub(super) center: [f64; 2],
}

impl Intrinsics {
    /// What a frame says, completed by what the file says.
    pub(super) fn or(&self, file: &Self) -> Self {
        let (a, b) = (self, file);
        Self {
            camera_model: a.camera_model.clone().or_else(|| b.camera_model.clone()),
            camera_angle_x: a.camera_angle_x.or(b.camera_angle_x),
            camera_angle_y: a.camera_angle_y.or(b.camera_angle_y),
            fl_x: a.fl_x.or(b.fl_x),
            fl_y: a.fl_y.or(b.fl_y),
            cx: a.cx.or(b.cx),
            cy: a.cy.or(b.cy),
            w: a.w.or(b.w),
            h: a.h.or(b.h),
            k1: a.k1.or(b.k1),
            k2: a.k2.or(b.k2),
            k3: a.k3.or(b.k3),
            k4: a.k4.or(b.k4),
            p1: a.p1.or(b.p1),
            p2: a.p2.or(b.p2),
        }
    }

    /// The lens of a picture of `width` x `height` pixels.
    pub(super) fn in_pixels(&self, width: f64, height: f64) -> Result<Lens, String> {
        let bends = [
            ("k1", self.k1),
            ("k2", self.k2),
            ("k3", self.k3),
            ("k4", self.k4),
            ("p1", self.p1),
            ("p2", self.p2),
        ];
        if let Some((key, Some(x))) = bends.into_iter().find(|(_, x)| x.is_some_and(|x| x != 0.0)) {
            return Err(format!("{key} is {x}; it must be 0: undo the distortion of the pictures first"));
        }
        let plain = ["PINHOLE", "SIMPLE_PINHOLE", "OPENCV", "PERSPECTIVE"];
        if let Some(model) = self.camera_model.as_ref().filter(|m| !plain.contains(&m.as_str())) {
            return Err(format!("camera_model is {model}; it must be a pinhole camera"));
        }
        for (key, said, is) in [("w", self.w, width), ("h", self.h, height)] {
            if let Some(said) = said.filter(|s| (s - is).abs() > 0.5) {
                return Err(format!("{key} is {said}, but the picture has {is} pixels"));
            }
        }
        for (key, angle) in [("camera_angle_x", self.camera_angle_x), ("camera_angle_y", self.camera_angle_y)]
        {
            if let Some(a) = angle.filter(|a| !(*a > 0.0 && *a < std::f64::consts::PI)) {
                return Err(format!("{key} is {a}; it must be more than 0 and less than pi radians"));
            }
        }
        let by_angle = |angle: Option<f64>, size: f64| angle.map(|a| 0.5 * size / (0.5 * a).tan());
        let x = self.fl_x.or(by_angle(self.camera_angle_x, width));
        let y = self.fl_y.or(by_angle(self.camera_angle_y, height));
        let (Some(x), Some(y)) = (x.or(y), y.or(x)) else {
            return Err("neither fl_x nor camera_angle_x is given".into());
        };
        let focal = [x, y];
        let center = [self.cx.unwrap_or(0.5 * width), self.cy.unwrap_or(0.5 * height)];
        if let Some(f) = focal.into_iter().find(|f| !(*f > 1e-3 * width.max(height) && f.is_finite())) {
            return Err(format!("the focal length is {f} pixels; it must be positive, and finite"));
        }
        for (key, c, size) in [("cx", center[0], width), ("cy", center[1], height)] {
            if !(c > -size && c < 2.0 * size) {
                return Err(format!("{key} is {c}; it must lie near the picture of {size} pixels"));
            }
        }
        Ok(Lens { focal, center })
    }
}

/// A rotation and a translation: `p -> R p + t`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rigid {
    /// Rows of the rotation.
    pub(super) rotation: [[f64; 3]; 3],
    pub(super) translation: [f64; 3],
}

impl Rigid {
    const IDENTITY: Self =
        Self { rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], translation: [0.0; 3] };

    /// Checks the three or four rows of a matrix.
    pub(super) fn new(rows: &[Vec<f64>]) -> Result<Self, String> {
        if !(3..=4).contains(&rows.len()) || rows.iter().any(|r| r.len() != 4) {
            return Err("is no matrix of 3 or 4 rows with 4 numbers each".into());
        }
        if rows.iter().flatten().any(|x| !x.is_finite()) {
            return Err("holds a value that is not finite".into());
        }
        if rows.get(3).is_some_and(|r| r.iter().zip([0.0, 0.0, 0.0, 1.0]).any(|(a, b)| (a - b).abs() > SLACK))
        {
            return Err("must have the last row 0 0 0 1".into());
        }
        let rotation = [0, 1, 2].map(|r| [0, 1, 2].map(|c| rows[r][c]));
        let column = |c: usize| [0, 1, 2].map(|r: usize| rotation[r][c]);
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        for a in 0..3 {
            for b in a..3 {
                let (is, must) = (dot(column(a), column(b)), f64::from(u8::from(a == b)));
                if (is - must).abs() > SLACK {
                    return Err(format!(
                        "is not rigid: the product of its columns {a} and {b} is {is:.4}; it must be {must}"
                    ));
                }
            }
        }
        let [x, y, z] = [column(0), column(1), column(2)];
        let cross = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]];
        if dot(cross, z) < 0.0 {
            return Err("is not rigid: it mirrors".into());
        }
        Ok(Self { rotation, translation: [0, 1, 2].map(|r| rows[r][3]) })
    }

    /// A direction, turned.
    pub(super) fn turn(&self, v: [f64; 3]) -> [f64; 3] {
        self.rotation.map(|r| r[0] * v[0] + r[1] * v[1] + r[2] * v[2])
    }

    /// A point, moved.
    pub(super) fn apply(&self, p: [f64; 3]) -> [f64; 3] {
        let turned = self.turn(p);
        [0, 1, 2].map(|k| turned[k] + self.translation[k])
    }

    fn inverse(&self) -> Self {
        let r = self.rotation;
        let rotation = [0, 1, 2].map(|i| [0, 1, 2].map(|j: usize| r[j][i]));
        let back = Self { rotation, translation: [0.0; 3] };
        Self { translation: back.turn(self.translation).map(|x| -x), ..back }
    }

    /// First `first`, then this.
    pub(super) fn after(&self, first: &Self) -> Self {
        let column = |c: usize| self.turn([0, 1, 2].map(|r: usize| first.rotation[r][c]));
        let columns = [column(0), column(1), column(2)];
        Self {
            rotation: [0, 1, 2].map(|r| [0, 1, 2].map(|c: usize| columns[c][r])),
            translation: self.apply(first.translation),
        }
    }
}

impl Transforms {
    /// From the world of the matrices to that of the asset.
    pub(super) fn undo(&self) -> Result<Rigid, String> {
        let Some(rows) = &self.applied_transform else { return Ok(Rigid::IDENTITY) };
        Ok(Rigid::new(rows).map_err(|r| format!("applied_transform {r}"))?.inverse())
    }

    /// Whether every picture has lights.
    pub(super) fn is_lit(&self) -> bool {
        let some = |l: &Option<Vec<Light>>| l.as_ref().is_some_and(|l| !l.is_empty());
        some(&self.lights) || (!self.frames.is_empty() && self.frames.iter().all(|f| some(&f.lights)))
    }
}

/// Lights in the frame of a fit.
pub(super) fn lights(given: &[Light], undo: &Rigid, frame: FitFrame) -> Result<ViewLights, String> {
    let color = |what: &str, c: &[f64; 3]| -> Result<Vec3f, String> {
        if c.iter().all(|x| *x >= 0.0 && *x <= 1e9) {
            Ok(vec3(c[0] as f32, c[1] as f32, c[2] as f32))
        } else {
            Err(format!("{what} of a light is {c:?}; it must be 0 to 1e9"))
        }
    };
    let vector = |v: [f64; 3]| vec3(v[0] as f32, v[1] as f32, v[2] as f32);
    let light = |l: &Light| {
        Ok(match l {
            Light::Point { position, intensity } => {
                let position = frame.to_frame(vector(undo.apply(*position)));
                if !position.is_finite() {
                    return Err("position of a light is not finite".into());
                }
                let intensity = color("intensity", intensity)? / (frame.radius * frame.radius);
                ViewLight::Point { position, intensity }
            }
            Light::Directional { direction, irradiance } => {
                let direction = vector(undo.turn(*direction)).normalize_or_zero();
                if direction == Vec3f::zero() {
                    return Err("direction of a light has no length".into());
                }
                ViewLight::Directional { direction, irradiance: color("irradiance", irradiance)? }
            }
            Light::Ambient { radiance } => ViewLight::Ambient { radiance: color("radiance", radiance)? },
        })
    };
    given.iter().map(light).collect::<Result<_, String>>().map(ViewLights)
}
