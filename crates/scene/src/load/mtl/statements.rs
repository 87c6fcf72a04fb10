//! What a library says about a material, and what it means.

use super::Map;
use crate::error::{Fault, fault};
use crate::load::obj::numbers;
use crate::{AlphaMode, Anisotropy, Clearcoat, Extensions, Material, Sheen, Specular, Transmission};

/// Reads the texture of a statement, which may be needed.
pub(super) type ReadMap<'a> = dyn FnMut(&str, bool) -> Result<Option<Map>, Fault> + 'a;

/// The statements of a material; `None` where there is none.
#[derive(Debug, Default)]
pub(super) struct Statements {
    diffuse: Option<[f32; 3]>,
    ambient: Option<[f32; 3]>,
    specular: Option<[f32; 3]>,
    emission: Option<[f32; 3]>,
    filter: Option<[f32; 3]>,
    exponent: Option<f32>,
    ior: Option<f32>,
    alpha: Option<f32>,
    illumination: Option<f32>,
    roughness: Option<f32>,
    metallic: Option<f32>,
    sheen: Option<f32>,
    coat: Option<f32>,
    coat_roughness: Option<f32>,
    anisotropy: Option<f32>,
    anisotropy_rotation: Option<f32>,
    pub(super) diffuse_map: Option<Map>,
    pub(super) specular_map: Option<Map>,
    pub(super) roughness_map: Option<Map>,
    pub(super) metallic_map: Option<Map>,
    pub(super) emission_map: Option<Map>,
    pub(super) alpha_map: Option<Map>,
    pub(super) normal_map: Option<Map>,
    /// A `bump`: a normal map where it has colours, else heights.
    pub(super) bump_map: Option<Map>,
}

/// What a number of `illum` asks for.
#[derive(Clone, Copy, Debug)]
struct Illumination {
    highlight: bool,
    reflection: bool,
    transparency: bool,
    glass: bool,
}

/// Whether a statement with bad values only costs what it says: not so for those without which colours or holes would be
/// wrong.
pub(super) fn may_be_left_out(keyword: &str) -> bool {
    matches!(
        keyword,
        "Ka" | "Ks" | "Ns" | "Ni" | "illum" | "Tf" | "Pr" | "Pm" | "Ps" | "Pc" | "Pcr" | "aniso" | "anisor"
    )
}

/// Least and most of the numbers of a statement, and whether one beyond is taken as the bound; else the statement is left
/// out.
fn range(keyword: &str) -> (f32, f32, bool) {
    match keyword {
        "Ns" => (0.0, 1000.0, true),
        "Ni" => (1.0, 10.0, false),
        "illum" => (0.0, 10.0, false),
        "Ke" => (0.0, f32::MAX, true),
        "Pc" => (0.0, 4.0, true),
        "anisor" => (-1.0, 1.0, true),
        _ => (0.0, 1.0, true),
    }
}

/// How far beyond its range a number may lie in silence: what exporters lose by rounding.
const ROUNDING: f32 = 1e-3;

/// The numbers of a statement within its range, `None` where it is left out; `told` hears the rule that they broke.
fn within<const N: usize>(keyword: &str, values: [f32; N], told: &mut Option<String>) -> Option<[f32; N]> {
    let (least, most, bounded) = range(keyword);
    let out = values.map(|x| x.clamp(least, most));
    let beyond = values.iter().zip(&out).find(|(x, y)| (*x - *y).abs() > ROUNDING);
    let Some((beyond, _)) = beyond else { return Some(out) };
    let must = if most == f32::MAX { format!("at least {least}") } else { format!("{least} to {most}") };
    let done = if bounded { "the nearest bound is taken" } else { "the statement is left out" };
    *told = Some(format!("`{keyword}` is {beyond:?}; it must be {must}; {done}"));
    bounded.then_some(out)
}

/// One number stands for all three.
fn color(rest: &str) -> Result<[f32; 3], String> {
    let c: [f32; 3] = numbers(rest, &[f32::MAX; 3], 1)?;
    Ok(if c[1] == f32::MAX { [c[0]; 3] } else { c.map(|x| if x == f32::MAX { 0.0 } else { x }) })
}

