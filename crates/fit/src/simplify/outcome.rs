//! What a simplification gives back.

use super::delivery::{Delivered, Delivery};
use super::plan::is_textured;
use super::through_path::TracedMaps;
use super::{Appearance, Asset, DECIMATED, Effort, FitPlan, Normalised, SimplifyOptions};
use crate::candidate::Candidate;
use crate::engine::judge::{Judged, Quality, ReportView, Stage, WIDEST_TRACED, beyond_rasterizer};
use crate::engine::surface::Surface;
use crate::engine::trainer::{HistoryPoint, Trained};
use crate::engine::vertex_colors::colored;
use crate::traced_maps::MapsCourse;
use crate::{FitError, Progress};
use photofit_scene::{Compression, Scene};
use std::path::{Path, PathBuf};

/// An asset that a report compares with the one that was given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageQuality {
    /// What it is called ([`Outcome::stages`]).
    pub name: &'static str,
    /// Its triangles.
    pub triangles: usize,
    /// The mean over the views of the report.
    pub quality: Quality,
}

impl StageQuality {
    /// Whether it is the asset with its own materials, decimated.
    pub fn has_own_materials(&self) -> bool {
        self.name == DECIMATED
    }
}

/// Figures and pictures of a finished simplification.
#[derive(Debug)]
pub struct Outcome {
    /// Triangles of the reference.
    pub triangles_in: usize,
    /// Triangles of the written file.
    pub triangles_out: usize,
    /// Wall time of everything, reports of quality included.
    pub seconds: f64,
    /// Wall time until the file was written.
    pub fit_seconds: f64,
    /// Steps made.
    pub steps: u64,
    /// The effort that was asked for.
    pub effort: Effort,
    /// Million samples per second of the steps of the fit.
    pub mpix_per_s: f64,
    /// Seconds after which the held-out quality stayed within half a decibel of its end.
    pub seconds_to_half_db: f64,
    /// True when the user ended the work early, or the time limit the fit.
    pub stopped: bool,
    /// Whether that ended the fit; else it ended what came after it: the choice of what is written, its textures within a budget of
    /// bytes, or the judgement.
    pub fit_stopped: bool,
    /// The stages with their mean quality, in the order of [`ReportView::quality`]: `original` (the asset itself as an engine draws it,
    /// where engines draw it), `decimated` (the asset's own materials on as many
    /// triangles as the fit has; absent where the user stopped the work before the choice), the starts by their
    /// [`Written::name`] (`baked`, absent where there is but one, `shrink-wrapped`, or `sphere`: a new atlas and maps from the asset,
    /// nothing is fitted), `fitted` (what was fitted; absent where no step came to anything better than the start, or the user stopped
    /// the work before the choice, and something else was written) and `file` (the written file, loaded again; absent where that is
    /// the fitted one, which no budget of bytes made smaller). The last is the written file.
    pub stages: Vec<StageQuality>,
    /// Every view of the report; fewer than were asked for where the user ended the work.
    pub views: Vec<ReportView>,
    /// Views that were asked for.
    pub report_views: u64,
    /// How the pictures of the report were made.
    pub judged: Judged,
    /// Samples of their pixels, where they are path traced.
    pub judge_spp: u32,
    /// The course of the fit.
    pub history: Vec<HistoryPoint>,
    /// What ran and what was skipped.
    pub plan: FitPlan,
    /// How the fit of the maps through the path tracer went, where there was one.
    pub traced_maps: Option<MapsCourse>,
    /// What of the asset is not in the written file, one line each.
    pub left_out: Vec<String>,
    /// What of the asset is in the written file, but was not drawn while fitting, one line each.
    pub not_fitted: Vec<String>,
    /// Where it was written: what was asked for, or [`too_large_path`] of it.
    pub file: PathBuf,
    /// What was written.
    pub written: Written,
    /// What it has in place of the asset's surface.
    pub appearance: Appearance,
    /// Bytes of the file.
    pub bytes: u64,
    /// Bytes that it was to have at most.
    pub max_bytes: Option<u64>,
    /// Whether the work was ended while what could be written was compared: what was written is the best by then.
    pub choice_cut: bool,
    /// Its textures: sizes and encodings.
    pub textures: String,
    /// Whether materials of the asset that was given have textures.
    pub asset_textured: bool,
    /// How its geometry is stored: within a budget of bytes maybe in a coarser precision than was asked for.
    pub compression: Compression,
    /// The fitted asset in the normalised frame: the written one, unless that is [`Written::Decimated`] or
    /// [`Written::Whole`], or its maps were fitted through the path tracer. Of [`Written::Kept`] it has the shape alone.
    pub candidate: Candidate,
    /// Width and height of the pictures that quality is reported by.
    pub resolution: usize,
    /// Where the fit ran.
    pub device: String,
}

/// `output` with another ending.
pub(crate) fn beside(output: &Path, ending: &str) -> PathBuf {
    let mut name = output.file_stem().unwrap_or_default().to_owned();
    name.push(".");
    name.push(ending);
    output.with_file_name(name)
}

