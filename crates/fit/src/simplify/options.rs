//! What the user chooses.

use super::through_path::{FitRenderer, TracedMaps};
use super::{
    Appearance, Effort, FitPlan, Init, Judgement, Mips, Normalised, ReferenceRenderer, appearance,
    by_outline, byte_budget, locks, mips,
};
use crate::FitError;
use crate::bake::{BakeSettings, Occlusion};
use crate::candidate::Candidate;
use crate::engine::device::Device;
use crate::engine::export::to_scene;
use crate::engine::judge::{self, Judge, JudgeRenderer, Judged, WIDEST_TRACED, beyond_rasterizer};
use crate::engine::plan::FitRequest;
use crate::engine::reference::{Reference, ReferenceKind, SAMPLES, SUPERSAMPLE, samples_for};
use crate::engine::trainer::{Batch, Checkpointing, HELD_OUT};
use crate::engine::vertex_colors::colored;
use crate::views::{Lighting, Sampling};
use photofit_geometry::decimate::Target;
use photofit_scene::{Compression, Scene, TextureEncoding};
use std::path::PathBuf;
use std::time::Duration;

/// Options of [`super::simplify`].
#[derive(Clone, Debug)]
pub struct SimplifyOptions {
    /// The budget.
    pub target: Target,
    /// What the fit starts from.
    pub init: Init,
    /// Width and height of the pictures that quality is reported by; the fit compares pictures half as wide, in which
    /// each pixel is the mean of two by two samples.
    pub resolution: usize,
    /// Pictures as an engine shows the asset at `resolution` pixels: the fit samples its candidate as graphics hardware
    /// does ([`Sampling::ENGINE`], up to [`LARGEST_ENGINE_PICTURE`] pixels), and quality is judged by one sample a pixel
    /// with mipmaps, against a supersampled reference.
    pub as_engine: bool,
    /// Pictures per step; with `as_engine`, of pictures below 512 pixels so many times more as a side is shorter, up to
    /// [`MOST_REPLAYS`]: half of `batch` are new, all others are seen again.
    pub batch: usize,
    /// Steps of the fit.
    pub steps: u64,
    /// How much work is done where nothing else says it ([`Self::with_effort`]).
    pub effort: Effort,
    /// Ends the fit early; what is reached counts. It bounds the fit alone: preparation, export and the report come on top.
    pub time_limit: Option<Duration>,
    /// Width and height of the maps.
    pub texture_size: usize,
    /// How the mip levels of the maps come about.
    pub mips: Mips,
    /// Smallest size on screen that [`Mips::Free`] levels are fitted for, pixels; the largest is `resolution`.
    pub smallest_size: usize,
    /// How the maps are stored in the written file.
    pub texture_encoding: TextureEncoding,
    /// How the geometry is stored in the written file; within [`Self::max_bytes`] a coarser precision is tried, too.
    pub compression: Compression,
    /// The light while fitting.
    pub lighting: Lighting,
    /// How pictures of the reference are made, for the fit and for the report.
    pub reference: ReferenceRenderer,
    /// What draws the light asset while its maps are fitted; [`FitRenderer::Path`] needs [`ReferenceRenderer::Path`].
    pub fit_with: FitRenderer,
    /// Seed of all random choices.
    pub seed: u64,
    /// Folder of the checkpoint.
    pub checkpoint: Option<PathBuf>,
    /// Goes on from the checkpoint.
    pub resume: bool,
    /// Most bytes of the written file: sizes of textures and their encoding ([`Self::texture_encoding`], or JPEG where that
    /// is too large) are chosen so that it fits with the least loss. Own textures ([`Self::own_textures`]) and new maps are each
    /// made to fit, and what looks best then is written.
    pub max_bytes: Option<u64>,
    /// Whether the triangles follow from [`Self::max_bytes`] instead of [`Self::target`]: all where they fit into half of it or the asset
    /// as it is fits; else several parts of it are tried, both of starts of the fit and of the asset's own surface, or, where nothing has
    /// textures, all of it.
    pub triangles_by_bytes: bool,
    /// Views of the report.
    pub report_views: u64,
    /// Whether the asset's own texture coordinates, textures and materials on fewer triangles, the textures reduced to
    /// the texels that new maps would have or to [`Self::max_bytes`], may be written where they look better than what was fitted; else there are
    /// always new maps, one set for all.
    pub own_textures: bool,
    /// Whether the asset's own textures keep their texels where they are written and [`MILD_RATIO`] of the triangles or more are
    /// left.
    pub whole_textures: bool,
    /// Longest side of the asset's own textures where they are written, but for [`Appearance::Kept`]; `None`: whatever goes
    /// with the texels of all of them. [`Self::whole_textures`] comes first.
    pub own_texture_size: Option<usize>,
    /// What the light asset has in place of the asset's surface.
    pub appearance: Appearance,
    /// Whether vertices on open borders stay where they are, in the decimation and in the fit, to the bit.
    pub lock_borders: bool,
    /// The attribute (`_NAME` of a glTF file, without the underscore, read by [`photofit_scene::Limits::vertex_attribute`]) that marks
    /// vertices which stay where they are, to the bit: those where it is above one half.
    pub lock: Option<String>,
    /// Where the occlusion map of the light asset comes from: the asset's maps, rays against the asset (then there are always
    /// new maps), or nowhere: there is none.
    pub occlusion: Occlusion,
    /// Who draws the pictures of the report.
    pub judge: JudgeRenderer,
    /// Samples of a pixel of a report whose pictures are all path traced.
    pub judge_spp: u32,
    /// Where the fit runs.
    pub device: Device,
}

