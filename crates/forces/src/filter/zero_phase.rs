//! The filter run forward and backward over a whole signal.

use super::{Butterworth, Filter, FilterError};

impl Butterworth {
    /// How far a signal is continued at either end: it must be longer than that.
    pub(crate) fn zero_phase_reach(&self) -> usize {
        3 * (self.order + 1)
    }

    /// Filters a whole signal forward, then backward: no delay, and the attenuation of the filter
    /// twice (−6.02 dB at the cutoff).
    ///
    /// The signal is continued at both ends by its reflection through the end point, three times the
    /// order plus three samples long, and each pass starts settled at the first value it sees: what
    /// `scipy.signal.sosfiltfilt` does by default.
    ///
    /// # Errors
    /// [`FilterError::TooFewSamples`] unless the signal is longer than that continuation.
    pub fn zero_phase(&self, samples: &mut [f64]) -> Result<(), FilterError> {
        let reach = self.zero_phase_reach();
        if samples.len() <= reach {
            return Err(FilterError::TooFewSamples { samples: samples.len(), needed: reach + 1 });
        }
        let (first, last) = (samples[0], samples[samples.len() - 1]);
        let inner = &samples[1..samples.len() - 1];
        let mut before: Vec<f64> =
            samples[1..=reach].iter().rev().map(|x| 2.0 * first - x).collect();
        let after = inner.iter().rev().take(reach).map(|x| 2.0 * last - x);
        let mut after: Vec<f64> = after.collect();

        let mut forward = Filter::settled(self, before[0]);
        forward.process(&mut before);
        forward.process(samples);
        forward.process(&mut after);

        after.reverse();
        samples.reverse();
        let mut backward = Filter::settled(self, after[0]);
        backward.process(&mut after);
        backward.process(samples);
        samples.reverse();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_signal;
    use super::*;

    fn design(order: usize, cutoff: f64) -> Butterworth {
        Butterworth::low_pass(order, cutoff, 1000.0).unwrap()
    }

    /// `scipy.signal.sosfiltfilt` of SciPy 1.17.1 on [`test_signal`], at samples 0, 1, 50 and 199.
    #[test]
    fn answers_are_those_of_scipy() {
        let cases = [
            (
                4,
                10.0,
                [-40.83473399960325, -39.57353816409702, 4.669686126043902, 3.2678743702554827],
            ),
            (
                1,
                10.0,
                [-62.028610097522275, -58.147067668850546, -3.9263980947212933, 23.289536010421543],
            ),
            (
                3,
                40.0,
                [-52.68224089213457, -43.220394825809116, -8.794232033347509, 47.16196773203333],
            ),
            (
                5,
                200.0,
                [-49.972347913245, -8.673558598602098, -1.1006184550137241, 48.00572804889954],
            ),
            (
                8,
                100.0,
                [-49.98356361436764, -28.63630798195381, -5.9062277613380445, 48.0239203936249],
            ),
        ];
        for (order, cutoff, expected) in cases {
            let mut signal = test_signal();
            design(order, cutoff).zero_phase(&mut signal).unwrap();
            for (i, expected) in [0, 1, 50, 199].into_iter().zip(expected) {
                // SciPy's own settled state is off by 1.5e-14 of the continued signal's 150.
                assert!((signal[i] - expected).abs() < 1e-12 * 150.0, "{order} {i}: {}", signal[i]);
            }
        }
    }

    #[test]
    fn a_symmetric_signal_stays_symmetric_and_a_line_stays_a_line() {
        let bump = |i: i32| 1.0 / (1.0 + f64::from(i * i) / 400.0);
        let mut signal: Vec<f64> = (-500..=500).map(bump).collect();
        design(4, 50.0).zero_phase(&mut signal).unwrap();
        // The ends see the continuation in different order. The slowest pole of this filter dies
        // away by 0.89 a sample, 400 samples from the end to 1e-20.
        for i in 400..500 {
            assert!((signal[i] - signal[1000 - i]).abs() < 1e-9);
        }
        let mut line: Vec<f64> = (0..5000).map(f64::from).collect();
        design(2, 100.0).zero_phase(&mut line).unwrap();
        assert!((2000..3000).all(|i| (line[i] - i as f64).abs() < 1e-9));
    }

    #[test]
    fn a_signal_no_longer_than_its_continuation_is_refused() {
        let design = design(4, 10.0);
        let error = design.zero_phase(&mut [1.0; 15]).unwrap_err();
        assert_eq!(error, FilterError::TooFewSamples { samples: 15, needed: 16 });
        let mut constant = [1.0; 16];
        design.zero_phase(&mut constant).unwrap();
        assert_eq!(constant, [1.0; 16]);
    }
}
