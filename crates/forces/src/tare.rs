//! Tare: frames taken as unloaded, a check of them against the training data, and a zero taken during recording.

use calibration::Calibration;
use calibration::quality::AxisQuality;
use calibration::uncertainty::Tare;
use calibration::validation::excitation::Excitation;
use shell_data::statistics::RunningVariance;
use shell_data::wrench::{Axis, AxisValues, PerAxis};

use super::stationary::{STATIONARY_FRAMES, StationaryFinder, StationaryInterval};
use super::{DEFAULT_TARE_FRAMES, ForceError, ForcePipeline, RowRule, TareRule};

/// Number of frames summed at once. It is fixed, so that the mean has the same bits however the log is cut.
const CHUNK: usize = 4096;

#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct TareSearch {
    rule: TareRule,
    rows: RowRule,
    is_over: bool,
    /// Readings of found frames that are not yet in `mean`, counts, one column per channel.
    chunk: Vec<Vec<f64>>,
    mean: Option<Tare>,
    spread: PerAxis<RunningVariance>,
    found: usize,
    found_s: Option<(f64, f64)>,
    seen_s: Option<(f64, f64)>,
    pub(super) frames: Option<TareFrames>,
    zeros: Option<StationaryZeros>,
    /// Search for stationary intervals; `None` if the caller searches, and only the first interval is needed here.
    pub(super) finder: Option<StationaryFinder>,
}

/// The frames of a tare; those of the first interval, if the tare follows the stationary intervals.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TareFrames {
    pub readings: Vec<Vec<f64>>,
    pub times_s: Vec<f64>,
    /// Position of the right leg at each frame, counts; empty if unknown.
    pub leg: Vec<f64>,
}

#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct TareResult {
    pub frames: usize,
    /// Time of the first frame, s; `None` if the log has no time.
    pub start_s: Option<f64>,
    pub end_s: Option<f64>,
    /// The wrench that is subtracted, N and N·m.
    #[serde(serialize_with = "by_column")]
    pub wrench: AxisValues<f64>,
    /// N and N·m.
    #[serde(serialize_with = "by_column")]
    pub sd: AxisValues<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rests: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub last_rest_s: Option<f64>,
}

#[derive(Clone, Copy, Debug)]
pub struct FirstRows<'a> {
    /// Times, s; empty if the log has no time.
    pub times_s: &'a [f64],
    pub readings: &'a [Vec<f64>],
    pub fresh: &'a [bool],
    /// Counts.
    pub leg: Option<&'a [f64]>,
}

impl TareSearch {
    pub(super) fn new(rule: TareRule, rows: RowRule) -> Self {
        let mut search = Self { rule, rows, is_over: rule == TareRule::Untared, ..Self::default() };
        if let TareRule::Rests { causal } = rule {
            search.zeros = Some(StationaryZeros { causal, knots: Vec::new() });
            search.finder = Some(StationaryFinder::default());
        }
        search
    }

    pub(super) fn wants(&self, last_s: f64) -> bool {
        match self.rule {
            TareRule::Between(start_s, _) => !self.is_done() && last_s >= start_s,
            _ => !self.is_done(),
        }
    }

    /// Returns true if no more rows are needed: never while stationary intervals are searched for.
    pub(super) fn is_done(&self) -> bool {
        self.is_over || (self.found >= self.wanted() && self.finder.is_none())
    }

    fn wanted(&self) -> usize {
        match self.rule {
            TareRule::First(frames) => frames,
            TareRule::Rests { .. } => STATIONARY_FRAMES,
            TareRule::Untared | TareRule::Between(..) => usize::MAX,
        }
    }

    pub(super) fn look_at(&mut self, calibration: &Calibration, rows: FirstRows<'_>) {
        self.look_for_stationary(calibration, rows);
        let wanted = self.wanted();
        for row in 0..rows.fresh.len() {
            if self.is_over || self.found >= wanted {
                return;
            }
            let time = rows.times_s.get(row).copied();
            extend(&mut self.seen_s, time);
            let is_early = match self.rule {
                TareRule::Between(_, end_s) if time.is_none_or(|time| time > end_s) => {
                    self.is_over = true;
                    return;
                }
                TareRule::Between(start_s, _) => time.is_some_and(|time| time < start_s),
                _ => false,
            };
            if !is_early && (self.rows == RowRule::Rows || rows.fresh[row]) {
                self.take(calibration, rows, row);
            }
        }
    }

