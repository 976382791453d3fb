//! Hung weights as the reference: loads known up to stated errors, estimated together with the sensors.
//!
//! ```text
//! yᵢⱼ = fᵢ(bᵢ + aᵢᵀxⱼ(δⱼ, o)) + e      δⱼ: mass, two angles, lever of load j      o: lever offset of its mounting
//! ```
//!
//! Eight readings determine more of a pose than the six parameters of a force at a point (only five matter), so
//! errors of a load can be separated from errors of the sensors. Levenberg-Marquardt steps find all of them at the
//! maximum of the posterior density, after the deviations of each load are eliminated (a Schur complement: Triggs et
//! al., Bundle Adjustment, 2000, §6). Their prior has the stated errors and Student's shape for each of mass,
//! direction and lever: a mistyped value does not bend the sensors (Lange, Little & Taylor, J. Am. Stat. Assoc. 84,
//! 1989). The noise is corrected for the part of the residuals that sensors and loads absorbed.
//!
//! Errors that all loads have in common are not corrected: a turn or a shift of all is another frame of reference.

mod equations;
mod load;

use self::equations::{Eliminated, LoadEquations, Row};
pub use self::load::{LoadQuantity, StatedLoad};
use self::load::{OWN, SHARED};
use super::PhysicsError;
use super::damping::Damping;
use super::fit::{Observation, Scaled, Scales, common_prior, fit};
use super::noise::{Noise, Residuals};
use super::response::{PARAMETERS, Parameters, Response, move_by};
use super::sensor::Prior;
use least_squares::symmetric::SymmetricMatrix;
use shell_data::statistics::upper_median;
use shell_data::wrench::PerAxis;

/// Degrees of freedom of Student's prior: one load in a few dozen may be far off.
const FREEDOM: f64 = 4.0;

/// Stated errors, or multiples of the table's scatter if that is larger, beyond which a quantity is suspicious.
const FAR: f64 = 5.0;

/// Standard deviation of the priors of lo, ln h and ln ν: the middle candidate of a fit.
const WIDTH: f64 = 0.5;

/// Rounds, each with weights and noise from the previous one, and steps in a round.
const ROUNDS: usize = 20;
const STEPS: usize = 3;

#[derive(Clone, Debug, Default, PartialEq)]
pub struct CorrectedLoad {
    /// N and N·m.
    pub wrench: PerAxis<f64>,
    /// Direction, of length 1; zero for a wrench.
    pub direction: [f64; 3],
    /// Found minus stated size, with its standard error, N.
    pub force_n: (f64, f64),
    /// Angle between the found and the stated direction, with its standard error, rad.
    pub angle_rad: (f64, f64),
    /// Found minus stated point, m.
    pub lever_m: [f64; 3],
    /// Quantity furthest from its stated value, if any is suspicious.
    pub suspicious: Option<LoadQuantity>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct CorrectedLoads {
    /// Corrected loads, in the order of the observations.
    pub loads: Vec<CorrectedLoad>,
    /// Lever offset of each mounting, m.
    pub mountings: Vec<[f64; 3]>,
    /// Scatter of sizes, directions and levers, in stated errors: 1 if the stated errors are right.
    pub scatter: [f64; 3],
}

/// Corrects loads by the readings at them: `observations[j]` was made under `loads[j]`. `mounting_m` is the standard
/// deviation of the lever offsets of `mountings` mountings, on each axis.
///
/// # Errors
/// [`PhysicsError`] if there are too few observations or channels.
///
/// # Panics
/// If the numbers of loads and observations differ.
pub fn correct_loads(
    observations: &[Observation],
    loads: &[StatedLoad],
    (mountings, mounting_m): (usize, f64),
) -> Result<CorrectedLoads, PhysicsError> {
    assert_eq!(observations.len(), loads.len(), "a load for each observation");
    let stated: Vec<Observation> = (observations.iter().zip(loads))
        .map(|(o, load)| Observation { wrench: load.wrench(), ..o.clone() })
        .collect();
    let stated: Vec<&Observation> = stated.iter().collect();
    let scales = Scales::new(&stated)?;
    let data = scales.apply(&stated);
    let start = fit(&data, WIDTH);
    let mut search = LoadSearch {
        loads,
        data,
        scales,
        mounting_m,
        at: Unknowns {
            parameters: start.parameters,
            own: vec![[0.0; OWN]; loads.len()],
            offsets: vec![[0.0; SHARED]; mountings],
        },
        noise: start.noise,
        damping: Damping::default(),
    };
    let at = search.rounds();
    Ok(search.outcome(&at))
}

#[derive(Clone, Debug)]
struct Unknowns {
    parameters: Vec<Parameters>,
    own: Vec<[f64; OWN]>,
    /// Lever offsets of the mountings, in `mounting_m`.
    offsets: Vec<[f64; SHARED]>,
}

struct LoadSearch<'a> {
    loads: &'a [StatedLoad],
    data: Scaled,
    scales: Scales,
    mounting_m: f64,
    at: Unknowns,
    noise: Noise,
    damping: Damping,
}

