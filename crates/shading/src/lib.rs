//! Surface scattering and lights with derivatives.

mod environment;
mod ggx;
mod light;
mod normal_map;
mod octahedral;
mod prefilter;
mod split_sum;
mod surface;

pub use environment::{Environment, EnvironmentError};
pub use ggx::{
    COSINE_MIN, EvalGradient, LobesEvalGradient, ROUGHNESS_MIN, eval, eval_lobes, eval_lobes_vjp, eval_vjp,
};
pub use light::{Light, ShadeGradient, Yaw, shade, shade_vjp, view_direction, view_direction_vjp};
pub use normal_map::{
    BEND_START, FaceViewerGradient, PerturbGradient, face_viewer, face_viewer_vjp, perturb, perturb_vjp,
};
pub use split_sum::{SplitSum, split_sum};
pub use surface::{DIELECTRIC_F0, Lobes, LobesGradient, Surface, SurfaceGradient};

#[cfg(test)]
mod tests;
