//! Parses arbitrary bytes as a calibration and as a partial fit. This must not panic, and a document
//! that parses must read back unchanged after it is written.
#![no_main]

use calibration_file::{CalibrationFile, PartialFit};
use calibration_file_fuzz::file;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    if let Ok(read) = CalibrationFile::read_edited(&file(bytes)) {
        let document = read.to_json();
        let again = CalibrationFile::read(&file(document.as_bytes())).map(|read| read.to_json());
        assert_eq!(again.ok(), Some(document));
    }
    if let Ok(read) = PartialFit::read_edited(&file(bytes)) {
        let document = read.to_json();
        let again = PartialFit::read(&file(document.as_bytes())).map(|read| read.to_json());
        assert_eq!(again.ok(), Some(document));
    }
});
