//! The state of a sitting: the loads so far, and what comes next.

use std::collections::VecDeque;

use calibration::fit::Workers;
use calibration::load_plan::{Order, Planner, PredictedError, SensorKnowledge, couplings};
use calibration::quality::significant;
use live_view::{
    ErrorPoint, Guide, GuidePhase, GuideView, GuidedLoad, LiveRow, LoadGuide, UnloadedValues,
};
use load_table::{HungLoad, HungLoads, Pull};
use shared_proto::CHANNELS;
use shell_data::block::FrameLabel;
use shell_data::statistics::RunningVariance;
use shell_data::wrench::{Axis, PerAxis};

use super::estimate::Estimate;
use super::fault::SittingFault;
use super::held::{HeldLoad, moved_unloaded};

pub const CHECK: &str = "check";

/// Column in a table of recorded loads with the label that each load has in the table of the rig.
const RIG_COLUMN: &str = "plan_load";

/// Minimum number of loads for decisions based on errors on held-out loads.
const FEWEST: usize = 12;

/// Maximum number of further loads that are planned to predict whether the limits can be reached.
const MOST_AHEAD: usize = 60;

/// Error limits that end the loads: of forces in N and of moments in N·m.
pub type ErrorLimits = [Option<f64>; 2];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SittingStage {
    Loads,
    Check,
    Over,
}

#[derive(Clone, Debug)]
struct Take {
    /// Its line in the table of the rig.
    line: usize,
    /// The load as stated, or as measured by the reference, with the label of its rows.
    load: HungLoad,
    readings: Vec<f64>,
    fault: Option<SittingFault>,
}

#[derive(Debug)]
pub struct Sitting {
    rig: HungLoads,
    candidates: Vec<PerAxis<f64>>,
    /// Largest load of each axis.
    largest: PerAxis<f64>,
    limits: ErrorLimits,
    threads: usize,
    guide: Guide,
    /// Rows that may belong to a load that is being held.
    rows: VecDeque<LiveRow>,
    /// Wrench of the reference at the start, without a load.
    zero: PerAxis<RunningVariance>,
    /// The first values without a load after the newest load, and the number of loads at that time.
    unloaded: Option<(usize, UnloadedValues)>,
    /// True if the guide knows the unloaded sensor.
    is_zeroed: bool,
    /// Readings without a load at the start of a sitting that goes on.
    rest: Option<[f64; CHANNELS]>,
    /// True while a recorded load has to be taken off first.
    still_hangs: bool,
    takes: Vec<Take>,
    check: Option<Take>,
    skipped: Vec<bool>,
    /// Largest scatter of each channel at any load so far, counts.
    usual: [f64; CHANNELS],
    estimate: Option<Estimate>,
    errors: Vec<ErrorPoint>,
    stage: SittingStage,
    finding: String,
}

impl Sitting {
    /// Begins a sitting with the loads of a rig. The loads count as stated, unless rows have the wrench of a
    /// reference. `threads` is as in [`Workers::new`].
    pub fn new(rig: HungLoads, limits: ErrorLimits, threads: usize) -> Self {
        let guided = |load: &HungLoad| GuidedLoad {
            group: load.group.clone(),
            text: load.to_string(),
            wrench: load.wrench(),
            gain: 0.0,
        };
        let candidates: Vec<PerAxis<f64>> = rig.loads().iter().map(HungLoad::wrench).collect();
        let largest = std::array::from_fn(|axis| {
            candidates.iter().map(|load| load[axis].abs()).fold(0.0, f64::max)
        });
        let mut sitting = Self {
            guide: Guide::new(rig.loads().iter().map(guided).collect()),
            skipped: vec![false; candidates.len()],
            candidates,
            largest,
            rig,
            limits,
            threads,
            rows: VecDeque::new(),
            zero: PerAxis::default(),
            unloaded: None,
            is_zeroed: false,
            rest: None,
            still_hangs: false,
            takes: Vec::new(),
            check: None,
            usual: [0.0; CHANNELS],
            estimate: None,
            errors: Vec::new(),
            stage: SittingStage::Loads,
            finding: String::new(),
        };
        sitting.ask_next(false);
        sitting
    }

    pub fn stage(&self) -> SittingStage {
        self.stage
    }

    pub fn used(&self) -> usize {
        self.used_takes().count()
    }

