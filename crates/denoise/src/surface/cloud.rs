//! A point cloud made ready for reconstruction: normals and the distance between neighbours.

use super::SurfaceError;
use super::neighbors::{KdTree, Nearest};
use photofit_scalar::{Vec3, Vec3f, vec3};
use rayon::prelude::*;

/// Neighbours that a plane is fitted to, the point itself included.
const NEIGHBORS: usize = 13;
/// Largest spacing of a point over the lower quartile of the spacings of its neighbours: a stray point beside a dense
/// surface stays small instead of hiding the surface behind it.
const MOST_SPACING: f32 = 2.0;
/// Queries that one task answers.
const CHUNK: usize = 2048;

/// Points with normals, spacing and optionally colours; made once, seen by any number of cameras.
#[derive(Clone, Debug)]
pub struct Cloud {
    positions: Vec<Vec3f>,
    normals: Vec<Vec3f>,
    spacing: Vec<f32>,
    colors: Vec<Vec3f>,
}

impl Cloud {
    /// Prepares points. `normals` (world frame, any length and sign; zero = unknown) and `colors` (linear RGB) hold
    /// one entry per position or none.
    ///
    /// Normals that are unknown are those of the plane through the 12 nearest neighbours (principal components,
    /// Hoppe et al. 1992), without a sign. The spacing of a point is `s = d_k sqrt(pi / k)` with `d_k` the distance of
    /// its k-th neighbour: the side of the square that it owns on its surface; at most twice the lower quartile of
    /// that of its neighbours, which keeps strays small.
    ///
    /// ```
    /// use photofit_denoise::surface::Cloud;
    /// use photofit_scalar::vec3;
    /// let grid = (0..400).map(|i| vec3((i % 20) as f32, (i / 20) as f32, 0.0)).collect();
    /// let cloud = Cloud::new(grid, vec![], vec![])?;
    /// assert!(cloud.normals()[210].z.abs() > 0.999);
    /// assert!((cloud.spacing()[210] - 1.0).abs() < 0.1);
    /// # Ok::<(), photofit_denoise::surface::SurfaceError>(())
    /// ```
    ///
    /// # Errors
    /// Without points, with 2^32 - 1 or more of them, with an array of another length, or with a position, normal or
    /// colour that is not finite.
    pub fn new(
        positions: Vec<Vec3f>,
        mut normals: Vec<Vec3f>,
        colors: Vec<Vec3f>,
    ) -> Result<Self, SurfaceError> {
        let n = positions.len();
        if n == 0 {
            return Err(SurfaceError::Empty);
        }
        if n >= u32::MAX as usize {
            let rule = format!("there are {n} points; there must be fewer than {}", u32::MAX);
            return Err(SurfaceError::Points { rule });
        }
        for (what, attribute) in [("normals", &normals), ("colours", &colors)] {
            if !attribute.is_empty() && attribute.len() != n {
                let rule =
                    format!("there are {} {what}; there must be as many as points, {n}", attribute.len());
                return Err(SurfaceError::Points { rule });
            }
        }
        for (what, values) in [("position", &positions), ("normal", &normals), ("colour", &colors)] {
            if let Some(i) = values.iter().position(|v| !v.is_finite()) {
                let found = values[i].to_array();
                let rule = format!("the {what} of point {i} is {found:?}; it must be finite");
                return Err(SurfaceError::Points { rule });
            }
        }
        let (planes, spacing) = planes(&positions);
        if normals.is_empty() {
            normals = planes;
        } else {
            for (n, plane) in normals.iter_mut().zip(planes) {
                let unit = n.normalize_or_zero();
                *n = if unit == Vec3f::zero() { plane } else { unit };
            }
        }
        Ok(Self { positions, normals, spacing, colors })
    }

    /// Positions, in the frame of the caller.
    pub fn positions(&self) -> &[Vec3f] {
        &self.positions
    }

    /// Unit normals of unknown sign; zero where neighbours do not span a plane.
    pub fn normals(&self) -> &[Vec3f] {
        &self.normals
    }

    /// Distance between neighbours around each point; 0 for a lone point and among duplicates.
    pub fn spacing(&self) -> &[f32] {
        &self.spacing
    }

    /// Linear RGB, or empty.
    pub fn colors(&self) -> &[Vec3f] {
        &self.colors
    }
}

/// Normal of the plane through the neighbours, and spacing, of every point.
fn planes(positions: &[Vec3f]) -> (Vec<Vec3f>, Vec<f32>) {
    let tree = KdTree::new(positions);
    // In the order of the tree, so that what a task needs is near in memory.
    let found: Vec<(Vec3f, f32, [u32; NEIGHBORS])> = tree
        .order()
        .par_chunks(CHUNK)
        .flat_map_iter(|chunk| {
            let mut nearest = Nearest::new(NEIGHBORS);
            let mut out = Vec::with_capacity(chunk.len());
            for &i in chunk {
                let p = positions[i as usize];
                tree.nearest(p, &mut nearest);
                out.push((plane_normal(&tree, p, &nearest), spacing(&nearest), places(&nearest)));
            }
            out
        })
        .collect();
    let mut normals = vec![Vec3f::zero(); positions.len()];
    let mut spacing = vec![0.0; positions.len()];
    for (&i, (n, s, places)) in tree.order().iter().zip(&found) {
        normals[i as usize] = *n;
        spacing[i as usize] = s.min(MOST_SPACING * quartile(places.map(|at| found[at as usize].1)));
    }
    (normals, spacing)
}

