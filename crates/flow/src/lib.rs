//! Learned importance sampling: densities of directions that follow the light of a scene, for any renderer.
//!
//! A [`Guide`] learns from [`Record`]s (a vertex, the direction taken there, its density and what came of it) and then
//! makes directions with their densities. Two kinds: [`FlowGuide`], a normalizing flow of coupling layers conditioned by a
//! network on position and directions; [`LobeGuide`], mixtures of von Mises-Fisher lobes in a spatial tree, without a
//! network. [`Guided`] mixes a guide with the scattering function of a surface behind the direction-sampler trait of
//! `photofit-sampling`.
//!
//! ```
//! use photofit_flow::{FlowGuide, FlowOptions, Guide, Learn, Query, Record};
//! use photofit_sampling::{Rng, cosine_hemisphere, cosine_hemisphere_pdf};
//! use photofit_scalar::{Vec3f, vec3};
//! let mut guide = FlowGuide::new(Vec3f::zero(), Vec3f::splat(1.0), FlowOptions::default())?;
//! let n = vec3(0.0, 0.0, 1.0);
//! let query = Query { position: Vec3f::splat(0.5), normal: n, wo: n, roughness: 1.0 };
//! // Light from the side of +x alone.
//! let mut rng = Rng::new(1, 0);
//! let records: Vec<Record> = (0..20_000)
//!     .map(|_| {
//!         let wi = cosine_hemisphere([rng.next_f32(), rng.next_f32()]);
//!         let light = if wi.x > 0.5 { 1.0 } else { 0.0 };
//!         Record { query, wi, pdf: cosine_hemisphere_pdf(wi.z), value: light * wi.z, incident: light }
//!     })
//!     .collect();
//! guide.learn(&records)?;
//! let local = guide.local(&query);
//! assert!(guide.pdf(&local, vec3(0.8, 0.0, 0.6)) > 4.0 * guide.pdf(&local, vec3(-0.8, 0.0, 0.6)));
//! # Ok::<(), photofit_flow::FlowError>(())
//! ```

pub mod coupling;
mod domain;
mod elementary;
mod encoding;
mod error;
mod flow;
mod grid;
mod guide;
mod lobes;
pub mod network;
pub mod spline;
mod tensor;
mod waves;

pub use domain::{Chart, Domain};
pub use encoding::Encoding;
pub use error::FlowError;
pub use flow::{FlowGuide, FlowLocal, FlowOptions};
pub use grid::Grid;
pub use guide::{Guide, Guided, Learn, Query, Record, SHARE};
pub use lobes::{LobeGuide, LobeLocal, LobeOptions};
pub use tensor::Tensor;
pub use waves::Waves;
