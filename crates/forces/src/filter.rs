//! Low-pass filtering of evenly sampled signals.
//!
//! [`Butterworth`] is the design. [`Filter`] runs it forward over a stream in constant memory (causal, with a delay),
//! [`Butterworth::zero_phase`] forward and backward over a whole signal (no delay, twice the attenuation in dB).
//!
//! The transfer functions equal `scipy.signal.butter`: the analogue prototype under the bilinear transform, with a
//! prewarped cutoff. A direct-form biquad with a low cutoff depends on small differences of coefficients near −2 and
//! 1: at 10⁻⁴ of the sampling rate it has lost six digits. Trapezoidal state-variable sections keep them, have a gain
//! of exactly one at zero frequency, and their state is the signal itself.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use shell_data::hint::Hint;

#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FilterError {
    #[error("filter order `{}` is not between 1 and {}", .0, Butterworth::LARGEST_ORDER)]
    Order(usize),
    #[error("sampling rate `{0}` Hz is not a positive number")]
    Rate(f64),
    #[error(
        "cutoff `{cutoff_hz}` Hz is not between 0 and half the sampling rate, `{nyquist_hz}` Hz"
    )]
    Cutoff { cutoff_hz: f64, nyquist_hz: f64 },
    /// The filter's memory would exceed the limit; `least_hz` is the lowest allowed.
    #[error(
        "cutoff `{cutoff_hz}` Hz is too low for {} samples per second: at least `{}` Hz",
        *rate_hz as f32, *least_hz as f32
    )]
    TooSlow { cutoff_hz: f64, rate_hz: f64, least_hz: f64 },
    #[error("`{samples}` samples are too few to filter without phase: at least `{needed}` needed")]
    TooFewSamples { samples: usize, needed: usize },
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

/// A Butterworth low-pass: maximally flat, −3.01 dB at the cutoff, gain 1 at zero frequency.
#[derive(Clone, Debug, PartialEq)]
pub struct Butterworth {
    order: usize,
    /// Frequency at which the gain is 1/√2, Hz.
    cutoff_hz: f64,
    rate_hz: f64,
    sections: Vec<FilterSection>,
}

/// One real pole or a pair of complex poles. `g = tan(π·cutoff/rate)` is the prewarped cutoff, `k = 1/Q` the damping.
#[derive(Clone, Copy, Debug, PartialEq)]
enum FilterSection {
    /// `g / (s + g)` under the bilinear transform `s = (z − 1)/(z + 1)`.
    Real { g: f64 },
    /// `g² / (s² + k·g·s + g²)` under the same transform.
    Pair { g: f64, k: f64 },
}

impl Butterworth {
    pub(crate) const LARGEST_ORDER: usize = 16;

    /// The lowest cutoff, as a share of the rate. At this cutoff, an output depends on about a million samples.
    pub(crate) const LOWEST: f64 = 2e-5;

    /// Designs a low-pass with −3.01 dB at `cutoff_hz`, as `scipy.signal.butter(order, cutoff, fs=rate)`.
    ///
    /// # Errors
    /// [`FilterError::Order`] outside 1..=16, [`FilterError::Rate`] unless positive and finite,
    /// [`FilterError::Cutoff`] unless between 0 and half the rate, both excluded;
    /// [`FilterError::TooSlow`] below `LOWEST` times the rate.
    pub fn low_pass(order: usize, cutoff_hz: f64, rate_hz: f64) -> Result<Self, FilterError> {
        if !(1..=Self::LARGEST_ORDER).contains(&order) {
            return Err(FilterError::Order(order));
        }
        if !(rate_hz > 0.0 && rate_hz.is_finite()) {
            return Err(FilterError::Rate(rate_hz));
        }
        let nyquist_hz = rate_hz / 2.0;
        if !(cutoff_hz > 0.0 && cutoff_hz < nyquist_hz) {
            return Err(FilterError::Cutoff { cutoff_hz, nyquist_hz });
        }
        let least_hz = Self::LOWEST * rate_hz;
        if cutoff_hz < least_hz {
            return Err(FilterError::TooSlow { cutoff_hz, rate_hz, least_hz });
        }
        let g = (PI * (cutoff_hz / rate_hz)).tan();
        // The poles lie evenly on a half circle; a pair at the angle θ from the imaginary axis has the damping 2·sin
        // θ. The best damped pairs come first, so no section rings at full amplitude.
        let real = (order % 2 == 1).then_some(FilterSection::Real { g });
        let pairs = (0..order / 2).rev().map(|pair| {
            let angle = PI * (2 * pair + 1) as f64 / (2 * order) as f64;
            FilterSection::Pair { g, k: 2.0 * angle.sin() }
        });
        let sections = real.into_iter().chain(pairs).collect();
        Ok(Self { order, cutoff_hz, rate_hz, sections })
    }