struct FixedWeights {
    /// Weights of the readings, by load and sensor.
    readings: Vec<Vec<f64>>,
    /// Weights of the deviations of each load.
    own: Vec<[f64; OWN]>,
    prior: Prior,
}

impl LoadSearch<'_> {
    fn rounds(&mut self) -> LoadEquations {
        let mut weights = self.weights();
        let mut at = self.equations(&self.at, &weights);
        for _ in 0..ROUNDS {
            for _ in 0..STEPS {
                self.step(&mut at, &weights);
            }
            self.noise = self.noise.refine(&self.residuals(&at), 5);
            weights = self.weights();
            at = self.equations(&self.at, &weights);
        }
        at
    }

    fn step(&mut self, at: &mut LoadEquations, weights: &FixedWeights) {
        let next = at.reduced(self.damping.scale()).and_then(|(reduced, descent, eliminated)| {
            let step = reduced.cholesky()?.solve(descent);
            let next = self.moved(&step, at, &eliminated);
            Some((self.equations(&next, weights), next))
        });
        if let Some(next) = self.damping.accept(next, |(next, _)| next.cost < at.cost) {
            (*at, self.at) = next;
        }
    }

    fn moved(&self, step: &[f64], at: &LoadEquations, eliminated: &[Eliminated]) -> Unknowns {
        let mut next = self.at.clone();
        move_by(&mut next.parameters, step);
        let first = PARAMETERS * next.parameters.len();
        for (position, offset) in next.offsets.iter_mut().flatten().enumerate() {
            *offset += step[first + position];
        }
        for ((own, of), eliminated) in next.own.iter_mut().zip(&at.loads).zip(eliminated) {
            let (own_step, follows) =
                (eliminated.factor.solve(&of.descent), eliminated.follow(step));
            (0..OWN).for_each(|k| own[k] += own_step[k] - follows[k]);
        }
        next
    }

    fn offset(&self, at: &Unknowns, load: &StatedLoad) -> [f64; SHARED] {
        let units = load.mounting().map_or([0.0; SHARED], |mounting| at.offsets[mounting]);
        units.map(|x| x * self.mounting_m)
    }

    /// Wrench of a load in the model's scales, and derivatives by the load's deviations and mounting's offset.
    fn wrench(&self, at: &Unknowns, row: usize) -> (PerAxis<f64>, [PerAxis<f64>; OWN + SHARED]) {
        // Central differences of a smooth function with numbers of order 1 have a relative error of 1e-8.
        const STEP: f64 = 1e-4;
        let load = &self.loads[row];
        let offset = self.offset(at, load);
        let scaled = |own: &[f64; OWN], offset: &[f64; SHARED]| -> PerAxis<f64> {
            let (wrench, _) = load.deviated(own, offset);
            std::array::from_fn(|axis| wrench[axis] / self.scales.wrench[axis])
        };
        let slope = |position: usize| {
            let side = |step: f64| {
                let (mut own, mut offset) = (at.own[row], offset);
                match position.checked_sub(OWN) {
                    None => own[position] += step,
                    Some(shared) => offset[shared] += step * self.mounting_m,
                }
                scaled(&own, &offset)
            };
            let (up, down) = (side(STEP), side(-STEP));
            std::array::from_fn(|axis| (up[axis] - down[axis]) / (2.0 * STEP))
        };
        (scaled(&at.own[row], &offset), std::array::from_fn(slope))
    }

    fn rows(&self, at: &Unknowns, row: usize) -> Vec<Row> {
        let (x, by) = self.wrench(at, row);
        let first = |mounting| PARAMETERS * at.parameters.len() + SHARED * mounting;
        let offset = self.loads[row].mounting().map(first);
        let of = |(i, (p, readings)): (usize, (&Parameters, &Vec<f64>))| {
            let response = Response::at(p, &x);
            let along = |by: &PerAxis<f64>| (0..6).map(|axis| p[1 + axis] * by[axis]).sum::<f64>();
            let by_load: [f64; OWN + SHARED] = by.each_ref().map(|by| response.slope * along(by));
            let shared = offset.into_iter().flat_map(|first| first..).zip(by_load[OWN..].to_vec());
            Row {
                residual: readings[row] - response.value,
                slope: response.slope,
                by_load: std::array::from_fn(|k| by_load[k]),
                border: (PARAMETERS * i..).zip(response.gradient(&x)).chain(shared).collect(),
            }
        };
        at.parameters.iter().zip(&self.data.readings).enumerate().map(of).collect()
    }

    fn weights(&self) -> FixedWeights {
        let of_load = |row| {
            let rows = self.rows(&self.at, row);
            rows.iter().map(|of| self.noise.variance(of.slope).recip()).collect()
        };
        let of_own = |own: &[f64; OWN]| {
            let mut weights = [0.0; OWN];
            for quantity in LoadQuantity::ALL {
                let positions = quantity.positions();
                let square = quantity.length(own).powi(2);
                weights[positions.clone()]
                    .fill((FREEDOM + positions.len() as f64) / (FREEDOM + square));
            }
            weights
        };
        FixedWeights {
            readings: (0..self.loads.len()).map(of_load).collect(),
            own: self.at.own.iter().map(of_own).collect(),
            prior: common_prior(self.at.parameters.iter(), WIDTH),
        }
    }

    fn equations(&self, at: &Unknowns, weights: &FixedWeights) -> LoadEquations {
        let first_offset = PARAMETERS * at.parameters.len();
        let size = first_offset + SHARED * at.offsets.len();
        let mut all = LoadEquations {
            cost: 0.0,
            border: SymmetricMatrix::zeros(size),
            descent: vec![0.0; size],
            loads: Vec::with_capacity(self.loads.len()),
        };
        for (i, p) in at.parameters.iter().enumerate() {
            for (k, value) in p.iter().enumerate() {
                let position = PARAMETERS * i + k;
                all.pull(position, weights.prior.sd[k].powi(-2), weights.prior.mean[k] - value);
            }
        }
        for (position, offset) in at.offsets.iter().flatten().enumerate() {
            all.pull(first_offset + position, 1.0, -offset);
        }
        for (row, own) in at.own.iter().enumerate() {
            let weights = (&weights.readings[row][..], &weights.own[row]);
            all.add_load(self.rows(at, row), weights, own);
        }
        all
    }

    /// Residuals, corrected for the part that sensors and loads absorbed.
    fn residuals(&self, at: &LoadEquations) -> Vec<Residuals> {
        let mut all = vec![Residuals::default(); self.at.parameters.len()];
        let Some((border, eliminated)) = at.factor() else { return all };
        for (of, eliminated) in at.loads.iter().zip(&eliminated) {
            for (row, all) in of.rows.iter().zip(&mut all) {
                let mut u = vec![0.0; at.border.size];
                for (t, following) in row.by_load.iter().zip(&eliminated.following) {
                    u.iter_mut().zip(following).for_each(|(u, x)| *u -= t * x);
                }
                row.border.iter().for_each(|&(position, by)| u[position] += by);
                let own: f64 = eliminated.factor.forward(&row.by_load).iter().map(|x| x * x).sum();
                let unsure = own + border.square(u);
                let square = row.residual.mul_add(row.residual, unsure);
                all.squares.push(square);
                all.slope_squares.push(row.slope * row.slope);
            }
        }
        all
    }

    fn outcome(&self, at: &LoadEquations) -> CorrectedLoads {
        let is_force =
            |load: &StatedLoad| matches!(load, StatedLoad::Force { force_n, .. } if *force_n > 0.0);
        let scatter = LoadQuantity::ALL.map(|quantity| {
            let forces = self.at.own.iter().zip(self.loads).filter(|(_, load)| is_force(load));
            let mut sizes: Vec<f64> = forces.map(|(own, _)| quantity.length(own)).collect();
            upper_median(&mut sizes).map_or(0.0, |middle| middle / quantity.median())
        });
        let suspicious = |own: &[f64; OWN]| {
            let distance =
                |quantity: LoadQuantity| quantity.length(own) / scatter[quantity as usize].max(1.0);
            let far = LoadQuantity::ALL.into_iter().filter(|quantity| distance(*quantity) > FAR);
            far.max_by(|a, b| distance(*a).total_cmp(&distance(*b)))
        };
        let factor = at.factor();
        let loads = self.loads.iter().zip(&self.at.own).enumerate().map(|(row, (load, own))| {
            let offset = self.offset(&self.at, load);
            let (wrench, direction) = load.deviated(own, &offset);
            let StatedLoad::Force { errors, .. } = *load else {
                return CorrectedLoad { wrench, direction, ..CorrectedLoad::default() };
            };
            let unsure = factor.as_ref().map_or([f64::NAN; OWN], |(border, eliminated)| {
                eliminated[row].standard_errors(border)
            });
            let angle = LoadQuantity::Direction.length(own) * errors.angle_rad;
            let angle_error = (0.5 * (unsure[1].powi(2) + unsure[2].powi(2))).sqrt();
            CorrectedLoad {
                wrench,
                direction,
                force_n: (own[0] * errors.force_n, unsure[0] * errors.force_n),
                angle_rad: (angle, angle_error * errors.angle_rad),
                lever_m: std::array::from_fn(|i| own[3 + i].mul_add(errors.lever_m, offset[i])),
                suspicious: suspicious(own),
            }
        });
        CorrectedLoads {
            loads: loads.collect(),
            mountings: self.at.offsets.iter().map(|o| o.map(|x| x * self.mounting_m)).collect(),
            scatter,
        }
    }
}

