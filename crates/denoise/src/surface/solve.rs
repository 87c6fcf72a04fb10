//! The variational part: depth in ln z by one of the methods, and the total variation of colours.
//!
//! The unknown is `u = ln z`, in which relative accuracy is uniform, a constant delta of the one-sided Huber term is
//! free of scale, and the slope that a normal asks for does not depend on depth. Data weights are 1 at samples.

use super::reconstruct::Start;
use super::{Method, Pinhole, SurfaceError, SurfaceOptions, blend, blend_weight};
use crate::Shape;
use crate::admm::{Admm, DataTerm, Penalties, Problem, Weight};
use photofit_scalar::Vec3f;
use rayon::prelude::*;

/// Weight of a filled pixel in the first pass of the fast method.
const FILLED: f32 = 0.05;
/// Steps of the hybrid method before its absolute term is weighted.
const WARM_UP: usize = 3;
/// Steps of the vectorial total variation of colours.
const TEXTURE_STEPS: usize = 12;

/// Told the stage, the steps done and the steps in all; an error stops the work.
pub(super) type Tell<'a> = dyn FnMut(&'static str, usize, usize) -> Result<(), SurfaceError> + 'a;

/// Solves for ln z.
pub(super) fn depth(
    start: &Start,
    camera: &Pinhole,
    options: &SurfaceOptions,
    tell: &mut Tell<'_>,
) -> Result<Vec<f32>, SurfaceError> {
    let shape = Shape::new(camera.width, camera.height, 1);
    let n = options.iterations;
    let lambda = |at_hole: f32, scale: f32| -> Weight<f32> {
        let value = |v: &bool| if *v { scale } else { at_hole };
        start.valid.par_iter().map(value).collect::<Vec<f32>>().into()
    };
    let huber = || DataTerm::Huber { lambda: lambda(0.0, 1.0), delta: options.weights.delta.into() };
    let absolute = options.weights.absolute;
    let mix = |a: &[f32], b: &[f32]| {
        let weight = blend_weight(b, camera.width, camera.height, &options.blend);
        blend(a, b, &weight)
    };
    match options.method {
        Method::Fast => {
            let filled = DataTerm::L2 { lambda: lambda(FILLED, 1.0) };
            let smooth = run(shape, start, &start.filled, filled, options, (0, 2 * n), tell, |_| Ok(()))?;
            let sharp = run(shape, start, &start.ln_z, huber(), options, (n, 2 * n), tell, |_| Ok(()))?;
            Ok(mix(&sharp, &smooth))
        }
        Method::Blend => {
            let l1 = DataTerm::L1 { lambda: lambda(0.0, absolute) };
            let smooth = run(shape, start, &start.ln_z, huber(), options, (0, 2 * n), tell, |_| Ok(()))?;
            let sharp = run(shape, start, &start.ln_z, l1, options, (n, 2 * n), tell, |_| Ok(()))?;
            Ok(mix(&sharp, &smooth))
        }
        Method::Hybrid => {
            let data = |l1: Weight<f32>| DataTerm::Hybrid { l1, l2: lambda(0.0, 1.0) };
            let adapt = |admm: &mut Admm<f32>| {
                if admm.steps() != WARM_UP {
                    return Ok(());
                }
                let w = blend_weight(&admm.solution(), camera.width, camera.height, &options.blend);
                let l1: Vec<f32> = w
                    .iter()
                    .zip(&start.valid)
                    .map(|(w, v)| if *v { absolute * (1.0 - w) } else { 0.0 })
                    .collect();
                Ok(admm.set_data(data(l1.into()))?)
            };
            run(shape, start, &start.ln_z, data(lambda(0.0, absolute)), options, (0, n), tell, adapt)
        }
    }
}

/// `iterations` steps from the filled map on `target`.
fn run(
    shape: Shape,
    start: &Start,
    target: &[f32],
    data: DataTerm<f32>,
    options: &SurfaceOptions,
    (done, total): (usize, usize),
    tell: &mut Tell<'_>,
    mut after: impl FnMut(&mut Admm<f32>) -> Result<(), SurfaceError>,
) -> Result<Vec<f32>, SurfaceError> {
    let w = &options.weights;
    let gamma: Vec<f32> = start.trust.par_iter().map(|t| w.gamma * t).collect();
    let mut problem = Problem::new(shape, target, data);
    if w.alpha > 0.0 {
        problem = problem.with_gradient(w.alpha);
    }
    if w.beta > 0.0 {
        problem = problem.with_hessian(w.beta);
    }
    if w.gamma > 0.0 {
        problem = problem.with_guide(gamma, &start.target);
    }
    let per = |weight: f32, threshold: f32| f64::from(weight / threshold);
    let penalties = Penalties {
        data: 1.0,
        gradient: per(w.alpha, w.threshold),
        hessian: per(w.beta, w.threshold),
        guide: per(w.gamma, w.threshold),
        relaxation: 1.7,
    };
    let mut admm = Admm::with_penalties(&problem, penalties, Some(&start.filled))?;
    for k in 0..options.iterations {
        tell("depth", done + k, total)?;
        admm.step();
        after(&mut admm)?;
    }
    Ok(admm.solution())
}

/// Smooths colours by vectorial total variation: one norm over the gradients of all channels.
pub(super) fn texture(
    colors: Vec<Vec3f>,
    camera: &Pinhole,
    options: &SurfaceOptions,
) -> Result<Vec<Vec3f>, SurfaceError> {
    if options.texture <= 0.0 {
        return Ok(colors);
    }
    let shape = Shape::new(camera.width, camera.height, 3);
    let n = shape.pixels();
    let planes: Vec<f32> = (0..3).flat_map(|c| colors.iter().map(move |v| v.to_array()[c])).collect();
    let problem = Problem::new(shape, &planes, DataTerm::L2 { lambda: 1.0.into() })
        .with_gradient(options.texture)
        .vectorial();
    let mut admm = Admm::new(&problem)?;
    admm.solve(crate::admm::Stop::Iterations(TEXTURE_STEPS));
    let out = admm.solution();
    Ok((0..n).map(|i| Vec3f { x: out[i], y: out[n + i], z: out[2 * n + i] }).collect())
}
