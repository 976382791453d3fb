//! Drift of the zero of a log, from its first row to its last.

use crate::workflow::selection::RowFilter;
use crate::workflow::{WorkflowError, check_channels};
use calibration::Calibration;
use figures::WrenchTrace;
use forces::by_column;
use forces::drift::{Drift, FEWEST_STATIONARY};
use forces::stationary::{StationaryFinder, ZeroEstimate};
use log_file::{ColumnRef, Log, ReadOptions, Wanted};
use shell_data::wrench::{AxisValues, PerAxis};

/// The column that `record` writes the temperature of the die to.
pub const TEMPERATURE: &str = "temperature_c";

#[derive(Clone, Debug, serde::Serialize)]
pub struct DriftSummary {
    pub rows: u64,
    pub skipped_rows: u64,
    pub rests: usize,
    /// The middle of the first stationary interval, s.
    pub first_s: f64,
    /// The middle of the last stationary interval, s.
    pub last_s: f64,
    /// The time of the last row, s.
    pub end_s: f64,
    /// The lowest and highest temperature at the stationary intervals; `None` if it is not known.
    pub temperature: Option<[f64; 2]>,
    /// The drift of the wrench, N and N·m, if there was a calibration.
    #[serde(serialize_with = "by_axis")]
    pub axes: Option<AxisValues<Drift>>,
    /// The drift of the readings of each channel, counts.
    pub channels: Vec<Drift>,
    /// The wrench at the stationary intervals relative to the first one, for a figure.
    #[serde(skip)]
    pub trace: WrenchTrace,
    /// The readings of each channel at the stationary intervals relative to the first one, with their times.
    #[serde(skip)]
    pub channel_changes: Vec<Vec<(f64, f64)>>,
}

/// Share of a log at its end that may have no stationary interval, and its limits, s: an interval takes half a second.
const LATE: f64 = 0.1;
const LATE_S: [f64; 2] = [1.0, 2.0];

impl DriftSummary {
    /// Returns true if the last stationary interval is far from the end of the log, so that the zero at the end is
    /// not known: the sensor is loaded there, or its zero has jumped.
    pub fn ends_unknown(&self) -> bool {
        let late_s = LATE * (self.end_s - self.first_s);
        self.end_s - self.last_s > late_s.clamp(LATE_S[0], LATE_S[1])
    }
}

