//! Tests of the splitting: optima, closed forms, limits, stress.

mod optima;
mod problems;
