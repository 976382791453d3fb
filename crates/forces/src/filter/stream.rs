//! The filter at work on a stream.

use super::butterworth::{Butterworth, FilterSection};

/// A causal low-pass with its state, to be fed a signal in pieces of any size.
///
/// Starts at rest at zero, as `scipy.signal.lfilter` does: right for a signal that starts near
/// zero, as a tared one does. [`settled`](Self::settled) starts it elsewhere.
#[derive(Clone, Debug)]
pub struct Filter {
    sections: Vec<(FilterSection, FilterState)>,
}

/// The two integrators of a section: band-pass (of a pair alone) and low-pass.
#[derive(Clone, Copy, Debug)]
struct FilterState {
    band: f64,
    low: f64,
}

impl Filter {
    /// A filter at rest at zero.
    pub fn new(design: &Butterworth) -> Self {
        Self::settled(design, 0.0)
    }

    /// A filter in the state in which an endless constant `value` would have left it, as
    /// `sosfilt_zi` does: the answer to more of the same is exactly `value`.
    pub fn settled(design: &Butterworth, value: f64) -> Self {
        let state = FilterState { band: 0.0, low: value };
        Self { sections: design.sections.iter().map(|&section| (section, state)).collect() }
    }

    /// The answer to one more sample, which is not taken in: the state stays as it is.
    pub fn peek(&self, sample: f64) -> f64 {
        self.sections.iter().fold(sample, |sample, (section, state)| {
            let (mut state, mut sample) = (*state, [sample]);
            state.process(section, &mut sample);
            sample[0]
        })
    }

    /// Replaces the next samples of the signal by the filter's answer to them.
    ///
    /// The answer does not depend on how the signal is cut into pieces. A sample that is not finite
    /// spoils all that follow.
    ///
    /// Each section is integrated by the trapezoidal rule, implicitly, in closed form: A. Simper,
    /// "Linear Trapezoidal Integrated State Variable Filter" (Cytomic, 2013); V. Zavalishin, "The Art
    /// of VA Filter Design" (2018), §3.10 and §4.
    pub fn process(&mut self, samples: &mut [f64]) {
        for (section, state) in &mut self.sections {
            state.process(section, samples);
        }
    }
}

impl FilterState {
    fn process(&mut self, section: &FilterSection, samples: &mut [f64]) {
        match *section {
            FilterSection::Real { g } => self.real(g, samples),
            FilterSection::Pair { g, k } => self.pair(g, k, samples),
        }
    }

    fn real(&mut self, g: f64, samples: &mut [f64]) {
        let share = g / (1.0 + g);
        let mut low = self.low;
        for sample in samples {
            let half = share * (*sample - low);
            *sample = low + half;
            low = *sample + half;
        }
        self.low = low;
    }

