//! The triangles of a fit with maps of its own within a budget of bytes.
//!
//! Its geometry is another than that of the asset, with an atlas that splits vertices, so that starts of it are made and measured as they
//! would be written. How much of the file it should take depends on the asset: starts with several parts of it meet, each made to fit.

use super::triangles::{GEOMETRY, OTHER_PARTS, nearest};
use super::{Budget, Made, Shapes, bytes_without_textures, coarsest};
use crate::engine::plan::{Item, Runs};
use crate::engine::reference::Reference;
use crate::progress::AsStage;
use crate::simplify::prepare::{Weights, importance, prepare};
use crate::simplify::{Appearance, Asset, Effort, MIN_TRIANGLES, SimplifyOptions, dressed};
use crate::{FitError, Progress};
use photofit_geometry::decimate::Target;
use photofit_scene::Scene;
use std::cell::RefCell;

/// Parts of the file that the geometry of starts is tried with: first the convention.
const PARTS: [f64; 4] = [GEOMETRY, OTHER_PARTS[0], OTHER_PARTS[1], OTHER_PARTS[2]];
/// Part of these bytes that it may leave unused. A decimation alone is tried until it leaves less; a start takes long.
const UNUSED_BY_STARTS: f64 = 0.15;

/// A start, as it would be written with all of its texels.
struct Started {
    /// Triangles that were asked for.
    triangles: usize,
    light: Scene,
    /// Triangles that there are, and bytes without textures.
    size: [f64; 2],
}

/// The row of the plan.
const ROW: &str = "triangles by bytes";

/// The row of the plan before the work, where triangles follow from bytes.
pub(in crate::simplify) fn planned(options: &SimplifyOptions, scene: &Scene) -> Option<Item> {
    let all = options.target == Target::Triangles(scene.triangle_count());
    let (runs, why) = match options.appearance {
        _ if !options.triangles_by_bytes => return None,
        Appearance::Kept if all => (Runs::No, "all stay"),
        Appearance::Kept if scene.images.is_empty() => (Runs::Yes, "as many as take all of the bytes"),
        Appearance::Kept => {
            (Runs::Yes, "decimations whose geometry takes several parts of the bytes are compared")
        }
        _ if options.lacks_nothing(scene) => (Runs::No, "all stay"),
        Appearance::Maps => (Runs::Open, "starts decide whose geometry takes several parts of the bytes"),
        Appearance::VertexColors => (Runs::Open, "as many as take all of the bytes in a start"),
    };
    Some(Item { what: ROW, runs, why: why.into() })
}

/// The row of the plan after one of several decimations of an asset was `chosen`, so many of whose files are `fitting`; `cut`: the work was
/// ended before all of these were looked at.
pub(in crate::simplify) fn compared(
    options: &SimplifyOptions,
    scene: &Scene,
    (shapes, chosen): (&Shapes, usize),
    (fitting, cut): (usize, bool),
) -> Option<Item> {
    let planned = planned(options, scene)?;
    if planned.runs == Runs::No {
        return Some(planned);
    }
    let mut counts: Vec<String> = shapes.bare.iter().map(|s| s.triangle_count().to_string()).collect();
    let chosen = counts.swap_remove(chosen);
    let others = counts.join(", ");
    let why = match (counts.len(), fitting) {
        (0, _) => format!("{chosen}; no other number was tried"),
        (_, 0) => format!("{chosen} make the smallest file; {others} were tried, too, and none fits"),
        (_, 1) => format!("{chosen}; {others} were tried, too, and do not fit"),
        _ if cut => {
            format!("{chosen}; {others} were tried, too, and the work was ended before all were compared")
        }
        _ => format!("{chosen} look best; {others} were tried, too"),
    };
    Some(Item { why, ..planned })
}

