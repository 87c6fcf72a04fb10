//! What was made is written, loaded again, and judged as a file beside what it was made from.

use super::locks::Held;
use super::{
    Asset, FILE, FITTED, FitPlan, Judged, ORIGINAL, ReportView, SimplifyOptions, Written, byte_budget, locks,
    outcome, prepare,
};
use crate::engine::judge::Stage;
use crate::engine::reference::Reference;
use crate::{FitError, Progress};
use photofit_scene::{Compression, Scene};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What is to be written, with what the asset has beside its surface, its textures encoded as asked and locked vertices where
/// they are in the asset.
pub(super) fn dressed(mut light: Scene, asset: Asset<'_>, options: &SimplifyOptions) -> Scene {
    light.inherit(asset.scene);
    light.images.iter_mut().for_each(|i| i.encoding = options.texture_encoding);
    if options.locks() {
        locks::restore(&mut light, asset.scene, asset.n);
    }
    light
}

/// Where a light asset goes, and what it is judged by.
pub(super) struct Delivery<'a> {
    pub(super) asset: Asset<'a>,
    pub(super) reference: &'a dyn Reference,
    pub(super) options: &'a SimplifyOptions,
    pub(super) output: &'a Path,
    /// When the work began.
    pub(super) began: Instant,
    pub(super) progress: &'a dyn Progress,
}

/// A file that was written, and how it looks.
pub(super) struct Delivered {
    pub(super) path: PathBuf,
    pub(super) bytes: u64,
    /// Sizes and encodings of its textures.
    pub(super) textures: String,
    pub(super) compression: Compression,
    pub(super) written: Written,
    /// Triangles of the asset and of the file.
    pub(super) triangles: [usize; 2],
    /// What the report compares: the asset itself where its pictures are others than those of the reference, what the file was made from, and the file.
    pub(super) stages: Vec<Stage>,
    pub(super) pictures: Vec<ReportView>,
    pub(super) judged: Judged,
    /// What it holds of the vertices that were to stay where they are, where any were.
    held: Option<Held>,
    /// When everything was done and when the file was written, seconds after the work began.
    pub(super) seconds: f64,
    pub(super) seconds_to_file: f64,
}

impl Delivery<'_> {
    /// Writes a light asset with its geometry stored in a way, and judges the file beside `others`.
    pub(super) fn deliver(
        &self,
        (light, compression): (&Scene, Compression),
        written: Written,
        others: Vec<Stage>,
    ) -> Result<Delivered, FitError> {
        let &Self { asset, reference, options, output, began, progress } = self;
        let scene = asset.scene;
        prepare::tell_budget(options, [scene.triangle_count(), light.triangle_count()], progress);
        let (path, bytes) = outcome::save(output, (light, compression), options)?;
        let seconds_to_file = began.elapsed().as_secs_f64();
        let file = photofit_scene::load(&path)?;
        let triangles = [scene.triangle_count(), file.triangle_count()];
        let held = Held::of(&file, scene, options);
        held.iter().for_each(|held| held.warn(compression, progress));
        let mut stages = Vec::new();
        // As an engine draws it the asset differs from the reference, too; path traced, by the noise of other samples.
        if options.as_engine || options.is_judged_by_path_tracing(scene) {
            stages.push(Stage::new(ORIGINAL, scene.clone()));
        }
        let is_fit = written == Written::Fitted && others.iter().all(|s| s.name != FITTED);
        stages.extend(others);
        stages.push(Stage::new(if is_fit { FITTED } else { FILE }, file));
        let judge = options.judge_of(scene, asset.n, reference);
        let pictures = judge.views(&stages, options.report_views, progress)?;
        Ok(Delivered {
            path,
            bytes,
            textures: byte_budget::told(light),
            compression,
            written,
            triangles,
            held,
            judged: judge.method(&stages),
            stages,
            pictures,
            seconds: began.elapsed().as_secs_f64(),
            seconds_to_file,
        })
    }

    /// Adds to a plan what the file came to.
    pub(super) fn told(&self, plan: FitPlan, file: &Delivered) -> FitPlan {
        let compared = file.stages.iter().filter(|s| s.name != ORIGINAL).count();
        let judgement = self.options.judgement(self.asset.given).made(file.pictures.len(), compared);
        plan.with_judgement(judgement)
            .with_triangles(file.triangles)
            .with_locked(file.held.map(|held| held.row(file.compression)))
            .with_bytes(self.options.max_bytes, Some((file.bytes, &file.textures, file.compression)))
    }
}

impl Delivered {
    /// What was written, loaded again.
    pub(super) fn file(&self) -> &Scene {
        &self.stages[self.stages.len() - 1].scene
    }
}
