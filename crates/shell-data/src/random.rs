//! Random numbers that are identical bit for bit on every machine.
//!
//! The generator is ChaCha with 8 rounds, keyed by a seed and a purpose: two purposes never share numbers. Normal
//! deviates come from the Box–Muller transform (Box & Muller, Ann. Math. Statist. 29, 610, 1958) with `libm`, because
//! the standard library's logarithm and sine differ between platforms.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    Unit = 1,
    /// Variation from recording to recording: light, warmth, mounting.
    Session = 2,
    Readings = 3,
    Reference = 4,
    TrainingPoses = 5,
    TestPoses = 6,
    /// Variation of the reference sensor's mounting from recording to recording.
    Mounting = 7,
    Losses = 8,
    Radio = 9,
    Bootstrap = 10,
    /// Variation from trial to trial of the virtual robot.
    Trial = 11,
    /// The virtual robot's leg controller.
    Controller = 12,
    /// The virtual robot's telemetry.
    Telemetry = 13,
    /// Held-out poses of a session, and the order of the other poses.
    Replay = 14,
}

#[derive(Clone, Debug)]
pub struct RandomStream {
    generator: ChaCha8Rng,
    spare: Option<f64>,
}

impl RandomStream {
    /// Makes the stream for a purpose; `index` distinguishes streams with the same purpose.
    pub fn new(seed: u64, purpose: Purpose, index: u64) -> Self {
        let mut key = [0; 32];
        key[..8].copy_from_slice(&seed.to_le_bytes());
        key[8] = purpose as u8;
        let mut generator = ChaCha8Rng::from_seed(key);
        generator.set_stream(index);
        Self { generator, spare: None }
    }

    /// Returns a number between 0 and 1, both excluded: the midpoint of one of 2⁵³ equal cells.
    pub fn uniform(&mut self) -> f64 {
        const CELL: f64 = 1.0 / (1_u64 << 53) as f64;
        ((self.generator.next_u64() >> 11) as f64 + 0.5) * CELL
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// Returns a normal deviate with mean 0 and standard deviation 1.
    pub fn normal(&mut self) -> f64 {
        if let Some(spare) = self.spare.take() {
            return spare;
        }
        let radius = (-2.0 * libm::log(self.uniform())).sqrt();
        let (sin, cos) = libm::sincos(std::f64::consts::TAU * self.uniform());
        self.spare = Some(radius * sin);
        radius * cos
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DRAWS: usize = 1_000_000;

    #[test]
    fn normal_deviates_have_the_moments_of_the_normal_distribution() {
        let mut stream = RandomStream::new(3, Purpose::Readings, 0);
        let mut sums = [0.0; 4];
        for _ in 0..DRAWS {
            let x = stream.normal();
            for (sum, power) in sums.iter_mut().zip([x, x * x, x * x * x, x * x * x * x]) {
                *sum += power;
            }
        }
        // The k-th sample moment has variance (m₂ₖ − mₖ²)/n; the tolerance is five standard deviations.
        let variances = [1.0, 2.0, 15.0, 96.0];
        for ((sum, expected), variance) in sums.into_iter().zip([0.0, 1.0, 0.0, 3.0]).zip(variances)
        {
            let tolerance = 5.0 * f64::sqrt(variance / DRAWS as f64);
            assert!((sum / DRAWS as f64 - expected).abs() < tolerance, "{sum} {expected}");
        }
    }

    #[test]
    fn normal_deviates_fill_the_tails_as_they_should() {
        let mut stream = RandomStream::new(4, Purpose::Readings, 0);
        let beyond = (0..DRAWS).filter(|_| stream.normal().abs() > 3.0).count() as f64;
        // P(|x| > 3) = erfc(3/√2) = 0.002699796; binomial, tolerance five standard deviations.
        let expected = 0.002_699_796 * DRAWS as f64;
        assert!((beyond - expected).abs() < 5.0 * expected.sqrt(), "{beyond}");
    }

    #[test]
    fn pairs_of_deviates_are_not_correlated() {
        let mut stream = RandomStream::new(5, Purpose::Readings, 0);
        let sum: f64 = (0..DRAWS).map(|_| stream.normal() * stream.normal()).sum();
        assert!((sum / DRAWS as f64).abs() < 5.0 / f64::sqrt(DRAWS as f64));
    }

    #[test]
    fn purposes_and_indices_draw_different_numbers() {
        let first = |purpose, index| RandomStream::new(1, purpose, index).uniform();
        let a = first(Purpose::Unit, 0);
        assert_eq!(a, first(Purpose::Unit, 0));
        assert_ne!(a, first(Purpose::Unit, 1));
        assert_ne!(a, first(Purpose::Session, 0));
    }
}
