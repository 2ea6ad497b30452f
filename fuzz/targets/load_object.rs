#![no_main]
libfuzzer_sys::fuzz_target!(|data: &[u8]| deepshadow_fuzz::load_object::run(data));
