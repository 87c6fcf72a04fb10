//! Which candidate goes on: the start of the fit, and what is written.

use super::prepare::{Start, bake_candidate};
use super::{SimplifyOptions, to_scene};
use crate::bake;
use crate::candidate::Candidate;
use crate::engine::Normalised;
use crate::engine::cpu::Chain;
use crate::engine::judge::{self, Stage};
use crate::engine::reference::Reference;
use crate::engine::surface::{self, Surface};
use crate::engine::trainer::{HeldOut, Trained};
use crate::engine::views::Orbit;
use crate::visibility::Visibility;
use crate::{FitError, Progress, Silent};
use photofit_raster::deferred::Passes;
use photofit_scene::{Scene, TextureImage};

/// Texels of the reference's surface on the present shape of a candidate.
pub(super) fn rebaked(
    surface: &bake::Reference<'_>,
    seen: &Visibility,
    candidate: &Candidate,
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<Vec<f32>, FitError> {
    let (maps, _) = bake_candidate(surface, seen, candidate, options, progress)?;
    Ok(maps.texels.into_flattened())
}

/// The start that looks best in the views of the early stop; the first wins a tie.
pub(super) fn best_start<'a>(starts: &'a [Start], held_out: &HeldOut) -> &'a Start {
    let quality =
        |s: &Start| held_out.psnr(&surface::pictures(&s.candidate, &held_out.shots, &Passes::default()));
    match starts {
        [first, second] if quality(second) > quality(first) => second,
        _ => &starts[0],
    }
}

/// What is written.
pub(super) struct Chosen {
    /// The fit, or a start that looked better.
    pub(super) trained: Trained<Surface>,
    /// Whether the decimated asset with its own materials looked better than that.
    pub(super) own_materials: bool,
}

/// The fit judged itself by its own renderer; the choice among the fitted asset, the same with maps baked anew, the
/// starts, and the decimated asset `plain` with its own materials where these are no heavier than the maps, is made as a
/// user would see them.
pub(super) fn best(
    trained: Trained<Surface>,
    surface: &bake::Reference<'_>,
    seen: &Visibility,
    starts: &[Start],
    plain: &Stage,
    n: &Normalised,
    reference: &dyn Reference,
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<Chosen, FitError> {
    let mut models = vec![trained.model.clone(), trained.model];
    if let Ok(texels) = rebaked(surface, seen, &models[1].candidate, options, &Silent) {
        models[1].values_mut(1).copy_from_slice(&texels);
        models[1].changed(1);
    }
    for start in starts {
        models.push(Surface { candidate: start.candidate.clone(), ..models[0].clone() });
    }
    let fitted = |m: &Surface| Stage::new("", to_scene(&m.candidate, n));
    let mut stages: Vec<Stage> = models.iter().map(fitted).collect();
    if is_light(&plain.scene, options.texture_size) {
        stages.push(plain.clone());
    }
    let views = Orbit::new(options.seed, &options.lighting, options.resolution);
    let (count, [_, samples]) = (options.choice_views(), options.judge_samples());
    let scores = judge::scores(n, reference, &stages, &views, count, samples, progress)?;
    let own_materials = highest(&scores) == models.len();
    let model = highest(&scores[..models.len()]);
    Ok(Chosen { trained: Trained { model: models.swap_remove(model), ..trained }, own_materials })
}

/// Index of the highest score; the first wins a tie.
fn highest(scores: &[f64]) -> usize {
    (0..scores.len()).fold(0, |best, k| if scores[k] > scores[best] { k } else { best })
}

/// Whether the materials of a scene can be written as they are: no image that they read is larger than the maps of a fit
/// may be, and the rasterizer, which the choice is made by, draws all of them.
fn is_light(scene: &Scene, texture_size: usize) -> bool {
    let used = |i: &TextureImage| i.width.max(i.height) <= texture_size;
    let materials = scene.instances.iter().map(|i| &scene.materials[scene.primitives[i.primitive].material]);
    let slots = materials.flat_map(|m| {
        let lit =
            [&m.metallic_roughness_texture, &m.normal_texture, &m.emissive_texture, &m.occlusion_texture];
        lit.into_iter().chain([&m.base_color_texture]).flatten()
    });
    slots.into_iter().all(|s| used(&scene.images[s.image])) && judge::beyond_rasterizer(scene).is_empty()
}
