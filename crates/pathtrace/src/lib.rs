//! Ray casting against triangle meshes.
//!
//! ```
//! use photofit_pathtrace::{Accel, Ray};
//! use photofit_scalar::vec3;
//! let positions = [vec3(0.0, 0.0, 0.0), vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0)];
//! let accel = Accel::build(&positions, &[[0, 1, 2]])?;
//! let hit = accel.closest_hit(&Ray::new(vec3(0.25, 0.5, 2.0), vec3(0.0, 0.0, -1.0))).expect("aims at the triangle");
//! assert!((hit.t - 2.0).abs() < 1e-6 && (hit.u - 0.25).abs() < 1e-6 && (hit.v - 0.5).abs() < 1e-6 && hit.front);
//! # Ok::<(), photofit_pathtrace::AccelError>(())
//! ```

pub mod accel;
mod camera;
mod error;
mod film;
mod integrator;
mod light;
#[cfg(feature = "mitsuba")]
mod mitsuba;
mod plan;
mod random;
mod render;
mod volume;
mod world;

#[cfg(test)]
mod validation;

pub use accel::{Accel, AccelError, Hit, NearestPoint, Ray};
pub use camera::{Lens, Projection, View};
pub use error::PathtraceError;
pub use film::{Aov, Filter};
pub use integrator::{PathOptions, Strategy};
pub use light::{EnvironmentMap, Falloff, LightSource};
pub use plan::{Features, Plan};
pub use render::{Integrator, Progress, RenderOptions, Renderer};
pub use volume::{Boundary, BoundedMedium, Field, Volume};
pub use world::{
    Instance, Interaction, Material, Parts, Scattering, Shape, World, WorldHit, WorldOptions, WorldRay,
};
