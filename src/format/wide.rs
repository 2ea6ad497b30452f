//! The same code for wider vector units, chosen when the program runs.
//!
//! The default target of x86-64 has vectors of 16 bytes; nearly every machine in use has 32. The
//! results are the same: the code uses integers and comparisons, and no fused arithmetic.

/// Whether the machine has the vectors and the bit operations of AVX2.
#[inline]
pub(crate) fn has_avx2() -> bool {
    #[cfg(target_arch = "x86_64")]
    return std::arch::is_x86_feature_detected!("avx2")
        && std::arch::is_x86_feature_detected!("bmi1")
        && std::arch::is_x86_feature_detected!("bmi2")
        && std::arch::is_x86_feature_detected!("popcnt");
    #[cfg(not(target_arch = "x86_64"))]
    false
}

/// Calls `f`, compiled for 32-byte vectors if the machine has them. `f` and the functions that it
/// calls should be `#[inline(always)]`.
#[inline]
pub(crate) fn wide<R>(f: impl FnOnce() -> R) -> R {
    #[cfg(target_arch = "x86_64")]
    if has_avx2() {
        #[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
        fn avx2<R>(f: impl FnOnce() -> R) -> R {
            f()
        }
        // SAFETY: the machine has the features that the function is compiled for.
        return unsafe { avx2(f) };
    }
    f()
}
