//! Alignment of a reference's recording and a board log into one training log. The required columns of both are held
//! in memory: the offset may be anything, so no row can be dropped before the match is found. This takes 8 bytes per
//! value: 56 per row of the reference (64 with a sync signal) and 72 per frame of eight readings.

use std::io::{self, Write};

use super::WorkflowError;
use alignment::{Aligned, Edges, Options, Recording, rising_edges};
use log_file::{ColumnRef, Log, ReadOptions, ReadSummary, Wanted};
use shell_data::wrench::{Axes, Axis};

/// The column of a board log with the times of edges, s.
const EDGE_TIMES: &str = "sync_s";

/// Reads both logs and aligns them; also returns the read summaries of the reference and the board log. `sync` is the
/// column of the reference with a signal whose edges the board recorded as well. Fails with [`WorkflowError`] if a
/// log cannot be read, lacks time, wrench or readings, or if there is no clear match.
pub fn align_logs(
    reference: &Log,
    board: &Log,
    options: Options,
    sync: Option<&ColumnRef>,
    read: &ReadOptions<'_>,
) -> Result<(Aligned, [ReadSummary; 2]), WorkflowError> {
    let mut wrench = Wanted { time: true, wrench: true, ..Wanted::default() };
    let mut readings = Wanted { time: true, readings: true, ..Wanted::default() };
    reference.require(&wrench)?;
    reference.require_axes(Axes::ALL)?;
    board.require(&readings)?;
    reference.require_time_unit()?;
    board.require_time_unit()?;
    if let Some(signal) = sync {
        wrench.others = reference.column_positions(std::slice::from_ref(signal))?;
        readings.texts = board.column_positions(&[ColumnRef::Name(EDGE_TIMES.to_owned())])?;
    }
    let (with_wrench, reference_summary) = reference.read_whole(&wrench, read)?;
    let (with_readings, board_summary) = board.read_whole(&readings, read)?;
    let signal = with_wrench.others.concat();
    let (reference_s, resolution_s) = rising_edges(&with_wrench.time_s, &signal);
    let times = with_readings.texts.iter().flatten();
    let edges_s = times.filter_map(|(text, _)| text.trim().parse::<f64>().ok()).collect();
    let wrench = Recording { time_s: with_wrench.time_s, columns: with_wrench.wrench };
    let readings = Recording { time_s: with_readings.time_s, columns: with_readings.readings };
    let edges = Edges { reference_s, board_s: edges_s, resolution_s };
    let has_edges = !edges.reference_s.is_empty() && !edges.board_s.is_empty();
    let options = Options { edges: has_edges.then_some(edges), ..options };
    let aligned = alignment::align(wrench, readings, options).map_err(|source| {
        let (reference, board) = (reference.path().to_owned(), board.path().to_owned());
        WorkflowError::Align { reference, board, source }
    })?;
    Ok((aligned, [reference_summary, board_summary]))
}

/// Number of rows of a training log that were written, and that were left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct WrittenRows {
    pub written: usize,
    pub uncovered: usize,
}

/// Writes the training log: `t_s` (the board's clock), `s1` …, `fx_n` … `mz_nm`. Fails if `out` fails.
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
            // A thousandth of the resolution of reference sensors. Adding zero turns −0 into 0.
            match axis.is_moment() {
                true => write!(out, ",{:.8}", value + 0.0)?,
                false => write!(out, ",{:.6}", value + 0.0)?,
            }
        }
        writeln!(out)
    })?;
    Ok(WrittenRows { written, uncovered })
}