/// Places of the neighbours in the order of the tree, the last one repeated where there are fewer.
fn places(nearest: &Nearest) -> [u32; NEIGHBORS] {
    let items = nearest.items();
    std::array::from_fn(|k| items.get(k).or(items.last()).map_or(0, |item| item.1))
}

/// The lower quartile; duplicates, whose spacing is 0, count last.
fn quartile(spacing: [f32; NEIGHBORS]) -> f32 {
    let mut values = spacing.map(|s| if s > 0.0 { s } else { f32::INFINITY });
    *values.select_nth_unstable_by(NEIGHBORS / 4, f32::total_cmp).1
}

fn spacing(nearest: &Nearest) -> f32 {
    let k = nearest.items().len().saturating_sub(1);
    match nearest.items().last() {
        Some(&(d2, _)) if k > 0 => (d2 * std::f32::consts::PI / k as f32).sqrt(),
        _ => 0.0,
    }
}

/// The direction in which the neighbours spread least; zero when they lie on a line or in one place.
fn plane_normal(tree: &KdTree, p: Vec3f, nearest: &Nearest) -> Vec3f {
    let count = nearest.items().len();
    if count < 3 {
        return Vec3f::zero();
    }
    let scale = nearest.items()[count - 1].0.sqrt();
    if scale < f32::MIN_POSITIVE {
        return Vec3f::zero();
    }
    let offset = |at: u32| ((tree.point(at) - p) * (1.0 / scale)).cast::<f64>();
    let mut mean = Vec3::<f64>::zero();
    nearest.items().iter().for_each(|&(_, at)| mean += offset(at));
    mean *= 1.0 / count as f64;
    // Upper triangle: xx, xy, xz, yy, yz, zz.
    let mut c = [0.0; 6];
    for &(_, at) in nearest.items() {
        let d = offset(at) - mean;
        let products = [d.x * d.x, d.x * d.y, d.x * d.z, d.y * d.y, d.y * d.z, d.z * d.z];
        c.iter_mut().zip(products).for_each(|(c, p)| *c += p);
    }
    smallest_eigenvector(c).cast()
}

/// Unit eigenvector of the smallest eigenvalue of a symmetric matrix `xx, xy, xz, yy, yz, zz` of size about 1; zero
/// when the two smallest are equal to within 1e-6 of the largest.
fn smallest_eigenvector(c: [f64; 6]) -> Vec3<f64> {
    let mut a = [[c[0], c[1], c[2]], [c[1], c[3], c[4]], [c[2], c[4], c[5]]];
    let mut v = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    // Cyclic Jacobi: converges quadratically, five sweeps reach double precision.
    for _ in 0..8 {
        let off = a[0][1] * a[0][1] + a[0][2] * a[0][2] + a[1][2] * a[1][2];
        if off < 1e-30 {
            break;
        }
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            rotate(&mut a, &mut v, p, q);
        }
    }
    let values = [a[0][0], a[1][1], a[2][2]];
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| values[i].total_cmp(&values[j]));
    let [low, mid, high] = order.map(|i| values[i]);
    if mid - low > 1e-6 * high {
        vec3(v[0][order[0]], v[1][order[0]], v[2][order[0]]).normalize_or_zero()
    } else {
        Vec3::zero()
    }
}

