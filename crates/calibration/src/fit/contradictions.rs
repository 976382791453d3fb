//! Contradictions among the training rows: parts whose reference differs from the rest, jumps of
//! the zero, poses that err far more, equal readings under different loads, and a reference
//! computed from the readings.

use std::collections::HashMap;
use std::iter::{repeat, repeat_n};

use super::cures::{Cure, WrenchProducts};
use super::evaluation::{GroupErrors, group_errors};
use super::outliers::Outliers;
use super::parts::{linear, predicted, spread};
use super::warning::Warning;
use super::{Fit, files};
use crate::groups::label_found_poses;
use least_squares::error::FitError;
use least_squares::passes::Workers;
use least_squares::quality::significant;
use least_squares::validation::cross_validation::CrossValidation;
use shell_data::block::Block;
use shell_data::dataset::Dataset;
use shell_data::statistics::RunningVariance;
use shell_data::wrench::{Axis, PerAxis};

const PARTS: usize = 4;

/// Most files that are compared, and that serve as the reference for the others.
const MOST_FILES: usize = 40;
const MOST_REFERENCES: usize = 4;

/// Rows per channel of a part that serves as the reference, at least.
const ROWS_PER_CHANNEL: usize = 4;

/// Limit for a part's error: this many errors of the reference part, but at least this share of its
/// loads.
const MOST: f64 = 3.0;
const NO_ERROR: f64 = 1e-3;

/// R² on every axis from which on a reference was computed from the readings.
const COMPUTED: f64 = 0.999_999;

/// Least error of a faulty pose, in errors of the others, and least number of poses. In random parts
/// of a sound recording, hung by hand, a pose errs up to 7.8 times as much; a load written down
/// wrongly, ten times and more.
const FAR_MORE: f64 = 9.0;
const FEWEST_POSES: usize = 8;

/// Largest difference of equal readings and least difference of different loads, as shares of their
/// ranges; most poses compared.
const SAME_READINGS: f64 = 0.005;
const OTHER_LOADS: f64 = 0.2;
const MOST_POSES: usize = 1000;

/// Most means, in order of time, for a jump of the zero; and means on each side that show how
/// sudden it is.
const MEANS: usize = 240;
const BESIDE: usize = 12;

/// Least number of rows of a mean that is no pose: single rows of a short file scatter too much.
const ROWS_OF_MEAN: usize = 5;

/// Least number of independent means, apart from the jump.
const INDEPENDENT: f64 = 24.0;

/// A log with more rows uses every second, third, … block for residuals.
const MOST_ROWS: u64 = 100_000;

/// Largest share of rows that stand out by chance or by a slip now and then.
const MOST_OUTLIERS: f64 = 0.02;

/// Least share of the squares of the means that a jump or a drift explains, and of the jump between
/// adjacent means.
const EXPLAINED: f64 = 0.6;
const SUDDEN: f64 = 0.6;

/// Least jump, and least drift, of the zero, in root mean square errors: a jump alone has 2 of them, a drift 3.5.
const JUMP: f64 = 1.5;
const DRIFT: f64 = 2.0;

pub(super) fn find(fit: &Fit, workers: Workers<'_>) -> Result<Vec<String>, FitError> {
    let mut found = parts(fit, workers)?;
    if found.is_empty() {
        found = files::find(fit, workers)?;
    }
    if found.is_empty() {
        found.extend(moving_zero(fit));
    }
    found.extend(same_readings(fit));
    found.extend(poses_that_err(fit, workers)?);
    found.extend(computed_reference(fit));
    found.extend(many_outliers(fit));
    found.extend(fit.warnings.iter().find_map(|warning| match warning {
        Warning::MomentUnit(lever_m) => {
            Some(format!("moments / forces = {lever_m:.1} m: moments are probably in mN·m"))
        }
        Warning::PointUnit(_) => Some(warning.to_string()),
        _ => None,
    }));
    Ok(found)
}

