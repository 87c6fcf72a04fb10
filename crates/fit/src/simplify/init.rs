//! What a fit can start from: what each start needs, and how its shape is made.

use super::options::rule;
use super::prepare::{Weights, decimated};
use super::{SimplifyOptions, Written, locks, shrink_wrap};
use crate::bake::ReferenceSurface;
use crate::engine::Normalised;
use crate::visibility::Visibility;
use crate::{FitError, Progress};
use photofit_geometry::decimate::{Decimated, Target};
use photofit_geometry::{Mesh, shapes};
use photofit_rays::NearestPoint;
use photofit_scalar::vec3;
use rayon::prelude::*;
use std::collections::HashSet;

/// Triangles of an icosahedron, of which spheres are made.
const LEAST_OF_SPHERE: usize = 20;

/// What the fit starts from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Init {
    /// The decimated reference.
    #[default]
    Decimate,
    /// A sphere.
    Sphere,
}

/// A shape that a fit can start from.
pub(super) struct Shape {
    /// Drawn onto the reference.
    pub(super) mesh: Mesh,
    /// The class of each triangle.
    pub(super) class: Vec<u32>,
    /// What it is where it is written as it stands.
    pub(super) made: Written,
    /// The same mesh as decimation left it, where there was one.
    pub(super) decimated: Option<Mesh>,
    /// Positions that stay.
    pub(super) locked: HashSet<[u32; 3]>,
    /// Triangles of the reference that the decimation left out since nobody sees them.
    pub(super) unseen: Option<usize>,
}

impl Shape {
    /// A decimated mesh, drawn onto the reference.
    pub(super) fn drawn(
        d: Decimated,
        reference: &ReferenceSurface<'_>,
        weights: (&Visibility, &[f32]),
        progress: &dyn Progress,
    ) -> Result<Self, FitError> {
        let mut mesh = d.mesh.clone();
        shrink_wrap::NEARBY.run(&mut mesh, &d.locked, reference, weights, progress)?;
        let (locked, unseen) = (locks::locked(&d), Some(d.stats.unseen));
        Ok(Self {
            mesh,
            class: d.group,
            made: Written::ShrinkWrapped,
            decimated: Some(d.mesh),
            locked,
            unseen,
        })
    }
}

impl Init {
    /// Whether it is the decimated asset: it may keep what the asset has, and is compared with what it was before it was drawn
    /// onto it.
    pub(super) fn is_decimated(self) -> bool {
        self == Self::Decimate
    }

    /// What it is, after `the fit starts from`.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Decimate => "the decimated asset",
            Self::Sphere => "a sphere",
        }
    }

    /// Refuses a target that it cannot meet for an asset of so many triangles.
    pub(super) fn check(self, target: Target, triangles: usize) -> Result<(), FitError> {
        if self.is_decimated() {
            return Ok(());
        }
        let most = match target {
            // A share leaves [`super::MIN_TRIANGLES`] or all there are.
            Target::Ratio(_) => triangles,
            target => self.budget(target, triangles)?,
        };
        let must = format!("needs a budget of {LEAST_OF_SPHERE} triangles at least, not of {most}");
        rule("init", self.name(), most >= LEAST_OF_SPHERE, &must)
    }

    /// The triangles of a start that is no decimated asset of so many.
    fn budget(self, target: Target, triangles: usize) -> Result<usize, FitError> {
        match target {
            Target::Triangles(t) => Ok(t),
            Target::Ratio(r) => Ok((triangles as f64 * r) as usize),
            Target::Error(_) | Target::ScreenSize(_) => {
                let must = "must be the decimated asset for a target by error or screen size";
                rule("init", self.name(), false, must).map(|()| triangles)
            }
        }
    }

    /// The shape in the frame of the reference.
    pub(super) fn shape(
        self,
        n: &Normalised,
        reference: &ReferenceSurface<'_>,
        (seen, weights): (&Visibility, Weights<'_>),
        options: &SimplifyOptions,
        progress: &dyn Progress,
    ) -> Result<Shape, FitError> {
        match self {
            Self::Decimate => {
                let (mesh, class) = (&n.flat.mesh, n.triangle_classes());
                let d = decimated(n, mesh, &class, weights.decimated, options, progress)?;
                Shape::drawn(d, reference, (seen, weights.drawn), progress)
            }
            Self::Sphere => {
                let budget = self.budget(options.target, n.flat.mesh.triangles.len())?;
                let mut mesh = sphere(n, seen, budget);
                let made = mesh.triangles.len();
                if made < budget {
                    progress.note(&format!(
                        "a sphere is an icosahedron whose sides are cut: of {budget} triangles that are allowed it has {made}"
                    ));
                }
                shrink_wrap::FROM_AFAR.run(&mut mesh, &[], reference, (seen, &[]), progress)?;
                let class = closest_classes(n, reference, seen, &mesh);
                let (made, locked) = (Written::Sphere, HashSet::new());
                Ok(Shape { mesh, class, made, decimated: None, locked, unseen: None })
            }
        }
    }
}

