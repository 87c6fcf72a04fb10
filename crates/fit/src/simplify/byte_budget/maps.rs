//! The triangles of a fit with maps of its own within a budget of bytes.
//!
//! Its geometry is another than that of the asset, with an atlas that splits vertices, so that starts of it are made and measured as they
//! would be written. How much of the file it should take depends on the asset: starts with several parts of it meet, each made to fit.

use super::triangles::{GEOMETRY, OTHER_PARTS, nearest};
use super::{Budget, Made, Shapes, bytes_without_textures, coarsest};
use crate::engine::plan::{Item, Runs};
use crate::engine::reference::Reference;
use crate::simplify::prepare::{Weights, importance, prepare};
use crate::simplify::{Appearance, Asset, Effort, MIN_TRIANGLES, SimplifyOptions, dressed};
use crate::{FitError, Progress};
use photofit_geometry::decimate::Target;
use photofit_scene::Scene;

/// Part of its bytes that geometry may leave unused: starts take long, and which part is best is no sharp choice.
const UNUSED: f64 = 0.15;

/// A start, as it would be written with all of its texels.
#[derive(Clone)]
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
    let (runs, why) = match options.appearance {
        _ if !options.triangles_by_bytes => return None,
        _ if options.target == Target::Triangles(scene.triangle_count()) && options.lacks_nothing(scene) => {
            (Runs::No, "all fit")
        }
        Appearance::Maps => (Runs::Open, "in starts whose geometry takes several parts of the bytes"),
        Appearance::VertexColors => (Runs::Open, "by what starts take of the bytes"),
        Appearance::Kept => (Runs::Yes, "decimations that take several parts of the bytes are compared"),
    };
    Some(Item { what: ROW, runs, why: why.into() })
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
            Some(Budget { most, asset, reference, options, progress }.triangles_of_maps(first)?)
        }
        _ => None,
    };
    Ok(match found {
        None => (options.clone(), planned(options, asset.scene)),
        Some((triangles, why)) => {
            let of = asset.scene.triangle_count();
            let why = format!("{triangles} of {of} are asked for: {why}");
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
        let percent = |s: &Started| format!("{:.0}% of the bytes", 100.0 * s.size[1] / most as f64);
        let parts = if options.appearance == Appearance::Maps { &PARTS } else { &[1.0][..] };
        let mut known = vec![self.started(first)?];
        let mut found: Vec<Started> = Vec::new();
        for part in parts {
            let room = part * most as f64;
            // Of those that were made the one that comes nearest.
            let off = |s: &Started| (s.size[1] / room).ln().abs();
            known.sort_by(|a, b| off(a).total_cmp(&off(b)));
            let near = known[0].clone();
            let other = known.iter().map(|s| s.size).find(|size| size[0] != near.size[0]);
            let fits =
                near.size[1] <= room && (near.size[1] >= (1.0 - UNUSED) * room || near.triangles == all);
            let best = match fits {
                true => Some(near),
                false => {
                    let made = |triangles| self.started(triangles).map(|s| (s.clone(), s.size));
                    let sizes = [other.unwrap_or_default(), near.size];
                    nearest(sizes, (room, UNUSED), all, &made, &|| progress.is_cancelled())?
                }
            };
            known.extend(best.clone());
            found.extend(best.filter(|b| found.iter().all(|f| f.triangles != b.triangles)));
        }
        if found.len() < 2 || progress.is_cancelled() {
            return Ok(match found.first() {
                Some(only) => {
                    (only.triangles, format!("the geometry of their start takes {}", percent(only)))
                }
                None => (MIN_TRIANGLES.min(all), "no start of more has a geometry that fits".into()),
            });
        }
        let mut made: Vec<Made> = Vec::new();
        for start in &found {
            made.extend(self.within(&Shapes::new(start.light.clone()))?);
        }
        let (best, of) = (&found[self.best(&made)?], found.len());
        let share = percent(best);
        Ok((
            best.triangles,
            format!("their start, whose geometry takes {share}, looks best of {of}, each made to fit"),
        ))
    }

    /// A start of at most so many triangles.
    fn started(&self, triangles: usize) -> Result<Started, FitError> {
        let Self { asset, options, progress, .. } = *self;
        let Asset { n, rays, visibility, .. } = asset;
        let seen = importance(n, visibility);
        let weights = (visibility, Weights { decimated: &seen, drawn: &[] });
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

/// Parts of the file that geometry is tried with: first the convention.
const PARTS: [f64; 4] = [GEOMETRY, OTHER_PARTS[0], OTHER_PARTS[1], OTHER_PARTS[2]];