/// Files, or blocks of a single file, whose reference agrees with the others only after a change.
fn parts(fit: &Fit, workers: Workers<'_>) -> Result<Vec<String>, FitError> {
    let axes = fit.calibration.axes;
    let data = fit.used.without_memory();
    let logs: Vec<Vec<&Block>> = data
        .logs
        .iter()
        .take(MOST_FILES)
        .map(|log| log.blocks.iter().map(|block| &*block.rows).collect())
        .collect();
    let (parts, names): (Vec<Block>, Vec<String>) = match &logs[..] {
        [log] => {
            let rows = data.rows();
            let part = |at: usize| {
                let [from, to] = [at, at + 1].map(|at| at as f64 / PARTS as f64);
                let [first, last] = [from, to].map(|share| (share * rows as f64) as u64);
                (spread(log, from..to), format!("rows {} to {last}", first + 1))
            };
            (0..PARTS).map(part).unzip()
        }
        logs => {
            let name = |log: &shell_data::dataset::LogRows| format!("`{}`", log.name.display());
            let names = data.logs.iter().take(MOST_FILES).map(name);
            (logs.iter().map(|log| spread(log, 0.0..1.0)).collect(), names.collect())
        }
    };
    let fewest = ROWS_PER_CHANNEL * data.channels();
    let mut best: Option<(usize, Vec<(usize, Cure)>)> = None;
    let every = parts.len().div_ceil(MOST_REFERENCES).max(1);
    for (reference, rows) in parts.iter().enumerate().step_by(every) {
        if rows.rows < fewest {
            continue;
        }
        let Some(linear) = linear(rows.clone(), axes, workers)? else { continue };
        let limit: PerAxis<f64> = std::array::from_fn(|axis| {
            let load = RunningVariance::new(&rows.wrench[axis]).rms();
            (MOST * linear.train[axis].rms).max(NO_ERROR * load)
        });
        let others =
            parts.iter().enumerate().filter(|(at, rows)| *at != reference && rows.rows > 0);
        let cured = others.filter_map(|(at, rows)| {
            let products = WrenchProducts::new(&predicted(&linear.calibration, rows), &rows.wrench);
            // The zero of a sensor may move between recordings.
            let cure = products.cure(&limit, axes).filter(|cure| !cure.is_zero)?;
            Some((at, cure))
        });
        let cured: Vec<_> = cured.collect();
        if best.as_ref().is_none_or(|(_, least)| cured.len() < least.len()) {
            best = Some((reference, cured));
        }
    }
    let Some((reference, cured)) = best else { return Ok(Vec::new()) };
    let mut told: Vec<String> = Vec::new();
    for same in cured.chunk_by(|a, b| a.1.change == b.1.change && a.0 + 1 == b.0) {
        let [(first, cure), ..] = same else { continue };
        let (last, _) = &same[same.len() - 1];
        let which = match (logs.len(), first == last) {
            (1, _) => {
                let rows = data.rows() as usize;
                format!("rows {} to {}", rows * first / PARTS + 1, rows * (last + 1) / PARTS)
            }
            (_, true) => names[*first].clone(),
            _ => format!("{} to {}", names[*first], names[*last]),
        };
        told.push(format!("in {which} against {}, {cure}", names[reference]));
    }
    Ok(told)
}

