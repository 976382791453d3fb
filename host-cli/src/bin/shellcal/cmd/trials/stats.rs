//! `shellcal stats`: statistics of a table of values by condition.

use trial::ValueTable;

use super::evaluation::{BOOTSTRAP_SEED, ReferenceArg, require_condition};
use super::show;
use crate::files::{InputPath, read_text};
use crate::printer::Printer;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal stats specific_resistance_per_stride.csv
  shellcal stats results/strides.csv --of drag_energy_j --reference free")]
pub(crate) struct StatsArgs {
    /// Table, as CSV with a header
    #[arg(value_name = "TABLE")]
    table: InputPath,

    /// Column of conditions [default: `condition`, otherwise the first]
    #[arg(long, value_name = "COLUMN")]
    by: Option<String>,

    /// Columns of values [default: all numeric columns]
    #[arg(long, value_name = "COLUMNS", value_delimiter = ',')]
    of: Option<Vec<String>>,

    /// Column that assigns rows to trials; rows of one trial resemble each other [default: the first of
    /// `file`, `trial`, `run`, `log` and `session`]
    #[arg(long, value_name = "COLUMN")]
    trial: Option<String>,

    #[command(flatten)]
    compared: ReferenceArg,
}

/// Maximum number of conditions of a table: each takes memory for its samples.
const MOST_CONDITIONS: usize = 10_000;

impl StatsArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        let path = self.table.display();
        let text = read_text(&self.table)?;
        let (by, trial) = (self.by.as_deref(), self.trial.as_deref());
        let table = ValueTable::parse(&text, by, trial, self.of.as_deref())
            .map_err(|problem| anyhow::anyhow!("{path}:{problem}"))?;
        let found = table.conditions.len();
        anyhow::ensure!(
            found <= MOST_CONDITIONS,
            "{path}: `{}` names {found} conditions, at most {MOST_CONDITIONS} are compared; name the column of \
             conditions with `--by`",
            table.by
        );
        let conditions = table.conditions.iter().map(|(name, _)| &**name);
        require_condition("row", conditions, self.compared.reference.as_deref())?;
        for (quantity, &missing) in table.quantities.iter().zip(&table.missing) {
            if missing > 0 {
                printer.note(format!("{quantity}: {missing} missing values are left out"));
            }
        }
        for problem in &table.left_out {
            printer.warning(format!("{path}:{problem}; the column is left out"));
        }
        let rows = table.statistics(self.compared.reference.as_deref(), BOOTSTRAP_SEED);
        printer.finish(&rows, |printer| {
            table.quantities.iter().enumerate().for_each(|(at, quantity)| {
                if at > 0 {
                    printer.line("");
                }
                let trials = table.trial.as_ref();
                let trials = trials.map_or_else(String::new, |of| format!(", trials by {of}"));
                printer.line(format!("{quantity} by {}{trials}", table.by));
                let rows = rows.iter().filter(|row| row.quantity == *quantity);
                let numbers: Vec<_> = rows
                    .map(|row| (&*row.condition, &row.statistics, row.difference.as_ref()))
                    .collect();
                show::statistics(printer, quantity, &numbers, 1.0)
            })
        })
    }
}
