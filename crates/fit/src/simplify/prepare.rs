//! From the reference to the start of the fit: normalise, decimate, unwrap, bake.

use super::init::Shape;
use super::texture_space::TextureSpaces;
use super::{Mips, SimplifyOptions, Written, coverage, locks};
use crate::bake::{self, BakeClass, BakeSettings, ReferenceSurface, bake};
use crate::candidate::Candidate;
use crate::engine::Normalised;
use crate::engine::asset::bits;
use crate::engine::judge::Stage;
use crate::engine::plan::rows::Unseen;
use crate::engine::unwrap::unwrapped;
use crate::visibility::{Visibility, VisibilitySettings, visibility_reporting};
use crate::{FitError, Progress};
use photofit_geometry::Mesh;
use photofit_geometry::decimate::{DecimateError, Decimated, Options, Target, decimate, decimate_reporting};
use photofit_raster::CHANNELS;
use photofit_raster::texture::{MipRule, Pyramid};
use photofit_scene::Scene;
use photofit_shading::Sides;
use std::ops::ControlFlow;

/// Triangles that fewer than this share of the sky sees still count this much in the decimation.
const LEAST_IMPORTANCE: f32 = 0.05;

/// What of the reference can be seen.
pub(crate) fn visibility(
    reference: &ReferenceSurface<'_>,
    progress: &dyn Progress,
) -> Result<Visibility, FitError> {
    visibility_reporting(reference, &VisibilitySettings::default(), &heard("visibility", progress))
        .ok_or(FitError::Interrupted)
}

