//! OpenEXR: named layers of named channels.

mod planes;

pub use planes::{ExrLayer, read_exr_planes};

use super::limits::MAX_RATIO;
use super::{Format, Limits, atomic, file_bytes};
use crate::{Image, ImageError};
use exr::image::{AnyChannel, AnyChannels, Encoding, FlatSamples, Layer};
use exr::meta::MetaData;
use exr::meta::attribute::{LineOrder, SampleType, Text};
use exr::meta::header::{ImageAttributes, LayerAttributes};
use exr::prelude::{IntegerBounds, WritableImage};
use std::collections::BTreeSet;
use std::io::Cursor;
use std::path::Path;

/// Lossless; rows in order, or the bytes of a file would depend on which thread compresses faster.
const ENCODING: Encoding = Encoding { line_order: LineOrder::Increasing, ..Encoding::FAST_LOSSLESS };

/// Reads all layers of an OpenEXR file as `(layer name, image, channel names)`, in the order of the file.
///
/// Parts of a multi-part file are layers, and so are groups of channels with a common prefix in their names
/// (`albedo.R`, `albedo.G`), as many renderers write them; a layer inside a named part is called `part.prefix`.
/// Channels come in the order R, G, B, A, then X, Y, Z, then the others as stored. Only the full resolution level is
/// read. Default [`Limits`] apply.
///
/// # Errors
/// If the file cannot be read, is no valid OpenEXR file, holds deep or subsampled data, or is larger than the limits.
pub fn read_exr_layers(path: impl AsRef<Path>) -> Result<Vec<(String, Image, Vec<String>)>, ImageError> {
    Ok(interleaved(read_exr_planes(path, every)?))
}

/// Wants every layer.
fn every(layers: &[ExrLayer]) -> Vec<bool> {
    vec![true; layers.len()]
}

fn interleaved(layers: Vec<ExrLayer>) -> Vec<(String, Image, Vec<String>)> {
    layers.into_iter().map(|l| (l.to_image(), l)).map(|(image, l)| (l.name, image, l.channels)).collect()
}

pub(super) fn decode_first(bytes: &[u8], place: &str, limits: &Limits) -> Result<Image, ImageError> {
    let first = |layers: &[ExrLayer]| (0..layers.len()).map(|k| k == 0).collect();
    let layers = planes::decode_planes(bytes, place, limits, first)?;
    layers.first().map(ExrLayer::to_image).ok_or_else(|| ImageError::invalid(place, "no layer"))
}

fn invalid(place: &str, e: &exr::error::Error) -> ImageError {
    ImageError::invalid(place, format!("not a valid OpenEXR file: {e}"))
}

/// The decoder takes the memory that the header claims and aborts where there is none: the claim is checked first.
fn check_header(bytes: &[u8], place: &str, limits: &Limits) -> Result<MetaData, ImageError> {
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(|e| invalid(place, &e))?;
    let mut left = *limits;
    let mut file_left = bytes.len();
    for header in &meta.headers {
        if header.deep {
            return Err(ImageError::invalid(place, "deep data is not read"));
        }
        if header.channels.list.iter().any(|c| c.sampling.0 != 1 || c.sampling.1 != 1) {
            return Err(ImageError::invalid(place, "subsampled channels are not read"));
        }
        let (width, height) = (header.layer_size.0 as u64, header.layer_size.1 as u64);
        let channels = header.channels.list.len() as u64;
        let sizes = header.channels.list.iter().map(|c| match c.sample_type {
            SampleType::F16 => 2,
            SampleType::F32 | SampleType::U32 => 4,
        });
        left.check(place, (width, height), channels, sizes.sum(), file_left, MAX_RATIO)?;
        left.max_samples -= width * height * channels;
        // Every block has an entry in the offset table and a head of its own.
        let blocks = header.chunk_count as u64;
        if blocks.saturating_mul(16) > bytes.len() as u64 {
            let rule = format!("{blocks} blocks do not fit the {} bytes of the file", bytes.len());
            return Err(ImageError::invalid(place, rule));
        }
        file_left = file_left.saturating_sub(16 * blocks as usize);
    }
    Ok(meta)
}

/// Rank of a channel within its layer: colour, then vectors, then the rest.
fn rank(channel: &str) -> usize {
    let known = ["R", "r", "G", "g", "B", "b", "A", "a", "X", "x", "Y", "y", "Z", "z"];
    known.iter().position(|k| *k == channel).unwrap_or(known.len())
}

/// Writes images of one size as the layers of an OpenEXR file: `(layer name, image, channel names)`.
///
/// Samples are stored as 32-bit floats with lossless compression. A single layer may have an empty name; several are
/// written as parts and need distinct names. The file appears under its name only when it is complete.
///
/// ```no_run
/// use photofit_image::{Image, write_exr};
/// let (color, depth) = (Image::new(64, 64, 3), Image::new(64, 64, 1));
/// write_exr("aov.exr", &[("color", &color, &["R", "G", "B"]), ("depth", &depth, &["Z"])])?;
/// # Ok::<(), photofit_image::ImageError>(())
/// ```
///
/// # Errors
/// If there is no layer, a layer has no pixels or another size than the first, names are missing, doubled or not
/// Latin-1, or the file system refuses.
///
/// # Panics
/// If a layer has not one name per channel.
pub fn write_exr(path: impl AsRef<Path>, layers: &[(&str, &Image, &[&str])]) -> Result<(), ImageError> {
    let of = |(name, image, channels): &(&str, &Image, &[&str])| {
        ExrLayer::of_image((*name).to_owned(), image, channels.iter().map(ToString::to_string).collect())
    };
    write_exr_planes(path, &layers.iter().map(of).collect::<Vec<_>>())
}

