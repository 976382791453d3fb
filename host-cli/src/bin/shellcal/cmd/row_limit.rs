//! `--max-rows`: a slip of the finger must not fill the disk.

/// How many rows are made at most.
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