/// A sphere around the visible reference, as many triangles as the budget allows, which is no smaller than the least one.
fn sphere(n: &Normalised, seen: &Visibility, budget: usize) -> Mesh {
    let mut mesh = shapes::icosphere((budget / LEAST_OF_SPHERE).isqrt() as u32);
    let visible = |t: &usize| seen.is_visible(*t);
    let corners = || (0..n.flat.mesh.triangles.len()).filter(visible).flat_map(|t| n.flat.mesh.corners(t));
    let first = corners().next().unwrap_or_default();
    let (lo, hi) = corners().fold((first, first), |(lo, hi), p| (lo.min(p), hi.max(p)));
    let (center, half) = ((lo + hi) * 0.5, (hi - lo) * 0.5);
    for p in &mut mesh.positions {
        *p = center + vec3(p.x * half.x, p.y * half.y, p.z * half.z) * 0.9;
    }
    mesh.normals.clear();
    mesh
}

/// The class of each triangle of `mesh`: that of the visible triangle of the reference closest to its centre.
fn closest_classes(
    n: &Normalised,
    reference: &ReferenceSurface<'_>,
    seen: &Visibility,
    mesh: &Mesh,
) -> Vec<u32> {
    let classes = n.triangle_classes();
    (0..mesh.triangles.len())
        .into_par_iter()
        .map(|t| {
            let [a, b, c] = mesh.corners(t);
            let centre = (a + b + c) * (1.0 / 3.0);
            let visible = |p: &NearestPoint| seen.is_visible(p.triangle as usize);
            let closest = reference.accel().closest_point_where(centre, f32::INFINITY, visible);
            closest.map_or(0, |p| classes[p.triangle as usize])
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sphere_needs_the_triangles_of_the_least_one() {
        let refused = |target, triangles| {
            let options = SimplifyOptions { target, init: Init::Sphere, ..SimplifyOptions::default() };
            options.check(triangles).map_err(|e| e.to_string()).err()
        };
        let told = |most: usize| {
            Some(format!("init is a sphere; it needs a budget of 20 triangles at least, not of {most}"))
        };
        assert_eq!(refused(Target::Triangles(19), 500), told(19));
        assert_eq!(refused(Target::Ratio(0.5), 12), told(12), "all that there are");
        for (target, triangles) in
            [(Target::Triangles(20), 500), (Target::Ratio(0.001), 500), (Target::Ratio(0.5), 20)]
        {
            assert_eq!(refused(target, triangles), None, "{target:?} of {triangles}");
        }
        assert!(refused(Target::Error(0.1), 500).is_some_and(|e| e.contains("by error or screen size")));
        let few = SimplifyOptions { target: Target::Triangles(19), ..SimplifyOptions::default() };
        assert!(few.check(500).is_ok(), "a decimated asset may have fewer");
    }

    #[test]
    fn spheres_have_no_more_triangles_than_the_budget() {
        let scene = crate::simplify::tests::rock();
        let n = Normalised::new(&scene).unwrap();
        let seen = Visibility::everything(n.flat.mesh.triangles.len());
        for (budget, made) in [(20, 20), (79, 20), (80, 80), (1000, 980)] {
            assert_eq!(sphere(&n, &seen, budget).triangles.len(), made, "{budget}");
        }
    }
}
