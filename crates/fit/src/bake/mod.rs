//! Baking: the reference's surface on the atlas of another mesh, found by casting rays.
//!
//! Each texel of the target's atlas takes several samples. A sample is a point of the target and its smooth normal;
//! among the places where the line through them meets the reference, the nearest one that faces the same way and can
//! be seen from outside is chosen. Where the line meets none, the closest such point of the reference is taken. The
//! cage, that is how far to look, is measured on the target beforehand: it is twice the distance between the surfaces.
//!
//! Normals are averaged in world space and written in the tangent frame of the target, such that
//! [`photofit_shading::perturb`] gives them back.

mod cage;
mod creases;
mod occlusion;
pub(crate) mod reference;
mod select;
mod target;
mod texel;

#[cfg(test)]
pub(crate) mod tests;

use crate::visibility::Visibility;
use photofit_geometry::{Mesh, atlas};
use photofit_raster::{CHANNELS, Maps, channel};
use photofit_rays::AccelError;
use photofit_scalar::Vec3f;
use photofit_scene::AlphaMode;
use rayon::prelude::*;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

pub(crate) use creases::{hard_edges, own_creases};
pub use occlusion::{Occlusion, OcclusionRays};
pub use reference::ReferenceSurface;

/// Largest width and height of the maps.
pub const MAX_SIZE: usize = 16384;

/// Which materials of the reference a triangle of the target stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AlphaClass {
    /// Materials without alpha.
    Opaque,
    /// Alpha masks.
    Mask,
    /// Alpha blending.
    Blend,
}

impl From<AlphaMode> for AlphaClass {
    fn from(mode: AlphaMode) -> Self {
        match mode {
            AlphaMode::Opaque => Self::Opaque,
            AlphaMode::Mask { .. } => Self::Mask,
            AlphaMode::Blend => Self::Blend,
        }
    }
}

/// Which surfaces of the reference a triangle of the target stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BakeClass {
    /// Their materials.
    pub alpha: AlphaClass,
    /// Whether their vertex normals point to the back of their triangles.
    pub opposed: bool,
    /// Whether light passes through, so that their alpha is not that of the asset.
    pub see_through: bool,
}

impl From<AlphaClass> for BakeClass {
    /// Surfaces that are not glass and whose vertex normals are on the front.
    fn from(alpha: AlphaClass) -> Self {
        Self { alpha, opposed: false, see_through: false }
    }
}

/// How to bake.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BakeSettings {
    /// Columns of the maps, at most [`MAX_SIZE`].
    pub width: usize,
    /// Rows of the maps, at most [`MAX_SIZE`].
    pub height: usize,
    /// Samples of a texel are a grid of this many by as many, 1 to 8.
    pub samples_per_side: usize,
    /// Width of the box over which a texel's samples are spread, in texels. Below 1 it makes up for some of the blur
    /// of bilinear lookups.
    pub filter_width: f32,
    /// How far from the target the reference is searched at most, in diagonals of the reference's box.
    pub max_distance: f32,
    /// 0: rays along the smooth normal of the target; 1: along the face normal.
    pub face_normal: f32,
    /// Roughness is widened by the spread of the normals that a texel averages.
    pub widen_roughness: bool,
    /// Unlit surfaces become emission (base colour black, no specular reflection); otherwise they keep their colour.
    pub unlit_as_emission: bool,
    /// Where the occlusion comes from.
    pub occlusion: Occlusion,
}

impl Default for BakeSettings {
    fn default() -> Self {
        Self {
            width: 1024,
            height: 1024,
            samples_per_side: 2,
            filter_width: 0.75,
            max_distance: 0.04,
            face_normal: 0.0,
            widen_roughness: false,
            unlit_as_emission: true,
            occlusion: Occlusion::Maps,
        }
    }
}

