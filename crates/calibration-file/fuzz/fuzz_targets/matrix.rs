//! Imports arbitrary bytes as a matrix of coefficients, CSV or MATLAB 5. This must not panic, and an
//! imported calibration must survive writing and reading.
#![no_main]

use calibration_file::CalibrationFile;
use calibration_file::matrix::ImportOptions;
use calibration_file_fuzz::file;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok((imported, _)) = CalibrationFile::import(&file(bytes), &ImportOptions::default()) else {
        return;
    };
    let document = imported.to_json();
    let again = CalibrationFile::read(&file(document.as_bytes())).map(|read| read.to_json());
    assert_eq!(again.ok(), Some(document));
});