/// As [`write_exr`], from planes.
///
/// # Errors
/// As [`write_exr`].
///
/// # Panics
/// If a layer has not one plane per channel.
pub fn write_exr_planes(path: impl AsRef<Path>, layers: &[ExrLayer]) -> Result<(), ImageError> {
    let path = path.as_ref();
    let place = path.display().to_string();
    let bad = |rule: String| Err(ImageError::invalid(&place, rule));
    let Some(first) = layers.first() else { return bad("an OpenEXR file needs a layer".into()) };
    let mut names = BTreeSet::new();
    for ExrLayer { name, width, height, channels, planes } in layers {
        assert_eq!(planes.len(), channels.len() * width * height, "one plane per channel of layer {name:?}");
        if planes.is_empty() || (*width, *height) != (first.width, first.height) {
            return bad(format!("layer {name:?}: pixels are needed, and all layers of one size"));
        }
        if (layers.len() > 1 && name.is_empty()) || !names.insert(name) {
            return bad(format!("layer {name:?}: the layers of a file need distinct names"));
        }
        let distinct: BTreeSet<&str> = channels.iter().map(String::as_str).collect();
        if distinct.len() != channels.len() || distinct.contains("") {
            return bad(format!("layer {name:?}: channels need distinct names"));
        }
    }
    let mut parts = exr::image::Layers::new();
    for layer in layers {
        let Some(part) = part_of(layer) else {
            return bad(format!(
                "layer {:?}: names are Latin-1 without zeros and at most 255 long",
                layer.name
            ));
        };
        parts.push(part);
    }
    let bounds = IntegerBounds::from_dimensions((first.width, first.height));
    let file = exr::image::Image::from_layers(ImageAttributes::new(bounds), parts);
    atomic::write_with(path, |writer| file.write().to_buffered(writer)).map_err(|e| match e {
        exr::error::Error::Io(source) => ImageError::io(path, source),
        e => invalid(&place, &e),
    })
}

/// Writes images of one size as the channels of one part, as renderers do: those of the layer `""` plain, those of
/// other layers as `layer.channel`; with metadata as lines `key: value` of the attribute `comments`.
///
/// [`read_exr_layers`] gives the layers back. Samples are stored as 32-bit floats with lossless compression. The file
/// appears under its name only when it is complete.
///
/// # Errors
/// If there is no layer, a layer has no pixels or another size than the first, a channel appears twice, names or
/// metadata are not Latin-1, or the file system refuses.
///
/// # Panics
/// If a layer has not one name per channel.
pub fn write_exr_channels(
    path: impl AsRef<Path>,
    layers: &[(&str, &Image, &[&str])],
    metadata: &[(&str, &str)],
) -> Result<(), ImageError> {
    let path = path.as_ref();
    let place = path.display().to_string();
    let bad = |rule: String| Err(ImageError::invalid(&place, rule));
    let Some((_, first, _)) = layers.first() else { return bad("an OpenEXR file needs a layer".into()) };
    let mut names = BTreeSet::new();
    let mut list = Vec::new();
    for (name, image, channels) in layers {
        assert_eq!(channels.len(), image.channels, "one name per channel of layer {name:?}");
        if image.data.is_empty() || (image.width, image.height) != (first.width, first.height) {
            return bad(format!("layer {name:?}: pixels are needed, and all layers of one size"));
        }
        for (c, channel) in channels.iter().enumerate() {
            let full = if name.is_empty() { (*channel).to_owned() } else { format!("{name}.{channel}") };
            let samples = image.data.iter().skip(c).step_by(image.channels).copied().collect();
            let Some(text) = text(&full).filter(|_| names.insert(full.clone())) else {
                return bad(format!("channel {full:?}: names are distinct, Latin-1 and at most 255 long"));
            };
            list.push(AnyChannel::new(text, FlatSamples::F32(samples)));
        }
    }
    // One text: custom attributes would be written in the order of a hash map, another one in every run.
    let comments: String = metadata.iter().map(|(key, value)| format!("{key}: {value}\n")).collect();
    let Some(comments) = Text::new_or_none(&comments) else {
        return bad("metadata: keys and values are Latin-1".into());
    };
    let comments = (!metadata.is_empty()).then_some(comments);
    let attributes = LayerAttributes { comments, ..LayerAttributes::default() };
    let size = (first.width, first.height);
    let layer = Layer::new(size, attributes, ENCODING, AnyChannels::sort(list.into()));
    let file = exr::image::Image::from_layer(layer);
    atomic::write_with(path, |writer| file.write().to_buffered(writer)).map_err(|e| match e {
        exr::error::Error::Io(source) => ImageError::io(path, source),
        e => invalid(&place, &e),
    })
}

/// A name for a file.
fn text(s: &str) -> Option<Text> {
    Text::new_or_none(s).filter(|t| t.as_slice().len() <= 255 && !t.as_slice().contains(&0))
}

fn part_of(layer: &ExrLayer) -> Option<Layer<AnyChannels<FlatSamples>>> {
    let planes = layer.planes.chunks(layer.width * layer.height);
    let list = layer
        .channels
        .iter()
        .zip(planes)
        .map(|(channel, plane)| Some(AnyChannel::new(text(channel)?, FlatSamples::F32(plane.to_vec()))))
        .collect::<Option<_>>()?;
    let mut attributes = LayerAttributes::default();
    if !layer.name.is_empty() {
        attributes.layer_name = Some(text(&layer.name)?);
    }
    Some(Layer::new((layer.width, layer.height), attributes, ENCODING, AnyChannels::sort(list)))
}

#[cfg(test)]
mod tests;
