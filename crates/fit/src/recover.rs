//! Recovering textures from pictures: an asset's shape, pictures of it with cameras, and maps that look like them.
//! Assembled from the parts of the engine.
//!
//! load the pictures -> normalise -> atlas -> grey maps -> fit them by rendering -> export -> reload the file and compare
//! it with the pictures that were held out. Where the light of the pictures is known, base colour and roughness are
//! fitted; else what the pictures show on average becomes an unlit colour.

use crate::engine::device::{Device, train_on};
use crate::engine::export::to_scene;
use crate::engine::fingerprint::Fingerprint;
use crate::engine::judge::{Quality, ReportView, Stage};
use crate::engine::loss::{self, PictureLoss};
use crate::engine::plan::rows::{self, Work};
use crate::engine::plan::{Item, PlanRows, SurfacePlan};
use crate::engine::reference::{Rasterized, Reference};
use crate::engine::surface::{MAPS, Surface};
use crate::engine::trainer::{Batch, Checkpointing, HistoryPoint, Job, Measure, Phase};
use crate::engine::unwrap::unwrapped;
use crate::engine::views::Sampling;
use crate::engine::{LightAsset, Normalised};
use crate::error::in_ranges;
use crate::pictures::PictureFolder;
use crate::{FitError, Progress};
use photofit_geometry::Mesh;
use photofit_raster::{CHANNELS, channel};
use photofit_scene::{Material, Scene};
use std::path::Path;

/// Peak rate of the maps.
const MAP_RATE: f64 = 0.02;
/// Base colour, or unlit colour, that the fit starts from.
const GREY: f32 = 0.5;
/// Roughness that the fit starts from.
const ROUGHNESS: f32 = 0.7;
/// Rate of roughness relative to that of colours.
const RATE_OF_ROUGHNESS: f32 = 0.5;

/// Options of [`recover_texture`].
#[derive(Clone, Debug)]
pub struct RecoverOptions {
    /// Width and height of the maps, 16 to 8192.
    pub texture_size: usize,
    /// Steps of the fit.
    pub steps: u64,
    /// Pictures per step, 1 to 64.
    pub batch: usize,
    /// How pictures are compared in the steps; `None`: by what they hold, see [`loss::choose`].
    pub loss: Option<PictureLoss>,
    /// Seed of all random choices.
    pub seed: u64,
    /// Where the fit runs.
    pub device: Device,
    /// Checkpoints and limits.
    pub checkpointing: Checkpointing,
}

impl Default for RecoverOptions {
    fn default() -> Self {
        Self {
            texture_size: 1024,
            steps: 400,
            batch: 2,
            loss: None,
            seed: 0,
            device: Device::default(),
            checkpointing: Checkpointing::default(),
        }
    }
}

/// What was recovered.
#[derive(Debug)]
pub struct Recovered {
    /// Mean quality of the written file in the pictures that were held out.
    pub quality: Quality,
    /// The same of the grey start.
    pub start: Quality,
    /// Each held-out picture, with the start and the written file against it.
    pub views: Vec<ReportView>,
    /// The course of the fit.
    pub history: Vec<HistoryPoint>,
    /// Steps made.
    pub steps: u64,
    /// Ended by the user or the time limit.
    pub stopped: bool,
    /// Triangles of the written file.
    pub triangles: usize,
    /// Pictures, and how many of them were held out.
    pub pictures: [usize; 2],
    /// Whether the light of the pictures was known.
    pub lit: bool,
    /// Pictures without alpha, whose outline is that of the mesh.
    pub without_alpha: usize,
    /// What `mesh` holds besides its surface and the written file does not, one line each.
    pub left_out: Vec<String>,
    /// Where the fit ran.
    pub device: String,
    /// What ran and what was skipped.
    pub plan: PlanRows,
}

