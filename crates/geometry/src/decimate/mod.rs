//! Edge-collapse decimation with attribute-aware quadrics.
//!
//! The input is welded by position, cleaned and put into a unit frame; every triangle leaves its plane quadric, weighted
//! by area and importance, at its vertices (Garland and Heckbert, "Surface simplification using quadric error
//! metrics", 1997); open borders, edges between groups and attribute seams add planes that hold them. The cheapest
//! edge collapses first, to the minimum of the summed quadrics. On top of the quadric a collapse pays for the area
//! that it loses or gains times its squared displacement: plane distances alone do not see that a tube gets shorter.
//! With attributes (`keep_uvs`) the quadrics of Hoppe, "New quadric metric for simplifying meshes with appearance
//! attributes", 1999, are eliminated into the plain ones.
//!
//! After the collapses the positions are fitted to samples of the input surface, with edge flips in between (Hoppe et
//! al., "Mesh optimization", 1993): at 1 to 3 % of the triangles this takes a third off the surface error. Attributes
//! that are kept follow: what the triangles interpolate is fitted to the same samples by least squares, in which vertices of
//! seams keep their texture coordinates, wedges with like normals or colours change as one, and samples that lie nearest to another group,
//! to the other side of an edge of normals, or to another chart, do not count.
//!
//! Silhouettes go with the length of a part, not with its area, so thin components (ropes, straps) count more
//! ([`Options::thin_power`]). Dropping a whole small component competes in the same queue at the price of collapsing
//! it onto its axis. But for locked vertices a budget is always reached: by collapses under full checks, then with
//! relaxed ones, then without, and in the end by dropping components. Errors are estimates from the quadrics.
//!
//! ```
//! use photofit_geometry::{Mesh, decimate::{Options, Target, decimate}};
//! use photofit_scalar::vec3;
//! // A flat grid of 200 triangles needs two.
//! let mut mesh = Mesh::default();
//! for j in 0..11 {
//!     for i in 0..11 {
//!         mesh.positions.push(vec3(i as f32, j as f32, 0.0));
//!     }
//! }
//! for j in 0..10 {
//!     for i in 0..10 {
//!         let k = j * 11 + i;
//!         mesh.triangles.extend([[k, k + 1, k + 12], [k, k + 12, k + 11]]);
//!     }
//! }
//! let light = decimate(&mesh, &[], &[], &Options::new(Target::Triangles(2)))?;
//! assert_eq!(light.mesh.triangles.len(), 2);
//! assert!(light.relative_error < 1e-3);
//! # Ok::<(), photofit_geometry::decimate::DecimateError>(())
//! ```

mod check;
mod clean;
mod components;
mod engine;
mod flip;
mod options;
mod output;
mod part;
mod quadric;
mod queue;
mod refine;
mod refit;
mod run;
mod setup;
mod topology;
mod wedge;

#[cfg(test)]
mod tests;

pub use clean::cleaned;
pub use components::components;
pub use options::{DecimateError, Decimated, Options, Stats, Target};

use crate::Mesh;
use std::ops::ControlFlow;

/// Share of the work that the collapses are, about.
const COLLAPSES: f32 = 0.6;

/// Decimates a mesh to a target.
///
/// `group` (one number per triangle: material, alpha class) and `importance` (one number `>= 0` per triangle: visible
/// share, screen-space weight; only ratios matter) may be empty, which means 0 and 1 everywhere. A triangle keeps its
/// group. Tangents are dropped; without [`Options::keep_uvs`] all attributes are. A budget that is not below the
/// number of triangles gives back the welded and cleaned input.
///
/// The result depends on the input alone and is the same, bit by bit, on every run.
///
/// # Errors
/// [`DecimateError`] where sizes disagree, a number is not finite, an index is out of range, the budget is zero or no
/// triangle has distinct corners.
pub fn decimate(
    mesh: &Mesh,
    group: &[u32],
    importance: &[f32],
    options: &Options,
) -> Result<Decimated, DecimateError> {
    decimate_reporting(mesh, group, importance, options, &|_| ControlFlow::Continue(()))
}

/// As [`decimate`]; `report` hears the finished share in `[0, 1]` and may end the work.
///
/// # Errors
/// As [`decimate`], and [`DecimateError::Stopped`].
pub fn decimate_reporting(
    mesh: &Mesh,
    group: &[u32],
    importance: &[f32],
    options: &Options,
    report: &dyn Fn(f32) -> ControlFlow<()>,
) -> Result<Decimated, DecimateError> {
    clean::validate(mesh, group, importance, options)?;
    let mut soup = clean::clean(mesh, group, options)?;
    let mut stats = Stats {
        input_triangles: mesh.triangles.len(),
        input_vertices: mesh.positions.len(),
        welded_vertices: soup.positions.len(),
        cleaned: soup.cleaned,
        ..Stats::default()
    };
    let goal = run::Goal::new(options, mesh.triangles.len());
    if options.drop_unseen && !options.lock_border && goal.triangles < soup.triangles.len() {
        stats.unseen = setup::drop_unseen(&mut soup, importance);
    }
    let (centre, diagonal, source) = (soup.centre, soup.diagonal, soup.source.clone());
    let (mut engine, original) = setup::engine(mesh, soup, group, importance, options);
    stats.components = engine.parts.len();
    let goal = goal.beside_locked(&engine);
    run::run(&mut engine, &goal, &mut stats, &|share| report(share * COLLAPSES))?;
    if let Some(original) = original.filter(|_| stats.collapses > 0) {
        let report = |share: f32| report(COLLAPSES + (1.0 - COLLAPSES) * share);
        refine::refine(&mut engine, &original, options.refine_rounds, &report)?;
    }
    let output::Output { mesh, group, source, locked } =
        output::output(&engine, mesh, &source, centre, diagonal);
    let relative_error = engine.worst.sqrt();
    Ok(Decimated { mesh, group, source, locked, error: relative_error * diagonal, relative_error, stats })
}
