//! The parts that a fit is assembled from. Each exists once; a task is a file that puts them together.
//!
//! - [`mod@reference`]: what answers (camera, lights, moment, size) with a picture.
//! - [`given`]: finished pictures with cameras, a reference and its views in one.
//! - [`animated`]: animated assets at the moments that views name.
//! - [`views`]: from where, under which light, at which size: pure functions of (set, index).
//! - [`model`]: named groups of parameters with their optimizers, wherever they live; [`cpu`]: those in main memory.
//! - `gpu`: a surface whose fit stays on a device; [`device`]: where a fit runs.
//! - [`surface`]: positions and maps of a mesh, the stages from them to pictures, and the same reversed.
//! - [`traced`]: parameters of a path-traced world, by path replay.
//! - [`posed`]: maps of a mesh that is seen at moments of an animation.
//! - [`loss`]: chosen by the noise of the reference's pictures.
//! - [`chain`]: fits one after the other, with a checkpoint for each.
//! - `not_finite`: light that is not a number, counted and told.
//! - [`trainer`]: one loop: phases, evaluation of held-out views, best state, patience, checkpoints, cancellation.
//! - [`classes`]: materials that become one material of the light asset, and how a fit draws them; [`export`]: a fitted
//!   surface as a scene, [`vertex_colors`] as one without textures; `unwrap`: a mesh as a surface with an atlas.
//! - [`judge`]: quality of what was written, drawn as other programs draw it.
//! - [`plan`]: what a fit of a surface runs, and the rows in which tasks tell what they run, and why.

pub mod animated;
pub(crate) mod asset;
pub mod chain;
pub(crate) mod checkpoint;
pub mod classes;
pub mod cpu;
pub mod device;
pub mod export;
pub mod fingerprint;
mod frame;
pub mod given;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod judge;
mod light_asset;
pub mod loss;
pub mod model;
mod not_finite;
pub mod plan;
mod pool;
pub mod posed;
pub mod reference;
pub mod surface;
pub mod traced;
pub mod trainer;
pub(crate) mod unwrap;
pub mod vertex_colors;
pub mod views;

pub use asset::Normalised;
pub use frame::FitFrame;
pub use light_asset::LightAsset;
pub(crate) use not_finite::NotFinite;
pub use not_finite::not_finite_told;
