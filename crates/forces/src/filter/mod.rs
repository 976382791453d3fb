//! Low-pass filtering of evenly sampled signals.
//!
//! [`Butterworth`] is the design, [`Filter`] runs it forward over a stream in constant memory
//! (causal, with the delay that this brings), [`Butterworth::zero_phase`] runs it forward and
//! backward over a whole signal (no delay, the attenuation squared).
//!
//! The transfer functions are those of `scipy.signal.butter`: the analogue prototype through the
//! bilinear transform, with the cutoff prewarped. They are realised as trapezoidal state-variable
//! sections rather than as biquads in direct form. A biquad's coefficients stand near −2 and 1 when
//! the cutoff is low, and what it does rests on their small difference: at a cutoff of 10⁻⁴ of the
//! sampling rate it has lost six digits. The state-variable form keeps them, has a gain of exactly
//! one at zero frequency, and its state is the signal itself.

use shell_data::hint::Hint;

mod butterworth;
mod memory;
mod stream;
mod zero_phase;

pub use butterworth::Butterworth;
pub use stream::Filter;

/// A filter that cannot be designed or applied as asked.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FilterError {
    /// An order of zero, or more poles than anyone can want.
    #[error("filter order `{}` is not between 1 and {}", .0, Butterworth::LARGEST_ORDER)]
    Order(usize),
    /// A sampling rate that is no positive number.
    #[error("sampling rate `{0}` Hz is not a positive number")]
    Rate(f64),
    /// A cutoff that a signal sampled at this rate does not contain.
    #[error(
        "cutoff `{cutoff_hz}` Hz is not between 0 and half the sampling rate, `{nyquist_hz}` Hz"
    )]
    Cutoff {
        /// The cutoff asked for, Hz.
        cutoff_hz: f64,
        /// Half the sampling rate, Hz.
        nyquist_hz: f64,
    },
    /// A cutoff so low that the filter would remember more than memory holds.
    #[error(
        "cutoff `{cutoff_hz}` Hz is too low for {} samples per second: at least `{}` Hz",
        *rate_hz as f32, *least_hz as f32
    )]
    TooSlow {
        /// The cutoff asked for, Hz.
        cutoff_hz: f64,
        /// The sampling rate, Hz.
        rate_hz: f64,
        /// The lowest cutoff, Hz.
        least_hz: f64,
    },
    /// A signal too short to be filtered without phase.
    #[error("`{samples}` samples are too few to filter without phase: at least `{needed}` needed")]
    TooFewSamples {
        /// Length of the signal.
        samples: usize,
        /// The least that will do.
        needed: usize,
    },
}

impl Hint for FilterError {
    fn hint(&self) -> Option<String> {
        let text = match self {
            Self::Cutoff { .. } => {
                "the low-pass runs at the rate of the log's rows; choose a lower `--lowpass`"
            }
            Self::TooFewSamples { .. } => {
                "filter forward only with `--causal`, or not at all with `--no-lowpass`"
            }
            _ => return None,
        };
        Some(text.to_owned())
    }
}

/// A signal of whole numbers without any pattern to speak of, 200 samples between −50 and 50.
#[cfg(test)]
fn test_signal() -> Vec<f64> {
    (0..200).map(|i| f64::from((i * i * 37 + 11 * i) % 101 - 50)).collect()
}
