//! A whole picture on a device, forward and in reverse: the twin of [`crate::deferred::render`] and
//! [`crate::deferred::render_vjp`].

use super::buffers::{GradientBuffers, MeshBuffers, PictureBuffers};
use super::params::FrameParams;
use super::shading::{Shading, ShadingVjp};
use super::steps::{Slots, Steps};
use crate::antialias::gpu::{antialias, antialias_vjp, fold, silhouettes};
use crate::deferred::Passes;
use crate::deferred::composite::{average, blend, blend_vjp, lay_behind, magnify, resolve, transparent_part};
use crate::project::gpu::{gather, project};
use crate::rasterize::gpu::{bin, rasterize};
use photofit_gpu::{GpuError, Recorder};

/// Records a picture of a mesh over `picture.background`, into `picture.color`. `params` are those of the largest picture
/// that the recording is for.
///
/// # Errors
/// If a dispatch does not fit.
pub fn render(
    r: &mut Recorder,
    mesh: &MeshBuffers,
    picture: &PictureBuffers,
    passes: &Passes,
    params: &FrameParams,
    shading: &mut impl Shading,
) -> Result<Slots, GpuError> {
    let mut steps = Steps::new(r, params);
    let s = &mut steps;
    let (layers, samples) = (picture.layers.len(), s.samples());
    s.recorder.clear(&picture.live);
    project(s, mesh, picture)?;
    if passes.antialias {
        fold(s, mesh, picture)?;
    }
    bin(s, mesh, picture)?;
    for (k, layer) in picture.layers.iter().enumerate() {
        rasterize(s, mesh, picture, k)?;
        shading.record(s.recorder, mesh, picture, layer, picture.bins.samples(k, samples))?;
        if passes.antialias {
            silhouettes(s, mesh, picture, k)?;
        }
        if k + 1 < layers {
            transparent_part(s, mesh, picture, k)?;
        }
    }
    let several = !picture.samples.is_empty();
    for (k, layer) in picture.layers.iter().enumerate().rev() {
        let out = match k {
            0 if several => &picture.samples,
            0 => &picture.color,
            _ => &picture.layers[k - 1].behind,
        };
        if passes.antialias {
            blend(s, picture, k, &layer.blended)?;
            antialias(s, mesh, picture, k, out)?;
        } else {
            blend(s, picture, k, out)?;
        }
    }
    if several {
        average(s, picture)?;
    }
    Ok(steps.finish())
}

/// Records a picture of a mesh without gradients and without blending of silhouettes, over nothing: premultiplied radiance and
/// alpha, from pixel [`FrameParams::first`] of `picture.color` on. Layers are laid behind one another from the front on, in
/// the buffers of two ([`PictureBuffers::drawn`]). `params` are those of the largest picture that the recording is for.
///
/// # Errors
/// If a dispatch does not fit.
pub fn draw(
    r: &mut Recorder,
    mesh: &MeshBuffers,
    picture: &PictureBuffers,
    params: &FrameParams,
    shading: &mut impl Shading,
) -> Result<Slots, GpuError> {
    let mut steps = Steps::new(r, params);
    let s = &mut steps;
    let samples = s.samples();
    s.recorder.clear(&picture.live);
    project(s, mesh, picture)?;
    bin(s, mesh, picture)?;
    for (k, layer) in picture.layers.iter().enumerate() {
        rasterize(s, mesh, picture, k)?;
        shading.record(s.recorder, mesh, picture, layer, picture.bins.samples(k, samples))?;
        lay_behind(s, picture, k)?;
    }
    resolve(s, picture)?;
    Ok(steps.finish())
}

/// Records the adjoint of [`render`] for `g.color`: accumulates into the gradients of `g` and of what the shading reads.
///
/// # Errors
/// If a dispatch does not fit.
pub fn render_vjp(
    r: &mut Recorder,
    mesh: &MeshBuffers,
    picture: &PictureBuffers,
    passes: &Passes,
    params: &FrameParams,
    shading: &mut impl ShadingVjp,
    g: &GradientBuffers,
) -> Result<Slots, GpuError> {
    let mut steps = Steps::new(r, params);
    let s = &mut steps;
    let samples = s.samples();
    let [mut front, mut next] = [&g.samples[0], &g.samples[1]];
    s.recorder.clear(&g.sums);
    magnify(s, g, front)?;
    for (k, layer) in picture.layers.iter().enumerate() {
        if passes.antialias {
            antialias_vjp(s, mesh, picture, k, g, [front, next], passes.position_gradients)?;
            std::mem::swap(&mut front, &mut next);
        }
        blend_vjp(s, picture, k, g, front)?;
        shading.record_vjp(s.recorder, mesh, picture, layer, g, picture.bins.samples(k, samples))?;
    }
    if passes.position_gradients {
        gather(s, mesh, g)?;
    }
    Ok(steps.finish())
}