    pub fn estimate(&self) -> Option<&Estimate> {
        self.estimate.as_ref()
    }

    pub fn errors(&self) -> &[ErrorPoint] {
        &self.errors
    }

    pub fn finding(&self) -> &str {
        &self.finding
    }

    /// Returns the line of the load that is asked for.
    pub fn next_line(&self) -> usize {
        self.guide.next()
    }

    /// Returns the table of the loads that are used, as CSV; `None` without any.
    pub fn table(&self) -> Option<String> {
        self.csv(self.used_takes())
    }

    pub fn check_table(&self) -> Option<String> {
        self.csv(self.check.iter())
    }

    /// Returns the line of the rig's table for which each line of `recorded`, a [`table`](Self::table), was
    /// recorded. Fails if the rig does not have a load, or another one with its label.
    pub fn lines_of(&self, recorded: &HungLoads, measured: bool) -> Result<Vec<usize>, String> {
        let own = || recorded.loads().iter().map(|load| load.group.clone()).collect();
        let labels: Vec<String> = recorded
            .column(RIG_COLUMN)
            .map_or_else(own, |cells| cells.map(str::to_owned).collect());
        let line = |(label, was): (String, &HungLoad)| {
            let position = self.rig.loads().iter().position(|load| load.group == label);
            let line = position.ok_or_else(|| format!("the rig has no load `{label}`"))?;
            let load = &self.rig.loads()[line];
            match measured || load.pull == was.pull {
                true => Ok(line),
                false => Err(format!("load `{label}` was {was}, and the rig has {load}")),
            }
        };
        labels.into_iter().zip(recorded.loads()).map(line).collect()
    }

    /// Takes a load that was recorded for a line of the rig's table. Returns the label of its rows, or the
    /// fault for which it has to be recorded again.
    pub fn record(&mut self, line: usize, held: &HeldLoad) -> Result<String, SittingFault> {
        if let Some(fault) = held.fault(&self.usual, &self.largest) {
            self.finding = format!("load `{}`: {fault}; hold it again", self.label(line));
            return Err(fault);
        }
        for (usual, scatter) in self.usual.iter_mut().zip(held.scatter()) {
            *usual = usual.max(scatter);
        }
        let group = self.free_label(line);
        let load = HungLoad { group: group.clone(), ..self.rig.loads()[line].clone() };
        let load = match held.wrench() {
            Some(wrench) => HungLoad { pull: Pull::Wrench(wrench), ..load },
            None => load,
        };
        let take = Take { line, load, readings: held.means(), fault: None };
        if self.stage == SittingStage::Check {
            self.check = Some(take);
            self.stage = SittingStage::Over;
            self.finding.clear();
        } else {
            self.take(take);
        }
        self.ask_next(true);
        Ok(group)
    }

    pub fn undo(&mut self) {
        let Some(take) = self.takes.pop() else { return };
        self.stage = SittingStage::Loads;
        self.finding = format!("load `{}` is taken back", take.load.group);
        self.use_estimate(self.fitted());
        self.ask_next(false);
    }

    fn used_takes(&self) -> impl Iterator<Item = &Take> + Clone {
        self.takes.iter().filter(|take| take.fault.is_none())
    }

    fn label(&self, line: usize) -> &str {
        &self.rig.loads()[line].group
    }

    /// Returns a label for the rows of a load, unused by other rows.
    fn free_label(&self, line: usize) -> String {
        if self.stage == SittingStage::Check {
            return CHECK.to_owned();
        }
        let label = self.label(line);
        let is_free = |name: &String| {
            let of_rig = self.rig.loads().iter().any(|load| load.group == *name && name != label);
            !of_rig && self.takes.iter().all(|take| take.load.group != *name) && name != CHECK
        };
        let names = [label.to_owned()].into_iter();
        let mut names = names.chain((2..).map(|number: usize| format!("{label}.{number}")));
        names.find(is_free).expect("numbers do not end")
    }

