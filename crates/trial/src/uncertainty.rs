//! How sure the mean force of a window is.
//!
//! The mean force less the tare is linear in the coefficients C, with d the mean features of the
//! window less those of the tare: `dᵀC`. Its error has four parts, which are added as variances:
//!
//! - that of the coefficients, `‖Tᵀd‖²` (or `S·‖Fᵀd‖²` where rows are taken as independent; see
//!   [`calibration::uncertainty`]);
//! - the noise of the tare's mean, from how its frames scatter, with what neighbours have in common
//!   (Newey & West, Econometrica 55, 1987);
//! - the noise of the window's mean, the same noise over its frames;
//! - what the calibration cannot follow, such as play in the springs: it does not average out over a
//!   window, and is taken to be the same share of any load, `(1 − R²)·(1 − σ²/S)·F²`, of
//!   the training data's unexplained variance S without the noise σ² of a frame.
//!
//! Without a tare the residual variance of the calibration stands for the last two.
//!
//! The interval is that of Student's t with the degrees of freedom of Welch and Satterthwaite.

use super::input::TrialInput;
use super::integral::Span;
use super::signals::TrialForces;
use calibration::Polynomial;
use calibration::uncertainty::{CoefficientCovariance, student_quantile};
use shell_data::wrench::{Axis, PerAxis};

/// The share of the truth that intervals are to hold.
const LEVEL: f64 = 0.95;

/// Half the width of the 95 % interval of the mean of `forces` over `span` along Fx and Fz, N; `None` if the
/// calibration carries no covariance.
pub(super) fn half_widths(
    input: &TrialInput<'_>,
    forces: &TrialForces,
    span: &Span,
) -> Option<PerAxis<f64>> {
    let (calibration, pipeline) = (input.instrument.calibration?, input.pipeline?);
    let covariance = calibration.covariance.as_ref()?;
    let polynomial = calibration.polynomial()?;
    // What each frame counts for in the mean.
    let mut shares = vec![0.0; forces.frames.first().map_or(0, Vec::len)];
    span.shares.iter().for_each(|&(row, share)| shares[forces.frame_of_row[row]] += share);
    let mut difference = mean_features(polynomial, &forces.frames, &shares);
    let mut of_tare = PerAxis::default();
    if let (Some(frames), Some(tare)) = (&pipeline.tare_frames, &pipeline.tare) {
        difference.iter_mut().zip(&tare.features).for_each(|(x, tare)| *x -= tare);
        calibration.wrench(&frames.readings, &mut of_tare);
    }
    let own_frames = shares.iter().map(|share| share * share).sum::<f64>();
    let mut half_widths = PerAxis::default();
    for axis in [Axis::Fx, Axis::Fz].map(Axis::index) {
        let variance = match &covariance.coefficients {
            CoefficientCovariance::Rows { factor } => {
                covariance.residual[axis][axis] * square(factor, &difference)
            }
            CoefficientCovariance::Groups { factors, .. } => square(&factors[axis], &difference),
        };
        let degrees_of_freedom = covariance.degrees_of_freedom as f64;
        let mut parts = vec![(variance, degrees_of_freedom)];
        let noise: &[f64] = &of_tare[axis];
        if let Some(unexplained) = input.options.unexplained {
            let residual = covariance.residual[axis][axis];
            let own = if noise.len() > 1 { variances(noise)[0] } else { 0.0 };
            let lack = if residual > 0.0 { 1.0 - own / residual } else { 0.0 };
            let load = span.mean(&forces.wrench[axis]);
            parts.push((unexplained[axis] * lack.max(0.0) * load * load, degrees_of_freedom));
        }
        if noise.len() > 1 {
            let frames = noise.len() as f64;
            let variance = variances(noise)[1] * (1.0 / frames + own_frames);
            parts.push((variance, frames - 1.0));
        } else {
            // Nothing is known of its zero and its noise but what the training rows scattered.
            parts.push((covariance.residual[axis][axis], degrees_of_freedom));
        }
        half_widths[axis] = half_width(&parts);
    }
    Some(half_widths)
}

