//! Tests of the `photofit` program as users run it.
#![expect(clippy::unwrap_used, reason = "a test stops at the first surprise")]

mod bad_input;
mod commands;
mod denoise;
mod gradient;
mod lod;
mod mitsuba;
mod overwrite;
mod path;
mod recover;
mod recover_material;
mod recover_scene;
mod recover_volume;
mod retexture;
mod signals;
mod simplify;
mod support;
mod surface;
mod usage;
