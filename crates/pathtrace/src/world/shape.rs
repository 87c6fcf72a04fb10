//! Shapes as they are kept: checked, and moved to the middle of their frame where they lie far off.

use super::parts::Shape;
use super::surface::largest;
use crate::PathtraceError;
use crate::error::invalid;
use glam::DVec3;
use photofit_geometry::Mesh;
use photofit_rays::{AccelError, DistanceGrid, MAX_COORDINATE, exact_center};
use photofit_scalar::Vec3f;
use rayon::prelude::*;

/// A shape ready to be placed.
#[derive(Clone, Debug)]
pub(crate) struct Stored {
    pub(crate) kind: Kind,
    /// Subtracted from every position.
    pub(crate) center: DVec3,
    /// Unit normals of the triangles, zero for those without area.
    pub(crate) facets: Vec<Vec3f>,
    /// Box of the centred shape; empty (lower above upper) without triangles.
    pub(crate) bounds: [DVec3; 2],
}

/// Geometry in the centred frame.
#[derive(Clone, Debug)]
pub(crate) enum Kind {
    Mesh(Mesh),
    /// A sphere around the origin.
    Sphere {
        radius: f32,
    },
    /// A grid over the unit cube.
    DistanceGrid {
        grid: Box<DistanceGrid>,
        /// Cells along each axis.
        cells: DVec3,
        smooth: bool,
    },
}

/// Boxes farther off than this many times their size are moved.
const FAR: f64 = 16.0;

impl Stored {
    /// Checks a shape and takes it over.
    pub(crate) fn new(index: usize, shape: Shape) -> Result<Self, PathtraceError> {
        match shape {
            Shape::Mesh(mesh) => Self::mesh(index, mesh),
            Shape::Sphere { center, radius } => {
                let place = || format!("shape {index}");
                if !(radius > 0.0 && radius <= MAX_COORDINATE) {
                    return Err(invalid(
                        place(),
                        format!("the radius is {radius}; it must be positive and at most {MAX_COORDINATE:e}"),
                    ));
                }
                if !center.is_finite() {
                    return Err(invalid(
                        place(),
                        format!("the centre is {:?}; it must be finite", center.to_array()),
                    ));
                }
                let r = f64::from(radius);
                let center = DVec3::new(f64::from(center.x), f64::from(center.y), f64::from(center.z));
                let bounds = [DVec3::splat(-r), DVec3::splat(r)];
                Ok(Self { kind: Kind::Sphere { radius }, center, facets: Vec::new(), bounds })
            }
            Shape::DistanceGrid { size, values, smooth } => {
                let grid = DistanceGrid::new(size, values)
                    .map_err(|cause| invalid(format!("shape {index}"), cause.to_string()))?;
                let cells = DVec3::from_array(size.map(|n| (n - 1) as f64));
                let bounds = grid.bounds().map(|p| p / cells);
                let kind = Kind::DistanceGrid { grid: Box::new(grid), cells, smooth };
                Ok(Self { kind, center: DVec3::ZERO, facets: Vec::new(), bounds })
            }
        }
    }

    fn mesh(shape: usize, mut mesh: Mesh) -> Result<Self, PathtraceError> {
        if let Some((name, length)) = mesh.misfit() {
            let n = mesh.positions.len();
            let rule =
                format!("there are {length} {name} for {n} vertices; there must be none, or one a vertex");
            return Err(invalid(format!("shape {shape}"), rule));
        }
        let bounds = bounds(&mesh).map_err(|cause| PathtraceError::Accel { shape, cause })?;
        let center = far_center(bounds);
        if center != DVec3::ZERO {
            for p in &mut mesh.positions {
                for (x, c) in [(&mut p.x, center.x), (&mut p.y, center.y), (&mut p.z, center.z)] {
                    *x = (f64::from(*x) - c) as f32;
                }
            }
        }
        let facet = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
            cross_safe(b - a, c - a).normalize_or_zero()
        };
        let facets = mesh.triangles.par_iter().map(facet).collect();
        Ok(Self { kind: Kind::Mesh(mesh), center, facets, bounds: bounds.map(|p| p - center) })
    }

    /// Number of triangles; 1 for a sphere, that of cells with a part of the surface for a grid.
    pub(crate) fn pieces(&self) -> usize {
        match &self.kind {
            Kind::Mesh(mesh) => mesh.triangles.len(),
            Kind::Sphere { .. } => 1,
            Kind::DistanceGrid { grid, .. } => grid.cells(),
        }
    }
}

