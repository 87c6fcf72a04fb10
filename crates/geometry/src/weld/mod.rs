//! Welding: which vertices lie at the same place.
//!
//! Files split vertices along uv seams and hard edges. Topology (adjacency, smooth normals, Laplacians) is taken on
//! welded positions, so that such a split does not open the surface.

#[cfg(feature = "gpu")]
pub mod gpu;

use crate::csr::Csr;
use photofit_scalar::{Real, Vec3, Vec3f};
use rayon::prelude::*;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::hash::Hash;

/// A map from vertices to welded ids.
///
/// Ids are dense and numbered by first appearance, hence the same on every run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Weld {
    /// Welded id of each vertex; length: vertices.
    pub ids: Vec<u32>,
    /// First vertex of each welded id; length: welded ids.
    pub first: Vec<u32>,
}

impl Weld {
    /// Every vertex on its own.
    ///
    /// # Panics
    /// Above 2^32 - 2 vertices.
    pub fn identity(vertices: usize) -> Self {
        let n =
            u32::try_from(vertices).ok().filter(|&n| n < u32::MAX).expect("vertices are counted in 32 bits");
        Self { ids: (0..n).collect(), first: (0..n).collect() }
    }

    /// Number of vertices.
    pub fn vertices(&self) -> usize {
        self.ids.len()
    }

    /// Number of welded ids.
    pub fn count(&self) -> usize {
        self.first.len()
    }

    /// Whether no two vertices share an id.
    pub fn is_identity(&self) -> bool {
        self.ids.len() == self.first.len()
    }

    /// Triangles in welded ids; length and order unchanged (a triangle may become degenerate).
    ///
    /// # Panics
    /// When a triangle names a vertex outside the map.
    pub fn triangles(&self, triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
        triangles.iter().map(|t| t.map(|v| self.ids[v as usize])).collect()
    }

    /// The vertices of each welded id, ascending.
    pub fn members(&self) -> Csr {
        Csr::group(self.count(), self.ids.iter().copied())
    }

    /// One value per welded id, taken from its first vertex.
    ///
    /// # Panics
    /// When `values` does not have one entry per vertex.
    pub fn pick<A: Copy>(&self, values: &[A]) -> Vec<A> {
        assert_eq!(values.len(), self.vertices(), "one value per vertex");
        self.first.iter().map(|&v| values[v as usize]).collect()
    }

    /// Copies welded values to the vertices: `out[v] = welded[ids[v]]`.
    ///
    /// # Panics
    /// When `welded` does not have one entry per welded id.
    pub fn expand<A: Copy>(&self, welded: &[A]) -> Vec<A> {
        assert_eq!(welded.len(), self.count(), "one value per welded id");
        self.ids.iter().map(|&w| welded[w as usize]).collect()
    }

    /// Adjoint of [`Self::expand`]: `d_welded[w] +=` sum of `d_vertices[v]` over the vertices of `w`, in ascending
    /// order.
    ///
    /// # Panics
    /// When a slice does not have one entry per vertex or per welded id.
    pub fn expand_vjp<T: Real>(&self, d_vertices: &[Vec3<T>], d_welded: &mut [Vec3<T>]) {
        assert_eq!(d_vertices.len(), self.vertices(), "one gradient per vertex");
        assert_eq!(d_welded.len(), self.count(), "one gradient per welded id");
        for (&w, &g) in self.ids.iter().zip(d_vertices) {
            d_welded[w as usize] += g;
        }
    }
}

/// Welds equal keys, ids by first appearance.
fn by_key<K: Hash + Eq>(count: usize, key: impl Fn(usize) -> K) -> Weld {
    assert!(count < u32::MAX as usize, "vertices are counted in 32 bits");
    // The seeded hasher keeps crafted input from degrading the table; ids do not depend on its order.
    let mut seen: HashMap<K, u32> = HashMap::with_capacity(count);
    let mut weld = Weld { ids: Vec::with_capacity(count), first: Vec::with_capacity(count) };
    for v in 0..count {
        let id = match seen.entry(key(v)) {
            Entry::Occupied(e) => *e.get(),
            Entry::Vacant(e) => {
                let id = weld.first.len() as u32;
                weld.first.push(v as u32);
                *e.insert(id)
            }
        };
        weld.ids.push(id);
    }
    weld
}

