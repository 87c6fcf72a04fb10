//! An animated asset at the asked moment: what references of both renderers draw where a view names one.
//!
//! All moments share the frame of a fit; [`super::reference::Reference::bounds`] says where the asset is at a moment. Skins,
//! morph targets and moving nodes are those of [`Scene::pose`]. An asset that is never asked for a moment is not copied.

use super::asset::Normalised;
use super::frame::FitFrame;
use super::views::{Moment, Sphere};
use crate::FitError;
use photofit_geometry::opposed;
use photofit_geometry::skinning::{Affine, Deformation};
use photofit_pathtrace::{Instance, Parts, Shape};
use photofit_scalar::Vec3;
use photofit_scene::{FlatScene, Scene};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

/// Moments whose geometry is kept.
const KEPT: usize = 8;

/// The geometry of an animated asset at its moments, in the frame of a fit.
#[derive(Debug)]
pub struct Animated<'a> {
    scene: &'a Scene,
    frame: FitFrame,
    /// The asset's own animation for each that moments name; `None`: they name its own.
    plays: Option<Vec<Option<usize>>>,
    state: Mutex<State>,
}

/// What a pose changes of a [`photofit_pathtrace::World`].
pub(super) struct WorldPose {
    /// Deformed shapes with their indices.
    pub(super) shapes: Vec<(usize, Shape)>,
    /// All instances.
    pub(super) instances: Vec<Instance>,
}

#[derive(Debug, Default)]
struct State {
    /// The scene in the pose asked for last.
    posed: Option<Scene>,
    kept: VecDeque<(Moment, Arc<FlatScene>)>,
    /// What moments do to the vertices of the bind pose.
    poses: VecDeque<(Moment, Arc<Deformation>)>,
}

/// What is kept of a moment, or made and kept in place of what was kept first.
fn keep<T>(
    kept: &mut VecDeque<(Moment, Arc<T>)>,
    moment: Moment,
    make: impl FnOnce() -> Result<T, FitError>,
) -> Result<Arc<T>, FitError> {
    if let Some((_, found)) = kept.iter().find(|k| k.0 == moment) {
        return Ok(found.clone());
    }
    let made = Arc::new(make()?);
    if kept.len() == KEPT {
        kept.pop_front();
    }
    kept.push_back((moment, made.clone()));
    Ok(made)
}

impl<'a> Animated<'a> {
    /// A scene in the frame of `n`; it moves where it has animations.
    pub fn new(scene: &'a Scene, n: &Normalised) -> Self {
        Self::in_frame(scene, n.frame())
    }

    /// A scene in a frame.
    pub(super) fn in_frame(scene: &'a Scene, frame: FitFrame) -> Self {
        Self { scene, frame, plays: None, state: Mutex::default() }
    }

    /// The same for moments of another asset, whose animations have these names: each is played by the first of this name,
    /// and one without a name by that of the same index.
    #[must_use]
    pub fn playing(self, names: &[String]) -> Self {
        let own = self.scene.hierarchy.as_deref();
        let played = |(index, name): (usize, &String)| match name.as_str() {
            "" => Some(index).filter(|i| own.is_some_and(|h| *i < h.animations.len())),
            name => own.and_then(|h| h.animation(name)),
        };
        Self { plays: Some(names.iter().enumerate().map(played).collect()), ..self }
    }

    /// Whether the asset has what moments of this animation ask for.
    pub fn plays(&self, animation: usize) -> bool {
        self.own(Moment { animation: Some(animation), time: 0.0 }).is_ok()
    }

    /// `count` moments of an animation, evenly spread over it, its two ends included.
    ///
    /// # Panics
    /// If there is no such animation.
    pub fn moments(&self, animation: usize, count: usize) -> Vec<Moment> {
        let duration = self.scene.hierarchy.as_ref().map_or(0.0, |h| h.animations[animation].duration());
        let step = duration / count.saturating_sub(1).max(1) as f32;
        (0..count).map(|k| Moment { animation: Some(animation), time: k as f32 * step }).collect()
    }

    /// The asset's own moment for one that is asked for.
    fn own(&self, asked: Moment) -> Result<Moment, FitError> {
        let moment = match (&self.plays, asked.animation) {
            (Some(plays), Some(index)) => match plays.get(index).copied().flatten() {
                Some(own) => Moment { animation: Some(own), ..asked },
                None => {
                    let name = if self.scene.name.is_empty() { "the asset" } else { &self.scene.name };
                    let rule =
                        format!("is in animation {index} of the reference; {name} must have it, by name");
                    return Err(FitError::Setting { field: "moment", rule });
                }
            },
            _ => asked,
        };
        check(self.scene, moment)?;
        Ok(moment)
    }

    /// The asset at a moment as one mesh in the frame of the fit.
    ///
    /// # Errors
    /// A moment that the asset does not have.
    pub fn flat(&self, moment: Moment) -> Result<Arc<FlatScene>, FitError> {
        let moment = self.own(moment)?;
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let State { posed, kept, .. } = &mut *state;
        keep(kept, moment, || {
            let mut flat = pose(posed, self.scene, moment).1.flatten();
            flat.mesh.positions.iter_mut().for_each(|p| *p = self.frame.to_frame(*p));
            Ok(flat)
        })
    }

