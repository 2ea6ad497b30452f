#![no_main]
//! Opens any bytes as a file.
//!
//! The mutator recomputes every CRC. Otherwise no input would pass the check of the header.

use libfuzzer_sys::{fuzz_mutator, fuzz_target, fuzzer_mutate};

fuzz_target!(|data: &[u8]| deepshadow_fuzz::open_verify::run(data));

fuzz_mutator!(|data: &mut [u8], size: usize, max_size: usize, seed: u32| {
    let size = deepshadow_fuzz::open_verify::mutate(data, size, max_size, seed, fuzzer_mutate);
    deepshadow_fuzz::resign::resign(&mut data[..size]);
    size
});
