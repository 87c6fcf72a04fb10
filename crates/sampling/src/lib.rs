//! photofit sampling.
