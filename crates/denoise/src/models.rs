//! The named models, as problems for [`crate::admm::Admm`].
//!
//! Each weight is a number or a map with one value per pixel or sample. Terms can be added or changed afterwards:
//!
//! ```
//! use photofit_denoise::{Shape, admm::{Admm, Stop}, models};
//! let shape = Shape::new(16, 16, 3);
//! let noisy: Vec<f32> = (0..768).map(|k| if k % 2 == 0 { 0.4 } else { 0.6 }).collect();
//! let mut admm = Admm::new(&models::hybrid(shape, &noisy, 0.1, 0.5, 0.4))?;
//! admm.solve(Stop::Iterations(50));
//! assert!(admm.solution().iter().all(|v| (v - 0.5).abs() < 0.02));
//! # Ok::<(), photofit_denoise::DenoiseError>(())
//! ```

use photofit_scalar::Real;

use crate::Shape;
use crate::admm::{DataTerm, Problem, Weight};

/// ROF (Rudin, Osher and Fatemi 1992): `lambda/2 (u-u0)^2 + |grad u|`. Keeps the mean; equals scikit-image's `denoise_tv_chambolle` with
/// `weight = 1/lambda`.
pub fn rof<T: Real>(shape: Shape, target: &[T], lambda: impl Into<Weight<T>>) -> Problem<'_, T> {
    Problem::new(shape, target, DataTerm::L2 { lambda: lambda.into() }).with_gradient(T::one())
}

/// TV-L1 (Chan and Esedoglu 2005): `lambda |u-u0| + |grad u|`. Removes features by size (a disc of radius R goes if
/// `lambda < 2/R`), keeps the contrast of the others, and ignores outliers.
pub fn tv_l1<T: Real>(shape: Shape, target: &[T], lambda: impl Into<Weight<T>>) -> Problem<'_, T> {
    Problem::new(shape, target, DataTerm::L1 { lambda: lambda.into() }).with_gradient(T::one())
}

/// HTV-L2: `lambda/2 (u-u0)^2 + alpha |grad u| + beta |H u|_F`. Convex; with `alpha = 0` affine ramps cost nothing.
pub fn htv_l2<T: Real>(
    shape: Shape,
    target: &[T],
    lambda: impl Into<Weight<T>>,
    alpha: impl Into<Weight<T>>,
    beta: impl Into<Weight<T>>,
) -> Problem<'_, T> {
    Problem::new(shape, target, DataTerm::L2 { lambda: lambda.into() })
        .with_gradient(alpha)
        .with_hessian(beta)
}

/// HTV-L2-N: [`htv_l2`] plus `gamma |grad u - g|` with a target gradient, for depth that of the normals.
pub fn htv_l2_n<'a, T: Real>(
    shape: Shape,
    target: &'a [T],
    lambda: impl Into<Weight<T>>,
    [alpha, beta, gamma]: [Weight<T>; 3],
    gradient: &'a [T],
) -> Problem<'a, T> {
    htv_l2(shape, target, lambda, alpha, beta).with_guide(gamma, gradient)
}

/// HTV-L1-N: as [`htv_l2_n`] with `lambda |u-u0|`, for samples with outliers.
pub fn htv_l1_n<'a, T: Real>(
    shape: Shape,
    target: &'a [T],
    lambda: impl Into<Weight<T>>,
    [alpha, beta, gamma]: [Weight<T>; 3],
    gradient: &'a [T],
) -> Problem<'a, T> {
    Problem::new(shape, target, DataTerm::L1 { lambda: lambda.into() })
        .with_gradient(alpha)
        .with_hessian(beta)
        .with_guide(gamma, gradient)
}

/// Hybrid: `l1 |u-u0| + l2/2 (u-u0)^2 + alpha |grad u|`, with vectorial total variation over the channels
/// (Bresson and Chan 2008). Tends to ROF for `l1 -> 0` and to TV-L1 for `l2 -> 0`.
pub fn hybrid<T: Real>(
    shape: Shape,
    target: &[T],
    l1: impl Into<Weight<T>>,
    l2: impl Into<Weight<T>>,
    alpha: impl Into<Weight<T>>,
) -> Problem<'_, T> {
    Problem::new(shape, target, DataTerm::Hybrid { l1: l1.into(), l2: l2.into() })
        .with_gradient(alpha)
        .vectorial()
}
