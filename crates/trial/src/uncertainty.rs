//! Uncertainty of the mean force of a window.
//!
//! The tared mean force is `dᵀC`, with coefficients C and the difference d between the mean features of the window
//! and those of the tare. Its error has five parts, which add as variances:
//!
//! - the error of the coefficients, `‖Tᵀd‖²` (`S·‖Fᵀd‖²` for independent rows; see [`calibration::uncertainty`]);
//! - the noise of the tare's mean, from its frames, with their autocorrelation (Newey & West, Econometrica 55, 1987);
//! - the noise of the window's mean, from the same noise over its frames;
//! - the error of the model, such as play in the springs. It does not average out, and is taken as the same share of
//!   any load: `(1 − R²)·(1 − σ²/S)·F²`, with the training data's unexplained variance S and the noise σ² of a frame;
//! - with memory terms, the force that they would add without fading. They are learned from short loads; under longer
//!   ones play and slow creep stay, and the terms fade.
//!
//! Without a tare, the residual variance of the calibration replaces the noise. The model error of a physics model,
//! from held-out loads, includes the error of the coefficients.
//!
//! The first part and the last two come from the calibration and are common to all trials: they do not average out,
//! and cancel in a difference as far as loads agree. Means and differences are therefore computed from a vector of
//! components.
//!
//! The interval is Student's t with the Welch-Satterthwaite degrees of freedom. The coefficients have few of these if
//! few groups have large loads ([`Covariance::degrees_of_combination`]).

use super::input::TrialInput;
use super::integral::Span;
use super::signals::TrialForces;
use calibration::uncertainty::{CoefficientCovariance, Covariance, student_quantile};
use calibration::{Kind, Polynomial};
use shell_data::wrench::{Axis, PerAxis};

const LEVEL: f64 = 0.95;

#[derive(Clone, Debug, PartialEq)]
pub struct ForceUncertainty {
    /// Half the widths of 95 % intervals, N.
    pub half_widths: PerAxis<f64>,
    /// Error due to the calibration, N: components along common directions, each one standard deviation.
    pub shared: PerAxis<Vec<f64>>,
    pub degrees_of_freedom: PerAxis<f64>,
}

/// Uncertainty of the mean forces; `None` if the calibration does not provide it.
pub(super) fn of_means(
    input: &TrialInput<'_>,
    forces: &TrialForces,
    span: &Span,
) -> Option<ForceUncertainty> {
    let (calibration, pipeline) = (input.instrument.calibration?, input.pipeline?);
    let mut shares = vec![0.0; forces.frames.first().map_or(0, Vec::len)];
    span.shares.iter().for_each(|&(row, share)| shares[forces.frame_of_row[row]] += share);
    let mut of_tare = PerAxis::default();
    if let Some(frames) = &pipeline.tare_frames {
        calibration.wrench(&frames.readings, &mut of_tare);
    }
    let known = match &calibration.kind {
        Kind::Polynomial(polynomial) => {
            let covariance = calibration.covariance.as_ref()?;
            let mut difference = mean_features(polynomial, &forces.frames, &shares);
            if let (Some(_), Some(tare)) = (&pipeline.tare_frames, &pipeline.tare) {
                difference.iter_mut().zip(&tare.features).for_each(|(x, tare)| *x -= tare);
            }
            let mut known = of_polynomial(covariance, &difference);
            if let (Some(_), Some(tare)) = (&calibration.memory, &pipeline.tare_frames) {
                let unfaded = unfaded(polynomial, (&forces.frames, &shares), &tare.readings);
                known.shared.iter_mut().zip(unfaded).for_each(|(parts, part)| parts.push(part));
            }
            known
        }
        Kind::Physics(physics) => {
            // A frame's model error covers any load and mounting, and a tare removes most of it. The remainder grows
            // with the load: it is the share that held-out loads leave unexplained.
            input.options.unexplained?;
            let groups = physics.intervals.as_ref().map_or(0, |of| of.groups);
            let degrees = groups.saturating_sub(1).max(1) as f64;
            let errors = calibration.standard_errors(&forces.frames, None)?;
            let mean = |errors: &Vec<f64>| {
                let squares =
                    errors.iter().zip(&shares).map(|(error, share)| share * error * error);
                squares.sum::<f64>()
            };
            ModelErrors {
                of_frame: errors.each_ref().map(mean),
                shared: PerAxis::default(),
                frame_degrees: degrees,
                degrees_of_freedom: [degrees; 6],
            }
        }
    };
    let ModelErrors { of_frame, mut shared, frame_degrees, degrees_of_freedom } = known;
    let own_frames = shares.iter().map(|share| share * share).sum::<f64>();
    let mut half_widths = PerAxis::default();
    for axis in [Axis::Fx, Axis::Fz].map(Axis::index) {
        let noise: &[f64] = &of_tare[axis];
        if let Some(unexplained) = input.options.unexplained {
            let own = if noise.len() > 1 { variances(noise)[0] } else { 0.0 };
            let lack = if of_frame[axis] > 0.0 { 1.0 - own / of_frame[axis] } else { 0.0 };
            let share = (unexplained[axis] * lack.max(0.0)).sqrt();
            shared[axis].push(share * span.mean(&forces.wrench[axis]));
        }
        let variance = shared[axis].iter().map(|part| part * part).sum::<f64>();
        let mut parts = vec![(variance, degrees_of_freedom[axis])];
        if noise.len() > 1 {
            let frames = noise.len() as f64;
            let variance = variances(noise)[1] * (1.0 / frames + own_frames);
            parts.push((variance, frames - 1.0));
        } else {
            // Without a tare, only the scatter of the training rows indicates the error of the zero and the noise.
            parts.push((of_frame[axis], frame_degrees));
        }
        half_widths[axis] = half_width(&parts);
    }
    Some(ForceUncertainty { half_widths, shared, degrees_of_freedom })
}