impl Default for SimplifyOptions {
    fn default() -> Self {
        Self {
            target: Target::Ratio(0.03),
            init: Init::Decimate,
            resolution: 512,
            as_engine: false,
            batch: 2,
            steps: Effort::Normal.work().steps,
            effort: Effort::Normal,
            time_limit: None,
            texture_size: 1024,
            mips: Mips::default(),
            smallest_size: SMALLEST_SIZE,
            texture_encoding: TextureEncoding::Png,
            compression: Compression::None,
            lighting: Lighting::default(),
            reference: ReferenceRenderer::default(),
            fit_with: FitRenderer::default(),
            seed: 0,
            checkpoint: None,
            resume: false,
            max_bytes: None,
            triangles_by_bytes: false,
            report_views: Effort::Normal.work().report_views,
            own_textures: true,
            whole_textures: false,
            own_texture_size: None,
            appearance: Appearance::default(),
            lock_borders: false,
            lock: None,
            occlusion: Occlusion::Maps,
            judge: JudgeRenderer::Auto,
            judge_spp: SAMPLES,
            device: Device::default(),
        }
    }
}

/// Largest picture, pixels a side, in which a fit samples its candidate as an engine does; beyond, the aliasing of one
/// sample a pixel is small, and supersampled pictures of half the size show as much.
pub const LARGEST_ENGINE_PICTURE: usize = 256;
/// How many times more pictures a step sees where they are small.
pub const MOST_REPLAYS: usize = 16;
/// Largest size on screen, pixels, that pictures and textures follow.
const LARGEST_SCREEN: f64 = 1024.0;
/// Texels of a texture's side for a pixel on screen: with an atlas that is two thirds full, a convex body then has about
/// one texel for a pixel that faces the viewer.
const TEXELS_PER_PIXEL: f64 = 2.0;
/// Smallest size on screen that mip levels are fitted for, where nothing says another.
const SMALLEST_SIZE: usize = 16;
/// Smallest texture that a size on screen asks for.
const LEAST_TEXTURE: usize = 64;

impl SimplifyOptions {
    /// The same for an asset that is `pixels` pixels large on screen: pictures of that size, drawn as an engine does, and
    /// textures with as many texels as are seen then, a power of two. The budget stays as it is. Both follow the size from
    /// 16 up to 1024 pixels.
    #[must_use]
    pub fn for_screen_size(self, pixels: f64) -> Self {
        let shown = pixels.clamp(16.0, LARGEST_SCREEN);
        let texture_size = ((shown * TEXELS_PER_PIXEL) as usize).next_power_of_two().max(LEAST_TEXTURE);
        Self { resolution: shown.ceil() as usize, texture_size, as_engine: true, ..self }
    }

    /// Whether one texel stands for much of the asset's surface: it gathers more of it, and masks keep their coverage.
    pub(super) fn is_prefiltered(&self) -> bool {
        self.as_engine && self.resolution <= LARGEST_ENGINE_PICTURE
    }

