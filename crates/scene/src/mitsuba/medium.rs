//! `medium` elements with their volumes and phase functions.

use super::Importer;
use super::grid_file::parse_grid;
use super::spectrum::Meaning;
use crate::error::{Fault, fault};
use crate::load::clip;
use glam::{DAffine3, DVec3};
use photofit_scalar::Vec3f;

/// Numbers in space: the same everywhere, or on a grid over a cube.
#[derive(Clone, Debug)]
pub struct MitsubaVolume {
    /// Voxels along x, y and z; 1 x 1 x 1 where nothing varies.
    pub size: [usize; 3],
    /// Values, x fastest.
    pub values: Vec<Vec3f>,
    /// The world to the unit cube. Outside of it the value at its border goes on.
    pub to_unit: DAffine3,
    /// The box that the file of the grid names, from corner to corner; the unit cube without one.
    pub bounds: [DVec3; 2],
}

/// A participating medium.
#[derive(Clone, Debug)]
pub struct MitsubaMedium {
    /// What it is called: its id, that of its shape with `.interior_medium` or `.exterior_medium`, or `medium_` and its
    /// number.
    pub name: String,
    /// Extinction, per unit of length.
    pub extinction: MitsubaVolume,
    /// Factor of the extinction.
    pub scale: f32,
    /// Share of scattering in extinction.
    pub albedo: MitsubaVolume,
    /// Mean cosine of scattering (Henyey and Greenstein); 0: isotropic.
    pub g: f32,
    /// Light that it emits per unit of length, whatever its extinction, within the box of a grid (our addition to
    /// Mitsuba's format). `None`: none.
    pub emission: Option<MitsubaVolume>,
}

impl Importer {
    /// Index of a medium; `None` if it is not supported. Without an id it is called `role` of the element that has it.
    pub(super) fn medium(
        &mut self,
        element: usize,
        owner: usize,
        role: &str,
    ) -> Result<Option<usize>, Fault> {
        if let Some(&known) = self.media.get(&element) {
            return Ok(Some(known));
        }
        let kind = self.reader.kind(element).to_owned();
        if kind != "homogeneous" && kind != "heterogeneous" {
            let title = self.reader.title(element);
            self.reader.unsupported(element, title);
            return Ok(None);
        }
        let extinction = self.volume(element, "sigma_t", 1.0)?;
        let albedo = self.volume(element, "albedo", 0.75)?;
        let emits = self.reader.has(element, "emission");
        let emission = emits.then(|| self.volume(element, "emission", 0.0)).transpose()?;
        let scale = self.reader.float(element, "scale")?.unwrap_or(1.0) as f32;
        if scale < 0.0 {
            return Err(fault(
                self.reader.place(element),
                format!("the scale is {scale}; it must be not negative"),
            ));
        }
        if albedo.values.iter().any(|a| a.to_array().iter().any(|x| *x > 1.0)) {
            return Err(fault(
                self.reader.place(element),
                "an albedo lies outside of [0, 1]; it must lie in [0, 1]",
            ));
        }
        let grey = |v: &Vec3f| v.x == v.y && v.y == v.z;
        if !extinction.values.iter().all(grey) && extinction.values.len() > 1 {
            self.reader.unsupported(element, "a coloured grid of extinction");
        }
        let mut g = 0.0;
        if let Some((_, phase)) = self.reader.nested(element, "phase")?.first().cloned() {
            g = self.phase(phase)?;
        }
        self.reader.ignore(element, &["sample_emitters", "has_spectral_extinction"]);
        self.reader.finish(element);
        let index = self.scene.media.len();
        let owner = self.name(owner, String::new);
        let name = self.name(element, || match owner.as_str() {
            "" => format!("medium_{index}"),
            owner => format!("{owner}.{role}"),
        });
        self.scene.media.push(MitsubaMedium { name, extinction, scale, albedo, g, emission });
        self.media.insert(element, index);
        Ok(Some(index))
    }

