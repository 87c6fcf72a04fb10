//! Vertices shared by faces of opposite uv orientation: found, and split.

use super::FaceUv;
use crate::split::Split;
use photofit_scalar::Vec2f;

/// Bit 1: some face at the vertex is not mirrored; bit 2: some is.
fn orientations(triangles: &[[u32; 3]], uvs: &[Vec2f]) -> (Vec<i8>, Vec<u8>) {
    let faces: Vec<i8> =
        triangles.iter().map(|t| FaceUv::new(t.map(|v| uvs[v as usize])).handedness).collect();
    let mut seen = vec![0_u8; uvs.len()];
    for (t, &handedness) in triangles.iter().zip(&faces) {
        for &v in t {
            seen[v as usize] |= match handedness {
                1 => 1,
                -1 => 2,
                _ => 0,
            };
        }
    }
    (faces, seen)
}

/// The vertices, ascending, that both mirrored and unmirrored faces use.
///
/// # Panics
/// When a triangle names a vertex that has no uv.
pub fn mirrored_vertices(triangles: &[[u32; 3]], uvs: &[Vec2f]) -> Vec<u32> {
    let (_, seen) = orientations(triangles, uvs);
    seen.iter().enumerate().filter(|(_, s)| **s == 3).map(|(v, _)| v as u32).collect()
}

/// Splits every vertex that both mirrored and unmirrored faces use: the unmirrored faces (and those without uv area)
/// keep it, the mirrored ones share a copy appended at the end.
///
/// ```
/// use photofit_geometry::tangents::split_mirrored;
/// use photofit_scalar::vec2;
/// // Two triangles folded over the shared edge 0-1 in uv.
/// let uvs = [vec2(0.0, 0.0), vec2(0.0, 1.0), vec2(1.0, 0.0), vec2(1.0, 0.0)];
/// let split = split_mirrored(&[[0, 1, 2], [1, 0, 3]], &uvs);
/// assert_eq!(split.triangles, [[0, 1, 2], [5, 4, 3]]);
/// assert_eq!(split.source, [0, 1, 2, 3, 0, 1]);
/// ```
///
/// # Panics
/// When a triangle names a vertex that has no uv, or beyond 2^32 - 1 vertices.
pub fn split_mirrored(triangles: &[[u32; 3]], uvs: &[Vec2f]) -> Split {
    let (faces, seen) = orientations(triangles, uvs);
    let mut source: Vec<u32> = (0..uvs.len() as u32).collect();
    let mut copy = vec![u32::MAX; uvs.len()];
    for v in (0..uvs.len()).filter(|&v| seen[v] == 3) {
        copy[v] = u32::try_from(source.len()).expect("vertices are counted in 32 bits");
        source.push(v as u32);
    }
    let moved = |(t, &handedness): (&[u32; 3], &i8)| {
        t.map(|v| if handedness == -1 && copy[v as usize] != u32::MAX { copy[v as usize] } else { v })
    };
    Split { triangles: triangles.iter().zip(&faces).map(moved).collect(), source }
}