    fn look_for_stationary(&mut self, calibration: &Calibration, rows: FirstRows<'_>) {
        let (Some(finder), Some(zeros)) = (&mut self.finder, &mut self.zeros) else { return };
        let by_row = self.rows == RowRule::Rows;
        let frames: Vec<bool> = rows.fresh.iter().map(|&fresh| fresh || by_row).collect();
        let pick = |column: &[f64]| -> Vec<f64> {
            let rows = column.iter().zip(&frames);
            rows.filter(|(_, is_frame)| **is_frame).map(|(value, _)| *value).collect()
        };
        // When still, memory terms are zero, so plain channels suffice.
        let channels = rows.readings.iter().take(calibration.channels());
        let readings: Vec<Vec<f64>> = channels.map(|column| pick(column)).collect();
        finder.look_at(&pick(rows.times_s), &readings, &mut |stationary| {
            zeros.add(calibration, stationary)
        });
    }

    fn take(&mut self, calibration: &Calibration, rows: FirstRows<'_>, row: usize) {
        let time = rows.times_s.get(row).copied();
        push_row(&mut self.chunk, rows.readings, row);
        if let Some(frames) = &mut self.frames {
            push_row(&mut frames.readings, rows.readings, row);
            frames.times_s.extend(time);
            frames.leg.extend(rows.leg.map(|leg| leg[row]));
        }
        self.found += 1;
        extend(&mut self.found_s, time);
        if self.chunk[0].len() == CHUNK {
            self.add_chunk(calibration);
        }
    }

    fn add_chunk(&mut self, calibration: &Calibration) {
        let Some(next) = calibration.tare(&self.chunk) else { return };
        let mut wrench = PerAxis::default();
        calibration.wrench(&self.chunk, &mut wrench);
        for (spread, axis) in self.spread.iter_mut().zip(&wrench) {
            spread.merge(&RunningVariance::new(axis));
        }
        self.chunk.iter_mut().for_each(Vec::clear);
        self.mean = Some(match self.mean.take() {
            None => next,
            Some(mean) => mean_of_both(&mean, &next),
        });
    }

    /// # Errors
    /// [`ForceError::TareFrames`], [`ForceError::TareTime`] if there are too few frames.
    pub(super) fn finish(mut self, calibration: &Calibration) -> Result<ForcePipeline, ForceError> {
        let (found, wanted) = (self.found, self.wanted());
        match self.rule {
            TareRule::Untared => return Ok(ForcePipeline::default()),
            TareRule::Between(start_s, end_s) if found == 0 => {
                let (first_s, last_s) = self.seen_s.unwrap_or((f64::NAN, f64::NAN));
                return Err(ForceError::TareTime { start_s, end_s, first_s, last_s });
            }
            TareRule::First(_) | TareRule::Rests { .. } if found < wanted.max(1) => {
                return Err(ForceError::TareFrames { wanted, found });
            }
            _ => {}
        }
        if !self.chunk[0].is_empty() {
            self.add_chunk(calibration);
        }
        let knots = self.zeros.as_ref().map(|zeros| &zeros.knots);
        let tare_result = self.mean.as_ref().map(|mean| TareResult {
            frames: mean.frames,
            start_s: self.found_s.map(|(start, _)| start),
            end_s: self.found_s.map(|(_, end)| end),
            wrench: calibration.axes.values(&mean.wrench),
            sd: calibration.axes.values(&self.spread.map(|axis| axis.rms_about_mean())),
            rests: knots.map(Vec::len),
            last_rest_s: knots.and_then(|knots| Some(knots.last()?.end_s)),
        });
        let Self { mean: tare, zeros, frames: tare_frames, .. } = self;
        Ok(ForcePipeline { tare, zeros, tare_result, tare_frames, ..ForcePipeline::default() })
    }
}

fn extend(span_s: &mut Option<(f64, f64)>, time_s: Option<f64>) {
    if let Some(time_s) = time_s {
        *span_s = Some((span_s.map_or(time_s, |(first, _)| first), time_s));
    }
}

