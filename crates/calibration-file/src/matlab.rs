//! Coefficient matrices in MATLAB 5 files, plain or compressed.

use super::matrix::{ImportOptions, MatrixError, from_values};
use calibration::Calibration;

/// The names that a calibration matrix usually has, in the order in which they are looked for.
const USUAL_NAMES: [&str; 2] = ["N", "C"];

/// Whether a file begins as MATLAB 5 files do: a text of 116 bytes, and the byte order at 126.
pub(super) fn is_matlab(bytes: &[u8]) -> bool {
    bytes.starts_with(b"MATLAB") && matches!(bytes.get(126..128), Some(b"IM" | b"MI"))
}

pub(super) fn parse(bytes: &[u8], options: &ImportOptions) -> Result<Calibration, MatrixError> {
    if bytes.starts_with(b"MATLAB 7.3") {
        return Err(unreadable("it is of version 7.3; save it with `-v6` or `-v7`"));
    }
    let arrays = table_file::arrays(bytes.to_vec());
    let arrays = arrays.map_err(|error| unreadable(&error.to_string()))?;
    let found = || arrays.iter().map(|array| array.name.clone()).collect();
    let named = |name: &str| arrays.iter().find(|array| array.name == name);
    let array = match (&options.variable, arrays.as_slice()) {
        (Some(name), _) => named(name),
        (None, [only]) => Some(only),
        (None, _) => USUAL_NAMES.iter().find_map(|name| named(name)),
    };
    let wanted = || options.variable.clone().unwrap_or_else(|| USUAL_NAMES.join("` or `"));
    let array = array.ok_or_else(|| MatrixError::Variable { wanted: wanted(), found: found() })?;
    let wrong = |what: &str| unreadable(&format!("`{}` {what}", array.name));
    let &[rows, columns] = array.size.as_slice() else {
        return Err(wrong("has more than two dimensions"));
    };
    let values = array.values();
    let values = values.ok_or_else(|| wrong("does not hold real floating-point numbers"))?;
    let is_whole = rows.checked_mul(columns) == Some(values.len());
    if !is_whole || values.iter().any(|value| !value.is_finite()) {
        return Err(wrong("has missing or infinite elements"));
    }
    // MATLAB stores columns one after the other.
    from_values(rows, columns, |row, column| values[column * rows + row], options)
        .map_err(MatrixError::Unusable)
}

/// The error for a file that looks like one of MATLAB.
pub(super) fn unreadable(why: &str) -> MatrixError {
    MatrixError::Unusable(format!("cannot be read as a MATLAB 5 file: {why}"))
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use flate2::Compression;
    use flate2::write::ZlibEncoder;

    use super::*;

    /// A data element: type, length, content padded to eight bytes (MAT-File Format, "Level 5").
    fn element(kind: u32, content: &[u8]) -> Vec<u8> {
        let mut bytes = [kind.to_le_bytes(), (content.len() as u32).to_le_bytes()].concat();
        bytes.extend(content);
        bytes.resize(bytes.len().next_multiple_of(8), 0);
        bytes
    }

    /// A matrix of doubles whose elements, column by column, are 1, 2, 3, …
    fn matrix(name: &str, rows: i32, columns: i32) -> Vec<u8> {
        let (int32, uint32, int8, double, double_class) = (5, 6, 1, 9, 6_u32);
        let size = [rows.to_le_bytes(), columns.to_le_bytes()].concat();
        let values: Vec<u8> =
            (1..=rows * columns).flat_map(|x| f64::from(x).to_le_bytes()).collect();
        let content = [
            element(uint32, &[double_class.to_le_bytes(), [0; 4]].concat()),
            element(int32, &size),
            element(int8, name.as_bytes()),
            element(double, &values),
        ];
        element(14, &content.concat())
    }

    fn compressed(matrix: &[u8]) -> Vec<u8> {
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
        encoder.write_all(matrix).unwrap();
        let content = encoder.finish().unwrap();
        let length = (content.len() as u32).to_le_bytes();
        // Compressed elements are not padded.
        [15_u32.to_le_bytes().to_vec(), length.to_vec(), content].concat()
    }

    fn file(elements: &[Vec<u8>]) -> Vec<u8> {
        let mut header = b"MATLAB 5.0 MAT-file".to_vec();
        header.resize(124, b' ');
        header.extend([0, 1, b'I', b'M']);
        [header, elements.concat()].concat()
    }

    fn parse(bytes: &[u8], variable: Option<&str>) -> Result<Calibration, MatrixError> {
        assert!(is_matlab(bytes));
        let variable = variable.map(str::to_owned);
        super::parse(bytes, &ImportOptions { moment_unit: None, variable })
    }

    #[test]
    fn plain_and_compressed_matrices_are_the_same_either_way_round() {
        let calibration = parse(&file(&[matrix("A", 24, 6)]), None).unwrap();
        assert_eq!(calibration.polynomial().unwrap().coefficients()[1][..3], [2.0, 26.0, 50.0]);
        let packed = file(&[compressed(&matrix("A", 24, 6))]);
        assert_eq!(parse(&packed, None), Ok(calibration));
        let wide = parse(&file(&[matrix("A", 6, 24)]), None).unwrap();
        assert_eq!(wide.polynomial().unwrap().coefficients()[1][..3], [7.0, 8.0, 9.0]);
    }

    #[test]
    fn the_usual_names_are_found_among_others_and_any_on_request() {
        let bytes = file(&[matrix("x", 2, 2), matrix("C", 25, 6), matrix("late", 24, 6)]);
        let intercept = |calibration: Calibration| calibration.name().ends_with(" + offset");
        assert!(intercept(parse(&bytes, None).unwrap()));
        assert!(!intercept(parse(&bytes, Some("late")).unwrap()));
        let error = parse(&bytes, Some("N")).unwrap_err();
        let found = ["x", "C", "late"].map(str::to_owned).to_vec();
        assert_eq!(error, MatrixError::Variable { wanted: "N".into(), found });
        let expected = "it is `2` by `2`, expected 6 axes by 8, 24, 44 or 164 features, one more with an intercept";
        assert_eq!(parse(&bytes, Some("x")).unwrap_err().to_string(), expected);
    }

    #[test]
    fn files_cut_anywhere_are_errors_and_nothing_worse() {
        for bytes in [file(&[matrix("N", 24, 6)]), file(&[compressed(&matrix("N", 24, 6))])] {
            for length in 128..bytes.len() {
                assert!(parse(&bytes[..length], None).is_err(), "cut at {length}");
            }
        }
    }
}