/// What a fit can start from, decimated, unwrapped and baked: first the mesh that was drawn onto the reference, then, if it
/// was a decimated one, the same as decimation left it. What is decimated is the reference, or, where there is one, the
/// candidate `from` of an earlier fit. `weights` say how much each triangle of the reference counts.
pub(super) fn prepare(
    n: &Normalised,
    reference: &ReferenceSurface<'_>,
    (seen, weights): (&Visibility, Weights<'_>),
    from: Option<&Candidate>,
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<Vec<Start>, FitError> {
    let go_on = || if progress.is_cancelled() { Err(FitError::Interrupted) } else { Ok(()) };
    go_on()?;
    let Shape { mesh, class, made, decimated, locked, unseen } = match from {
        Some(candidate) => {
            let d = decimated(n, &candidate.mesh(), &candidate.class, &[], options, progress)?;
            Shape { unseen: None, ..Shape::drawn(d, reference, (seen, weights.drawn), progress)? }
        }
        None => options.init.shape(n, reference, (seen, weights), options, progress)?,
    };
    go_on()?;
    let start = |mesh: &Mesh, class, made| {
        let (mut candidate, distance) = unwrap_and_bake(n, reference, seen, mesh, class, options, progress)?;
        candidate.lock(|p| locked.contains(&bits(*p)));
        Ok::<Start, FitError>(Start { candidate, made, distance, unseen })
    };
    let mut starts = vec![start(&mesh, class.clone(), made)?];
    if let Some(mesh) = decimated.filter(|_| options.effort.work().compares_starts) {
        starts.push(start(&mesh, class, Written::Baked)?);
    }
    Ok(starts)
}

/// How much each triangle of the reference counts.
#[derive(Clone, Copy)]
pub(super) struct Weights<'a> {
    /// In the decimation.
    pub(super) decimated: &'a [f32],
    /// When the decimated mesh is drawn onto it, beside the area; empty: all alike.
    pub(super) drawn: &'a [f32],
}

/// A candidate with an atlas of its own and what was baked into it.
#[derive(Clone)]
pub(super) struct Start {
    pub(super) candidate: Candidate,
    /// What it is where it is written.
    pub(super) made: Written,
    /// Mean distance to the reference, in the normalised frame.
    pub(super) distance: f64,
    /// Triangles of the reference that its decimation left out since nobody sees them; `None` where it was not decimated.
    pub(super) unseen: Option<usize>,
}

/// Gives a mesh an atlas, the reference's hard edges, and maps baked from the reference; also its mean distance to that, in the
/// normalised frame.
fn unwrap_and_bake(
    n: &Normalised,
    reference: &ReferenceSurface<'_>,
    seen: &Visibility,
    mesh: &Mesh,
    class: Vec<u32>,
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<(Candidate, f64), FitError> {
    let (seen_surface, classes) = (Some((reference, seen)), n.light_asset.drawn_classes());
    let mut candidate = unwrapped(mesh, seen_surface, class, classes, options.texture_size, progress)?;
    if options.mips == Mips::Free {
        candidate.free_mips();
    }
    let (baked, distance) = bake_candidate(reference, seen, &candidate, options, progress)?;
    candidate.maps = baked;
    Ok((candidate, distance))
}

/// A callback that shows the finished share of a stage and passes on the wish to stop.
pub(super) fn heard<'a>(
    stage: &'static str,
    progress: &'a dyn Progress,
) -> impl Fn(f32) -> ControlFlow<()> + Sync + 'a {
    move |share| {
        progress.report(stage, (share * 1000.0) as u64, 1000, "");
        if progress.is_cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

/// How much each triangle of the reference counts: by the share of the sky that sees it, 0 where nothing does.
pub(super) fn importance(n: &Normalised, seen: &Visibility) -> Vec<f32> {
    (0..n.flat.mesh.triangles.len())
        .map(|t| if seen.is_visible(t) { LEAST_IMPORTANCE + seen.importance(t) } else { 0.0 })
        .collect()
}

/// The triangles of the reference that nobody sees, of which the decimation left some out.
pub(super) fn unseen(reference: &ReferenceSurface<'_>, seen: &Visibility, dropped: usize) -> Unseen {
    let has_area = |t: &usize| reference.area_normal(*t as u32).length() > 0.0;
    let with_area = || (0..reference.mesh().triangles.len()).filter(has_area);
    Unseen { dropped, unseen: with_area().filter(|t| !seen.is_visible(*t)).count(), all: with_area().count() }
}

/// Decimates a mesh whose triangles have the given classes.
pub(super) fn decimated(
    n: &Normalised,
    mesh: &Mesh,
    class: &[u32],
    importance: &[f32],
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<Decimated, FitError> {
    let mut options = locks::locking(Options::new(options.target), mesh, n, options);
    options.double_sided = n.light_asset.classes.iter().map(|c| c.sides == Sides::Both).collect();
    let report = heard("decimate", progress);
    decimate_reporting(mesh, class, importance, &options, &report).map_err(|e| match e {
        DecimateError::Stopped => FitError::Interrupted,
        e => e.into(),
    })
}

/// The stage `name`: the decimated reference with its own textures and materials.
pub(super) fn decimated_only(
    name: &'static str,
    scene: &Scene,
    n: &Normalised,
    importance: &[f32],
    options: &Options,
) -> Result<Stage, FitError> {
    let spaces = TextureSpaces::of(scene);
    let d = decimate(&spaces.read(&n.flat), &n.flat.triangle_material, importance, options)?;
    let mut mesh = d.mesh;
    if mesh.normals.is_empty() {
        mesh.normals = photofit_geometry::normals::mesh_normals(&mesh);
    }
    let mut stage = Stage::of_mesh(name, scene, &mesh, &d.group);
    stage.scene.primitives.iter_mut().for_each(|p| spaces.store(p.material, &mut p.mesh));
    Ok(stage)
}

/// Tells that locked vertices left no room for the budget, where they did not.
pub(super) fn tell_budget(options: &SimplifyOptions, [of, made]: [usize; 2], progress: &dyn Progress) {
    let most = match options.target {
        // More of the bytes may be triangles than was planned.
        Target::Triangles(_) if options.triangles_by_bytes => made,
        Target::Triangles(n) => n,
        Target::Ratio(r) => (of as f64 * r) as usize,
        Target::Error(_) | Target::ScreenSize(_) => made,
    };
    if options.locks() && made > most.max(1) {
        progress.warn(&format!(
            "locked vertices leave no room for a budget of {most} triangles: there are {made}"
        ));
    }
}

/// Bakes the reference onto the candidate's present shape: maps with the mip levels that they start with, and the mean distance
/// between the two. Masks keep their coverage in free levels, as they do in those that are made for a file.
pub(super) fn bake_candidate(
    reference: &ReferenceSurface<'_>,
    seen: &Visibility,
    candidate: &Candidate,
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<(Pyramid<f32, CHANNELS>, f64), FitError> {
    let base = &candidate.maps.levels[0];
    let settings = BakeSettings { width: base.width, height: base.height, ..options.bake_settings() };
    let classes: Vec<BakeClass> =
        candidate.class.iter().map(|c| candidate.classes[*c as usize].into()).collect();
    let (mesh, round) = (candidate.mesh(), candidate.round_normals());
    let target = bake::Target { mesh: &mesh, directions: Some(&round), classes: Some(&classes) };
    let mut baked =
        bake(reference, seen, &target, &settings, &heard("bake", progress)).map_err(|e| match e {
            bake::BakeError::Stopped => FitError::Interrupted,
            e => e.into(),
        })?;
    baked.fill(None);
    if options.is_prefiltered() {
        coverage::keep(candidate, &baked.valid, &baked.cut, &mut baked.maps);
    }
    let mut maps = candidate.levels_of(baked.maps);
    if maps.rule == MipRule::Free {
        for level in &mut maps.levels[1..] {
            let all = vec![true; level.texels.len()];
            coverage::keep(candidate, &all, &all, level);
        }
    }
    Ok((maps, baked.statistics.mean_distance))
}
