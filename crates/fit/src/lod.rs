//! A chain of levels of detail, each fitted for its size on screen.
//!
//! The asset is prepared once. The shape of each level starts from the fitted one before it, its maps are baked from the
//! asset, and it is fitted and judged as an engine shows it at its size. What a viewer notices when one level replaces the
//! next is measured where it happens: FLIP between the two at the size of the switch.

mod blend;

pub use blend::{Blend, SurfaceDistance, weighted};

use crate::engine::chain::{FitChain, MOST_PARTS, part_folder};
use crate::engine::judge::{Popping, Quality, Stage, popping};
use crate::simplify::outcome::beside;
use crate::simplify::{Asset, Init, Outcome, SimplifyOptions, locks, simplify_asset, with_asset};
use crate::{FitError, Progress};
use photofit_geometry::decimate::Target;
use photofit_scene::{Limits, Scene};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Smallest size on screen of a level, pixels.
pub const SMALLEST: f64 = 16.0;
/// Largest size on screen of a level, pixels.
pub const LARGEST: f64 = 1024.0;
/// Most levels of a chain.
pub const MOST_LEVELS: usize = MOST_PARTS;
/// A level without a budget has the triangles that look right at so many times its size: with those of its size alone, a
/// fitted level of 64 pixels looks worse than the original does with one sample a pixel (docs/crates/fit.md).
const FINER: f64 = 2.0;
/// Pixels of the screen that the coverages of `MSFT_screencoverage` are shares of.
const SCREEN: f64 = 1920.0 * 1080.0;

/// Options of [`simplify_chain`].
#[derive(Clone, Debug, Default)]
pub struct LodOptions {
    /// Size on screen of each level, pixels of its bounding sphere's diameter, falling, 16 to 1024.
    pub sizes: Vec<f64>,
    /// Budget of each level, falling; empty: as few triangles as look right at the sizes.
    pub triangles: Vec<usize>,
    /// Also writes one file with all levels ([`combined_path`]).
    pub combined: bool,
    /// Each level but the last gets a morph target that turns it into the next one ([`Blend`]); their bytes are known only when
    /// the next level is fitted, so that this does not go with [`SimplifyOptions::max_bytes`].
    pub continuous: bool,
    /// Options of every level. Its budget, size and, where [`Self::texture_size`] gives none, textures are those of the
    /// level; steps are those of the first level, the others, whose shape is fitted already, make half as many; the time
    /// limit is for all fits together: each may take an equal share of what is left.
    pub fit: SimplifyOptions,
    /// Width and height of the textures of all levels; else they follow from the sizes.
    pub texture_size: Option<usize>,
}

/// A finished level.
#[derive(Debug)]
pub struct Level {
    /// The file.
    pub path: PathBuf,
    /// Its bytes.
    pub bytes: u64,
    /// Size on screen that it is for, pixels.
    pub size: f64,
    /// Size below which the next level replaces it; `None` for the last that was asked for.
    pub switch_size: Option<f64>,
    /// Change to the next level at the size of the switch; `None` where there is no next level.
    pub popping: Option<Popping>,
    /// How it becomes the next level, where that is asked for.
    pub blend: Option<Blend>,
    /// Figures and pictures.
    pub outcome: Outcome,
}

impl Level {
    /// Quality of the written file at its size.
    pub fn quality(&self) -> Quality {
        self.outcome.shipped().copied().unwrap_or_default()
    }
}

/// A finished chain.
#[derive(Debug)]
pub struct LodChain {
    /// The levels that were written, finest first.
    pub levels: Vec<Level>,
    /// Fewer levels than were asked for: the user stopped the chain.
    pub stopped: bool,
    /// The file with all levels, where one was asked for and no level has more bytes than are asked for.
    pub combined: Option<PathBuf>,
    /// Why a level could not be made, or what follows from all; the levels before it are written.
    pub failed: Option<FitError>,
}

