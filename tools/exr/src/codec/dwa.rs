//! Checks a DWA block before the `exr` crate allocates by its counts.
//!
//! The crate would abort the process: it reserves memory for any count, and lets runs overshoot.

use super::{rle, zip};
use crate::error::{Error, Result};
use crate::header::Rect;
use crate::limits::dct_blocks;
use crate::source::resize;

/// Bytes of the counters at the start of a block.
const COUNTERS: usize = 11 * 8;
/// Most bytes of the rules for channels; OpenEXR writes at most 73. The `exr` crate compares every
/// rule with every channel.
const MAX_RULE_BYTES: u64 = 1024;

/// Checks that the counts of a block agree with its pixels and with its runs.
pub(crate) fn check(
    packed: &[u8],
    rect: Rect,
    channels: usize,
    decoded: u64,
    a: &mut Vec<u8>,
    b: &mut Vec<u8>,
) -> Result<()> {
    let truncated = || Error::corrupt("the DWA block is truncated");
    let within = |what: &str, n: u64, most: u64| {
        let message = || format!("the DWA block has {n} {what} instead of at most {most}");
        (n <= most)
            .then_some(())
            .ok_or_else(|| Error::corrupt(message()))
    };
    let (counters, rest) = packed
        .split_first_chunk::<COUNTERS>()
        .ok_or_else(truncated)?;
    let counter = |i: usize| u64::from_le_bytes(counters.as_chunks().0[i]);
    // Counters 2 to 5 are the lengths of the four sections, which follow the rules.
    let (version, plain, runs, from_runs) = (counter(0), counter(1), counter(6), counter(7));
    let blocks = dct_blocks(rect) * channels as u64;
    within("AC coefficients", counter(8), 63 * blocks)?;
    within("DC coefficients", counter(9), blocks)?;
    within(
        "bytes without DCT",
        plain.saturating_add(from_runs),
        decoded,
    )?;
    // A run of one byte takes two.
    within("bytes of runs", runs, 2 * from_runs)?;
    let rules = match (version, rest.first_chunk()) {
        (0 | 1, _) => 0,
        (_, Some(&size)) => u64::from(u16::from_le_bytes(size)),
        _ => return Err(truncated()),
    };
    within("bytes of rules", rules, MAX_RULE_BYTES)?;
    if from_runs > 0 {
        let start = (2..5).map(counter).fold(rules, u64::saturating_add);
        let section = usize::try_from(start)
            .ok()
            .and_then(|start| rest.get(start..));
        let length = usize::try_from(counter(5)).unwrap_or(usize::MAX);
        let section = section
            .and_then(|s| s.get(..length))
            .ok_or_else(truncated)?;
        resize(a, runs as usize);
        resize(b, from_runs as usize);
        zip::inflate(section, a).map_err(Error::corrupt)?;
        rle::expand(a, b).map_err(Error::corrupt)?;
    }
    Ok(())
}
