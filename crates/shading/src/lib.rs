//! Surface scattering and lights with derivatives.
//!
//! One model of reflection for both renderers: a [`Surface`] becomes [`Lobes`], of which [`eval()`] makes BSDF times
//! cosine under a policy on multiple scattering ([`Energy`]); [`shade`] sums it over [`Light`]s. [`perturb`] and
//! [`face_viewer`] make the shading normal, [`Environment`] is a prefiltered environment map. Beside each function
//! stands its adjoint `*_vjp`, which recomputes the forward pass and returns the gradient with respect to every
//! differentiable input.
//!
//! [`mod@bsdf`] adds sampling and densities of the same model for path tracing, and more materials.
//!
//! Everything is generic over [`photofit_scalar::Real`], allocates nothing and holds no state. Directions point away
//! from the surface; colours are linear Rec.709.
//!
//! ```
//! use photofit_scalar::{Vec3, vec3};
//! use photofit_shading::{Energy, Light, Surface, face_viewer, perturb, shade, shade_vjp, view_direction};
//!
//! let surface = Surface { base_color: vec3(0.8_f32, 0.6, 0.4), roughness: 0.5, metallic: 0.0, gamma: 0.0 };
//! let (position, eye) = (Vec3::zero(), vec3(0.0, 0.0, 3.0));
//! let (normal, tangent) = (vec3(0.0, 0.0, 1.0), vec3(1.0, 0.0, 0.0));
//! let wo = view_direction(eye, position);
//! let n = face_viewer(perturb(normal, tangent, 1.0, vec3(0.1, 0.0, 0.99)), normal, wo);
//! let lights = [Light::Point { position: vec3(1.0, 1.0, 2.0), intensity: Vec3::splat(10.0) }];
//! let radiance = shade(&surface, Energy::Single, position, n, wo, &lights);
//! assert!(radiance.x > radiance.z && radiance.z > 0.0);
//! // A brighter base colour gives a brighter picture.
//! let gradient = shade_vjp(&surface, Energy::Single, position, n, wo, &lights, Vec3::splat(1.0));
//! assert!(gradient.surface.base_color.x > 0.0);
//! ```

pub mod bsdf;
mod energy;
mod environment;
mod equirectangular;
mod eval;
mod ggx;
#[cfg(feature = "gpu")]
pub mod gpu;
mod light;
mod normal_map;
mod octahedral;
mod prefilter;
mod sides;
mod split_sum;
mod surface;

pub use energy::Energy;
pub use environment::{Environment, EnvironmentError};
pub use equirectangular::{EquirectangularTaps, equirectangular};
pub use eval::{EvalGradient, LobesEvalGradient, eval, eval_vjp};
pub use ggx::{COSINE_MIN, ROUGHNESS_MIN};
pub use light::{
    Beam, Light, ShadeGradient, Yaw, shade, shade_ambient, shade_ambient_vjp, shade_beam, shade_beam_vjp,
    shade_vjp, view_direction, view_direction_vjp,
};
pub use normal_map::{
    BEND_START, FaceViewerGradient, PerturbGradient, face_viewer, face_viewer_vjp, perturb, perturb_vjp,
};
pub use sides::Sides;
pub use split_sum::{SplitSum, split_sum};
pub use surface::{DIELECTRIC_F0, Lobes, LobesGradient, Surface, SurfaceGradient};

#[cfg(test)]
mod tests;
