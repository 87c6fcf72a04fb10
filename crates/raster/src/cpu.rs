//! What this machine's processor can do.

/// Whether AVX2 and fused multiply-add may be used.
///
/// Functions compiled for both give the same bits as the portable ones unless they ask for a fused multiply-add by
/// name: the compiler never contracts a product and a sum.
#[cfg(target_arch = "x86_64")]
#[inline]
pub fn has_avx2() -> bool {
    std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma")
}
