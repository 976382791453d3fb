//! Logs as columns.

use std::collections::BTreeMap;
use std::path::PathBuf;

use log_file::{
    ColumnRef, Log, LogFormat, Mapping, Meaning, MomentUnit, ReadOptions, TimeUnit, Wanted,
    named_axis,
};
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use shell_data::block::Block;
use shell_data::wrench::{Axis, PerAxis};

use crate::error::{PythonFailure, PythonMessage};
use crate::interrupt::without_lock;

/// What the user says of the columns, by the names of the options.
pub(crate) type OptionColumns = BTreeMap<String, String>;

/// How logs are read: what the columns are, bad rows left out, threads.
pub(crate) type ReadRules = (OptionColumns, bool, usize);

/// Names and columns, the group of each row with the labels, rows that were skipped and repeated.
type ReadArrays<'py> = (
    Vec<(String, Bound<'py, PyArray1<f64>>)>,
    Option<(Bound<'py, PyArray1<u32>>, Vec<String>)>,
    (String, u64, u64),
);

/// Reads a log whole.
#[pyfunction]
pub(crate) fn read_log<'py>(
    py: Python<'py>,
    path: PathBuf,
    reading: ReadRules,
) -> Result<ReadArrays<'py>, PythonFailure> {
    let (names, skip_bad_rows, threads) = reading;
    let mapping = mapping(&names)?;
    let (columns, groups, about) = without_lock(py, None, |_| {
        let log = Log::open(&path, &mapping)?;
        let telemetry = log.columns().iter().enumerate();
        let others: Vec<usize> = telemetry
            .filter(|(_, column)| matches!(column.meaning, Meaning::Telemetry(_)))
            .map(|(position, _)| position)
            .collect();
        let wanted = Wanted {
            time: log.has_time(),
            readings: log.channels() > 0,
            wrench: log.has_wrench(),
            groups: log.has_groups(),
            others: others.clone(),
            ..Wanted::default()
        };
        let mut names = Vec::new();
        names.extend(wanted.time.then(|| "t_s".to_owned()));
        names.extend((1..=log.channels()).map(|channel| format!("s{channel}")));
        if wanted.wrench {
            names.extend(log.axes().columns().into_iter().map(str::to_owned));
        }
        names.extend(others.iter().map(|&position| log.columns()[position].name.clone()));
        let mut columns = vec![Vec::new(); names.len()];
        let is_there = Axis::ALL.map(|axis| log.axes().contains(axis));
        let (mut positions, mut labels) = (Vec::new(), Labels::default());
        let read = ReadOptions { threads, skip_bad_rows, ..ReadOptions::default() };
        let summary = log.read(&wanted, &read, std::mem::take, |block: Block| {
            let Block { time_s, readings, wrench, groups, others, .. } = block;
            let time = wanted.time.then_some(time_s);
            let wrench = wrench.into_iter().zip(is_there).filter_map(|(of, is)| is.then_some(of));
            let of_block = time.into_iter().chain(readings).chain(wrench).chain(others);
            columns.iter_mut().zip(of_block).for_each(|(all, part)| all.extend(part));
            for (label, rows) in groups {
                positions.extend(std::iter::repeat_n(labels.position(label), rows));
            }
            Ok::<_, log_file::LogError>(())
        })?;
        let groups = wanted.groups.then_some((positions, labels.names));
        let about = (log.format().to_string(), summary.skipped_rows, summary.repeated_rows);
        Ok((names.into_iter().zip(columns).collect::<Vec<_>>(), groups, about))
    })?;
    let columns = columns.into_iter().map(|(name, of)| (name, of.into_pyarray(py))).collect();
    let groups = groups.map(|(positions, labels)| (positions.into_pyarray(py), labels));
    Ok((columns, groups, about))
}

/// Labels in the order of their first rows.
#[derive(Default)]
struct Labels {
    names: Vec<String>,
    positions: BTreeMap<String, u32>,
}