    /// How maps are baked, but for their size.
    pub(super) fn bake_settings(&self) -> BakeSettings {
        let plain = BakeSettings { occlusion: self.occlusion, ..BakeSettings::default() };
        if self.is_prefiltered() {
            // Roughness is not widened: with it and a wider bake together small levels lost FLIP (docs/crates/fit.md).
            BakeSettings { samples_per_side: 8, filter_width: 1.0, ..plain }
        } else {
            plain
        }
    }

    /// What a fit of an asset against pictures of a kind does, as far as the options tell.
    pub fn plan(&self, scene: &Scene, reference: ReferenceKind) -> FitPlan {
        let plan = FitPlan::new(scene)
            .with_options(self.fit_steps(), reference, &self.lighting)
            // As they were resolved: starts of a fit may come to all triangles, too.
            .without_steps((self.steps == 0 && self.lacks_nothing(scene)).then_some(NOTHING_LACKS))
            .with_appearance(self.appearance)
            .with_own_materials(self.keeps_textures(scene))
            .with_judgement(self.judgement(scene))
            .with_occlusion(self.occlusion)
            .with_traced_maps(TracedMaps::planned(self).row())
            .with_bytes(self.max_bytes, None)
            .with_counted(byte_budget::planned(self, scene))
            .with_mips(self.mip_sizes());
        if self.appearance == Appearance::Kept { plan } else { plan.with_outline(by_outline::planned(self)) }
    }

    /// What is asked of the surface that is fitted to pictures of a kind.
    pub(super) fn fit_request(&self, reference: ReferenceKind) -> FitRequest {
        let steps = self.fit_steps();
        FitRequest { steps, moves: true, reference }
    }

    /// Steps that are made at most.
    pub fn fit_steps(&self) -> u64 {
        if self.appearance == Appearance::Kept { 0 } else { self.steps }
    }

    /// A candidate as it is written.
    pub(super) fn exported(&self, candidate: &Candidate, n: &Normalised) -> Scene {
        match self.appearance {
            Appearance::VertexColors => colored(candidate, &n.light_asset).scene,
            Appearance::Maps | Appearance::Kept => to_scene(candidate, &n.light_asset),
        }
    }

    /// Where and how the fit keeps its state.
    pub(crate) fn checkpointing(&self) -> Checkpointing {
        let (checkpoint, resume, time_limit) = (self.checkpoint.clone(), self.resume, self.time_limit);
        Checkpointing { checkpoint, resume, time_limit }
    }

    /// How the fit samples its candidate.
    pub(super) fn sampling(&self) -> Sampling {
        if self.is_prefiltered() || self.mips == Mips::Free {
            Sampling::ENGINE
        } else {
            Sampling::SUPERSAMPLED
        }
    }

    /// Width and height of the pictures that the fit compares: their samples that are shaded one by one are as many as
    /// the pixels of `resolution`.
    pub(super) fn picture_size(&self) -> usize {
        let sampling = self.sampling();
        if sampling.shade_per_pixel { self.resolution } else { self.resolution / sampling.per_axis }
    }

    /// Samples per axis of a pixel in pictures of the reference and of what is judged.
    pub(super) fn judge_samples(&self) -> [usize; 2] {
        if self.as_engine { [samples_for(self.resolution), 1] } else { [SUPERSAMPLE; 2] }
    }

    /// Pictures of a step: small ones are more, of which no more are new.
    pub(super) fn batch_of_steps(&self) -> Batch {
        let small = self.as_engine || self.mips == Mips::Free;
        let more = if small { (512 / self.mean_side().max(1)).clamp(1, MOST_REPLAYS) } else { 1 };
        Batch::new(self.batch * more, self.batch.div_ceil(2))
    }

    /// How many times as many views as usual pictures of this size need, so that they show as many pixels.
    fn more_views(&self) -> u64 {
        let small = self.as_engine || self.mips == Mips::Free;
        if small { (512 / self.mean_side().max(1) as u64).clamp(1, 4) } else { 1 }
    }

    /// Views of the early stop.
    pub(super) fn held_out_views(&self) -> u64 {
        HELD_OUT * self.more_views()
    }

