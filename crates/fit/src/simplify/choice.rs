//! Which candidate goes on: the start of the fit, and what is written.

use super::byte_budget::Shapes;
use super::outcome::tell_detail;
use super::prepare::{Start, bake_candidate};
use super::rival::Rival;
use super::{Appearance, Asset, SimplifyOptions, Written, plain};
use crate::bake;
use crate::candidate::Candidate;
use crate::engine::Normalised;
use crate::engine::judge::{Certainty, Stage};
use crate::engine::plan::Item;
use crate::engine::reference::{ENERGY, Reference};
use crate::engine::surface::{self, Surface};
use crate::engine::trainer::{HeldOut, Trained};
use crate::visibility::Visibility;
use crate::{FitError, Progress, Silent};
use photofit_geometry::decimate::Target;
use photofit_raster::CHANNELS;
use photofit_raster::deferred::Passes;
use photofit_raster::texture::Pyramid;
use photofit_scene::Scene;

/// Maps of the reference's surface on the present shape of a candidate.
pub(super) fn rebaked(
    surface: &bake::ReferenceSurface<'_>,
    seen: &Visibility,
    candidate: &Candidate,
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<Pyramid<f32, CHANNELS>, FitError> {
    bake_candidate(surface, seen, candidate, options, progress).map(|(maps, _)| maps)
}

/// How a start looks in the views of the early stop.
#[derive(Clone, Copy)]
pub(super) struct StartQuality {
    pub(super) psnr: f64,
    /// Share of the squared error at the outline, in [0, 1].
    pub(super) at_outline: f64,
}

/// The start that looks best in the views of the early stop, of which the first wins a tie, and how it looks.
pub(super) fn best_start(starts: &[Start], held_out: &HeldOut) -> (usize, StartQuality) {
    let passes = Passes { energy: ENERGY, ..Passes::default() };
    let look = |start: &Start| {
        let pictures = surface::pictures(&start.candidate, held_out.shots(), &passes);
        StartQuality { psnr: held_out.psnr(&pictures), at_outline: held_out.at_outline(&pictures) }
    };
    let first = (0, look(&starts[0]));
    starts.iter().enumerate().skip(1).fold(first, |best, (k, start)| {
        let look = look(start);
        if look.psnr > best.1.psnr { (k, look) } else { best }
    })
}

/// What is written; [`super::finish`] makes a file of it.
pub(super) struct Chosen {
    /// The fit, or a start that looked better.
    pub(super) trained: Trained<Surface>,
    /// What is written.
    pub(super) light: Scene,
    /// Which of the candidates that is.
    pub(super) written: Written,
    /// What was fitted, where something else is written.
    pub(super) fitted: Option<Scene>,
    /// Within a budget of bytes: the decimated asset with its own materials, where it may be written. It was not compared, since it is
    /// as the file that it would be.
    pub(super) own: Option<Shapes>,
    /// How the asset with its own materials that may be written was decimated.
    pub(super) decimation: Option<Item>,
    /// The asset with its own materials on as many triangles, the best decimation where several were compared; `None` where nothing was,
    /// since the user stopped the work.
    pub(super) plain: Option<Stage>,
    /// How sure the choice is; `None` where it was cut.
    pub(super) certainty: Option<Certainty>,
}

impl Chosen {
    /// Warns of what it lacks that was to be expected.
    pub(super) fn warn(&self, n: &Normalised, options: &SimplifyOptions, progress: &dyn Progress) {
        if options.appearance == Appearance::VertexColors && !self.written.has_own_surface() {
            tell_detail(&self.trained.model.candidate, n, progress);
        }
        if self.trained.behind.is_some() && self.written != Written::Decimated && self.plain.is_some() {
            progress.warn(
                "the fit ended early, far behind the asset's own materials on as many triangles, which yet look worse in the \
                 views of the choice; without them as a choice (new maps) it makes all of its steps",
            );
        }
    }
}

/// The fit judged itself by its own renderer; the choice among the fitted asset, the same with maps baked anew, the
/// starts, and the decimated asset with its own materials, where it may be written, is made by pictures as those of the
/// report are made. Where triangles follow from bytes those of the asset with its own materials do so by options of their own. Who stopped the
/// work does not wait for it.
pub(super) fn best(
    asset: Asset<'_>,
    trained: Trained<Surface>,
    (starts, start, rival): (&[Start], usize, Rival),
    reference: &dyn Reference,
    (options, own_options): (&SimplifyOptions, &SimplifyOptions),
    progress: &dyn Progress,
) -> Result<Chosen, FitError> {
    let Asset { scene, n, rays, visibility: seen, .. } = asset;
    if progress.is_cancelled() {
        return Ok(reached(trained, (starts, start), n, options));
    }
    progress.report("choose", 0, options.choice_views(), "own materials");
    let as_many = Target::Triangles(starts[start].candidate.triangles.len());
    let plain = rival.into_stage(asset, &starts[start].candidate, options)?;
    let (own, plain) = if options.triangles_by_bytes && options.keeps_textures(scene) {
        // Its own geometry takes other bytes than that of new maps.
        let target = own_options.target;
        let first = plain::decimated(scene, n, &[], &plain::own(target, n, options))?;
        (plain::candidate(asset, &first, reference, target, own_options, progress)?, plain)
    } else {
        let own = plain::candidate(asset, &plain, reference, as_many, options, progress)?;
        // The best of several decimations is what others are to be compared with.
        let best = own.as_ref().map(|own| own.stage.clone());
        (own, best.unwrap_or(plain))
    };
    let (mut own, decimation) = own.map(|own| (own.shapes, own.decimation)).unzip();
    // A fit without a better step is its start.
    let gained = trained.gained();
    let mut models = Vec::new();
    if gained {
        models.push((Written::Fitted, trained.model.clone()));
        // A bake that fails costs no fit: the maps stay as they were fitted.
        if let Ok(maps) = rebaked(rays, seen, &trained.model.candidate, options, &Silent) {
            let mut anew = trained.model.clone();
            anew.candidate.maps = maps;
            models.push((Written::Rebaked, anew));
        }
    }
    for start in starts {
        let candidate = start.candidate.clone();
        models.push((start.made, Surface { candidate, ..trained.model.clone() }));
    }
    let mut scenes: Vec<Scene> = models.iter().map(|m| options.exported(&m.1.candidate, n)).collect();
    // Within a budget of bytes own materials meet the others as the files that both would be.
    if options.max_bytes.is_none() {
        scenes.extend(own.take().map(|own| own.scene(0)));
    }
    let stages: Vec<Stage> = scenes.iter().map(|s| Stage::new("", s.clone())).collect();
    let judge = options.judge_of(scene, n, reference);
    let (count, samples) = (options.choice_views(), options.choice_samples());
    let ranking = judge.ranking(&stages, (count, options.smallest_picture()), samples, progress)?;
    let best = ranking.best();
    let written = models.get(best).map_or(Written::Decimated, |m| m.0);
    let fitted = (written != Written::Fitted && gained).then(|| scenes[0].clone());
    let (_, model) = models.swap_remove(ranking.best_of(0..models.len()));
    Ok(Chosen {
        trained: Trained { model, ..trained },
        light: scenes.swap_remove(best),
        written,
        fitted,
        own,
        decimation,
        plain: Some(plain),
        // Who stopped the work cut the choice, too.
        certainty: (!progress.is_cancelled()).then(|| ranking.certainty()),
    })
}

/// What a fit had reached: by the held-out views it is the best of its course, in which the start counts.
fn reached(
    trained: Trained<Surface>,
    (starts, start): (&[Start], usize),
    n: &Normalised,
    options: &SimplifyOptions,
) -> Chosen {
    let written = if trained.gained() { Written::Fitted } else { starts[start].made };
    let light = options.exported(&trained.model.candidate, n);
    Chosen {
        trained,
        light,
        written,
        fitted: None,
        own: None,
        decimation: None,
        plain: None,
        certainty: None,
    }
}