impl Labels {
    fn position(&mut self, label: String) -> u32 {
        if let Some(&position) = self.positions.get(&label) {
            return position;
        }
        let position = self.names.len() as u32;
        self.names.push(label.clone());
        self.positions.insert(label, position);
        position
    }
}

/// What the user says of the columns.
pub(crate) fn mapping(names: &OptionColumns) -> Result<Mapping, PythonFailure> {
    let mut mapping = Mapping::default();
    for (option, text) in names {
        let refused = |expected: &str| {
            let message = format!("{option} is `{text}`, expected {expected}");
            PythonFailure::from(PythonMessage::new("OptionError", message))
        };
        match option.as_str() {
            "format" => {
                mapping.format = Some(match text.as_str() {
                    "telemetry" => LogFormat::Telemetry,
                    "csv" => LogFormat::Csv,
                    "training" => LogFormat::Training,
                    "reference" => LogFormat::Reference,
                    "console" => LogFormat::Console,
                    _ => {
                        return Err(refused(
                            "`telemetry`, `csv`, `training`, `reference` or `console`",
                        ));
                    }
                });
            }
            "sensors" => mapping.sensors = Some(list(text)),
            "wrench" => {
                let expected = "six columns, Fx to Mz, or their axes: `fx=a,fz=b`";
                mapping.wrench = Some(wrench(text).ok_or_else(|| refused(expected))?);
            }
            "time" => mapping.time = Some(column(text)),
            "group" => mapping.group = Some(column(text)),
            "time_unit" => {
                mapping.time_unit = Some(match text.as_str() {
                    "s" => TimeUnit::Second,
                    "ms" => TimeUnit::Millisecond,
                    "us" => TimeUnit::Microsecond,
                    "ns" => TimeUnit::Nanosecond,
                    _ => return Err(refused("`s`, `ms`, `us` or `ns`")),
                });
            }
            "moment_unit" => {
                mapping.moment_unit = Some(match text.as_str() {
                    "Nm" | "N·m" => MomentUnit::NewtonMetre,
                    "mNm" | "mN·m" => MomentUnit::MillinewtonMetre,
                    _ => return Err(refused("`Nm` or `mNm`")),
                });
            }
            _ => return Err(refused("no such option")),
        }
    }
    Ok(mapping)
}

/// Six columns, the name of a matrix of six, or `fx=a,fz=b`: columns of axes that are named.
fn wrench(text: &str) -> Option<PerAxis<Option<ColumnRef>>> {
    let items = || text.split(',');
    if !items().any(|item| named_axis(item).is_some()) {
        let columns = match list(text).as_slice() {
            [ColumnRef::Name(matrix)] => ColumnRef::columns_of_matrix(matrix, 6),
            columns => columns.to_vec(),
        };
        let six = <[ColumnRef; 6]>::try_from(columns).ok()?;
        return Some(six.map(Some));
    }
    let mut columns: PerAxis<Option<ColumnRef>> = PerAxis::default();
    for item in items() {
        let (axis, name) = named_axis(item).filter(|(_, name)| !name.trim().is_empty())?;
        let taken = columns[axis.index()].replace(column(name));
        if taken.is_some() {
            return None;
        }
    }
    Some(columns)
}

/// A column by its position, from 1, or its name.
fn column(text: &str) -> ColumnRef {
    match text.trim().parse() {
        Ok(position) => ColumnRef::Position(position),
        Err(_) => ColumnRef::Name(text.trim().to_owned()),
    }
}

/// Columns: names and positions separated by commas, `2-9` for several positions.
fn list(text: &str) -> Vec<ColumnRef> {
    let part = |part: &str| -> Vec<ColumnRef> {
        let range = part.split_once('-');
        let range = range.and_then(|(a, b)| {
            Some((a.trim().parse::<usize>().ok()?, b.trim().parse::<usize>().ok()?))
        });
        match range {
            // No log has more columns; what is beyond is refused by the log.
            Some((first, last)) => (first..=usize::min(last, first.saturating_add(4096)))
                .map(ColumnRef::Position)
                .collect(),
            None => vec![column(part)],
        }
    };
    text.split(',').flat_map(part).collect()
}
