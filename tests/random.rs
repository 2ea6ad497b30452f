//! Random numbers for tests and benches.
#![allow(dead_code, reason = "each program uses some of the methods")]

/// A splitmix64 generator: the same seed yields the same numbers on every machine.
pub struct Random(pub u64);

impl Random {
    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut x = self.0;
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        x ^ (x >> 31)
    }

    /// An integer in `0..n`.
    pub fn below(&mut self, n: u32) -> u32 {
        (self.bits() >> 32) as u32 % n
    }

    /// An index in `0..n`; `n` must fit in 32 bits.
    pub fn index(&mut self, n: usize) -> usize {
        self.below(n.try_into().unwrap()) as usize
    }

    /// A number in `0.0..1.0`.
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A multiple of 2^-20 in `0.0..1.0`.
    pub fn unit_f32(&mut self) -> f32 {
        self.below(1 << 20) as f32 / (1 << 20) as f32
    }

    /// A number between `lo` and `hi`.
    pub fn range(&mut self, lo: f64, hi: f64) -> f64 {
        lo + (hi - lo) * self.unit()
    }
}
