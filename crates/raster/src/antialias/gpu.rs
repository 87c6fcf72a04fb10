//! Antialiasing of silhouettes on a device.

use crate::gpu::{FRAME, GradientBuffers, LayerBuffers, MeshBuffers, PictureBuffers, Steps, Work};
use photofit_gpu::{Buffer, FIXED, GpuError, INDEX, Kernel};

const CROSSING: &str = include_str!("crossing.wgsl");
const ANTIALIAS: &str = include_str!("antialias.wgsl");

/// Which edges are silhouettes in a view.
pub(crate) const FOLD: Kernel =
    Kernel { name: "fold", source: &[INDEX, FRAME, include_str!("fold.wgsl")], entry: "fold" };
/// Silhouettes between neighbouring samples.
pub(crate) const SILHOUETTES: Kernel = Kernel {
    name: "silhouettes",
    source: &[INDEX, FRAME, CROSSING, include_str!("silhouette.wgsl")],
    entry: "find",
};
/// Blends across silhouettes.
pub(crate) const BLEND: Kernel =
    Kernel { name: "antialias", source: &[INDEX, FRAME, CROSSING, ANTIALIAS], entry: "forward" };
/// The adjoint.
pub(crate) const REVERSE: Kernel = Kernel {
    name: "antialias_vjp",
    source: &[INDEX, FIXED, FRAME, CROSSING, ANTIALIAS, include_str!("antialias_vjp.wgsl")],
    entry: "reverse",
};

/// Records which edges of the mesh are silhouettes in the picture.
///
/// # Errors
/// If a dispatch does not fit.
pub fn fold(s: &mut Steps<'_>, mesh: &MeshBuffers, picture: &PictureBuffers) -> Result<(), GpuError> {
    let buffers = [picture.clip.bind(), mesh.triangles.bind(), mesh.opposite.bind(), picture.folds.bind()];
    s.dispatch(&FOLD, 0, 0, &buffers, Work::Threads(mesh.triangles()))
}

/// Records [`super::silhouettes`] of a layer: `triangle` and `depth` to `pairs`.
///
/// # Errors
/// If a dispatch does not fit.
pub fn silhouettes(
    s: &mut Steps<'_>,
    mesh: &MeshBuffers,
    picture: &PictureBuffers,
    layer: usize,
) -> Result<(), GpuError> {
    let LayerBuffers { triangle, depth, pairs, .. } = &picture.layers[layer];
    let buffers = [
        picture.clip.bind(),
        mesh.triangles.bind(),
        mesh.neighbour.bind(),
        picture.folds.bind(),
        triangle.bind(),
        depth.bind(),
        pairs.bind(),
    ];
    s.dispatch(&SILHOUETTES, layer, 0, &buffers, picture.bins.samples(layer, s.samples()))
}

/// Records [`super::antialias`] of a layer: `blended` to `out`.
///
/// # Errors
/// If a dispatch does not fit.
pub fn antialias(
    s: &mut Steps<'_>,
    mesh: &MeshBuffers,
    picture: &PictureBuffers,
    layer: usize,
    out: &Buffer<[f32; 4]>,
) -> Result<(), GpuError> {
    let LayerBuffers { pairs, blended, .. } = &picture.layers[layer];
    let buffers = [picture.clip.bind(), mesh.triangles.bind(), pairs.bind(), blended.bind(), out.bind()];
    s.dispatch(&BLEND, layer, 0, &buffers, picture.bins.samples(layer, s.samples()))
}

/// Records [`super::antialias_vjp`] of a layer: the gradient `from` of its output to that of `blended`, in `to`; gradients
/// of clip-space positions go to `g.sums`, if `positions` have any.
///
/// # Errors
/// If a dispatch does not fit.
pub fn antialias_vjp(
    s: &mut Steps<'_>,
    mesh: &MeshBuffers,
    picture: &PictureBuffers,
    layer: usize,
    g: &GradientBuffers,
    [from, to]: [&Buffer<[f32; 4]>; 2],
    positions: bool,
) -> Result<(), GpuError> {
    let LayerBuffers { pairs, blended, .. } = &picture.layers[layer];
    let buffers = [
        picture.clip.bind(),
        mesh.triangles.bind(),
        pairs.bind(),
        blended.bind(),
        from.bind(),
        to.bind(),
        g.sums.bind(),
    ];
    let work = picture.bins.samples(layer, s.samples());
    s.dispatch(&REVERSE, layer, u32::from(positions), &buffers, work)
}

#[cfg(test)]
mod tests;
