//! Textures of a light animated asset that make it look like a heavy one in motion: skinned, morphed or moved by nodes.
//! Assembled from the parts of the engine; the task beside [`crate::simplify`] for assets that move.
//!
//! One frame for all moments -> bake at rest onto the light asset's own texture coordinates -> fit the maps by rendering
//! both at many moments -> export with the light asset's nodes, skins and animations -> reload the file and compare it with
//! the reference at these moments, in views that the fit never saw. Motions stay what they are, and so does the shape unless
//! [`RetextureOptions::fit_shape`] asks for its fit.

mod bare;
mod start;

use crate::candidate::{Candidate, OrientedPoints};
use crate::engine::Normalised;
use crate::engine::animated::Animated;
use crate::engine::checkpoint::Digest;
use crate::engine::device::{Device, train_on};
use crate::engine::export::to_scene;
use crate::engine::fingerprint::Fingerprint;
use crate::engine::judge::{self, Judge, JudgeRenderer, Judged, Quality, ReportView, Stage};
use crate::engine::loss;
use crate::engine::plan::{FitRequest, Item, PlanRows, SurfacePlan, rows};
use crate::engine::posed::{Posed, same_triangles};
use crate::engine::reference::{Rasterized, Reference, SAMPLES, SUPERSAMPLE};
use crate::engine::surface::{MAPS, POSITIONS, Surface, fade_over, rate_of_maps, rate_of_positions};
use crate::engine::trainer::{self, Batch, Checkpointing, HeldOut, HistoryPoint, Job, Phase};
use crate::engine::views::{Lighting, Moment, Orbit, OverMoments, Sampling};
use crate::error::in_ranges;
use crate::simplify::Written;
use crate::simplify::outcome::{lost_extensions, not_fitted};
use crate::visibility::{VisibilitySettings, visibility};
use crate::{FitError, Progress};
use bare::bare;
use photofit_geometry::opposed;
use photofit_scene::Scene;
use start::{baked, candidate, warn_of_normals};
use std::path::Path;
use std::sync::Arc;

/// Options of [`retexture`].
#[derive(Clone, Debug)]
pub struct RetextureOptions {
    /// The moments that are compared, in animations of the reference; the light asset plays those of the same names. Without
    /// any both are compared as they stand.
    pub moments: Vec<Moment>,
    /// Width and height of the pictures, pixels, 16 to 4096.
    pub resolution: usize,
    /// Width and height of the maps, 16 to 8192.
    pub texture_size: usize,
    /// Steps of the fit.
    pub steps: u64,
    /// Whether the shape of the light asset is fitted, too: the vertices of its bind pose, which its skins, morph targets and
    /// nodes move as before.
    pub fit_shape: bool,
    /// Pictures per step, 1 to 64.
    pub batch: usize,
    /// The light while fitting.
    pub lighting: Lighting,
    /// Seed of all random choices.
    pub seed: u64,
    /// Views of the report.
    pub report_views: u64,
    /// Where the fit runs.
    pub device: Device,
    /// Checkpoints and limits.
    pub checkpointing: Checkpointing,
}

impl Default for RetextureOptions {
    fn default() -> Self {
        Self {
            moments: Vec::new(),
            resolution: 256,
            texture_size: 1024,
            steps: 400,
            fit_shape: false,
            batch: 2,
            lighting: Lighting::default(),
            seed: 0,
            report_views: 8,
            device: Device::default(),
            checkpointing: Checkpointing::default(),
        }
    }
}

/// What was made.
#[derive(Debug)]
pub struct Retextured {
    /// Mean quality of the written file over the views of the report and their moments.
    pub quality: Quality,
    /// The same of the baked start.
    pub start: Quality,
    /// Each view, with the start and the written file against it.
    pub views: Vec<ReportView>,
    /// How the pictures of the views were made: by the path tracer where a material has what the rasterizer lacks.
    pub judged: Judged,
    /// What was written: the fit, or the baked start where that looked better in held-out views of the choice.
    pub written: Written,
    /// The course of the fit.
    pub history: Vec<HistoryPoint>,
    /// Steps made.
    pub steps: u64,
    /// Ended by the user or the time limit.
    pub stopped: bool,
    /// What of the reference's materials is not in the written file, one line each.
    pub left_out: Vec<String>,
    /// What of them is in the written file, but was not drawn while fitting, one line each.
    pub not_fitted: Vec<String>,
    /// Where the fit ran.
    pub device: String,
    /// What ran and what was skipped.
    pub plan: PlanRows,
}

