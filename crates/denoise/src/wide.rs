//! Row kernels on AVX2 where the machine has it, with the same bits without.

pub(crate) use photofit_scalar::wide::Kernel;
use photofit_scalar::wide::{Width, run_up_to};

/// Runs a kernel compiled for AVX2 where the machine has it. It must be inlined all the way down.
#[inline]
pub(crate) fn run_widest<K: Kernel>(kernel: K) -> K::Output {
    run_up_to(Width::Avx2, kernel)
}
