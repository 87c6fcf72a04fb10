//! Samples of an OpenEXR file, channel by channel: each block goes from its bytes to where it stays.

use super::{Format, Limits, check_header, file_bytes, invalid, rank};
use crate::{Image, ImageError};
use exr::block::UncompressedBlock;
use exr::block::chunk::TileCoordinates;
use exr::error::{Result as ExrResult, UnitResult};
use exr::image::read::layers::ChannelsReader;
use exr::meta::MetaData;
use exr::meta::attribute::SampleType;
use exr::meta::header::Header;
use exr::prelude::{ReadChannels, ReadLayers, Vec2, f16};
use std::collections::BTreeSet;
use std::io::Cursor;
use std::path::Path;

/// A layer of an OpenEXR file, one plane per channel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ExrLayer {
    /// Its name.
    pub name: String,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Names of the channels, in the order of [`read_exr_layers`](super::read_exr_layers).
    pub channels: Vec<String>,
    /// `width * height` samples of each channel, one after the other; empty where they are not wanted.
    pub planes: Vec<f32>,
}

impl ExrLayer {
    /// The channels of an image, which have these names.
    ///
    /// # Panics
    /// If there is not one name per channel.
    pub fn of_image(name: String, image: &Image, channels: Vec<String>) -> Self {
        assert_eq!(channels.len(), image.channels, "one name per channel");
        let Image { width, height, .. } = *image;
        Self { name, width, height, channels, planes: image.planes() }
    }

    /// The samples of a pixel one after the other.
    pub fn to_image(&self) -> Image {
        Image::from_planes(self.width, self.height, &self.planes)
    }
}

/// Reads an OpenEXR file as [`read_exr_layers`](super::read_exr_layers) does, but as planes; samples only of the layers that are
/// `wanted`: it is asked with all layers, none of which has samples yet, and says which.
///
/// # Errors
/// If the file cannot be read, is no valid OpenEXR file, holds deep or subsampled data, or is larger than the limits.
pub fn read_exr_planes(
    path: impl AsRef<Path>,
    wanted: impl FnOnce(&[ExrLayer]) -> Vec<bool>,
) -> Result<Vec<ExrLayer>, ImageError> {
    let path = path.as_ref();
    let place = path.display().to_string();
    let limits = Limits::default();
    let bytes = file_bytes(path, limits.max_file_bytes)?;
    if Format::of(&bytes) != Some(Format::Exr) {
        return Err(ImageError::invalid(&place, "not an OpenEXR file"));
    }
    decode_planes(&bytes, &place, &limits, wanted)
}

pub(super) fn decode_planes(
    bytes: &[u8],
    place: &str,
    limits: &Limits,
    wanted: impl FnOnce(&[ExrLayer]) -> Vec<bool>,
) -> Result<Vec<ExrLayer>, ImageError> {
    let MetaData { headers, .. } = check_header(bytes, place, limits)?;
    let layers: Vec<ExrLayer> = headers.iter().flat_map(|h| layers_of(h).0).collect();
    let wanted = wanted(&layers);
    let names = layers.into_iter().zip(wanted).filter(|(_, wanted)| *wanted).map(|(layer, _)| layer.name);
    let file = ReadPlanes { wanted: names.collect() }
        .all_layers()
        .all_attributes()
        .from_buffered(Cursor::new(bytes))
        .map_err(|e| invalid(place, &e))?;
    Ok(file.layer_data.into_iter().flat_map(|part| part.channel_data).collect())
}

/// The layers of a part, without samples; and for each of its channels the layer and the plane.
fn layers_of(header: &Header) -> (Vec<ExrLayer>, Vec<(usize, usize)>) {
    let part = header.own_attributes.layer_name.as_ref().map(ToString::to_string).unwrap_or_default();
    let names: Vec<String> = header.channels.list.iter().map(|c| c.name.to_string()).collect();
    let split: Vec<(&str, &str)> = names.iter().map(|n| n.rsplit_once('.').unwrap_or(("", n))).collect();
    let mut place = vec![(0, 0); names.len()];
    // The plain group sorts first.
    let groups: BTreeSet<&str> = split.iter().map(|n| n.0).collect();
    let layer = |(k, prefix): (usize, &str)| {
        let mut members: Vec<usize> = (0..names.len()).filter(|c| split[*c].0 == prefix).collect();
        members.sort_by_key(|c| rank(split[*c].1));
        members.iter().enumerate().for_each(|(plane, c)| place[*c] = (k, plane));
        let name = match (part.is_empty(), prefix.is_empty()) {
            (true, _) => prefix.to_owned(),
            (false, true) => part.clone(),
            (false, false) => format!("{part}.{prefix}"),
        };
        let Vec2(width, height) = header.layer_size;
        let channels = members.into_iter().map(|c| split[c].1.to_owned()).collect();
        ExrLayer { name, width, height, channels, planes: Vec::new() }
    };
    let layers = groups.into_iter().enumerate().map(layer).collect();
    (layers, place)
}

/// Makes a reader for each part.
struct ReadPlanes {
    /// Names of layers.
    wanted: BTreeSet<String>,
}

impl ReadChannels<'_> for ReadPlanes {
    type Reader = PlanesReader;

    fn create_channels_reader(&self, header: &Header) -> ExrResult<PlanesReader> {
        let (mut layers, place) = layers_of(header);
        for layer in layers.iter_mut().filter(|l| self.wanted.contains(&l.name)) {
            layer.planes = vec![0.0; layer.width * layer.height * layer.channels.len()];
        }
        Ok(PlanesReader { layers, place })
    }
}

/// The layers of a part while blocks come in.
struct PlanesReader {
    layers: Vec<ExrLayer>,
    place: Vec<(usize, usize)>,
}

impl ChannelsReader for PlanesReader {
    type Channels = Vec<ExrLayer>;

    fn filter_block(&self, tile: TileCoordinates) -> bool {
        tile.level_index == Vec2(0, 0)
    }

    fn read_block(&mut self, header: &Header, block: UncompressedBlock) -> UnitResult {
        for line in block.lines(&header.channels) {
            let at = line.location;
            let (layer, plane) = self.place[at.channel];
            let ExrLayer { width, height, planes, .. } = &mut self.layers[layer];
            if planes.is_empty() {
                continue;
            }
            let first = (plane * *height + at.position.y()) * *width + at.position.x();
            let target = &mut planes[first..first + at.sample_count];
            match header.channels.list[at.channel].sample_type {
                SampleType::F32 => line.read_samples_into_slice(target)?,
                SampleType::F16 => {
                    for (t, v) in target.iter_mut().zip(line.read_samples::<f16>()) {
                        *t = v?.to_f32();
                    }
                }
                SampleType::U32 => {
                    for (t, v) in target.iter_mut().zip(line.read_samples::<u32>()) {
                        *t = v? as f32;
                    }
                }
            }
        }
        Ok(())
    }

    fn into_channels(self) -> Vec<ExrLayer> {
        self.layers
    }
}
