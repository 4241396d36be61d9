#![no_main]
libfuzzer_sys::fuzz_target!(|data: &[u8]| cfreg_fuzz::array(data));