/// Fits the maps of `mesh` to the pictures of a folder (or of a `transforms.json`) and writes the result to `output`
/// (.glb). The shape stays, with the sides that are seen, and with cameras, lights and what the file says about itself;
/// materials and textures of `mesh` are not read.
///
/// # Errors
/// See [`FitError`] and [`PictureFolder::load`]; nothing is written then.
pub fn recover_texture(
    pictures: &Path,
    mesh: &Scene,
    output: &Path,
    options: &RecoverOptions,
    progress: &dyn Progress,
) -> Result<Recovered, FitError> {
    options.check()?;
    mesh.validate_for_fit()?;
    let outline = Normalised::new(&bare(mesh, false))?;
    let photos = PictureFolder::load(pictures, outline.frame(), options.seed, &|s| {
        Ok(Rasterized::new(&outline.flat, &outline.library).picture(s)?.image)
    })?;
    if photos.without_alpha > 0 {
        progress.warn(&format!(
            "{} of {} pictures have no alpha: the outline of the mesh is taken for theirs",
            photos.without_alpha,
            photos.given.pictures().len()
        ));
    }
    if !photos.unseen.is_empty() {
        progress.warn(&format!(
            "the cameras of {} of {} frames do not see the asset: {:?}",
            photos.unseen.len(),
            photos.given.pictures().len(),
            photos.unseen
        ));
    }
    if !photos.reduced.is_empty() {
        progress.warn(&format!(
            "{} of {} pictures have more than 2048 pixels a side and are reduced: {:?}",
            photos.reduced.len(),
            photos.given.pictures().len(),
            photos.reduced
        ));
    }
    photos.doubts().iter().for_each(|d| progress.warn(d));
    let n = Normalised::new(&bare(mesh, !photos.lit))?;
    let model = grey(
        &n.light_asset,
        (&n.flat.mesh, &n.triangle_classes()),
        photos.lit,
        options.texture_size,
        progress,
    )?;
    let start = to_scene(&model.candidate, &n.light_asset);
    let held_out = photos.evaluation(options.seed)?;
    let mut topology = photos.digest();
    topology.add(&model.candidate.uvs);
    let loss = options.loss.unwrap_or_else(|| loss::choose(&held_out));
    let job = Job {
        reference: &photos.given,
        views: &photos.given,
        held_out: &held_out,
        sampling: Sampling::SUPERSAMPLED,
        loss,
        seed: options.seed,
        batch: Batch::half_new(options.batch),
        steps: options.steps,
        rival: None,
        checkpointing: &options.checkpointing,
        fingerprint: Fingerprint::default()
            .option("texture_size", options.texture_size)
            .option("batch", options.batch)
            .option("seed", options.seed)
            .digest("pictures, cameras, lights or shape", topology),
    };
    let phases = |_| {
        vec![Phase {
            name: "maps",
            first: 0,
            steps: options.steps,
            shrink: 1,
            rates: vec![(MAPS.into(), MAP_RATE)],
            fade: None,
            reinitialised: None,
        }]
    };
    let plan = PlanRows::new(Vec::new(), &phases(0.0));
    let (trained, device) = train_on(&options.device, model, &job, phases, progress)?;
    let row = match options.loss {
        Some(asked) => rows::asked_loss(asked, trained.steps > 0),
        None => rows::loss(loss, held_out.noise, trained.steps > 0),
    };
    let items = items(&trained.model.work(trained.steps), &photos, row, held_out.measure);
    let plan = PlanRows { items, ..plan }.ended(trained.reached()).with_device(device.told());

    let mut painted = to_scene(&trained.model.candidate, &n.light_asset);
    painted.inherit(mesh);
    photofit_scene::save_glb(output, &painted)?;
    let fitted = photofit_scene::load(output)?;
    let triangles = fitted.triangle_count();
    let left_out = left_out(mesh, &fitted);
    let stages = [Stage::new("start", start), Stage::new("recovered", fitted)];
    let views = photos.judge(&n.light_asset, &stages, progress)?;
    let [start, quality] = Quality::of_two_stages(&views);
    Ok(Recovered {
        quality,
        start,
        views,
        history: trained.history,
        steps: trained.steps,
        stopped: trained.stopped || progress.is_cancelled(),
        triangles,
        pictures: [photos.given.pictures().len(), photos.given.held_out()],
        lit: photos.lit,
        without_alpha: photos.without_alpha,
        left_out,
        device: device.name(),
        plan,
    })
}

