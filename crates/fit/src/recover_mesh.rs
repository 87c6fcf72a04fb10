//! Recovering a shape from pictures: pictures with cameras and alpha, and a mesh that looks like them.
//! Assembled from the parts of the engine, as [`crate::recover`], which keeps the shape.
//!
//! load the pictures -> the sphere that their outlines tell -> a coarse ball inside of it with an atlas and grey maps ->
//! fit positions and maps by rendering -> split each triangle into four, fit again, until the budget is reached -> export
//! -> reload the file and compare it with the pictures that were held out. Texture coordinates are split with the
//! triangles, so that one atlas serves all levels and the maps go on.

mod shape_error;
mod start;

pub use shape_error::ShapeError;

use crate::engine::LightAsset;
use crate::engine::chain::FitChain;
use crate::engine::checkpoint::Digest;
use crate::engine::device::{Device, train_on};
use crate::engine::export::to_scene;
use crate::engine::fingerprint::Fingerprint;
use crate::engine::judge::{Quality, ReportView, Stage};
use crate::engine::loss::PictureLoss;
use crate::engine::plan::{PlanRows, rows};
use crate::engine::surface::{MAPS, POSITIONS, PositionOptimizer, Surface};
use crate::engine::trainer::{Batch, Checkpointing, HeldOut, HistoryPoint, Job, Phase, Trained};
use crate::engine::views::Sampling;
use crate::error::in_ranges;
use crate::pictures::PictureFolder;
use crate::recover::{grey, items, left_out};
use crate::{FitError, Progress};
use photofit_geometry::subdivide::midpoint;
use photofit_geometry::weld::weld_rows;
use photofit_raster::loss::Loss;
use photofit_scalar::Vec3f;
use photofit_scene::Scene;
use start::{Pictures, Start};
use std::path::Path;

/// Peak rate of the maps.
const MAP_RATE: f64 = 0.02;
/// Peak rate of a level relative to that of the level before.
const RATE_OF_NEXT: f64 = 0.5;
/// Most times that triangles are split on the way to the budget.
pub const MOST_LEVELS: u32 = 3;
/// Fewest triangles to start from.
const MIN_TRIANGLES: usize = 80;
/// Options of [`recover_mesh`].
#[derive(Clone, Debug)]
pub struct RecoverMeshOptions {
    /// How positions move.
    pub optimizer: PositionOptimizer,
    /// Most triangles of the result, at least 80; a start with more keeps its own.
    pub triangles: usize,
    /// Width and height of the maps, 16 to 8192.
    pub texture_size: usize,
    /// Steps of the fit, over all levels.
    pub steps: u64,
    /// Pictures per step, 1 to 64.
    pub batch: usize,
    /// Seed of all random choices.
    pub seed: u64,
    /// Where the fit runs.
    pub device: Device,
    /// Checkpoints and limits.
    pub checkpointing: Checkpointing,
}

impl Default for RecoverMeshOptions {
    fn default() -> Self {
        Self {
            optimizer: PositionOptimizer::default(),
            triangles: 5120,
            texture_size: 512,
            steps: 600,
            batch: 2,
            seed: 0,
            device: Device::default(),
            checkpointing: Checkpointing::default(),
        }
    }
}

/// Where the pictures come from.
#[derive(Clone, Copy, Debug)]
pub enum PictureSource<'a> {
    /// A folder with `transforms.json`, or such a file; every picture must have alpha.
    Folder(&'a Path),
    /// Drawn from an asset by the rasterizer from all around, each under lights of its own that are known.
    Asset {
        /// The asset.
        asset: &'a Scene,
        /// Number of pictures, 8 to 256.
        views: usize,
        /// Width and height of a picture, 16 to 2048 pixels.
        size: usize,
    },
}