    fn pair(&mut self, g: f64, k: f64, samples: &mut [f64]) {
        let a1 = 1.0 / (1.0 + g * (g + k));
        let a2 = g * a1;
        let a3 = g * a2;
        let Self { mut band, mut low } = *self;
        for sample in samples {
            let input = *sample - low;
            let band_now = a1 * band + a2 * input;
            let low_now = low + (a2 * band + a3 * input);
            band = 2.0 * band_now - band;
            low = 2.0 * low_now - low;
            *sample = low_now;
        }
        *self = Self { band, low };
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use proptest::prelude::*;

    use super::super::test_signal;
    use super::*;

    fn filtered(order: usize, cutoff: f64, rate: f64, settled: bool) -> Vec<f64> {
        let mut signal = test_signal();
        let design = Butterworth::low_pass(order, cutoff, rate).unwrap();
        let mut filter =
            if settled { Filter::settled(&design, signal[0]) } else { Filter::new(&design) };
        filter.process(&mut signal);
        signal
    }

    /// `scipy.signal.sosfilt` of SciPy 1.17.1 on [`test_signal`], at samples 0, 1, 50 and 199: from
    /// zero, and from `sosfilt_zi(sos) * x[0]`.
    #[test]
    fn answers_are_those_of_scipy() {
        let cases = [
            (
                (4, 10.0),
                [
                    -4.492430731985324e-05,
                    -0.0003538160069855908,
                    -0.05711736014830632,
                    0.46978123519076675,
                ],
                [-50.00000000000076, -49.999956872665734, -18.359427519469683, 0.8759313809617888],
            ),
            (
                (1, 10.0),
                [-1.5234373545626914, -3.0149777483768117, -5.127549162527958, -1.6574121110915483],
                [-49.99999999999995, -48.537500139619766, -7.218081322461365, -1.6575906518842416],
            ),
            (
                (3, 40.0),
                [
                    -0.07835051752941342,
                    -0.43395283019928155,
                    -11.008545071008305,
                    -7.947049773477032,
                ],
                [-49.99999999999983, -49.9247835031716, -10.904469875562278, -7.947049773193891],
            ),
            (
                (8, 100.0),
                [
                    -0.0011979822051888084,
                    -0.0153635406343838,
                    -13.618896455432493,
                    -4.555744919352755,
                ],
                [-50.00000000000007, -49.9988499370831, -13.700859852699665, -4.555744920016442],
            ),
        ];
        for ((order, cutoff), zero, settled) in cases {
            for (expected, settled) in [(zero, false), (settled, true)] {
                let answer = filtered(order, cutoff, 1000.0, settled);
                for (i, expected) in [0, 1, 50, 199].into_iter().zip(expected) {
                    // SciPy's own settled state is off by 1.5e-14 of the signal's 50 at order 4.
                    assert!((answer[i] - expected).abs() < 1e-12 * 50.0, "{order} {i}");
                }
            }
        }
    }

    /// Gain at `frequency`, from the impulse response.
    fn gain(order: usize, cutoff: f64, frequency: f64, length: usize) -> f64 {
        let mut response = vec![0.0; length];
        response[0] = 1.0;
        Filter::new(&Butterworth::low_pass(order, cutoff, 1000.0).unwrap()).process(&mut response);
        let turn = |i: usize| (TAU * frequency / 1000.0 * i as f64).sin_cos();
        let sum = response.iter().enumerate().fold((0.0, 0.0), |(re, im), (i, h)| {
            let (sin, cos) = turn(i);
            (re + h * cos, im - h * sin)
        });
        f64::hypot(sum.0, sum.1)
    }

    /// `1/√(1 + (tan(πf/fs)/tan(πfc/fs))^2n)`: Butterworth through the prewarped bilinear transform.
    fn analytic(order: i32, cutoff: f64, frequency: f64) -> f64 {
        let ratio = (TAU * frequency / 2000.0).tan() / (TAU * cutoff / 2000.0).tan();
        1.0 / (1.0 + ratio.powi(2 * order)).sqrt()
    }

    #[test]
    fn magnitude_is_the_analytic_one() {
        for order in 1..=8 {
            for (cutoff, length) in [(0.5, 60_000), (10.0, 8000), (200.0, 8000), (450.0, 8000)] {
                for share in [0.0, 0.5, 1.0, 1.1] {
                    let frequency = share * cutoff;
                    let expected = analytic(order, cutoff, frequency);
                    let found = gain(order as usize, cutoff, frequency, length);
                    // Thousands of terms summed to one: rounding of their root times 1e-16.
                    assert!((found - expected).abs() < 1e-12, "{order} {frequency}: {found}");
                }
            }
        }
        assert!((20.0 * gain(4, 10.0, 10.0, 8000).log10() + 3.010299956639812).abs() < 1e-9);
    }

    #[test]
    fn a_very_low_cutoff_keeps_its_digits() {
        // As biquads in direct form (SciPy 1.17.1) this filter has the gain 1 − 4e-10 at 0 Hz.
        for (frequency, expected) in
            [(0.0, 1.0), (0.1, 0.5f64.sqrt()), (0.2, analytic(4, 0.1, 0.2))]
        {
            let found = gain(4, 0.1, frequency, 200_000);
            assert!((found - expected).abs() < 1e-12, "{frequency}: {found} {expected}");
        }
    }

    #[test]
    fn a_constant_passes_unchanged_once_settled() {
        for order in 1..=8 {
            let design = Butterworth::low_pass(order, 0.1, 1000.0).unwrap();
            let mut filter = Filter::settled(&design, 1.0 / 3.0);
            let mut signal = vec![1.0 / 3.0; 10_000];
            filter.process(&mut signal);
            assert!(signal.iter().all(|&sample| sample == 1.0 / 3.0));
        }
    }

    #[test]
    fn a_peek_is_the_next_answer_and_changes_nothing() {
        let mut filter = Filter::new(&Butterworth::low_pass(5, 30.0, 1000.0).unwrap());
        for sample in test_signal() {
            let (peeked, again) = (filter.peek(sample), filter.peek(sample));
            let mut answer = [sample];
            filter.process(&mut answer);
            assert_eq!([peeked, again], [answer[0]; 2]);
        }
    }

    proptest! {
        #[test]
        fn pieces_give_the_answer_of_the_whole(order in 1usize..9, cut in 0usize..200) {
            let whole = filtered(order, 30.0, 1000.0, false);
            let mut pieces = test_signal();
            let mut filter = Filter::new(&Butterworth::low_pass(order, 30.0, 1000.0).unwrap());
            let (a, b) = pieces.split_at_mut(cut);
            filter.process(a);
            filter.process(b);
            prop_assert_eq!(pieces, whole);
        }
    }
}
