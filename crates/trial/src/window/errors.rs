//! How well the data tell when a plateau begins and ends.

use super::plateau::{DragPlateau, PlateauFit};

/// Standard errors of level, entry and exit; infinite where the data do not tell.
pub(super) fn standard_errors(points: &[(f64, f64)], fit: &PlateauFit) -> [f64; 3] {
    const UNKNOWNS: usize = 5;
    let n = points.len();
    let model = |plateau: &DragPlateau, time_s: f64| fit.outside + fit.drag * plateau.share(time_s);
    let residuals: Vec<f64> =
        points.iter().map(|&(time_s, drag)| drag - model(&fit.plateau, time_s)).collect();
    let step_s = 1e-3 * (fit.plateau.exit - fit.plateau.enter);
    let moved = |enter: f64, exit: f64, ramp: f64| DragPlateau {
        enter: fit.plateau.enter + enter,
        exit: fit.plateau.exit + exit,
        ramp: fit.plateau.ramp + ramp,
    };
    let slope = |to: [f64; 3], by: f64, time_s: f64| {
        let [a, b, c] = to;
        let ahead = model(&moved(a, b, c), time_s);
        let behind = model(&moved(-a, -b, -c), time_s);
        (ahead - behind) / (2.0 * by)
    };
    let mut normal = [[0.0; UNKNOWNS]; UNKNOWNS];
    for &(time_s, _) in points {
        let row = [
            fit.plateau.share(time_s),
            slope([step_s, 0.0, 0.0], step_s, time_s),
            slope([0.0, step_s, 0.0], step_s, time_s),
            slope([0.0, 0.0, 1e-3], 1e-3, time_s),
            1.0,
        ];
        for i in 0..UNKNOWNS {
            for j in 0..UNKNOWNS {
                normal[i][j] += row[i] * row[j];
            }
        }
    }
    let variance = residuals.iter().map(|r| r * r).sum::<f64>() / (n - UNKNOWNS) as f64;
    let scale = variance * correlation_length(&residuals);
    std::array::from_fn(|i| {
        inverse_diagonal(&normal, i).map_or(f64::INFINITY, |d| (scale * d).sqrt())
    })
}

/// How many neighbours count as one: 1 + 2 Σ ρₖ over the lags up to the first that is not positive.
fn correlation_length(residuals: &[f64]) -> f64 {
    let product =
        |lag: usize| -> f64 { residuals.iter().zip(&residuals[lag..]).map(|(a, b)| a * b).sum() };
    let variance = product(0);
    if variance <= 0.0 {
        return 1.0;
    }
    let lags = (1..residuals.len() / 4).map(|lag| product(lag) / variance);
    1.0 + 2.0 * lags.take_while(|&correlation| correlation > 0.0).sum::<f64>()
}

/// A diagonal element of the inverse, by elimination with the unit vector; `None` if singular.
fn inverse_diagonal<const N: usize>(matrix: &[[f64; N]; N], index: usize) -> Option<f64> {
    let mut left = *matrix;
    let mut right = [0.0; N];
    right[index] = 1.0;
    for k in 0..N {
        let pivot = left[k][k];
        if pivot.is_nan() || pivot <= 1e-12 * matrix[k][k] || pivot <= 0.0 {
            return None;
        }
        for i in (0..N).filter(|&i| i != k) {
            let factor = left[i][k] / pivot;
            let above = left[k];
            for (value, above) in left[i].iter_mut().zip(above).skip(k) {
                *value -= factor * above;
            }
            right[i] -= factor * right[k];
        }
    }
    Some(right[index] / left[index][index])
}
