//! The device that tests of kernels share.

use crate::{Choice, Gpu, GpuError};
use std::sync::OnceLock;

/// The device of the tests in this process: any adapter, or the one that `PHOTOFIT_TEST_GPU` names. `None` where there is
/// no adapter, unless `PHOTOFIT_REQUIRE_GPU` is set.
///
/// # Panics
/// If a device is required or there is an adapter, and it cannot be opened.
pub fn test_device() -> Option<&'static Gpu> {
    static DEVICE: OnceLock<Option<Gpu>> = OnceLock::new();
    let open = || {
        let choice = std::env::var("PHOTOFIT_TEST_GPU").map_or(Choice::Any, Choice::Named);
        let required = std::env::var_os("PHOTOFIT_REQUIRE_GPU").is_some();
        match Gpu::new(&choice) {
            Ok(gpu) => Some(gpu),
            Err(GpuError::NoAdapter { .. }) if !required => None,
            Err(e) => panic!("the tests need a device: {e}"),
        }
    };
    DEVICE.get_or_init(open).as_ref()
}
