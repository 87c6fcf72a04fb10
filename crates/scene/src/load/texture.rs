//! Decoding the textures that materials use, within a budget of texels.

use super::Limits;
use crate::TextureImage;
use crate::error::{Fault, fault};
use photofit_image::{TextureTexels, decode_texture_texels};
use photofit_ktx2::{Ktx2Error, level_count};
use photofit_texture::MipLayout;
use rayon::prelude::*;
use serde_json::Value;
use std::borrow::Cow;
use std::collections::{HashMap, HashSet};

/// Textures requested so far; each is decoded once.
#[derive(Debug)]
pub(crate) struct Textures<'a> {
    limits: &'a Limits,
    texels: u64,
    /// Encoded bytes requested so far: many images may share the same ones.
    encoded: u64,
    pending: Vec<Pending<'a>>,
    known: HashMap<String, usize>,
}

#[derive(Debug)]
struct Pending<'a> {
    place: String,
    name: String,
    extras: Option<Value>,
    bytes: Cow<'a, [u8]>,
    texels: u64,
    /// More than 8 bits a channel.
    deep: bool,
}

impl<'a> Textures<'a> {
    pub(crate) fn new(limits: &'a Limits) -> Self {
        Self { limits, texels: 0, encoded: 0, pending: Vec::new(), known: HashMap::new() }
    }

    /// Index of the texture requested under this key before.
    pub(crate) fn known(&self, key: &str) -> Option<usize> {
        self.known.get(key).copied()
    }

    /// Asks for a PNG, JPEG, WebP or KTX 2.0 texture; its size is checked here, its texels are decoded by [`Self::decode`].
    pub(crate) fn request(
        &mut self,
        key: String,
        place: String,
        name: String,
        bytes: Cow<'a, [u8]>,
    ) -> Result<usize, Fault> {
        self.encoded = self.encoded.saturating_add(bytes.len() as u64);
        if self.encoded > self.limits.file_bytes {
            return Err(fault(
                place,
                format!(
                    "all textures have {} bytes up to here; there may be at most {} bytes",
                    self.encoded, self.limits.file_bytes
                ),
            ));
        }
        let (width, height) =
            photofit_image::texture_size(&bytes).map_err(|e| fault(&place, image_rule(e)))?;
        let side = self.limits.texture_side;
        if width > side || height > side {
            return Err(fault(
                place,
                format!("has {width} x {height} texels; it may have at most {side} x {side} texels"),
            ));
        }
        let levels = file_levels(&bytes).map_err(|rule| fault(&place, rule))?;
        let texels = MipLayout::first(width, height, levels).texels() as u64;
        let deep = photofit_image::texture_is_deep(&bytes).map_err(|e| fault(&place, image_rule(e)))?;
        self.texels = self.texels.saturating_add(texels);
        if self.texels > self.limits.texels {
            return Err(fault(
                place,
                format!(
                    "all textures have {} texels up to here; there may be at most {} texels",
                    self.texels, self.limits.texels
                ),
            ));
        }
        self.known.insert(key, self.pending.len());
        self.pending.push(Pending { place, name, extras: None, bytes, texels, deep });
        Ok(self.pending.len() - 1)
    }

    /// Application data of a texture that was requested.
    pub(crate) fn set_extras(&mut self, index: usize, extras: Option<Value>) {
        self.pending[index].extras = extras;
    }

    /// All textures, in the order of their requests. Of more than 8 bits those that hold `data` keep all, as long as there is
    /// room beside the 8 bits of every texture; those for which there is none are told. Nothing reads colours in more than 8.
    pub(crate) fn decode(
        mut self,
        data: &HashSet<usize>,
        warnings: &mut Vec<String>,
    ) -> Result<Vec<TextureImage>, Fault> {
        let most = self.limits.texels;
        let mut room = most - self.texels;
        for (i, p) in self.pending.iter_mut().enumerate().filter(|(_, p)| p.deep) {
            // Twice the bytes of 8 bits, which are kept, too.
            let more = p.texels.saturating_mul(2);
            p.deep = data.contains(&i);
            if p.deep && more > room {
                p.deep = false;
                let place = &p.place;
                warnings.push(format!(
                    "{place}: is read in 8 bits; there is no room for its 16 in {most} texels"
                ));
            }
            room -= if p.deep { more } else { 0 };
        }
        let limits = photofit_image::Limits {
            max_side: self.limits.texture_side as u32,
            ..photofit_image::Limits::default()
        };
        let keep = self.limits.keep_encoded;
        let images: Vec<Result<TextureImage, Fault>> = self
            .pending
            .into_par_iter()
            .map(|p| {
                let read = decode_texture_texels(&p.bytes, &limits, p.deep);
                let TextureTexels { width, height, texels, texels16 } =
                    read.map_err(|e| fault(&p.place, image_rule(e)))?;
                let mips = mip_levels(&p.bytes).map_err(|rule| fault(&p.place, rule))?;
                let encoded = keep.then(|| p.bytes.as_ref().into());
                let image = TextureImage { width, height, texels, texels16, mips, ..TextureImage::default() };
                Ok(TextureImage { name: p.name, extras: p.extras, encoded, ..image })
            })
            .collect();
        // The first error in the file's order, whichever thread met one first.
        images.into_iter().collect()
    }
}

