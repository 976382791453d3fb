//! Checks of a calibration file.

use std::fs::File;
use std::path::Path;

use calibration::reading_ranges::ReadingRange;
use calibration::validation::excitation::Gap;
use calibration::{Calibration, Kind};
use log_file::checksum;
use shell_data::Converter;
use shell_data::wrench::{Axes, Axis};

use crate::channels::channel_name;
use crate::{Finding, percent};
use calibration_file::{CalibrationFile, Diagnostics};

/// Condition number above which the last ten or so digits of a coefficient are in doubt.
const CONDITION: f64 = 1e6;

/// Largest ratio of the error on new data to the error on the training data.
const OVERFIT: f64 = 2.0;

/// With fewer rows per feature, a fit follows the noise.
const ROWS_PER_FEATURE: u64 = 10;

/// Minimum explained share of an axis's variance.
const EXPLAINED: f64 = 0.9;

/// Age in days above which a calibration should be repeated, or at least tested.
const OLD_DAYS: f64 = 365.0;

/// Largest share of training rows skipped as invalid.
const SKIPPED: f64 = 0.01;

/// Reads and checks a calibration file. `age` returns the days since a date.
pub fn examine_calibration(path: &Path, age: &dyn Fn(&str) -> Option<f64>) -> Vec<Finding> {
    let file = match CalibrationFile::read(path) {
        Ok(file) => file,
        Err(error) => {
            let advice = "make it again with `shellcal fit`; a file that was cut short has lost its end \
                          on the way";
            let seen = format!("it cannot be used: {}", error.problem);
            return vec![Finding::fault("unreadable", seen, advice)];
        }
    };
    let CalibrationFile { calibration, origin } = &file;
    let (name, channels) = (calibration.name(), calibration.channels());
    let mut findings = vec![Finding::fine("calibration", format!("{name}, {channels} channels"))];
    if let Some(verdict) = file.not_ok() {
        let seen = format!("its fit said: {verdict}");
        let advice = "mend what it names, and fit again";
        findings.push(Finding::fault("not-ok", seen, advice));
    }
    match &origin.diagnostics {
        Some(known) => {
            if let Some(polynomial) = calibration.polynomial() {
                check_features(known, polynomial.coefficients.len(), &mut findings);
            }
            check_skipped(known, &mut findings);
            check_leaks(known, &mut findings);
            check_errors(known, calibration.axes, &mut findings);
            check_explained(known, calibration.axes, &mut findings);
            check_loads(known, calibration.axes, &mut findings);
        }
        None => {
            let advice = "hold it against a log with `shellcal eval`";
            let seen = "nothing is known of its errors";
            findings.push(Finding::warning("no-diagnostics", seen, advice));
        }
    }
    let columns = origin.columns.as_ref();
    let names = columns.and_then(|columns| columns.sensors.as_deref()).unwrap_or_default();
    check_ranges(calibration, names, &mut findings);
    if matches!(calibration.kind, Kind::Polynomial(_)) && calibration.covariance.is_none() {
        let seen = "it has no covariance, so forces come without standard errors";
        let advice = "fit it again without `--model`: it then takes a model that its groups of rows can judge";
        findings.push(Finding::warning("no-covariance", seen, advice));
    }
    findings.extend(age(&origin.date).and_then(check_age));
    for source in &origin.sources {
        let then = source.checksum.as_deref();
        let now = then.and_then(|_| checksum_of(&source.path));
        if now.is_some_and(|now| Some(now.as_str()) != then) {
            let path = source.path.display();
            let seen = format!("`{path}` is not what it was when this was fitted");
            let advice = "fit again, or find the file of that day";
            findings.push(Finding::warning("source-changed", seen, advice));
        }
    }
    findings
}

fn checksum_of(path: &Path) -> Option<String> {
    let file = File::open(path).ok().filter(|_| path.is_file())?;
    checksum::of_stream(file).ok()
}

fn check_skipped(known: &Diagnostics, findings: &mut Vec<Finding>) {
    let skipped = known.skipped_rows as f64 / (known.rows + known.skipped_rows).max(1) as f64;
    if skipped > SKIPPED {
        let seen = format!("{} of the training rows were wrong and left out", percent(skipped));
        let advice = "look at what was wrong with them: `shellcal info` without `--skip-bad-rows` names the first";
        findings.push(Finding::warning("skipped", seen, advice));
    }
}

fn check_features(known: &Diagnostics, features: usize, findings: &mut Vec<Finding>) {
    let Diagnostics { rank, rows, condition, .. } = *known;
    if rank < features {
        let seen = format!("the training data determine {rank} of its {features} features");
        let advice = "record loads on every axis and both ways, or take a smaller `--model`";
        findings.push(Finding::fault("rank", seen, advice));
    }
    if condition.is_none_or(|condition| condition > CONDITION) {
        let seen = match condition {
            Some(of) => format!("its features are hard to tell apart, condition {of:.1e}"),
            None => "its features cannot be told apart".to_owned(),
        };
        let advice = "record loads that move the channels independently, or fit with `--ridge`";
        findings.push(Finding::warning("condition", seen, advice));
    }
    if rows < ROWS_PER_FEATURE * features as u64 {
        let seen = format!("{rows} rows for {features} features");
        let advice = "record more, or take a smaller `--model`";
        findings.push(Finding::warning("few-rows", seen, advice));
    }
}

