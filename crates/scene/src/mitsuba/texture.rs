//! `texture` elements, and the colours that may stand in their place.

use super::spectrum::Meaning;
use super::{BitmapKey, Importer, picture};
use crate::error::{Fault, fault};
use crate::graph::{Bitmap, IDENTITY_UV, MAX_GRAPH_DEPTH, Texture, UvTransform};
use crate::load::clip;
use photofit_image::{Image, linear_to_srgb_u8};
use photofit_scalar::{Vec3f, vec3};
use photofit_texture::{Filter, Wrap};
use std::path::Path;
use std::sync::Arc;

impl Importer {
    /// A property that is a number, a colour, a spectrum or a texture.
    pub(super) fn texture(
        &mut self,
        plugin: usize,
        name: &str,
        meaning: Meaning,
        default: f32,
    ) -> Result<Texture, Fault> {
        let found = self.optional_texture(plugin, name, meaning)?;
        Ok(found.unwrap_or_else(|| Texture::number(default)))
    }

    /// As [`Self::texture`], `None` where the property is not there.
    pub(super) fn optional_texture(
        &mut self,
        plugin: usize,
        name: &str,
        meaning: Meaning,
    ) -> Result<Option<Texture>, Fault> {
        let tags = ["float", "integer", "rgb", "spectrum", "texture"];
        match self.reader.property(plugin, name, &tags) {
            Some(e) => self.texture_of(e, meaning, 0).map(Some),
            None => Ok(None),
        }
    }

    /// What an element stands for.
    pub(super) fn texture_of(
        &mut self,
        element: usize,
        meaning: Meaning,
        depth: usize,
    ) -> Result<Texture, Fault> {
        let place = self.reader.place(element);
        if depth > MAX_GRAPH_DEPTH {
            return Err(fault(
                place,
                format!("textures are nested more than {MAX_GRAPH_DEPTH} deep; that many are accepted"),
            ));
        }
        let color = match self.reader.tag(element) {
            "float" | "integer" => Vec3f::splat(self.reader.attribute_number(element, "value")? as f32),
            "rgb" => self.reader.rgb(element)?,
            "spectrum" => self.reader.spectrum(element, meaning)?,
            _ => return self.texture_plugin(element, meaning, depth),
        };
        if color.to_array().iter().any(|x| *x < 0.0) {
            return Err(fault(
                place,
                format!("the colour is {:?}; it must not be negative", color.to_array()),
            ));
        }
        if meaning == Meaning::Reflectance && color.to_array().iter().any(|x| *x > 1.0) {
            return Err(fault(
                place,
                format!("the reflectance is {:?}; it must lie in [0, 1]", color.to_array()),
            ));
        }
        Ok(Texture::Constant(color))
    }

    fn texture_plugin(&mut self, element: usize, meaning: Meaning, depth: usize) -> Result<Texture, Fault> {
        let kind = self.reader.kind(element).to_owned();
        let out = match kind.as_str() {
            "bitmap" => self.bitmap(element)?,
            "checkerboard" => {
                let mut side = |name: &str, default: f32| -> Result<Texture, Fault> {
                    let tags = ["float", "integer", "rgb", "spectrum", "texture"];
                    match self.reader.property(element, name, &tags) {
                        Some(e) => self.texture_of(e, meaning, depth + 1),
                        None => Ok(Texture::number(default)),
                    }
                };
                let colors = Arc::new([side("color0", 0.4)?, side("color1", 0.2)?]);
                Texture::Checkerboard { colors, to_uv: self.uv_transform(element)? }
            }
            "mesh_attribute" => self.mesh_attribute(element)?,
            "rawconstant" => {
                let value = if let Some(v) = self.reader.point(element, "value")? {
                    vec3(v.x as f32, v.y as f32, v.z as f32)
                } else if let Some(e) = self.reader.property(element, "value", &["rgb"]) {
                    self.reader.rgb(e)?
                } else {
                    Vec3f::splat(self.reader.float(element, "value")?.unwrap_or(0.0) as f32)
                };
                Texture::Constant(value)
            }
            "uniform" | "d65" | "srgb" => {
                return Ok(Texture::Constant(self.reader.spectrum(element, meaning)?));
            }
            _ => {
                let title = self.reader.title(element);
                self.reader.unsupported(element, title);
                self.reader.mark_all(element);
                Texture::number(0.5)
            }
        };
        self.reader.finish(element);
        Ok(out)
    }

    /// The transform of texture coordinates.
    fn uv_transform(&mut self, element: usize) -> Result<UvTransform, Fault> {
        if self.reader.property(element, "to_uv", &["transform"]).is_none() {
            return Ok(IDENTITY_UV);
        }
        let m = self.reader.affine(element, "to_uv")?;
        let (x, y, t) = (m.matrix3.x_axis, m.matrix3.y_axis, m.translation);
        Ok([[x.x as f32, y.x as f32, t.x as f32], [x.y as f32, y.y as f32, t.y as f32]])
    }

