//! Each kernel against its operation on the CPU.

use super::KERNELS;

#[test]
fn kernels_are_valid() {
    for kernel in KERNELS {
        if let Err(e) = photofit_gpu::validate(kernel) {
            panic!("{e}");
        }
    }
}
