//! The stages from the shape to the vertices of a picture: positions and normals go through a list of them, their gradients
//! through the same list reversed. Without any a picture shows the shape as it stands.

use photofit_geometry::Mesh;
use photofit_geometry::skinning::Deformation;
use photofit_scalar::{Real, Vec3};
use std::fmt::Debug;

/// Oriented points: positions and unit normals, one of each per vertex; or their gradients.
#[derive(Clone, Debug, Default)]
pub struct OrientedPoints<T = f32> {
    /// Positions.
    pub positions: Vec<Vec3<T>>,
    /// Unit normals.
    pub normals: Vec<Vec3<T>>,
}

impl<T: Real> OrientedPoints<T> {
    /// Zero gradients.
    pub fn zeros(vertices: usize) -> Self {
        Self { positions: vec![Vec3::zero(); vertices], normals: vec![Vec3::zero(); vertices] }
    }
}

impl OrientedPoints {
    /// The vertices of a mesh with normals.
    pub fn of(mesh: &Mesh) -> Self {
        Self { positions: mesh.positions.clone(), normals: mesh.normals.clone() }
    }
}

/// One step of the way from the shape to the vertices of a picture.
pub trait VertexStage<T>: Debug + Sync {
    /// What becomes of vertices.
    fn forward(&self, vertices: &OrientedPoints<T>) -> OrientedPoints<T>;

    /// Adds to `g` the gradient of `vertices` from that of what became of them.
    fn vjp(&self, vertices: &OrientedPoints<T>, d: &OrientedPoints<T>, g: &mut OrientedPoints<T>);
}

/// A pose: positions and normals go as those of a skin with morph targets.
impl<T: Real> VertexStage<T> for Deformation<T> {
    fn forward(&self, vertices: &OrientedPoints<T>) -> OrientedPoints<T> {
        OrientedPoints {
            positions: self.positions(&vertices.positions),
            normals: self.normals(&vertices.normals),
        }
    }

    fn vjp(&self, vertices: &OrientedPoints<T>, d: &OrientedPoints<T>, g: &mut OrientedPoints<T>) {
        self.positions_vjp(&d.positions, &mut g.positions);
        self.normals_vjp(&vertices.normals, &d.normals, &mut g.normals);
    }
}

/// What each stage of a list is given, and the last of all: what comes out.
pub(super) fn through<T: Real>(
    stages: &[&dyn VertexStage<T>],
    shape: &OrientedPoints<T>,
) -> Vec<OrientedPoints<T>> {
    let mut all = vec![shape.clone()];
    for stage in stages {
        let next = stage.forward(&all[all.len() - 1]);
        all.push(next);
    }
    all
}

/// The gradient of what the first stage was given, from that of what came out: adjoint of [`through`], whose results are
/// given.
pub(super) fn through_vjp<T: Real>(
    stages: &[&dyn VertexStage<T>],
    passed: &[OrientedPoints<T>],
    mut d: OrientedPoints<T>,
) -> OrientedPoints<T> {
    for (stage, vertices) in stages.iter().zip(passed).rev() {
        let mut g = OrientedPoints::zeros(vertices.positions.len());
        stage.vjp(vertices, &d, &mut g);
        d = g;
    }
    d
}