/// The zero as a function of time, from stationary intervals in order.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct StationaryZeros {
    /// Holds the zero of the last complete interval, instead of linear interpolation.
    causal: bool,
    knots: Vec<Knot>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Knot {
    middle_s: f64,
    end_s: f64,
    wrench: PerAxis<f64>,
}

impl StationaryZeros {
    pub(super) fn add(&mut self, calibration: &Calibration, stationary: &StationaryInterval) {
        if let Some(tare) = calibration.tare(&stationary.readings) {
            let (middle_s, end_s) = (stationary.middle_s(), stationary.end_s());
            self.knots.push(Knot { middle_s, end_s, wrench: tare.wrench });
        }
    }

    /// Returns the zero at a time, N and N·m: 0 if there was no stationary interval.
    pub(super) fn at(&self, time_s: f64) -> PerAxis<f64> {
        if self.causal {
            let next = self.knots.partition_point(|knot| knot.end_s <= time_s);
            return self.knots.get(next.saturating_sub(1)).map_or([0.0; 6], |knot| knot.wrench);
        }
        let next = self.knots.partition_point(|knot| knot.middle_s <= time_s);
        match (next.checked_sub(1).map(|before| &self.knots[before]), self.knots.get(next)) {
            (Some(a), Some(b)) => {
                let share = (time_s - a.middle_s) / (b.middle_s - a.middle_s);
                std::array::from_fn(|axis| {
                    a.wrench[axis] + (b.wrench[axis] - a.wrench[axis]) * share
                })
            }
            (one, other) => one.or(other).map_or([0.0; 6], |knot| knot.wrench),
        }
    }
}

impl TareFrames {
    pub fn end_s(&self) -> f64 {
        self.times_s.last().copied().unwrap_or(f64::NEG_INFINITY)
    }
}

fn push_row(columns: &mut Vec<Vec<f64>>, readings: &[Vec<f64>], row: usize) {
    columns.resize_with(readings.len(), Vec::new);
    columns.iter_mut().zip(readings).for_each(|(column, readings)| column.push(readings[row]));
}

fn mean_of_both(a: &Tare, b: &Tare) -> Tare {
    let frames = a.frames + b.frames;
    let share = b.frames as f64 / frames as f64;
    let mean = |a: f64, b: f64| a + (b - a) * share;
    Tare {
        frames,
        features: a.features.iter().zip(&b.features).map(|(&a, &b)| mean(a, b)).collect(),
        wrench: std::array::from_fn(|axis| mean(a.wrench[axis], b.wrench[axis])),
        variance: std::array::from_fn(|axis| mean(a.variance[axis], b.variance[axis])),
    }
}

/// Serializes one value per axis under the axes' column names.
///
/// # Errors
/// Any error of `serializer`.
pub fn by_column<T: serde::Serialize, S: serde::Serializer>(
    values: &AxisValues<T>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.collect_map(values.iter().map(|(axis, value)| (axis.column(), value)))
}

/// Share of the largest training load above which a tare is doubtful; drift and noise stay below it.
const LOADED: f64 = 0.1;

/// Multiple of the calibration error below which a tare wrench is not a detectable load.
const ERRORS: f64 = 4.0;

const CONSEQUENCE: &str = "every force of this log is relative to it";

impl TareResult {
    /// The most serious reason to doubt that the frames were unloaded: their mean wrench is far from the zero of the
    /// calibration, or the wrench changes during the tare. `errors` and `loads` describe the training data.
    pub fn doubt(&self, errors: &PerAxis<AxisQuality>, loads: &Excitation) -> Option<String> {
        let largest = loads.largest_loads();
        let excess = |of: &AxisValues<f64>| {
            let limit = |axis: Axis| {
                (LOADED * largest[axis.index()]).max(ERRORS * errors[axis.index()].rms)
            };
            let over = of.iter().map(|&(axis, value)| (axis, value, value.abs() / limit(axis)));
            let known = over.filter(|(_, _, excess)| excess.is_finite());
            let (axis, value, excess) = known.max_by(|a, b| a.2.total_cmp(&b.2))?;
            (excess > 1.0).then_some((axis, value))
        };
        if let Some((axis, mean)) = excess(&self.wrench) {
            let (name, unit) = (axis.name(), axis.unit());
            return Some(format!(
                "the frames of the tare are loaded, it seems: {name} is {mean:.3} {unit} there; {CONSEQUENCE}"
            ));
        }
        excess(&self.sd).map(|(axis, sd)| {
            let (name, unit) = (axis.name(), axis.unit());
            format!(
                "the load changes during the tare: {name} varies by {sd:.3} {unit} (standard deviation); \
                 {CONSEQUENCE}"
            )
        })
    }
}

