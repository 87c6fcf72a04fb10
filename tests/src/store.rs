//! Golden files: 8-bit PNG and 32-bit float EXR.
//!
//! They are read and written by the `image` and `exr` crates directly, not by `photofit-image`: an error there
//! must not cancel against itself.

use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail};
use exr::prelude::{self as ex, ReadChannels, ReadLayers, WritableImage};
use photofit_image::Image;

/// How a golden image is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// 8 bits a sample for values in `[0, 1]`, 1 to 4 channels; the codes are `round(255 value)`, nothing else.
    Png,
    /// 32-bit floats, 1 to 9 channels.
    Exr,
}

impl Format {
    /// The distance of two neighbouring stored values.
    pub fn step(self) -> f32 {
        match self {
            Self::Png => 1.0 / 255.0,
            Self::Exr => 0.0,
        }
    }

    /// The file name's ending.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Exr => "exr",
        }
    }
}

/// The golden file of a case.
pub fn path(folder: &Path, name: &str, format: Format) -> PathBuf {
    folder.join(name).with_extension(format.extension())
}

/// Reads a golden file.
///
/// # Errors
/// If it is missing or damaged.
pub fn read(path: &Path, format: Format) -> Result<Image> {
    let bytes = fs::read(path).with_context(|| format!("{}: no golden image", path.display()))?;
    let decoded = match format {
        Format::Png => decode_png(&bytes),
        Format::Exr => decode_exr(&bytes),
    };
    decoded.with_context(|| path.display().to_string())
}

/// Writes a golden file under a temporary name and renames it.
///
/// # Errors
/// If the image does not fit the format (range, finiteness, channels) or the file cannot be written.
pub fn write(path: &Path, format: Format, image: &Image) -> Result<()> {
    let bytes = match format {
        Format::Png => encode_png(image),
        Format::Exr => encode_exr(image),
    };
    let bytes = bytes.with_context(|| path.display().to_string())?;
    let temporary = path.with_extension("tmp");
    fs::write(&temporary, bytes).with_context(|| format!("{}: cannot write", temporary.display()))?;
    fs::rename(&temporary, path).with_context(|| format!("{}: cannot rename", path.display()))
}

/// Encodes 1 to 4 channels in `[0, 1]` as 8-bit PNG.
///
/// # Errors
/// If a sample lies outside the range or the number of channels is another.
pub fn encode_png(image: &Image) -> Result<Vec<u8>> {
    let color = match image.channels {
        1 => image::ColorType::L8,
        2 => image::ColorType::La8,
        3 => image::ColorType::Rgb8,
        4 => image::ColorType::Rgba8,
        n => bail!("a PNG holds 1 to 4 channels, not {n}"),
    };
    if let Some(bad) = image.data.iter().find(|v| !(0.0..=1.0).contains(*v)) {
        bail!("a PNG holds values in [0, 1], not {bad}");
    }
    let codes: Vec<u8> = image.data.iter().map(|v| (v * 255.0).round() as u8).collect();
    let mut bytes = Vec::new();
    let encoder = image::codecs::png::PngEncoder::new(&mut bytes);
    let (width, height) = (u32::try_from(image.width)?, u32::try_from(image.height)?);
    image::ImageEncoder::write_image(encoder, &codes, width, height, color.into())?;
    Ok(bytes)
}

fn decode_png(bytes: &[u8]) -> Result<Image> {
    let decoded = image::load_from_memory_with_format(bytes, image::ImageFormat::Png)?;
    let (width, height) = (decoded.width() as usize, decoded.height() as usize);
    let (channels, codes) = match decoded {
        image::DynamicImage::ImageLuma8(i) => (1, i.into_raw()),
        image::DynamicImage::ImageLumaA8(i) => (2, i.into_raw()),
        image::DynamicImage::ImageRgb8(i) => (3, i.into_raw()),
        image::DynamicImage::ImageRgba8(i) => (4, i.into_raw()),
        other => bail!("expected 8 bits a sample, found {:?}", other.color()),
    };
    Ok(Image::from_data(width, height, channels, codes.iter().map(|c| f32::from(*c) / 255.0).collect()))
}

/// Channel names in the order of the samples.
fn channel_names(channels: usize) -> Result<Vec<String>> {
    Ok(match channels {
        1 => vec!["Y".to_owned()],
        3 | 4 => ["R", "G", "B", "A"][..channels].iter().map(|&c| c.to_owned()).collect(),
        2 | 5..=9 => (0..channels).map(|c| format!("C{c}")).collect(),
        n => bail!("a golden EXR holds 1 to 9 channels, not {n}"),
    })
}

fn encode_exr(image: &Image) -> Result<Vec<u8>> {
    let list = channel_names(image.channels)?
        .iter()
        .enumerate()
        .map(|(c, name)| {
            let plane = image.data.iter().skip(c).step_by(image.channels).copied().collect();
            ex::AnyChannel::new(name.as_str(), ex::FlatSamples::F32(plane))
        })
        .collect();
    let layer = ex::Layer::new(
        (image.width, image.height),
        ex::LayerAttributes::default(),
        ex::Encoding::SMALL_LOSSLESS,
        ex::AnyChannels::sort(list),
    );
    let mut bytes = Cursor::new(Vec::new());
    ex::Image::from_layer(layer).write().to_buffered(&mut bytes)?;
    Ok(bytes.into_inner())
}

fn decode_exr(bytes: &[u8]) -> Result<Image> {
    let reader = ex::read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
    let layer = reader.all_attributes().from_buffered(Cursor::new(bytes))?.layer_data;
    let stored = &layer.channel_data.list;
    let mut image = Image::new(layer.size.width(), layer.size.height(), stored.len());
    for (c, name) in channel_names(stored.len())?.iter().enumerate() {
        let found = stored.iter().find(|channel| channel.name.eq(name.as_str()));
        let channel = found.ok_or_else(|| anyhow!("no channel {name}"))?;
        for (pixel, value) in
            image.data.chunks_exact_mut(stored.len()).zip(channel.sample_data.values_as_f32())
        {
            pixel[c] = value;
        }
    }
    Ok(image)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_give_back_what_was_stored() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        for channels in [1, 2, 3, 4] {
            let codes = (0..5 * 4 * channels).map(|i| (i * 3) as f32 / 255.0).collect();
            let image = Image::from_data(5, 4, channels, codes);
            for format in [Format::Png, Format::Exr] {
                let file = path(folder.path(), "image", format);
                write(&file, format, &image).expect("written");
                assert_eq!(read(&file, format).expect("read"), image, "{format:?} with {channels} channels");
            }
        }
        let image = Image::from_data(2, 1, 9, (0..18).map(|i| (i as f32 - 9.0) * 1e5).collect());
        let file = path(folder.path(), "floats", Format::Exr);
        write(&file, Format::Exr, &image).expect("written");
        assert_eq!(read(&file, Format::Exr).expect("read"), image);
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        for bad in [1.5, -0.1, f32::NAN] {
            assert!(encode_png(&Image::from_data(1, 1, 1, vec![bad])).is_err(), "{bad}");
        }
        assert!(encode_png(&Image::new(1, 1, 5)).is_err(), "five channels");
        assert!(encode_exr(&Image::new(1, 1, 10)).is_err(), "ten channels");
        assert!(read(Path::new("no/such/file.png"), Format::Png).is_err(), "a missing file");
    }
}
