//! From the reference to the start of the fit: normalise, decimate, unwrap, bake.

use super::look::{self, MaterialClass};
use super::wrap;
use super::{Init, SimplifyOptions};
use crate::bake::{self, AlphaClass, BakeSettings, Reference, bake, blank_texel, hard_edges};
use crate::candidate::Candidate;
use crate::engine::judge as evaluate;
use crate::visibility::{Visibility, VisibilitySettings, visibility_reporting};
use crate::{FitError, Progress};
use photofit_geometry::atlas::{UnwrapOptions, unwrap};
use photofit_geometry::decimate::{DecimateError, Decimated, Options, Target, decimate, decimate_reporting};
use photofit_geometry::{Edges, Mesh, normals::split_hard_edges, shapes, weld::weld_exact};
use photofit_raster::{Maps, channel};
use photofit_scalar::{Vec3f, vec3};
use photofit_scene::{AlphaMode, FlatScene, Material, Scene, SurfaceLibrary};
use std::borrow::Cow;
use std::ops::ControlFlow;

/// Triangles that fewer than this share of the sky sees still count this much in the decimation.
const LEAST_IMPORTANCE: f32 = 0.05;

/// The reference in the frame of the fit: its bounding sphere has radius 1 about the origin.
#[derive(Debug)]
pub struct Normalised {
    /// World-space geometry in the normalised frame.
    pub flat: FlatScene,
    /// Its materials.
    pub materials: Vec<Material>,
    /// Its materials, ready to be looked up.
    pub library: SurfaceLibrary,
    /// Its texture images.
    pub images: Vec<photofit_scene::TextureImage>,
    /// The materials that the light asset will have.
    pub classes: Vec<MaterialClass>,
    /// The class of each material.
    material_class: Vec<u32>,
    /// Centre in the asset's frame.
    pub center: Vec3f,
    /// Radius in the asset's units.
    pub radius: f32,
}

impl Normalised {
    /// Flattens and normalises a scene.
    ///
    /// # Errors
    /// A scene without a visible extent.
    pub fn new(scene: &Scene) -> Result<Self, FitError> {
        let mut flat = scene.flatten();
        let (center, radius) = bounding_sphere(&flat.mesh).ok_or_else(|| FitError::Setting {
            option: "asset",
            rule: "it has no triangles with an extent".into(),
        })?;
        for p in &mut flat.mesh.positions {
            *p = (*p - center) / radius;
        }
        let (classes, material_class) = look::classes(scene);
        let drawn = look::drawn(scene);
        let library = SurfaceLibrary::new(&drawn);
        let (materials, images) = match drawn {
            Cow::Borrowed(scene) => (scene.materials.clone(), scene.images.clone()),
            Cow::Owned(scene) => (scene.materials, scene.images),
        };
        Ok(Self { flat, materials, images, classes, material_class, library, center, radius })
    }

    /// The reference prepared for rays.
    ///
    /// # Errors
    /// Geometry that cannot be ray cast.
    pub fn reference(&self) -> Result<Reference<'_>, FitError> {
        Ok(Reference::new(&self.flat, &self.materials, &self.library)?)
    }

    /// Class of each triangle of the reference.
    fn triangle_classes(&self) -> Vec<u32> {
        self.flat.triangle_material.iter().map(|m| self.material_class[*m as usize]).collect()
    }

    /// What alpha means in the pictures of each class.
    fn drawn_modes(&self) -> Vec<AlphaMode> {
        self.classes.iter().map(|c| c.drawn).collect()
    }
}

/// Centre of the box around the used vertices and the largest distance from it.
fn bounding_sphere(mesh: &Mesh) -> Option<(Vec3f, f32)> {
    let used = || mesh.triangles.iter().flatten().map(|i| mesh.positions[*i as usize]);
    let first = used().next()?;
    let (lo, hi) = used().fold((first, first), |(lo, hi), p| (lo.min(p), hi.max(p)));
    let center = (lo + hi) * 0.5;
    let radius = used().map(|p| (p - center).length()).fold(0.0, f32::max);
    (radius > 0.0 && radius.is_finite()).then_some((center, radius))
}