#[cfg(test)]
mod tests {
    use shell_data::wrench::LoadErrors;
    use system_tests::random::Random;

    use super::*;

    const EXACT: LoadErrors = LoadErrors { force_n: 0.0, angle_rad: 0.0, lever_m: 0.0 };
    const USUAL: LoadErrors = LoadErrors { force_n: 0.005, angle_rad: 0.0175, lever_m: 1e-3 };

    /// Forces of 1 to 5 N at points up to 40 mm away, alternately on two mountings.
    fn loads(count: usize, errors: LoadErrors) -> Vec<StatedLoad> {
        let mut random = Random(11);
        let load = |at| {
            let d: [f64; 3] = std::array::from_fn(|_| random.normal());
            let length = d.iter().map(|x| x * x).sum::<f64>().sqrt();
            StatedLoad::Force {
                force_n: [1.0, 2.0, 5.0][random.below(3) as usize],
                direction: d.map(|x| x / length),
                point_m: std::array::from_fn(|_| 0.08 * random.unit() - 0.04),
                errors,
                mounting: Some(at % 2),
            }
        };
        (0..count).map(load).collect()
    }

    /// Observations by eight sensors under these loads, with noise of 2 counts on 1000.
    fn observe(loads: &[StatedLoad]) -> Vec<Observation> {
        let mut random = Random(5);
        let gains: Vec<PerAxis<f64>> =
            (0..8).map(|_| std::array::from_fn(|_| 2.4 * random.unit() - 1.2)).collect();
        let scale = [2.0, 2.0, 2.0, 0.05, 0.05, 0.05];
        let observation = |(group, load): (u64, &StatedLoad)| {
            let wrench = load.wrench();
            let x: PerAxis<f64> = std::array::from_fn(|axis| wrench[axis] / scale[axis]);
            let reading = |(sensor, [a, b, c, d, e, f]): (usize, &PerAxis<f64>)| {
                let p = [0.1 * sensor as f64 - 0.4, *a, *b, *c, *d, *e, *f, 0.0, 0.0, 0.1];
                1000.0 * Response::at(&p, &x).value + 2.0 * random.normal()
            };
            Observation { group, wrench, readings: gains.iter().enumerate().map(reading).collect() }
        };
        (0..).zip(loads).map(observation).collect()
    }

