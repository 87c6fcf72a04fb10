//! Work compiled for the widest vectors of the processor.
//!
//! Only the width differs: no fused multiply-add is allowed, so that every machine gives the same bits.

/// Work that is compiled once for each width: its `run`, and all that it calls, must be marked `#[inline(always)]`. A closure is
/// one, itself marked so.
pub trait Kernel {
    /// What it gives.
    type Output;

    /// Does the work.
    fn run(self) -> Self::Output;
}

// Not `FnOnce`: a closure that could be called twice is called through a function of its own then, which nothing marks as
// inlined, so that large ones stayed narrow without a word.
impl<R, F: FnMut() -> R> Kernel for F {
    type Output = R;

    #[inline(always)]
    fn run(mut self) -> R {
        self()
    }
}

/// Instructions that work may be compiled for, the narrowest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Width {
    /// What every processor of the architecture has.
    Base,
    /// 256 bits of x86-64.
    Avx2,
    /// 512 bits of x86-64.
    Avx512,
}

impl Width {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Base, Self::Avx2, Self::Avx512];
}

/// Runs a kernel compiled for the widest vectors that the machine has, not beyond `most`: the same bits with any.
#[inline]
pub fn run_up_to<K: Kernel>(most: Width, kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    {
        if most >= Width::Avx512 && std::arch::is_x86_feature_detected!("avx512f") {
            #[expect(unsafe_code, reason = "calling a function compiled for AVX-512")]
            // SAFETY: the feature was just detected.
            return unsafe { run_avx512(kernel) };
        }
        if most >= Width::Avx2 && std::arch::is_x86_feature_detected!("avx2") {
            #[expect(unsafe_code, reason = "calling a function compiled for AVX2")]
            // SAFETY: the feature was just detected.
            return unsafe { run_avx2(kernel) };
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = most;
    kernel.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
fn run_avx512<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn run_avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}