/// Checks for errors measured on rows that the fit has practically seen.
fn check_leaks(known: &Diagnostics, findings: &mut Vec<Finding>) {
    if let Some(share) = known.test_leak.map(percent) {
        let seen = format!("{share} of its test rows were recorded at poses of the training data");
        let advice = "test on other poses: whole poses have to be on one side of a split, not rows";
        findings.push(Finding::fault("test-leaks", seen, advice));
    }
    if let Some(share) = known.group_leak.map(percent) {
        let seen =
            format!("{share} of its training rows share their pose with rows of other groups");
        let advice = "fit again with one group label for each pose (`--group`)";
        findings.push(Finding::fault("groups-leak", seen, advice));
    }
}

fn check_errors(known: &Diagnostics, axes: Axes, findings: &mut Vec<Finding>) {
    let tested = known.test.filter(|_| known.test_leak.is_none());
    let tested = tested.map(|test| ("test data", test.map(|axis| axis.rms)));
    let held_out = known.cross_validation.as_ref().filter(|_| known.group_leak.is_none());
    let held_out = held_out.map(|cv| ("held-out groups", cv.grouped.map(|axis| axis.rms)));
    let sets: Vec<_> = tested.into_iter().chain(held_out).collect();
    if sets.is_empty() {
        let seen = "it was not tested on data that it has not seen";
        let advice = "fit without `--model`, or with `--test` and a recording of another session, or with `--cv`";
        findings.push(Finding::warning("untested", seen, advice));
    }
    for (name, rms) in sets {
        let ratio = |axis: Axis| rms[axis.index()] / known.train[axis.index()].rms;
        let ratios = axes.iter().map(|axis| (axis, ratio(axis)));
        let worst = ratios.filter(|(_, ratio)| ratio.is_finite());
        let Some((axis, ratio)) = worst.max_by(|a, b| a.1.total_cmp(&b.1)) else { continue };
        let axis = axis.name();
        let seen =
            format!("the error of {axis} on {name} is {ratio:.1} times that on the training data");
        let advice = "take a smaller model (`--model auto` chooses one), or record more poses";
        findings.push(match ratio > OVERFIT {
            true => Finding::fault("overfit", seen, advice),
            false => Finding::fine("errors", seen),
        });
    }
}

/// Checks for axes hardly explained in the test data or, without a test, in the training data.
fn check_explained(known: &Diagnostics, axes: Axes, findings: &mut Vec<Finding>) {
    let errors = known.test.as_ref().unwrap_or(&known.train);
    for axis in axes.iter() {
        let explained = errors[axis.index()].r_squared;
        let Some(share) = explained.filter(|share| *share < EXPLAINED) else { continue };
        let seen = format!("R² of {} is {share:.2}: it explains little of that axis", axis.name());
        let advice = "record larger loads on that axis, or do not use it; `shellcal fit --model auto` compares models";
        findings.push(Finding::warning("explains-little", seen, advice));
    }
}

fn check_loads(known: &Diagnostics, axes: Axes, findings: &mut Vec<Finding>) {
    for gap in known.excitation.iter().flat_map(|excitation| excitation.gaps(axes)) {
        let text = gap.to_string();
        let (seen, advice) = text.split_once(": ").unwrap_or((&text, ""));
        let seen = format!("in the training data {seen}");
        findings.push(match gap {
            Gap::Unloaded(_) => Finding::fault("axis-unloaded", seen, advice),
            Gap::OneSided { .. } => Finding::warning("axis-one-sided", seen, advice),
            _ => Finding::warning("axes-together", seen, advice),
        });
    }
}

fn check_ranges(calibration: &Calibration, names: &[String], findings: &mut Vec<Finding>) {
    let Some(ranges) = &calibration.valid_range else {
        let seen = "the range of its training data is not known, so nothing is flagged as outside";
        let advice = "fit it from logs with `shellcal fit`";
        findings.push(Finding::warning("no-range", seen, advice));
        return;
    };
    for (channel, range) in ranges.iter().enumerate() {
        let name = channel_name(names, channel);
        if range.is_constant() {
            let seen = format!("{name} was {} in all of the training data", range.min);
            let advice = "check that photointerrupter, and record again";
            findings.push(Finding::fault("channel-dead", seen, advice));
        } else if is_at_an_end(range) {
            let seen =
                format!("{name} was at an end of the converter's range in the training data");
            let advice = "change the distance of the reflector or the emitter's current, and record again; or \
                          leave such rows out with `fit --valid-range`";
            findings.push(Finding::fault("channel-saturated", seen, advice));
        }
    }
}

/// Returns true for a converter's readings at an end; volts and fractions have no such ends.
fn is_at_an_end(range: &ReadingRange) -> bool {
    let converter = Converter::of_extremes(range.min, range.max);
    converter.is_some_and(|of| of.is_at_end(range.min) || of.is_at_end(range.max))
}

fn check_age(days: f64) -> Option<Finding> {
    let whole_days = days.abs().floor();
    let (seen, advice) = match days {
        _ if days > OLD_DAYS => (
            format!("it was made {whole_days} days ago"),
            "test it on a new recording with `shellcal eval --max-rms`",
        ),
        _ if days < -1.0 => (
            format!("it will have been made in {whole_days} days"),
            "one of the clocks is wrong: that of this computer, or that of the one it was made on",
        ),
        _ => return None,
    };
    Some(Finding::warning("age", seen, advice))
}
