//! Logs as columns.

use std::collections::BTreeMap;
use std::path::PathBuf;

use log_file::{
    FORMATS, Log, Mapping, Meaning, MomentUnit, ReadOptions, TIME_UNITS, Wanted, parse_column,
    parse_columns, parse_condition, parse_units, parse_wrench,
};
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use shell_data::block::Block;
use shell_data::wrench::Axis;

use crate::error::{PythonFailure, PythonMessage};
use crate::interrupt::without_lock;

/// The user's assignments of columns, by option name.
pub(crate) type OptionColumns = BTreeMap<String, String>;

/// Rules for reading logs: columns, which bad rows to skip, threads.
pub(crate) type ReadRules = (OptionColumns, String, usize);

/// Converts the rule for invalid rows: none (empty), `few` or `all` are left out.
pub(crate) fn read_options(skipped: &str, threads: usize) -> ReadOptions<'static> {
    ReadOptions {
        threads,
        skip_bad_rows: !skipped.is_empty(),
        largest_bad_share: (skipped != "all").then_some(ReadOptions::FEW_BAD_ROWS),
        ..ReadOptions::default()
    }
}

/// Names and columns, the group of each row with the labels, numbers of skipped and repeated rows.
type ReadArrays<'py> = (
    Vec<(String, Bound<'py, PyArray1<f64>>)>,
    Option<(Bound<'py, PyArray1<u32>>, Vec<String>)>,
    (String, u64, u64),
);

#[pyfunction]
pub(crate) fn read_log<'py>(
    py: Python<'py>,
    path: PathBuf,
    reading: ReadRules,
) -> Result<ReadArrays<'py>, PythonFailure> {
    let (names, skipped, threads) = reading;
    let mapping = mapping(&names)?;
    let (columns, groups, about) = without_lock(py, None, |_| {
        let log = Log::open(&path, &mapping)?;
        let is_telemetry = |&at: &usize| matches!(log.columns()[at].meaning, Meaning::Telemetry(_));
        let others: Vec<usize> = (0..log.columns().len()).filter(is_telemetry).collect();
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
        let (block, summary) = log.read_whole(&wanted, &read_options(&skipped, threads))?;
        let Block { time_s, readings, wrench, groups, others, .. } = block;
        let is_there = Axis::ALL.map(|axis| log.axes().contains(axis));
        let wrench = wrench.into_iter().zip(is_there).filter_map(|(of, is)| is.then_some(of));
        let time = wanted.time.then_some(time_s).into_iter();
        let columns = time.chain(readings).chain(wrench).chain(others);
        // Labels in the order of their first rows.
        let (mut positions, mut labels, mut known) = (Vec::new(), Vec::new(), BTreeMap::new());
        for (label, rows) in groups {
            let position = *known.entry(label).or_insert_with_key(|label| {
                labels.push(label.clone());
                labels.len() as u32 - 1
            });
            positions.extend(std::iter::repeat_n(position, rows));
        }
        let groups = wanted.groups.then_some((positions, labels));
        let about = (log.format().to_string(), summary.skipped_rows, summary.repeated_rows);
        Ok((names.into_iter().zip(columns).collect::<Vec<_>>(), groups, about))
    })?;
    let columns = columns.into_iter().map(|(name, of)| (name, of.into_pyarray(py))).collect();
    let groups = groups.map(|(positions, labels)| (positions.into_pyarray(py), labels));
    Ok((columns, groups, about))
}

pub(crate) fn mapping(names: &OptionColumns) -> Result<Mapping, PythonFailure> {
    let mut mapping = Mapping::default();
    for (option, text) in names {
        let wrong = |how: &str| {
            let message = format!("{option} is `{text}`{how}");
            PythonFailure::from(PythonMessage::new("OptionError", message))
        };
        let refused = |expected: &str| wrong(&format!(", expected {expected}"));
        let impossible = |problem: String| wrong(&format!(": {problem}"));
        match option.as_str() {
            "format" => {
                let expected = "`telemetry`, `csv`, `training`, `reference` or `console`";
                let known = FORMATS.iter().find(|(name, ..)| name == text);
                mapping.format = Some(known.ok_or_else(|| refused(expected))?.2);
            }
            "sensors" => mapping.sensors = Some(parse_columns(text).map_err(impossible)?),
            "wrench" => {
                let expected = "six columns, Fx to Mz, or their axes: `fx=a,fz=b`";
                mapping.wrench = Some(parse_wrench(text).map_err(|_| refused(expected))?);
            }
            "time" => mapping.time = Some(parse_column(text).map_err(impossible)?),
            "group" => mapping.group = Some(parse_column(text).map_err(impossible)?),
            "time_unit" => {
                let known = TIME_UNITS.iter().find(|(name, ..)| name == text);
                let refused = || refused("`s`, `ms`, `us` or `ns`");
                mapping.time_unit = Some(known.ok_or_else(refused)?.2);
            }
            "moment_unit" => {
                mapping.moment_unit = Some(match text.as_str() {
                    "Nm" | "N·m" => MomentUnit::NewtonMetre,
                    "mNm" | "mN·m" => MomentUnit::MillinewtonMetre,
                    _ => return Err(refused("`Nm` or `mNm`")),
                });
            }
            "table" => mapping.table = Some(text.clone()),
            "unit" => mapping.units = parse_units(text).map_err(impossible)?,
            // Several conditions are lines of one text.
            "where" => {
                let conditions = text.lines().map(parse_condition).collect::<Result<_, _>>();
                mapping.rows = conditions.map_err(impossible)?;
            }
            "exclude_group" => {
                mapping.excluded_groups = text.lines().map(str::to_owned).collect();
            }
            "header_line" | "skip_lines" => {
                let number = text.parse().map_err(|_| refused("a number of lines"))?;
                match option.as_str() {
                    "header_line" => mapping.header_line = Some(number),
                    _ => mapping.skip_lines = Some(number),
                }
            }
            _ => return Err(refused("no such option")),
        }
    }
    Ok(mapping)
}
