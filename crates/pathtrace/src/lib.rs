//! Monte Carlo light transport: the world that integrators see, integrators, lights, media and the film.

mod adjoint;
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

pub use adjoint::{Adjoint, Gradient, GradientSamples, MaterialValue, Parameter, ParameterGradient};
pub use camera::{Lens, Projection, View};
pub use error::PathtraceError;
pub use film::{Aov, Filter};
pub use integrator::{
    AovSink, Contribution, FirstHit, Found, MediaFlight, PathOptions, PathVertex, PictureSink, ShadowFlight,
    Sink, Strategy, SurfaceVisit, TrainingSink, TrainingVertex,
};
pub use light::{EnvironmentMap, Falloff, LightOrigin, LightSource, ThrownPicture};
pub use plan::{Features, RenderPlan};
pub use render::{Integrator, Progress, RenderOptions, Renderer};
pub use volume::{Boundary, BoundedMedium, Field, MediumRef, MediumValue, Volume};
pub use world::{
    BsdfSource, Instance, Interaction, Material, Parts, Shape, World, WorldHit, WorldOptions, WorldRay,
};