    fn take(&mut self, take: Take) {
        let before = self.estimate.clone().filter(|_| self.used() >= FEWEST);
        let wrench = take.load.wrench();
        let fault = before
            .as_ref()
            .and_then(|before| SittingFault::of_load(before, &wrench, &take.readings));
        self.takes.push(take);
        let estimate = self.fitted();
        let is_contradiction = match (&before, &estimate) {
            (Some(before), Some(estimate)) => estimate.contradicts(before),
            _ => false,
        };
        self.finding.clear();
        match fault.filter(|_| is_contradiction) {
            Some(fault) => {
                let take = self.takes.last_mut().expect("it was just pushed");
                self.finding = format!("load `{}` ({}) {fault}", take.load.group, take.load);
                take.fault = Some(fault);
            }
            None => {
                self.use_estimate(estimate);
                if self.judge_again() {
                    self.use_estimate(self.fitted());
                }
            }
        }
    }

    fn fitted(&self) -> Option<Estimate> {
        let (loads, readings) = self.used_loads();
        Estimate::new(&loads, &readings, Workers::new(self.threads)).ok()
    }

    fn use_estimate(&mut self, estimate: Option<Estimate>) {
        let loads = self.used();
        self.errors.retain(|known| known.loads < loads);
        self.estimate = estimate;
        let Some(Estimate { error, upper, .. }) = &self.estimate else { return };
        let largest = |errors: &PerAxis<f64>| {
            [&errors[..3], &errors[3..]].map(|part| part.iter().copied().fold(0.0, f64::max))
        };
        self.errors.push(ErrorPoint { loads, error: largest(error), upper: largest(upper) });
    }

    /// Uses loads again if an earlier model left them out and the newest agrees with them; returns true if any.
    fn judge_again(&mut self) -> bool {
        let Some(estimate) = &self.estimate else { return false };
        let mut is_any_used = false;
        for take in self.takes.iter_mut().filter(|take| take.fault.is_some()) {
            take.fault = SittingFault::of_load(estimate, &take.load.wrench(), &take.readings);
            is_any_used |= take.fault.is_none();
        }
        is_any_used
    }

    /// Asks for the most informative load that is left, for the check weight, or for nothing.
    fn ask_next(&mut self, was_held: bool) {
        if self.stage == SittingStage::Loads {
            let next = if self.is_reached() { None } else { self.plan(was_held) };
            if let Some(line) = next {
                self.guide.choose(Some(line), was_held);
                return;
            }
            self.stage = SittingStage::Check;
        }
        let asked = match self.stage {
            SittingStage::Over => None,
            _ => self.check_line(),
        };
        self.guide.choose(asked, was_held);
    }

    /// Sets the readings without a load of the sitting that goes on.
    pub fn set_rest(&mut self, rest: [f64; CHANNELS]) {
        self.rest = Some(rest);
    }

    /// Refuses readings as those without a load if they are near those of a recorded load, and far from the `rest`.
    fn check_unloaded(&mut self) {
        /// Distance from the load, as a share of its distance from the rest.
        const NEAR: f64 = 0.25;
        let (Some(rest), Some(now)) = (self.rest, self.guide.unloaded_readings()) else { return };
        let distance = |a: &[f64], b: &[f64]| {
            a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
        };
        let hangs =
            |take: &&Take| distance(&now, &take.readings) < NEAR * distance(&rest, &take.readings);
        match self.takes.iter().find(hangs) {
            Some(take) => {
                let label = &take.load.group;
                self.finding = format!(
                    "the readings are those of load `{label}`: take the weight off (if nothing hangs, the sensor has \
                     changed: begin in a new folder)"
                );
                self.guide.forget_unloaded();
                (self.still_hangs, self.is_zeroed, self.zero) = (true, false, PerAxis::default());
            }
            None if self.still_hangs => {
                self.still_hangs = false;
                self.finding.clear();
            }
            None => {}
        }
    }

    fn is_left(&self, line: usize) -> bool {
        !self.skipped[line] && self.takes.iter().all(|take| take.line != line)
    }

    /// Returns the most informative of the remaining loads. If these cannot reach the limits, `finding` tells the
    /// reason.
    fn plan(&mut self, was_held: bool) -> Option<usize> {
        let left: Vec<usize> = (0..self.candidates.len()).filter(|&at| self.is_left(at)).collect();
        let candidates: Vec<PerAxis<f64>> = left.iter().map(|&at| self.candidates[at]).collect();
        let loads: Vec<PerAxis<f64>> = self.used_takes().map(|take| take.load.wrench()).collect();
        let sensors = self.estimate.as_ref().filter(|_| loads.len() >= FEWEST);
        let sensors = sensors.map(|of| SensorKnowledge::from_calibration(&of.calibration));
        let mut planner = Planner::new(sensors, Order::Gain, &loads, &candidates);
        let next = planner.next();
        if was_held && self.finding.is_empty() && self.limits != [None; 2] {
            let last = planner.take(MOST_AHEAD).last().or(next);
            let best = last.map(|last| last.error);
            self.finding = self.hindrance(best, &loads, &candidates, next.is_none());
        }
        next.map(|next| left[next.candidate])
    }