/// What is baked onto.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    /// With normals, tangents and uvs inside of the unit square.
    pub mesh: &'a Mesh,
    /// Unit vectors along which to look, one per vertex; `None`: the normals. At creases these should be smoother than
    /// the normals, or what lies between the two sides is not seen.
    pub directions: Option<&'a [Vec3f]>,
    /// One per triangle, which then takes surfaces of that class alone.
    pub classes: Option<&'a [BakeClass]>,
}

impl<'a> Target<'a> {
    /// A mesh that takes surfaces of any class along its normals.
    pub fn new(mesh: &'a Mesh) -> Self {
        Self { mesh, directions: None, classes: None }
    }
}

/// Why a bake cannot be done.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BakeError {
    /// No triangles.
    #[error("the {what} has no triangles")]
    Empty {
        /// Which mesh.
        what: &'static str,
    },
    /// An array of the wrong length, or an absent one.
    #[error("{mesh}: {found} {what}, expected {expected}")]
    Length {
        /// Which mesh.
        mesh: &'static str,
        /// Which array.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The length it should have.
        expected: usize,
    },
    /// A value that is not finite.
    #[error("{mesh}: {what} of vertex {vertex} is not finite")]
    NonFinite {
        /// Which mesh.
        mesh: &'static str,
        /// Which attribute.
        what: &'static str,
        /// Index of the vertex.
        vertex: usize,
    },
    /// Positions or triangles that cannot be used.
    #[error("{mesh}: {source}")]
    Geometry {
        /// Which mesh.
        mesh: &'static str,
        /// What is wrong.
        source: AccelError,
    },
    /// A material that does not exist.
    #[error("reference: triangle {triangle} names material {material}, there are {materials}")]
    Material {
        /// Index of the triangle.
        triangle: usize,
        /// Its material.
        material: u32,
        /// Number of materials.
        materials: usize,
    },
    /// A setting out of range.
    #[error("{setting} is {value}: {rule}")]
    Setting {
        /// Name of the setting.
        setting: &'static str,
        /// Its value.
        value: f64,
        /// The rule that it breaks.
        rule: &'static str,
    },
    /// Stopped by the progress callback.
    #[error("baking was stopped")]
    Stopped,
}

/// How the samples found their surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BakeStatistics {
    /// Samples taken.
    pub samples: u64,
    /// Samples whose ray met a visible surface inside of the cage.
    pub by_ray: u64,
    /// Samples whose ray met one only between the cage and the largest distance.
    pub by_far_ray: u64,
    /// Samples that took the closest point of the reference.
    pub by_closest_point: u64,
    /// Samples that found nothing but surfaces hidden from outside.
    pub hidden: u64,
    /// Samples that met an alpha mask only where it is cut out.
    pub cut: u64,
    /// Samples that found nothing.
    pub missed: u64,
    /// Texels that a triangle of the atlas owns.
    pub covered_texels: u64,
    /// Texels with a baked surface.
    pub valid_texels: u64,
    /// Mean distance from the target to the surface found, in the asset's units.
    pub mean_distance: f64,
    /// Largest such distance.
    pub max_distance: f32,
}

impl BakeStatistics {
    /// Share of the samples that found no surface, in [0, 1].
    pub fn missed_share(&self) -> f64 {
        self.missed as f64 / self.samples.max(1) as f64
    }

    fn add(&mut self, o: &Self) {
        self.samples += o.samples;
        self.by_ray += o.by_ray;
        self.by_far_ray += o.by_far_ray;
        self.by_closest_point += o.by_closest_point;
        self.hidden += o.hidden;
        self.cut += o.cut;
        self.missed += o.missed;
        self.covered_texels += o.covered_texels;
        self.valid_texels += o.valid_texels;
        // A sum until the end.
        self.mean_distance += o.mean_distance;
        self.max_distance = self.max_distance.max(o.max_distance);
    }
}

