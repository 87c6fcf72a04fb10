//! Layers over one another and samples to pixels, on a device: the twins of the steps of [`super::render`] that are not
//! shading.

use crate::gpu::{FRAME, GradientBuffers, LayerBuffers, MeshBuffers, PictureBuffers, Steps, Work};
use photofit_gpu::{Buffer, GpuError, INDEX, Kernel};

const SOURCE: &[&str] = &[INDEX, FRAME, include_str!("composite.wgsl")];

const fn kernel(name: &'static str) -> Kernel {
    Kernel { name, source: SOURCE, entry: name }
}

/// A layer over what lies behind it.
pub(crate) const BLEND: Kernel = kernel("blend");
/// The adjoint.
pub(crate) const BLEND_VJP: Kernel = kernel("blend_vjp");
/// What lets see the next layer.
pub(crate) const TRANSPARENT_PART: Kernel = kernel("transparent_part");
/// Samples to pixels.
pub(crate) const AVERAGE: Kernel = kernel("average");
/// Pixels to samples.
pub(crate) const MAGNIFY: Kernel = kernel("magnify");

/// A layer behind those in front of it, without gradients.
pub(crate) const LAY_BEHIND: Kernel = kernel("lay_behind");
/// What was laid, to pixels.
pub(crate) const RESOLVE: Kernel = kernel("resolve");

/// Records a layer over what lies behind it, into `out`.
///
/// # Errors
/// If a dispatch does not fit.
pub fn blend(
    s: &mut Steps<'_>,
    picture: &PictureBuffers,
    layer: usize,
    out: &Buffer<[f32; 4]>,
) -> Result<(), GpuError> {
    let LayerBuffers { triangle, shaded, behind, .. } = &picture.layers[layer];
    let buffers = [
        triangle.bind(),
        shaded.bind(),
        behind.bind(),
        picture.background.bind(),
        picture.live.bind(),
        out.bind(),
    ];
    s.dispatch(&BLEND, layer, 0, &buffers, picture.bins.samples(layer, s.samples()))
}

/// Records its adjoint: writes `g.shaded` and turns `front`, the gradient of the layer over what lies behind, into that of
/// what lies behind.
///
/// # Errors
/// If a dispatch does not fit.
pub fn blend_vjp(
    s: &mut Steps<'_>,
    picture: &PictureBuffers,
    layer: usize,
    g: &GradientBuffers,
    front: &Buffer<[f32; 4]>,
) -> Result<(), GpuError> {
    let LayerBuffers { triangle, shaded, behind, .. } = &picture.layers[layer];
    let buffers = [
        triangle.bind(),
        shaded.bind(),
        behind.bind(),
        picture.background.bind(),
        picture.live.bind(),
        front.bind(),
        g.shaded.bind(),
    ];
    s.dispatch(&BLEND_VJP, layer, 0, &buffers, picture.bins.samples(layer, s.samples()))
}

/// Records which ids of a layer let see the next one, in `picture.front`.
///
/// # Errors
/// If a dispatch does not fit.
pub fn transparent_part(
    s: &mut Steps<'_>,
    mesh: &MeshBuffers,
    picture: &PictureBuffers,
    layer: usize,
) -> Result<(), GpuError> {
    let LayerBuffers { triangle, shaded, .. } = &picture.layers[layer];
    let buffers =
        [triangle.bind(), shaded.bind(), mesh.surfaces.bind(), picture.front.bind(), picture.live.bind()];
    s.dispatch(&TRANSPARENT_PART, layer, 0, &buffers, picture.bins.samples(layer, s.samples()))
}

/// Records the mean of each pixel's samples.
///
/// # Errors
/// If a dispatch does not fit.
pub fn average(s: &mut Steps<'_>, picture: &PictureBuffers) -> Result<(), GpuError> {
    let buffers = [picture.samples.bind(), picture.color.bind()];
    s.dispatch(&AVERAGE, 0, 0, &buffers, Work::Threads(s.pixels()))
}

/// Records the adjoint of [`average`]: `g.color` to `out`.
///
/// # Errors
/// If a dispatch does not fit.
pub fn magnify(s: &mut Steps<'_>, g: &GradientBuffers, out: &Buffer<[f32; 4]>) -> Result<(), GpuError> {
    s.dispatch(&MAGNIFY, 0, 0, &[g.color.bind(), out.bind()], Work::Threads(s.samples()))
}

/// Records that a layer is laid behind those in front of it, in `picture.samples`, and, where another one may follow, what of it
/// lets see that, in `picture.front`.
///
/// # Errors
/// If a dispatch does not fit.
pub fn lay_behind(s: &mut Steps<'_>, picture: &PictureBuffers, layer: usize) -> Result<(), GpuError> {
    let LayerBuffers { triangle, shaded, .. } = &picture.layers[layer];
    let buffers =
        [triangle.bind(), shaded.bind(), picture.front.bind(), picture.live.bind(), picture.samples.bind()];
    let another = u32::from(layer + 1 < picture.layers.len());
    s.dispatch(&LAY_BEHIND, layer, another, &buffers, picture.bins.samples(layer, s.samples()))
}

/// Records the mean of each pixel's samples, as they were laid.
///
/// # Errors
/// If a dispatch does not fit.
pub fn resolve(s: &mut Steps<'_>, picture: &PictureBuffers) -> Result<(), GpuError> {
    let buffers = [picture.samples.bind(), picture.color.bind()];
    s.dispatch(&RESOLVE, 0, 0, &buffers, Work::Threads(s.pixels()))
}

#[cfg(test)]
mod tests;