/// Bits of a coordinate with both zeros made equal.
#[inline(always)]
fn bits(x: f32) -> u32 {
    (x + 0.0).to_bits()
}

/// Welds vertices with exactly equal coordinates (`-0 == 0`; NaNs weld where their bits agree). Linear time.
///
/// ```
/// use photofit_geometry::weld::weld_exact;
/// use photofit_scalar::vec3;
/// let weld = weld_exact(&[vec3(0.0, 1.0, 0.0), vec3(2.0, 0.0, 0.0), vec3(-0.0, 1.0, 0.0)]);
/// assert_eq!(weld.ids, [0, 1, 0]);
/// assert_eq!(weld.first, [0, 1]);
/// ```
///
/// # Panics
/// Above 2^32 - 2 vertices.
pub fn weld_exact(positions: &[Vec3f]) -> Weld {
    by_key(positions.len(), |v| positions[v].to_array().map(bits))
}

/// Welds vertices whose `width` consecutive numbers in `attributes` (row-major, one row per vertex) are exactly
/// equal; used to weld by position, normal and uv together, as MikkTSpace does.
///
/// # Panics
/// When `width` is zero or does not divide the length, or above 2^32 - 2 vertices.
pub fn weld_rows(attributes: &[f32], width: usize) -> Weld {
    assert!(width > 0 && attributes.len().is_multiple_of(width), "whole rows of a positive width");
    let keys: Vec<u32> = attributes.par_iter().with_min_len(1 << 14).map(|&x| bits(x)).collect();
    by_key(attributes.len() / width, |v| &keys[v * width..(v + 1) * width])
}

