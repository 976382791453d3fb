//! What is to be known of a conversion.

use std::path::Path;

use super::ConvertSummary;
use crate::workflow::remark::{Remark, used_rows};
use calibration_file::Diagnostics;
use forces::AppliedLowPass;
use forces::stationary::ZeroMove;

impl ConvertSummary {
    /// What was done to the log at `path`, and what may be wrong with it.
    pub fn remarks(&self, path: &Path) -> Vec<Remark> {
        let Self { rows, repeated_rows, skipped_rows, frames, .. } = *self;
        let counts = [rows, repeated_rows, skipped_rows];
        let mut remarks = vec![used_rows(path, self.rows_used, counts)];
        remarks.push(Remark::Note(self.tare_words()));
        remarks.push(Remark::Note(match self.low_pass {
            None => "low-pass: none".to_owned(),
            Some(AppliedLowPass { low_pass, rate_hz }) => {
                format!("low-pass: {low_pass}, at {rate_hz:.2} rows per second")
            }
        }));
        let path = path.display();
        let mut warn = |text: String| remarks.push(Remark::Warning(format!("`{path}`: {text}")));
        if let Some(rate) = self.sampling {
            if rate.gaps > 0 {
                warn(format!("{} gaps between frames", rate.gaps));
            }
            if rate.backwards > 0 {
                warn(format!("time stands still or runs backwards {} times", rate.backwards));
            }
        }
        let is_fixed = self.tare.as_ref().is_some_and(|tare| tare.rests.is_none());
        if let Some(text) = self.zero.as_ref().filter(|_| is_fixed).and_then(ZeroMove::in_words) {
            warn(text);
        }
        for (count, what) in [
            (self.out_of_range_frames, "outside the calibrated range"),
            (self.saturated_frames, "saturated"),
            (self.left_out_frames, "left out by the model"),
        ] {
            if count > 0 {
                let share = 100.0 * count as f64 / frames.max(1) as f64;
                warn(format!("{count} of {frames} frames ({share:.1} %) have a reading {what}"));
            }
        }
        remarks
    }

    /// What speaks against the tare, by the training data of the calibration.
    pub fn tare_doubt(&self, path: &Path, trained: Option<&Diagnostics>) -> Option<String> {
        let trained = trained?;
        let doubt = self.tare.as_ref()?.doubt(&trained.train, trained.excitation.as_ref()?)?;
        Some(format!("`{}`: {doubt}", path.display()))
    }

    fn tare_words(&self) -> String {
        let Some(tare) = &self.tare else {
            return "tare: none, zero is that of the calibration".to_owned();
        };
        let when = match (tare.start_s, tare.end_s) {
            (Some(start), Some(end)) => format!(", {start} s to {end} s"),
            _ => String::new(),
        };
        match (tare.rests, tare.last_rest_s) {
            (Some(rests), Some(last_s)) => format!(
                "tare: follows {rests} stretches at rest, the first{when}, the last until {last_s} s"
            ),
            _ => format!("tare: mean of {} frames{when}", tare.frames),
        }
    }
}
