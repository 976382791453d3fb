//! Search for the change of greatest posterior density, with the priors that make the observations
//! most probable. Differences are nearly linear in the change, so each trial of a prior or a
//! held-out group solves only some twenty equations, set up at the last change found.

use std::collections::BTreeMap;

use faer::prelude::Solve;
use faer::{Col, Mat, Scale, Side};

use super::change::{Change, ChannelChange};
use super::{
    ChangedQuantity, FIRST_SHARE, GAIN, IMPOSSIBLE, LEVER_M, NewLoads, SHARES, SWEEPS, TURN_RAD,
    ZERO, errors,
};
use crate::conversion::{Calibration, Kind};
use sensor_physics::response::Response;
use sensor_physics::{Observation, PhysicsModel, Sensor};
use shell_data::wrench::PerAxis;

/// Number of linearisations: the third moves the result by a thousandth of a standard error.
const ROUNDS: usize = 4;

/// Step of central differences, in widest prior standard deviations and reference errors.
const STEP: f64 = 1e-3;

#[derive(Clone, Copy, Debug)]
struct Unknown {
    quantity: ChangedQuantity,
    position: usize,
    sd: f64,
}

/// Width of the prior of each quantity, as a share of the widest; 0 for no change.
pub(super) type Shares = [f64; ChangedQuantity::ALL.len()];

/// Sums over the differences `c + J·x` of observations in stated errors; `x` in standard deviations
/// of the widest priors.
#[derive(Clone, Debug)]
struct ChangeEquations {
    /// `JᵀJ`.
    information: Mat<f64>,
    /// `−Jᵀc`.
    descent: Col<f64>,
    /// `cᵀc`.
    square: f64,
}

struct Posterior {
    mean: Vec<f64>,
    errors: Vec<f64>,
    /// Least sum of squares, of differences and unknowns.
    cost: f64,
    ln_evidence: f64,
}

#[derive(Clone, Debug)]
pub(super) struct FoundChange {
    pub(super) shares: Shares,
    pub(super) change: Change,
    pub(super) standard_errors: Change,
    pub(super) held_out: BTreeMap<u64, Change>,
    /// Log evidence.
    pub(super) ln_evidence: f64,
    /// RMS of differences before and after the change, in stated errors; the second includes the priors.
    pub(super) disagreement: [f64; 2],
    /// Quantity that would have changed more than in any sensor.
    pub(super) impossible: Option<ChangedQuantity>,
}

pub(super) struct ChangeSearch<'a> {
    calibration: &'a Calibration,
    loads: &'a NewLoads<'a>,
    /// Reading that a gain does not change, and width of the calibrated range, counts.
    channels: Vec<(f64, f64)>,
    unknowns: Vec<Unknown>,
    factors: Vec<Mat<f64>>,
}

impl ChangeEquations {
    fn nothing(unknowns: usize) -> Self {
        Self {
            information: Mat::zeros(unknowns, unknowns),
            descent: Col::zeros(unknowns),
            square: 0.0,
        }
    }

    fn add(&mut self, other: &Self, sign: f64) {
        self.information += &other.information * Scale(sign);
        self.descent += &other.descent * Scale(sign);
        self.square += sign * other.square;
    }

    fn posterior(&self, sds: &[f64]) -> Option<Posterior> {
        let size = sds.len();
        // x = S·z with z of variance one.
        let curvature = Mat::from_fn(size, size, |i, j| {
            sds[i].mul_add(sds[j] * self.information[(i, j)], f64::from(u8::from(i == j)))
        });
        let factor = curvature.llt(Side::Lower).ok()?;
        let descent = Col::from_fn(size, |i| sds[i] * self.descent[i]);
        let z = factor.solve(&descent);
        let inverse = factor.solve(Mat::<f64>::identity(size, size));
        let cost = self.square - (0..size).map(|i| descent[i] * z[i]).sum::<f64>();
        let ln_determinant = (0..size).map(|i| 2.0 * factor.L()[(i, i)].ln()).sum::<f64>();
        Some(Posterior {
            mean: (0..size).map(|i| sds[i] * z[i]).collect(),
            errors: (0..size).map(|i| sds[i] * inverse[(i, i)].sqrt()).collect(),
            cost,
            ln_evidence: -0.5 * (cost + ln_determinant),
        })
    }
}

