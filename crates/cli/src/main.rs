//! The `photofit` program.
fn main() {}