    fn bitmap(&mut self, element: usize) -> Result<Texture, Fault> {
        let place = self.reader.place(element);
        let to_uv = self.uv_transform(element)?;
        let name = self.reader.string(element, "filename")?;
        let name = name.ok_or_else(|| fault(&place, "the bitmap has no filename; it must have one"))?;
        let raw = self.reader.boolean(element, "raw", false)?;
        let wrap = match self.reader.string(element, "wrap_mode")?.as_deref() {
            None | Some("repeat") => Wrap::Repeat,
            Some("mirror") => Wrap::MirroredRepeat,
            Some("clamp") => Wrap::ClampToEdge,
            Some(other) => {
                return Err(fault(
                    place,
                    format!("wrap_mode is `{}`; it must be repeat, mirror or clamp", clip(other)),
                ));
            }
        };
        let filter = match self.reader.string(element, "filter_type")?.as_deref() {
            None | Some("bilinear") => Filter::Bilinear,
            Some("nearest") => Filter::Nearest,
            Some(other) => {
                return Err(fault(
                    place,
                    format!("filter_type is `{}`; it must be bilinear or nearest", clip(other)),
                ));
            }
        };
        self.reader.ignore(element, &["format", "accel"]);
        let path = self.reader.document.resolve(&name, &place)?;
        let key: BitmapKey = (path, raw, wrap, filter);
        if let Some(image) = self.bitmaps.get(&key) {
            return Ok(Texture::Bitmap { image: image.clone(), to_uv, scale: 1.0 });
        }
        let image = self.image(&key.0, raw, &place)?;
        let image = Arc::new(Bitmap::new(&image, wrap, filter));
        self.bitmaps.insert(key, image.clone());
        Ok(Texture::Bitmap { image, to_uv, scale: 1.0 })
    }

    /// An image in linear light, or as it is stored.
    pub(super) fn image(&mut self, path: &Path, raw: bool, place: &str) -> Result<Image, Fault> {
        let side = u32::try_from(self.limits.texture_side).unwrap_or(u32::MAX);
        let bytes =
            crate::load::read_file(path, self.limits.file_bytes).map_err(|e| fault(place, e.to_string()))?;
        let mut image = match picture::decode(&bytes, self.limits.texture_side) {
            Some(image) => image.map_err(|rule| fault(format!("{place}: {}", path.display()), rule))?,
            None => {
                let limits = photofit_image::Limits { max_side: side, ..photofit_image::Limits::default() };
                photofit_image::decode(&bytes, &path.display().to_string(), &limits)
                    .map_err(|e| fault(place, e.to_string()))?
            }
        };
        self.texels += image.width as u64 * image.height as u64;
        if self.texels > self.limits.texels {
            return Err(fault(
                place,
                format!("images have {} texels up to here; there may be {}", self.texels, self.limits.texels),
            ));
        }
        if let Some((x, y, _)) = image.find(|v| !v.is_finite()) {
            let file = format!("{place}: {}", path.display());
            return Err(fault(file, format!("the texel in column {x} of row {y} is not finite; it must be")));
        }
        let stored_in_bytes = [&b"\x89PNG"[..], b"\xff\xd8", b"BM"].iter().any(|m| bytes.starts_with(m));
        if raw && stored_in_bytes {
            let channels = image.channels;
            for p in image.data.chunks_exact_mut(channels) {
                let colors = if channels == 2 || channels == 4 { channels - 1 } else { channels };
                for x in &mut p[..colors] {
                    *x = f32::from(linear_to_srgb_u8(*x)) / 255.0;
                }
            }
        }
        Ok(image)
    }

    fn mesh_attribute(&mut self, element: usize) -> Result<Texture, Fault> {
        let place = self.reader.place(element);
        let name = self.reader.string(element, "name")?.unwrap_or_default();
        let scale = self.reader.float(element, "scale")?.unwrap_or(1.0) as f32;
        self.uses_attributes = true;
        let Some(attributes) = &mut self.attributes else {
            return Err(fault(
                place,
                "a mesh attribute stands on a shape without vertices; it must stand on a mesh",
            ));
        };
        if let Some(values) = attributes.faces.get(&name) {
            return Ok(Texture::FaceAttribute { values: values.clone(), scale });
        }
        if !attributes.vertices.contains_key(&name) {
            return Err(fault(place, format!("the mesh has no attribute `{}`", clip(&name))));
        }
        match &attributes.chosen {
            Some(other) if *other != name => {
                self.reader.unsupported(element, "a second vertex attribute on one mesh");
            }
            _ => attributes.chosen = Some(name),
        }
        Ok(Texture::VertexAttribute { scale })
    }
}
