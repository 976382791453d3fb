//! `shellcal info --drift`: the drift of the zero of an unloaded sensor.

use calibration_file::CalibrationFile;
use figures::{Chart, ChartMark, Figure, PlotAxis, Series, Size, Spacing, trace_figure};
use forces::drift::{Drift, Trend};
use forces::stationary::{FALSE_ALARMS, ZeroChange, largest_change};
use log_file::Log;
use shellcal::workflow::drift::{DriftSummary, drift};

use super::InfoArgs;
use crate::printer::Printer;
use crate::tables::decimals;

impl InfoArgs {
    pub(super) fn report_drift(
        &self,
        logs: &[Log],
        file: Option<&CalibrationFile>,
        printer: &Printer,
    ) -> anyhow::Result<()> {
        let mut plot = self.figure.create_of_one(&self.files, printer)?;
        let mut drifts = Vec::new();
        for log in logs {
            let name = log.path().display().to_string();
            let summary = printer.scan(log, self.mapping.read_options(), |read| {
                let calibration = file.map(|file| &file.calibration);
                drift(log, calibration, self.temperature.as_ref(), self.frames.rows(log), &read)
            })?;
            if let Some(plot) = plot.take() {
                plot.draw(|size| figure(size, &name, &summary))?;
            }
            drifts.push((name, summary));
        }
        let documents = drifts.iter().map(|(log, summary)| {
            document! {
                log,
                // True if a tare at the start holds to the end; null if the zero at the end is not known.
                tare_holds: match moved(summary) {
                    Some(_) => Some(false),
                    None => (!summary.ends_unknown()).then_some(true),
                },
                ..summary: summary,
            }
        });
        printer.finish(&documents.collect::<Vec<_>>(), |printer| {
            drifts.iter().for_each(|(log, summary)| print(printer, log, summary))
        })
    }
}

/// The quantities, each with its name, its unit and its number of decimals.
fn quantities(summary: &DriftSummary) -> Vec<(String, &'static str, usize, &Drift)> {
    let axes = summary
        .axes
        .iter()
        .flatten()
        .map(|(axis, drift)| (axis.name().to_owned(), axis.unit(), decimals(*axis), drift));
    let channels = summary.channels.iter().enumerate();
    axes.chain(channels.map(|(i, drift)| (format!("s{}", i + 1), "counts", 2, drift))).collect()
}

/// The quantity that exceeds its limit most: among the axes or, without a calibration, among the channels.
fn moved(summary: &DriftSummary) -> Option<(usize, ZeroChange)> {
    let judged = summary.axes.as_ref().map_or(summary.channels.len(), Vec::len);
    let all = quantities(summary);
    largest_change(all[..judged].iter().enumerate().map(|(i, (.., drift))| (i, drift.change)))
}

fn print(printer: &Printer, log: &str, summary: &DriftSummary) {
    let DriftSummary { rests, first_s, last_s, .. } = *summary;
    printer.line(format!(
        "{log}: {rests} stationary intervals, the first about {first_s:.1} s, the last about {last_s:.1} s"
    ));
    let quantities = quantities(summary);
    let has_trend = quantities.iter().any(|(.., drift)| drift.per_degree.is_some());
    let mut header = vec!["zero of", "change", "noise", "wander", "per minute", "± SE"];
    if has_trend {
        header.extend(["per degree", "± SE"]);
    }
    let rows = quantities.iter().map(|(name, unit, decimals, drift)| {
        let decimals = *decimals;
        let shown = |value: f64| format!("{value:.decimals$}");
        let ZeroChange { change, noise, .. } = drift.change;
        let mut row = vec![format!("{name} ({unit})")];
        row.extend([change, noise, drift.wander].map(shown));
        let Trend { slope, standard_error, .. } = drift.per_s;
        row.extend([60.0 * slope, 60.0 * standard_error].map(shown));
        if has_trend {
            let figures = drift.per_degree.map(|at| [at.slope, at.standard_error].map(shown));
            row.extend(figures.unwrap_or_default());
        }
        row
    });
    printer.table(&header, rows);
    match summary.temperature {
        Some([low, high]) if has_trend => {
            let drifts = quantities.iter().map(|(.., drift)| drift);
            let pairs = drifts.filter_map(|drift| Some((drift.per_s, drift.per_degree?)));
            let better = pairs.clone().filter(|(time, of)| of.residual_rms < time.residual_rms);
            printer.line(format!(
                "temperature {low:.2} to {high:.2}: a line against it is closer to the zeros than one against time in \
                 {} of {}",
                better.count(),
                pairs.count()
            ));
        }
        Some([at, _]) => printer.line(format!("temperature {at:.2} throughout")),
        None => {}
    }
    printer.line(match moved(summary) {
        None if summary.ends_unknown() => format!(
            "no zero moves beyond its noise until {last_s:.1} s, the zero at the end is not known: from then on \
             the sensor is loaded, or its zero has jumped"
        ),
        None => "a tare at the start holds to the end: no zero moves beyond its noise".to_owned(),
        Some((i, ZeroChange { change, noise, .. })) => {
            let (name, unit, decimals, _) = &quantities[i];
            format!(
                "a tare at the start does not hold: the zero of {name} moves by {change:.decimals$} {unit}, \
                 with a noise of {noise:.decimals$}; `--tare rests` follows it"
            )
        }
    });
    printer.note(format!(
        "a constant zero gives a false alarm in at most {} % of logs",
        100.0 * FALSE_ALARMS
    ));
}

fn figure(size: Size, name: &str, summary: &DriftSummary) -> Figure {
    let title = format!("{name}: zero at rest, less that at the start");
    if summary.axes.is_some() {
        return trace_figure(size, &title, &summary.trace);
    }
    let series: Vec<Series> = summary
        .channel_changes
        .iter()
        .cloned()
        .enumerate()
        .map(|(i, points)| Series { label: format!("s{}", i + 1), points, mark: ChartMark::Line })
        .collect();
    let values = || series.iter().flat_map(|series| series.points.iter().map(|point| point.1));
    let (low, high) = (values().fold(0.0, f64::min), values().fold(0.0, f64::max));
    let x = PlotAxis::new("time", "s", Spacing::Linear, summary.first_s, summary.last_s);
    let y = PlotAxis::new("change of the zero", "counts", Spacing::Linear, low, high);
    Chart { title, x, y, series }.figure(size)
}
