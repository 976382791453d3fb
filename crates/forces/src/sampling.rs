//! Statistics of the periods between frames, while streaming.

/// Histogram steps per doubling of the period: 0.3 % each.
const STEPS: f64 = 256.0;
/// The histogram resolves periods from 2⁻³⁰ s (1 ns) to 2³⁰ s (34 years).
const DOUBLINGS: i32 = 30;
/// A period this many times the usual one is a gap in the recording.
const GAP: f64 = 10.0;

#[derive(Clone, Debug, Default)]
pub struct Sampling {
    last_s: Option<f64>,
    /// Number and sum, s, of the periods in each step of the histogram.
    steps: Vec<(u64, f64)>,
    backwards: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Rate {
    /// Frames per second, without gaps.
    pub mean_hz: f64,
    /// One over the median period.
    pub median_hz: f64,
    /// Distance between the 5th and the 95th percentile of the periods, divided by the median.
    pub spread: f64,
    /// Number of periods more than ten times the median.
    pub gaps: u64,
    pub backwards: u64,
}

impl Sampling {
    pub fn add(&mut self, time_s: &[f64]) {
        self.steps.resize(2 * DOUBLINGS as usize * STEPS as usize, (0, 0.0));
        for &time in time_s {
            if let Some(last) = self.last_s.replace(time) {
                let period = time - last;
                if period > 0.0 {
                    let step = ((period.log2() + f64::from(DOUBLINGS)) * STEPS) as usize;
                    let step = step.min(self.steps.len() - 1);
                    self.steps[step].0 += 1;
                    self.steps[step].1 += period;
                } else {
                    self.backwards += 1;
                }
            }
        }
    }

    /// The rate; `None` if time never advances between frames.
    pub fn rate(&self) -> Option<Rate> {
        let periods: u64 = self.steps.iter().map(|step| step.0).sum();
        let median = self.percentile(periods, 0.5)?;
        let spread = self.percentile(periods, 0.95)? - self.percentile(periods, 0.05)?;
        let is_gap = |&&(count, sum): &&(u64, f64)| sum > GAP * median * count as f64;
        let gaps = self.steps.iter().filter(is_gap).map(|step| step.0).sum();
        let usual = self.steps.iter().filter(|step| !is_gap(step));
        let (count, sum) = usual.fold((0, 0.0), |(n, s), &(count, sum)| (n + count, s + sum));
        Some(Rate {
            mean_hz: count as f64 / sum,
            median_hz: 1.0 / median,
            spread: spread / median,
            gaps,
            backwards: self.backwards,
        })
    }

    /// The mean period, s, of the step that contains a percentile: exact if all periods are equal.
    fn percentile(&self, periods: u64, share: f64) -> Option<f64> {
        let rank = (share * periods as f64).ceil().max(1.0) as u64;
        let mut passed = 0;
        let holds = |&&(count, _): &&(u64, f64)| {
            passed += count;
            passed >= rank
        };
        self.steps.iter().find(holds).filter(|step| step.0 > 0).map(|step| step.1 / step.0 as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rate(times: &[f64]) -> Option<Rate> {
        let mut sampling = Sampling::default();
        // In two pieces: the period between blocks must be counted.
        let (a, b) = times.split_at(times.len() / 2);
        sampling.add(a);
        sampling.add(b);
        sampling.rate()
    }

    #[test]
    fn even_sampling_has_its_rate_and_no_spread() {
        let times: Vec<f64> = (0..1000).map(|i| 5.0 + f64::from(i) / 1000.0).collect();
        let rate = rate(&times).unwrap();
        // Times near 5 s have rounding errors of 1e-15 s; the period is 1e-3 s.
        assert!((rate.median_hz - 1000.0).abs() < 1e-6 && (rate.mean_hz - 1000.0).abs() < 1e-6);
        assert!(rate.spread < 0.01, "{rate:?}");
        assert_eq!((rate.gaps, rate.backwards), (0, 0));
    }

    #[test]
    fn gaps_and_steps_back_are_counted_and_do_not_change_the_rate() {
        let times = [0.0, 0.25, 0.5, 0.75, 10.0, 10.25, 10.25, 10.0, 10.25];
        let rate = rate(&times).unwrap();
        assert_eq!((rate.mean_hz, rate.median_hz), (4.0, 4.0));
        assert_eq!((rate.gaps, rate.backwards), (1, 2));
    }

    #[test]
    fn uneven_sampling_has_a_spread() {
        // Alternating periods of 4 and 10 ms: 7 ms on average.
        let times: Vec<f64> =
            (0..200).map(|i| f64::from(i / 2) * 0.014 + f64::from(i % 2) * 0.004).collect();
        let rate = rate(&times).unwrap();
        assert!((rate.mean_hz - 1.0 / 0.007).abs() < 0.5, "{rate:?}");
        assert!(rate.spread > 0.5);
    }

    #[test]
    fn without_time_passing_there_is_no_rate() {
        assert_eq!(rate(&[]), None);
        assert_eq!(rate(&[1.0]), None);
        assert_eq!(rate(&[1.0, 1.0, 0.5]), None);
        assert!(rate(&[0.0, 1e-300, 1e300]).unwrap().mean_hz > 0.0);
    }
}
