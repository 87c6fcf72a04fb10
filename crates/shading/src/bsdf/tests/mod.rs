//! Tests of every BSDF: sampling, energy, reciprocity, known values, robustness.

mod adjoint;
mod bench;
mod catalogue;
mod charts;
mod chi_square;
mod energy;
mod principled;
mod principled_transmission;
mod stress;
mod values;
