//! How far back a filter remembers.

use super::{Butterworth, Filter};

impl Butterworth {
    /// After how many samples the filter has forgotten what came before, to within `tolerance`.
    ///
    /// Two signals that are the same from some sample on, and before it differ by at most one,
    /// have answers that differ by at most `tolerance` from that many samples later on: the sum of
    /// `|h|` beyond, of the impulse response h, is no larger.
    ///
    /// # Panics
    /// If `tolerance` is not between 0 and 1.
    pub fn memory(&self, tolerance: f64) -> usize {
        assert!(0.0 < tolerance && tolerance < 1.0, "a tolerance between 0 and 1");
        // The slowest poles, at the angle θ = π/(2·order) from the imaginary axis, lose a factor e in
        // 1/(2π·cutoff·sin θ); near half the rate the bilinear transform makes them faster or slower,
        // which the loop sees.
        let angle = std::f64::consts::FRAC_PI_2 / self.order as f64;
        let rate = std::f64::consts::TAU * self.cutoff_hz / self.rate_hz * angle.sin();
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
            // What is beyond the pieces is a thousandth at most.
            beyond > tolerance - limit
        });
        kept.map_or(0, |last| last + 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lies_further_back_than_the_memory_does_not_matter() {
        for (order, cutoff, rate) in
            [(4, 10.0, 1000.0), (1, 10.0, 1000.0), (2, 400.0, 1000.0), (8, 3.0, 180.0)]
        {
            let design = Butterworth::low_pass(order, cutoff, rate).unwrap();
            for tolerance in [1e-3, 1e-12] {
                let memory = design.memory(tolerance);
                // The worst past: of the sign that the response has when it counts.
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
}