/// One Jacobi rotation that makes `a[p][q]` zero.
fn rotate(a: &mut [[f64; 3]; 3], v: &mut [[f64; 3]; 3], p: usize, q: usize) {
    if a[p][q].abs() < 1e-300 {
        return;
    }
    let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
    let c = 1.0 / (t * t + 1.0).sqrt();
    let s = t * c;
    for k in 0..3 {
        let (x, y) = (a[k][p], a[k][q]);
        (a[k][p], a[k][q]) = (c * x - s * y, s * x + c * y);
    }
    for k in 0..3 {
        let (x, y) = (a[p][k], a[q][k]);
        (a[p][k], a[q][k]) = (c * x - s * y, s * x + c * y);
        let (x, y) = (v[k][p], v[k][q]);
        (v[k][p], v[k][q]) = (c * x - s * y, s * x + c * y);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_sampling::{Rng, fibonacci_sphere};

    #[test]
    fn eigenvectors_of_random_matrices() {
        let mut rng = Rng::new(5, 0);
        for _ in 0..200 {
            let mut c = [0.0; 6];
            for _ in 0..6 {
                let d = [rng.next_f64() - 0.5, rng.next_f64() - 0.5, rng.next_f64() - 0.5];
                let products = [d[0] * d[0], d[0] * d[1], d[0] * d[2], d[1] * d[1], d[1] * d[2], d[2] * d[2]];
                c.iter_mut().zip(products).for_each(|(c, p)| *c += p);
            }
            let e = smallest_eigenvector(c);
            let image = vec3(
                c[0] * e.x + c[1] * e.y + c[2] * e.z,
                c[1] * e.x + c[3] * e.y + c[4] * e.z,
                c[2] * e.x + c[4] * e.y + c[5] * e.z,
            );
            let value = image.dot(e);
            assert!((image - e * value).length() < 1e-12);
            // No other direction spreads less.
            for _ in 0..20 {
                let d = vec3(rng.next_f64() - 0.5, rng.next_f64() - 0.5, rng.next_f64() - 0.5);
                let d = d.normalize_or_zero();
                let other = c[0] * d.x * d.x
                    + c[3] * d.y * d.y
                    + c[5] * d.z * d.z
                    + 2.0 * (c[1] * d.x * d.y + c[2] * d.x * d.z + c[4] * d.y * d.z);
                assert!(other >= value - 1e-12);
            }
        }
    }

    #[test]
    fn normals_and_spacing_of_a_sphere() {
        let n = 20_000;
        let points: Vec<Vec3f> =
            (0..n).map(|i| fibonacci_sphere(i, n) * 2.0 + vec3(10.0, 0.0, 0.0)).collect();
        let cloud = Cloud::new(points.clone(), vec![], vec![]).unwrap();
        let side = (4.0 * std::f32::consts::PI * 4.0 / n as f32).sqrt();
        for (i, p) in points.iter().enumerate() {
            let radial = (*p - vec3(10.0, 0.0, 0.0)) * 0.5;
            assert!(cloud.normals()[i].dot(radial).abs() > 0.9995, "point {i}");
            assert!(
                (cloud.spacing()[i] / side - 1.0).abs() < 0.25,
                "point {i}: {}",
                cloud.spacing()[i] / side
            );
        }
    }

    #[test]
    fn strays_are_no_larger_than_what_is_around_them() {
        let mut points: Vec<Vec3f> = (0..900).map(|i| vec3((i % 30) as f32, (i / 30) as f32, 0.0)).collect();
        points.push(vec3(15.0, 15.0, 6.0));
        // A pile of duplicates says nothing about its surroundings.
        points.extend([vec3(5.5, 5.5, 0.0); 20]);
        let spacing = Cloud::new(points, vec![], vec![]).unwrap().spacing().to_vec();
        assert!((1.5..2.5).contains(&spacing[900]), "a stray 6 above: {}", spacing[900]);
        assert!((0.5..1.2).contains(&spacing[5 * 30 + 4]), "beside the pile: {}", spacing[5 * 30 + 4]);
        assert!(spacing[910] == 0.0, "in the pile");
    }

    #[test]
    fn given_normals_are_kept_and_missing_ones_found() {
        let grid: Vec<Vec3f> = (0..100).map(|i| vec3((i % 10) as f32, (i / 10) as f32, 0.0)).collect();
        let mut given = vec![vec3(0.0, 2.0, 0.0); 100];
        given[55] = Vec3f::zero();
        let cloud = Cloud::new(grid, given, vec![]).unwrap();
        assert_eq!(cloud.normals()[3], vec3(0.0, 1.0, 0.0));
        assert!(cloud.normals()[55].z.abs() > 0.999);
    }

    #[test]
    fn degenerate_clouds_have_no_normals() {
        for points in [vec![Vec3f::splat(3.0)], vec![Vec3f::splat(-1e6); 50]] {
            let cloud = Cloud::new(points, vec![], vec![]).unwrap();
            assert_eq!((cloud.normals()[0], cloud.spacing()[0]), (Vec3f::zero(), 0.0));
        }
        let line = (0..50).map(|i| vec3(i as f32, 0.0, 0.0)).collect();
        assert_eq!(Cloud::new(line, vec![], vec![]).unwrap().normals()[25], Vec3f::zero());
        let rule = |p, n, c| Cloud::new(p, n, c).unwrap_err().to_string();
        assert_eq!(rule(vec![], vec![], vec![]), "the cloud has no points");
        let expected = "points: the position of point 0 is [NaN, 0.0, 0.0]; it must be finite";
        assert_eq!(rule(vec![vec3(f32::NAN, 0.0, 0.0)], vec![], vec![]), expected);
        let expected = "points: there are 2 normals; there must be as many as points, 1";
        assert_eq!(rule(vec![Vec3f::zero()], vec![Vec3f::zero(); 2], vec![]), expected);
        let expected = "points: the colour of point 0 is [inf, inf, inf]; it must be finite";
        assert_eq!(rule(vec![Vec3f::zero()], vec![], vec![Vec3f::splat(f32::INFINITY)]), expected);
    }
}