impl LodOptions {
    /// Checks the sizes and budgets against an asset of `triangles` triangles; `usize::MAX` where there is none yet.
    ///
    /// # Errors
    /// [`FitError::Setting`] names the field, what it is and what it must be.
    pub fn check(&self, triangles: usize) -> Result<(), FitError> {
        let (sizes, budgets) = (&self.sizes, &self.triangles);
        let fail = |field, is: String, rule: String| {
            Err(FitError::Setting { field, rule: format!("is [{is}]; {rule}") })
        };
        let of_sizes = |rule: String| fail("sizes", listed(sizes), rule);
        let of_budgets = |rule: String| fail("triangles", listed(budgets), rule);
        if !(1..=MOST_LEVELS).contains(&sizes.len()) {
            return of_sizes(format!("there must be 1 to {MOST_LEVELS} levels"));
        }
        if !sizes.iter().all(|s| (SMALLEST..=LARGEST).contains(s)) {
            return of_sizes(format!("sizes must be {SMALLEST} to {LARGEST} pixels"));
        }
        if sizes.windows(2).any(|w| w[0] <= w[1]) {
            return of_sizes("sizes must fall".into());
        }
        if !budgets.is_empty() && budgets.len() != sizes.len() {
            return of_budgets(format!("there must be one for each of {} levels", sizes.len()));
        }
        if budgets.windows(2).any(|w| w[0] <= w[1]) {
            return of_budgets("budgets must fall".into());
        }
        if self.continuous {
            self.check_continuous()?;
        }
        (0..sizes.len()).try_for_each(|k| self.level(k).check(triangles).map_err(of_chain))
    }

    fn check_continuous(&self) -> Result<(), FitError> {
        let fail = |rule: &str| Err(FitError::Setting { field: "continuous", rule: rule.into() });
        if self.sizes.len() < 2 {
            return fail("blends each level into the next; it needs two levels at least");
        }
        if self.fit.max_bytes.is_some() {
            return fail("adds to levels that are written already; it does not go with most bytes of a file");
        }
        Ok(())
    }

    /// The options of a level, of which the first is 0.
    ///
    /// # Panics
    /// If there is no such level.
    pub fn level(&self, k: usize) -> SimplifyOptions {
        let target = match self.triangles.get(k) {
            Some(n) => Target::Triangles(*n),
            None => Target::ScreenSize(FINER * self.sizes[k]),
        };
        // Later levels start from the one before, decimated.
        let (init, steps) = match k {
            0 => (self.fit.init, self.fit.steps),
            _ => (Init::Decimate, self.fit.steps.div_ceil(2)),
        };
        let fit = SimplifyOptions { target, init, steps, ..self.fit.clone() };
        let fit = SimplifyOptions { checkpoint: self.checkpoint(k), ..fit.for_screen_size(self.sizes[k]) };
        // A level is shown down to the size at which the next one replaces it.
        let smallest_size = self.switch_size(k).unwrap_or(SMALLEST).max(SMALLEST) as usize;
        let texture_size = self.texture_size.unwrap_or(fit.texture_size);
        SimplifyOptions { texture_size, smallest_size, ..fit }
    }

    /// Folder of the checkpoint of a level.
    fn checkpoint(&self, k: usize) -> Option<PathBuf> {
        self.fit.checkpoint.as_ref().map(|folder| part_folder(folder, k))
    }

    /// Size below which the level after `k` replaces it: the geometric mean of both.
    fn switch_size(&self, k: usize) -> Option<f64> {
        self.sizes.get(k + 1).map(|next| (self.sizes[k] * next).sqrt())
    }
}

fn listed<T: ToString>(values: &[T]) -> String {
    values.iter().map(T::to_string).collect::<Vec<_>>().join(", ")
}

/// An error of one level with the names of fields that a chain has.
fn of_chain(error: FitError) -> FitError {
    let named = |field: &str| match field {
        // What pictures are made at is the size of the level.
        "resolution" => Some("sizes"),
        _ => None,
    };
    match error {
        FitError::Setting { field, rule } => FitError::Setting { field: named(field).unwrap_or(field), rule },
        FitError::OtherFit { path, mut differences } => {
            // A level's budget follows from its size.
            differences.retain(|d| d.field != "screen_size");
            for d in &mut differences {
                d.field = named(&d.field).map_or_else(|| d.field.clone(), str::to_owned);
            }
            FitError::OtherFit { path, differences }
        }
        error => error,
    }
}

/// The file of a level: `out.glb`, `out.lod1.glb`, `out.lod2.glb`.
pub fn level_path(output: &Path, level: usize) -> PathBuf {
    if level == 0 { output.to_owned() } else { beside(output, &format!("lod{level}.glb")) }
}

/// The file of the figures: `out.lods.json`.
pub fn summary_path(output: &Path) -> PathBuf {
    beside(output, "lods.json")
}