/// Welds vertices that lie within `tolerance` of an earlier one, in the asset's units.
///
/// Vertices are visited in order; each takes the id of the nearest representative within `tolerance` (the lower id
/// at equal distance), or becomes a representative itself. Chains therefore do not creep: every vertex lies within
/// `tolerance` of its representative, and representatives lie farther than `tolerance` apart. Linear time by a hash
/// grid. Vertices with a non-finite coordinate stay alone. A tolerance of zero is [`weld_exact`].
///
/// # Panics
/// When `tolerance` is negative or not finite, or above 2^32 - 2 vertices.
pub fn weld_within(positions: &[Vec3f], tolerance: f32) -> Weld {
    assert!(tolerance >= 0.0 && tolerance.is_finite(), "the tolerance is a finite length");
    if tolerance == 0.0 {
        return weld_exact(positions);
    }
    assert!(positions.len() < u32::MAX as usize, "vertices are counted in 32 bits");
    let (size, reach) = (f64::from(tolerance), f64::from(tolerance) * f64::from(tolerance));
    // Cells are kept as floating-point whole numbers: they neither overflow nor collapse far from the origin.
    let cell = |p: Vec3<f64>| p.map(|x| (x / size).floor());
    let key = |c: Vec3<f64>| c.to_array().map(|x| (x + 0.0).to_bits());
    let mut newest: HashMap<[u64; 3], u32> = HashMap::with_capacity(positions.len());
    let mut older: Vec<u32> = Vec::new();
    let mut weld = Weld { ids: Vec::with_capacity(positions.len()), first: Vec::new() };
    for (v, p) in positions.iter().enumerate() {
        let p: Vec3<f64> = p.cast();
        let home = cell(p);
        let mut best = (f64::INFINITY, u32::MAX);
        if p.is_finite() {
            for offset in 0..27 {
                let step = [offset % 3, offset / 3 % 3, offset / 9].map(|x| f64::from(x) - 1.0);
                let mut at = newest.get(&key(home + Vec3::from_array(step))).copied().unwrap_or(u32::MAX);
                while at != u32::MAX {
                    let q: Vec3<f64> = positions[weld.first[at as usize] as usize].cast();
                    let d = (p - q).length_squared();
                    if d <= reach && (d, at) < best {
                        best = (d, at);
                    }
                    at = older[at as usize];
                }
            }
        }
        if best.1 == u32::MAX {
            best.1 = weld.first.len() as u32;
            weld.first.push(v as u32);
            older.push(if p.is_finite() {
                newest.insert(key(home), best.1).unwrap_or(u32::MAX)
            } else {
                u32::MAX
            });
        }
        weld.ids.push(best.1);
    }
    weld
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_gradcheck::Uniform;
    use photofit_scalar::vec3;

    /// The quadratic-time statement of [`weld_within`].
    fn naive(positions: &[Vec3f], tolerance: f32) -> Weld {
        let mut weld = Weld::default();
        for (v, p) in positions.iter().enumerate() {
            let mut best = (f64::INFINITY, u32::MAX);
            for (id, &first) in weld.first.iter().enumerate() {
                let d = (p.cast::<f64>() - positions[first as usize].cast()).length_squared();
                if d <= f64::from(tolerance) * f64::from(tolerance) && (d, id as u32) < best {
                    best = (d, id as u32);
                }
            }
            if best.1 == u32::MAX {
                best.1 = weld.first.len() as u32;
                weld.first.push(v as u32);
            }
            weld.ids.push(best.1);
        }
        weld
    }

    #[test]
    fn tolerance_agrees_with_the_quadratic_statement() {
        let mut rng = Uniform::new(3);
        for (scale, tolerance) in [(1.0, 0.1), (1.0, 0.3), (1e6, 1e5), (1e-6, 2e-7)] {
            let points: Vec<Vec3f> = (0..400)
                .map(|_| Vec3::from_array([0; 3].map(|_| (rng.range(-1.0, 1.0) * scale) as f32)))
                .collect();
            let fast = weld_within(&points, tolerance);
            assert_eq!(fast, naive(&points, tolerance), "scale {scale}");
            assert!(fast.count() < points.len(), "scale {scale}: something welds");
        }
    }

    #[test]
    fn extremes_do_not_hang_or_panic() {
        let mut points = vec![vec3(f32::MAX, 0.0, 0.0), vec3(f32::MAX, 0.0, 0.0), vec3(f32::NAN, 0.0, 0.0)];
        points.extend((0..20_000).map(|_| vec3(f32::INFINITY, 1.0, 2.0)));
        let weld = weld_within(&points, f32::MIN_POSITIVE);
        assert_eq!(weld.ids[..2], [0, 0]);
        assert_eq!(weld.count(), points.len() - 1);
        assert_eq!(weld_exact(&[]).count(), 0);
    }

    #[test]
    fn rows_weld_by_all_attributes() {
        let weld = weld_rows(&[0.0, 1.0, 0.0, 2.0, -0.0, 1.0], 2);
        assert_eq!(weld.ids, [0, 1, 0]);
    }

    #[test]
    fn expand_and_its_adjoint_are_transposed() {
        let weld = weld_exact(&[vec3(0.0, 0.0, 0.0), vec3(1.0, 0.0, 0.0), vec3(0.0, 0.0, 0.0)]);
        let (x, g) = (
            [vec3(1.0, 2.0, 3.0), vec3(4.0, 5.0, 6.0)],
            [vec3(1.0, 0.5, 2.0), vec3(3.0, 1.0, 1.0), vec3(-2.0, 4.0, 1.0)],
        );
        let forward: f64 = weld.expand(&x).iter().zip(&g).map(|(a, b)| a.dot(*b)).sum();
        let mut d = [Vec3::zero(); 2];
        weld.expand_vjp(&g, &mut d);
        let reverse: f64 = d.iter().zip(&x).map(|(a, b)| a.dot(*b)).sum();
        assert!((forward - reverse).abs() < 1e-12, "{forward} against {reverse}");
    }
}
