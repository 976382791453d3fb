//! Checks of the readings of a board or a log.

use calibration::Calibration;

use crate::{Finding, FindingSeverity, percent};
use log_file::summary::LogSummary;

pub(crate) const ENOUGH_FRAMES: u64 = 20;

/// Least factor by which the exchange of swapped channels reduces standard errors; noise and creep cause less.
const UNLIKELY: f64 = 2.0;

/// Shares of frames outside the calibrated range: warning and fault.
const OUTSIDE: [f64; 2] = [0.05, 0.5];

/// Checks for saturated, dead, quiet, identical and swapped channels. `identical` lists pairs with
/// equal readings in every row; channels without `names` are s1, s2, …. In a log that `is_still`, a constant
/// channel may be sound, and gets a warning only.
pub(crate) fn check_channels(
    (summary, is_still): (&LogSummary, bool),
    names: &[String],
    identical: &[(usize, usize)],
    calibration: Option<&Calibration>,
    findings: &mut Vec<Finding>,
) {
    if summary.readings.is_empty() || summary.rows < ENOUGH_FRAMES {
        return;
    }
    let before = findings.len();
    for (channel, column) in summary.readings.iter().enumerate() {
        let name = channel_name(names, channel);
        let saturated = column.saturated_rows();
        if column.is_constant() {
            let (seen, advice) = match (saturated, column.min) {
                (0, at) => (
                    format!("{name} is {at} in every frame"),
                    "check the photointerrupter's supply and the wire of its output",
                ),
                (_, at) => (
                    format!("{name} stands at {at}, an end of the converter's range"),
                    "check whether the photointerrupter is connected: an open input and a short \
                     stand at an end of the range",
                ),
            };
            findings.push(match is_still && saturated == 0 {
                true => Finding::warning("channel-dead", seen, advice),
                false => Finding::fault("channel-dead", seen, advice),
            });
            continue;
        }
        if saturated > 0 {
            let share = percent(saturated as f64 / column.rows as f64);
            let seen =
                format!("{name} is at an end of the converter's range in {share} of the frames");
            let advice = "change the distance of the reflector or the emitter's current; forces of \
                          such frames are wrong";
            findings.push(Finding::fault("channel-saturated", seen, advice));
        } else if column.is_pinned_at_max() {
            let seen = format!("{name} is cut off at {}", column.max);
            let advice = "something limits it: the supply of the phototransistor, or a filter";
            findings.push(Finding::fault("channel-saturated", seen, advice));
        }
        if let Some(values) = column.quiet_values() {
            let seen = format!("{name} is almost constant: {values} values");
            let advice = "press on the shell: if it stays so, its reflector is out of sight or its \
                          emitter is dark";
            findings.push(Finding::warning("channel-quiet", seen, advice));
        }
    }
    let is_alive = |&&(first, _): &&(usize, usize)| !summary.readings[first].is_constant();
    for &(first, second) in identical.iter().filter(is_alive) {
        let [first, second] = [first, second].map(|channel| channel_name(names, channel));
        let seen = format!("{first} and {second} are the same in every frame");
        let advice = "two inputs share a wire, or a column was copied";
        findings.push(Finding::fault("channels-identical", seen, advice));
    }
    findings.extend(calibration.and_then(|of| swapped(summary, names, of)));
    if findings.len() == before {
        let channels = summary.readings.len();
        findings.push(Finding::fine("channels", format!("{channels} channels alive and in range")));
    }
}

pub(crate) fn channel_name(names: &[String], channel: usize) -> String {
    let name = names.get(channel).filter(|name| !name.is_empty());
    name.cloned().unwrap_or_else(|| format!("s{}", channel + 1))
}

/// Removes findings that follow from swapped channels: repeated ones, and readings outside their range.
pub(crate) fn without_consequences(findings: &mut Vec<Finding>) {
    const SWAPPED: &str = "channels-swapped";
    if findings.iter().any(|finding| finding.check == SWAPPED) {
        let mut is_first = true;
        findings.retain(|finding| match finding.check {
            SWAPPED => std::mem::replace(&mut is_first, false),
            "range" => false,
            _ => true,
        });
    }
}

/// Finds two channels with exchanged readings.
///
/// Readings that no load can cause lie far from all training data, so that their forces have large standard
/// errors. If an exchange of two channels brings the errors down, these channels are swapped.
fn swapped(summary: &LogSummary, names: &[String], calibration: &Calibration) -> Option<Finding> {
    if summary.readings.len() != calibration.channels() {
        return None;
    }
    let readings: Vec<_> = summary.readings.iter().map(|column| vec![column.mean()]).collect();
    let errors = |readings: &[Vec<f64>]| {
        Some(calibration.standard_errors(readings, None)?.map(|axis| axis[0]))
    };
    let now = errors(&readings)?;
    let (channels, factor) = best_exchange(&readings, |readings| {
        let ratios = std::iter::zip(now, errors(readings)?).map(|(now, then)| now / then);
        Some(ratios.product::<f64>().powf(1.0 / 6.0))
    })?;
    (factor > UNLIKELY).then(|| {
        let seen =
            format!("forces are {factor:.1} times as certain: each reads what the other should");
        exchanged(names, channels, &seen)
    })
}

pub(crate) fn best_exchange(
    readings: &[Vec<f64>],
    score: impl Fn(&[Vec<f64>]) -> Option<f64>,
) -> Option<((usize, usize), f64)> {
    let mut readings = readings.to_vec();
    let mut best = None;
    for (first, second) in pairs(readings.len()) {
        readings.swap(first, second);
        let found = score(&readings)?;
        readings.swap(first, second);
        if best.is_none_or(|(_, highest)| found > highest) {
            best = Some(((first, second), found));
        }
    }
    best
}

pub(crate) fn exchanged(names: &[String], (first, second): (usize, usize), then: &str) -> Finding {
    let [first, second] = [first, second].map(|channel| channel_name(names, channel));
    let seen = format!("with {first} and {second} exchanged, {then}");
    let advice = "exchange their wires, or name the columns in the order of the calibration with `--sensors`";
    Finding::fault("channels-swapped", seen, advice)
}

pub(crate) fn outside(rows: u64, of: u64) -> Option<Finding> {
    let share = rows as f64 / of.max(1) as f64;
    let seen = format!("{} of the frames are outside the calibrated range", percent(share));
    let advice = "calibrate over the loads that occur; if nothing touches the shell, it or a \
                  reflector has moved since: calibrate again";
    let finding = Finding::graded("range", share, OUTSIDE, seen, advice);
    (finding.severity != FindingSeverity::Fine).then_some(finding)
}

fn pairs(columns: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..columns).flat_map(move |first| (first + 1..columns).map(move |second| (first, second)))
}

/// Returns pairs of equal columns, among those in `before` if given.
pub(crate) fn identical_in(
    columns: &[Vec<f64>],
    before: Option<Vec<(usize, usize)>>,
) -> Vec<(usize, usize)> {
    let mut pairs = before.unwrap_or_else(|| pairs(columns.len()).collect());
    pairs.retain(|&(first, second)| columns[first] == columns[second]);
    pairs
}