    fn phase(&mut self, element: usize) -> Result<f32, Fault> {
        let kind = self.reader.kind(element).to_owned();
        let mut g = 0.0;
        match kind.as_str() {
            "isotropic" => {}
            "hg" => g = self.reader.float(element, "g")?.unwrap_or(0.8) as f32,
            _ => {
                let title = self.reader.title(element);
                self.reader.unsupported(element, title);
                self.reader.mark_all(element);
            }
        }
        if g.abs() >= 1.0 {
            return Err(fault(self.reader.place(element), format!("g is {g}; it must lie between -1 and 1")));
        }
        self.reader.finish(element);
        Ok(g)
    }

    fn volume(&mut self, medium: usize, name: &str, default: f32) -> Result<MitsubaVolume, Fault> {
        let bounds = [DVec3::ZERO, DVec3::ONE];
        let constant = |value: Vec3f| MitsubaVolume {
            size: [1; 3],
            values: vec![value],
            to_unit: DAffine3::IDENTITY,
            bounds,
        };
        let Some(element) = self.reader.property(medium, name, &["volume"]) else {
            let texture = self.texture(medium, name, Meaning::Unbounded, default)?;
            if texture.constant().is_none() {
                let title = self.reader.title(medium);
                self.reader.unsupported(medium, format!("a texture that varies as `{name}` of {title}"));
            }
            return Ok(constant(texture.constant().unwrap_or_else(|| Vec3f::splat(default))));
        };
        let kind = self.reader.kind(element).to_owned();
        let out = match kind.as_str() {
            "constvolume" => {
                let texture = self.texture(element, "value", Meaning::Unbounded, 1.0)?;
                constant(texture.constant().unwrap_or_else(|| Vec3f::splat(default)))
            }
            "gridvolume" => self.grid(element)?,
            _ => {
                let title = self.reader.title(element);
                self.reader.unsupported(element, title);
                self.reader.mark_all(element);
                constant(Vec3f::splat(default))
            }
        };
        self.reader.finish(element);
        Ok(out)
    }

    fn grid(&mut self, element: usize) -> Result<MitsubaVolume, Fault> {
        let place = self.reader.place(element);
        let name = self.reader.string(element, "filename")?;
        let name = name.ok_or_else(|| fault(&place, "the gridvolume has no filename; it must have one"))?;
        let own_box = self.reader.boolean(element, "use_grid_bbox", false)?;
        let to_world = self.reader.affine(element, "to_world")?;
        for (property, known) in [("filter_type", "trilinear"), ("wrap_mode", "clamp")] {
            if let Some(value) = self.reader.string(element, property)?
                && value != known
            {
                self.reader
                    .unsupported(element, format!("{property} `{}` of volume `gridvolume`", clip(&value)));
            }
        }
        self.reader.ignore(element, &["raw", "accel"]);
        let path = self.reader.document.resolve(&name, &place)?;
        let bytes = crate::load::read_file(&path, self.limits.file_bytes)
            .map_err(|e| fault(&place, e.to_string()))?;
        let (size, values, [lo, hi]) =
            parse_grid(&bytes).map_err(|rule| fault(format!("{place}: {}", path.display()), rule))?;
        let mut to_unit = to_world.inverse();
        if own_box {
            let extent = hi - lo;
            if extent.min_element() <= 0.0 {
                let rule = format!(
                    "the box of the grid goes from {lo} to {hi}; the second corner must lie above the first along each axis"
                );
                return Err(fault(format!("{place}: {}", path.display()), rule));
            }
            to_unit = DAffine3::from_scale(1.0 / extent) * DAffine3::from_translation(-lo) * to_unit;
        }
        if !to_unit.is_finite() || to_unit.matrix3.determinant() == 0.0 {
            return Err(fault(place, "the transform flattens the grid; it must not"));
        }
        Ok(MitsubaVolume { size, values, to_unit, bounds: [lo, hi] })
    }
}