    /// Number of samples after which the filter has forgotten its past. Two signals that differed by at most one before
    /// these samples give outputs that differ by at most `tolerance`, the bound on the sum of `|h|` over the tail of
    /// the impulse response h.
    ///
    /// # Panics
    /// If `tolerance` is not between 0 and 1.
    pub fn memory(&self, tolerance: f64) -> usize {
        assert!(0.0 < tolerance && tolerance < 1.0, "a tolerance between 0 and 1");
        // The slowest poles, at the angle θ = π/(2·order) from the imaginary axis, decay by a factor e in
        // 1/(2π·cutoff·sin θ) s. The loop accounts for the bilinear transform near half the rate.
        let angle = FRAC_PI_2 / self.order as f64;
        let rate = TAU * self.cutoff_hz / self.rate_hz * angle.sin();
        let piece = (4.0 / rate).ceil() as usize;
        let mut filter = Filter::new(self);
        let mut response = vec![0.0; piece];
        response[0] = 1.0;
        filter.process(&mut response);
        let limit = tolerance * 1e-3;
        loop {
            let start = response.len();
            response.resize(start + piece, 0.0);
            filter.process(&mut response[start..]);
            if response[start..].iter().all(|h| h.abs() < limit / piece as f64) {
                break;
            }
        }
        let mut beyond = 0.0;
        let kept = response.iter().rposition(|h| {
            beyond += h.abs();
            // The tail beyond the pieces is at most a thousandth of the tolerance.
            beyond > tolerance - limit
        });
        kept.map_or(0, |last| last + 1)
    }

    /// Number of samples by which each end of a signal is continued; the signal must be longer.
    pub(crate) fn zero_phase_reach(&self) -> usize {
        3 * (self.order + 1)
    }

    /// Filters a whole signal forward, then backward: no delay, and twice the attenuation (−6.02 dB at the cutoff).
    /// Each end is continued by `3·(order + 1)` samples: its reflection through the end point. Each pass starts settled
    /// at its first value, as in `scipy.signal.sosfiltfilt`.
    ///
    /// # Errors
    /// [`FilterError::TooFewSamples`] unless the signal is longer than the continuation of an end.
    pub fn zero_phase(&self, samples: &mut [f64]) -> Result<(), FilterError> {
        let reach = self.zero_phase_reach();
        if samples.len() <= reach {
            return Err(FilterError::TooFewSamples { samples: samples.len(), needed: reach + 1 });
        }
        let end = samples.len() - 1;
        let (first, last) = (samples[0], samples[end]);
        let before = samples[1..=reach].iter().rev().map(|x| 2.0 * first - x);
        let after = samples[end - reach..end].iter().rev().map(|x| 2.0 * last - x);
        let mut longer: Vec<f64> = before.chain(samples.iter().copied()).chain(after).collect();
        for _direction in ["forward", "backward"] {
            Filter::settled(self, longer[0]).process(&mut longer);
            longer.reverse();
        }
        samples.copy_from_slice(&longer[reach..][..samples.len()]);
        Ok(())
    }
}

/// A causal low-pass, fed in pieces of any size. It starts at zero, as `scipy.signal.lfilter` does, which suits a tared
/// signal; [`settled`](Self::settled) starts at another value.
#[derive(Clone, Debug)]
pub struct Filter {
    sections: Vec<(FilterSection, FilterState)>,
}

/// State of the two integrators of a section: band-pass (used by a pair only) and low-pass.
#[derive(Clone, Copy, Debug)]
struct FilterState {
    band: f64,
    low: f64,
}

impl Filter {
    pub fn new(design: &Butterworth) -> Self {
        Self::settled(design, 0.0)
    }

    /// Starts in the state after an endless constant `value`, as `sosfilt_zi` does:
    /// further samples of `value` give exactly `value`.
    pub fn settled(design: &Butterworth, value: f64) -> Self {
        let state = FilterState { band: 0.0, low: value };
        Self { sections: design.sections.iter().map(|&section| (section, state)).collect() }
    }

