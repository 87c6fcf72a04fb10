//! `medium` elements with their volumes and phase functions.

use super::Importer;
use super::spectrum::Meaning;
use crate::error::{Fault, fault};
use crate::load::clip;
use glam::{DAffine3, DVec3};
use photofit_scalar::{Vec3f, vec3};

/// Most voxels of one grid.
const VOXELS: u64 = 1 << 28;

/// Numbers in space: the same everywhere, or on a grid over a cube.
#[derive(Clone, Debug)]
pub struct MitsubaVolume {
    /// Voxels along x, y and z; 1 x 1 x 1 where nothing varies.
    pub size: [usize; 3],
    /// Values, x fastest.
    pub values: Vec<Vec3f>,
    /// The world to the unit cube. Outside of it the value at its border goes on.
    pub to_unit: DAffine3,
}

/// A participating medium.
#[derive(Clone, Debug)]
pub struct MitsubaMedium {
    /// Extinction, per unit of length.
    pub extinction: MitsubaVolume,
    /// Factor of the extinction.
    pub scale: f32,
    /// Share of scattering in extinction.
    pub albedo: MitsubaVolume,
    /// Mean cosine of scattering (Henyey and Greenstein); 0: isotropic.
    pub g: f32,
}

impl Importer {
    /// Index of a medium; `None` if it is not supported.
    pub(super) fn medium(&mut self, element: usize) -> Result<Option<usize>, Fault> {
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
        self.scene.media.push(MitsubaMedium { extinction, scale, albedo, g });
        let index = self.scene.media.len() - 1;
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
        let constant =
            |value: Vec3f| MitsubaVolume { size: [1; 3], values: vec![value], to_unit: DAffine3::IDENTITY };
        let Some(element) = self.reader.property(medium, name, &["volume"]) else {
            let texture = self.texture(medium, name, Meaning::Unbounded, default)?;
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
            if !(extent.min_element() > 0.0 && extent.is_finite()) {
                return Err(fault(place, "the box of the grid is flat; it must have an extent"));
            }
            to_unit = DAffine3::from_scale(1.0 / extent) * DAffine3::from_translation(-lo) * to_unit;
        }
        if !to_unit.is_finite() || to_unit.matrix3.determinant() == 0.0 {
            return Err(fault(place, "the transform flattens the grid; it must not"));
        }
        Ok(MitsubaVolume { size, values, to_unit })
    }
}

/// Size, values and box of a `.vol` file.
type Grid = ([usize; 3], Vec<Vec3f>, [DVec3; 2]);

/// Reads Mitsuba's grid format: `VOL`, version 3, float32, size, channels, box, values.
fn parse_grid(bytes: &[u8]) -> Result<Grid, String> {
    const HEADER: usize = 48;
    if bytes.len() < HEADER || !bytes.starts_with(b"VOL\x03") {
        return Err("begins with VOL and version 3".into());
    }
    let int = |at: usize| {
        let word = [bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]];
        i32::from_le_bytes(word)
    };
    let real = |at: usize| f32::from_bits(int(at) as u32);
    if int(4) != 1 {
        return Err(format!("the encoding of the values is {}; it must be 1 (float32)", int(4)));
    }
    let [x, y, z, channels] = [8, 12, 16, 20].map(int).map(|n| u64::try_from(n).unwrap_or(0));
    let voxels = x.checked_mul(y).and_then(|n| n.checked_mul(z)).unwrap_or(u64::MAX);
    if voxels == 0 || voxels > VOXELS || !(channels == 1 || channels == 3) {
        return Err(format!(
            "has {x} x {y} x {z} voxels of {channels} channels; it must have 1 to {VOXELS} voxels of 1 or 3 channels"
        ));
    }
    let need = HEADER as u64 + 4 * voxels * channels;
    if (bytes.len() as u64) < need {
        return Err(format!("has {} bytes; it must have {need}", bytes.len()));
    }
    let corner = |at: usize| DVec3::new(real(at).into(), real(at + 4).into(), real(at + 8).into());
    let mut values = Vec::with_capacity(voxels as usize);
    for i in 0..voxels as usize {
        let value = |c: usize| real(HEADER + 4 * (i * channels as usize + c));
        let v = if channels == 1 { Vec3f::splat(value(0)) } else { vec3(value(0), value(1), value(2)) };
        if !(v.is_finite() && v.x >= 0.0 && v.y >= 0.0 && v.z >= 0.0) {
            return Err(format!(
                "the values are {:?} at voxel {i}; they must be finite and not negative",
                v.to_array()
            ));
        }
        values.push(v);
    }
    Ok(([x as usize, y as usize, z as usize], values, [corner(24), corner(36)]))
}