/// The zero of a stream, taken on request: the mean of the next [`DEFAULT_TARE_FRAMES`] wrenches,
/// after tare and low-pass.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RunningTare {
    pub zero: PerAxis<f64>,
    pending: Option<(usize, PerAxis<f64>)>,
}

impl RunningTare {
    pub fn begin(&mut self) {
        self.pending = Some((0, [0.0; 6]));
    }

    pub fn is_pending(&self) -> bool {
        self.pending.is_some()
    }

    /// Returns true if this wrench completes a tare; the new zero applies from this wrench on.
    pub fn push(&mut self, wrench: PerAxis<f64>) -> bool {
        let Some((count, sum)) = &mut self.pending else { return false };
        *count += 1;
        sum.iter_mut().zip(wrench).for_each(|(sum, value)| *sum += value);
        if *count < DEFAULT_TARE_FRAMES {
            return false;
        }
        let (count, sum) = (*count as f64, *sum);
        *self = Self { zero: sum.map(|sum| sum / count), pending: None };
        true
    }
}

#[cfg(test)]
mod tests {
    use calibration::scaling::Scaling;
    use calibration::validation::excitation::AxisExcitation;
    use calibration::{Basis, Model};

    use super::*;

    /// A calibration in which Fx equals the reading.
    fn identity() -> Calibration {
        let model = Model { basis: Basis::Linear, intercept: false, channels: 1, memory: 0 };
        Calibration::new(model, Scaling::identity(1), vec![[1.0, 0.0, 0.0, 0.0, 0.0, 0.0]])
    }

    /// Twelve rows one second apart, each frame in two rows: 0, 0, 1, 1, …, processed in pieces.
    fn search(rule: TareRule, rows: RowRule) -> Result<ForcePipeline, ForceError> {
        let mut search = TareSearch::new(rule, rows);
        search.frames = Some(TareFrames::default());
        let times: Vec<f64> = (0..12).map(f64::from).collect();
        let readings: Vec<f64> = times.iter().map(|t| (t / 2.0).floor()).collect();
        let fresh: Vec<bool> = (0..12).map(|i| i % 2 == 0).collect();
        for start in (0..12).step_by(5) {
            let end = (start + 5).min(12);
            if search.wants(times[end - 1]) {
                let rows = FirstRows {
                    times_s: &times[start..end],
                    readings: &[readings[start..end].to_vec()],
                    fresh: &fresh[start..end],
                    leg: None,
                };
                search.look_at(&identity(), rows);
            }
        }
        search.finish(&identity())
    }

    #[test]
    fn first_frames_count_once_by_time_and_rows_count_by_row() {
        let found = search(TareRule::First(4), RowRule::Time).unwrap();
        let frames = found.tare_frames.unwrap();
        assert_eq!(frames.readings, [[0.0, 1.0, 2.0, 3.0]]);
        assert_eq!((frames.times_s[0], frames.end_s()), (0.0, 6.0));
        assert_eq!(found.tare.unwrap().wrench[0], 1.5);
        let by_row = search(TareRule::First(4), RowRule::Rows).unwrap();
        assert_eq!(by_row.tare_frames.unwrap().readings, [[0.0, 0.0, 1.0, 1.0]]);
        let untared = search(TareRule::Untared, RowRule::Time).unwrap();
        assert!(untared.tare.is_none() && untared.tare_result.is_none());
        assert!(untared.tare_frames.is_none() && untared.zeros.is_none());
        let error = search(TareRule::First(7), RowRule::Time).unwrap_err();
        assert_eq!(error, ForceError::TareFrames { wanted: 7, found: 6 });
    }

    #[test]
    fn a_tare_by_time_takes_the_frames_between() {
        let found = search(TareRule::Between(3.0, 8.5), RowRule::Time).unwrap();
        assert_eq!(found.tare_frames.unwrap().readings, [[2.0, 3.0, 4.0]]);
        let result = found.tare_result.unwrap();
        assert_eq!((result.frames, result.start_s, result.end_s), (3, Some(4.0), Some(8.0)));
        let error = search(TareRule::Between(20.0, 30.0), RowRule::Time).unwrap_err();
        assert!(matches!(error, ForceError::TareTime { .. }), "{error}");
    }

