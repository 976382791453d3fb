//! Coverage of the 95 % intervals of drag energy over trials, with a separate calibration for each.

use calibration::fit::ModelRule;
use calibration::solver::Workers;
use calibration::uncertainty::Covariance;
use calibration::validation::grouped::{Apart, GroupSums, RandomSplit};
use calibration::{Basis, Calibration, FitOptions, Model};
use calibration_file::Origin;
use forces::{FirstRows, PipelineSetup};
use shell_data::block::Block;
use shell_data::dataset::Dataset;
use shell_data::wrench::Axes;
use shellcal::workflow::fit::calibration_file;
use simulation::sensor_model::{RecordingKind, RecordingSettings, SensorRecording};
use simulation::virtual_robot::{ChannelForces, TrialSettings, Truth, VirtualTrial};
use trial::{
    Instrument, LogTimes, Profile, Quantity, Trial, TrialInput, TrialOptions, TrialRow, TrialRows,
    ValueSample, evaluate,
};

/// A training recording of unit `seed`.
fn training(seed: u64, (rows, rate_hz): (usize, f64), elastic: bool) -> Block {
    let recording = SensorRecording::new(RecordingSettings {
        kind: RecordingKind::Training,
        rate_hz,
        start_time_s: 0.0,
        seed: 7 * seed + 3,
        unit_seed: seed,
        noise_scale: 1.0,
        adc_bits: 12,
        elastic,
    });
    let mut block = Block::default();
    (block.readings, block.wrench) = (vec![Vec::new(); 8], vec![Vec::new(); 6]);
    for sample in recording.unwrap().take(rows) {
        block.rows += 1;
        for (column, reading) in block.readings.iter_mut().zip(sample.frame.readings) {
            column.push(f64::from(reading));
        }
        for (column, value) in block.wrench.iter_mut().zip(sample.wrench) {
            column.push(value);
        }
        let label = sample.pose.to_string();
        match block.groups.last_mut() {
            Some((last, rows)) if *last == label => *rows += 1,
            _ => block.groups.push((label, 1)),
        }
    }
    block
}

/// The program's own choice of calibration for such a recording, with lag and memory, and its unexplained part.
fn chosen(seed: u64, _: usize, elastic: bool) -> (Calibration, [f64; 6]) {
    // As the shipped set: 125 poses.
    const RATE_HZ: f64 = 10.0;
    let mut block = training(seed, (2500, RATE_HZ), elastic);
    block.time_s = (0..block.rows).map(|row| row as f64 / RATE_HZ).collect();
    let data = Dataset::from_blocks("train", Axes::ALL, vec![block]);
    let options = FitOptions {
        model: ModelRule::Auto,
        dynamics: ModelRule::Auto.usual_dynamics(),
        ..FitOptions::default()
    };
    let fitted = calibration::fit::fit(data, Dataset::default(), &options).unwrap();
    let file = calibration_file(&fitted, Origin::default());
    let unexplained = file.unexplained().unwrap();
    (file.calibration, unexplained)
}

/// A cubic calibration, and the share of the loads' variance that it leaves unexplained.
fn calibrate(seed: u64, rows: usize, elastic: bool) -> (Calibration, [f64; 6]) {
    let block = training(seed, (rows, 100.0), elastic);
    let mut sums = GroupSums::new(Basis::Cubic, 8, Apart::Groups, RandomSplit::default());
    let mut worker = sums.worker();
    sums.add(worker.add(&block, &block.groups).unwrap()).unwrap();
    let sums = sums.finish([worker]).unwrap();
    let total = sums.total().unwrap();
    let model = Model { basis: Basis::Cubic, intercept: true, channels: 8, memory: 0 };
    let solution = total.solve(&model, 0.0).unwrap().solution;
    let mut calibration = Calibration::from_solution(&solution, &total.reading_ranges());
    let covariance = Covariance::from_groups(&sums, &model, 0.0, false, Workers::ONE).unwrap();
    let unexplained = std::array::from_fn(|axis| {
        let values = &block.wrench[axis];
        let mean = values.iter().sum::<f64>() / rows as f64;
        let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / rows as f64;
        covariance.residual[axis][axis] / variance
    });
    calibration.covariance = Some(covariance);
    (calibration, unexplained)
}