    /// Describes what stands in the way of the limits, if anything does, with the predicted error after all
    /// loads that are left.
    fn hindrance(
        &self,
        best: Option<PredictedError>,
        loads: &[PerAxis<f64>],
        candidates: &[PerAxis<f64>],
        is_last: bool,
    ) -> String {
        let [force_n, moment_nm] = self.limits;
        let after = match best {
            Some(PredictedError::Wrench(errors)) => errors,
            Some(PredictedError::Relative(_)) => return String::new(),
            None => match &self.estimate {
                Some(estimate) => estimate.error,
                None => return String::new(),
            },
        };
        if !is_last && PredictedError::Wrench(after).is_within(force_n, moment_nm) {
            return String::new();
        }
        let is_over = |axis: &Axis| {
            let limit = if axis.is_moment() { moment_nm } else { force_n };
            limit.is_some_and(|limit| after[axis.index()] > limit)
        };
        let share = |axis: &Axis| after[axis.index()] / self.largest[axis.index()].max(1e-9);
        let worst = Axis::ALL.into_iter().filter(is_over);
        let Some(axis) = worst.max_by(|a, b| share(a).total_cmp(&share(b))) else {
            return if is_last { "no load of the rig is left".to_owned() } else { String::new() };
        };
        let (name, error, unit) = (axis.name(), significant(after[axis.index()], 2), axis.unit());
        let when = if is_last { "with all loads of the rig" } else { "even with all loads left" };
        let coupled = couplings(loads, candidates);
        let coupled = coupled.iter().find(|of| of.first == axis || of.second == axis);
        let way = match (self.wrong_load(), coupled) {
            (Some(wrong), _) => wrong,
            (None, None) => "hang loads twice, or heavier ones".to_owned(),
            (None, Some(of)) => {
                let (first, second) = (of.first.name(), of.second.name());
                format!("{first} and {second} always come together: pull at another point")
            }
        };
        format!("{when} the error in {name} is {error} {unit}; {way}")
    }

    /// Describes the load without which the errors are far smaller, if there is one.
    fn wrong_load(&self) -> Option<String> {
        let (loads, readings) = self.used_loads();
        let workers = Workers::new(self.threads);
        self.estimate.as_ref()?.wrong_load(&loads, &readings, workers).map(|of| of.to_string())
    }

    fn used_loads(&self) -> (Vec<HungLoad>, Vec<&[f64]>) {
        self.used_takes().map(|take| (take.load.clone(), &take.readings[..])).unzip()
    }

    /// Returns true if the error is within the limits with 95 % confidence.
    pub fn is_reached(&self) -> bool {
        let is_within = |estimate: &Estimate| {
            let [force_n, moment_nm] = self.limits;
            PredictedError::Wrench(estimate.upper).is_within(force_n, moment_nm)
        };
        self.limits != [None; 2]
            && self.used() >= FEWEST
            && self.estimate.as_ref().is_some_and(is_within)
    }

    /// Returns the line of the load that checks the calibration: the largest that was not recorded, or the
    /// largest of all.
    fn check_line(&self) -> Option<usize> {
        let size = |line: usize| {
            let share = |axis: usize| {
                (self.candidates[line][axis] / self.largest[axis].max(f64::MIN_POSITIVE)).abs()
            };
            (0..6).map(share).sum::<f64>()
        };
        let key = |line: &usize| (self.is_left(*line), size(*line));
        (0..self.candidates.len())
            .max_by(|a, b| key(a).0.cmp(&key(b).0).then(key(a).1.total_cmp(&key(b).1)))
            .filter(|&line| size(line) > 0.0)
    }