impl<'a> ChangeSearch<'a> {
    pub(super) fn new(
        calibration: &'a Calibration,
        loads: &'a NewLoads<'a>,
        variance_scale: f64,
    ) -> Self {
        let channels = channels(calibration);
        let mut search = Self {
            unknowns: unknowns(calibration, &channels),
            calibration,
            loads,
            channels,
            factors: Vec::new(),
        };
        let factor = |at| search.factor_of_errors(at, variance_scale);
        search.factors = (0..loads.observations.len()).map(factor).collect();
        search
    }

    /// Finds the change with the most probable priors; no change unless `is_changed`.
    pub(super) fn find(&self, is_changed: bool) -> FoundChange {
        let mut at = vec![0.0; self.unknowns.len()];
        let mut shares = Shares::default();
        let (mut groups, mut all) = self.equations(&at);
        let (unchanged, mut found) = (all.square, None);
        for round in 0..if is_changed { ROUNDS } else { 0 } {
            if round > 0 {
                (groups, all) = self.equations(&at);
            }
            shares = self.most_probable(&all);
            found = all.posterior(&self.sds(&shares));
            let Some(of) = &found else { break };
            at.clone_from(&of.mean);
        }
        let sds = self.sds(&shares);
        let without = |group: &ChangeEquations| {
            let mut rest = all.clone();
            rest.add(group, -1.0);
            rest.posterior(&sds).map_or_else(|| at.clone(), |of| of.mean)
        };
        let held_out = |(&of, group)| (of, self.change(&without(group)));
        let rows: usize = self.factors.iter().map(Mat::nrows).sum();
        let rms = |cost: f64| (cost / rows as f64).sqrt();
        let cost = found.as_ref().map_or(unchanged, |of| of.cost);
        let errors = found.as_ref().map_or(&[][..], |of| &of.errors[..]);
        let mut unknowns = self.unknowns.iter().zip(&at);
        let impossible = unknowns.find(|(_, x)| x.is_nan() || x.abs() > IMPOSSIBLE);
        FoundChange {
            impossible: impossible.map(|(of, _)| of.quantity),
            shares,
            held_out: groups.iter().map(held_out).collect(),
            change: self.change(&at),
            standard_errors: self.change(errors),
            ln_evidence: found.as_ref().map_or(0.0, |of| of.ln_evidence + 0.5 * unchanged),
            disagreement: [rms(unchanged), rms(cost)],
        }
    }

    /// Group of the observation furthest from the unchanged calibration, in stated errors.
    pub(super) fn furthest(&self) -> u64 {
        let rows = self.whitened(&vec![0.0; self.unknowns.len()]);
        let square = |row: &Vec<f64>| row.iter().map(|x| x * x).sum::<f64>();
        let pairs = rows.iter().map(square).zip(self.loads.observations);
        let furthest = pairs.max_by(|(a, _), (b, _)| a.total_cmp(b));
        furthest.map_or(0, |(_, observation)| observation.group)
    }

    fn most_probable(&self, all: &ChangeEquations) -> Shares {
        let evidence = |shares: &Shares| {
            all.posterior(&self.sds(shares)).map_or(f64::NEG_INFINITY, |of| of.ln_evidence)
        };
        // Without unknowns, no share would change the evidence.
        let is_unknown = |quantity| self.unknowns.iter().any(|of| of.quantity == quantity);
        let mut shares =
            ChangedQuantity::ALL.map(|of| if is_unknown(of) { FIRST_SHARE } else { 0.0 });
        let mut best = evidence(&shares);
        for _ in 0..SWEEPS {
            let before = shares;
            for quantity in ChangedQuantity::ALL {
                for share in SHARES {
                    let mut others = shares;
                    others[quantity as usize] = share;
                    let found = evidence(&others);
                    if found > best {
                        (shares, best) = (others, found);
                    }
                }
            }
            if shares == before {
                break;
            }
        }
        shares
    }

    fn sds(&self, shares: &Shares) -> Vec<f64> {
        self.unknowns.iter().map(|of| shares[of.quantity as usize]).collect()
    }

