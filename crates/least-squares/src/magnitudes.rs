//! How large numbers are, found while streaming: a histogram over bins of equal ratio.
//!
//! The bins are the leading bits of the numbers themselves, so that counting costs a shift. A quantile is
//! interpolated within its bin: off by 1.6 % at worst, and by far less where numbers are many. Counts
//! merge in any order to the same result: one histogram for each thread is enough.

/// A histogram of up to 2³² magnitudes, those that are zero or tiny all in the lowest bin:
/// `2^BITS` bins per factor of two, over `OCTAVES` factors of two.
#[derive(Clone, Debug, PartialEq)]
pub struct Histogram<const BITS: u32, const OCTAVES: u64> {
    counts: Vec<u32>,
}

/// As fine as prediction intervals need.
pub type Magnitudes = Histogram<6, 24>;

/// For the scale of a robust fit: quantiles to four parts in a thousand, of numbers that wild ones
/// have made small beside their unit.
pub type FineMagnitudes = Histogram<8, 48>;

/// Numbers from this power of two on share the last bin.
const TOP: u64 = 8;

impl<const BITS: u32, const OCTAVES: u64> Default for Histogram<BITS, OCTAVES> {
    /// Zero numbers.
    fn default() -> Self {
        Self { counts: vec![0; Self::BINS] }
    }
}

impl<const BITS: u32, const OCTAVES: u64> Histogram<BITS, OCTAVES> {
    /// The bin just past the last, in leading bits of a number.
    const END: u64 = (1023 + TOP) << BITS;
    const BINS: usize = (OCTAVES << BITS) as usize;

    /// Counts a magnitude, not negative, best in a unit that most are not far from.
    #[inline(always)]
    pub fn add(&mut self, size: f64) {
        let key = (size.to_bits() >> (52 - BITS)) as i64;
        let bin = key - Self::END as i64 + Self::BINS as i64;
        self.counts[bin.clamp(0, Self::BINS as i64 - 1) as usize] += 1;
    }

    /// Adds the numbers of `other`.
    pub fn merge(&mut self, other: &Self) {
        add_counts(&mut self.counts, &other.counts);
    }

    /// The number that a share of all are not above; zero in the lowest bin and for zero numbers.
    pub fn quantile(&self, share: f64) -> f64 {
        self.quantiles(&[share])[0]
    }

    /// The same for several shares in ascending order.
    pub fn quantiles(&self, shares: &[f64]) -> Vec<f64> {
        let all = self.counts.iter().map(|&n| u64::from(n)).sum::<u64>() as f64;
        let edge = |bin: usize| {
            f64::from_bits((Self::END + bin as u64 - Self::BINS as u64) << (52 - BITS))
        };
        let mut quantiles = Vec::with_capacity(shares.len());
        let mut below = 0.0;
        for (bin, &count) in self.counts.iter().enumerate().filter(|&(_, &count)| count > 0) {
            let count = f64::from(count);
            while let Some(rank) = shares.get(quantiles.len()).map(|share| share * all)
                && below + count >= rank
            {
                let within = (edge(bin + 1) - edge(bin)) * (rank - below) / count;
                quantiles.push(if bin == 0 { 0.0 } else { edge(bin) + within });
            }
            below += count;
        }
        quantiles.resize(shares.len(), 0.0);
        quantiles
    }
}

impl Magnitudes {
    /// Counts the sizes of the differences of two columns of the same length, in a unit.
    pub fn add_differences(&mut self, predicted: &[f64], measured: &[f64], unit: f64) {
        let scale = unit.recip();
        predicted.iter().zip(measured).for_each(|(p, m)| self.add((p - m).abs() * scale));
    }
}

/// No generic function, so that it is compiled here, where inner loops are, and not where it is used.
#[inline(never)]
fn add_counts(sums: &mut [u32], counts: &[u32]) {
    sums.iter_mut().zip(counts).for_each(|(sum, n)| *sum += n);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_numbers_to_the_width_of_a_bin() {
        for n in [1_u32, 2, 7, 1000] {
            let (mut even, mut odd) = (Magnitudes::default(), Magnitudes::default());
            for i in 0..n {
                let part = if i % 2 == 0 { &mut even } else { &mut odd };
                part.add(0.001 * f64::from(i * 7919 % n + 1));
            }
            even.merge(&odd);
            let shares = [0.25, 0.5, 0.95];
            for (share, found) in shares.into_iter().zip(even.quantiles(&shares)) {
                assert_eq!(found, even.quantile(share));
                let expected = 0.001 * (f64::from(n) * share).ceil();
                assert!((found / expected - 1.0).abs() < 1.6e-2, "{n}, {share}: {found}");
            }
        }
        assert_eq!(Magnitudes::default().quantile(0.5), 0.0);
    }
}
