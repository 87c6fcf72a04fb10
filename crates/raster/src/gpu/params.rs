//! The parameters that all kernels of a picture share.

use crate::deferred::{Masks, Passes};
use crate::project::Matrix4;

/// Parameters of a kernel of a picture (`frame.wgsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct FrameParams {
    /// World to clip space, row by row.
    pub rows: Matrix4<f32>,
    /// Columns of samples.
    pub width: u32,
    /// Rows of samples.
    pub height: u32,
    /// Samples per axis of a pixel.
    pub side: u32,
    /// Number of the layer at work.
    pub layer: u32,
    /// Vertices of the mesh.
    pub vertices: u32,
    /// Triangles of the mesh.
    pub triangles: u32,
    /// What a kernel with several uses is used for.
    pub mode: u32,
    /// Units of fixed-point sums in one: a power of two.
    pub scale: f32,
    /// Slope of faded masks; 0 cuts them.
    pub slope: f32,
    /// 1 where alpha has a gradient.
    pub fits_alpha: u32,
    /// 1 where backs of single-sided triangles are drawn, too.
    pub backs: u32,
    /// Where in its buffer the first pixel of a picture lies that is drawn without gradients ([`super::draw`]).
    pub first: u32,
}

/// What changes from picture to picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shot {
    /// World to clip space, z in [0, w].
    pub view_projection: Matrix4<f32>,
    /// Columns of samples.
    pub width: usize,
    /// Rows of samples.
    pub height: usize,
    /// Samples per axis of a pixel.
    pub samples: usize,
    /// Units of fixed-point sums of gradients in one: a power of two.
    pub scale: f32,
}

impl FrameParams {
    /// Samples of the picture.
    pub fn samples(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Pixels of the picture.
    pub fn pixels(&self) -> usize {
        (self.width / self.side) as usize * (self.height / self.side) as usize
    }

    /// Parameters of a shot of a mesh, of the first layer, without the backs of single-sided triangles; `fits_alpha` says
    /// whether some alpha has a gradient.
    ///
    /// # Panics
    /// If the samples do not fill whole pixels, or an axis has more than 65,535 of them.
    pub fn new(shot: &Shot, vertices: usize, triangles: usize, passes: &Passes, fits_alpha: bool) -> Self {
        let side = shot.samples.max(1);
        assert!(shot.width.is_multiple_of(side) && shot.height.is_multiple_of(side), "whole pixels");
        assert!(shot.width.max(shot.height) <= 0xffff, "at most 65,535 samples an axis");
        Self {
            rows: shot.view_projection,
            width: shot.width as u32,
            height: shot.height as u32,
            side: side as u32,
            layer: 0,
            vertices: vertices as u32,
            triangles: triangles as u32,
            mode: 0,
            scale: shot.scale,
            slope: if let Masks::Faded { slope } = passes.masks { slope } else { 0.0 },
            fits_alpha: u32::from(fits_alpha),
            backs: 0,
            first: 0,
        }
    }
}
