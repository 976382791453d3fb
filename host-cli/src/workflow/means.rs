//! The means of groups of training rows, as a log of their own.
//!
//! Rows of a pose are one observation many times over. A fit to the means gives each pose the same weight, however
//! long it was held.

use std::collections::HashMap;
use std::io::{self, Write};

use super::WorkflowError;
use super::groups::{self, GroupBy, HeldOut};
use super::selection::UsedRows;
use calibration::double_double::DoubleDouble;
use calibration::reading_ranges::ReadingRanges;
use log_file::{Log, ReadOptions, ReadSummary};
use shell_data::block::Block;
use shell_data::wrench::Axes;

/// Training logs that were reduced to one of means.
#[derive(Debug)]
pub struct Means {
    /// A row for each group, in the order of their first rows: readings, wrench, label.
    pub log: Log,
    /// What a group is.
    pub group_by: GroupBy,
    /// How many there are.
    pub groups: usize,
    /// The rows that were taken.
    pub rows: u64,
    /// What each log was.
    pub summaries: Vec<ReadSummary>,
    /// The rows that were taken of each log.
    pub rows_of: Vec<u64>,
}

/// Reduces `train` to the means of its groups: those of `held_out`.
///
/// # Errors
/// [`WorkflowError`] if a log cannot be read, the logs differ in their channels or axes, or there are no groups.
pub fn of_groups(
    train: &[Log],
    held_out: HeldOut,
    used: UsedRows<'_>,
    read: &ReadOptions<'_>,
) -> Result<Means, WorkflowError> {
    let axes = super::agree_on_axes(train, &mut [])?;
    let group_by = groups::held_out(train, held_out, read)?.ok_or(WorkflowError::NoGroups)?;
    let wanted = group_by.wanted(train);
    let first = super::check_logs(train, &[], &wanted)?;
    let channels = first.channels();
    let mut sums = Sums::default();
    let mut rows_of = vec![0; train.len()];
    let map = |(): &mut (), log: usize, block: &mut Block| -> Result<Block, WorkflowError> {
        group_by.label(train, log, block)?;
        used.select(log, block);
        // Names what is not finite, as every fit does.
        ReadingRanges::of_block(block, channels)?;
        Ok(std::mem::take(block))
    };
    let fold = |log: usize, block: Result<Block, WorkflowError>| -> Result<(), WorkflowError> {
        let block = block?;
        rows_of[log] += block.rows as u64;
        sums.add(&block);
        Ok(())
    };
    let logs: Vec<&Log> = train.iter().collect();
    let (summaries, _) = log_file::read_all(&logs, &wanted, read, || (), map, fold)?;
    if sums.groups.is_empty() {
        return Err(WorkflowError::NoRows);
    }
    let log = Log::of_text(first.path(), |text| sums.write(channels, axes, text))?;
    Ok(Means {
        log,
        group_by,
        groups: sums.groups.len(),
        rows: rows_of.iter().sum(),
        summaries,
        rows_of,
    })
}

/// Sums of readings and wrench by group, in twice the digits: means are right to the last one, in any order of
/// the rows.
#[derive(Default)]
struct Sums {
    groups: Vec<Group>,
    places: HashMap<String, usize>,
}

struct Group {
    label: String,
    rows: f64,
    columns: Vec<DoubleDouble>,
}

impl Sums {
    fn add(&mut self, block: &Block) {
        let mut start = 0;
        for (label, rows) in &block.groups {
            let place = self.places.get(label).copied().unwrap_or_else(|| {
                let columns = vec![DoubleDouble::ZERO; block.readings.len() + block.wrench.len()];
                self.groups.push(Group { label: label.clone(), rows: 0.0, columns });
                self.places.insert(label.clone(), self.groups.len() - 1);
                self.groups.len() - 1
            });
            let group = &mut self.groups[place];
            group.rows += *rows as f64;
            let columns = block.readings.iter().chain(&block.wrench);
            for (sum, column) in group.columns.iter_mut().zip(columns) {
                let part = &column[start..start + rows];
                *sum = part.iter().fold(*sum, |sum, &x| sum + DoubleDouble::from(x));
            }
            start += rows;
        }
    }

    /// As CSV, with all digits.
    fn write(&self, channels: usize, axes: Axes, text: &mut dyn Write) -> io::Result<()> {
        let names = (1..=channels).map(|i| format!("s{i}"));
        let names = names.chain(axes.iter().map(|axis| axis.column().to_owned()));
        for name in names {
            write!(text, "{name},")?;
        }
        writeln!(text, "group")?;
        for Group { label, rows, columns } in &self.groups {
            let (readings, wrench) = columns.split_at(channels);
            let wrench = axes.iter().map(|axis| &wrench[axis.index()]);
            for sum in readings.iter().chain(wrench) {
                write!(text, "{},", (*sum / DoubleDouble::from(*rows)).to_f64())?;
            }
            let label: String =
                label.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
            writeln!(text, "\"{}\"", label.replace('"', "\"\""))?;
        }
        Ok(())
    }
}
