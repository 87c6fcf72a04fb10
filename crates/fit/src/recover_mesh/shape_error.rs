//! How far two surfaces are apart.

use crate::bake::BakeError;
use crate::simplify::shrink_wrap::{Sample, sample};
use crate::visibility::Visibility;
use crate::{FitError, Progress};
use photofit_geometry::Mesh;
use photofit_rays::Accel;
use rayon::prelude::*;

/// Points on each of the two surfaces.
const POINTS: usize = 20_000;

/// Distance between two surfaces, by the closest points of points spread evenly over both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShapeError {
    /// Mean distance, percent of the bounding radius of the true one.
    pub mean: f64,
    /// Distance that 95% of the points stay below, percent of that radius.
    pub p95: f64,
    /// Mean angle between the normals, degrees.
    pub normals: f64,
}

/// The true surface: a mesh in the frame whose unit is its bounding radius, and what of it is seen from outside.
#[derive(Debug)]
pub(super) struct Truth {
    pub(super) mesh: Mesh,
    pub(super) seen: Visibility,
}

impl ShapeError {
    /// Between what is seen of `truth` and all of `mesh`, both ways.
    ///
    /// # Errors
    /// If a surface has no extent.
    pub(super) fn between(truth: &Truth, mesh: &Mesh, progress: &dyn Progress) -> Result<Self, FitError> {
        progress.report("shape error", 0, 1, "");
        let all = Visibility::everything(mesh.triangles.len());
        let there = one_way(&sample(&truth.mesh, (&truth.seen, &[]), POINTS), mesh, "recovered")?;
        let back = one_way(&sample(mesh, (&all, &[]), POINTS), &truth.mesh, "true")?;
        let (mut distances, angles): (Vec<f64>, Vec<f64>) = there.into_iter().chain(back).unzip();
        distances.sort_unstable_by(f64::total_cmp);
        let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len().max(1) as f64;
        let at = (distances.len() * 95 / 100).min(distances.len().saturating_sub(1));
        Ok(Self {
            mean: 100.0 * mean(&distances),
            p95: 100.0 * distances.get(at).copied().unwrap_or_default(),
            normals: mean(&angles),
        })
    }
}

/// Distance and angle of normals, degrees, from each point to the closest one of a mesh.
fn one_way(from: &[Sample], to: &Mesh, name: &'static str) -> Result<Vec<(f64, f64)>, FitError> {
    let accel = Accel::build(&to.positions, &to.triangles)
        .map_err(|source| BakeError::Geometry { mesh: name, source })?;
    let closest = |s: &Sample| {
        let point = accel.closest_point(s.at, f32::INFINITY)?;
        let [a, b, c] = to.corners(point.triangle as usize);
        let cosine = (b - a).cross(c - a).normalize_or_zero().dot(s.normal);
        Some((f64::from(point.distance), f64::from(cosine.clamp(-1.0, 1.0)).acos().to_degrees()))
    };
    Ok(from.par_iter().map(closest).collect::<Vec<_>>().into_iter().flatten().collect())
}