    #[test]
    fn loads_without_errors_stay_as_they_are_stated() {
        let loads: Vec<StatedLoad> = loads(30, EXACT).iter().map(StatedLoad::unmounted).collect();
        let found = correct_loads(&observe(&loads), &loads, (0, 0.0)).unwrap();
        for (found, load) in found.loads.iter().zip(&loads) {
            assert_eq!((found.wrench, found.suspicious), (load.wrench(), None));
        }
    }

    #[test]
    fn the_offset_between_two_mountings_is_found() {
        let stated = loads(48, USUAL);
        let moved: Vec<StatedLoad> = stated
            .iter()
            .map(|load| {
                let StatedLoad::Force { mut point_m, mounting, force_n, direction, errors } = *load
                else {
                    panic!("forces")
                };
                point_m[0] += if mounting == Some(1) { 4e-3 } else { 0.0 };
                StatedLoad::Force { point_m, mounting, force_n, direction, errors }
            })
            .collect();
        let found = correct_loads(&observe(&moved), &stated, (2, 3e-3)).unwrap();
        let [first, second] = found.mountings[..] else { panic!("two mountings") };
        let between: [f64; 3] = std::array::from_fn(|i| second[i] - first[i]);
        // Errors of 1 mm in each lever, over 24 loads a side, give 0.3 mm; the prior of the offsets is 3 mm.
        for (found, expected) in between.iter().zip([4e-3, 0.0, 0.0]) {
            assert!((found - expected).abs() < 1e-3, "{between:?}");
        }
    }

    #[test]
    fn the_line_of_a_mistyped_mass_is_named() {
        let hung = loads(40, USUAL);
        let mut stated: Vec<StatedLoad> = hung.iter().map(StatedLoad::unmounted).collect();
        let StatedLoad::Force { force_n, .. } = &mut stated[17] else { panic!("forces") };
        *force_n *= 2.0;
        let found = correct_loads(&observe(&hung), &stated, (0, 0.0)).unwrap();
        let named: Vec<usize> =
            (0..40).filter(|&at| found.loads[at].suspicious.is_some()).collect();
        assert_eq!(named, [17]);
    }

    impl StatedLoad {
        fn unmounted(&self) -> Self {
            match *self {
                Self::Force { force_n, direction, point_m, errors, .. } => {
                    Self::Force { force_n, direction, point_m, errors, mounting: None }
                }
                wrench @ Self::Wrench(_) => wrench,
            }
        }
    }
}
