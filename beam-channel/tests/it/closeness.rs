/// The reference has 15 digits; ten more roundings are within this.
const RELATIVE: f64 = 1e-12;
/// In SI units: a decimal position rounds by up to 5e-17 m, and near a release a force changes by 1 N/m or more.
const ABSOLUTE: f64 = 2e-16;

#[track_caller]
pub(crate) fn assert_close(what: &str, found: f64, expected: f64) {
    let tolerance = RELATIVE * expected.abs() + ABSOLUTE;
    assert!((found - expected).abs() <= tolerance, "{what}: {found:e}, expected {expected:e}");
}
