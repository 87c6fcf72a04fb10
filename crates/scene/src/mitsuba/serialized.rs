//! Meshes of `serialized` shapes: compressed arrays, many meshes to a file.

use crate::Limits;
use flate2::read::ZlibDecoder;
use photofit_geometry::Mesh;
use photofit_scalar::{Vec2f, Vec3f};
use std::io::Read;

/// Parts that a mesh may have.
const NORMALS: u32 = 0x1;
const COORDINATES: u32 = 0x2;
const COLORS: u32 = 0x8;
const FACE_NORMALS: u32 = 0x10;
const DOUBLE: u32 = 0x2000;
/// First word of a mesh.
const MAGIC: u16 = 0x041c;
/// Bytes of a mesh's name.
const NAME: usize = 4096;

/// A mesh, and whether its normals are those of its faces.
pub(super) fn read(bytes: &[u8], index: usize, limits: &Limits) -> Result<(Mesh, bool), String> {
    let version = match header(bytes, 0)? {
        version @ (3 | 4) => version,
        other => return Err(format!("the version is {other}; it must be 3 or 4")),
    };
    let at = offset(bytes, index, version)?;
    header(bytes, at)?;
    let mut data = ZlibDecoder::new(&bytes[at + 4..]);
    let flags = u32::from_le_bytes(array(&mut data)?);
    if version == 4 {
        let mut length = 0;
        while array::<1>(&mut data)? != [0] {
            length += 1;
            if length > NAME {
                return Err(format!("the name has more than {NAME} bytes; it may have that many"));
            }
        }
    }
    let vertices = u64::from_le_bytes(array(&mut data)?);
    let triangles = u64::from_le_bytes(array(&mut data)?);
    if vertices > limits.vertices as u64 || triangles > limits.triangles as u64 {
        let (v, t) = (limits.vertices, limits.triangles);
        return Err(format!("has {vertices} vertices and {triangles} triangles; it may have {v} and {t}"));
    }
    let (vertices, triangles) = (vertices as usize, triangles as usize);
    let wide = flags & DOUBLE != 0;
    let mut numbers = |count: usize| -> Result<Vec<f32>, String> {
        let raw = exactly(&mut data, count * if wide { 8 } else { 4 })?;
        Ok(if wide {
            raw.as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b) as f32).collect()
        } else {
            raw.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect()
        })
    };
    let mut mesh = Mesh { positions: triples(&numbers(3 * vertices)?), ..Mesh::default() };
    if flags & NORMALS != 0 {
        mesh.normals = triples(&numbers(3 * vertices)?);
    }
    if flags & COORDINATES != 0 {
        let uvs = numbers(2 * vertices)?;
        mesh.uvs = uvs.as_chunks::<2>().0.iter().map(|p| Vec2f::from_array(*p)).collect();
    }
    if flags & COLORS != 0 {
        numbers(3 * vertices)?;
    }
    let raw = exactly(&mut data, 12 * triangles)?;
    let indices: Vec<u32> = raw.as_chunks::<4>().0.iter().map(|b| u32::from_le_bytes(*b)).collect();
    if let Some(i) = indices.iter().find(|&&i| i as usize >= vertices) {
        return Err(format!("names index {i}; it must be below the {vertices} vertices"));
    }
    mesh.triangles = indices.as_chunks::<3>().0.to_vec();
    let lists = [&mesh.positions, &mesh.normals];
    if !lists.into_iter().flatten().all(|p| p.is_finite()) || !mesh.uvs.iter().all(|p| p.is_finite()) {
        return Err("an attribute is not finite; all must be".into());
    }
    if mesh.triangles.is_empty() {
        return Err("has no faces; it must have some".into());
    }
    mesh.normals.iter_mut().for_each(|n| *n = n.normalize_or_zero());
    Ok((mesh, flags & FACE_NORMALS != 0))
}

/// The version of the mesh that begins at a byte.
fn header(bytes: &[u8], at: usize) -> Result<u16, String> {
    match bytes.get(at..at.saturating_add(4)) {
        Some(&[a, b, c, d]) if u16::from_le_bytes([a, b]) == MAGIC => Ok(u16::from_le_bytes([c, d])),
        _ => Err(format!("byte {at} is not the beginning of a serialized mesh; it must be")),
    }
}

/// Where a mesh begins: the file ends with a table of offsets and their number.
fn offset(bytes: &[u8], index: usize, version: u16) -> Result<usize, String> {
    if index == 0 {
        return Ok(0);
    }
    let width = if version == 4 { 8 } else { 4 };
    let tail = bytes.len().saturating_sub(4);
    let count = bytes.get(tail..).and_then(|b| b.try_into().ok()).map_or(0, u32::from_le_bytes) as usize;
    if index >= count {
        return Err(format!("shape_index is {index}; the file has {count} meshes"));
    }
    let start = count.checked_mul(width).and_then(|n| tail.checked_sub(n));
    let entry = start.and_then(|s| bytes.get(s + index * width..)?.get(..width));
    let entry =
        entry.ok_or_else(|| format!("the table of {count} meshes does not fit into the file; it must"))?;
    let mut wide = [0; 8];
    wide[..width].copy_from_slice(entry);
    let at = u64::from_le_bytes(wide);
    usize::try_from(at).map_err(|e| format!("the offset {at} is not one of this machine: {e}"))
}