    /// Equations of the differences of each group, linearised at `at`, and the sum of all.
    fn equations(&self, at: &[f64]) -> (BTreeMap<u64, ChangeEquations>, ChangeEquations) {
        let here = self.whitened(at);
        let columns: Vec<Vec<Vec<f64>>> = (0..at.len())
            .map(|position| {
                let side = |step: f64| {
                    let mut there = at.to_vec();
                    there[position] += step;
                    self.whitened(&there)
                };
                let (mut up, down) = (side(STEP), side(-STEP));
                for (up, down) in up.iter_mut().flatten().zip(down.iter().flatten()) {
                    *up = (*up - down) / (2.0 * STEP);
                }
                up
            })
            .collect();
        let mut groups = BTreeMap::new();
        let mut all = ChangeEquations::nothing(at.len());
        for (row, o) in self.loads.observations.iter().enumerate() {
            let size = here[row].len();
            let jacobian = Mat::from_fn(size, at.len(), |i, j| columns[j][row][i]);
            let constant = Col::from_fn(size, |i| {
                here[row][i] - (0..at.len()).map(|j| jacobian[(i, j)] * at[j]).sum::<f64>()
            });
            let of_row = ChangeEquations {
                information: jacobian.transpose() * &jacobian,
                descent: jacobian.transpose() * &constant * Scale(-1.0),
                square: constant.squared_norm_l2(),
            };
            all.add(&of_row, 1.0);
            let group = groups.entry(o.group).or_insert_with(|| ChangeEquations::nothing(at.len()));
            group.add(&of_row, 1.0);
        }
        (groups, all)
    }

    /// Converts unknowns, in standard deviations of their widest priors, to a change.
    fn change(&self, at: &[f64]) -> Change {
        let still = |&(pivot, _): &(f64, f64)| ChannelChange { pivot, ..ChannelChange::default() };
        let mut change = Change {
            channels: self.channels.iter().map(still).collect(),
            lever_m: [0.0; 3],
            turn_rad: [0.0; 3],
        };
        for (&Unknown { quantity, position, sd }, x) in self.unknowns.iter().zip(at) {
            *match quantity {
                ChangedQuantity::Zero => &mut change.channels[position].zero,
                ChangedQuantity::Gain => &mut change.channels[position].gain,
                ChangedQuantity::Lever => &mut change.lever_m[position],
                ChangedQuantity::Turn => &mut change.turn_rad[position],
            } = x * sd;
        }
        change
    }

    fn whitened(&self, at: &[f64]) -> Vec<Vec<f64>> {
        let all: Vec<&Observation> = self.loads.observations.iter().collect();
        let mut all = self.differences(&self.change(at), &all);
        for (differences, factor) in all.iter_mut().zip(&self.factors) {
            forward(factor, differences);
        }
        all
    }

    /// Observed minus predicted: the axes of the wrench, or the readings as shares of the calibrated range.
    fn differences(&self, change: &Change, some: &[&Observation]) -> Vec<Vec<f64>> {
        match &self.calibration.kind {
            Kind::Polynomial(polynomial) => {
                let changed = Kind::Polynomial(change.polynomial(polynomial));
                let axes = self.calibration.axes;
                let of_row =
                    |of: PerAxis<f64>| axes.iter().map(|axis| 0.0 - of[axis.index()]).collect();
                errors(&Calibration::from_kind(changed), some).into_iter().map(of_row).collect()
            }
            Kind::Physics(physics) => {
                let (model, changed) = (physics.model(), change.model(physics.model()));
                let of_load = |o: &&Observation| {
                    let x = scaled(model, &o.wrench);
                    let pairs = changed.sensors.iter().zip(&model.sensors);
                    let difference = |(of, before): (&Sensor, &Sensor)| {
                        let predicted = Response::at(&of.parameters, &x).value;
                        let reading = o.readings[of.channel];
                        (reading - predicted.mul_add(of.range, of.least)) / before.range
                    };
                    pairs.map(difference).collect()
                };
                some.iter().map(of_load).collect()
            }
        }
    }