/// Largest jump, or drift, of an axis's mean residual, in the first log with one. Rows of a pose share their error, so each pose
/// is one mean.
fn moving_zero(fit: &Fit) -> Option<String> {
    let found = match fit.group_by.is_some_and(|by| by.is_poses()) {
        true => Some(fit.used.clone()),
        false => label_found_poses(&fit.used).map(|(_, data)| data),
    };
    let are_poses = found.is_some();
    for log in &found.as_ref().unwrap_or(&fit.used).logs {
        let blocks = (log.rows() / MOST_ROWS + 1) as usize;
        let every = (log.rows() as usize / blocks).div_ceil(MEANS).max(ROWS_OF_MEAN);
        let mut means: Vec<ResidualMean> = Vec::new();
        let (mut first, mut label) = (0, None);
        for (at, block) in log.blocks.iter().enumerate() {
            let rows = block.rows.rows;
            let mut at_row = first;
            first += rows;
            if at % blocks != 0 {
                continue;
            }
            let predicted = predicted(&fit.calibration, &block.rows);
            let labels = block.labels.iter().flat_map(|(label, rows)| repeat_n(Some(label), *rows));
            for (row, now) in (0..rows).zip(labels.chain(repeat(None))) {
                let is_next = match are_poses {
                    true => label != now,
                    false => means.last().is_some_and(|last| last.rows == every),
                };
                if is_next || means.is_empty() {
                    means.push(ResidualMean { first_row: at_row, ..ResidualMean::default() });
                }
                (label, at_row) = (now, at_row + 1);
                let last = means.last_mut().expect("one that was just added at the latest");
                last.rows += 1;
                for (axis, sum) in last.sums.iter_mut().enumerate() {
                    *sum += predicted[axis][row] - block.rows.wrench[axis][row];
                }
            }
        }
        let column = |axis: Axis| {
            means.iter().map(|of| of.sums[axis.index()] / of.rows as f64).collect::<Vec<f64>>()
        };
        let jumps = fit.calibration.axes.iter();
        let jumps = jumps.filter_map(|axis| Some((axis, jump(&column(axis))?)));
        let is_large =
            |(axis, jump): &(Axis, Jump)| jump.size.abs() > JUMP * fit.train[axis.index()].rms;
        let jumps = jumps.filter(is_large);
        let largest = jumps.max_by(|a, b| a.1.explained.total_cmp(&b.1.explained));
        let drifts = fit.calibration.axes.iter().filter_map(|axis| {
            let (size, explained) = drift(&column(axis))?;
            (size.abs() > DRIFT * fit.train[axis.index()].rms).then_some((axis, size, explained))
        });
        let drifted = drifts.max_by(|a, b| a.2.total_cmp(&b.2)).filter(|_| largest.is_none());
        if let Some((axis, size, _)) = drifted {
            return Some(format!(
                "the zero of {} drifts by {} {} over `{}`: let the sensors warm up first",
                axis.name(),
                significant(size.abs(), 2),
                axis.unit(),
                log.name.display()
            ));
        }
        if let Some((axis, jump)) = largest {
            return Some(format!(
                "the zero of {} jumps by {} {} at row {} of `{}`",
                axis.name(),
                significant(jump.size.abs(), 2),
                axis.unit(),
                means[jump.at].first_row + 1,
                log.name.display()
            ));
        }
    }
    None
}

/// Sums of the residuals of consecutive rows.
#[derive(Default)]
struct ResidualMean {
    first_row: usize,
    rows: usize,
    sums: PerAxis<f64>,
}

struct Jump {
    at: usize,
    size: f64,
    explained: f64,
}

/// Change along a straight line from the first to the last value of a column, if it explains most of it, and its share.
fn drift(column: &[f64]) -> Option<(f64, f64)> {
    let all = RunningVariance::new(column);
    let n = column.len();
    if n < 4 * BESIDE || all.squares <= 0.0 {
        return None;
    }
    let middle = (n - 1) as f64 / 2.0;
    let products = column.iter().enumerate().map(|(at, value)| (at as f64 - middle) * value);
    let squares = (n * n - 1) as f64 * n as f64 / 12.0;
    let slope = products.sum::<f64>() / squares;
    let explained = slope * slope * squares / all.squares;
    let rest = column.iter().enumerate().map(|(at, value)| value - slope * at as f64);
    let is_drift = explained > EXPLAINED && independent(&rest.collect::<Vec<f64>>()) > INDEPENDENT;
    is_drift.then_some((slope * (n - 1) as f64, explained))
}