struct ModelErrors {
    /// Variances, squares of N.
    of_frame: PerAxis<f64>,
    /// As in [`ForceUncertainty::shared`].
    shared: PerAxis<Vec<f64>>,
    frame_degrees: f64,
    degrees_of_freedom: PerAxis<f64>,
}

fn of_polynomial(covariance: &Covariance, difference: &[f64]) -> ModelErrors {
    let of_frame = std::array::from_fn(|axis| covariance.residual[axis][axis]);
    let shared = std::array::from_fn(|axis| match &covariance.coefficients {
        CoefficientCovariance::Rows { factor } => {
            let scale = covariance.residual[axis][axis].sqrt();
            products(factor, difference).map(|product| scale * product).collect()
        }
        CoefficientCovariance::Groups { factors, .. } => {
            products(&factors[axis], difference).collect()
        }
    });
    ModelErrors {
        of_frame,
        shared,
        frame_degrees: covariance.degrees_of_freedom as f64,
        degrees_of_freedom: covariance.degrees_of_combination(difference),
    }
}

/// Force that memory terms would add to a window's mean without fading after the tare, N and N·m: their coefficients
/// times the change of the moving averages of the readings.
fn unfaded(
    polynomial: &Polynomial,
    (window, shares): (&[Vec<f64>], &[f64]),
    tare: &[Vec<f64>],
) -> PerAxis<f64> {
    let channels = polynomial.model().channels;
    let mut force = PerAxis::default();
    for (term, coefficients) in polynomial.model().terms().iter().zip(&polynomial.coefficients) {
        let &[column] = term.factors() else { continue };
        let column = usize::from(column);
        if column < channels {
            continue;
        }
        let average = |frames: &[Vec<f64>], row: usize| {
            frames[column % channels][row] - frames.get(column).map_or(0.0, |terms| terms[row])
        };
        let rows = tare[0].len();
        let before = (0..rows).map(|row| average(tare, row)).sum::<f64>() / rows.max(1) as f64;
        let during = shares.iter().enumerate().map(|(row, share)| share * average(window, row));
        let change = (during.sum::<f64>() - before) / polynomial.scaling().scale[column];
        force.iter_mut().zip(coefficients).for_each(|(force, by)| *force += by * change);
    }
    force
}

/// `Σ share·x` of the features x of each frame.
fn mean_features(polynomial: &Polynomial, frames: &[Vec<f64>], shares: &[f64]) -> Vec<f64> {
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

fn products<'a>(factor: &'a [Vec<f64>], x: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
    factor.iter().map(move |column| column.iter().zip(x).map(|(f, x)| f * x).sum())
}

/// Variance of two or more values, and their number times the variance of their mean, with Bartlett's weights for lags
/// up to the cube root of the number. The second is never less than the first.
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

/// Half the width of the interval from variances with their degrees of freedom.
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

    /// An autoregressive signal, whose variance of the mean is `σ²/(1 − φ)²/n` for long signals.
    #[test]
    fn the_variance_of_a_mean_allows_for_correlation_of_neighbours() {
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
            // Bartlett's weights up to lag 7 miss 1 − 2.50/3 in the second case; white noise is never underestimated.
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