/// What was recovered.
#[derive(Debug)]
pub struct RecoveredMesh {
    /// Mean quality of the written file in the pictures that were held out.
    pub quality: Quality,
    /// The same of the start.
    pub start: Quality,
    /// Each held-out picture, with the start and the written file against it.
    pub views: Vec<ReportView>,
    /// The course of the fit, over all levels.
    pub history: Vec<HistoryPoint>,
    /// Distance to the asset that the pictures were drawn from, of the start and of the written file.
    pub shape_error: Option<[ShapeError; 2]>,
    /// Steps made.
    pub steps: u64,
    /// Wall time of a step, evaluations included.
    pub seconds_per_iteration: f64,
    /// Ended by the user or the time limit.
    pub stopped: bool,
    /// Triangles of the start and of the written file.
    pub triangles: [usize; 2],
    /// Pictures, and how many of them were held out.
    pub pictures: [usize; 2],
    /// Whether the light of the pictures was known.
    pub lit: bool,
    /// What the mesh to begin with holds besides its surface and the written file does not, one line each.
    pub left_out: Vec<String>,
    /// Where the fit ran, its last level.
    pub device: String,
    /// What ran and what was skipped.
    pub plan: PlanRows,
}

/// Fits a mesh and its maps to pictures and writes the result to `output` (.glb). It starts from `mesh`, in the world of
/// the cameras, or from a ball.
///
/// # Errors
/// See [`FitError`] and [`PictureFolder::load`]; [`FitError::Pictures`] for pictures without alpha, with empty outlines, or
/// from one direction only. Nothing is written then.
pub fn recover_mesh(
    pictures: PictureSource<'_>,
    mesh: Option<&Scene>,
    output: &Path,
    options: &RecoverMeshOptions,
    progress: &dyn Progress,
) -> Result<RecoveredMesh, FitError> {
    options.check()?;
    let Pictures { photos, light_asset, truth } = Pictures::new(pictures, options.seed, progress)?;
    let start = Start::new(&light_asset, mesh, options.triangles, photos.lit)?;
    let model = grey(&light_asset, (&start.mesh, &start.class), photos.lit, options.texture_size, progress)?;
    let mut model = model.moving(true);
    let first = model.candidate.mesh();
    let first_scene = to_scene(&model.candidate, &light_asset);

    let held_out = photos.evaluation(options.seed)?;
    let fit = Fit { photos: &photos, held_out: &held_out, options };
    let mut phases = Vec::new();
    let mut chain = FitChain::new(&options.checkpointing, progress);
    let (mut steps, mut stopped, mut device) = (0, false, options.device.clone());
    for level in 0..start.levels {
        if level > 0 {
            model = finer(model, &light_asset)?;
        }
        model.optimizer = options.optimizer;
        model.smoothness = PositionOptimizer::for_vertices(model.candidate.positions.len());
        let (trained, ran, rows) = chain.fit(1, progress, |checkpointing| {
            fit.level(model.clone(), (level, start.levels), checkpointing, progress)
        })?;
        device = ran;
        chain.add(&trained.history, fit.steps(level, start.levels));
        phases.extend(rows.ended(trained.reached()).phases);
        steps += trained.steps;
        model = trained.model;
        stopped = trained.stopped;
        if stopped {
            break;
        }
    }

    let row = rows::own_loss(LOSS.into(), steps > 0);
    let plan = PlanRows { items: items(&model.work(steps), &photos, row, held_out.measure), phases };

    let mut found = to_scene(&model.candidate, &light_asset);
    if let Some(mesh) = mesh {
        found.inherit(mesh);
    }
    photofit_scene::save_glb(output, &found)?;
    let fitted = photofit_scene::load(output)?;
    let triangles = [first.triangles.len(), fitted.triangle_count()];
    let shape_error = match &truth {
        Some(truth) => {
            let of = |mesh| ShapeError::between(truth, mesh, progress);
            Some([of(&first)?, of(&model.candidate.mesh())?])
        }
        None => None,
    };
    let left_out = mesh.map_or_else(Vec::new, |mesh| left_out(mesh, &fitted));
    let stages = [Stage::new("start", first_scene), Stage::new("recovered", fitted)];
    let views = photos.judge(&light_asset, &stages, progress)?;
    let [start, quality] = Quality::of_two_stages(&views);
    let history = chain.into_history();
    let seconds = history.last().map_or(0.0, |h| h.seconds);
    Ok(RecoveredMesh {
        quality,
        start,
        views,
        history,
        shape_error,
        steps,
        seconds_per_iteration: seconds / steps.max(1) as f64,
        stopped: stopped || progress.is_cancelled(),
        triangles,
        pictures: [photos.given.pictures().len(), photos.given.held_out()],
        lit: photos.lit,
        left_out,
        device: device.name(),
        plan: plan.with_device(device.told()),
    })
}