/// Number of independent values that are worth as much as these, by the correlation of neighbours: rows of a pose that
/// is not labelled share their error.
fn independent(column: &[f64]) -> f64 {
    let all = RunningVariance::new(column);
    if all.squares <= 0.0 {
        return column.len() as f64;
    }
    let products = column.windows(2).map(|pair| (pair[0] - all.mean) * (pair[1] - all.mean));
    let correlation = (products.sum::<f64>() / all.squares).clamp(0.0, 1.0);
    column.len() as f64 * (1.0 - correlation) / (1.0 + correlation)
}

/// Jump of a column, if it explains most of it and is sudden.
fn jump(column: &[f64]) -> Option<Jump> {
    let all = RunningVariance::new(column);
    let n = column.len();
    if n < 4 * BESIDE || all.squares <= 0.0 {
        return None;
    }
    let (mut sum, mut best): (f64, Option<Jump>) = (0.0, None);
    for (at, value) in column.iter().enumerate() {
        if (n / 10..=n - n / 10).contains(&at) {
            let [before, after] = [at, n - at].map(|rows| rows as f64);
            let explained = sum * sum * (1.0 / before + 1.0 / after) / all.squares;
            if best.as_ref().is_none_or(|best| explained > best.explained) {
                // Deviations from the mean add up to `sum` before the jump, and to `-sum` after it.
                best = Some(Jump { at, size: -sum / after - sum / before, explained });
            }
        }
        sum += value - all.mean;
    }
    let found = best.filter(|best| best.explained > EXPLAINED)?;
    let mean = |part: &[f64]| RunningVariance::new(part).mean;
    let [before, after] = [found.at - BESIDE..found.at, found.at..found.at + BESIDE]
        .map(|part| mean(&column[part.start.min(n)..part.end.min(n)]));
    let rest = column.iter().enumerate();
    let rest = rest.map(|(at, value)| if at < found.at { *value } else { value - found.size });
    let is_jump = (after - before).abs() > SUDDEN * found.size.abs()
        && independent(&rest.collect::<Vec<f64>>()) > INDEPENDENT;
    is_jump.then_some(found)
}

/// The pose and axis with the largest error relative to the other poses, if it is far larger.
fn poses_that_err(fit: &Fit, workers: Workers<'_>) -> Result<Option<String>, FitError> {
    if !fit.group_by.is_some_and(|by| by.is_poses()) {
        return Ok(None);
    }
    let groups = group_errors(&fit.calibration, &fit.used, 0, workers)?.groups;
    if groups.len() < FEWEST_POSES {
        return Ok(None);
    }
    let held_out =
        fit.cross_validation.as_ref().map(CrossValidation::errors_alone).unwrap_or_default();
    let mut named: Vec<(f64, &str, Axis)> = Vec::new();
    for axis in fit.calibration.axes.iter() {
        // The residual of a pose of leverage h is (1 − h) times its held-out error, and its variance is proportional to
        // 1 − h. The geometric mean of both has the same variance for all poses.
        let square = |of: &GroupErrors| {
            let rms = of.errors[axis.index()].quality().map_or(0.0, |quality| quality.rms);
            let alone = held_out.get(of.label.as_str()).map_or(rms, |of| of[axis.index()].rms());
            rms * alone
        };
        let squares: Vec<f64> = groups.iter().map(square).collect();
        let total: f64 = squares.iter().sum();
        for (group, square) in groups.iter().zip(&squares) {
            let rest = (total - square) / (groups.len() - 1) as f64;
            if *square > FAR_MORE * FAR_MORE * rest && rest > 0.0 {
                named.push(((square / rest).sqrt(), &group.label, axis));
            }
        }
    }
    let worst = named.into_iter().max_by(|a, b| a.0.total_cmp(&b.0));
    Ok(worst.map(|(ratio, pose, axis)| {
        let ratio = significant(ratio, 2);
        format!(
            "pose `{pose}` errs {ratio} times as much as the rest on {}: check its load",
            axis.name()
        )
    }))
}

#[derive(Default)]
struct PoseMeans {
    rows: f64,
    readings: Vec<f64>,
    loads: PerAxis<f64>,
}

