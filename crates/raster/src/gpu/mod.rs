//! Pictures that stay on a device: the twins of [`crate::deferred`].

pub mod buffers;
pub mod shading;
