//! An animated asset at the asked moment: what references of both renderers draw where a view names one.
//!
//! All moments share the frame of the asset as it stands; [`super::reference::Reference::bounds`] says where the asset is
//! at a moment. Skins, morph targets and moving nodes are those of [`Scene::pose`].

use super::asset::{Normalised, bounding_sphere};
use super::views::{Moment, Sphere};
use crate::FitError;
use photofit_pathtrace::{Instance, Parts, Shape};
use photofit_scalar::Vec3f;
use photofit_scene::{FlatScene, Scene};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

/// Moments whose geometry is kept.
const KEPT: usize = 8;

/// The geometry of an animated asset at its moments, in the frame of a fit.
#[derive(Debug)]
pub struct Animated<'a> {
    n: &'a Normalised,
    /// Durations of the animations, seconds.
    durations: Vec<f32>,
    state: Mutex<State>,
}

/// What a pose changes of a [`photofit_pathtrace::World`].
pub(super) struct Posed {
    /// Deformed shapes with their indices.
    pub(super) shapes: Vec<(usize, Shape)>,
    /// All instances.
    pub(super) instances: Vec<Instance>,
}

#[derive(Debug)]
struct State {
    /// Without images: geometry alone is read.
    scene: Scene,
    kept: VecDeque<(Moment, Arc<FlatScene>)>,
}

impl<'a> Animated<'a> {
    /// The animations of a scene whose frame is `n`; `None` where it has none.
    pub fn new(scene: &Scene, n: &'a Normalised) -> Option<Self> {
        let durations: Vec<f32> =
            scene.hierarchy.as_deref()?.animations.iter().map(|a| a.duration()).collect();
        if durations.is_empty() {
            return None;
        }
        let scene = Scene {
            primitives: scene.primitives.clone(),
            instances: scene.instances.clone(),
            materials: scene.materials.clone(),
            cameras: scene.cameras.clone(),
            lights: scene.lights.clone(),
            hierarchy: scene.hierarchy.clone(),
            ..Scene::default()
        };
        Some(Self { n, durations, state: Mutex::new(State { scene, kept: VecDeque::new() }) })
    }

    /// `count` moments of an animation, evenly spread over it, its two ends included.
    ///
    /// # Panics
    /// If there is no such animation.
    pub fn moments(&self, animation: usize, count: usize) -> Vec<Moment> {
        let step = self.durations[animation] / count.saturating_sub(1).max(1) as f32;
        (0..count).map(|k| Moment { animation: Some(animation), time: k as f32 * step }).collect()
    }

    fn check(&self, moment: Moment) -> Result<(), FitError> {
        let count = self.durations.len();
        let fail = |rule| Err(FitError::Setting { field: "moment", rule });
        match moment.animation {
            Some(a) if a >= count => fail(format!("names animation {a}; the asset has {count}")),
            Some(_) if !moment.time.is_finite() => {
                fail(format!("is at {} s; its time must be finite", moment.time))
            }
            _ => Ok(()),
        }
    }

    /// The asset at a moment as one mesh in the frame of the fit.
    pub(super) fn flat(&self, moment: Moment) -> Result<Arc<FlatScene>, FitError> {
        self.check(moment)?;
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, flat)) = state.kept.iter().find(|k| k.0 == moment) {
            return Ok(flat.clone());
        }
        state.pose(moment);
        let mut flat = state.scene.flatten();
        for p in &mut flat.mesh.positions {
            *p = (*p - self.n.center) / self.n.radius;
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
    pub(super) fn parts(&self, moment: Moment) -> Result<Posed, FitError> {
        self.check(moment)?;
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let deformed = state.pose(moment);
        let shape = |i| (i, Shape::Mesh(state.scene.complete_mesh(i).into_owned()));
        let shapes = deformed.into_iter().map(shape).collect();
        let frame = self.n.to_frame();
        let mut instances = Parts::instances_of(&state.scene);
        instances.iter_mut().for_each(|i| i.transform = frame * i.transform);
        Ok(Posed { shapes, instances })
    }

    /// A sphere around the asset at a moment; the unit sphere where it has no extent then, or there is no such moment.
    pub(super) fn bounds(&self, moment: Moment) -> Sphere {
        let found = self.flat(moment).ok().and_then(|flat| bounding_sphere(&flat.mesh));
        found.map_or(Sphere::UNIT, |(center, radius): (Vec3f, f32)| Sphere { center, radius })
    }
}

impl State {
    /// Poses the scene; returns the primitives that may have been deformed.
    fn pose(&mut self, moment: Moment) -> Vec<usize> {
        let pose = self.scene.pose(moment.animation, moment.time);
        let deformed = pose.meshes.iter().map(|m| m.0).collect();
        self.scene.set_pose(pose);
        deformed
    }
}

#[cfg(test)]
mod tests;