/// Where a light asset is written that has more bytes than were asked for: `out.too-large.glb`.
pub fn too_large_path(output: &Path) -> PathBuf {
    beside(output, "too-large.glb")
}

/// Writes a light asset, its geometry compressed in a way, and returns where, and its bytes: one of more than are asked for replaces
/// nothing.
pub(super) fn save(
    output: &Path,
    (light, compression): (&Scene, Compression),
    options: &SimplifyOptions,
) -> Result<(PathBuf, u64), FitError> {
    let file = photofit_scene::to_glb_with(light, compression)?;
    let bytes = file.len() as u64;
    let fits = options.max_bytes.is_none_or(|most| bytes <= most);
    let path = if fits { output.to_owned() } else { too_large_path(output) };
    photofit_scene::write_glb(&path, &file)?;
    Ok((path, bytes))
}

/// What of a fit was written: what looked best in the views of the choice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Written {
    /// What was fitted.
    Fitted,
    /// The fitted shape, its maps baked anew.
    Rebaked,
    /// The start that was decimated (from the asset, or from the level of detail before) and drawn onto the asset's surface:
    /// no fit looked better.
    ShrinkWrapped,
    /// The start that was a sphere, drawn onto the asset's surface: no fit looked better.
    Sphere,
    /// The decimated start with baked maps: no fit looked better.
    Baked,
    /// The decimated asset with its own materials: nothing with new maps looked better.
    Decimated,
    /// The asset's own texture coordinates, materials and textures on fewer triangles, as asked.
    Kept,
    /// The asset as it was given, which has few enough bytes.
    Whole,
}

impl Written {
    /// What a fit can start from.
    pub(crate) const STARTS: [Self; 3] = [Self::Baked, Self::ShrinkWrapped, Self::Sphere];

    /// In one word.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fitted => "fitted",
            Self::Rebaked => "rebaked",
            Self::ShrinkWrapped => "shrink-wrapped",
            Self::Sphere => "sphere",
            Self::Baked => "baked",
            Self::Decimated => "own-materials",
            Self::Kept => "kept",
            Self::Whole => "whole",
        }
    }

    /// The shape of a start: of the asset, or of the level of detail before.
    pub(crate) fn start(self) -> &'static str {
        match self {
            Self::ShrinkWrapped => "the decimated shape, drawn onto the asset's surface,",
            Self::Sphere => "a sphere, drawn onto the asset's surface,",
            Self::Fitted | Self::Rebaked | Self::Baked | Self::Decimated | Self::Kept | Self::Whole => {
                "the decimated shape"
            }
        }
    }

    /// Whether that was baked after or in place of a fit.
    pub(crate) fn is_baked(self) -> bool {
        self == Self::Rebaked || Self::STARTS.contains(&self)
    }

    /// Whether that has the asset's own texture coordinates, materials and textures.
    pub fn has_own_surface(self) -> bool {
        matches!(self, Self::Decimated | Self::Kept | Self::Whole)
    }
}

impl Outcome {
    /// Mean quality of a stage.
    pub fn stage(&self, name: &str) -> Option<&Quality> {
        self.stages.iter().find(|s| s.name == name).map(|s| &s.quality)
    }

    /// Mean quality of the written file, the last of the stages.
    pub fn shipped(&self) -> Option<&Quality> {
        self.stages.last().map(|s| &s.quality)
    }

    /// Whether the file has more bytes than it was to have.
    pub fn is_too_large(&self) -> bool {
        self.max_bytes.is_some_and(|most| self.bytes > most)
    }

    /// Whether what was written was compared with what else could be. Where the user stopped the work before, it is the best of
    /// the fit's own course.
    pub fn was_chosen(&self) -> bool {
        self.written == Written::Kept || self.stage(DECIMATED).is_some()
    }

    /// How the pictures of the report were made, in words.
    pub fn judged_by(&self) -> String {
        let spp = self.judge_spp;
        match self.judged {
            Judged::Rasterized => "judged by rasterized pictures".into(),
            Judged::RasterizedAgainst(reference) => {
                let name = reference.name;
                format!(
                    "judged by rasterized pictures against {name} ones of the asset, {spp} samples per pixel"
                )
            }
            Judged::PathTraced => {
                let side = self.resolution.min(WIDEST_TRACED);
                let shadows = self.plan.holds_shadows() && !self.written.has_own_surface();
                let twice = if shadows { "; shadows that its maps hold count twice" } else { "" };
                format!(
                    "judged by path traced pictures of {side} x {side} pixels, {spp} samples each, whose noise counts in SSIM and FLIP{twice}"
                )
            }
        }
    }

    /// Adds the fit of the maps through the path tracer, where there was one.
    pub(super) fn add_traced_maps(&mut self, maps: TracedMaps) {
        self.stopped |= maps.stopped();
        self.fit_stopped |= maps.stopped();
        self.traced_maps = maps.course();
    }

