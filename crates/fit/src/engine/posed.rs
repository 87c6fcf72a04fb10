//! A surface that is seen at moments of an animation: its maps are fitted, its vertices are those of the pose.
//!
//! The stages are those of [`Surface`] but for the first: what the shape does is not a parameter, [`Animated`] says it.

use super::animated::Animated;
use super::cpu::Chain;
use super::loss::PictureLoss;
use super::model::{Group, ModelError};
use super::surface::Surface;
use super::views::{Moment, Shot};
use crate::FitError;
use crate::candidate::{ParameterGradients, Vertices};
use photofit_optim::Optimizer;
use photofit_raster::deferred::Masks;

/// A surface with its poses.
#[derive(Clone, Debug)]
pub struct Posed<'a> {
    surface: Surface,
    animated: &'a Animated<'a>,
}

impl<'a> Posed<'a> {
    /// The surface of an asset with its poses, which have the same vertices and triangles.
    pub fn new(surface: Surface, animated: &'a Animated<'a>) -> Self {
        // Poses pass no gradients to positions.
        Self { surface: surface.moving(false), animated }
    }

    /// The surface with the present maps.
    pub fn surface(&self) -> &Surface {
        &self.surface
    }

    pub(super) fn surface_mut(&mut self) -> &mut Surface {
        &mut self.surface
    }

    /// The vertices at a moment of the reference.
    ///
    /// # Errors
    /// A moment that the asset does not have; a pose that turns triangles inside out.
    pub fn vertices(&self, moment: Moment) -> Result<Vertices, FitError> {
        let flat = self.animated.flat(moment)?;
        let candidate = &self.surface.candidate;
        if flat.mesh.triangles != candidate.triangles {
            let rule = format!("at {} s turns triangles inside out; it must not", moment.time);
            return Err(FitError::Setting { field: "moment", rule });
        }
        Ok(candidate.posed_vertices(flat.mesh.positions.clone(), flat.mesh.normals.clone()))
    }

    fn all(&self, shots: &[Shot]) -> Result<Vec<Vertices>, ModelError> {
        let one = |shot: &Shot| self.vertices(shot.moment).map_err(|e| ModelError::Picture(Box::new(e)));
        shots.iter().map(one).collect()
    }
}

impl Chain for Posed<'_> {
    type Gradients = ParameterGradients;

    fn groups(&self) -> Vec<Group> {
        self.surface.groups()
    }

    fn optimizer(&self, group: &Group) -> Result<Optimizer<f32>, FitError> {
        self.surface.optimizer(group)
    }

    fn step_masks(&mut self, masks: Masks) {
        self.surface.step_masks(masks);
    }

    fn values(&self, group: usize) -> &[f32] {
        self.surface.values(group)
    }

    fn values_mut(&mut self, group: usize) -> &mut [f32] {
        self.surface.values_mut(group)
    }

    fn changed(&mut self, group: usize) -> Result<(), ModelError> {
        self.surface.changed(group)
    }

    fn gradients(&self) -> ParameterGradients {
        self.surface.gradients()
    }

    fn moved<'b>(
        &'b mut self,
        gradients: &'b ParameterGradients,
        group: usize,
    ) -> (&'b mut [f32], &'b [f32]) {
        self.surface.moved(gradients, group)
    }

    fn step(
        &self,
        shots: &[Shot],
        loss: PictureLoss,
        moving: &[bool],
        gradients: &mut ParameterGradients,
    ) -> Result<f64, ModelError> {
        let vertices = self.all(shots)?;
        let passes = self.surface.moving_passes(moving);
        Ok(self.surface.candidate.step_at(shots, |i| Some(&vertices[i]), loss, &passes, gradients))
    }

    fn pictures(&self, shots: &[Shot]) -> Result<Vec<Vec<[f32; 4]>>, ModelError> {
        let vertices = self.all(shots)?;
        let picture = |(shot, v)| self.surface.candidate.render(v, shot, &self.surface.passes).color;
        Ok(shots.iter().zip(&vertices).map(picture).collect())
    }
}