/// Finds the stationary intervals of a log and the drift of its zero from one to the next, in one pass: for
/// the channels and, with a calibration, for the wrench. `temperature` is the column of the temperature if it
/// is not [`TEMPERATURE`].
pub fn drift(
    log: &Log,
    calibration: Option<&Calibration>,
    temperature: Option<&ColumnRef>,
    rows: RowFilter,
    read: &ReadOptions<'_>,
) -> Result<DriftSummary, WorkflowError> {
    let path = log.path().display();
    let temperature = match temperature {
        Some(column) => Some(log.column_positions(std::slice::from_ref(column))?[0]),
        None => log.columns().iter().position(|column| column.name == TEMPERATURE),
    };
    let texts = temperature.into_iter().collect();
    let wanted = Wanted { readings: true, time: true, texts, ..Wanted::default() };
    log.require(&wanted)?;
    if let Some(calibration) = calibration {
        check_channels(log, calibration.channels())?;
    }
    let mut finder = StationaryFinder::default();
    let (mut times_s, mut end_s) = (Vec::new(), f64::NAN);
    let mut axes: PerAxis<Vec<ZeroEstimate>> = PerAxis::default();
    let mut channels: Vec<Vec<ZeroEstimate>> = vec![Vec::new(); log.channels()];
    // A board sends the temperature only now and then: a value holds until the next one.
    let mut said: Vec<(f64, f64)> = Vec::new();
    let summary = log.read(
        &wanted,
        read,
        |block| {
            rows.select(block);
            std::mem::take(block)
        },
        |block| {
            let mut row = 0;
            for (text, rows) in block.texts.iter().flatten() {
                let known = temperature_of(text).map_err(|text| {
                    let column = &log.columns()[temperature.unwrap_or_default()].name;
                    WorkflowError::refused(
                        format!("`{path}`: `{text}` in column `{column}` is no temperature"),
                        "name the column of temperature with `--temperature`",
                    )
                })?;
                said.extend(known.map(|value| (block.time_s[row], value)));
                row += rows;
            }
            end_s = block.time_s.last().copied().unwrap_or(end_s);
            finder.look_at(&block.time_s, &block.readings, &mut |stationary| {
                times_s.push(stationary.middle_s());
                for (zeros, readings) in channels.iter_mut().zip(&stationary.readings) {
                    zeros.push(ZeroEstimate::new(readings, &stationary.parts));
                }
                if let Some(calibration) = calibration {
                    let wrench = ZeroEstimate::from_wrench(calibration, stationary);
                    axes.iter_mut().zip(wrench).for_each(|(zeros, zero)| zeros.push(zero));
                }
            });
            Ok::<(), WorkflowError>(())
        },
    )?;
    let temperature_at = |&time_s: &f64| {
        let next = said.partition_point(|&(time, _)| time <= time_s);
        next.checked_sub(1).map(|last| said[last].1)
    };
    let temperatures: Vec<Option<f64>> = times_s.iter().map(temperature_at).collect();
    let calibration_axes = calibration.map(|calibration| calibration.axes);
    let quantities = calibration_axes.map_or(channels.len(), |axes| axes.iter().count());
    let of = |zeros: &Vec<ZeroEstimate>| Drift::fit(zeros, &times_s, &temperatures, quantities);
    let too_few = || {
        let found = times_s.len();
        WorkflowError::refused(
            format!(
                "`{path}` has `{found}` stationary intervals, a drift needs at least {FEWEST_STATIONARY}"
            ),
            "begin with the sensor still and unloaded, and leave it so for a second or more now and then",
        )
    };
    let channel_drifts = channels.iter().map(of).collect::<Option<Vec<_>>>().ok_or_else(too_few)?;
    let axis_drifts = match calibration_axes {
        None => None,
        Some(present) => {
            let found = present.iter().map(|axis| Some((axis, of(&axes[axis.index()])?)));
            Some(found.collect::<Option<AxisValues<Drift>>>().ok_or_else(too_few)?)
        }
    };
    let known = temperatures.iter().copied().flatten();
    let extremes = known.clone().reduce(f64::min).zip(known.reduce(f64::max));
    let mut trace = WrenchTrace::default();
    trace.add(&times_s, &axes.each_ref().map(|zeros| from_first(zeros)));
    let points = |zeros: &Vec<ZeroEstimate>| std::iter::zip(times_s.clone(), from_first(zeros));
    Ok(DriftSummary {
        rows: summary.rows,
        skipped_rows: summary.skipped_rows,
        rests: times_s.len(),
        first_s: times_s[0],
        last_s: times_s[times_s.len() - 1],
        end_s,
        temperature: extremes.map(|(low, high)| [low, high]),
        axes: axis_drifts,
        channels: channel_drifts,
        trace,
        channel_changes: channels.iter().map(|zeros| points(zeros).collect()).collect(),
    })
}

/// The number in a cell of a temperature column, `None` if it is empty; text that is not a number is the error.
fn temperature_of(text: &str) -> Result<Option<f64>, String> {
    let text = text.trim();
    if text.is_empty() {
        return Ok(None);
    }
    let number = text.replace(',', ".").parse().ok().filter(|value: &f64| value.is_finite());
    number.map(Some).ok_or_else(|| text.to_owned())
}

fn from_first(column: &[ZeroEstimate]) -> Vec<f64> {
    column.iter().map(|zero| zero.mean - column[0].mean).collect()
}

fn by_axis<S: serde::Serializer>(
    values: &Option<AxisValues<Drift>>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    match values {
        Some(values) => by_column(values, serializer),
        None => serializer.serialize_none(),
    }
}
