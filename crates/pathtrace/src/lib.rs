//! photofit pathtrace.