/// The rows of the plan.
pub(crate) fn items(work: &Work, photos: &PictureFolder, loss: Item, measure: Measure) -> Vec<Item> {
    let all = photos.given.pictures().len();
    let alpha = all - photos.without_alpha;
    let mut items = vec![
        Item::of(
            "known light",
            photos.lit,
            "the pictures name it",
            "none is named: an unlit colour is fitted",
        ),
        Item::of(
            "outline of the mesh",
            alpha < all,
            format!("stands for that of {} pictures without alpha", all - alpha),
            "all pictures have alpha",
        ),
    ];
    items.extend(rows::surface(work));
    items.push(loss);
    items.push(rows::evaluation(
        measure,
        if measure == Measure::Psnr {
            "the pictures hold what a screen shows"
        } else {
            "the pictures hold light above 1"
        },
    ));
    items
}

impl RecoverOptions {
    fn check(&self) -> Result<(), FitError> {
        let rules = [("texture_size", self.texture_size, 16..=8192), ("batch", self.batch, 1..=64)];
        in_ranges(rules)
    }
}

/// The shape of a scene with opaque materials: one for the parts whose fronts alone are seen, one for those that are seen
/// from both sides.
pub(crate) fn bare(mesh: &Scene, unlit: bool) -> Scene {
    let mut scene = mesh.clone();
    let material =
        |name: &str, double_sided| Material { name: name.into(), unlit, double_sided, ..Material::clay() };
    scene.materials = vec![material("recovered", false), material("recovered-double-sided", true)];
    scene.images.clear();
    scene.hierarchy = None;
    for p in &mut scene.primitives {
        p.material = usize::from(mesh.materials.get(p.material).is_some_and(|m| m.double_sided));
        p.mesh.colors.clear();
    }
    scene
}

/// What an asset whose shape is painted holds and the written file does not, one line each; that its materials go is what was
/// asked for.
pub(crate) fn left_out(mesh: &Scene, written: &Scene) -> Vec<String> {
    let without_surfaces = Scene {
        cameras: mesh.cameras.clone(),
        lights: mesh.lights.clone(),
        about: mesh.about.clone(),
        hierarchy: mesh.hierarchy.clone(),
        ignored_extensions: mesh.ignored_extensions.clone(),
        ignored_extras: mesh.ignored_extras,
        ignored_attributes: mesh.ignored_attributes.clone(),
        ..Scene::default()
    };
    without_surfaces.left_out(written)
}

/// The start: a shape in the frame with the hard edges of its own normals, the class of each triangle, an atlas and grey
/// maps, of which colour and, where
/// there is light, roughness are fitted.
pub(crate) fn grey(
    light: &LightAsset,
    (source, class): (&Mesh, &[u32]),
    lit: bool,
    size: usize,
    progress: &dyn Progress,
) -> Result<Surface, FitError> {
    let has_area = |t: &usize| {
        let [a, b, c] = source.corners(*t);
        a != b && b != c && c != a
    };
    let kept: Vec<usize> = (0..source.triangles.len()).filter(has_area).collect();
    let triangles = kept.iter().map(|t| source.triangles[*t]).collect();
    let (positions, normals) = (source.positions.clone(), source.normals.clone());
    let mesh = Mesh { positions, normals, triangles, ..Mesh::default() };
    let class = kept.iter().map(|t| class[*t]).collect();
    let mut candidate = unwrapped(&mesh, None, class, light.drawn_classes(), size, progress)?;
    let fitted = if lit { channel::BASE_COLOR } else { channel::EMISSIVE };
    let mut maps = candidate.maps.levels[0].clone();
    for texel in &mut maps.texels {
        texel[channel::BASE_COLOR..channel::BASE_COLOR + 3].fill(0.0);
        texel[fitted..fitted + 3].fill(GREY);
        texel[channel::ROUGHNESS] = ROUGHNESS;
        // An unlit surface does not reflect.
        texel[channel::SPECULAR_SUPPRESSION] = f32::from(u8::from(!lit));
    }
    candidate.set_maps(maps);
    let mut samples = [false; CHANNELS];
    samples[fitted..fitted + 3].fill(true);
    samples[channel::ROUGHNESS] = lit;
    let plan = SurfacePlan::of_samples(&candidate, samples, false);
    let mut surface = Surface::new(candidate, &plan).moving(false);
    surface.rates[channel::ROUGHNESS] *= RATE_OF_ROUGHNESS;
    Ok(surface)
}

#[cfg(test)]
mod tests;
