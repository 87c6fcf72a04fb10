//! photofit optim.