    pub fn peek(&self, sample: f64) -> f64 {
        self.sections.iter().fold(sample, |sample, (section, state)| {
            let (mut state, mut sample) = (*state, [sample]);
            state.process(section, &mut sample);
            sample[0]
        })
    }

    /// Replaces samples by the output, in pieces of any size. A sample that is not finite spoils all later ones.
    ///
    /// Each section is integrated by the trapezoidal rule, implicitly, in closed form: A. Simper,
    /// "Linear Trapezoidal Integrated State Variable Filter" (Cytomic, 2013); V. Zavalishin, "The
    /// Art of VA Filter Design" (2018), §3.10 and §4.
    pub fn process(&mut self, samples: &mut [f64]) {
        for (section, state) in &mut self.sections {
            state.process(section, samples);
        }
    }
}

impl FilterState {
    fn process(&mut self, section: &FilterSection, samples: &mut [f64]) {
        let Self { mut band, mut low } = *self;
        match *section {
            FilterSection::Real { g } => {
                let share = g / (1.0 + g);
                for sample in samples {
                    let half = share * (*sample - low);
                    *sample = low + half;
                    low = *sample + half;
                }
            }
            FilterSection::Pair { g, k } => {
                let a1 = 1.0 / (1.0 + g * (g + k));
                let a2 = g * a1;
                let a3 = g * a2;
                for sample in samples {
                    let input = *sample - low;
                    let band_now = a1 * band + a2 * input;
                    let low_now = low + (a2 * band + a3 * input);
                    band = 2.0 * band_now - band;
                    low = 2.0 * low_now - low;
                    *sample = low_now;
                }
            }
        }
        *self = Self { band, low };
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use proptest::prelude::*;

    use super::*;

    /// A signal of whole numbers without an obvious pattern, 200 samples between −50 and 50.
    fn test_signal() -> Vec<f64> {
        (0..200).map(|i| f64::from((i * i * 37 + 11 * i) % 101 - 50)).collect()
    }

    impl FilterSection {
        /// The biquad `[b0, b1, b2, 1, a1, a2]`, with the poles of `scipy.signal.butter(…, output="sos")`. Each
        /// section has gain 1 at zero frequency; SciPy puts the whole gain in the first.
        fn biquad(&self) -> [f64; 6] {
            match *self {
                FilterSection::Real { g } => {
                    let scale = 1.0 / (1.0 + g);
                    [g * scale, g * scale, 0.0, 1.0, (g - 1.0) * scale, 0.0]
                }
                FilterSection::Pair { g, k } => {
                    let scale = 1.0 / (1.0 + g * (g + k));
                    let b = g * g * scale;
                    let a1 = 2.0 * (g * g - 1.0) * scale;
                    [b, 2.0 * b, b, 1.0, a1, (1.0 + g * (g - k)) * scale]
                }
            }
        }
    }

    /// Expected, from `scipy.signal.butter(order, cutoff, fs=1000, output="sos")` of SciPy 1.17.1: the poles (a1 and a2
    /// of each section) and the product of the sections' gains (`sos[0, 0]`).
    #[test]
    fn sections_equal_scipy() {
        let cases: [(usize, f64, f64, &[[f64; 2]]); 4] = [
            (
                4,
                10.0,
                8.984861463970648e-07,
                &[
                    [-1.8866095826215064, 0.8903397362840242],
                    [-1.9492159580258417, 0.9530698953278909],
                ],
            ),
            (1, 10.0, 0.03046874709125383, &[[-0.9390625058174923, 0.0]]),
            (
                5,
                200.0,
                0.02193962068846417,
                &[
                    [-0.15838444032453627, 0.0],
                    [-0.3492860258606905, 0.13031332327594414],
                    [-0.4776547730940111, 0.5457233155094577],
                ],
            ),
            (
                8,
                100.0,
                2.395964410377617e-05,
                &[
                    [-1.0263514742610553, 0.26864019099379005],
                    [-1.0868584613628944, 0.343430940165366],
                    [-1.2197253651240232, 0.5076634651740437],
                    [-1.4515795942478362, 0.794251053241888],
                ],
            ),
        ];
        for (order, cutoff, gain, poles) in cases {
            let sections = {
                let filter = Butterworth::low_pass(order, cutoff, 1000.0).unwrap();
                filter.sections.iter().map(FilterSection::biquad).collect::<Vec<_>>()
            };
            assert_eq!(sections.len(), poles.len());
            for (section, [a1, a2]) in sections.iter().zip(poles) {
                // Both values, of magnitude 2, carry a few rounding errors.
                assert!((section[4] - a1).abs() < 4e-15, "{order}: {} {a1}", section[4]);
                assert!((section[5] - a2).abs() < 4e-15, "{order}: {} {a2}", section[5]);
                assert!(section[2] == 0.0 || section[1] == 2.0 * section[0]);
            }
            let product: f64 = sections.iter().map(|section| section[0]).product();
            // SciPy's gain comes from a difference of poles and is accurate to about 1e-13.
            assert!((product / gain - 1.0).abs() < 1e-12, "{order}: {product} {gain}");
        }
    }

    #[test]
    fn impossible_designs_are_refused_by_name() {
        let of = |order, cutoff, rate| Butterworth::low_pass(order, cutoff, rate).unwrap_err();
        assert_eq!(of(0, 10.0, 1000.0), FilterError::Order(0));
        assert_eq!(of(17, 10.0, 1000.0), FilterError::Order(17));
        assert_eq!(
            of(4, 500.0, 1000.0).to_string(),
            "cutoff `500` Hz is not between 0 and half the sampling rate, `500` Hz"
        );
        assert_eq!(
            of(4, 0.019, 1000.0).to_string(),
            "cutoff `0.019` Hz is too low for 1000 samples per second: at least `0.02` Hz"
        );
        for cutoff in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(matches!(of(4, cutoff, 1000.0), FilterError::Cutoff { .. }));
        }
        for rate in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(matches!(of(4, 10.0, rate), FilterError::Rate(_)));
        }
    }

    #[test]
    fn samples_older_than_the_memory_have_no_effect() {
        for (order, cutoff, rate) in
            [(4, 10.0, 1000.0), (1, 10.0, 1000.0), (2, 400.0, 1000.0), (8, 3.0, 180.0)]
        {
            let design = Butterworth::low_pass(order, cutoff, rate).unwrap();
            for tolerance in [1e-3, 1e-12] {
                let memory = design.memory(tolerance);
                // The worst past has the sign of the response at each sample.
                let mut response = vec![0.0; 20 * memory.max(10)];
                response[0] = 1.0;
                Filter::new(&design).process(&mut response);
                let worst = |n: usize| response[n..].iter().map(|h| h.abs()).sum::<f64>();
                assert!(worst(memory) <= tolerance, "{order} {tolerance}");
                assert!(memory == 0 || worst(memory - 1) > 0.9 * tolerance, "{order} {tolerance}");
            }
        }
    }

    #[test]
    fn the_lab_s_filter_forgets_in_little_more_than_a_second() {
        let design = Butterworth::low_pass(4, 10.0, 1000.0).unwrap();
        let seconds = design.memory(1e-12) as f64 / 1000.0;
        // ln(1e12) time constants of 1/(2π·10·sin(π/8)) s are 1.15 s.
        assert!((1.15..1.3).contains(&seconds), "{seconds}");
    }

    fn design(order: usize, cutoff: f64) -> Butterworth {
        Butterworth::low_pass(order, cutoff, 1000.0).unwrap()
    }

    /// Expected: `scipy.signal.sosfiltfilt` of SciPy 1.17.1 on [`test_signal`], at samples 0, 1, 50 and 199.
    #[test]
    fn zero_phase_output_equals_scipy() {
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
                // SciPy's own settled state is off by 1.5e-14 of the continued signal's range of 150.
                assert!((signal[i] - expected).abs() < 1e-12 * 150.0, "{order} {i}: {}", signal[i]);
            }
        }
    }

    /// Expected: `scipy.signal.sosfiltfilt` of SciPy 1.17.1 on signals one sample longer than their
    /// continuation, with a cutoff of 10 Hz at 100 Hz.
    #[test]
    fn the_shortest_signals_are_filtered_as_scipy_does() {
        let cases = [
            (
                4,
                16,
                [
                    -5.010114740178325,
                    -2.2374615947879324,
                    1.9890588293465288,
                    3.9863138833114458,
                    4.837403417962421,
                ],
            ),
            (
                3,
                13,
                [
                    -4.967636884763591,
                    -2.191828169707251,
                    1.6746552471848495,
                    3.3907224936531484,
                    4.890206447158078,
                ],
            ),
        ];
        for (order, rows, expected) in cases {
            let value = |i: i32| f64::from(i * 7 % 11) - 5.0 + 0.25 * f64::from(i);
            let mut signal: Vec<f64> = (0..rows).map(value).collect();
            let design = Butterworth::low_pass(order, 10.0, 100.0).unwrap();
            design.zero_phase(&mut signal).unwrap();
            let end = signal.len() - 1;
            for (at, expected) in [0, 1, 7, end - 1, end].into_iter().zip(expected) {
                // SciPy's own settled state is off by 1.5e-14 of the continued signal's range of 20.
                assert!((signal[at] - expected).abs() < 1e-12, "{order} {at}: {}", signal[at]);
            }
        }
    }

    #[test]
    fn a_symmetric_signal_stays_symmetric_and_a_line_stays_a_line() {
        let bump = |i: i32| 1.0 / (1.0 + f64::from(i * i) / 400.0);
        let mut signal: Vec<f64> = (-500..=500).map(bump).collect();
        design(4, 50.0).zero_phase(&mut signal).unwrap();
        // The two ends process the continuation in different order. The slowest pole of this filter decays by a factor
        // of 0.89 per sample, so to 1e-20 at 400 samples from the end.
        for i in 400..500 {
            assert!((signal[i] - signal[1000 - i]).abs() < 1e-9);
        }
        let mut line: Vec<f64> = (0..5000).map(f64::from).collect();
        design(2, 100.0).zero_phase(&mut line).unwrap();
        assert!((2000..3000).all(|i| (line[i] - i as f64).abs() < 1e-9));
    }

    #[test]
    fn a_signal_shorter_than_its_padding_is_refused() {
        let design = design(4, 10.0);
        let error = design.zero_phase(&mut [1.0; 15]).unwrap_err();
        assert_eq!(error, FilterError::TooFewSamples { samples: 15, needed: 16 });
        let mut constant = [1.0; 16];
        design.zero_phase(&mut constant).unwrap();
        assert_eq!(constant, [1.0; 16]);
    }

    fn filtered(order: usize, cutoff: f64, rate: f64, settled: bool) -> Vec<f64> {
        let mut signal = test_signal();
        let design = Butterworth::low_pass(order, cutoff, rate).unwrap();
        let mut filter =
            if settled { Filter::settled(&design, signal[0]) } else { Filter::new(&design) };
        filter.process(&mut signal);
        signal
    }

    /// Expected: `scipy.signal.sosfilt` of SciPy 1.17.1 on [`test_signal`], at samples 0, 1, 50 and
    /// 199: from zero, and from `sosfilt_zi(sos) * x[0]`.
    #[test]
    fn causal_output_equals_scipy() {
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
                let output = filtered(order, cutoff, 1000.0, settled);
                for (i, expected) in [0, 1, 50, 199].into_iter().zip(expected) {
                    // SciPy's own settled state is off by 1.5e-14 of the signal's range of 50 at order 4.
                    assert!((output[i] - expected).abs() < 1e-12 * 50.0, "{order} {i}");
                }
            }
        }
    }

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
                    // Thousands of terms sum to one; the rounding error grows with the root of their number.
                    assert!((found - expected).abs() < 1e-12, "{order} {frequency}: {found}");
                }
            }
        }
        assert!((20.0 * gain(4, 10.0, 10.0, 8000).log10() + 3.010299956639812).abs() < 1e-9);
    }

    #[test]
    fn a_very_low_cutoff_keeps_its_digits() {
        // As direct-form biquads (SciPy 1.17.1) this filter has a gain of 1 − 4e-10 at 0 Hz.
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
    fn a_peek_equals_the_next_output_and_keeps_the_state() {
        let mut filter = Filter::new(&Butterworth::low_pass(5, 30.0, 1000.0).unwrap());
        for sample in test_signal() {
            let (peeked, again) = (filter.peek(sample), filter.peek(sample));
            let mut output = [sample];
            filter.process(&mut output);
            assert_eq!([peeked, again], [output[0]; 2]);
        }
    }

    proptest! {
        #[test]
        fn pieces_give_the_output_of_the_whole(order in 1usize..9, cut in 0usize..200) {
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