/// Fits the maps of `light` so that it looks like `reference` at all moments, and writes it with them to `output` (.glb).
///
/// # Errors
/// See [`FitError`]: moments that one of the assets does not have, texture coordinates that are missing or leave the unit
/// square, a reference whose materials are of several kinds (opaque, masked, blended, of other extensions). Nothing is
/// written then.
pub fn retexture(
    reference: &Scene,
    light: &Scene,
    output: &Path,
    options: &RetextureOptions,
    progress: &dyn Progress,
) -> Result<Retextured, FitError> {
    options.check()?;
    reference.validate_for_fit()?;
    light.validate_for_fit()?;
    let n = Normalised::over(reference, &options.moments)?;
    let _told = n.not_finite.told_at_the_end(progress);
    let bare = bare(light)?;
    let own = Animated::new(&bare, &n).playing(&n.light_asset.animations);
    let theirs = Animated::new(reference, &n);
    let rays = n.surface()?;
    let reference_pictures = Rasterized::new(&n.flat, &n.library).animated(&theirs);
    // What is written is judged by the pictures of the CPU.
    let drawn = &*options.device.drawing(reference_pictures);

    let rest = own.flat(Moment::default())?;
    options.moments.iter().try_for_each(|m| same_triangles(&rest.mesh.triangles, &own.flat(*m)?.mesh, *m))?;
    let turned = opposed(&rest.mesh);
    warn_of_normals(&n, (&rest, &turned), progress);
    let mut candidate = candidate(&n, &rest, options.texture_size)?;
    // Vertex normals that point to the back would lead rays away from the surface.
    let round = turned.contains(&true).then(|| candidate.round_normals());
    let moves = options.fit_shape && options.steps > 0;
    let to_bind = moves.then(|| own.to_bind()).transpose()?;
    let surface = (&rays, &visibility(&rays, &VisibilitySettings::default()));
    let at_rest = candidate.vertices_of(OrientedPoints::of(&rest.mesh));
    let (maps, distance) = baked(&n, surface, &candidate, (at_rest, round.as_deref()), progress)?;
    candidate.set_maps(maps);
    let start = dressed(light, &candidate, &n);
    if let Some(to_bind) = &to_bind {
        // A fitted shape has normals of its own, which the asset need not have.
        let at_rest = candidate.vertices_through(&[&**to_bind, &*own.deformation(Moment::default())?]);
        candidate.set_maps(baked(&n, surface, &candidate, (at_rest, None), progress)?.0);
    }
    let asked = FitRequest { steps: options.steps, moves, reference: reference_pictures.kind() };
    let fitted = SurfacePlan::new(&candidate, asked);
    let steps = if moves || fitted.passes.map_gradients { options.steps } else { 0 };
    let model = Posed::new(Surface::new(candidate, &fitted), &own, to_bind);

    let size = options.resolution / Sampling::SUPERSAMPLED.per_axis;
    let seen = OverMoments {
        views: Orbit::new(options.seed, &options.lighting, size),
        moments: options.moments.clone(),
    };
    let count = trainer::HELD_OUT.max(2 * options.moments.len() as u64).min(32);
    let held_out = HeldOut::new(drawn, &seen, Sampling::SUPERSAMPLED, count, options.seed)?;
    held_out.warn_unseen(progress);
    let loss = loss::choose(&held_out);
    let job = Job {
        reference: drawn,
        views: &seen,
        held_out: &held_out,
        sampling: Sampling::SUPERSAMPLED,
        loss,
        seed: options.seed,
        batch: Batch::half_new(options.batch),
        steps,
        rival: None,
        checkpointing: &options.checkpointing,
        fingerprint: fingerprint(options, &n, &model.surface().candidate, [&own, &theirs])?,
    };
    let mut plan = PlanRows::default();
    let phases = |psnr: f64| {
        let mut rates = vec![(MAPS.into(), rate_of_maps(psnr))];
        rates.extend(moves.then(|| (POSITIONS.into(), rate_of_positions(distance))));
        let fade = fade_over(fitted.fades, [0.0, 1.0]);
        let name = if moves { "shape and maps" } else { "maps" };
        let phases = vec![Phase { name, first: 0, steps, shrink: 1, rates, fade, reinitialised: None }];
        plan = PlanRows::new(Vec::new(), &phases);
        phases
    };
    let (trained, device) = train_on(&options.device, model, &job, phases, progress)?;
    let mut plan = plan.ended(trained.reached());
    // What nothing is fitted of says so, whatever steps were asked for.
    plan.items =
        rows::surface(&trained.model.surface().work(if steps > 0 { trained.steps } else { options.steps }));
    plan.items.push(animation(options, &n));
    plan.items.push(rows::loss(loss, held_out.noise, trained.steps > 0));
    plan.items.push(rows::evaluation(held_out.measure, "what a screen shows is compared"));
    let plan = plan.with_device(device.told());

    // Without a step they are the same.
    let fitted = if trained.steps > 0 { outcome(light, &trained.model, &n) } else { start.clone() };
    // The fit judged itself at half the size, by its own textures; what is written is chosen as it will be seen.
    let mut stages = [Stage::new("start", start), Stage::new("fitted", fitted)];
    let larger =
        OverMoments { views: Orbit { size: options.resolution, ..seen.views.clone() }, ..seen.clone() };
    let is_baked_better = trained.steps > 0 && {
        let score = judge::scores(
            &n.light_asset,
            &reference_pictures,
            &stages,
            &larger,
            count,
            SUPERSAMPLE,
            progress,
        )?;
        score[0] > score[1]
    };
    let (written, chosen) = if is_baked_better { (Written::Baked, 0) } else { (Written::Fitted, 1) };
    photofit_scene::save_glb(output, &stages[chosen].scene)?;
    stages[1].scene = photofit_scene::load(output)?;
    let judge = Judge {
        scene: reference,
        n: &n,
        reference: &reference_pictures,
        renderer: JudgeRenderer::Auto,
        spp: SAMPLES,
        lighting: &options.lighting,
        size: options.resolution,
        samples: [SUPERSAMPLE; 2],
        seed: options.seed,
    };
    let views = judge.at_moments(&stages, &options.moments, options.report_views, progress)?;
    let [start, quality] = Quality::of_two_stages(&views);
    let file = &stages[1].scene;
    Ok(Retextured {
        quality,
        start,
        views,
        judged: judge.method(&stages),
        written,
        history: trained.history,
        steps: trained.steps,
        stopped: trained.stopped || progress.is_cancelled(),
        left_out: lost_extensions(reference, file).into_iter().collect(),
        not_fitted: not_fitted(reference, file, false),
        device: device.name(),
        plan,
    })
}

