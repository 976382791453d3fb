//! Coefficient matrices as labs exchange them: one row per feature of raw readings, six axes.
//!
//! The CSV has a header `feature,Fx_N,Fy_N,Fz_N,Mx_mNm,My_mNm,Mz_mNm`, or fewer axes; moments are
//! in mN·m. Its rows begin with `s1^1`, `s1^2`, …; products are `s1^1*s2^2`, the intercept is `1`.
//! Also read: bare numbers, features by axes or transposed, in the order of [`Model::terms`], and
//! ATI's calibrations.

use std::collections::HashMap;

use calibration::model::{Basis, MAX_CHANNELS, Model, Term};
use calibration::scaling::Scaling;
use calibration::{Calibration, Polynomial};
use shell_data::wrench::MomentUnit;
use shell_data::wrench::{Axes, Axis, PerAxis};

use super::LARGEST;

#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImportOptions {
    /// The unit of moments; by default the unit in the header, or mN·m without a header.
    pub moment_unit: Option<MomentUnit>,
    /// The variable of a MATLAB file; by default `N`, `C`, or the only variable.
    pub variable: Option<String>,
}

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MatrixError {
    #[error("no matrix `{wanted}`; found `{}`", found.join("`, `"))]
    Variable { wanted: String, found: Vec<String> },
    #[error("{0}")]
    Unusable(String),
}

const HEADER: [&str; 7] = ["feature", "Fx_N", "Fy_N", "Fz_N", "Mx_mNm", "My_mNm", "Mz_mNm"];

const BARE_CHANNELS: usize = 8;

const MILLI: f64 = 1e3;

const USUAL_NAMES: [&str; 2] = ["N", "C"];

pub fn to_csv(polynomial: &Polynomial, axes: Axes) -> String {
    let names = axes.iter().map(|axis| HEADER[axis.index() + 1]);
    let mut csv = HEADER[..1].iter().copied().chain(names).collect::<Vec<_>>().join(",") + "\n";
    let rows = polynomial.raw_coefficients();
    for (term, row) in polynomial.model().terms().iter().zip(rows) {
        csv += &feature_name(term);
        for (axis, coefficient) in axes.values(&row) {
            let unit = if axis.is_moment() { MILLI } else { 1.0 };
            // Debug prints the shortest text that reads back as the same number.
            csv += &format!(",{:?}", coefficient * unit);
        }
        csv.push('\n');
    }
    csv
}

/// `s1^1*s2^2`; the intercept is `1`.
fn feature_name(term: &Term) -> String {
    if term.factors().is_empty() {
        return term.name();
    }
    let powers = term.factors().chunk_by(|a, b| a == b);
    powers.map(|run| format!("s{}^{}", run[0] + 1, run.len())).collect::<Vec<_>>().join("*")
}

/// Reads CSV or MATLAB 5, which has a text of 116 bytes and its byte order mark at byte 126. The flag says
/// that the file names its units.
pub(super) fn parse(
    bytes: &[u8],
    options: &ImportOptions,
) -> Result<(Calibration, bool), MatrixError> {
    if bytes.starts_with(b"MATLAB") && matches!(bytes.get(126..128), Some(b"IM" | b"MI")) {
        parse_matlab(bytes, options).map(|calibration| (calibration, false))
    } else if bytes.contains(&0) {
        Err(unreadable("it is neither text nor of version 5; save it with `-v6` or `-v7`"))
    } else {
        parse_csv(bytes, options).map_err(MatrixError::Unusable)
    }
}

fn parse_csv(bytes: &[u8], options: &ImportOptions) -> Result<(Calibration, bool), String> {
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .trim(csv::Trim::All)
        .from_reader(bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes));
    let records: Result<Vec<csv::StringRecord>, _> = reader.records().collect();
    let records = records.map_err(|error| format!("not a CSV file: {error}"))?;
    match records.split_first() {
        Some((header, rows)) if number(header.get(1).unwrap_or_default()).is_none() => {
            Ok((named(header, rows, options)?, true))
        }
        _ => Ok((bare(&records, options)?, false)),
    }
}

