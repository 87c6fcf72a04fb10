//! How far from each vertex of the target to look for the reference.

use super::select::Selector;
use super::target::{Point, point};
use photofit_geometry::Mesh;
use photofit_scalar::Vec3f;
use rayon::prelude::*;

/// Least distance to look, in diagonals: covers what the samples below miss between them.
const FLOOR: f32 = 0.003;
/// Barycentric weights of the points at which a triangle is measured: centroid and midpoints of the edges.
const INNER: [[f32; 3]; 4] =
    [[1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0], [0.5, 0.5, 0.0], [0.0, 0.5, 0.5], [0.5, 0.0, 0.5]];

/// Distance to look at each vertex of the target: twice the largest distance measured at it and on its triangles.
///
/// Twice, since a line along the normal meets the reference farther away than the closest point. Points that find no
/// surface count as the floor: their samples search the full distance by themselves.
pub(super) fn measure(selector: &Selector<'_>, target: &Mesh, directions: &[Vec3f]) -> Vec<f32> {
    let floor = FLOOR * selector.reference.diagonal();
    let at = |p: Option<Point>| p.and_then(|p| selector.distance(&p)).unwrap_or(0.0);
    let mut cage: Vec<f32> = (0..target.positions.len())
        .into_par_iter()
        .map(|v| {
            let normal = directions[v].normalize_or_zero();
            at((normal.length_squared() > 0.0).then_some(Point { position: target.positions[v], normal }))
        })
        .collect();
    let inner: Vec<f32> = (0..target.triangles.len())
        .into_par_iter()
        .map(|t| INNER.iter().map(|&w| at(point(target, directions, t, w, 0.0))).fold(0.0, f32::max))
        .collect();
    for (corners, &d) in target.triangles.iter().zip(&inner) {
        for &i in corners {
            let c = &mut cage[i as usize];
            *c = c.max(d);
        }
    }
    cage.iter().map(|d| (2.0 * d + floor).min(selector.limit)).collect()
}
