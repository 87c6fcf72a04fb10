//! Tests of the optimizer, by family.

mod adam;
mod families;
mod filters;
