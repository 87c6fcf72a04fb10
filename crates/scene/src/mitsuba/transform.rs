//! `transform` elements.

use super::properties::Reader;
use crate::error::{Fault, fault};
use glam::{DAffine3, DMat4, DVec3, DVec4};

impl Reader {
    /// The transform of a `transform` element: its operations, each applied after those before it.
    pub(super) fn matrix(&self, element: usize) -> Result<DMat4, Fault> {
        let mut all = DMat4::IDENTITY;
        for &child in &self.document.elements[element].children {
            all = self.operation(child)? * all;
        }
        if all.is_finite() {
            Ok(all)
        } else {
            Err(fault(self.place(element), "the transform is not finite; it must be"))
        }
    }

    /// The property `to_world` (or another) of a plugin as an affine map; the identity without it.
    pub(super) fn affine(&mut self, plugin: usize, name: &str) -> Result<DAffine3, Fault> {
        let Some(element) = self.property(plugin, name, &["transform"]) else {
            return Ok(DAffine3::IDENTITY);
        };
        let m = self.matrix(element)?;
        let last = m.row(3);
        if !(last - DVec4::W * last.w).abs_diff_eq(DVec4::ZERO, 1e-9) || last.w == 0.0 {
            return Err(fault(
                self.place(element),
                "the last row of the transform is another than 0 0 0 1; it must be that",
            ));
        }
        Ok(DAffine3::from_mat4(m * (1.0 / last.w)))
    }

    fn operation(&self, element: usize) -> Result<DMat4, Fault> {
        let e = &self.document.elements[element];
        let place = || self.place(element);
        Ok(match e.tag.as_str() {
            "translate" => DMat4::from_translation(self.vector(element, DVec3::ZERO)?),
            "scale" => DMat4::from_diagonal(self.vector(element, DVec3::ONE)?.extend(1.0)),
            "rotate" => {
                let axis = self.vector(element, DVec3::ZERO)?;
                let angle = self.attribute_number(element, "angle")?;
                let unit =
                    axis.try_normalize().ok_or_else(|| fault(place(), "the axis is zero; it must not be"))?;
                DMat4::from_axis_angle(unit, angle.to_radians())
            }
            "lookat" | "lookAt" | "look_at" => {
                let get = |name: &str| self.attribute_vector(element, name);
                let (origin, target) = (get("origin")?, get("target")?);
                let up = if e.attribute("up").is_some() { get("up")? } else { DVec3::ZERO };
                let forward = (target - origin).try_normalize().ok_or_else(|| {
                    fault(place(), "origin and target are the same point; they must differ")
                })?;
                let up = if up == DVec3::ZERO { forward.any_orthonormal_vector() } else { up };
                let left = up
                    .cross(forward)
                    .try_normalize()
                    .ok_or_else(|| fault(place(), "up points along the view; it must not"))?;
                let up = forward.cross(left);
                DMat4::from_cols(left.extend(0.0), up.extend(0.0), forward.extend(0.0), origin.extend(1.0))
            }
            "matrix" => {
                let values = self.attribute_numbers(element, "value")?;
                match values.len() {
                    16 => {
                        let rows: [f64; 16] = std::array::from_fn(|i| values[i]);
                        DMat4::from_cols_array(&rows).transpose()
                    }
                    9 => {
                        let rows: [f64; 9] = std::array::from_fn(|i| values[i]);
                        DMat4::from_mat3(glam::DMat3::from_cols_array(&rows).transpose())
                    }
                    n => {
                        return Err(fault(
                            place(),
                            format!("the matrix has {n} numbers; it must have 16 or 9"),
                        ));
                    }
                }
            }
            other => {
                let rule = format!(
                    "the transform has <{other}>; it may have translate, scale, rotate, lookat and matrix"
                );
                return Err(fault(place(), rule));
            }
        })
    }
}