    #[test]
    fn long_tares_do_not_depend_on_how_the_log_is_cut() {
        let readings: Vec<f64> = (0..10_000).map(|i| f64::from(i * i % 4093) / 7.0).collect();
        let fresh = vec![true; readings.len()];
        let tare = |piece: usize| {
            let mut search = TareSearch::new(TareRule::First(9000), RowRule::Time);
            for (readings, fresh) in readings.chunks(piece).zip(fresh.chunks(piece)) {
                let readings = [readings.to_vec()];
                let rows = FirstRows { times_s: &[], readings: &readings, fresh, leg: None };
                search.look_at(&identity(), rows);
            }
            search.finish(&identity()).unwrap().tare.unwrap()
        };
        let whole = tare(10_000);
        assert_eq!((whole.frames, &whole), (9000, &tare(7)));
        let mean = readings[..9000].iter().sum::<f64>() / 9000.0;
        // 9000 terms of up to 600 are off by 1e-12 of their sum at worst.
        assert!((whole.wrench[0] - mean).abs() < 1e-9);
    }

    #[test]
    fn a_zero_is_linear_between_stationary_intervals_and_constant_while_recording() {
        let knot = |end_s: f64, fx| Knot {
            middle_s: end_s - 1.0,
            end_s,
            wrench: [fx, 0.0, 0.0, 0.0, 0.0, 0.0],
        };
        let knots = vec![knot(2.0, 1.0), knot(6.0, 3.0), knot(12.0, 0.0)];
        let fx = |causal, time_s| StationaryZeros { causal, knots: knots.clone() }.at(time_s)[0];
        let straight = [0.0, 1.0, 3.0, 5.0, 7.0, 11.0, 20.0].map(|t| fx(false, t));
        assert_eq!(straight, [1.0, 1.0, 2.0, 3.0, 2.0, 0.0, 0.0]);
        let held = [0.0, 2.0, 5.9, 6.0, 11.9, 12.0, 20.0].map(|t| fx(true, t));
        assert_eq!(held, [1.0, 1.0, 1.0, 3.0, 3.0, 0.0, 0.0]);
        let none = StationaryZeros { causal: true, knots: Vec::new() };
        assert_eq!(none.at(1.0), [0.0; 6]);
    }

    /// Returns the doubt about a tare, for training loads up to 10 N and 1 N·m and errors of 0.1 N and 0.01 N·m.
    fn doubt(wrench: [f64; 2], sd: [f64; 2]) -> Option<String> {
        let scale = |axis: Axis| if axis.is_moment() { 0.1 } else { 1.0 };
        let axis = |axis| AxisExcitation { max: 10.0 * scale(axis), ..AxisExcitation::default() };
        let error = |axis| AxisQuality { rms: 0.1 * scale(axis), ..AxisQuality::default() };
        let loads = Excitation {
            axes: Axis::ALL.map(axis),
            correlation: PerAxis::default(),
            condition: Some(1.0),
        };
        let values = |[fz, mx]: [f64; 2]| vec![(Axis::Fz, fz), (Axis::Mx, mx)];
        let tare = TareResult {
            frames: 50,
            start_s: None,
            end_s: None,
            wrench: values(wrench),
            sd: values(sd),
            rests: None,
            last_rest_s: None,
        };
        tare.doubt(&Axis::ALL.map(error), &loads)
    }

    #[test]
    fn loads_and_changes_above_a_tenth_of_the_range_are_reported() {
        assert_eq!(doubt([0.9, 0.09], [0.9, 0.0]), None, "a zero that has drifted");
        for (wrench, sd, said) in [
            ([-2.0, 0.3], [0.0, 0.0], "loaded, it seems: Mx is 0.300 N·m there"),
            ([0.0, 0.0], [1.2, 0.0], "changes during the tare: Fz varies by 1.200 N (standard"),
            ([-2.0, 0.0], [0.0, 0.0], "loaded, it seems: Fz is -2.000 N there"),
        ] {
            let text = doubt(wrench, sd).unwrap();
            assert!(text.contains(said), "{text}");
        }
    }
}
