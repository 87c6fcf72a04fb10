//! Mitsuba's grid format: `VOL`, version 3, float32, size, channels, box, values; little endian.

use glam::DVec3;
use photofit_scalar::{Vec3f, vec3};

/// Most voxels of one grid.
const VOXELS: u64 = 1 << 28;
/// Most samples of a grid of distances.
const DISTANCES: u64 = 1 << 27;
/// Bytes before the values.
const HEADER: usize = 48;

/// A `.vol` file with these values, x fastest: 1 or 3 channels of each of `size` voxels along x, y and z, over a box.
///
/// # Panics
/// If the number of values is not that of the voxels times 1 or 3, or a side has more than 2^31 - 1 voxels.
pub fn encode_grid(size: [usize; 3], values: &[f32], [lo, hi]: [DVec3; 2]) -> Vec<u8> {
    let voxels: usize = size.iter().product();
    let channels = values.len() / voxels.max(1);
    assert!(
        values.len() == voxels * channels && (channels == 1 || channels == 3),
        "one or three values per voxel"
    );
    let mut out = Vec::with_capacity(HEADER + 4 * values.len());
    out.extend(b"VOL\x03");
    let counts = [1, size[0], size[1], size[2], channels];
    out.extend(counts.iter().flat_map(|n| i32::try_from(*n).expect("a side fits").to_le_bytes()));
    out.extend([lo, hi].iter().flat_map(|p| p.as_vec3().to_array()).flat_map(f32::to_le_bytes));
    out.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    out
}

/// Voxels along x, y and z, values (x fastest; the same in all channels where the file has one), and box of a `.vol` file.
pub type Grid = ([usize; 3], Vec<Vec3f>, [DVec3; 2]);

/// Reads the bytes of a `.vol` file: float32, one or three channels, at most 2^28 voxels.
///
/// # Errors
/// What is wrong, in words: another format or encoding, too few or too many bytes, a box or values that are not finite or below 0.
pub fn parse_grid(bytes: &[u8]) -> Result<Grid, String> {
    let Header { size, channels, bounds, values } = Header::read(bytes, VOXELS, &[1, 3])?;
    let number = |b: &[u8; 4]| f32::from_le_bytes(*b);
    let voxel = |(i, v): (usize, &[[u8; 4]])| {
        if let Some(c) = v.iter().position(|v| !(number(v).is_finite() && number(v) >= 0.0)) {
            let channel = if channels > 1 { format!(" in channel {c}") } else { String::new() };
            let value = number(&v[c]);
            return Err(format!(
                "voxel {i} holds {value}{channel}; its values must be finite and not negative"
            ));
        }
        Ok(match v {
            [x, y, z] => vec3(number(x), number(y), number(z)),
            other => Vec3f::splat(other.first().map_or(0.0, number)),
        })
    };
    let values: Result<_, _> = values.chunks_exact(channels).enumerate().map(voxel).collect();
    Ok((size, values?, bounds))
}

/// Samples along x, y and z (each 2 or more, at most 2^27 together) and signed distances, x fastest, of a `.vol` file of one
/// channel: finite, some below 0 and some not.
pub(super) fn parse_distances(bytes: &[u8]) -> Result<([usize; 3], Vec<f32>), String> {
    let Header { size, values, .. } = Header::read(bytes, DISTANCES, &[1])?;
    if size.iter().any(|n| *n < 2) {
        let [x, y, z] = size;
        return Err(format!("the grid has {x} x {y} x {z} samples; it must have 2 or more along each side"));
    }
    let values: Vec<f32> = values.iter().map(|b| f32::from_le_bytes(*b)).collect();
    if let Some(i) = values.iter().position(|v| !v.is_finite()) {
        return Err(format!("value {i} is {}; it must be finite", values[i]));
    }
    let inside = values.iter().filter(|v| **v < 0.0).count();
    if inside == 0 || inside == values.len() {
        let n = values.len();
        return Err(format!("{inside} of {n} values are below 0; some must be, and some must not"));
    }
    Ok((size, values))
}

/// What a file says before its values, and these, which are all there.
struct Header<'a> {
    size: [usize; 3],
    channels: usize,
    bounds: [DVec3; 2],
    values: &'a [[u8; 4]],
}