    /// Views by which the written asset is chosen.
    pub(super) fn choice_views(&self) -> u64 {
        self.effort.work().choice_views * self.more_views()
    }

    /// Whether the report of an asset is path traced.
    pub fn is_judged_by_path_tracing(&self, scene: &Scene) -> bool {
        self.judged(scene).0 == Judged::PathTraced
    }

    /// What the fit by the rasterizer is compared with.
    pub fn rasterized_against(&self) -> ReferenceRenderer {
        match self.fit_with {
            FitRenderer::Raster => self.reference,
            FitRenderer::Path => ReferenceRenderer::Raster,
        }
    }

    /// Who is asked to draw the pictures of the report.
    fn judge_renderer(&self) -> JudgeRenderer {
        match (self.judge, self.fit_with) {
            (JudgeRenderer::Auto, FitRenderer::Path) => JudgeRenderer::Path,
            (judge, _) => judge,
        }
    }

    /// Who draws the pictures of the report of an asset, and why.
    fn judged(&self, scene: &Scene) -> (Judged, String) {
        let reference = self.rasterized_against().kind();
        let (judged, why) = judge::method(self.judge_renderer(), reference, &beyond_rasterizer(scene));
        let why = match (self.judge, self.fit_with) {
            (JudgeRenderer::Auto, FitRenderer::Path) => "a fit through the path tracer is asked for".into(),
            (JudgeRenderer::Raster, FitRenderer::Path) => {
                why + "; what the path tracer alone sees is not drawn"
            }
            _ => why,
        };
        (judged, why)
    }

    /// Who draws the pictures of the report of an asset, why, and how many there are.
    pub fn judgement(&self, scene: &Scene) -> Judgement {
        let (judged, why) = self.judged(scene);
        // Decimated, baked, shrink-wrapped where the fit starts from a decimated asset, fitted, and the file where that is something
        // else.
        let starts = self.init.is_decimated() && self.effort.work().compares_starts;
        let kept = self.appearance == Appearance::Kept;
        let stages = if kept { 1 } else { 4 + usize::from(starts) };
        let (side, spp) = (self.resolution.min(WIDEST_TRACED), self.judge_spp);
        let judgement = Judgement { judged, why, pictures: 0, at_most: false, side, spp };
        Judgement { at_most: !kept, ..judgement.made(self.report_views as usize, stages) }
    }

