//! Inner products on the widest registers of the processor. Sums use eight lanes for registers of any width, so results
//! have the same bits on every machine.

use shell_data::vectorised;

#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (a, b) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    let mut sums = [0.0; 8];
    for (a, b) in a.0.iter().zip(b.0) {
        for i in 0..8 {
            sums[i] += a[i] * b[i];
        }
    }
    let rest: f64 = a.1.iter().zip(b.1).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + rest
}

vectorised! {
    /// Σ a b for each `b` of `others`.
    pub(super) fn dots(a: &[f64], others: &mut dyn Iterator<Item = &[f64]>, sums: &mut [f64]) {
        for (sum, b) in sums.iter_mut().zip(others) {
            *sum = dot(a, b);
        }
    }

    /// Σ_j w_j r_j for two sets of weights, where `rows` holds the rows r_j consecutively.
    pub(super) fn combine(
        rows: &[f64],
        weights: [[f64; 4]; 2],
        values: &mut [f64],
        slopes: &mut [f64],
    ) {
        let width = values.len();
        let (a, rest) = rows.split_at(width);
        let (b, rest) = rest.split_at(width);
        let (c, d) = rest.split_at(width);
        let (d, slopes) = (&d[..width], &mut slopes[..width]);
        let [v, s] = weights;
        for i in 0..width {
            values[i] = v[0] * a[i] + v[1] * b[i] + v[2] * c[i] + v[3] * d[i];
            slopes[i] = s[0] * a[i] + s[1] * b[i] + s[2] * c[i] + s[3] * d[i];
        }
    }
}