fn evaluated(
    (calibration, unexplained): &(Calibration, [f64; 6]),
    settings: TrialSettings,
) -> (TrialRow, Truth) {
    let trial = VirtualTrial::new(settings).unwrap();
    let mut rows = TrialRows { readings: vec![Vec::new(); 8], ..TrialRows::default() };
    for (time_s, frame) in trial.frames() {
        rows.times_s.push(time_s);
        rows.fresh.push(true);
        for (column, reading) in rows.readings.iter_mut().zip(frame.readings) {
            column.push(f64::from(reading));
        }
    }
    let terms = calibration.start_memory().map(|mut of| of.terms(&rows.times_s, &rows.readings));
    rows.readings.extend(terms.into_iter().flatten().flatten());
    let times = &rows.times_s;
    let log_times = LogTimes { first_s: times[0], last_s: times[times.len() - 1], period_s: 0.01 };
    let options = TrialOptions { unexplained: Some(*unexplained), ..TrialOptions::default() };
    let mut setup = PipelineSetup::keeping_frames(options.forces);
    let (readings, fresh) = (&*rows.readings, &*rows.fresh);
    setup.look_at(calibration, FirstRows { times_s: times, readings, fresh, leg: None });
    let mut pipeline = setup.finish(calibration).unwrap();
    pipeline.lag = calibration.lag;
    let profile = Profile::velociroach();
    let result = evaluate(&TrialInput {
        trial: &Trial::from_window(String::new(), trial.window_s.into()),
        instrument: Instrument { profile: &profile, calibration: Some(calibration) },
        times: &log_times,
        rows: &rows,
        pipeline: Some(&pipeline),
        options: &options,
    });
    (result.unwrap().row, trial.truth())
}

/// Error of the drag energy of a trial, and half the width of its interval, J.
fn error(calibration: &(Calibration, [f64; 6]), settings: TrialSettings) -> (f64, f64) {
    let (row, truth) = evaluated(calibration, settings);
    let interval = row.drag_energy_95_j.unwrap();
    let error = row.measures.drag_energy_j.unwrap() - truth.drag_energy_j;
    (error, 0.5 * (interval.high - interval.low))
}

type OfTruth = fn(&Truth) -> f64;

/// Forces and energies of a trial, with their true values.
const COMPARED: [(Quantity, OfTruth); 3] = [
    (Quantity::DragEnergy, |truth| truth.drag_energy_j),
    (Quantity::Drag, |truth| -truth.mean_wrench[0]),
    (Quantity::Lift, |truth| truth.mean_wrench[2]),
];