    /// What judges the written file.
    pub(super) fn judge_of<'a>(
        &'a self,
        scene: &'a Scene,
        n: &'a Normalised,
        reference: &'a dyn Reference,
    ) -> Judge<'a> {
        Judge {
            scene,
            n,
            reference,
            renderer: self.judge_renderer(),
            spp: self.judge_spp,
            lighting: &self.lighting,
            size: self.resolution,
            samples: self.judge_samples(),
            seed: self.seed,
        }
    }

    /// Checks the ranges against an asset of `triangles` triangles; `usize::MAX` where there is none yet.
    ///
    /// # Errors
    /// [`FitError::Setting`] names the field, what it is and what it must be.
    pub fn check(&self, triangles: usize) -> Result<(), FitError> {
        let resolution = self.resolution;
        let texture_size = self.texture_size;
        let rules = [
            target_rule(self.target, triangles),
            self.init.check(self.target, triangles),
            rule("resolution", resolution, (16..=4096).contains(&resolution), "must be 16 to 4096"),
            rule("texture_size", texture_size, (16..=8192).contains(&texture_size), "must be 16 to 8192"),
            rule("batch", self.batch, (1..=64).contains(&self.batch), "must be 1 to 64"),
            rule("report_views", self.report_views, self.report_views <= 256, "must be at most 256"),
            // Pictures of the judge are made in halves.
            rule("judge_spp", self.judge_spp, (2..=65536).contains(&self.judge_spp), "must be 2 to 65536"),
            rule(
                "triangles_by_bytes",
                self.triangles_by_bytes,
                !self.triangles_by_bytes || self.max_bytes.is_some(),
                "needs max_bytes",
            ),
            rule(
                "fit_with",
                format!("{:?}", self.fit_with).to_lowercase(),
                self.fit_with == FitRenderer::Raster || self.reference.kind().indirect_light,
                "needs path as the reference, too",
            ),
            appearance::check(self),
            mips::check(self),
            locks::rule(
                self,
                self.compression == Compression::None,
                "needs exact positions, which compressed geometry has not",
            ),
            locks::rule(self, self.init.is_decimated(), "needs the decimated asset as the start"),
            rule(
                "resume",
                self.resume,
                !self.resume || self.checkpoint.is_some(),
                "needs a checkpoint, the folder to go on from",
            ),
        ];
        rules.into_iter().collect()
    }

    /// Whether an asset that keeps its triangles may be written as it is, with textures in place of fitted maps.
    pub(super) fn keeps_all(&self, scene: &Scene) -> bool {
        self.triangles_by_bytes
            && self.keeps_textures(scene)
            && self.occlusion == Occlusion::Maps
            && !self.as_engine
            && beyond_rasterizer(scene).is_empty()
    }

    /// Whether the asset's own materials may be written, with their textures where the light asset may have some. Texture coordinates of
    /// its own may show one texel in many places, which are not occluded alike.
    pub(super) fn keeps_textures(&self, scene: &Scene) -> bool {
        let may = match self.appearance {
            Appearance::Maps => true,
            Appearance::VertexColors => !super::plan::is_textured(scene),
            Appearance::Kept => false,
        };
        may && self.own_textures && !matches!(self.occlusion, Occlusion::Rays(_))
    }

    /// Whether all triangles stay, so that nothing is missing that a fit could make up for: textures alone are reduced.
    pub(super) fn lacks_nothing(&self, scene: &Scene) -> bool {
        self.target == Target::Triangles(scene.triangle_count()) && self.keeps_all(scene)
    }

    /// The same with what an asset decides: its triangles where they follow from bytes, the budget that is meant, and no steps
    /// where nothing is missing that a fit could make up for.
    ///
    /// # Errors
    /// If options are out of their ranges ([`Self::check`]), the asset cannot be fitted ([`Scene::validate_for_fit`]), or its
    /// geometry cannot be written, whose bytes count.
    pub fn resolved(&self, scene: &Scene) -> Result<Resolved, FitError> {
        self.check(scene.triangle_count())?;
        scene.validate_for_fit()?;
        let mut options = self.clone();
        if let Some(most) = self.max_bytes.filter(|_| self.triangles_by_bytes) {
            // Instances of one mesh are one mesh of all of them in a decimation, but not in the asset as it is.
            let all = self.keeps_all(scene) && byte_budget::fits(scene, most, self.compression)?;
            options.target = Target::Triangles(if all {
                scene.triangle_count()
            } else {
                byte_budget::triangles_within(scene, most, self.compression)?
            });
        }
        let (target, told) = options.sane_target(scene.triangle_count());
        options.target = target;
        if options.lacks_nothing(scene) {
            options.steps = 0;
        }
        Ok(Resolved { options, told })
    }

    /// The budget that is meant: a share of the triangles of an asset never leaves fewer than [`MIN_TRIANGLES`] of them, or all
    /// that there are. Also says what a user should know about it.
    pub fn sane_target(&self, triangles: usize) -> (Target, Option<String>) {
        let floor = MIN_TRIANGLES.min(triangles);
        match self.target {
            Target::Ratio(r) if ((triangles as f64 * r) as usize) < floor => {
                let meant = (triangles as f64 * r) as usize;
                let text = format!(
                    "the asset has {triangles} triangles, and a share of {r} would leave {meant}: {floor} stay, so that a \
                     shape is left"
                );
                (Target::Triangles(floor), Some(text))
            }
            Target::Triangles(n) if n < floor => {
                let text = format!("a budget of {n} triangles is hardly a shape; {floor} are a sane floor");
                (self.target, Some(text))
            }
            target => (target, None),
        }
    }
}

/// Options with what an asset decides ([`SimplifyOptions::resolved`]).
#[derive(Clone, Debug)]
pub struct Resolved {
    pub(super) options: SimplifyOptions,
    /// What a user should know about the budget.
    pub(super) told: Option<String>,
}

impl Resolved {
    /// The options.
    pub fn options(&self) -> &SimplifyOptions {
        &self.options
    }
}

/// Why a fit makes no steps, however many are asked for.
const NOTHING_LACKS: &str = "all triangles stay: nothing is missing that a fit could make up for";

