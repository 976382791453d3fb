//! Arbitrary bytes as the console log of the base station: no panic, and the same frames for any chunk size. The first
//! byte sets the chunk size.
#![no_main]

use libfuzzer_sys::fuzz_target;
use log_file::LogFormat;
use log_file_fuzz::read_log;

fuzz_target!(|bytes: &[u8]| {
    let Some((&cut, bytes)) = bytes.split_first() else { return };
    read_log(bytes, Some(LogFormat::Console), usize::from(cut) + 1);
});