/// Five trials at 3 cm and five free ones, each with the calibration of a separate unit. The intervals of the
/// mean drag energy, drag and lift at 3 cm, and of their differences from free, contain the true means, and are
/// no wider than the errors require. `SHELLCAL_TRIAL_UNITS=100` takes a hundred units in place of twenty. Creep and
/// play make small loads read some tenth too small on every unit, but the intervals treat this error as random.
/// They may then always contain the truth, so their width is compared with the errors.
#[test]
fn intervals_of_conditions_hold_the_truth_and_are_as_wide_as_errors_ask_for() {
    const ROWS: usize = 12_000;
    let units = std::env::var("SHELLCAL_TRIAL_UNITS").map_or(20, |units| units.parse().unwrap());
    for (name, calibrate) in
        [("cubic", calibrate as fn(u64, usize, bool) -> (Calibration, [f64; 6])), ("auto", chosen)]
    {
        let (mut held, mut squares) = ([[0; 2]; 3], [[0.0; 2]; 3]);
        let mut with_memory = 0;
        for unit_seed in 1..=units {
            let calibration = calibrate(unit_seed, ROWS, false);
            with_memory += usize::from(calibration.0.memory.is_some());
            let trials = |condition: &str| -> Vec<(TrialRow, Truth)> {
                let condition = ChannelForces::named(condition).unwrap();
                let trial = |run| {
                    let settings = TrialSettings::new(condition, 1000 * unit_seed + run);
                    evaluated(&calibration, TrialSettings { unit_seed, elastic: false, ..settings })
                };
                (0..RUNS).map(trial).collect()
            };
            let [free, narrow] = ["free", "3 cm"].map(trials);
            for (at, (quantity, truth_of)) in COMPARED.into_iter().enumerate() {
                let sample = |trials: &[(TrialRow, Truth)]| {
                    let (mut sample, mut mean) = (ValueSample::default(), 0.0);
                    for (row, truth) in trials {
                        sample.add_cluster(quantity.of(&row.measures));
                        let (parts, degrees) = row.shared_error(quantity).unwrap();
                        sample.add_shared_error(&parts, degrees);
                        mean += truth_of(truth) / RUNS as f64;
                    }
                    (sample, mean)
                };
                let ((free, of_free), (narrow, of_narrow)) = (sample(&free), sample(&narrow));
                let mean = narrow.statistics(1).unwrap().mean_95.unwrap();
                let difference = narrow.difference(&free, "free", 1).unwrap().mean_95.unwrap();
                let cases = [(mean, of_narrow), (difference, of_narrow - of_free)];
                for (i, (interval, truth)) in cases.into_iter().enumerate() {
                    let half_width = 0.5 * (interval.high - interval.low);
                    let error = 0.5 * (interval.low + interval.high) - truth;
                    held[at][i] += u64::from(error.abs() <= half_width);
                    squares[at][i] += (error / half_width).powi(2) / units as f64;
                }
            }
        }
        println!("{name}: {with_memory} of {units} calibrations have memory terms");
        for ((quantity, _), (held, squares)) in COMPARED.into_iter().zip(held.iter().zip(squares)) {
            let sizes = squares.map(f64::sqrt);
            println!(
                "{name}, {}: mean and difference held in {held:?} of {units}, errors {sizes:.3?}",
                quantity.name()
            );
            // Binomial about 95 %, two standard deviations: 90 of 100.
            let least = (0.95 - 2.0 * (0.95 * 0.05 / units as f64).sqrt()) * units as f64;
            let are_held = held.iter().all(|held| *held >= least as u64);
            assert!(are_held, "{name}, {}: {held:?} of {units}", quantity.name());
            // In half widths; for normal errors the value is 1/1.96 = 0.51.
            let is_right = sizes.iter().all(|size| (0.35..0.65).contains(size));
            assert!(is_right, "{name}, {}: {sizes:?}", quantity.name());
        }
    }
}

/// A thousand trials: each condition with each calibration.
const CALIBRATIONS: u64 = 40;
const RUNS: u64 = 5;

#[test]
fn ninety_five_percent_intervals_of_drag_energy_hold_the_truth() {
    // Springs that a calibration can follow, and springs with creep and play, under which small
    // loads come out some ten percent too small.
    for elastic in [true, false] {
        let mut held = [0; 5];
        for unit_seed in 1..=CALIBRATIONS {
            let calibration = calibrate(unit_seed, 20_000, elastic);
            for (condition, held) in ChannelForces::PAPER.into_iter().zip(&mut held) {
                for run in 0..RUNS {
                    let seed = 1000 * unit_seed + run;
                    let settings = TrialSettings::new(condition, seed);
                    let settings = TrialSettings { unit_seed, elastic, ..settings };
                    let (error, half_width) = error(&calibration, settings);
                    *held += u64::from(error.abs() <= half_width);
                }
            }
        }
        let each = CALIBRATIONS * RUNS;
        let share = held.iter().sum::<u64>() as f64 / (5 * each) as f64;
        println!("elastic {elastic}: {share:.3}, by condition {held:?} of {each}");
        // The requirement; the Monte-Carlo error of 1000 trials is 0.7 %.
        assert!((share - 0.95).abs() < 0.02, "{share}");
        // No condition pays for another: 1.5 % of Monte-Carlo error, three times.
        for held in held {
            let share = held as f64 / each as f64;
            assert!((0.90..0.995).contains(&share), "{share}");
        }
    }
}
