//! A surface that is seen at moments of an animation: its maps are fitted, and its shape where it is asked for.
//!
//! The stages are those of [`Surface`] with two more between the shape and the pictures, where the shape is fitted: from
//! where vertices stand at rest, which are the parameters, back to the bind pose, and from there to the pose of a moment, by
//! the skins, morph targets and nodes of the written file. Where the shape stays, [`Animated`] says where the vertices are.

use super::animated::Animated;
use super::cpu::Chain;
use super::loss::PictureLoss;
use super::model::{Group, ModelError};
use super::surface::Surface;
use super::views::{Moment, Shot};
use crate::FitError;
use crate::candidate::{OrientedPoints, ParameterGradients, VertexSource, VertexStage, Vertices};
use photofit_geometry::Mesh;
use photofit_geometry::skinning::Deformation;
use photofit_optim::Optimizer;
use photofit_raster::deferred::Masks;
use photofit_scene::Scene;
use std::sync::Arc;

/// A surface with its poses.
#[derive(Clone, Debug)]
pub struct Posed<'a> {
    surface: Surface,
    animated: &'a Animated<'a>,
    /// From the shape at rest to the bind pose, where the shape is fitted.
    to_bind: Option<Arc<Deformation>>,
}

impl<'a> Posed<'a> {
    /// The surface of an asset with its poses, which have the same vertices and triangles. Where there is a way back to the
    /// bind pose ([`Animated::to_bind`]) its shape is fitted, else it stays.
    pub fn new(surface: Surface, animated: &'a Animated<'a>, to_bind: Option<Arc<Deformation>>) -> Self {
        Self { surface: surface.moving(to_bind.is_some()), animated, to_bind }
    }

    /// The surface with the present parameters.
    pub fn surface(&self) -> &Surface {
        &self.surface
    }

    pub(super) fn surface_mut(&mut self) -> &mut Surface {
        &mut self.surface
    }

    /// The vertices at a moment of the reference.
    ///
    /// # Errors
    /// A moment that the asset does not have, or that turns triangles inside out.
    pub fn vertices(&self, moment: Moment) -> Result<Vertices, FitError> {
        let candidate = &self.surface.candidate;
        let flat = self.animated.flat(moment)?;
        same_triangles(&candidate.triangles, &flat.mesh, moment)?;
        let Some(to_bind) = &self.to_bind else {
            return Ok(candidate.vertices_of(OrientedPoints::of(&flat.mesh)));
        };
        Ok(candidate.vertices_through(&[&**to_bind, &*self.animated.deformation(moment)?]))
    }

    /// Puts the shape in place of the bind pose of the asset, where it is fitted.
    pub fn write_shape(&self, asset: &mut Scene) {
        if let Some(to_bind) = &self.to_bind {
            let OrientedPoints { positions, normals } = to_bind.forward(&self.surface.candidate.shape());
            asset.set_bind_vertices(&positions, &normals);
        }
    }

    /// What `of` says of each shot.
    fn all<T>(
        &self,
        shots: &[Shot],
        of: impl Fn(Moment) -> Result<T, FitError>,
    ) -> Result<Vec<T>, ModelError> {
        let one = |shot: &Shot| of(shot.moment).map_err(|e| ModelError::Picture(Box::new(e)));
        shots.iter().map(one).collect()
    }
}

/// That the triangles of a moment are those at rest.
///
/// # Errors
/// A node with a mirroring scale turns them inside out.
pub(crate) fn same_triangles(rest: &[[u32; 3]], at: &Mesh, moment: Moment) -> Result<(), FitError> {
    if at.triangles == rest {
        return Ok(());
    }
    let rule = format!("at {} s turns triangles inside out; it must not", moment.time);
    Err(FitError::Setting { field: "moment", rule })
}

impl Chain for Posed<'_> {
    type Gradients = ParameterGradients;

    fn groups(&self) -> Vec<Group> {
        self.surface.groups()
    }

    fn optimizer(&self, group: &Group) -> Result<Optimizer<f32>, FitError> {
        self.surface.optimizer(group)
    }

    fn guide(&self, group: usize) -> Vec<f32> {
        self.surface.guide(group)
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
        let passes = self.surface.moving_passes(moving);
        let candidate = &self.surface.candidate;
        let Some(to_bind) = self.to_bind.as_deref() else {
            let vertices = self.all(shots, |m| self.vertices(m))?;
            let given = |i: usize| VertexSource::Given(&vertices[i]);
            return Ok(candidate.step_at(shots, given, loss, &passes, gradients));
        };
        let poses = self.all(shots, |m| self.animated.deformation(m))?;
        let stages: Vec<[&dyn VertexStage<f32>; 2]> =
            poses.iter().map(|p| [to_bind as _, &**p as _]).collect();
        Ok(candidate.step_at(shots, |i| VertexSource::Stages(&stages[i]), loss, &passes, gradients))
    }

    fn pictures(&self, shots: &[Shot]) -> Result<Vec<Vec<[f32; 4]>>, ModelError> {
        let vertices = self.all(shots, |m| self.vertices(m))?;
        let picture = |(shot, v)| self.surface.candidate.render(v, shot, &self.surface.passes).color;
        Ok(shots.iter().zip(&vertices).map(picture).collect())
    }
}
