//! Medians of repetitions that take turns, so that a busy moment of the machine meets all
//! candidates alike.

use rustix::time::{ClockId, clock_gettime};
use std::hint::black_box;

/// Something to time: it answers its queries once and returns a number that depends on all answers.
pub struct Candidate<'a> {
    queries: usize,
    run: Box<dyn FnMut() -> f32 + 'a>,
}

impl<'a> Candidate<'a> {
    /// What answers so many queries each time that it runs.
    pub fn new(queries: usize, run: impl FnMut() -> f32 + 'a) -> Self {
        Candidate {
            queries,
            run: Box::new(run),
        }
    }
}

/// Median nanoseconds of processor time a query of each candidate: in each of `rounds` rounds every
/// candidate runs once, after a round that does not count.
pub fn interleaved<const N: usize>(rounds: usize, mut candidates: [Candidate<'_>; N]) -> [f64; N] {
    let mut times = [const { Vec::new() }; N];
    for round in 0..=rounds {
        for (candidate, times) in candidates.iter_mut().zip(&mut times) {
            let start = cpu_seconds();
            black_box((candidate.run)());
            if round > 0 {
                times.push((cpu_seconds() - start) * 1e9 / candidate.queries as f64);
            }
        }
    }
    times.map(median)
}

/// The middle one.
pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Seconds that this thread has been on a processor.
pub fn cpu_seconds() -> f64 {
    let t = clock_gettime(ClockId::ThreadCPUTime);
    t.tv_sec as f64 + t.tv_nsec as f64 * 1e-9
}
