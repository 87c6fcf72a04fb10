//! A level that becomes the next one: a morph target that moves its vertices onto the surface of the next level.
//!
//! Geomorphs (`hoppe1996`, `hoppe1997`): a viewer raises the weight of the target from 0 to 1 while the asset
//! shrinks towards the size of the switch, where the next level takes over without a jump of its shape. Vertices keep their texture
//! coordinates: what the textures of both levels differ in still changes at the switch.

mod correspondence;
mod surface;

use crate::FitError;
use crate::bake::ReferenceSurface;
use crate::bake::reference::SurfacePoint;
use crate::engine::judge::Popping;
use correspondence::{correspondence, flat, turned};
use glam::Quat;
use photofit_rays::NearestPoint;
use photofit_scalar::{Vec3f, vec3};
use photofit_scene::{Bind, FlatScene, MorphTarget, Scene, SurfaceLibrary};
use rayon::prelude::*;
use serde_json::{Value, json};
use std::sync::Arc;
use surface::{Surface, accel};

/// Pixels by which the moved surface may miss corners and edges of the next level at the size of the switch.
pub(super) const TOLERANCE: f64 = 0.25;
/// Normals of vertices are compared as textures show them over so many lengths of an edge.
const NORMAL_WIDTH: f32 = 0.5;
/// Each side of a triangle is divided in so many where distances are measured.
const SAMPLES: usize = 4;

/// How a level becomes the next one.
#[derive(Clone, Debug, PartialEq)]
pub struct Blend {
    /// Name of the morph target: the next level's.
    pub target: String,
    /// Sizes on screen, pixels, at which the weight of the target is 0 and 1: that of the level and that of the switch. In between it is
    /// linear in the logarithm of the size.
    pub sizes: [f64; 2],
    /// Whether the target moves normals, too: where the pictures at the switch change less with it.
    pub normals: bool,
    /// Change to the next level at the size of the switch, from weight 1.
    pub popping: Popping,
    /// How far the surface is from the next level's, as it is: weight 0.
    pub before: SurfaceDistance,
    /// The same at weight 1.
    pub after: SurfaceDistance,
    /// Triangles whose normals turn by more than 90 degrees on the way and that have an area at its end.
    pub turned: usize,
    /// Triangles that lose their area on the way.
    pub flattened: usize,
}

/// How far two surfaces are from each other, as shares of the diagonal of the level's box.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SurfaceDistance {
    /// Largest distance from the level to the next, of 15 points a triangle.
    pub largest: f64,
    /// Mean distance from the level to the next, by area.
    pub mean: f64,
    /// Largest distance from the next level to this one, of as many.
    pub largest_back: f64,
    /// Mean distance from the next level to this one, by area.
    pub mean_back: f64,
}

/// What moves a level onto the next one.
struct Moves {
    /// One for each primitive of the level.
    targets: Vec<MorphTarget>,
    before: SurfaceDistance,
    after: SurfaceDistance,
    turned: usize,
    flattened: usize,
}

/// The level `fine` with a morph target `name` that turns it into `coarse`, which takes over at the last of `sizes`. Corners that are
/// missed by more than `tolerance` are drawn towards; `popping` compares a level with `coarse` there.
///
/// # Errors
/// Geometry that cannot be ray cast, and those of `popping`.
pub(super) fn blend(
    (fine, coarse): (&Scene, &Scene),
    name: &str,
    sizes: [f64; 2],
    tolerance: f32,
    popping: &dyn Fn(&Scene) -> Result<Popping, FitError>,
) -> Result<(Scene, Blend), FitError> {
    let mut moves = moves(fine, coarse, tolerance)?;
    let turning = with_target(fine, &moves, name);
    moves.targets.iter_mut().for_each(|t| t.normals.clear());
    let moving = with_target(fine, &moves, name);
    // Where normal maps show the asset's normals on both levels, turning those of vertices would spoil them.
    let (with, without) = (popping(&weighted(&turning, 1.0))?, popping(&weighted(&moving, 1.0))?);
    let normals = with.flip < without.flip;
    let Moves { before, after, turned, flattened, .. } = moves;
    let (scene, popping) = if normals { (turning, with) } else { (moving, without) };
    let target = name.to_owned();
    Ok((scene, Blend { target, sizes, normals, popping, before, after, turned, flattened }))
}