    fn csv<'a>(&self, takes: impl Iterator<Item = &'a Take> + Clone) -> Option<String> {
        let lines: Vec<(usize, String)> =
            takes.clone().map(|take| (take.line, take.load.group.clone())).collect();
        let is_measured = |take: &Take| take.load.pull != self.rig.loads()[take.line].pull;
        let table = match takes.clone().any(is_measured) {
            true => HungLoads::from_wrenches(
                takes.map(|take| (take.load.group.clone(), take.load.wrench())),
            )
            .ok()?,
            false => self.rig.relabelled(lines.iter().cloned()),
        };
        let all: Vec<usize> = (0..lines.len()).collect();
        let of_rig = lines.iter().map(|(line, _)| self.label(*line).to_owned()).collect();
        (!all.is_empty()).then(|| table.to_csv(&all, &[(RIG_COLUMN.to_owned(), of_rig)]))
    }

    /// Compares the unloaded reference with its first values since the newest load or, at first, before that load.
    fn watch_reference(&mut self, unloaded: UnloadedValues) {
        let loads = self.takes.len();
        if let Some((known, before)) = &self.unloaded {
            if let Some(moved) = moved_unloaded(before, &unloaded, &self.largest) {
                self.finding = format!("{moved}: set the sitting up again, `q` ends it");
                return;
            }
            if *known == loads {
                return;
            }
        }
        self.unloaded = Some((loads, unloaded));
    }

    /// Subtracts the reference's zero from a row; at the start, averages the row into that zero instead.
    fn zeroed(&mut self, row: &LiveRow) -> LiveRow {
        if !self.is_zeroed {
            if let Some(wrench) = row.wrench {
                let pairs = self.zero.iter_mut().zip(wrench);
                pairs.for_each(|(zero, value)| zero.merge(&RunningVariance::new(&[value])));
            }
            return LiveRow { wrench: None, ..*row };
        }
        let zero = &self.zero;
        let wrench =
            row.wrench.map(|wrench| std::array::from_fn(|axis| wrench[axis] - zero[axis].mean));
        LiveRow { wrench, ..*row }
    }
}

impl LoadGuide for Sitting {
    fn push(&mut self, row: &LiveRow) -> Option<FrameLabel> {
        let row = self.zeroed(row);
        let line = self.guide.next();
        self.rows.push_back(row);
        let held = self.guide.push(&row);
        let was_zeroed =
            std::mem::replace(&mut self.is_zeroed, self.guide.phase() != GuidePhase::Unloaded);
        if self.is_zeroed && !was_zeroed {
            self.check_unloaded();
        }
        if let Some(unloaded) = row.wrench.and_then(|_| self.guide.unloaded_values()) {
            self.watch_reference(unloaded);
        }
        if let Some(label) = held {
            let mut rows = HeldLoad::default();
            let is_of_load = |row: &&LiveRow| (label.from..=label.until).contains(&row.index);
            self.rows.iter().filter(is_of_load).for_each(|row| rows.push(row));
            let recorded = self.record(line, &rows);
            self.rows.clear();
            return match recorded {
                Ok(group) => Some(FrameLabel { group, ..label }),
                Err(_) => {
                    self.guide.choose(Some(line), true);
                    None
                }
            };
        }
        let first = self.guide.first_unsettled().unwrap_or(row.index);
        while self.rows.front().is_some_and(|oldest| oldest.index < first) {
            self.rows.pop_front();
        }
        None
    }

    fn first_unsettled(&self) -> Option<i64> {
        self.guide.first_unsettled()
    }

    fn skip(&mut self) {
        match self.stage {
            SittingStage::Loads => {
                self.skipped[self.guide.next()] = true;
                self.ask_next(false);
            }
            SittingStage::Check => {
                self.stage = SittingStage::Over;
                self.ask_next(false);
            }
            SittingStage::Over => {}
        }
    }

    fn back(&mut self) {
        self.undo();
    }

    fn view(&self) -> GuideView {
        let view = self.guide.view();
        let is_check = self.stage == SittingStage::Check;
        let recorded = self.used();
        let left = (0..self.candidates.len()).filter(|&line| self.is_left(line)).count();
        GuideView {
            text: if is_check { format!("check: {}", view.text) } else { view.text },
            number: recorded + 1,
            count: recorded + left,
            recorded,
            remaining_gain: None,
            errors: self.errors.clone(),
            limits: self.limits,
            finding: self.finding.clone(),
            ..view
        }
    }
}
