//! Arbitrary bytes as an OpenDocument spreadsheet: no panic, and the same rows for any chunk size.
#![no_main]

use libfuzzer_sys::fuzz_target;
use log_file_fuzz::read_table;

fuzz_target!(|bytes: &[u8]| read_table(bytes, b"PK\x03\x04"));