/// Share of the triangles from which on a budget is mild: most bytes are those of textures then.
pub const MILD_RATIO: f64 = 0.25;

/// Fewest triangles that a share of an asset leaves.
pub const MIN_TRIANGLES: usize = 64;

pub(super) fn rule(
    field: &'static str,
    is: impl std::fmt::Display,
    holds: bool,
    must: &str,
) -> Result<(), FitError> {
    if holds { Ok(()) } else { Err(FitError::Setting { field, rule: format!("is {is}; it {must}") }) }
}

fn target_rule(target: Target, triangles: usize) -> Result<(), FitError> {
    match target {
        Target::Triangles(n) => {
            let must = match triangles {
                usize::MAX => "must be at least 1".to_owned(),
                most => format!("must be 1 to {most}, the triangles of the asset"),
            };
            rule("triangles", n, (1..=triangles).contains(&n), &must)
        }
        Target::Ratio(r) => rule("ratio", r, r > 0.0 && r <= 1.0, "must be above 0 and at most 1"),
        Target::Error(e) => {
            rule("error", e, e > 0.0 && e < 1.0, "must lie between 0 and 1, a share of the bounding diagonal")
        }
        Target::ScreenSize(p) => {
            rule("screen_size", p, (1.0..=65536.0).contains(&p), "must be 1 to 65536 pixels")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(target: Target) -> SimplifyOptions {
        SimplifyOptions { target, ..SimplifyOptions::default() }
    }

    #[test]
    fn errors_name_the_field_what_it_is_and_what_it_must_be() {
        let cases = [
            (with(Target::Triangles(0)), "triangles is 0; it must be 1 to 500, the triangles of the asset"),
            (
                with(Target::Triangles(501)),
                "triangles is 501; it must be 1 to 500, the triangles of the asset",
            ),
            (with(Target::Ratio(2.0)), "ratio is 2; it must be above 0 and at most 1"),
            (
                SimplifyOptions { resolution: 8, ..SimplifyOptions::default() },
                "resolution is 8; it must be 16 to 4096",
            ),
            (SimplifyOptions { batch: 0, ..SimplifyOptions::default() }, "batch is 0; it must be 1 to 64"),
        ];
        for (options, message) in cases {
            assert_eq!(options.check(500).unwrap_err().to_string(), message);
        }
        assert!(SimplifyOptions::default().check(1).is_ok());
    }

    #[test]
    fn pictures_and_textures_follow_the_size_on_screen() {
        let of = |px: f64| SimplifyOptions::default().for_screen_size(px);
        for (px, resolution, texture, picture, judged) in [
            (16.0, 16, 64, 16, [16, 1]),
            (32.0, 32, 64, 32, [16, 1]),
            (100.5, 101, 256, 101, [8, 1]),
            (128.0, 128, 256, 128, [8, 1]),
            (512.0, 512, 1024, 256, [4, 1]),
            (9000.0, 1024, 2048, 512, [4, 1]),
        ] {
            let o = of(px);
            assert_eq!(
                (o.resolution, o.texture_size, o.picture_size()),
                (resolution, texture, picture),
                "{px}"
            );
            assert_eq!(o.judge_samples(), judged, "{px}");
            assert_eq!(o.sampling().shade_per_pixel, px <= 256.0, "{px}");
            assert!(o.check(usize::MAX).is_ok() && o.target == SimplifyOptions::default().target);
        }
        assert!(of(32.0).held_out_views() > of(512.0).held_out_views());
        assert_eq!(SimplifyOptions::default().sampling(), Sampling::SUPERSAMPLED);
    }

    #[test]
    fn a_share_of_a_small_asset_leaves_a_shape() {
        let (target, told) = SimplifyOptions::default().sane_target(12);
        assert_eq!(target, Target::Triangles(12));
        assert!(told.is_some_and(|t| t.contains("12 triangles")), "all of a cube stays");
        assert_eq!(SimplifyOptions::default().sane_target(1000).0, Target::Triangles(MIN_TRIANGLES));
        assert_eq!(SimplifyOptions::default().sane_target(100_000), (Target::Ratio(0.03), None));
        let (target, told) = with(Target::Triangles(5)).sane_target(1000);
        assert!(target == Target::Triangles(5) && told.is_some(), "an explicit budget holds, with a warning");
    }
}
