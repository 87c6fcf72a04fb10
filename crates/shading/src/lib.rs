//! photofit shading.