impl Statements {
    /// Takes a statement; whether it has a meaning here (or none that is worth a warning). `map` reads a texture, which
    /// may be needed; `told` hears of numbers out of range.
    pub(super) fn statement(
        &mut self,
        keyword: &str,
        rest: &str,
        place: &str,
        map: &mut ReadMap<'_>,
        told: &mut Option<String>,
    ) -> Result<bool, Fault> {
        let rule = |rule: String| fault(place, rule);
        let mut number = |rest: &str| -> Result<Option<f32>, Fault> {
            let n = numbers::<1>(rest, &[0.0], 1).map_err(rule)?;
            Ok(within(keyword, n, told).map(|n| n[0]))
        };
        // What is left out takes nothing from a statement before it.
        match keyword {
            "Kd" => self.diffuse = within(keyword, color(rest).map_err(rule)?, told),
            "Ka" => self.ambient = within(keyword, color(rest).map_err(rule)?, told),
            "Ks" => self.specular = within(keyword, color(rest).map_err(rule)?, told),
            "Ke" => self.emission = within(keyword, color(rest).map_err(rule)?, told),
            "Tf" => self.filter = within(keyword, color(rest).map_err(rule)?, told),
            "Ns" => self.exponent = number(rest)?,
            "Ni" => self.ior = number(rest)?.or(self.ior),
            "d" => self.alpha = number(rest.strip_prefix("-halo").unwrap_or(rest))?,
            "Tr" => self.alpha = number(rest)?.map(|t| 1.0 - t),
            "illum" => self.illumination = number(rest)?.or(self.illumination),
            "Pr" => self.roughness = number(rest)?,
            "Pm" => self.metallic = number(rest)?,
            "Ps" => self.sheen = number(rest)?,
            "Pc" => self.coat = number(rest)?,
            "Pcr" => self.coat_roughness = number(rest)?,
            "aniso" => self.anisotropy = number(rest)?,
            "anisor" => self.anisotropy_rotation = number(rest)?,
            "map_Kd" => self.diffuse_map = map(rest, true)?.or(self.diffuse_map),
            "map_Ks" => self.specular_map = map(rest, false)?.or(self.specular_map),
            // Roughness in both, as Blender reads them.
            "map_Ns" if self.roughness_map.is_none() => self.roughness_map = map(rest, false)?,
            "map_Ns" => drop(map(rest, false)?),
            "map_Pr" => self.roughness_map = map(rest, false)?.or(self.roughness_map),
            "map_Pm" => self.metallic_map = map(rest, false)?.or(self.metallic_map),
            "map_Ke" => self.emission_map = map(rest, true)?.or(self.emission_map),
            "map_d" => self.alpha_map = map(rest, false)?.or(self.alpha_map),
            "norm" | "map_Norm" | "map_norm" | "map_Kn" => {
                self.normal_map = map(rest, false)?.or(self.normal_map);
            }
            "bump" | "map_bump" | "map_Bump" => self.bump_map = map(rest, false)?.or(self.bump_map),
            "" | "#" => {}
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// Numbers that the format does not define ask for nothing.
    fn illumination(&self) -> Illumination {
        let n = self.illumination.map_or(-1, |n| n as i32);
        Illumination {
            highlight: n == 2,
            reflection: (3..=8).contains(&n),
            transparency: matches!(n, 4 | 6 | 7 | 9),
            glass: matches!(n, 4 | 9),
        }
    }

    /// The material without its maps.
    pub(super) fn material(&self, colored: bool) -> Material {
        let mean = |c: [f32; 3]| (c[0] + c[1] + c[2]) / 3.0;
        let illumination = self.illumination();
        let unset = if colored && self.diffuse_map.is_none() { 1.0 } else { 0.8 };
        let base = self.diffuse.unwrap_or([unset; 3]);
        let alpha = self.alpha.unwrap_or(1.0);
        let by_exponent = match self.exponent {
            Some(n) => 1.0 - (n / 1000.0).sqrt(),
            None if illumination.highlight => 0.0,
            None => 1.0,
        };
        let mirror = if illumination.reflection { self.ambient.map_or(1.0, mean) } else { 0.0 };
        Material {
            base_color: [base[0], base[1], base[2], alpha],
            metallic: self.metallic.unwrap_or(mirror),
            roughness: self.roughness.unwrap_or(by_exponent),
            emissive: self.emission.unwrap_or_default(),
            alpha_mode: if alpha < 1.0 { AlphaMode::Blend } else { AlphaMode::Opaque },
            extensions: self.extensions(illumination),
            ..crate::load::clay()
        }
    }

    fn extensions(&self, illumination: Illumination) -> Option<Box<Extensions>> {
        let mean = |c: [f32; 3]| (c[0] + c[1] + c[2]) / 3.0;
        let mut out = Extensions::default();
        let ior = self.ior.or(match (illumination.glass, illumination.transparency) {
            (true, _) => Some(1.5),
            (false, true) => Some(1.0),
            _ => None,
        });
        if let Some(ior) = ior {
            out.ior = ior;
        }
        // One half is the reflection that the index of refraction gives, one is twice as much.
        let level = self.specular.map_or(if illumination.highlight { 1.0 } else { 0.0 }, mean);
        if level != 0.5 && self.specular_map.is_none() {
            let color = [(2.0 * level).max(1.0); 3];
            out.specular = Some(Specular { factor: (2.0 * level).min(1.0), color, ..Specular::default() });
        }
        if let Some(weight) = self.sheen.filter(|w| *w > 0.0) {
            out.sheen = Some(Sheen { color: [weight; 3], roughness: 0.5, ..Sheen::default() });
        }
        if let Some(weight) = self.coat.filter(|w| *w > 0.0) {
            let roughness = self.coat_roughness.unwrap_or(0.03);
            out.clearcoat = Some(Clearcoat { factor: 0.25 * weight, roughness, ..Clearcoat::default() });
        }
        if let Some(strength) = self.anisotropy.filter(|a| *a > 0.0) {
            let rotation = self.anisotropy_rotation.unwrap_or(0.0) * std::f32::consts::TAU;
            out.anisotropy = Some(Anisotropy { strength, rotation, texture: None });
        }
        // Opaque materials of some exporters have a filter of one too.
        if let (Some(filter), true) = (self.filter, illumination.transparency) {
            out.transmission = Some(Transmission { factor: mean(filter), texture: None });
        }
        (out != Extensions::default()).then(|| Box::new(out))
    }
}
