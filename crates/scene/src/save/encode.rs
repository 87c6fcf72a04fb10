//! Images as the files that hold them.

use super::levels::{Use, levels};
use crate::error::fault;
use crate::load::texture::mip_levels;
use crate::{Scene, SceneError, TextureEncoding, TextureImage};
use photofit_image::{
    PngCompression, TextureTexels, decode_texture_texels, encode_jpeg, encode_png, encode_png16, encode_webp,
    encode_webp_lossy,
};

pub(super) const WEBP: &str = "image/webp";
pub(super) const KTX2: &str = "image/ktx2";
/// Squared error that a bit is worth for each step of quality below 100.
const LAMBDA_PER_QUALITY: f32 = 0.5;

/// The type of a PNG, JPEG, WebP or KTX 2.0 texture.
fn mime(encoded: &[u8]) -> &'static str {
    match encoded {
        _ if photofit_ktx2::is_ktx2(encoded) => KTX2,
        [0xff, 0xd8, ..] => "image/jpeg",
        [b'R', b'I', b'F', b'F', ..] => WEBP,
        _ => "image/png",
    }
}

impl Scene {
    /// An image as it is read again once it was written in this encoding: what the encoding loses is lost,
    /// [`TextureImage::encoded`] holds its bytes. What cannot be stored so is stored as PNG (see [`TextureEncoding`]).
    ///
    /// # Errors
    /// If the encoding cannot hold an image of this size.
    ///
    /// # Panics
    /// If there is no such image.
    pub fn stored_as(&self, image: usize, encoding: TextureEncoding) -> Result<TextureImage, SceneError> {
        let plain = TextureImage { encoding, encoded: None, ..self.images[image].clone() };
        let refused = |rule: String| fault(format!("image {:?}", plain.name), rule).in_scene();
        let (bytes, mime) = encode(self, image, &plain).map_err(refused)?;
        let encoding = if mime == "image/png" { TextureEncoding::Png } else { encoding };
        TextureImage { encoding, encoded: Some(bytes.into()), ..plain }.read_again()
    }
}

impl TextureImage {
    /// The image with the texels and mip levels that [`Self::encoded`] decodes to; as it is without.
    ///
    /// # Errors
    /// If that is no PNG, JPEG, WebP or KTX 2.0 texture.
    pub fn read_again(self) -> Result<Self, SceneError> {
        let Some(bytes) = &self.encoded else { return Ok(self) };
        let read = decode_texture_texels(bytes, &photofit_image::Limits::default(), true);
        let read = read.map_err(|e| e.to_string()).and_then(|base| Ok((base, mip_levels(bytes)?)));
        match read {
            Ok((TextureTexels { width, height, texels, texels16 }, mips)) => {
                Ok(Self { width, height, texels, texels16, mips, ..self })
            }
            Err(rule) => Err(fault(format!("image {:?}", self.name), rule).in_scene()),
        }
    }
}

/// What the levels of an image follow from, where it can be stored as KTX 2.0: `KHR_texture_basisu` wants sides that are
/// multiples of 4, and one transfer function.
fn use_in_ktx2(scene: &Scene, index: usize, image: &TextureImage) -> Option<Use> {
    let blocks = image.width.is_multiple_of(4) && image.height.is_multiple_of(4);
    Use::of(scene, index).filter(|_| blocks)
}

fn encode_ktx2(image: &TextureImage, used: Use, quality: u8) -> Result<Vec<u8>, String> {
    let rdo_lambda = f32::from(100 - quality.clamp(1, 100)) * LAMBDA_PER_QUALITY;
    let options = photofit_ktx2::Options { rdo_lambda, ..photofit_ktx2::Options::new(used.is_color()) };
    photofit_ktx2::encode(&levels(image, used), &options).map_err(|e| e.to_string())
}

impl Scene {
    /// How an image is stored in a file: as [`TextureImage::encoding`] says, or as PNG where that cannot hold it (alpha as JPEG, sides
    /// that are no multiples of 4 as KTX 2.0). A file that was read ([`TextureImage::encoded`]) is stored as it is.
    ///
    /// # Panics
    /// If there is no such image.
    pub fn stored_encoding(&self, image: usize) -> TextureEncoding {
        possible(self, image, &self.images[image])
    }
}

/// The encoding of an image, number `index` of the scene or a copy of it, or PNG where that cannot hold it.
fn possible(scene: &Scene, index: usize, image: &TextureImage) -> TextureEncoding {
    let holds = match image.encoding {
        TextureEncoding::Ktx2 { .. } => use_in_ktx2(scene, index, image).is_some(),
        TextureEncoding::Jpeg { .. } => image.texels.iter().all(|t| t[3] == u8::MAX),
        _ => true,
    };
    if holds { image.encoding } else { TextureEncoding::Png }
}

/// The bytes of an image, number `index` of the scene or a copy of it, and their type.
pub(super) fn encode(
    scene: &Scene,
    index: usize,
    image: &TextureImage,
) -> Result<(Vec<u8>, &'static str), String> {
    if let Some(bytes) = &image.encoded {
        return Ok((bytes.to_vec(), mime(bytes)));
    }
    if let TextureEncoding::Ktx2 { quality } = image.encoding
        && let Some(used) = use_in_ktx2(scene, index, image)
    {
        return Ok((encode_ktx2(image, used, quality)?, KTX2));
    }
    let (width, height) = (image.width, image.height);
    let (channels, bytes) = samples(&image.texels, u8::MAX);
    let (file, mime) = match possible(scene, index, image) {
        TextureEncoding::WebP => (encode_webp(width, height, channels, &bytes), WEBP),
        TextureEncoding::LossyWebP { quality } => {
            (encode_webp_lossy(width, height, channels, &bytes, quality), WEBP)
        }
        TextureEncoding::Jpeg { quality } => (encode_jpeg(width, height, &bytes, quality), "image/jpeg"),
        _ if image.texels16.is_empty() => {
            (encode_png(width, height, channels, &bytes, PngCompression::Small), "image/png")
        }
        _ => {
            let (channels, samples) = samples(&image.texels16, u16::MAX);
            (encode_png16(width, height, channels, &samples, PngCompression::Small), "image/png")
        }
    };
    Ok((file.map_err(|e| e.to_string())?, mime))
}

/// Number of channels and samples: without alpha where all of it is `opaque`.
fn samples<S: Copy + PartialEq>(texels: &[[S; 4]], opaque: S) -> (usize, Vec<S>) {
    let channels = if texels.iter().all(|t| t[3] == opaque) { 3 } else { 4 };
    (channels, texels.iter().flat_map(|t| &t[..channels]).copied().collect())
}
