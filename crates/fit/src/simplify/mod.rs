//! Appearance-driven simplification: the main job (Hasselgren et al. 2021).
//!
//! load -> normalise -> decimate -> wrap -> atlas -> bake -> fit by rendering -> bake again on the fitted shape -> fit
//! the maps -> export -> reload the file and compare it with the reference on views and lights that the fit never saw.

mod export;
mod look;
mod options;
mod outcome;
pub(crate) mod prepare;
mod wrap;

pub use crate::engine::judge::{Quality, ReportView, ViewQuality, compare};
pub use crate::engine::plan::Plan;
pub use crate::engine::reference::ReferenceRenderer;
pub use crate::engine::trainer::{HistoryPoint, Trained};
pub use export::to_scene;
pub use look::MaterialClass;
pub(crate) use look::drawn;
pub use options::{Init, SimplifyOptions};
pub use outcome::Outcome;
pub use prepare::Normalised;

use crate::engine::reference::Painter;
use crate::engine::{judge, trainer};
use crate::{FitError, Progress, Silent};
use photofit_geometry::decimate::{Options, Target};
use photofit_scene::Scene;
use std::path::Path;
use std::time::Instant;

/// Simplifies `scene` and writes the result to `output` (.glb).
///
/// When the user stops the fit, what has been reached is exported and reported like a finished fit.
///
/// # Errors
/// See [`FitError`]; nothing is written then.
pub fn simplify(
    scene: &Scene,
    output: &Path,
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<Outcome, FitError> {
    let began = Instant::now();
    scene.validate_for_fit()?;
    options.check(scene.triangle_count())?;
    let normalised = Normalised::new(scene)?;
    let reference = normalised.reference()?;
    let painter = Painter::new(&normalised, scene, options)?;
    let prepare::Prepared { starts, visibility } =
        prepare::prepare(&normalised, &reference, options, progress)?;
    let held_out = trainer::held_out(&painter, options)?;
    let start = trainer::best_start(&starts, &held_out);
    let plan = Plan::new(scene, &start.candidate, options);
    let mut trained =
        trainer::train(&painter, &reference, start.clone(), held_out, &visibility, &plan, options, progress)?;
    // The fit judged itself by its own renderer; the choice is made as a user would see it.
    let mut rebaked = trained.candidate.clone();
    if let Ok((maps, _)) = prepare::bake_candidate(&reference, &visibility, &rebaked, &Silent) {
        rebaked.set_maps(maps);
    }
    let choice = [trained.candidate, rebaked, start.candidate.clone()];
    trained.candidate = judge::best_of(&normalised, &painter, choice, options, progress)?;
    let fit_seconds = began.elapsed().as_secs_f64();

    let name = output.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
    let mut light = to_scene(&trained.candidate, &normalised, &name);
    for image in &mut light.images {
        image.encoding = options.texture_encoding;
    }
    photofit_scene::save_glb(output, &light)?;
    let fitted = photofit_scene::load(output)?;
    let triangles_out = fitted.triangle_count();
    let mut only = Options::new(Target::Triangles(triangles_out));
    only.keep_uvs = true;
    let decimated = prepare::decimated_only(&normalised, &only)?;
    let [wrapped, baked] = [0, starts.len() - 1].map(|k| &starts[k].candidate);
    let candidates = [
        decimated,
        judge::Prepared::of_scene(&to_scene(baked, &normalised, &name)),
        judge::Prepared::of_scene(&to_scene(wrapped, &normalised, &name)),
        judge::Prepared::of_scene(&fitted),
    ];
    let views = judge::evaluate(&normalised, &painter, &candidates, options, progress)?;
    Ok(Outcome::new(
        scene,
        trained,
        plan,
        views,
        triangles_out,
        [began.elapsed().as_secs_f64(), fit_seconds],
        options,
    ))
}
