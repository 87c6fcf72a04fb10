//! What sensors and projectors say alike: their frame and how wide they see.

use super::Importer;
use crate::error::{Fault, fault};
use crate::load::clip;
use glam::{DAffine3, DVec3};

impl Importer {
    /// Right, up and back, and the scale along each.
    pub(super) fn axes(&self, element: usize, m: &DAffine3) -> Result<([DVec3; 3], DVec3), Fault> {
        let m = m.matrix3;
        let scale = DVec3::new(m.x_axis.length(), m.y_axis.length(), m.z_axis.length());
        // Mitsuba's frames have x to the left and look along +z.
        let axes = [-m.x_axis / scale.x, m.y_axis / scale.y, -m.z_axis / scale.z];
        let skew = axes[0].dot(axes[1]).abs().max(axes[1].dot(axes[2]).abs()).max(axes[2].dot(axes[0]).abs());
        if scale.min_element() > 0.0 && skew < 1e-4 {
            return Ok((axes, scale));
        }
        let title = self.reader.title(element);
        let rule = format!("the axes of {title} are not at right angles; they must be");
        Err(fault(self.reader.place(element), rule))
    }

    /// Horizontal field of view, degrees.
    pub(super) fn field_of_view(&mut self, element: usize, aspect: f64) -> Result<f64, Fault> {
        let place = self.reader.place(element);
        let length = self.reader.string(element, "focal_length")?;
        let own = self.reader.float(element, "fov")?;
        let axis = self.reader.string(element, "fov_axis")?;
        let (fov, axis) = match (own, length) {
            (Some(_), Some(_)) => {
                return Err(fault(place, "has fov and focal_length; it must have one of them"));
            }
            (Some(fov), None) => (fov, axis.unwrap_or_else(|| "x".into())),
            (None, length) => {
                let text = length.unwrap_or_else(|| "50mm".into());
                let number: Option<f64> = text.trim().trim_end_matches("mm").trim().parse().ok();
                let f = number.filter(|f| *f > 0.0 && f.is_finite()).ok_or_else(|| {
                    fault(
                        &place,
                        format!("focal_length is `{}`; it must be a positive length in mm", clip(&text)),
                    )
                })?;
                // The diagonal of a 35 mm film.
                let diagonal = (36.0_f64 * 36.0 + 24.0 * 24.0).sqrt();
                (2.0 * (0.5 * diagonal / f).atan().to_degrees(), "diagonal".into())
            }
        };
        let tangent = (0.5 * fov.to_radians()).tan();
        let axis = match (axis.to_ascii_lowercase().as_str(), aspect > 1.0) {
            ("smaller", wide) => if wide { "y" } else { "x" }.to_owned(),
            ("larger", wide) => if wide { "x" } else { "y" }.to_owned(),
            (other, _) => other.to_owned(),
        };
        let x = match axis.as_str() {
            "x" => tangent,
            "y" => tangent * aspect,
            "diagonal" => tangent / (1.0 + 1.0 / (aspect * aspect)).sqrt(),
            other => {
                let rule =
                    format!("fov_axis is `{}`; it must be x, y, diagonal, smaller or larger", clip(other));
                return Err(fault(place, rule));
            }
        };
        if fov > 0.0 && fov < 180.0 && x.is_finite() {
            return Ok(2.0 * x.atan().to_degrees());
        }
        Err(fault(place, format!("the field of view is {fov} degrees; it must lie between 0 and 180")))
    }
}
