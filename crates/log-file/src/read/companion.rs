//! Opening a log whose columns are continued in another file, after a check that the rows of both belong together.

use std::path::Path;

use super::all::ReadOptions;
use crate::error::LogError;
use crate::format::columns::Wanted;
use crate::format::layout::Header;
use crate::format::mapping::{ColumnRef, LogFormat, Mapping};
use crate::log::Log;
use crate::stream::companion::RowMismatch;
use crate::stream::source::LogSource;
use shell_data::statistics::upper_median;

/// Checks that the rows of two logs are at the same times, within half a step, if both have a clock.
fn check_times(first: &Log, second: &Log) -> Result<(), LogError> {
    if !first.has_time() || !second.has_time() {
        return Ok(());
    }
    let wanted = Wanted { time: true, ..Wanted::default() };
    let times = |log: &Log| log.read_whole(&wanted, &ReadOptions::default());
    let [first_s, second_s] = [times(first)?, times(second)?].map(|(block, _)| block.time_s);
    let mut steps: Vec<f64> = first_s.windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect();
    let step = upper_median(&mut steps).unwrap_or(0.0);
    let differs = |pair: &(&f64, &f64)| (pair.0 - pair.1).abs() > step / 2.0;
    match first_s.iter().zip(&second_s).enumerate().find(|(_, pair)| differs(pair)) {
        None => Ok(()),
        Some((row, (&first_s, &second_s))) => Err(LogError::RowMismatch {
            path: first.path().to_owned(),
            companion: second.path().to_owned(),
            problem: RowMismatch::Times { row: row + 1, first: first_s, second: second_s },
        }),
    }
}

impl Log {
    /// Opens a log with a `companion`, whose columns follow those of the log, row by row. If both have a wrench, the
    /// companion's is used. If neither file has names and nothing is specified, the log has readings and the
    /// companion's six columns are the wrench.
    ///
    /// # Errors
    /// Errors of [`Log::open`] for either file, and [`LogError::RowMismatch`] if the numbers of rows or their times
    /// differ.
    pub fn open_with_companion(
        path: &Path,
        companion: &Path,
        mapping: &Mapping,
    ) -> Result<Self, LogError> {
        let source = LogSource::new(path, mapping.table.as_deref())?;
        let companion = LogSource::new(companion, None)?;
        // Opens each file by itself, in case it is a log.
        let alone = Mapping {
            header_line: mapping.header_line,
            skip_lines: mapping.skip_lines,
            ..Mapping::default()
        };
        let open = |source: &LogSource| Self::new(source.clone(), &alone).ok();
        let logs = open(&source).zip(open(&companion));
        if let Some((first, second)) = &logs
            && mapping.time.is_none()
        {
            check_times(first, second)?;
        }
        if let Some((first, second)) = &logs
            && let Some(rows) =
                first.layout.header.side_rows().zip(second.layout.header.side_rows())
            && source.is_text()
            && companion.is_text()
        {
            let source = source.with_rows_of(companion, [rows.0, rows.1]);
            let sides = [first, second].map(|log| (&log.layout.header, &log.layout.roles));
            let header = Header::joined(sides, source.sides.separator());
            let mut log = Self::with_header(source, mapping, Some(header))?;
            log.replaces_wrench = first.has_wrench() && second.has_wrench();
            return Ok(log);
        }
        let source = source.with_companion(companion)?;
        let mut mapping = mapping.clone();
        if !source.sides.has_names {
            let [readings, others] = source.sides.columns;
            mapping.format = mapping.format.or(Some(LogFormat::Csv));
            if mapping.sensors.is_none() && mapping.time.is_none() {
                mapping.sensors = Some((1..=readings).map(ColumnRef::Position).collect());
            }
            if mapping.wrench.is_none() && others == 6 {
                let position = |axis| Some(ColumnRef::Position(readings + 1 + axis));
                mapping.wrench = Some(std::array::from_fn(position));
            }
        }
        Self::new(source, &mapping)
    }
}
