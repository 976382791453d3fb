//! How close figures are to those of the reference solution.

/// The reference is printed to 15 digits; ten more roundings lie within this.
const RELATIVE: f64 = 1e-12;
/// In SI: a decimal position rounds by up to 5e-17 m, and near a release a force changes by 1 N/m and
/// more. It shows where the forces of the reference all but cancel.
const ABSOLUTE: f64 = 2e-16;

#[track_caller]
pub(crate) fn assert_close(what: &str, found: f64, expected: f64) {
    let tolerance = RELATIVE * expected.abs() + ABSOLUTE;
    assert!((found - expected).abs() <= tolerance, "{what}: {found:e}, expected {expected:e}");
}