    /// What was written of work that the user, or a time limit, ended early; `None` where it was not.
    pub fn ended_early(&self) -> Option<&'static str> {
        Some(match (self.fit_stopped, self.was_chosen()) {
            (true, true) => {
                "the fit was ended early: what is written is the best of what it had reached and of what needs no fit"
            }
            (true, false) => {
                "the fit was ended early: the best of its course is written, without a choice among others"
            }
            (false, false) => {
                "the work was ended after the fit: the best of its course is written, without a choice among others"
            }
            (false, true) if self.stopped => {
                "the work was ended early: what was left to compare was not compared"
            }
            (false, true) => return None,
        })
    }

    /// Of a file that was delivered; what was trained, which steered no file of [`Written::Kept`]; and what ran.
    pub(super) fn new(
        delivery: &Delivery<'_>,
        file: Delivered,
        trained: Trained<Surface>,
        plan: FitPlan,
    ) -> Self {
        let &Delivery { asset: Asset { given, .. }, options, progress, .. } = delivery;
        let (written, views, judged) = (file.written, &file.pictures, file.judged);
        let of = |(k, stage): (usize, &Stage)| StageQuality {
            name: stage.name,
            triangles: stage.scene.triangle_count(),
            quality: Quality::mean(views.iter().map(|v| &v.quality[k].quality)),
        };
        let last = trained.history.last().map_or(0.0, |h| h.quality);
        let fitted = written != Written::Kept;
        let not_fitted = fitted.then(|| not_fitted(given, file.file(), written.has_own_surface()));
        let settled = trained.history.iter().rev().take_while(|h| h.quality > last - 0.5).last();
        Self {
            triangles_in: file.triangles[0],
            triangles_out: file.triangles[1],
            seconds: file.seconds,
            fit_seconds: file.seconds_to_file,
            steps: trained.steps,
            effort: options.effort,
            mpix_per_s: trained.mpix_per_s,
            seconds_to_half_db: settled.map_or(0.0, |h| h.seconds),
            stopped: trained.stopped || progress.is_cancelled(),
            fit_stopped: trained.stopped,
            stages: file.stages.iter().enumerate().map(of).collect(),
            left_out: left_out(given, file.file(), options.appearance),
            not_fitted: not_fitted.unwrap_or_default(),
            views: file.pictures,
            report_views: options.report_views,
            judged,
            judge_spp: match judged {
                Judged::RasterizedAgainst(reference) => reference.spp.unwrap_or(1),
                Judged::Rasterized | Judged::PathTraced => options.judge_spp,
            },
            history: trained.history,
            plan,
            traced_maps: None,
            file: file.path,
            written,
            appearance: options.appearance,
            bytes: file.bytes,
            max_bytes: options.max_bytes,
            choice_cut: false,
            textures: file.textures,
            asset_textured: is_textured(given),
            compression: file.compression,
            candidate: trained.model.candidate,
            resolution: options.resolution,
            device: options.device.name(),
        }
    }
}

/// PSNR below which colours of vertices are thought to miss much of a base colour, decibels.
const COARSE: f64 = 28.0;

/// Warns where the base colour has more detail than colours of vertices hold.
pub(super) fn tell_detail(candidate: &Candidate, n: &Normalised, progress: &dyn Progress) {
    let psnr = colored(candidate, &n.light_asset).psnr;
    if psnr < COARSE {
        progress.warn(&format!(
            "the base colour has more detail than vertices: their colours show it with {psnr:.1} dB; more triangles or \
             textures show more"
        ));
    }
}

/// What of an asset is not in the written file, one line each.
pub(super) fn left_out(scene: &Scene, light: &Scene, appearance: Appearance) -> Vec<String> {
    let bumps =
        appearance == Appearance::VertexColors && scene.materials.iter().any(|m| m.normal_texture.is_some());
    let bumps = bumps.then(|| "normal maps: colours of vertices hold none".to_owned());
    lost_extensions(scene, light).into_iter().chain(scene.left_out(light)).chain(bumps).collect()
}

/// The material extensions of an asset that a written file does not have, in one line.
pub(crate) fn lost_extensions(scene: &Scene, light: &Scene) -> Option<String> {
    let kept = beyond_rasterizer(light);
    let lost: Vec<&str> = beyond_rasterizer(scene).into_iter().filter(|name| !kept.contains(name)).collect();
    (!lost.is_empty()).then(|| format!("material extensions: {}", lost.join(", ")))
}

/// What of an asset is in the written file without having been fitted, one line each; `own`: with the asset's own materials.
pub(crate) fn not_fitted(scene: &Scene, light: &Scene, own: bool) -> Vec<String> {
    let kept = beyond_rasterizer(light);
    let names: Vec<&str> = beyond_rasterizer(scene).into_iter().filter(|name| kept.contains(name)).collect();
    let how = if own { "as the asset has them" } else { "their textures as mean values" };
    let line = || format!("material extensions, {how}: {}", names.join(", "));
    (!names.is_empty()).then(line).into_iter().collect()
}
