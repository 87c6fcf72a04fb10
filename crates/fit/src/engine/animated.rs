//! An animated asset at the asked moment: what references of both renderers draw where a view names one.
//!
//! All moments share the frame of a fit; [`super::reference::Reference::bounds`] says where the asset is at a moment. Skins,
//! morph targets and moving nodes are those of [`Scene::pose`]. An asset that is never asked for a moment is not copied.

use super::asset::Normalised;
use super::frame::FitFrame;
use super::views::{Moment, Sphere};
use crate::FitError;
use photofit_pathtrace::{Instance, Parts, Shape};
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
        if let Some((_, flat)) = state.kept.iter().find(|k| k.0 == moment) {
            return Ok(flat.clone());
        }
        let mut flat = state.pose(self.scene, moment).1.flatten();
        for p in &mut flat.mesh.positions {
            *p = self.frame.to_frame(*p);
        }
        let flat = Arc::new(flat);
        if state.kept.len() == KEPT {
            state.kept.pop_front();
        }
        state.kept.push_back((moment, flat.clone()));
        Ok(flat)
    }

    /// The shapes that the animations deform and all instances at a moment, in the frame of the fit, as
    /// [`photofit_pathtrace::World::set_pose`] takes them.
    pub(super) fn parts(&self, moment: Moment) -> Result<WorldPose, FitError> {
        let moment = self.own(moment)?;
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let (deformed, scene) = state.pose(self.scene, moment);
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

impl State {
    /// Poses the scene; also the primitives that may have been deformed.
    fn pose(&mut self, scene: &Scene, moment: Moment) -> (Vec<usize>, &Scene) {
        // Without images: geometry alone is read.
        let posed = self.posed.get_or_insert_with(|| Scene {
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
}

#[cfg(test)]
pub(crate) mod arm;
#[cfg(test)]
mod tests;
