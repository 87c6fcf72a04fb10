//! Triangles where pictures miss them: the asset is decimated once more with the outline that each part of it shows counting
//! beside what can be seen of it, and the one that looks better goes on.
//!
//! What decimation does to an outline no map mends, so that it may hold most of the error that is left. The budget stays; a
//! part that is on the outline of many views gets triangles of parts that are on it in few ([`crate::outline`]).

use super::SimplifyOptions;
use super::choice::{StartQuality, best_start};
use super::prepare::{self, Start, Weights};
use crate::bake::ReferenceSurface;
use crate::candidate::Candidate;
use crate::engine::Normalised;
use crate::engine::plan::{Item, Runs};
use crate::engine::trainer::HeldOut;
use crate::outline::{OutlineSettings, outline_reporting, smoothed};
use crate::visibility::Visibility;
use crate::{FitError, Progress};
use photofit_geometry::decimate::Target;

/// The row of the plan.
const ROW: &str = "triangles by outline";
/// How much outlines count in the importance of a triangle, of 1; the rest is what can be seen of it. Each is tried.
const SHARES: [f64; 2] = [0.9, 0.5];
/// Share of the squared error at the outline below which nothing is tried.
const LEAST_AT_OUTLINE: f64 = 0.3;
/// Rings over which outlines are smoothed, in sides of a triangle of the light asset.
const RINGS: f64 = 0.5;
/// Most rings.
const MOST_RINGS: f64 = 24.0;

/// What a fit can start from.
pub(super) struct Starts {
    pub(super) all: Vec<Start>,
    /// Which of them looks best.
    pub(super) best: usize,
    /// The row of the plan.
    pub(super) row: Item,
}

/// What the fit can start from ([`prepare::prepare`]): of the asset decimated by what can be seen of it and, where the outline
/// holds much of the error of that, by outlines too, what looks better in the held-out views.
pub(super) fn starts(
    n: &Normalised,
    reference: &ReferenceSurface<'_>,
    seen: &Visibility,
    from: Option<&Candidate>,
    held_out: &HeldOut,
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<Starts, FitError> {
    let visible = prepare::importance(n, seen);
    let starts = prepare::prepare(
        n,
        reference,
        (seen, Weights { decimated: &visible, drawn: &[] }),
        from,
        options,
        progress,
    )?;
    let skipped = |all, best, why| Ok(Starts { all, best, row: Item { what: ROW, runs: Runs::No, why } });
    let whole = starts[0].candidate.triangles.len() >= reference.mesh().triangles.len();
    if let Some(why) = needless(from, options).or(whole.then(|| "no triangle is taken away".into())) {
        // A single one need not be looked at.
        let best = if starts.len() > 1 { best_start(&starts, held_out).0 } else { 0 };
        return skipped(starts, best, why);
    }
    let (first, StartQuality { psnr, at_outline }) = best_start(&starts, held_out);
    let percent = 100.0 * at_outline;
    if at_outline < LEAST_AT_OUTLINE {
        let least = 100.0 * LEAST_AT_OUTLINE;
        let why = format!("{percent:.0}% of the squared error lies at the outline, less than {least:.0}%");
        return skipped(starts, first, why);
    }
    let density = density(reference, starts[0].candidate.triangles.len(), progress)?;
    let (mut all, mut best, mut most, mut taken) = (starts, first, psnr, None);
    let mut told = format!("{percent:.0}% of the squared error lies at the outline: {psnr:.2} dB;");
    for share in SHARES {
        let importance = importance(reference, &visible, &density, share);
        let weights = Weights { decimated: &importance, drawn: &importance };
        let others = prepare::prepare(n, reference, (seen, weights), None, options, progress)?;
        let (other, StartQuality { psnr, .. }) = best_start(&others, held_out);
        told += &format!(" {psnr:.2} where it counts {share},");
        if psnr > most {
            (all, best, most, taken) = (others, other, psnr, Some(share));
        }
    }
    let how = taken.map_or("it does not count".to_owned(), |share| format!("it counts {share}"));
    let told = told.trim_end_matches(',');
    let row = Item { what: ROW, runs: taken.is_some().into(), why: format!("{told}: {how}") };
    Ok(Starts { all, best, row })
}

/// The row of the plan before anything is drawn.
pub(super) fn planned(options: &SimplifyOptions) -> Item {
    let (runs, why) = match needless(None, options) {
        Some(why) => (Runs::No, why),
        None => {
            let least = 100.0 * LEAST_AT_OUTLINE;
            (Runs::Open, format!("where {least:.0}% of the squared error or more lie at the outline"))
        }
    };
    Item { what: ROW, runs, why }
}

/// Why there is nothing to try.
fn needless(from: Option<&Candidate>, options: &SimplifyOptions) -> Option<String> {
    let why = match (from, options.target) {
        (Some(_), _) => "the fit starts from the level before",
        _ if !options.init.is_decimated() => {
            return Some(format!("the fit starts from {}", options.init.name()));
        }
        (_, Target::Error(_) | Target::ScreenSize(_)) => {
            "the budget is an error or a size on screen: other weights mean other numbers of triangles"
        }
        _ if !options.effort.work().compares_starts => "a fast fit has one start",
        _ => return None,
    };
    Some(why.into())
}

/// Length of outline per area of each triangle of the reference, as smooth as a mesh of `budget` triangles can follow.
fn density(
    reference: &ReferenceSurface<'_>,
    budget: usize,
    progress: &dyn Progress,
) -> Result<Vec<f32>, FitError> {
    let heard = prepare::heard("outline", progress);
    let lengths = outline_reporting(reference, &OutlineSettings::default(), &heard);
    let lengths = lengths.ok_or(FitError::Interrupted)?;
    let sides = (reference.mesh().triangles.len() as f64 / budget.max(1) as f64).sqrt();
    let rings = (RINGS * sides).clamp(1.0, MOST_RINGS).round() as usize;
    Ok(smoothed(reference, &lengths, rings))
}

/// How much each triangle of the reference counts where outlines have a share in it.
fn importance(reference: &ReferenceSurface<'_>, visible: &[f32], density: &[f32], share: f64) -> Vec<f32> {
    let sum = |of: &[f32]| {
        let weighted = |(t, w): (usize, &f32)| f64::from(reference.area_normal(t as u32).length() * w);
        of.iter().enumerate().map(weighted).sum::<f64>()
    };
    let (all, outlines) = (sum(visible), sum(density));
    let scale = if outlines > 0.0 { share * all / outlines } else { 0.0 };
    let one = |(w, d): (&f32, &f32)| {
        if *w > 0.0 { ((1.0 - share) * f64::from(*w) + scale * f64::from(*d)) as f32 } else { 0.0 }
    };
    visible.iter().zip(density).map(one).collect()
}

#[cfg(test)]
mod tests;