/// The loss: of absolute differences, so that outlines count that are far off. Light above 1 counts logarithmically, so
/// that it goes with either measure of the evaluations.
const LOSS: Loss = Loss::LogSrgbL1;

/// What all levels share.
struct Fit<'a> {
    photos: &'a PictureFolder,
    held_out: &'a HeldOut,
    options: &'a RecoverMeshOptions,
}

impl Fit<'_> {
    /// Steps of a level of so many.
    fn steps(&self, level: u32, levels: u32) -> u64 {
        let share = self.options.steps / u64::from(levels);
        if level + 1 == levels { self.options.steps - share * u64::from(level) } else { share }
    }

    /// Fits one level of so many.
    fn level(
        &self,
        model: Surface,
        (level, levels): (u32, u32),
        checkpointing: &Checkpointing,
        progress: &dyn Progress,
    ) -> Result<(Trained<Surface>, Device, PlanRows), FitError> {
        let Self { photos, held_out, options } = self;
        let steps = self.steps(level, levels);
        let mut topology = Digest::new();
        topology.add(model.candidate.triangles.as_flattened());
        topology.add(&model.candidate.uvs);
        let job = Job {
            reference: &photos.given,
            views: &photos.given,
            held_out,
            sampling: Sampling::SUPERSAMPLED,
            loss: PictureLoss::from(LOSS),
            seed: options.seed,
            batch: Batch::half_new(options.batch),
            steps,
            rival: None,
            checkpointing,
            fingerprint: Fingerprint::default()
                .option("optimizer", options.optimizer.name())
                .option("triangles", options.triangles)
                .option("texture_size", options.texture_size)
                .option("batch", options.batch)
                .option("seed", options.seed)
                .digest("pictures, cameras or lights", photos.digest())
                .digest("topology", topology),
        };
        let rate = options.optimizer.peak_rate() * RATE_OF_NEXT.powi(level as i32);
        let phases = |_| {
            vec![Phase {
                name: if level + 1 == levels { "full budget" } else { "coarse" },
                first: 0,
                steps,
                shrink: 1,
                rates: vec![(POSITIONS.into(), rate), (MAPS.into(), MAP_RATE)],
                fade: None,
                reinitialised: None,
            }]
        };
        let rows = PlanRows::new(Vec::new(), &phases(0.0));
        let (trained, device) = train_on(&options.device, model, &job, phases, progress)?;
        Ok((trained, device, rows))
    }
}

/// The same shape and maps with four triangles for each.
fn finer(coarse: Surface, light: &LightAsset) -> Result<Surface, FitError> {
    let Surface { candidate, .. } = &coarse;
    let mesh = midpoint(&candidate.mesh(), u64::MAX)
        .map_err(|e| FitError::Setting { field: "triangles", rule: e.to_string() })?
        .mesh;
    let class = candidate.class.iter().flat_map(|c| [*c; 4]).collect();
    let maps = candidate.maps.levels[0].clone();
    // Vertices at one place with one normal are smooth there: what was a hard edge stays one.
    let row = |(p, n): (&Vec3f, &Vec3f)| [p.x, p.y, p.z, n.x, n.y, n.z];
    let rows: Vec<f32> = mesh.positions.iter().zip(&mesh.normals).flat_map(row).collect();
    let smoothing = weld_rows(&rows, 6);
    let candidate = crate::candidate::Candidate::new(&mesh, &smoothing, class, light.drawn_classes(), maps);
    Ok(Surface { candidate, ..coarse })
}

impl RecoverMeshOptions {
    fn check(&self) -> Result<(), FitError> {
        let rules = [
            ("texture_size", self.texture_size, 16..=8192),
            ("batch", self.batch, 1..=64),
            ("triangles", self.triangles, MIN_TRIANGLES..=MOST_TRIANGLES),
        ];
        in_ranges(rules)
    }
}

/// Most triangles that can be asked for.
pub const MOST_TRIANGLES: usize = 1 << 22;

#[cfg(test)]
mod tests;
