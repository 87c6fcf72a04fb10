//! Mitsuba's grid format: `VOL`, version 3, float32, size, channels, box, values; little endian.

use glam::DVec3;
use photofit_scalar::{Vec3f, vec3};

/// Most voxels of one grid.
const VOXELS: u64 = 1 << 28;
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
/// What is wrong, in words: another format or encoding, missing bytes, values that are not finite or below 0.
pub fn parse_grid(bytes: &[u8]) -> Result<Grid, String> {
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
}