/// The options with as many triangles as look best within the bytes in starts of what is to be fitted, where triangles follow from bytes
/// and do not all fit; and the row of the plan.
///
/// # Errors
/// If a start cannot be made or written, or a picture not be made.
pub(in crate::simplify) fn counted(
    asset: Asset<'_>,
    reference: &dyn Reference,
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<(SimplifyOptions, Option<Item>), FitError> {
    let found = match (options.max_bytes, options.target) {
        (Some(most), Target::Triangles(first))
            if options.triangles_by_bytes && !options.lacks_nothing(asset.scene) =>
        {
            let progress = &AsStage { progress, stage: "triangles", note: |stage, _| stage };
            Some(Budget { most, asset, reference, options, progress }.triangles_of_maps(first)?)
        }
        _ => None,
    };
    Ok(match found {
        None => (options.clone(), planned(options, asset.scene)),
        Some((triangles, why)) => {
            let of = asset.scene.triangle_count();
            let why = format!("the fit may have {triangles} of {of}: {why}");
            let options = SimplifyOptions { target: Target::Triangles(triangles), ..options.clone() };
            (options, Some(Item { what: ROW, runs: Runs::Yes, why }))
        }
    })
}

impl Budget<'_> {
    /// The triangles of the start that looks best within the bytes, and why those; `first` are tried first.
    fn triangles_of_maps(&self, first: usize) -> Result<(usize, String), FitError> {
        let Self { most, asset, options, progress, .. } = *self;
        let all = asset.scene.triangle_count();
        let parts = if options.appearance == Appearance::Maps { &PARTS } else { &[1.0][..] };
        let seen = importance(asset.n, asset.visibility);
        let tried = RefCell::new(vec![self.started(first, &seen)?]);
        let made = |triangles| {
            let start = self.started(triangles, &seen)?;
            let size = start.size;
            tried.borrow_mut().push(start);
            Ok((tried.borrow().len() - 1, size))
        };
        let mut found: Vec<usize> = Vec::new();
        for part in parts {
            let room = part * most as f64;
            // Of those that were made the one that comes nearest, and the next.
            let sizes: Vec<[f64; 2]> = tried.borrow().iter().map(|s| s.size).collect();
            let off = |k: &usize| (sizes[*k][1] / room).ln().abs();
            let mut order: Vec<usize> = (0..sizes.len()).collect();
            order.sort_by(|a, b| off(a).total_cmp(&off(b)));
            let (near, fits) = (order[0], |k: usize| sizes[k][1] <= room);
            let other = order.iter().map(|k| sizes[*k]).find(|size| size[0] != sizes[near][0]);
            let uses = sizes[near][1] >= (1.0 - UNUSED_BY_STARTS) * room || sizes[near][0] >= all as f64;
            let best = if fits(near) && uses {
                Some(near)
            } else {
                let known = [other.unwrap_or_default(), sizes[near]];
                let next = nearest(known, (room, UNUSED_BY_STARTS), all, &made, &|| progress.is_cancelled())?;
                next.or_else(|| order.iter().copied().find(|k| fits(*k)))
            };
            let triangles = |k: usize| tried.borrow()[k].size[0];
            found.extend(best.filter(|b| found.iter().all(|f| triangles(*f) != triangles(*b))));
        }
        let tried = tried.into_inner();
        let told = |k: usize, why: &str| {
            let Started { triangles, size, .. } = tried[k];
            let percent = 100.0 * size[1] / most as f64;
            Ok((
                triangles,
                format!("the geometry of a start on as many takes {percent:.0}% of the bytes{why}"),
            ))
        };
        match found[..] {
            [] => {
                return Ok((MIN_TRIANGLES.min(all), "no start that was tried has geometry that fits".into()));
            }
            [only] => return told(only, ""),
            // Who stopped the work does not wait for a choice.
            [first, ..] if progress.is_cancelled() => return told(first, ""),
            _ => {}
        }
        let mut made: Vec<Made> = Vec::new();
        for k in &found {
            made.extend(self.within(&Shapes::new(tried[*k].light.clone()))?);
        }
        let fitting = made.iter().filter(|m| m.bytes() <= most).count();
        let best = found[self.best(&made)?];
        match fitting {
            0 => told(best, &format!(", the smallest file of {} that do not fit", made.len())),
            1 => told(best, &format!(", the only one of {} that fits with textures", made.len())),
            n => told(best, &format!(", the best of {n} that were made to fit")),
        }
    }

    /// A start of at most so many triangles; those of the asset count as they are `seen`.
    fn started(&self, triangles: usize, seen: &[f32]) -> Result<Started, FitError> {
        let Self { asset, options, progress, .. } = *self;
        let Asset { n, rays, visibility, .. } = asset;
        let weights = (visibility, Weights { decimated: seen, drawn: &[] });
        // A single one is measured.
        let target = Target::Triangles(triangles);
        let options = SimplifyOptions { effort: Effort::Fast, target, ..options.clone() };
        let start = prepare(n, rays, weights, None, &options, progress)?;
        let light = options.exported(&start[0].candidate, n);
        let dressed = dressed(light.clone(), asset, &options);
        let bytes = bytes_without_textures(&dressed, coarsest(options.compression))?;
        Ok(Started { triangles, size: [light.triangle_count() as f64, bytes as f64], light })
    }
}