fn named(
    header: &csv::StringRecord,
    rows: &[csv::StringRecord],
    options: &ImportOptions,
) -> Result<Calibration, String> {
    let axis_of = |found: &str| Axis::ALL.into_iter().find(|axis| found.starts_with(axis.name()));
    let axes: Axes = header.iter().skip(1).filter_map(axis_of).collect();
    let axes = if axes.is_empty() { Axes::ALL } else { axes };
    let mut units: PerAxis<f64> = PerAxis::default();
    for (position, axis) in axes.iter().enumerate() {
        let expected = HEADER[axis.index() + 1];
        let found = header.get(position + 1).unwrap_or_default();
        let unit = match found.split_once('_') {
            Some((name, unit)) if name == axis.name() => unit,
            _ => "",
        };
        units[axis.index()] = match (axis.is_moment(), unit, options.moment_unit) {
            (false, "N", _) => 1.0,
            (true, "Nm" | "mNm", Some(unit)) => divisor(unit),
            (true, "Nm", None) => 1.0,
            (true, "mNm", None) => MILLI,
            _ => {
                return Err(format!("the header has `{found}` where `{expected}` is expected"));
            }
        };
    }
    let mut coefficients = HashMap::new();
    for row in rows {
        let line = row.position().map_or(0, csv::Position::line);
        let name = row.get(0).unwrap_or_default();
        let term = parse_feature(name)
            .ok_or_else(|| format!("line {line}: `{name}` is not a feature such as `s1^2`"))?;
        let mut values = PerAxis::default();
        for (position, axis) in axes.iter().map(Axis::index).enumerate() {
            values[axis] = field(row, position + 1)? / units[axis];
        }
        let is_new = coefficients.insert(term, values).is_none();
        ensure!(is_new, "line {line}: the feature `{name}` comes twice");
    }
    let model = model_of(&coefficients).ok_or_else(|| {
        let features = coefficients.len();
        format!(
            "its `{features}` features are not those of a model (linear, cubic, quadratic, poly3)"
        )
    })?;
    let ordered = model.terms().iter().map(|term| coefficients[term]).collect();
    let mut calibration = from_raw_readings(model, ordered)?;
    calibration.axes = axes;
    Ok(calibration)
}

fn bare(records: &[csv::StringRecord], options: &ImportOptions) -> Result<Calibration, String> {
    let columns = records.first().map_or(0, csv::StringRecord::len);
    let mut values = Vec::with_capacity(records.len() * columns);
    for record in records {
        for column in 0..columns.max(record.len()) {
            values.push(field(record, column)?);
        }
    }
    from_values(records.len(), columns, |row, column| values[row * columns + column], options)
}

fn parse_matlab(bytes: &[u8], options: &ImportOptions) -> Result<Calibration, MatrixError> {
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
    // MATLAB stores matrices column by column.
    from_values(rows, columns, |row, column| values[column * rows + row], options)
        .map_err(MatrixError::Unusable)
}

fn unreadable(why: &str) -> MatrixError {
    MatrixError::Unusable(format!("cannot be read as a MATLAB 5 file: {why}"))
}

/// Makes a calibration from a matrix without names, features by axes or axes by features.
fn from_values(
    rows: usize,
    columns: usize,
    value: impl Fn(usize, usize) -> f64,
    options: &ImportOptions,
) -> Result<Calibration, String> {
    let wrong_shape = || {
        format!(
            "it is `{rows}` by `{columns}`, expected 6 axes by 8, 24, 44 or 164 features, one more with an intercept"
        )
    };
    let (features, transposed) = match (rows, columns) {
        (features, 6) => (features, false),
        (6, features) => (features, true),
        _ => return Err(wrong_shape()),
    };
    let model = models(BARE_CHANNELS).find(|model| model.terms().len() == features);
    let model = model.ok_or_else(wrong_shape)?;
    let unit = options.moment_unit.map_or(MILLI, divisor);
    let coefficient = |feature, axis: Axis| {
        let index = axis.index();
        let value = if transposed { value(index, feature) } else { value(feature, index) };
        if axis.is_moment() { value / unit } else { value }
    };
    let coefficients = (0..features).map(|j| Axis::ALL.map(|axis| coefficient(j, axis))).collect();
    from_raw_readings(model, coefficients)
}

pub(super) fn from_raw_readings(
    model: Model,
    coefficients: Vec<PerAxis<f64>>,
) -> Result<Calibration, String> {
    for value in coefficients.iter().flatten() {
        let is_small = value.abs() <= LARGEST;
        ensure!(is_small, "a coefficient is `{value}`, beyond what calibrations can have");
    }
    Ok(Calibration::new(model, Scaling::identity(model.channels), coefficients))
}

fn model_of(coefficients: &HashMap<Term, PerAxis<f64>>) -> Option<Model> {
    let intercept = coefficients.contains_key(&Term::INTERCEPT);
    let last = coefficients.keys().flat_map(|term| term.factors()).max()?;
    models(usize::from(*last) + 1).find(|model| {
        // Compare counts first: a file that names channel 200 must not create a million terms.
        model.intercept == intercept
            && model.term_count() == coefficients.len()
            && model.terms().iter().all(|term| coefficients.contains_key(term))
    })
}