/// A written level: each primitive stands once, where it is.
struct Sided {
    flat: FlatScene,
    library: SurfaceLibrary,
}

impl Sided {
    fn new(scene: &Scene) -> Self {
        Self { flat: scene.flatten(), library: SurfaceLibrary::new(scene) }
    }

    fn shaded<'a>(&'a self, scene: &'a Scene) -> Result<ReferenceSurface<'a>, FitError> {
        Ok(ReferenceSurface::new(&self.flat, &scene.materials, &self.library, &[])?)
    }
}

/// Moves the written level `fine` onto the next one.
fn moves(fine: &Scene, coarse: &Scene, tolerance: f32) -> Result<Moves, FitError> {
    let [a, b] = [fine, coarse].map(Sided::new);
    let mut names = Vec::new();
    let (from, onto) = (Surface::new(fine, &a.flat, &mut names)?, Surface::new(coarse, &b.flat, &mut names)?);
    let to = correspondence(&from, &onto, tolerance)?;
    let (shaded, next) = (a.shaded(fine)?, b.shaded(coarse)?);
    let apart = |positions: &[Vec3f]| {
        let scale = 1.0 / f64::from(shaded.diagonal());
        let (largest, mean) = distance((positions, &from.triangles), &onto.accel);
        let back = accel(positions, &from.triangles)?;
        let (largest_back, mean_back) = distance((&onto.positions, &onto.triangles), &back);
        Ok::<_, FitError>(SurfaceDistance {
            largest: largest * scale,
            mean: mean * scale,
            largest_back: largest_back * scale,
            mean_back: mean_back * scale,
        })
    };
    let ends = |t: &&[u32; 3]| !flat(&from.positions, t);
    Ok(Moves {
        before: apart(&from.positions)?,
        after: apart(&to)?,
        turned: from.triangles.iter().filter(|t| turned(&from.positions, &to, t)).count(),
        flattened: from.triangles.iter().filter(ends).filter(|t| flat(&to, t)).count(),
        targets: targets(fine, (&from, &shaded), (&onto, &next), &to),
    })
}

/// Largest and mean distance from a surface to another one.
fn distance((positions, triangles): (&[Vec3f], &[[u32; 3]]), to: &photofit_rays::Accel) -> (f64, f64) {
    let of = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| positions[v as usize]);
        let area = f64::from((b - a).cross(c - a).length());
        let (mut largest, mut sum, mut count) = (0.0_f64, 0.0, 0.0);
        for i in 0..=SAMPLES {
            for j in 0..=SAMPLES - i {
                let [u, v] = [i, j].map(|k| k as f32 / SAMPLES as f32);
                let p = a * (1.0 - u - v) + b * u + c * v;
                let d = to.closest_point(p, f32::INFINITY).map_or(0.0, |at| f64::from(at.distance));
                (largest, sum, count) = (largest.max(d), sum + d, count + 1.0);
            }
        }
        (largest, area * sum / count, area)
    };
    let all: Vec<(f64, f64, f64)> = triangles.par_iter().map(of).collect();
    let (largest, sum, area) =
        all.iter().fold((0.0_f64, 0.0, 0.0), |s, x| (s.0.max(x.0), s.1 + x.1, s.2 + x.2));
    (largest, if area > 0.0 { sum / area } else { 0.0 })
}