fn same_readings(fit: &Fit) -> Option<String> {
    fit.group_by.filter(|by| by.is_poses())?;
    let poses = pose_means(&fit.used.without_memory())?;
    let extent = |of: &dyn Fn(&PoseMeans) -> f64| {
        let (low, high) = shell_data::statistics::extremes(poses.iter().map(|(_, pose)| of(pose)));
        high - low
    };
    let channels = fit.calibration.channels();
    let readings: Vec<f64> =
        (0..channels).map(|channel| extent(&|pose| pose.readings[channel])).collect();
    let loads: PerAxis<f64> = std::array::from_fn(|axis| extent(&|pose| pose.loads[axis]));
    for (at, (first, a)) in poses.iter().enumerate() {
        for (second, b) in &poses[at + 1..] {
            let differs = |channel: usize| {
                (a.readings[channel] - b.readings[channel]).abs()
                    > SAME_READINGS * readings[channel]
            };
            let other = |axis: &Axis| {
                let axis = axis.index();
                (a.loads[axis] - b.loads[axis]).abs() > OTHER_LOADS * loads[axis]
            };
            if fit.calibration.axes.iter().any(|axis| other(&axis)) && !(0..channels).any(differs) {
                return Some(format!(
                    "poses `{first}` and `{second}` have the same readings under different loads: \
                     one of the loads is wrong"
                ));
            }
        }
    }
    None
}

/// Means of each pose, by first row; `None` for more than [`MOST_POSES`].
fn pose_means(data: &Dataset) -> Option<Vec<(String, PoseMeans)>> {
    let mut positions: HashMap<&str, usize> = HashMap::new();
    let mut poses: Vec<(String, PoseMeans)> = Vec::new();
    for (_, block) in data.blocks() {
        let mut start = 0;
        for (label, rows) in block.labels.iter() {
            let at = *positions.entry(label).or_insert(poses.len());
            if at == poses.len() {
                poses.push((label.clone(), PoseMeans::default()));
            }
            let of = &mut poses[at].1;
            let (readings, wrench) = (&block.rows.readings, &block.rows.wrench);
            of.readings.resize(readings.len(), 0.0);
            let sum = |column: &Vec<f64>| column[start..start + rows].iter().sum::<f64>();
            of.readings.iter_mut().zip(readings).for_each(|(of, column)| *of += sum(column));
            of.loads.iter_mut().zip(wrench).for_each(|(of, column)| *of += sum(column));
            of.rows += *rows as f64;
            start += rows;
        }
    }
    if poses.len() > MOST_POSES {
        return None;
    }
    for (_, pose) in &mut poses {
        pose.readings.iter_mut().chain(&mut pose.loads).for_each(|of| *of /= pose.rows.max(1.0));
    }
    Some(poses)
}

fn many_outliers(fit: &Fit) -> Option<String> {
    let found = [fit.outliers.found(), Some(&fit.dropped)];
    let count = |of: &Outliers| of.too_many.unwrap_or(of.rows.len());
    let rows = found.into_iter().flatten().map(count).max()?;
    let of = fit.rows + fit.dropped.rows.len() as u64;
    (rows as f64 > MOST_OUTLIERS * of as f64).then(|| {
        format!("{rows} of {of} rows stand out by their error: check cables and units around them")
    })
}

/// A reference that the readings explain too well for a measurement.
fn computed_reference(fit: &Fit) -> Option<String> {
    let worst = |axis: Axis| fit.train[axis.index()].r_squared;
    let all: Option<Vec<f64>> = fit.calibration.axes.iter().map(worst).collect();
    let least = all?.into_iter().fold(f64::INFINITY, f64::min);
    let is_computed = least >= COMPUTED && fit.rows > 3 * fit.rank() as u64;
    is_computed.then(|| {
        format!(
            "the reference is computed from the readings (R² at least {}): it is no measurement",
            (least * 1e7).floor() / 1e7
        )
    })
}
