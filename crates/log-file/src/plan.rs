//! From the wanted columns to what is parsed, and from what was parsed to a block in SI units.

use memchr::{memchr, memrchr};

use super::Wanted;
use super::console;
use super::head::Layout;
use super::mapping::Format;
use super::rows::{Parsed, RowError, RowPlan, Step};
use shell_data::block::Block;

/// How the rows of one log become blocks.
#[derive(Debug)]
pub(super) struct Plan {
    rows: Rows,
    /// How many columns are parsed.
    numbers: usize,
    time: Option<Output>,
    readings: Vec<Output>,
    wrench: Vec<Output>,
    others: Vec<Output>,
}

/// How rows are parsed.
#[derive(Debug)]
enum Rows {
    Separated(RowPlan),
    /// The wanted parts of a frame.
    Console(Vec<usize>),
}

/// A column of the block: where it is among the parsed columns, and what its values are divided by.
#[derive(Clone, Copy, Debug)]
struct Output {
    slot: usize,
    per_si_unit: f64,
}

impl Plan {
    /// How to read what is wanted, all of which the log has.
    pub(super) fn new(layout: &Layout, wanted: &Wanted) -> Self {
        let roles = &layout.roles;
        let mut places: Vec<usize> = wanted.others.clone();
        places.extend(roles.time.filter(|_| wanted.time));
        if wanted.readings {
            places.extend(&roles.sensors);
        }
        if wanted.wrench {
            places.extend(roles.wrench.iter().flatten());
        }
        places.sort_unstable();
        places.dedup();
        let output = |place: &usize| {
            let slot = places.binary_search(place).expect("every wanted place is listed");
            Output { slot, per_si_unit: layout.columns[*place].meaning.per_si_unit() }
        };
        let outputs = |wanted: bool, places: &[usize]| -> Vec<Output> {
            if wanted { places.iter().map(output).collect() } else { Vec::new() }
        };
        let wrench: Vec<usize> = roles.wrench.iter().flatten().copied().collect();
        Self {
            numbers: places.len(),
            time: roles.time.filter(|_| wanted.time).as_ref().map(output),
            readings: outputs(wanted.readings, &roles.sensors),
            wrench: outputs(wanted.wrench, &wrench),
            others: outputs(true, &wanted.others),
            rows: match layout.format {
                Format::Console => Rows::Console(places),
                _ => Rows::Separated(RowPlan {
                    separator: layout.separator,
                    steps: steps(
                        layout.columns.len(),
                        &places,
                        roles.group.filter(|_| wanted.groups),
                    ),
                    names: layout.columns.iter().map(|column| column.name.clone()).collect(),
                }),
            },
        }
    }

    /// Parses whole lines into `parsed`, which is cleared before.
    pub(super) fn parse(
        &self,
        lines: &[u8],
        skip_bad_rows: bool,
        parsed: &mut Parsed,
    ) -> Result<(), RowError> {
        match &self.rows {
            Rows::Separated(plan) => {
                // Rows differ little in length; should they, the columns grow.
                let first = memchr(b'\n', lines).unwrap_or(lines.len()) + 1;
                parsed.clear(self.numbers, lines.len() / first * 9 / 8);
                plan.parse_lines(lines, skip_bad_rows, parsed)?;
                parsed.finish();
                Ok(())
            }
            Rows::Console(places) => {
                *parsed = console::parse_lines(lines, places, skip_bad_rows)?;
                Ok(())
            }
        }
    }

    /// Makes a block of what was parsed; `context` holds the lines before it. The columns change
    /// places with those that `block` had, which can be used again.
    pub(super) fn fill(&self, block: &mut Block, parsed: &mut Parsed, context: &[u8]) {
        block.rows = parsed.rows;
        // The others come first and may share a column; all else has its own.
        block.others.resize_with(self.others.len(), Vec::new);
        for (column, output) in block.others.iter_mut().zip(&self.others) {
            column.clone_from(&parsed.columns[output.slot]);
        }
        let mut take = |column: &mut Vec<f64>, output: &Output| {
            std::mem::swap(column, &mut parsed.columns[output.slot]);
            if output.per_si_unit != 1.0 {
                column.iter_mut().for_each(|value| *value /= output.per_si_unit);
            }
        };
        if let Some(output) = &self.time {
            take(&mut block.time_s, output);
        }
        for (columns, outputs) in
            [(&mut block.readings, &self.readings), (&mut block.wrench, &self.wrench)]
        {
            columns.resize_with(outputs.len(), Vec::new);
            columns.iter_mut().zip(outputs).for_each(|(column, output)| take(column, output));
        }
        std::mem::swap(&mut block.groups, &mut parsed.groups);
        block.readings_before = self.last_readings(context);
    }

    /// The readings of the last row in `lines` that has them, `None` if there is none.
    fn last_readings(&self, lines: &[u8]) -> Option<Vec<f64>> {
        let mut end = lines.len();
        let mut parsed = Parsed::default();
        while end > 0 && !self.readings.is_empty() {
            let start = memrchr(b'\n', &lines[..end - 1]).map_or(0, |at| at + 1);
            if self.parse(&lines[start..end], false, &mut parsed).is_ok() && parsed.rows > 0 {
                return Some(self.readings.iter().map(|o| parsed.columns[o.slot][0]).collect());
            }
            end = start;
        }
        None
    }
}

/// What to do with each of the columns.
fn steps(columns: usize, places: &[usize], group: Option<usize>) -> Vec<Step> {
    let mut steps = vec![Step::Skip; columns];
    for &place in places {
        steps[place] = Step::Number;
    }
    if let Some(group) = group {
        steps[group] = Step::Group;
    }
    steps
}
