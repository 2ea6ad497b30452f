//! Medians of repetitions that take turns, so that a busy moment of the machine meets all candidates alike.

use std::hint::black_box;
use std::time::Instant;

use rustix::time::{ClockId, clock_gettime};

/// Something to time: it answers its queries once and returns a number that depends on all answers.
pub type Candidate<'a> = Box<dyn FnMut() -> f32 + 'a>;

/// Median nanoseconds a query of each candidate: `rounds` rounds, in each of which every candidate runs once, after one round that does not count.
pub fn interleaved(rounds: usize, queries: usize, candidates: &mut [Candidate<'_>]) -> Vec<f64> {
    let mut times = vec![Vec::new(); candidates.len()];
    for round in 0..=rounds {
        for (candidate, times) in candidates.iter_mut().zip(&mut times) {
            let start = Instant::now();
            black_box(candidate());
            if round > 0 {
                times.push(start.elapsed().as_secs_f64() * 1e9 / queries as f64);
            }
        }
    }
    times.into_iter().map(median).collect()
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
