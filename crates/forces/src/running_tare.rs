//! A zero that is taken while frames come.

use shell_data::wrench::PerAxis;

use super::DEFAULT_TARE_FRAMES;

/// The zero of a stream of wrenches, taken when somebody asks for it: the mean of the next
/// [`DEFAULT_TARE_FRAMES`] wrenches. It comes after tare and low-pass of the pipeline.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RunningTare {
    /// What is subtracted, N and N·m.
    pub zero: PerAxis<f64>,
    /// Wrenches of a tare that is being taken, and their sum.
    pending: Option<(usize, PerAxis<f64>)>,
}

impl RunningTare {
    /// Takes the mean of the next wrenches as zero.
    pub fn begin(&mut self) {
        self.pending = Some((0, [0.0; 6]));
    }

    /// Whether a tare is being taken.
    pub fn is_pending(&self) -> bool {
        self.pending.is_some()
    }

    /// Takes in the next wrench. Whether that has completed a tare, which then holds from this wrench on.
    pub fn push(&mut self, wrench: PerAxis<f64>) -> bool {
        let Some((count, sum)) = &mut self.pending else { return false };
        *count += 1;
        sum.iter_mut().zip(wrench).for_each(|(sum, value)| *sum += value);
        if *count < DEFAULT_TARE_FRAMES {
            return false;
        }
        let (count, sum) = (*count as f64, *sum);
        *self = Self { zero: sum.map(|sum| sum / count), pending: None };
        true
    }
}