    fn factor_of_errors(&self, at: usize, variance_scale: f64) -> Mat<f64> {
        let observation = &self.loads.observations[at];
        let mut covariance = match &self.calibration.kind {
            Kind::Polynomial(_) => {
                let axes: Vec<usize> =
                    self.calibration.axes.iter().map(|axis| axis.index()).collect();
                let error = |i: usize| self.loads.calibration_errors[axes[i]].powi(2);
                Mat::from_fn(axes.len(), axes.len(), |i, j| if i == j { error(i) } else { 0.0 })
            }
            Kind::Physics(physics) => {
                covariance_of_readings(physics.model(), &observation.wrench) * Scale(variance_scale)
            }
        };
        let unchanged = self.change(&[]);
        for (axis, &error) in self.loads.reference_errors[at].iter().enumerate() {
            if error <= 0.0 {
                continue;
            }
            let side = |step: f64| {
                let mut moved = observation.clone();
                moved.wrench[axis] += step * error;
                self.differences(&unchanged, &[&moved]).concat()
            };
            let (up, down) = (side(STEP), side(-STEP));
            let by = |i: usize| (up[i] - down[i]) / (2.0 * STEP);
            for i in 0..up.len() {
                (0..up.len()).for_each(|j| covariance[(i, j)] += by(i) * by(j));
            }
        }
        let factor = covariance.llt(Side::Lower).expect("a diagonal above zero, and squares");
        factor.L().to_owned()
    }
}

fn unknowns(calibration: &Calibration, channels: &[(f64, f64)]) -> Vec<Unknown> {
    // A polynomial without a constant cannot represent a change of the zeros.
    let has_constant = calibration.polynomial().is_none_or(|of| of.model().intercept);
    let of = |quantity: ChangedQuantity| {
        let sds: Vec<f64> = match quantity {
            ChangedQuantity::Zero if has_constant => {
                channels.iter().map(|(_, range)| ZERO * range).collect()
            }
            ChangedQuantity::Gain => vec![GAIN; channels.len()],
            ChangedQuantity::Lever if calibration.axes.are_all() => vec![LEVER_M; 3],
            ChangedQuantity::Turn if calibration.axes.are_all() => vec![TURN_RAD; 3],
            _ => Vec::new(),
        };
        sds.into_iter().enumerate().map(move |(position, sd)| Unknown { quantity, position, sd })
    };
    ChangedQuantity::ALL.into_iter().flat_map(of).collect()
}

fn scaled(model: &PhysicsModel, wrench: &PerAxis<f64>) -> PerAxis<f64> {
    std::array::from_fn(|axis| wrench[axis] / model.wrench_scale[axis])
}

/// Covariance `V` of the readings, in squared ranges: noise, uncertain parameters, shared factors.
fn covariance_of_readings(model: &PhysicsModel, wrench: &PerAxis<f64>) -> Mat<f64> {
    let x = scaled(model, wrench);
    let of = |sensor: &Sensor| {
        let (response, own) = sensor.response(&x, &model.noise);
        (own, sensor.loadings.map(|c| c * response.slope))
    };
    let sensors: Vec<_> = model.sensors.iter().map(of).collect();
    Mat::from_fn(sensors.len(), sensors.len(), |i, j| {
        let shared: f64 = sensors[i].1.iter().zip(&sensors[j].1).map(|(a, b)| a * b).sum();
        if i == j { sensors[i].0 + shared } else { shared }
    })
}

/// For each channel, the reading that no gain changes (0 if the range comes near it, else its middle), and the range.
fn channels(calibration: &Calibration) -> Vec<(f64, f64)> {
    let has_constant = calibration.polynomial().is_none_or(|it| it.model().intercept);
    let of_range = |[min, max]: [f64; 2]| {
        let width = max - min;
        let is_near_zero = min - width <= 0.0 && 0.0 <= max + width;
        (if is_near_zero || !has_constant { 0.0 } else { 0.5 * (min + max) }, width)
    };
    match (&calibration.valid_range, calibration.polynomial()) {
        (Some(ranges), _) => ranges.iter().map(|range| of_range([range.min, range.max])).collect(),
        (None, Some(polynomial)) => {
            let scaling = polynomial.scaling();
            let channels = scaling.centre.iter().zip(&scaling.scale).take(calibration.channels());
            channels.map(|(centre, scale)| of_range([centre - scale, centre + scale])).collect()
        }
        (None, None) => vec![(0.0, 0.0); calibration.channels()],
    }
}

/// `L⁻¹·b`, in place.
fn forward(l: &Mat<f64>, b: &mut [f64]) {
    for i in 0..b.len() {
        let known: f64 = (0..i).map(|k| l[(i, k)] * b[k]).sum();
        b[i] = (b[i] - known) / l[(i, i)];
    }
}