fn models(channels: usize) -> impl Iterator<Item = Model> {
    let model = move |basis, intercept| Model { basis, intercept, channels, memory: 0 };
    Basis::ALL.into_iter().flat_map(move |basis| [model(basis, false), model(basis, true)])
}

/// Parses `s1`, `s1^2`, `s1*s2^2` or `1`.
fn parse_feature(name: &str) -> Option<Term> {
    if name == "1" {
        return Some(Term::INTERCEPT);
    }
    let mut factors = Vec::new();
    for part in name.split('*') {
        let (channel, power) = part.trim().split_once('^').unwrap_or((part.trim(), "1"));
        let channel: usize = channel.strip_prefix(['s', 'S'])?.parse().ok()?;
        let power: usize = power.parse().ok().filter(|power| (1..=3).contains(power))?;
        let channel = channel.checked_sub(1).filter(|&c| c < MAX_CHANNELS)?;
        factors.extend(std::iter::repeat_n(u8::try_from(channel).ok()?, power));
    }
    (factors.len() <= 3).then(|| Term::product(&factors))
}

fn field(record: &csv::StringRecord, column: usize) -> Result<f64, String> {
    let found = record.get(column).unwrap_or_default();
    number(found).ok_or_else(|| {
        let (line, column) = (record.position().map_or(0, csv::Position::line), column + 1);
        format!("line {line}, column {column}: expected a finite number, found `{found}`")
    })
}

fn number(text: &str) -> Option<f64> {
    text.parse().ok().filter(|value: &f64| value.is_finite())
}

