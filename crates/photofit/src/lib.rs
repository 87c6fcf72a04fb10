//! photofit photofit.
