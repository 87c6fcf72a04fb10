//! Material extensions, read from the JSON as it stands.

use super::document::Document;
use super::material::read_slot;
use crate::error::{Fault, fault};
use crate::load::file::clip;
use crate::load::texture::Textures;
use crate::{Anisotropy, Clearcoat, Extensions, Sheen, Specular, TextureSlot, Transmission, Volume};
use serde_json::Value;

/// The extensions of material `m`; `None` where it has none that is read here.
pub(super) fn read<'a>(
    document: &'a Document<'_>,
    m: usize,
    place: &str,
    textures: &mut Textures<'a>,
    warnings: &mut Vec<String>,
) -> Result<Option<Box<Extensions>>, Fault> {
    let mut of = Reader { document, m, place, textures, warnings };
    let mut out = Extensions::default();
    if of.object("ior")?.is_some() {
        out.ior =
            of.number("ior", "ior", Extensions::IOR, "be at least 1, or 0", |x| x >= 1.0 || x == 0.0)?;
    }
    if of.object("specular")?.is_some() {
        out.specular = Some(Specular {
            factor: of.unit("specular", "specularFactor", 1.0)?,
            texture: of.slot("specular", "specularTexture")?,
            color: of.color("specular", "specularColorFactor", [1.0; 3], f32::MAX)?,
            color_texture: of.slot("specular", "specularColorTexture")?,
        });
    }
    if of.object("transmission")?.is_some() {
        out.transmission = Some(Transmission {
            factor: of.unit("transmission", "transmissionFactor", 0.0)?,
            texture: of.slot("transmission", "transmissionTexture")?,
        });
    }
    if of.object("volume")?.is_some() {
        out.volume = Some(Volume {
            thickness: of.number("volume", "thicknessFactor", 0.0, "be not negative", |x| x >= 0.0)?,
            thickness_texture: of.slot("volume", "thicknessTexture")?,
            attenuation_distance: of.number(
                "volume",
                "attenuationDistance",
                f32::INFINITY,
                "be positive",
                |x| x > 0.0,
            )?,
            attenuation_color: of.color("volume", "attenuationColor", [1.0; 3], 1.0)?,
        });
    }
    if of.object("clearcoat")?.is_some() {
        out.clearcoat = Some(Clearcoat {
            factor: of.unit("clearcoat", "clearcoatFactor", 0.0)?,
            texture: of.slot("clearcoat", "clearcoatTexture")?,
            roughness: of.unit("clearcoat", "clearcoatRoughnessFactor", 0.0)?,
            roughness_texture: of.slot("clearcoat", "clearcoatRoughnessTexture")?,
            normal_texture: of.slot("clearcoat", "clearcoatNormalTexture")?,
            normal_scale: of
                .number("clearcoat", "clearcoatNormalTexture/scale", 1.0, "be finite", |_| true)?,
        });
    }
    if of.object("sheen")?.is_some() {
        out.sheen = Some(Sheen {
            color: of.color("sheen", "sheenColorFactor", [0.0; 3], 1.0)?,
            color_texture: of.slot("sheen", "sheenColorTexture")?,
            roughness: of.unit("sheen", "sheenRoughnessFactor", 0.0)?,
            roughness_texture: of.slot("sheen", "sheenRoughnessTexture")?,
        });
    }
    if of.object("anisotropy")?.is_some() {
        out.anisotropy = Some(Anisotropy {
            strength: of.unit("anisotropy", "anisotropyStrength", 0.0)?,
            rotation: of.number("anisotropy", "anisotropyRotation", 0.0, "be finite", |_| true)?,
            texture: of.slot("anisotropy", "anisotropyTexture")?,
        });
    }
    Ok((out != Extensions::default()).then(|| Box::new(out)))
}

struct Reader<'r, 'a, 'd> {
    document: &'a Document<'d>,
    m: usize,
    /// The material, by index and name.
    place: &'r str,
    textures: &'r mut Textures<'a>,
    warnings: &'r mut Vec<String>,
}

impl<'a> Reader<'_, 'a, '_> {
    fn raw(&self) -> &'a Value {
        &self.document.materials[self.m]
    }

    fn fault(&self, extension: &str, rule: &str) -> Fault {
        fault(self.place, format!("KHR_materials_{extension}: {rule}"))
    }

    /// The extension, which is an object where it is there.
    fn object(&self, extension: &str) -> Result<Option<&'a Value>, Fault> {
        match self.raw().pointer(&format!("/extensions/KHR_materials_{extension}")) {
            Some(v) if !v.is_object() => Err(self.fault(extension, "is no object; it must be one")),
            found => Ok(found),
        }
    }

    fn value(&self, extension: &str, key: &str) -> Option<&'a Value> {
        self.raw().pointer(&format!("/extensions/KHR_materials_{extension}/{key}"))
    }

    /// A finite number for which `holds`.
    fn number(
        &self,
        extension: &str,
        key: &str,
        default: f32,
        rule: &str,
        holds: impl Fn(f32) -> bool,
    ) -> Result<f32, Fault> {
        match self.value(extension, key) {
            None => Ok(default),
            Some(v) => finite(v).filter(|x| holds(*x)).ok_or_else(|| {
                let key = key.replace('/', ".");
                self.fault(extension, &format!("{key} is {}; it must {rule}", clip(&v.to_string())))
            }),
        }
    }

    fn unit(&self, extension: &str, key: &str, default: f32) -> Result<f32, Fault> {
        self.number(extension, key, default, "lie in [0, 1]", |x| (0.0..=1.0).contains(&x))
    }

    /// Three finite numbers from 0 to `most`.
    fn color(&self, extension: &str, key: &str, default: [f32; 3], most: f32) -> Result<[f32; 3], Fault> {
        let Some(v) = self.value(extension, key) else { return Ok(default) };
        let channel = |v: &Value| finite(v).filter(|x| (0.0..=most).contains(x));
        let numbers = match v.as_array().map(Vec::as_slice) {
            Some([r, g, b]) => channel(r).zip(channel(g)).zip(channel(b)),
            _ => None,
        };
        let rule = if most > 1.0 { "be not negative and finite" } else { "lie in [0, 1]" };
        let ((r, g), b) = numbers.ok_or_else(|| {
            self.fault(
                extension,
                &format!("{key} is {}; it must have three channels, each must {rule}", clip(&v.to_string())),
            )
        })?;
        Ok([r, g, b])
    }

    fn slot(&mut self, extension: &str, key: &str) -> Result<Option<TextureSlot>, Fault> {
        let Some(v) = self.value(extension, key) else { return Ok(None) };
        let whole = |key: &str| v.get(key).and_then(Value::as_u64);
        let Some(texture) = whole("index").and_then(|i| usize::try_from(i).ok()) else {
            return Err(
                self.fault(extension, &format!("{key}.index is missing or no index; it must be a texture"))
            );
        };
        let set = whole("texCoord").map_or(0, |s| s.min(99) as u32);
        let path = format!("/extensions/KHR_materials_{extension}/{key}");
        read_slot(self.document, texture, set, self.raw(), self.m, &path, self.textures, self.warnings)
            .map(Some)
    }
}

fn finite(v: &Value) -> Option<f32> {
    v.as_f64().map(|x| x as f32).filter(|x| x.is_finite())
}
