//! Triangles where pictures miss them: the asset is decimated once more with the outline that each part of it shows counting
//! beside what can be seen of it, and the one that looks better goes on.
//!
//! What decimation does to an outline no map mends, so that it may hold most of the error that is left. The budget stays; a
//! part that is on the outline of many views gets triangles of parts that are on it in few ([`crate::outline`]).

use super::prepare::{self, Start};
use super::{Init, SimplifyOptions, choice};
use crate::bake::ReferenceSurface;
use crate::candidate::Candidate;
use crate::engine::Normalised;
use crate::engine::plan::{Item, Runs};
use crate::engine::surface;
use crate::engine::trainer::HeldOut;
use crate::outline::{OutlineSettings, outline_reporting, smoothed};
use crate::visibility::Visibility;
use crate::{FitError, Progress};
use photofit_geometry::decimate::Target;
use photofit_raster::deferred::Passes;
use std::time::Instant;

/// The row of the plan.
const ROW: &str = "triangles by outline";
/// How much outlines count in the importance of a triangle, of 1; the rest is what can be seen of it.
const SHARE: f64 = 0.5;
/// Share of the squared error at the outline below which nothing is tried.
const LEAST_AT_OUTLINE: f64 = 0.3;
/// Rings over which outlines are smoothed, in sides of a triangle of the light asset.
const RINGS: f64 = 0.5;
/// Most rings.
const MOST_RINGS: f64 = 24.0;

/// What the fit can start from ([`prepare::prepare`]): of the asset decimated by what can be seen of it and, where the outline
/// holds much of the error of that, by outlines too, what looks better in the held-out views. And the row of the plan.
pub(super) fn starts(
    n: &Normalised,
    reference: &ReferenceSurface<'_>,
    seen: &Visibility,
    from: Option<&Candidate>,
    held_out: &HeldOut,
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<(Vec<Start>, Item), FitError> {
    let visible = prepare::importance(n, seen);
    let starts = prepare::prepare(n, reference, (seen, &visible), from, options, progress)?;
    let skipped = |starts, why: String| Ok((starts, Item { what: ROW, runs: Runs::No, why }));
    if let Some(why) = needless(from, options) {
        return skipped(starts, why.into());
    }
    let first = choice::best_start(&starts, held_out);
    let pictures = surface::pictures(&first.candidate, held_out.shots(), &Passes::default());
    let (quality, at_outline) = (held_out.psnr(&pictures), held_out.at_outline(&pictures));
    let percent = 100.0 * at_outline;
    if at_outline < LEAST_AT_OUTLINE {
        let least = 100.0 * LEAST_AT_OUTLINE;
        return skipped(
            starts,
            format!("{percent:.0}% of the squared error lies at the outline, less than {least:.0}%"),
        );
    }
    let began = Instant::now();
    let importance = importance(n, reference, seen, starts[0].candidate.triangles.len(), progress)?;
    let others = prepare::prepare(n, reference, (seen, &importance), None, options, progress)?;
    let second = choice::best_start(&others, held_out);
    let other = held_out.psnr(&surface::pictures(&second.candidate, held_out.shots(), &Passes::default()));
    let seconds = began.elapsed().as_secs_f64();
    let why = format!(
        "{percent:.0}% of the squared error lies at the outline: with outlines counting {other:.2} dB, without {quality:.2} dB \
         ({seconds:.0} s)"
    );
    let taken = other > quality;
    let item = Item { what: ROW, runs: taken.into(), why };
    Ok((if taken { others } else { starts }, item))
}

/// The row of the plan before anything is drawn.
pub(super) fn planned(options: &SimplifyOptions) -> Item {
    let (runs, why) = match needless(None, options) {
        Some(why) => (Runs::No, why.to_owned()),
        None => {
            let least = 100.0 * LEAST_AT_OUTLINE;
            (Runs::Open, format!("where {least:.0}% of the squared error or more lie at the outline"))
        }
    };
    Item { what: ROW, runs, why }
}

/// Why there is nothing to try.
fn needless(from: Option<&Candidate>, options: &SimplifyOptions) -> Option<&'static str> {
    match (options.init, from, options.target) {
        (Init::Sphere, ..) => Some("the fit starts from a sphere"),
        (_, Some(_), _) => Some("the fit starts from the level before"),
        (_, _, Target::Error(_) | Target::ScreenSize(_)) => {
            Some("the budget is an error: other weights mean other numbers of triangles")
        }
        _ if !options.effort.work().compares_starts => Some("a fast fit has one start"),
        _ => None,
    }
}

/// How much each triangle of the reference counts where outlines do, in a mesh of `budget` triangles.
fn importance(
    n: &Normalised,
    reference: &ReferenceSurface<'_>,
    seen: &Visibility,
    budget: usize,
    progress: &dyn Progress,
) -> Result<Vec<f32>, FitError> {
    let heard = prepare::heard("outline", progress);
    let lengths = outline_reporting(reference, &OutlineSettings::default(), &heard);
    let lengths = lengths.ok_or(FitError::Interrupted)?;
    let sides = (reference.mesh().triangles.len() as f64 / budget.max(1) as f64).sqrt();
    let rings = (RINGS * sides).clamp(1.0, MOST_RINGS).round() as usize;
    let density = smoothed(reference, &lengths, rings);
    let mut importance = prepare::importance(n, seen);
    let mean = |of: &[f32]| {
        let weighted = |(t, w): (usize, &f32)| f64::from(reference.area_normal(t as u32).length() * w);
        of.iter().enumerate().map(weighted).sum::<f64>()
    };
    let (visible, outlines) = (mean(&importance), mean(&density));
    if outlines > 0.0 {
        for (w, d) in importance.iter_mut().zip(&density).filter(|(w, _)| **w > 0.0) {
            *w = ((1.0 - SHARE) * f64::from(*w) + SHARE * f64::from(*d) * visible / outlines) as f32;
        }
    }
    Ok(importance)
}

#[cfg(test)]
mod tests;
