//! Limits that several commands have: of errors, above which `fit` and `eval` fail, and of rows that are made.

use shell_data::wrench::Axes;
use shellcal::workflow::gates::Gates;

use super::choices::number_in;

const LIMIT: &str = "expected a finite number that is not negative";

#[derive(Debug, clap::Args)]
pub(super) struct RmsLimits {
    /// Fail when the RMS error of Fx, Fy or Fz is above this many N, or one of them is not compared
    #[arg(long, value_name = "N", value_parser = number_in(0.0..=f64::MAX, LIMIT))]
    max_rms: Option<f64>,

    /// Fail when the RMS error of Mx, My or Mz is above this many N·m, or one of them is not compared
    #[arg(long, value_name = "N·m", value_parser = number_in(0.0..=f64::MAX, LIMIT))]
    max_rms_moment: Option<f64>,
}

impl RmsLimits {
    /// Whether there are any.
    pub(super) fn are_given(&self) -> bool {
        self.max_rms.is_some() || self.max_rms_moment.is_some()
    }

    /// The gates that they are, for these axes and no others.
    pub(super) fn gates(&self, axes: Option<Axes>) -> Gates {
        Gates { force_n: self.max_rms, moment_nm: self.max_rms_moment, axes }
    }
}

/// How many rows are made at most: a slip of the finger must not fill the disk.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct RowLimit {
    /// Make no more rows than this: ten million take about one GB
    #[arg(long, value_name = "N", default_value_t = 10_000_000)]
    max_rows: u64,
}

impl RowLimit {
    /// Checks a number of rows, which may be anything.
    pub(super) fn check(self, rows: f64) -> anyhow::Result<()> {
        anyhow::ensure!(
            rows <= self.max_rows as f64,
            "{rows:e} rows were asked for, at most {} are made; if you mean it, raise `--max-rows`",
            self.max_rows
        );
        Ok(())
    }
}