/// The cross product of edges of any length, up to a positive factor.
#[inline(always)]
fn cross_safe(a: Vec3f, b: Vec3f) -> Vec3f {
    let c = a.cross(b);
    if c.length_squared() > 1e-30 {
        return c;
    }
    let unit = |v: Vec3f| {
        let l = largest(v);
        if l > 0.0 { v * (1.0 / l) } else { v }
    };
    unit(a).cross(unit(b))
}

/// The box of the vertices that triangles name; all of them are checked.
fn bounds(mesh: &Mesh) -> Result<[DVec3; 2], AccelError> {
    let (mut lo, mut hi) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for (triangle, corners) in mesh.triangles.iter().enumerate() {
        for &index in corners {
            let vertex = index as usize;
            let Some(&p) = mesh.positions.get(vertex) else {
                return Err(AccelError::Index { triangle, index, vertices: mesh.positions.len() });
            };
            if !p.is_finite() {
                return Err(AccelError::NonFinite { vertex });
            }
            if p.to_array().iter().any(|x| x.abs() > MAX_COORDINATE) {
                return Err(AccelError::TooFar { vertex });
            }
            let p = DVec3::new(f64::from(p.x), f64::from(p.y), f64::from(p.z));
            (lo, hi) = (lo.min(p), hi.max(p));
        }
    }
    Ok([lo, hi])
}

/// What the coordinates of a box that lies far off are moved by, without loss of a digit ([`exact_center`]); else the origin.
///
/// Nearer than [`FAR`] times the size little would be gained, and shapes that touch, each moved by a centre of its own, would touch
/// to the last place alone where they are rotated.
pub(crate) fn far_center([lo, hi]: [DVec3; 2]) -> DVec3 {
    let size = (hi - lo).max_element();
    let far = lo.abs().max(hi.abs()).max_element();
    if !(size >= 0.0 && far > FAR * size && far.is_finite()) {
        return DVec3::ZERO;
    }
    DVec3::from_array(std::array::from_fn(|k| exact_center([lo[k], hi[k]])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use photofit_scalar::vec3;

    #[test]
    fn far_shapes_are_moved_exactly_and_near_ones_not_at_all() {
        let near = [DVec3::new(-1.0, 2.0, 0.0), DVec3::new(0.3, 2.5, 1.0)];
        assert_eq!(far_center(near), DVec3::ZERO);
        let positions = vec![vec3(1e6, 2.0, -3.0), vec3(1e6 + 0.5, 2.0, -3.0), vec3(1e6, 3.125, -3.0)];
        let mesh = Mesh { positions: positions.clone(), triangles: vec![[0, 1, 2]], ..Mesh::default() };
        let stored = Stored::new(0, Shape::Mesh(mesh)).unwrap();
        let Kind::Mesh(moved) = &stored.kind else { panic!("a mesh") };
        assert!(moved.positions.iter().all(|p| p.x.abs() < 1.0), "{:?}", moved.positions);
        for (p, q) in positions.iter().zip(&moved.positions) {
            let back = DVec3::new(f64::from(q.x), f64::from(q.y), f64::from(q.z)) + stored.center;
            assert_eq!(back.as_vec3().to_array(), p.to_array(), "exact");
        }
        // Far along one axis alone: the digits of coordinates around 0 along another stay.
        let across = [DVec3::new(1e6, -1e-3, 0.2), DVec3::new(1e6 + 1.0, 1.3, 0.9)];
        assert_eq!(far_center(across), DVec3::new(1e6 + 0.5, 0.0, 0.0));
    }
}
