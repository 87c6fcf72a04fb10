//! photofit fit.
