//! Procedural meshes through the whole of [`unwrap`](super::unwrap).
