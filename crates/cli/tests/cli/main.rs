//! Tests of the `photofit` program as users run it.

mod bad_input;
mod commands;
mod simplify;
mod support;
mod usage;