impl<'a> Header<'a> {
    /// At most so many voxels, of one of these counts of channels.
    fn read(bytes: &'a [u8], most: u64, counts: &[u64]) -> Result<Self, String> {
        if bytes.is_empty() {
            return Err("is empty".into());
        }
        if !bytes.starts_with(b"VOL\x03") {
            let n = bytes.len().min(4);
            let found = bytes[..n].escape_ascii();
            return Err(format!("the first bytes are `{found}`; they must be VOL and the version 3"));
        }
        let words = bytes.as_chunks::<4>().0;
        if words.len() < HEADER / 4 {
            return Err(format!("has {} bytes; the header alone must have {HEADER}", bytes.len()));
        }
        let int = |word: usize| i32::from_le_bytes(words[word]);
        let real = |word: usize| f64::from(f32::from_le_bytes(words[word]));
        if int(1) != 1 {
            return Err(format!("the encoding of the values is {}; it must be 1 (float32)", int(1)));
        }
        let sides = [2, 3, 4].map(int);
        let [x, y, z, channels] = [2, 3, 4, 5].map(|k| u64::try_from(int(k)).unwrap_or(0));
        let voxels = x.checked_mul(y).and_then(|n| n.checked_mul(z)).unwrap_or(u64::MAX);
        if voxels == 0 || voxels > most {
            let [x, y, z] = sides;
            return Err(format!("has {x} x {y} x {z} voxels; there must be 1 to {most}"));
        }
        if !counts.contains(&channels) {
            let known: Vec<String> = counts.iter().map(u64::to_string).collect();
            return Err(format!("there are {} channels; there must be {}", int(5), known.join(" or ")));
        }
        let need = voxels.saturating_mul(channels).saturating_mul(4).saturating_add(HEADER as u64);
        if bytes.len() as u64 != need {
            return Err(format!("has {} bytes; it must have {need}", bytes.len()));
        }
        let corner = |word: usize| DVec3::new(real(word), real(word + 1), real(word + 2));
        let [lo, hi] = [corner(6), corner(9)];
        if !(lo.is_finite() && hi.is_finite()) {
            return Err(format!("its box is {lo} to {hi}; it must be finite"));
        }
        Ok(Self {
            size: [x as usize, y as usize, z as usize],
            channels: channels as usize,
            bounds: [lo, hi],
            values: &words[HEADER / 4..need as usize / 4],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read() {
        let (size, bounds) = ([2, 3, 1], [DVec3::new(-1.0, 0.0, 2.0), DVec3::new(1.0, 0.5, 2.5)]);
        for channels in [1, 3] {
            let values: Vec<f32> = (0..6 * channels).map(|i| 0.25 * i as f32).collect();
            let (found, read, found_bounds) = parse_grid(&encode_grid(size, &values, bounds)).unwrap();
            assert_eq!((found, found_bounds), (size, bounds));
            for (v, v_read) in values.chunks(channels).zip(&read) {
                assert!(v_read.to_array().iter().enumerate().all(|(c, x)| *x == v[c.min(channels - 1)]));
            }
        }
    }

    #[test]
    fn files_of_another_length_and_boxes_that_are_not_finite_are_refused() {
        let file = |hi: f64| encode_grid([2, 1, 1], &[1.0, 2.0], [DVec3::ZERO, DVec3::new(1.0, hi, 1.0)]);
        let rule = |bytes: &[u8]| parse_grid(bytes).unwrap_err();
        let whole = file(1.0);
        assert_eq!(rule(&whole[..whole.len() - 1]), "has 55 bytes; it must have 56");
        assert_eq!(rule(&[&whole[..], &[0]].concat()), "has 57 bytes; it must have 56");
        assert!(rule(&file(f64::NAN)).starts_with("its box is [0, 0, 0] to [1, NaN, 1]"));
        let mut none = whole.clone();
        none[20..24].copy_from_slice(&(-1_i32).to_le_bytes());
        assert_eq!(rule(&none), "there are -1 channels; there must be 1 or 3");
        let below = encode_grid([2, 1, 1], &[1.0, -2.0], [DVec3::ZERO, DVec3::ONE]);
        assert_eq!(rule(&below), "voxel 1 holds -2; its values must be finite and not negative");
        let blue = encode_grid([1, 1, 1], &[1.0, 2.0, f32::NAN], [DVec3::ZERO, DVec3::ONE]);
        assert_eq!(rule(&blue), "voxel 0 holds NaN in channel 2; its values must be finite and not negative");
    }
}