impl RetextureOptions {
    fn check(&self) -> Result<(), FitError> {
        let rules = [
            ("resolution", self.resolution, 16..=4096),
            ("texture_size", self.texture_size, 16..=8192),
            ("batch", self.batch, 1..=64),
        ];
        in_ranges(rules)?;
        if self.fit_shape && self.steps > 0 && self.device.requires_gpu() {
            let rule = "is a GPU; the shape of an asset that is seen in poses is fitted on the CPU".into();
            return Err(FitError::Setting { field: "device", rule });
        }
        Ok(())
    }
}

/// The row of the animation.
fn animation(options: &RetextureOptions, n: &Normalised) -> Item {
    let mut names: Vec<&str> = Vec::new();
    for index in options.moments.iter().filter_map(|m| m.animation) {
        if !names.contains(&&*n.light_asset.animations[index]) {
            names.push(&n.light_asset.animations[index]);
        }
    }
    let why = format!("{} moments of {}", options.moments.len(), names.join(", "));
    Item::of("animation", !names.is_empty(), why, "both assets are compared as they stand")
}

/// The light asset with the maps of a candidate. Its vertex colours belong to the materials that these replace: kept, they
/// would be multiplied with the new maps, which hold the whole colour.
fn dressed(light: &Scene, candidate: &Candidate, n: &Normalised) -> Scene {
    let made = to_scene(candidate, &n.light_asset);
    let mut out = Scene { materials: made.materials, images: made.images, ..light.clone() };
    for p in &mut out.primitives {
        p.material = 0;
        p.mesh.colors.clear();
    }
    // Meshes with skins or morph targets are written from their bind poses.
    let meshes = out.hierarchy.iter_mut().flat_map(|h| &mut Arc::make_mut(h).meshes);
    for bind in meshes.flat_map(|m| &mut m.primitives).filter_map(|p| p.bind.as_mut()) {
        bind.mesh.colors.clear();
    }
    out
}

/// The light asset with the maps of a model, and its shape where that is fitted.
fn outcome(light: &Scene, model: &Posed<'_>, n: &Normalised) -> Scene {
    let mut out = dressed(light, &model.surface().candidate, n);
    model.write_shape(&mut out);
    out
}

/// The options and what is fitted: a checkpoint of others is refused.
fn fingerprint(
    o: &RetextureOptions,
    n: &Normalised,
    candidate: &Candidate,
    [own, theirs]: [&Animated<'_>; 2],
) -> Result<Fingerprint, FitError> {
    let mut shape = Digest::new();
    shape.add(candidate.triangles.as_flattened());
    shape.add(&candidate.uvs);
    shape.add(&candidate.positions);
    let mut asset = Digest::new();
    asset.add(&n.flat.mesh.positions);
    asset.add(n.flat.mesh.triangles.as_flattened());
    let fingerprint = Fingerprint::default()
        .option("resolution", o.resolution)
        .option("texture_size", o.texture_size)
        .option("fit_shape", o.fit_shape)
        .option("batch", o.batch)
        .option("seed", o.seed)
        .option("lighting", o.lighting.name())
        .option("moments", format!("{:?}", o.moments))
        .digest("light asset", shape)
        .digest("reference", asset);
    let of = |asset: &Animated<'_>| -> Result<String, FitError> {
        let mut poses = Digest::new();
        for moment in &o.moments {
            poses.add(&asset.flat(*moment)?.mesh.positions);
        }
        Ok(poses.to_string())
    };
    Ok(fingerprint.digest("poses of the light asset", of(own)?).digest("poses of the reference", of(theirs)?))
}

#[cfg(test)]
mod tests;