fn array<const N: usize>(data: &mut impl Read) -> Result<[u8; N], String> {
    let mut out = [0; N];
    data.read_exact(&mut out).map_err(|e| format!("the compressed data cannot be read: {e}"))?;
    Ok(out)
}

/// As many bytes; memory grows with what is there, not with what is announced.
fn exactly(data: &mut impl Read, count: usize) -> Result<Vec<u8>, String> {
    let mut out = Vec::new();
    let read = data.by_ref().take(count as u64).read_to_end(&mut out);
    read.map_err(|e| format!("the compressed data cannot be read: {e}"))?;
    if out.len() == count {
        return Ok(out);
    }
    Err(format!("an array has {} bytes; it must have {count}", out.len()))
}

fn triples(values: &[f32]) -> Vec<Vec3f> {
    values.as_chunks::<3>().0.iter().map(|p| Vec3f::from_array(*p)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::Compression;
    use flate2::write::ZlibEncoder;
    use photofit_scalar::vec3;
    use std::io::Write;

    /// One triangle, its second corner at `x`.
    fn mesh(version: u16, flags: u32, x: f64, vertices: u64, last: u32) -> Vec<u8> {
        let mut data = flags.to_le_bytes().to_vec();
        if version == 4 {
            data.extend(b"name\0");
        }
        data.extend(vertices.to_le_bytes());
        data.extend(1_u64.to_le_bytes());
        let mut put = |values: &[f64]| {
            for v in values {
                if flags & DOUBLE != 0 {
                    data.extend(v.to_le_bytes());
                } else {
                    data.extend((*v as f32).to_le_bytes());
                }
            }
        };
        put(&[0.0, 0.0, 0.0, x, 0.0, 0.0, 0.0, 1.0, 0.0]);
        if flags & NORMALS != 0 {
            put(&[0.0, 0.0, 2.0].repeat(3));
        }
        if flags & COORDINATES != 0 {
            put(&[0.25, 0.75].repeat(3));
        }
        if flags & COLORS != 0 {
            put(&[1.0; 9]);
        }
        data.extend([0, 1, last].iter().flat_map(|i: &u32| i.to_le_bytes()));
        let mut out = MAGIC.to_le_bytes().to_vec();
        out.extend(version.to_le_bytes());
        let mut packer = ZlibEncoder::new(out, Compression::fast());
        packer.write_all(&data).unwrap();
        packer.finish().unwrap()
    }

    #[test]
    fn every_kind_of_mesh_and_the_table() {
        for version in [3_u16, 4] {
            for flags in [0x1000, DOUBLE, 0x1000 | NORMALS | COORDINATES | COLORS, DOUBLE | COORDINATES] {
                let first = mesh(version, flags, 2.0, 3, 2);
                let second = mesh(version, flags | FACE_NORMALS, 5.0, 3, 2);
                let mut file = [first.clone(), second].concat();
                for offset in [0, first.len() as u64] {
                    file.extend(&offset.to_le_bytes()[..if version == 4 { 8 } else { 4 }]);
                }
                file.extend(2_u32.to_le_bytes());
                for (index, x) in [(0, 2.0), (1, 5.0)] {
                    let (mesh, flat) = read(&file, index, &Limits::default()).unwrap();
                    assert_eq!((mesh.positions[1], mesh.triangles[0]), (vec3(x, 0.0, 0.0), [0, 1, 2]));
                    assert_eq!(flat, index == 1);
                    assert_eq!(mesh.normals.is_empty(), flags & NORMALS == 0);
                    assert_eq!(mesh.uvs.len(), if flags & COORDINATES == 0 { 0 } else { 3 });
                }
                assert!(read(&file, 2, &Limits::default()).unwrap_err().contains("2 meshes"));
            }
        }
    }

    #[test]
    fn broken_files_are_errors() {
        let good = mesh(4, 0x1000, 1.0, 3, 2);
        let few = Limits { vertices: 2, ..Limits::default() };
        for (bytes, limits, part) in [
            (b"zip".to_vec(), &Limits::default(), "beginning"),
            (mesh(5, 0x1000, 1.0, 3, 2), &Limits::default(), "version is 5"),
            (good[..good.len() - 12].to_vec(), &Limits::default(), "cannot be read"),
            (good[..8].to_vec(), &Limits::default(), "cannot be read"),
            (good.clone(), &few, "it may have 2"),
            (mesh(4, 0x1000, 1.0, 60_000_000, 2), &Limits::default(), "it must have 720000000"),
            (mesh(4, 0x1000, 1.0, 3, 7), &Limits::default(), "index 7"),
            (mesh(4, 0x1000, f64::NAN, 3, 2), &Limits::default(), "finite"),
        ] {
            let text = read(&bytes, 0, limits).unwrap_err();
            assert!(text.contains(part), "{part} in {text}");
        }
        let mut file = good;
        file.extend(u32::MAX.to_le_bytes());
        assert!(read(&file, 1, &Limits::default()).unwrap_err().contains("does not fit"));
    }
}