/// `Σ share·x` of the features x of each frame.
fn mean_features(polynomial: &Polynomial, frames: &[Vec<f64>], shares: &[f64]) -> Vec<f64> {
    /// Frames whose features are held at once.
    const FRAMES: usize = 256;
    let features = &polynomial.features;
    let mut mean = vec![0.0; features.len()];
    let mut columns = vec![0.0; FRAMES * features.len()];
    let counted = |share: &f64| *share != 0.0;
    let start = shares.iter().position(counted).unwrap_or_default();
    let end = shares.iter().rposition(counted).map_or(0, |last| last + 1);
    for from in (start..end).step_by(FRAMES) {
        let rows = from..end.min(from + FRAMES);
        features.fill(frames, rows.clone(), &mut columns, FRAMES);
        for (mean, column) in mean.iter_mut().zip(columns.as_chunks::<FRAMES>().0) {
            *mean += column.iter().zip(&shares[rows.clone()]).map(|(x, s)| x * s).sum::<f64>();
        }
    }
    mean
}

/// `‖factorᵀ·x‖²`.
fn square(factor: &[Vec<f64>], x: &[f64]) -> f64 {
    let product = |column: &Vec<f64>| column.iter().zip(x).map(|(f, x)| f * x).sum::<f64>();
    factor.iter().map(|column| product(column).powi(2)).sum()
}

/// The variance of a value of `x`, of two or more, and that of their mean, times its length: Bartlett's weights over the cube root of the
/// length, and never less than if values had nothing in common.
fn variances(x: &[f64]) -> [f64; 2] {
    let n = x.len() as f64;
    let mean = x.iter().sum::<f64>() / n;
    let product = |lag: usize| {
        let pairs = x.iter().zip(&x[lag..]);
        pairs.map(|(a, b)| (a - mean) * (b - mean)).sum::<f64>() / (n - 1.0)
    };
    let lags = n.cbrt().round() as usize;
    let weighed = |lag: usize| 2.0 * (1.0 - lag as f64 / (lags + 1) as f64) * product(lag);
    let own = product(0);
    [own, own + (1..=lags.min(x.len() - 1)).map(weighed).sum::<f64>().max(0.0)]
}

/// Of variances, with the degrees of freedom that each was found with.
fn half_width(parts: &[(f64, f64)]) -> f64 {
    let variance: f64 = parts.iter().map(|part| part.0).sum();
    if variance <= 0.0 {
        return 0.0;
    }
    let spread = |&(variance, degrees): &(f64, f64)| variance * variance / degrees.max(1.0);
    let degrees_of_freedom = variance * variance / parts.iter().map(spread).sum::<f64>();
    student_quantile(LEVEL, degrees_of_freedom) * variance.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use shell_data::random::{Purpose, RandomStream};

    /// An autoregressive signal, whose variance of the mean is `σ²/(1 − φ)²/n` for long ones.
    #[test]
    fn the_variance_of_a_mean_allows_for_what_neighbours_have_in_common() {
        let mut stream = RandomStream::new(5, Purpose::Readings, 0);
        for (phi, share) in [(0.0, 1.0), (0.5, 0.8)] {
            let mut found = 0.0;
            for _ in 0..200 {
                let mut last = 0.0;
                let x: Vec<f64> = (0..400)
                    .map(|_| {
                        last = phi * last + stream.normal();
                        last
                    })
                    .collect();
                found += variances(&x)[1] / 200.0;
            }
            let expected = 1.0 / (1.0 - phi) / (1.0 - phi);
            // Bartlett's weights up to lag 7 leave 1 − 2.50/3 out of the second; white noise is
            // never taken for less than it is.
            assert!((share..1.12).contains(&(found / expected)), "{phi}: {}", found / expected);
        }
    }

    #[test]
    fn parts_of_equal_size_share_their_degrees_of_freedom() {
        let part = (2.0, 5.0);
        // Welch–Satterthwaite: twice the degrees; t(0.95, 10) = 2.228.
        assert!((half_width(&[part, part]) - 2.0 * 2.228).abs() < 2e-3);
        assert_eq!(half_width(&[(0.0, 5.0)]), 0.0);
    }
}