/// Mip levels that a texture's file holds, the base included.
fn file_levels(bytes: &[u8]) -> Result<usize, String> {
    if photofit_ktx2::is_ktx2(bytes) { level_count(bytes).map_err(damaged) } else { Ok(1) }
}

/// The mip levels that a texture's file holds beside the base, which was decoded before: so its size is known to be allowed.
/// None where every reader makes its own.
///
/// # Errors
/// If a level cannot be decoded.
pub(crate) fn mip_levels(bytes: &[u8]) -> Result<Vec<Vec<[u8; 4]>>, String> {
    (1..file_levels(bytes)?).map(|k| Ok(photofit_ktx2::decode(bytes, k).map_err(damaged)?.2)).collect()
}

fn damaged(error: Ktx2Error) -> String {
    format!("is not a valid KTX 2.0 texture: {error}")
}

/// The message of an image error without its place, which the caller knows better.
fn image_rule(error: photofit_image::ImageError) -> String {
    let text = error.at("").to_string();
    text.strip_prefix(": ").unwrap_or(&text).to_owned()
}

/// `KHR_texture_transform` as an affine map: offset after rotation after scale.
///
/// The rotation turns texture coordinates counter-clockwise as seen in the image, whose v points down.
pub(crate) fn affine_of_transform(offset: [f32; 2], rotation: f32, scale: [f32; 2]) -> [[f32; 3]; 2] {
    let (s, c) = rotation.sin_cos();
    [[c * scale[0], s * scale[1], offset[0]], [-s * scale[0], c * scale[1], offset[1]]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn textures_of_16_bits_are_read_in_8_where_there_is_no_room() {
        let fast = photofit_image::PngCompression::Fast;
        let deep = |value: u16| {
            let texels: Vec<u16> = (0..12).map(|k| value + 7 * k).collect();
            photofit_image::encode_png16(2, 2, 3, &texels, fast).unwrap()
        };
        let plain = photofit_image::encode_png(2, 2, 3, &[9; 12], fast).unwrap();
        let read = |files: [&[u8]; 2], texels: u64, holds_data: fn(usize) -> bool| {
            let limits = Limits { texels, ..Limits::default() };
            let mut textures = Textures::new(&limits);
            for (k, bytes) in files.into_iter().enumerate() {
                textures
                    .request(format!("{k}"), format!("image {k}"), String::new(), bytes.into())
                    .map_err(|f| f.rule)?;
            }
            let mut warnings = Vec::new();
            let images = textures
                .decode(&(0..2).filter(|i| holds_data(*i)).collect(), &mut warnings)
                .map_err(|f| f.rule)?;
            Ok::<_, String>((images.iter().map(|i| i.texels16.len()).collect::<Vec<_>>(), warnings))
        };
        let [first, second] = [deep(20_000), deep(30_000)];
        let both = [&first[..], &second];
        assert_eq!(read(both, 24, |_| true), Ok((vec![4, 4], Vec::new())));
        let (kept, told) = read(both, 23, |_| true).unwrap();
        assert_eq!((kept, told.len()), (vec![4, 0], 1));
        assert_eq!(told[0], "image 1: is read in 8 bits; there is no room for its 16 in 23 texels");
        assert_eq!(read(both, 15, |_| true).unwrap().0, [0, 0]);
        assert!(read(both, 7, |_| true).unwrap_err().contains("8 texels"));
        // Colours take no room of data.
        assert_eq!(read(both, 16, |i| i == 1), Ok((vec![0, 4], Vec::new())));
        // What comes first takes no room of what follows.
        let mixed = [&first[..], &plain];
        assert_eq!(read(mixed, 16, |_| true), Ok((vec![4, 0], Vec::new())));
        assert_eq!(read(mixed, 15, |_| true).unwrap().0, [0, 0]);
        assert_eq!(read(mixed, 8, |_| true).unwrap().1.len(), 1);
    }
}