/// The file with all levels: `out.lods.glb`.
pub fn combined_path(output: &Path) -> PathBuf {
    beside(output, "lods.glb")
}

/// The folder of a level's report within that of the chain: the folder itself for the first, then `lod1`, `lod2`.
pub fn report_folder(folder: &Path, level: usize) -> PathBuf {
    if level == 0 { folder.to_owned() } else { folder.join(format!("lod{level}")) }
}

/// Progress of one level of a chain.
struct OfLevel<'a> {
    progress: &'a dyn Progress,
    name: String,
}

impl Progress for OfLevel<'_> {
    fn report(&self, stage: &'static str, done: u64, total: u64, note: &str) {
        let comma = if note.is_empty() { "" } else { ", " };
        self.progress.report(stage, done, total, &format!("{}{comma}{note}", self.name));
    }
    fn warn(&self, text: &str) {
        self.progress.warn(&format!("{}: {text}", self.name));
    }
    fn note(&self, text: &str) {
        self.progress.note(&format!("{}: {text}", self.name));
    }
    fn is_cancelled(&self) -> bool {
        self.progress.is_cancelled()
    }
}

/// Simplifies `scene` to a chain of levels; the first is written to `output` (.glb), the others beside it
/// ([`level_path`]).
///
/// When the user stops the work, the fit at work is exported and reported like a finished one, and later levels are not
/// begun. A chain that goes on from its checkpoints makes the levels before again, without the steps that they hold. Once the
/// first level is written, the summary of an older chain ([`summary_path`]) is removed. A level of more bytes than are asked for stands
/// in [`crate::simplify::too_large_path`] of its file, and there is no file with all levels then: older files stay as they were.
///
/// # Errors
/// See [`FitError`], where not even the first level could be made; else [`LodChain::failed`].
pub fn simplify_chain(
    scene: &Scene,
    output: &Path,
    options: &LodOptions,
    progress: &dyn Progress,
) -> Result<LodChain, FitError> {
    options.check(scene.triangle_count())?;
    locks::check(scene, &options.fit, progress)?;
    let began = Instant::now();
    with_asset(scene, progress, |asset| {
        let checkpointing = options.fit.checkpointing();
        let mut chain = FitChain::new(&checkpointing, progress);
        let (mut levels, mut failed) = (Vec::<Level>::new(), None);
        for k in 0..options.sizes.len() {
            if k > 0 && progress.is_cancelled() {
                break;
            }
            let began = if k == 0 { began } else { Instant::now() };
            let level = match level(asset, output, options, &levels, &mut chain, began, progress) {
                Err(FitError::Interrupted) if k > 0 => break,
                Err(e) if k > 0 => {
                    failed = Some(e);
                    break;
                }
                level => level?,
            };
            let traced = level.outcome.traced_maps.as_ref().and_then(|m| m.history.last());
            chain.spend(traced.map_or(0.0, |h| h.seconds));
            chain.add(&level.outcome.history, options.level(k).steps);
            if k == 0 {
                forget_summary(output)?;
            }
            levels.push(level);
        }
        let combined =
            if failed.is_none() { finish(asset, output, options, &mut levels, progress) } else { Ok(None) };
        // A signal may have come while levels got their morph targets.
        let stopped = levels.len() < options.sizes.len()
            || levels.iter().any(|l| l.outcome.stopped)
            || options.continuous && progress.is_cancelled();
        let (combined, failed) = combined.map_or_else(|e| (None, Some(e)), |c| (c, failed));
        Ok(LodChain { levels, stopped, combined, failed })
    })
}

/// Removes the figures of an older chain: they must not describe the files of this one, whose first level is written.
fn forget_summary(output: &Path) -> Result<(), FitError> {
    let path = summary_path(output);
    match std::fs::remove_file(&path) {
        Err(source) if source.kind() != std::io::ErrorKind::NotFound => Err(FitError::Io { path, source }),
        _ => Ok(()),
    }
}