/// The morph target of each primitive of `scene`.
fn targets(
    scene: &Scene,
    (from, shaded): (&Surface, &ReferenceSurface<'_>),
    (onto, next): (&Surface, &ReferenceSurface<'_>),
    to: &[Vec3f],
) -> Vec<MorphTarget> {
    let mut out = vec![MorphTarget::default(); scene.primitives.len()];
    let mut first = 0;
    for instance in &scene.instances {
        let mesh = &scene.primitives[instance.primitive].mesh;
        let (mut triangle, n) = (vec![None; mesh.positions.len()], mesh.triangles.len());
        for (t, corners) in mesh.triangles.iter().enumerate().rev() {
            for (k, v) in corners.iter().enumerate() {
                triangle[*v as usize] = Some((first + t, k));
            }
        }
        let moved = |v: usize| {
            let Some((t, k)) = triangle[v] else { return (Vec3f::zero(), Vec3f::zero()) };
            let id = from.triangles[t][k] as usize;
            let at = SurfacePoint::corner(t as u32, k);
            let width = NORMAL_WIDTH * edge(from, t);
            let normal = mesh.normals.get(v).copied().unwrap_or_else(|| shaded.smooth_normal(&at));
            let shown = shaded.shade(&at, width).normal;
            let wanted = facing(onto, to[id], normal).map_or(shown, |at| next.shade(&at, width).normal);
            let turn = Quat::from_rotation_arc(unit(shown), unit(wanted));
            let [x, y, z] = (turn * glam::Vec3::from_array(normal.to_array())).to_array();
            (to[id] - from.positions[id], vec3(x, y, z) - normal)
        };
        let moved: Vec<(Vec3f, Vec3f)> = (0..mesh.positions.len()).into_par_iter().map(moved).collect();
        let target = &mut out[instance.primitive];
        (target.positions, target.normals) = moved.into_iter().unzip();
        first += n;
    }
    out
}

fn unit(v: Vec3f) -> glam::Vec3 {
    glam::Vec3::from_array(v.to_array()).try_normalize().unwrap_or(glam::Vec3::Y)
}

/// Mean length of the edges of a triangle.
fn edge(surface: &Surface, t: usize) -> f32 {
    let [a, b, c] = surface.triangles[t].map(|v| surface.positions[v as usize]);
    ((b - a).length() + (c - b).length() + (a - c).length()) / 3.0
}

/// The place of the next level at `p`; of several, one that faces as `normal` does.
fn facing(onto: &Surface, p: Vec3f, normal: Vec3f) -> Option<SurfacePoint> {
    let nearest = onto.accel.closest_point(p, f32::INFINITY)?;
    let close = nearest.distance + 1e-5 * onto.scale();
    let alike = |at: &NearestPoint| onto.face[at.triangle as usize].dot(normal) > 0.5;
    let at = onto.accel.closest_point_where(p, close, alike).unwrap_or(nearest);
    Some(SurfacePoint { triangle: at.triangle, u: at.u, v: at.v })
}

/// The level with the morph target `name`.
fn with_target(level: &Scene, moves: &Moves, name: &str) -> Scene {
    let mut scene = level.clone();
    if let Some(hierarchy) = scene.hierarchy.as_mut().map(Arc::make_mut) {
        for mesh in &mut hierarchy.meshes {
            for part in &mut mesh.primitives {
                part.bind = Some(Bind {
                    mesh: scene.primitives[part.primitive].mesh.clone(),
                    influences: Vec::new(),
                    targets: vec![moves.targets[part.primitive].clone()],
                });
            }
            mesh.weights = vec![0.0];
            let mut extras = mesh.extras.take().filter(Value::is_object).unwrap_or_else(|| json!({}));
            extras["targetNames"] = json!([name]);
            mesh.extras = Some(extras);
        }
    }
    scene
}

/// The level as it looks under a weight of its morph target.
pub fn weighted(level: &Scene, weight: f32) -> Scene {
    let mut scene = level.clone();
    if let Some(hierarchy) = scene.hierarchy.as_mut().map(Arc::make_mut) {
        let moving = hierarchy.meshes.iter_mut().filter(|mesh| mesh.targets() > 0);
        moving.for_each(|mesh| mesh.weights = vec![weight]);
    }
    let pose = scene.pose(None, 0.0);
    scene.set_pose(pose);
    scene
}

#[cfg(test)]
mod tests;