/// What a fit can start from.
pub(crate) struct Prepared {
    /// First the mesh that was drawn onto the reference, then, if it was a decimated one, the same as decimation left it.
    pub(crate) starts: Vec<Start>,
    /// What of the reference can be seen.
    pub(crate) visibility: Visibility,
}

/// Decimates, unwraps and bakes.
pub(crate) fn prepare(
    n: &Normalised,
    reference: &Reference<'_>,
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<Prepared, FitError> {
    let go_on = || if progress.is_cancelled() { Err(FitError::Interrupted) } else { Ok(()) };
    let seen =
        visibility_reporting(reference, &VisibilitySettings::default(), &heard("visibility", progress))
            .ok_or(FitError::Interrupted)?;
    let (mesh, class, decimated) = match options.init {
        Init::Decimate => {
            let d = decimate_reference(n, &seen, options.target, progress)?;
            let mut mesh = d.mesh.clone();
            wrap::NEARBY.run(&mut mesh, reference, &seen, progress)?;
            (mesh, d.group, Some(d.mesh))
        }
        Init::Sphere => {
            let (mut mesh, class) = sphere(n, &seen, options.target)?;
            wrap::FROM_AFAR.run(&mut mesh, reference, &seen, progress)?;
            (mesh, class, None)
        }
    };
    go_on()?;
    let start = |mesh: &Mesh, class| unwrap_and_bake(n, reference, &seen, mesh, class, options, progress);
    let mut starts = vec![start(&mesh, class.clone())?];
    if let Some(mesh) = decimated {
        starts.push(start(&mesh, class)?);
    }
    Ok(Prepared { starts, visibility: seen })
}

/// A candidate with an atlas of its own and what was baked into it.
#[derive(Clone)]
pub(crate) struct Start {
    pub(crate) candidate: Candidate,
    /// Mean distance to the reference, in the normalised frame.
    pub(crate) distance: f64,
}

/// Gives a mesh an atlas, the reference's hard edges, and maps baked from the reference.
fn unwrap_and_bake(
    n: &Normalised,
    reference: &Reference<'_>,
    seen: &Visibility,
    mesh: &Mesh,
    class: Vec<u32>,
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<Start, FitError> {
    progress.report("atlas", 0, 1, "");
    let settings = UnwrapOptions { size: options.texture_size as u32, ..UnwrapOptions::default() };
    let atlas = unwrap(&mesh.positions, &mesh.triangles, &class, &settings)?;
    let (unwrapped, _) = atlas.build_mesh(&mesh.positions, &mesh.triangles);
    if progress.is_cancelled() {
        return Err(FitError::Interrupted);
    }
    let weld = weld_exact(&unwrapped.positions);
    let edges = Edges::new(&unwrapped.triangles, &weld);
    let hard = hard_edges(reference, seen, &unwrapped, &edges);
    let creased = split_hard_edges(&unwrapped.triangles, &weld, &edges, &hard);
    let maps = Maps::filled(options.texture_size, options.texture_size, blank_texel());
    let split = creased.split.apply(&unwrapped);
    let mut candidate = Candidate::new(&split, &creased.smoothing, class, n.drawn_modes(), maps);
    let (baked, distance) = bake_candidate(reference, seen, &candidate, progress)?;
    candidate.set_maps(baked);
    Ok(Start { candidate, distance })
}

/// A callback that shows the finished share of a stage and passes on the wish to stop.
fn heard<'a>(stage: &'static str, progress: &'a dyn Progress) -> impl Fn(f32) -> ControlFlow<()> + Sync + 'a {
    move |share| {
        progress.report(stage, (share * 1000.0) as u64, 1000, "");
        if progress.is_cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

/// Decimates the reference with its visible triangles first.
fn decimate_reference(
    n: &Normalised,
    seen: &Visibility,
    target: Target,
    progress: &dyn Progress,
) -> Result<Decimated, FitError> {
    let triangles = n.flat.mesh.triangles.len();
    let importance: Vec<f32> = (0..triangles)
        .map(|t| if seen.is_visible(t) { LEAST_IMPORTANCE + seen.importance(t) } else { 0.0 })
        .collect();
    let mut options = Options::new(target);
    options.double_sided = n.classes.iter().map(|c| c.double_sided).collect();
    let report = heard("decimate", progress);
    decimate_reporting(&n.flat.mesh, &n.triangle_classes(), &importance, &options, &report).map_err(|e| {
        match e {
            DecimateError::Stopped => FitError::Interrupted,
            e => e.into(),
        }
    })
}

/// The decimated reference with its own textures: one scene with the reference's materials.
pub(crate) fn decimated_only(n: &Normalised, options: &Options) -> Result<evaluate::Prepared, FitError> {
    let d = decimate(&n.flat.mesh, &n.flat.triangle_material, &[], options)?;
    let mut mesh = d.mesh;
    if mesh.normals.is_empty() {
        mesh.normals = photofit_geometry::normals::mesh_normals(&mesh);
    }
    Ok(evaluate::Prepared::of_flat(n, mesh, d.group))
}

/// A sphere around the visible reference, as many triangles as the budget allows.
fn sphere(n: &Normalised, seen: &Visibility, target: Target) -> Result<(Mesh, Vec<u32>), FitError> {
    let budget = match target {
        Target::Triangles(t) => t,
        Target::Ratio(r) => (n.flat.mesh.triangles.len() as f64 * r) as usize,
        Target::Error(_) | Target::ScreenSize(_) => {
            return Err(FitError::Setting {
                option: "--init sphere",
                rule: "needs a budget given by --triangles or --ratio".into(),
            });
        }
    };
    let frequency = ((budget as f64 / 20.0).sqrt().floor() as u32).max(1);
    let mut mesh = shapes::icosphere(frequency);
    let visible = |t: &usize| seen.is_visible(*t);
    let corners = || (0..n.flat.mesh.triangles.len()).filter(visible).flat_map(|t| n.flat.mesh.corners(t));
    let first = corners().next().unwrap_or_default();
    let (lo, hi) = corners().fold((first, first), |(lo, hi), p| (lo.min(p), hi.max(p)));
    let (center, half) = ((lo + hi) * 0.5, (hi - lo) * 0.5);
    for p in &mut mesh.positions {
        *p = center + vec3(p.x * half.x, p.y * half.y, p.z * half.z) * 0.9;
    }
    mesh.normals.clear();
    let class = vec![0; mesh.triangles.len()];
    Ok((mesh, class))
}

/// Bakes the reference onto the candidate's present shape; also returns the mean distance between the two.
pub(crate) fn bake_candidate(
    reference: &Reference<'_>,
    seen: &Visibility,
    candidate: &Candidate,
    progress: &dyn Progress,
) -> Result<(Maps, f64), FitError> {
    let base = &candidate.maps.levels[0];
    let settings = BakeSettings { width: base.width, height: base.height, ..BakeSettings::default() };
    let classes: Vec<AlphaClass> =
        candidate.class.iter().map(|c| candidate.classes[*c as usize].into()).collect();
    let (mesh, round) = (candidate.mesh(), candidate.round_normals());
    let target = bake::Target { mesh: &mesh, directions: Some(&round), classes: Some(&classes) };
    let mut baked =
        bake(reference, seen, &target, &settings, &heard("bake", progress)).map_err(|e| match e {
            bake::BakeError::Stopped => FitError::Interrupted,
            e => e.into(),
        })?;
    baked.fill(None);
    for t in &mut baked.maps.texels {
        t[channel::GAMMA] = 0.0;
    }
    Ok((baked.maps, baked.statistics.mean_distance))
}