/// Fits the level after those that are finished.
fn level(
    asset: Asset<'_>,
    output: &Path,
    options: &LodOptions,
    before: &[Level],
    chain: &mut FitChain<'_>,
    began: Instant,
    progress: &dyn Progress,
) -> Result<Level, FitError> {
    let (k, count) = (before.len(), options.sizes.len());
    let progress = &OfLevel { progress, name: format!("level {} of {count}", k + 1) };
    let mut fit = options.level(k);
    let from = before.last().map(|l| &l.outcome.candidate);
    if let (Target::Triangles(n), Some(from)) = (&mut fit.target, from) {
        *n = (*n).min(from.triangles.len());
    }
    fit.sane_target(asset.scene.triangle_count()).1.iter().for_each(|t| progress.warn(t));
    let path = level_path(output, k);
    let outcome = chain.fit(count - k, progress, |checkpointing| {
        let fit = SimplifyOptions {
            checkpoint: checkpointing.checkpoint.clone(),
            resume: checkpointing.resume,
            time_limit: checkpointing.time_limit,
            ..fit.clone()
        };
        simplify_asset(asset, from, &path, &fit, began, progress).map_err(of_chain)
    })?;
    let path = outcome.file.clone();
    let bytes = bytes(&path)?;
    let (size, switch_size) = (options.sizes[k], options.switch_size(k));
    Ok(Level { path, bytes, size, switch_size, popping: None, blend: None, outcome })
}

/// Compares neighbouring levels, gives them morph targets where that is asked for, and writes the file with all of them, unless one
/// is too large; its path.
fn finish(
    asset: Asset<'_>,
    output: &Path,
    options: &LodOptions,
    levels: &mut [Level],
    progress: &dyn Progress,
) -> Result<Option<PathBuf>, FitError> {
    // The file with all levels holds their textures as they are: a second lossy encoding would change them.
    let limits = Limits { keep_encoded: true, ..Limits::default() };
    let mut scenes: Vec<Scene> =
        levels.iter().map(|l| photofit_scene::load_with(&l.path, &limits)).collect::<Result<_, _>>()?;
    let light = &asset.n.light_asset;
    for k in 1..levels.len() {
        let size = levels[k - 1].switch_size.unwrap_or(SMALLEST);
        let popping = |fine: &Scene| {
            let stages = [fine, &scenes[k]].map(|s| Stage::new("level", s.clone()));
            let pixels = size.round() as usize;
            popping(light, [&stages[0], &stages[1]], &options.fit.lighting, pixels, options.fit.seed)
        };
        let before = popping(&scenes[k - 1])?;
        levels[k - 1].popping = Some(before);
        // Whoever asked to stop gets the levels as they are.
        if options.continuous && !progress.is_cancelled() {
            progress.report("morph targets", k as u64, levels.len() as u64 - 1, "");
            let (fine, coarse) = (&scenes[k - 1], &scenes[k]);
            let tolerance = blend::TOLERANCE * 2.0 * f64::from(light.frame.radius) / size;
            let level = &mut levels[k - 1];
            let sizes = [level.size, size];
            let (moving, blend) =
                blend::blend((fine, coarse), &format!("lod{k}"), sizes, tolerance as f32, &popping)?;
            if blend.popping.outline > before.outline {
                progress.warn(&format!(
                    "level {k} has no morph target: with it the outline would jump more at the switch ({:.4}, {:.4} without)",
                    blend.popping.outline, before.outline
                ));
                continue;
            }
            photofit_scene::save_glb_with(&level.path, &moving, level.outcome.compression)?;
            (level.blend, level.bytes) = (Some(blend), bytes(&level.path)?);
            scenes[k - 1] = moving;
        }
    }
    let fit = levels.iter().enumerate().all(|(k, level)| level.path == level_path(output, k));
    let combined = (options.combined && fit).then(|| combined_path(output));
    if let Some(path) = &combined {
        let last = levels.len() - 1;
        let coverage = |k: usize| match levels[k].switch_size {
            Some(s) if k < last => (std::f64::consts::FRAC_PI_4 * s * s / SCREEN).min(1.0),
            _ => 0.0,
        };
        let coverage: Vec<f64> = (0..levels.len()).map(coverage).collect();
        // Levels within a budget of bytes may be rounded coarser than was asked for: the file of all has no use for more bits.
        let compression = levels.iter().map(|level| level.outcome.compression).max();
        photofit_scene::save_glb_lods(path, &scenes, &coverage, compression.unwrap_or_default())?;
    }
    Ok(combined)
}

fn bytes(path: &Path) -> Result<u64, FitError> {
    let read = std::fs::metadata(path).map_err(|source| FitError::Io { path: path.to_owned(), source });
    Ok(read?.len())
}

#[cfg(test)]
mod tests;
