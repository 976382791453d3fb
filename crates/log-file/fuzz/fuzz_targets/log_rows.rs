//! Arbitrary bytes as a log whose format is recognised, or as rows below a header: no panic, and the same rows for any
//! chunk size. The first byte sets the chunk size and selects the header.
#![no_main]

use libfuzzer_sys::fuzz_target;
use log_file_fuzz::read_log;

const HEADER: &[u8] = b"t_s,s1,s2,s3,s4,s5,s6,s7,s8,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm,group\n";

fuzz_target!(|bytes: &[u8]| {
    let Some((&cut, bytes)) = bytes.split_first() else { return };
    let header = if cut < 128 { HEADER } else { &[] };
    read_log(&[header, bytes].concat(), None, usize::from(cut % 128) + 1);
});
