//! Arbitrary bytes as an ordinary text file (UTF-16, decimal commas, units, dates): no panic, and the same
//! rows for any chunk size.
#![no_main]

use libfuzzer_sys::fuzz_target;
use log_file_fuzz::read_log;

fuzz_target!(|bytes: &[u8]| read_log(bytes, None, bytes.len() % 499 + 20));