/// The result of [`bake`].
#[derive(Clone, Debug)]
pub struct Baked {
    /// Linear base colour, alpha, roughness, metalness, tangent-space normal, emission.
    pub maps: Maps<f32>,
    /// Texels with a baked surface, row by row.
    pub valid: Vec<bool>,
    /// Texels that are wholly cut out by an alpha mask: alpha 0, the rest not baked.
    pub cut: Vec<bool>,
    /// How the samples fared.
    pub statistics: BakeStatistics,
}

impl Baked {
    /// Copies into each texel without a surface the nearest one that has, at most `reach` texels away (or all with
    /// `None`); alpha stays 0 where a mask cut everything out.
    pub fn fill(&mut self, reach: Option<u32>) {
        atlas::dilate(&mut self.maps.texels, &self.valid, self.maps.width, self.maps.height, reach);
        for (texel, _) in self.maps.texels.iter_mut().zip(&self.cut).filter(|(_, cut)| **cut) {
            texel[channel::ALPHA] = 0.0;
        }
    }
}

/// What [`bake`] writes into texels without a surface: white, rough, flat.
pub fn blank_texel() -> [f32; CHANNELS] {
    let mut texel = [0.0; CHANNELS];
    texel[channel::BASE_COLOR..channel::BASE_COLOR + 3].fill(1.0);
    texel[channel::ALPHA] = 1.0;
    texel[channel::ROUGHNESS] = 1.0;
    texel[channel::NORMAL + 2] = 1.0;
    texel[channel::OCCLUSION] = 1.0;
    texel
}

/// Bakes the surface of `reference` onto the atlas of `target`.
///
/// `visibility` holds one entry per triangle of the reference. `progress` is called with the finished share in [0, 1], from any thread, and may stop the bake. The result is the same for any
/// number of threads.
///
/// ```
/// use photofit_fit::bake::{BakeSettings, ReferenceSurface, Target, bake};
/// use photofit_fit::visibility::{VisibilitySettings, visibility};
/// use photofit_geometry::shapes;
/// use photofit_scalar::vec4;
/// use photofit_scene::{FlatScene, Material, Scene, SurfaceLibrary};
/// use std::ops::ControlFlow;
///
/// let scene = Scene { materials: vec![Material::clay()], ..Scene::default() };
/// let flat = FlatScene { mesh: shapes::icosphere(8), triangle_material: vec![0; 20 * 64] };
/// let surfaces = SurfaceLibrary::new(&scene);
/// let reference = ReferenceSurface::new(&flat, &scene.materials, &surfaces, &[])?;
/// let seen = visibility(&reference, &VisibilitySettings { rays: 100_000, ..Default::default() });
///
/// let mut target = shapes::quad_grid(1, 1);
/// target.positions.iter_mut().for_each(|p| *p = *p * 0.5 + photofit_scalar::vec3(0.0, 0.0, 0.9));
/// target.tangents = vec![vec4(1.0, 0.0, 0.0, 1.0); 4];
/// let settings = BakeSettings { width: 16, height: 16, max_distance: 0.2, ..Default::default() };
/// let baked = bake(&reference, &seen, &Target::new(&target), &settings, &|_| ControlFlow::Continue(()))?;
/// assert_eq!(baked.statistics.missed, 0);
/// assert_eq!(baked.maps.texels[0][..4], [0.5, 0.5, 0.5, 1.0]);
/// # Ok::<(), photofit_fit::bake::BakeError>(())
/// ```
///
/// # Errors
/// Wrong lengths, values that are not finite, settings out of range, or [`BakeError::Stopped`].
pub fn bake(
    reference: &ReferenceSurface<'_>,
    visibility: &Visibility,
    target: &Target<'_>,
    settings: &BakeSettings,
    progress: &(dyn Fn(f32) -> ControlFlow<()> + Sync),
) -> Result<Baked, BakeError> {
    check_settings(settings)?;
    let Target { mesh: target, classes, directions } = *target;
    target::check(target)?;
    let directions = directions.unwrap_or(&target.normals);
    let lengths = [
        ("directions", directions.len(), target.positions.len(), "target"),
        ("sides' visibility", visibility.front.len(), reference.mesh().triangles.len(), "reference"),
        ("sides' visibility", visibility.back.len(), reference.mesh().triangles.len(), "reference"),
        ("classes", classes.map_or(target.triangles.len(), <[_]>::len), target.triangles.len(), "target"),
    ];
    for (what, found, expected, mesh) in lengths {
        reference::attribute(mesh, what, found, expected, true)?;
    }
    let (width, height) = (settings.width, settings.height);
    let coverage = atlas::mesh_coverage(&target.uvs, &target.triangles, width, height, true);
    let limit = settings.max_distance * reference.diagonal();
    let selector = select::Selector { reference, visibility, limit };
    let cage = cage::measure(&selector, target, directions);
    let job =
        texel::Job { selector, target, directions, classes, settings, coverage: &coverage, cage: &cage };

    let mut baked = Baked {
        maps: Maps { width, height, texels: vec![blank_texel(); width * height] },
        valid: vec![false; width * height],
        cut: vec![false; width * height],
        statistics: BakeStatistics::default(),
    };
    let stopped = AtomicBool::new(false);
    let finished = AtomicUsize::new(0);
    let rows: Vec<BakeStatistics> = baked
        .maps
        .texels
        .par_chunks_mut(width)
        .zip(baked.valid.par_chunks_mut(width))
        .zip(baked.cut.par_chunks_mut(width))
        .enumerate()
        .map(|(y, ((texels, valid), cut))| {
            if stopped.load(Ordering::Relaxed) {
                return BakeStatistics::default();
            }
            let statistics = job.row(y, texels, valid, cut);
            let done = finished.fetch_add(1, Ordering::Relaxed) + 1;
            if progress(done as f32 / height as f32).is_break() {
                stopped.store(true, Ordering::Relaxed);
            }
            statistics
        })
        .collect();
    if stopped.into_inner() {
        return Err(BakeError::Stopped);
    }
    let total = &mut baked.statistics;
    rows.iter().for_each(|row| total.add(row));
    let found = total.by_ray + total.by_far_ray + total.by_closest_point + total.hidden;
    total.mean_distance /= found.max(1) as f64;
    Ok(baked)
}

