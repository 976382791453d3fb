//! Coefficient matrices in MATLAB 5 files, plain or compressed.

use matfile::{MatFile, NumericData};

use super::matrix::{ImportOptions, MatrixError, from_values};
use crate::calibration::Calibration;

/// The names that a calibration matrix usually has, in the order in which they are looked for.
const USUAL_NAMES: [&str; 2] = ["N", "C"];

/// Whether a file begins as MATLAB 5 files do: a text of 116 bytes, and the byte order at 126.
pub(super) fn is_matlab(bytes: &[u8]) -> bool {
    bytes.starts_with(b"MATLAB") && matches!(bytes.get(126..128), Some(b"IM" | b"MI"))
}

pub(super) fn parse(bytes: &[u8], options: &ImportOptions) -> Result<Calibration, MatrixError> {
    let file = MatFile::parse(bytes).map_err(|error| MatrixError::Matlab(error.to_string()))?;
    let found: Vec<String> = file.arrays().iter().map(|a| a.name().to_owned()).collect();
    let array = match (&options.variable, file.arrays().as_slice()) {
        (Some(name), _) => file.find_by_name(name),
        (None, [only]) => Some(only),
        (None, _) => USUAL_NAMES.iter().find_map(|name| file.find_by_name(name)),
    };
    let wanted = || options.variable.clone().unwrap_or_else(|| USUAL_NAMES.join("` or `"));
    let array = array.ok_or_else(|| MatrixError::Variable { wanted: wanted(), found })?;
    let &[rows, columns] = array.size().as_slice() else {
        let message = format!("`{}` has more than two dimensions", array.name());
        return Err(MatrixError::Matlab(message));
    };
    let values = match array.data() {
        NumericData::Double { real, imag: None } => real.clone(),
        NumericData::Single { real, imag: None } => real.iter().map(|&x| x.into()).collect(),
        _ => {
            let message = format!("`{}` does not hold real floating-point numbers", array.name());
            return Err(MatrixError::Matlab(message));
        }
    };
    if values.len() != rows * columns || values.iter().any(|value| !value.is_finite()) {
        let message = format!("`{}` has missing or infinite elements", array.name());
        return Err(MatrixError::Matlab(message));
    }
    // MATLAB stores columns one after the other.
    from_values(rows, columns, |row, column| values[column * rows + row], options)
}