    /// What a moment does to the vertices of [`Self::flat`]: from their bind pose to the frame of the fit.
    ///
    /// # Errors
    /// A moment that the asset does not have, or that turns triangles inside out; an asset without normals (see
    /// [`Scene::deformation`]).
    pub fn deformation(&self, moment: Moment) -> Result<Arc<Deformation>, FitError> {
        let moment = self.own(moment)?;
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        keep(&mut state.poses, moment, || {
            let mut deformation = self.scene.deformation(moment.animation, moment.time).map_err(unfit)?;
            let frame = self.to_frame();
            let moves = &mut deformation.moves;
            moves.iter_mut().for_each(|m| *m = m.cast::<f64>().then(&frame).cast());
            Ok(deformation)
        })
    }

    /// The way of vertices from where they stand at rest, in the frame of the fit, back to the bind pose: what
    /// [`Self::deformation`] makes of its results is where they stand at a moment.
    ///
    /// # Errors
    /// If they cannot be moved there (see [`Scene::check_bind_vertices`]), the pose at rest flattens some, morph targets add
    /// to its normals, or these point to the back of triangles: normals of a fitted shape are those of its front.
    pub fn to_bind(&self) -> Result<Arc<Deformation>, FitError> {
        self.scene.check_bind_vertices().map_err(unfit)?;
        let Moment { animation, time } = Moment::default();
        let rest = self.scene.deformation(animation, time).map_err(unfit)?;
        // Only the direction of a normal at rest is known, from which a sum of vectors cannot be taken off.
        if rest.normals.iter().any(|added| *added != Vec3::zero()) {
            return Err(unfit("has morph targets that change its normals where it stands at rest".into()));
        }
        let frame = self.to_frame();
        let back = |(v, m): (usize, &Affine)| {
            let added: Vec3<f64> = rest.positions.get(v).map_or(Vec3::zero(), |d| d.cast());
            let inverse = m.cast::<f64>().then(&frame).inverse()?;
            Some(Affine { translation: inverse.translation - added, ..inverse }.cast())
        };
        let moves: Option<Vec<Affine>> = rest.moves.iter().enumerate().map(back).collect();
        let moves = moves.ok_or_else(|| unfit("is flat where it stands at rest".into()))?;
        let backs = opposed(&self.flat(Moment::default())?.mesh).into_iter().filter(|o| *o).count();
        if backs > 0 {
            return Err(unfit(format!("has vertex normals that point to the back of {backs} triangles")));
        }
        Ok(Arc::new(Deformation { moves, ..Deformation::default() }))
    }

    /// The map from the world to the frame of the fit.
    fn to_frame(&self) -> Affine<f64> {
        let frame = self.frame.transform();
        let column = |c: glam::DVec3| Vec3::from_array(c.to_array());
        let m = frame.matrix3;
        Affine { axes: [m.x_axis, m.y_axis, m.z_axis].map(column), translation: column(frame.translation) }
    }

    /// The shapes that the animations deform and all instances at a moment, in the frame of the fit, as
    /// [`photofit_pathtrace::World::set_pose`] takes them.
    pub(super) fn parts(&self, moment: Moment) -> Result<WorldPose, FitError> {
        let moment = self.own(moment)?;
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let (deformed, scene) = pose(&mut state.posed, self.scene, moment);
        let shape = |i| (i, Shape::Mesh(scene.complete_mesh(i).into_owned()));
        let shapes = deformed.into_iter().map(shape).collect();
        let frame = self.frame.transform();
        let mut instances = Parts::instances_of(scene);
        instances.iter_mut().for_each(|i| i.transform = frame * i.transform);
        Ok(WorldPose { shapes, instances })
    }

    /// A sphere around the asset at a moment; the unit sphere where it has no extent then, or there is no such moment.
    pub(super) fn bounds(&self, moment: Moment) -> Sphere {
        let found = self.flat(moment).ok().and_then(|flat| FitFrame::around(&[&flat.mesh]));
        found.map_or(Sphere::UNIT, |f| Sphere { center: f.center, radius: f.radius })
    }
}

/// Why the shape of an asset cannot be fitted.
fn unfit(rule: String) -> FitError {
    FitError::Setting { field: "light_asset", rule: format!("{rule}; its shape cannot be fitted") }
}

/// Whether a scene has a moment.
fn check(scene: &Scene, moment: Moment) -> Result<(), FitError> {
    let count = scene.hierarchy.as_ref().map_or(0, |h| h.animations.len());
    let fail = |rule| Err(FitError::Setting { field: "moment", rule });
    match moment.animation {
        Some(a) if a >= count => fail(format!("names animation {a}; the asset has {count}")),
        _ if !moment.time.is_finite() => fail(format!("is at {} s; its time must be finite", moment.time)),
        _ => Ok(()),
    }
}

/// Poses a scene, in a copy of its own; also the primitives that may have been deformed.
fn pose<'s>(posed: &'s mut Option<Scene>, scene: &Scene, moment: Moment) -> (Vec<usize>, &'s Scene) {
    // Without images: geometry alone is read.
    let posed = posed.get_or_insert_with(|| Scene {
        primitives: scene.primitives.clone(),
        instances: scene.instances.clone(),
        materials: scene.materials.clone(),
        cameras: scene.cameras.clone(),
        lights: scene.lights.clone(),
        hierarchy: scene.hierarchy.clone(),
        ..Scene::default()
    });
    let pose = posed.pose(moment.animation, moment.time);
    let deformed = pose.meshes.iter().map(|m| m.0).collect();
    posed.set_pose(pose);
    (deformed, posed)
}

#[cfg(test)]
pub(crate) mod arm;
#[cfg(test)]
mod tests;
