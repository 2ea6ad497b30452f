//! OpenEXR's run-length encoding.
//!
//! A count c >= 0 repeats the next byte c + 1 times; c < 0 copies the next -c bytes.

/// Largest expansion: two bytes decode to at most 128.
pub(crate) const MAX_RATIO: u64 = 64;

/// Decodes `packed` to exactly `out.len()` bytes.
pub(crate) fn expand(mut packed: &[u8], out: &mut [u8]) -> Result<(), String> {
    let mut at = 0;
    let too_long = || "RLE data decodes to too many bytes".to_owned();
    let truncated = || "RLE data is truncated".to_owned();
    while let Some((&count, rest)) = packed.split_first() {
        let count = count as i8;
        let len = if count < 0 {
            usize::from(count.unsigned_abs())
        } else {
            count as usize + 1
        };
        let target = out.get_mut(at..at + len).ok_or_else(too_long)?;
        if count < 0 {
            target.copy_from_slice(rest.get(..len).ok_or_else(truncated)?);
            packed = &rest[len..];
        } else {
            target.fill(*rest.first().ok_or_else(truncated)?);
            packed = &rest[1..];
        }
        at += len;
    }
    if at != out.len() {
        return Err(format!("RLE data decodes to {at} of {} bytes", out.len()));
    }
    Ok(())
}

/// Replaces the contents of `out` with the encoded `raw`; false if that does not shrink it.
pub(crate) fn shrink(raw: &[u8], out: &mut Vec<u8>) -> bool {
    const MIN_RUN: usize = 3;
    out.clear();
    let mut literal = 0; // first pending byte
    let mut at = 0;
    let flush = |out: &mut Vec<u8>, bytes: &[u8]| {
        for piece in bytes.chunks(127) {
            out.push((-(piece.len() as i8)) as u8);
            out.extend_from_slice(piece);
        }
    };
    while at < raw.len() {
        let run = raw[at..]
            .iter()
            .take(128)
            .take_while(|&&b| b == raw[at])
            .count();
        if run >= MIN_RUN {
            flush(out, &raw[literal..at]);
            out.push((run - 1) as u8);
            out.push(raw[at]);
            literal = at + run;
        }
        at += run;
    }
    flush(out, &raw[literal..]);
    out.len() < raw.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encoded_runs_expand_to_the_same_bytes() {
        let mut cases: Vec<Vec<u8>> = vec![vec![], vec![7], vec![7; 2], vec![7; 128], vec![7; 129]];
        cases.push((0..=255).collect());
        cases.push([vec![1; 300], (0..130).collect(), vec![2; 3], vec![3; 2]].concat());
        for raw in cases {
            let mut packed = Vec::new();
            shrink(&raw, &mut packed);
            let mut back = vec![0; raw.len()];
            expand(&packed, &mut back).unwrap();
            assert_eq!(back, raw);
        }
    }

    #[test]
    fn truncated_runs_and_runs_that_are_too_long_are_errors() {
        let mut out = [0; 4];
        for packed in [&[3][..], &[0xfe, 1], &[4, 9], &[2, 9], &[0x80], &[]] {
            assert!(expand(packed, &mut out).is_err(), "{packed:?}");
        }
    }
}
