//! The design of a Butterworth low-pass.

use std::f64::consts::PI;

use super::FilterError;

/// A Butterworth low-pass: maximally flat, −3.01 dB at the cutoff, gain 1 at zero frequency.
#[derive(Clone, Debug, PartialEq)]
pub struct Butterworth {
    /// Number of poles.
    pub(super) order: usize,
    /// The frequency that is attenuated to 1/√2, Hz.
    pub(super) cutoff_hz: f64,
    /// The sampling rate designed for, Hz.
    pub(super) rate_hz: f64,
    pub(super) sections: Vec<FilterSection>,
}

/// A part of the filter with one real pole or one pair of complex poles.
///
/// `g = tan(π·cutoff/rate)` is the prewarped cutoff, `k = 1/Q` the damping.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum FilterSection {
    /// `g / (s + g)` under the bilinear transform `s = (z − 1)/(z + 1)`.
    Real { g: f64 },
    /// `g² / (s² + k·g·s + g²)` under the same.
    Pair { g: f64, k: f64 },
}

impl Butterworth {
    /// The highest order that can be asked for.
    pub(crate) const LARGEST_ORDER: usize = 16;

    /// The lowest cutoff, as a share of the rate. An answer depends on some million samples there.
    pub(crate) const LOWEST: f64 = 2e-5;

    /// A low-pass with `order` poles and its −3.01 dB point at `cutoff_hz`, for a signal sampled
    /// `rate_hz` times a second. The same filter as `scipy.signal.butter(order, cutoff, fs=rate)`.
    ///
    /// # Errors
    /// [`FilterError::Order`] outside 1..=16, [`FilterError::Rate`] unless positive and finite,
    /// [`FilterError::Cutoff`] unless between 0 and half the rate, both excluded;
    /// [`FilterError::TooSlow`] below a share of `LOWEST`(Self::LOWEST) of the rate.
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
        // The poles lie evenly on a half circle, a pair at the angle θ from the imaginary axis has
        // the damping 2·sin θ. The best damped come first, so that none rings at full amplitude.
        let real = (order % 2 == 1).then_some(FilterSection::Real { g });
        let pairs = (0..order / 2).rev().map(|pair| {
            let angle = PI * (2 * pair + 1) as f64 / (2 * order) as f64;
            FilterSection::Pair { g, k: 2.0 * angle.sin() }
        });
        let sections = real.into_iter().chain(pairs).collect();
        Ok(Self { order, cutoff_hz, rate_hz, sections })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    impl FilterSection {
        /// The section as a biquad `[b0, b1, b2, 1, a1, a2]`, as other tools take it. The poles are those of
        /// `scipy.signal.butter(…, output="sos")`; each section has gain 1 at zero frequency, where SciPy puts the whole
        /// gain in the first.
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

    /// The poles (a1, a2 of each section) of `scipy.signal.butter(order, cutoff, fs=1000,
    /// output="sos")`, SciPy 1.17.1, and the product of the sections' gains, its `sos[0, 0]`.
    #[test]
    fn sections_are_those_of_scipy() {
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
                // Both sides round a handful of times at a magnitude of 2.
                assert!((section[4] - a1).abs() < 4e-15, "{order}: {} {a1}", section[4]);
                assert!((section[5] - a2).abs() < 4e-15, "{order}: {} {a2}", section[5]);
                assert!(section[2] == 0.0 || section[1] == 2.0 * section[0]);
            }
            let product: f64 = sections.iter().map(|section| section[0]).product();
            // SciPy's gain comes from a difference of poles and is good to about 1e-13.
            assert!((product / gain - 1.0).abs() < 1e-12, "{order}: {product} {gain}");
        }
    }

    #[test]
    fn what_cannot_be_designed_is_refused_by_name() {
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
}