fn check_settings(s: &BakeSettings) -> Result<(), BakeError> {
    let size = 1..=MAX_SIZE;
    let rays = match s.occlusion {
        Occlusion::Rays(rays) => rays,
        Occlusion::Maps | Occlusion::None => OcclusionRays::default(),
    };
    let rules = [
        ("width", s.width as f64, size.contains(&s.width), "must be 1 to 16384"),
        ("height", s.height as f64, size.contains(&s.height), "must be 1 to 16384"),
        (
            "samples_per_side",
            s.samples_per_side as f64,
            (1..=8).contains(&s.samples_per_side),
            "must be 1 to 8",
        ),
        (
            "filter_width",
            f64::from(s.filter_width),
            (0.0..=4.0).contains(&s.filter_width),
            "must lie in [0, 4]",
        ),
        (
            "max_distance",
            f64::from(s.max_distance),
            s.max_distance > 0.0 && s.max_distance <= 10.0,
            "must lie in (0, 10]",
        ),
        ("face_normal", f64::from(s.face_normal), (0.0..=1.0).contains(&s.face_normal), "must lie in [0, 1]"),
        ("occlusion rays", rays.rays as f64, (1..=65536).contains(&rays.rays), "must be 1 to 65536"),
        (
            "occlusion reach",
            f64::from(rays.reach),
            rays.reach > 0.0 && rays.reach <= 1e4,
            "must lie in (0, 10000]",
        ),
    ];
    for (setting, value, holds, rule) in rules {
        if !holds {
            return Err(BakeError::Setting { setting, value, rule });
        }
    }
    Ok(())
}
