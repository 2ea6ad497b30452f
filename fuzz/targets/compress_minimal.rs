#![no_main]
use deepshadow::Compressor;
libfuzzer_sys::fuzz_target!(|data: &[u8]| deepshadow_fuzz::compress::run(
    Compressor::Minimal,
    data
));
