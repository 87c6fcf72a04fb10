//! The error type of the crate.

/// What can be wrong with a mesh or with the size asked for.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum GeometryError {
    /// A triangle names a vertex that does not exist.
    #[error("triangle {triangle} names vertex {index}, but the mesh has {vertices} vertices")]
    IndexOutOfRange {
        /// Index of the triangle.
        triangle: usize,
        /// The vertex index it holds.
        index: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// An attribute array is neither empty nor as long as the positions.
    #[error("attribute `{attribute}` has {found} entries, but the mesh has {expected} vertices")]
    AttributeLength {
        /// Name of the attribute.
        attribute: &'static str,
        /// Entries found.
        found: usize,
        /// Number of vertices.
        expected: usize,
    },
    /// A result would be larger than the stated limit.
    #[error("{what} would have {count} entries, above the limit of {limit}")]
    TooLarge {
        /// The array that would grow too large.
        what: &'static str,
        /// Entries it would have.
        count: u64,
        /// The limit.
        limit: u64,
    },
}

/// Checks that every index of `triangles` is below `vertices` and that corner ids fit 32 bits.
///
/// # Errors
/// [`GeometryError::IndexOutOfRange`] for the first bad triangle, [`GeometryError::TooLarge`] above 2^32 - 2
/// corners or vertices.
pub fn check_triangles(triangles: &[[u32; 3]], vertices: usize) -> Result<(), GeometryError> {
    let limit = u64::from(u32::MAX) - 1;
    for (what, count) in [("corner list", 3 * triangles.len() as u64), ("vertex list", vertices as u64)] {
        if count > limit {
            return Err(GeometryError::TooLarge { what, count, limit });
        }
    }
    let largest = |t: &[u32; 3]| t[0].max(t[1]).max(t[2]);
    match triangles.iter().position(|t| largest(t) as usize >= vertices) {
        Some(triangle) => {
            Err(GeometryError::IndexOutOfRange { triangle, index: largest(&triangles[triangle]), vertices })
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bad_index_is_named() {
        assert_eq!(check_triangles(&[[0, 1, 2]], 3), Ok(()));
        let error = check_triangles(&[[0, 1, 2], [0, 3, 1]], 3).unwrap_err();
        assert_eq!(error.to_string(), "triangle 1 names vertex 3, but the mesh has 3 vertices");
    }
}