/// The divisor that converts moments to N·m.
pub(super) fn divisor(unit: MomentUnit) -> f64 {
    match unit {
        MomentUnit::NewtonMetre => 1.0,
        MomentUnit::MillinewtonMetre => MILLI,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn calibration(basis: Basis, intercept: bool, channels: usize) -> Calibration {
        let model = Model { basis, intercept, channels, memory: 0 };
        let value = |j: usize, axis: usize| (1 + j * 6 + axis) as f64 / 8.0;
        let rows = (0..model.terms().len()).map(|j| std::array::from_fn(|axis| value(j, axis)));
        Calibration::new(model, Scaling::identity(channels), rows.collect())
    }

    fn import(text: &str) -> Result<Calibration, String> {
        parse_csv(text.as_bytes(), &ImportOptions::default()).map(|(calibration, _)| calibration)
    }

    #[test]
    fn an_export_imports_to_the_same_calibration() {
        for basis in Basis::ALL {
            for intercept in [false, true] {
                let calibration = calibration(basis, intercept, 3);
                assert_eq!(
                    import(&to_csv(calibration.polynomial().unwrap(), Axes::ALL)),
                    Ok(calibration)
                );
            }
        }
    }

    #[test]
    fn some_axes_are_written_and_read_alone() {
        let mut some = calibration(Basis::Linear, true, 2);
        some.axes = [Axis::Fz, Axis::Mx].into_iter().collect();
        let text = to_csv(some.polynomial().unwrap(), some.axes);
        assert!(text.starts_with("feature,Fz_N,Mx_mNm\ns1^1,0.375,500.0\n"), "{text}");
        let read = import(&text).unwrap();
        assert_eq!(read.axes, some.axes);
        let coefficients = &read.polynomial().unwrap().coefficients;
        assert_eq!(coefficients[0], [0.0, 0.0, 0.375, 0.5, 0.0, 0.0]);
        assert!(import("feature,Fz_N,Fx_N\ns1,1,2\n").is_err());
    }

    #[test]
    fn the_export_is_in_the_lab_s_format() {
        let csv = to_csv(calibration(Basis::Cubic, true, 1).polynomial().unwrap(), Axes::ALL);
        let lines: Vec<&str> = csv.lines().collect();
        assert_eq!(lines[0], "feature,Fx_N,Fy_N,Fz_N,Mx_mNm,My_mNm,Mz_mNm");
        assert_eq!(lines[1], "s1^1,0.125,0.25,0.375,500.0,625.0,750.0");
        assert!(lines[2].starts_with("s1^2,") && lines[4].starts_with("1,"));
        assert!(
            to_csv(calibration(Basis::Poly3, false, 2).polynomial().unwrap(), Axes::ALL)
                .contains("\ns1^2*s2^1,")
        );
    }

    #[test]
    fn rows_may_come_in_any_order_and_moments_in_either_unit() {
        let csv = "feature,Fx_N,Fy_N,Fz_N,Mx_Nm,My_Nm,Mz_Nm\ns2,7,8,9,10,11,12\ns1,1,2,3,4,5,6\n";
        let calibration = import(csv).unwrap();
        assert_eq!(
            calibration.polynomial().unwrap().coefficients[0],
            [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
        );
    }

    #[test]
    fn bare_numbers_are_read_in_both_orientations() {
        let value = |j: usize, axis: usize| (j * 6 + axis).to_string();
        let line = |row: Vec<String>| row.join(",") + "\n";
        let tall: String = (0..25).map(|j| line((0..6).map(|a| value(j, a)).collect())).collect();
        let wide: String = (0..6).map(|a| line((0..25).map(|j| value(j, a)).collect())).collect();
        let calibration = import(&tall).unwrap();
        assert_eq!(calibration.name(), "cubic + offset");
        assert_eq!(
            calibration.polynomial().unwrap().coefficients[1],
            [6.0, 7.0, 8.0, 0.009, 0.01, 0.011]
        );
        assert_eq!(import(&wide), Ok(calibration));
    }

    #[test]
    fn invalid_matrices_are_refused_with_their_position() {
        let header = "feature,Fx_N,Fy_N,Fz_N,Mx_mNm,My_mNm,Mz_mNm\n";
        let cases = [
            ("", "it is `0` by `0`"),
            ("1,2\n3,4\n", "it is `2` by `2`"),
            ("1,2,3,4,5,6\n", "it is `1` by `6`"),
            ("feature,Fx_N,Fz_N,Fy_N,Mx_mNm,My_mNm,Mz_mNm\n", "`Fz_N` where `Fy_N`"),
            ("feature,Fx_lbf,Fy_N,Fz_N,Mx_mNm,My_mNm,Mz_mNm\n", "`Fx_lbf` where `Fx_N`"),
            (&format!("{header}s1,1,2,3,4,5,x\n"), "line 2, column 7"),
            (&format!("{header}s1,1,2,3,4,5\n"), "line 2, column 7"),
            (&format!("{header}s1,1,2,3,4,5,inf\n"), "found `inf`"),
            (&format!("{header}q1,1,2,3,4,5,6\n"), "line 2: `q1`"),
            (&format!("{header}s0,1,2,3,4,5,6\n"), "line 2: `s0`"),
            (&format!("{header}s1^4,1,2,3,4,5,6\n"), "line 2: `s1^4`"),
            (&format!("{header}s1,1,2,3,4,5,6\ns1^1,1,2,3,4,5,6\n"), "comes twice"),
            (&format!("{header}s255,1,2,3,4,5,6\n"), "its `1` features"),
            (header, "its `0` features"),
        ];
        for (text, expected) in cases {
            let message = import(text).unwrap_err();
            assert!(message.contains(expected), "{text}: {message}");
        }
    }

    mod matlab {
        use std::io::Write;

        use flate2::Compression;
        use flate2::write::ZlibEncoder;

        use super::*;

        /// Type, length, and content padded to eight bytes (MAT-File Format, "Level 5").
        fn element(kind: u32, content: &[u8]) -> Vec<u8> {
            let mut bytes = [kind.to_le_bytes(), (content.len() as u32).to_le_bytes()].concat();
            bytes.extend(content);
            bytes.resize(bytes.len().next_multiple_of(8), 0);
            bytes
        }

        /// A matrix of doubles with the elements 1, 2, 3, … column by column.
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
            let variable = variable.map(str::to_owned);
            super::super::parse(bytes, &ImportOptions { moment_unit: None, variable })
                .map(|(calibration, _)| calibration)
        }

        #[test]
        fn plain_and_compressed_matrices_are_equal_in_both_orientations() {
            let calibration = parse(&file(&[matrix("A", 24, 6)]), None).unwrap();
            assert_eq!(calibration.polynomial().unwrap().coefficients[1][..3], [2.0, 26.0, 50.0]);
            let packed = file(&[compressed(&matrix("A", 24, 6))]);
            assert_eq!(parse(&packed, None), Ok(calibration));
            let wide = parse(&file(&[matrix("A", 6, 24)]), None).unwrap();
            assert_eq!(wide.polynomial().unwrap().coefficients[1][..3], [7.0, 8.0, 9.0]);
        }

        #[test]
        fn usual_names_are_found_and_others_on_request() {
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
        fn truncated_files_are_errors() {
            for bytes in [file(&[matrix("N", 24, 6)]), file(&[compressed(&matrix("N", 24, 6))])] {
                for length in 128..bytes.len() {
                    assert!(parse(&bytes[..length], None).is_err(), "cut at {length}");
                }
            }
        }
    }
}
