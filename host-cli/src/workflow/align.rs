//! From a reference's recording and a board log to one training log.
//!
//! The columns needed of both are held in memory: the offset may be anything, so that no row can be
//! let go before the match is found. That is 8 bytes per value, 56 per row of the reference (64 with a sync
//! signal) and 72 per frame of eight readings.

use shell_data::hint::Hint;
use std::io::{self, Write};
use std::path::PathBuf;

use super::selection::RowFilter;
use alignment::{AlignError, Aligned, Edges, Options, Recording, rising_edges};
use log_file::{ColumnRef, Log, LogError, ReadOptions, ReadSummary, Wanted};
use shell_data::wrench::{Axes, Axis};

/// The column of a board's log that has the times of edges, s.
const EDGE_TIMES: &str = "sync_s";

/// How two logs are aligned.
#[derive(Clone, Debug, PartialEq)]
pub struct AlignOptions {
    /// Time that the board averages a frame over, s; 0 for an instant.
    pub exposure_s: f64,
    /// Which rows of the board log are frames.
    pub rows: RowFilter,
    /// The column of the reference that has a signal whose edges the board has recorded as well.
    pub sync: Option<ColumnRef>,
}

/// Two logs lined up.
#[derive(Debug)]
pub struct AlignedLogs {
    /// The recordings and how their clocks stand to each other.
    pub aligned: Aligned,
    /// What the reference's file was.
    pub reference: ReadSummary,
    /// What the board's file was.
    pub board: ReadSummary,
}

/// Two logs that cannot be lined up.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AlignLogsError {
    /// One of them cannot be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// They do not match, or not clearly.
    #[error("cannot align `{}` with `{}`", board.display(), reference.display())]
    Align {
        /// The reference's file.
        reference: PathBuf,
        /// The board's file.
        board: PathBuf,
        /// Why.
        source: AlignError,
    },
}

impl Hint for AlignLogsError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::Log(error) => error.hint(),
            Self::Align { source, .. } => source.hint(),
        }
    }
}

impl AlignLogsError {
    /// Whether the logs could be read and compared, but the match is not to be trusted.
    pub fn is_refusal(&self) -> bool {
        matches!(self, Self::Align { source, .. } if source.is_refusal())
    }
}

/// Reads both logs and lines them up.
///
/// # Errors
/// [`AlignLogsError`] if a log cannot be read, lacks time, wrench or readings, or if there is no
/// clear match.
pub fn align_logs(
    reference: &Log,
    board: &Log,
    options: &AlignOptions,
    read: &ReadOptions<'_>,
) -> Result<AlignedLogs, AlignLogsError> {
    let mut wrench = Wanted { time: true, wrench: true, ..Wanted::default() };
    let mut readings = Wanted { time: true, readings: true, ..Wanted::default() };
    // Both are looked at before the first is read.
    reference.require(&wrench)?;
    reference.require_axes(Axes::ALL)?;
    board.require(&readings)?;
    if let Some(signal) = &options.sync {
        wrench.others = reference.column_positions(std::slice::from_ref(signal))?;
        readings.texts = board.column_positions(&[ColumnRef::Name(EDGE_TIMES.to_owned())])?;
    }
    let Read { recording: wrench, signal, summary: reference_summary, .. } =
        columns(reference, &wrench, read)?;
    let Read { recording: readings, edges_s, summary: board_summary, .. } =
        columns(board, &readings, read)?;
    let (reference_s, resolution_s) = rising_edges(&wrench.time_s, &signal);
    let edges = Edges { reference_s, board_s: edges_s, resolution_s };
    let has_edges = !edges.reference_s.is_empty() && !edges.board_s.is_empty();
    let options = Options {
        exposure_s: options.exposure_s,
        repeats_are_stale: options.rows == RowFilter::Fresh,
        edges: has_edges.then_some(edges),
    };
    let aligned = alignment::align(wrench, readings, options).map_err(|source| {
        let (reference, board) = (reference.path().to_owned(), board.path().to_owned());
        AlignLogsError::Align { reference, board, source }
    })?;
    Ok(AlignedLogs { aligned, reference: reference_summary, board: board_summary })
}

/// What was read of a log.
struct Read {
    recording: Recording,
    /// The signal with edges, a value for each row, where one was wanted.
    signal: Vec<f64>,
    /// The times of edges, s, where they were wanted.
    edges_s: Vec<f64>,
    summary: ReadSummary,
}

fn columns(log: &Log, wanted: &Wanted, read: &ReadOptions<'_>) -> Result<Read, LogError> {
    let mut recording = Recording::default();
    let (mut signal, mut edges_s) = (Vec::new(), Vec::new());
    let summary = log.read(wanted, read, std::mem::take, |mut block| {
        block.others.iter_mut().for_each(|values| signal.append(values));
        let times = block.texts.iter().flatten();
        edges_s.extend(times.filter_map(|(text, _)| text.trim().parse::<f64>().ok()));
        let columns = if wanted.wrench { &mut block.wrench } else { &mut block.readings };
        recording.columns.resize_with(columns.len(), Vec::new);
        recording.time_s.append(&mut block.time_s);
        for (all, column) in recording.columns.iter_mut().zip(columns) {
            all.append(column);
        }
        Ok::<(), LogError>(())
    })?;
    Ok(Read { recording, signal, edges_s, summary })
}

/// How many rows of a training log were written, and how many were not.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct WrittenRows {
    /// Written.
    pub written: usize,
    /// Left out because the reference was not recording, or had a gap, around that time.
    pub uncovered: usize,
}

/// Writes the training log: `t_s` (the board's clock), `s1` …, `fx_n` … `mz_nm`.
///
/// # Errors
/// Whatever `out` says.
pub fn write_training(aligned: &Aligned, out: &mut impl Write) -> io::Result<WrittenRows> {
    write!(out, "t_s")?;
    for channel in 1..=aligned.channels() {
        write!(out, ",s{channel}")?;
    }
    for axis in Axis::ALL {
        write!(out, ",{}", axis.column())?;
    }
    writeln!(out)?;
    let mut written = 0;
    let uncovered = aligned.resample(|time_s, readings, wrench| {
        written += 1;
        write!(out, "{time_s}")?;
        readings.iter().try_for_each(|reading| write!(out, ",{reading}"))?;
        for (axis, value) in Axis::ALL.into_iter().zip(wrench) {
            // A thousandth of what reference sensors resolve. Adding zero takes off a minus.
            match axis.is_moment() {
                true => write!(out, ",{:.8}", value + 0.0)?,
                false => write!(out, ",{:.6}", value + 0.0)?,
            }
        }
        writeln!(out)
    })?;
    Ok(WrittenRows { written, uncovered })
}
