//! Whether the 95 % intervals of drag energy hold the truth in 95 % of trials, with calibrations that
//! are fitted, each to a recording of its own.

use calibration::solver::Workers;
use calibration::uncertainty::Covariance;
use calibration::validation::grouped::{Apart, GroupSums, RandomSplit};
use calibration::{Basis, Calibration, Model};
use forces::{FirstRows, PipelineSetup};
use shell_data::block::Block;
use simulation::sensor_model::{RecordingKind, RecordingSettings, SensorRecording};
use simulation::virtual_robot::{ChannelForces, TrialSettings, VirtualTrial};
use trial::{Instrument, LogTimes, Profile, Trial, TrialInput, TrialOptions, TrialRows, evaluate};

/// A cubic calibration of unit `seed` on a recording of `rows` rows, and the share of the loads'
/// variance that it leaves unexplained.
fn calibrate(seed: u64, rows: usize, elastic: bool) -> (Calibration, [f64; 6]) {
    let recording = SensorRecording::new(RecordingSettings {
        kind: RecordingKind::Training,
        rate_hz: 100.0,
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

/// Error of the drag energy of a trial, and half the width of its interval, J.
fn error(
    (calibration, unexplained): &(Calibration, [f64; 6]),
    settings: TrialSettings,
) -> (f64, f64) {
    let trial = VirtualTrial::new(settings).unwrap();
    let mut rows = TrialRows { readings: vec![Vec::new(); 8], ..TrialRows::default() };
    for (time_s, frame) in trial.frames() {
        rows.times_s.push(time_s);
        rows.fresh.push(true);
        for (column, reading) in rows.readings.iter_mut().zip(frame.readings) {
            column.push(f64::from(reading));
        }
    }
    let times = &rows.times_s;
    let log_times = LogTimes { first_s: times[0], last_s: times[times.len() - 1], period_s: 0.01 };
    let options = TrialOptions { unexplained: Some(*unexplained), ..TrialOptions::default() };
    let mut setup = PipelineSetup::keeping_frames(options.forces);
    let (readings, fresh) = (&*rows.readings, &*rows.fresh);
    setup.look_at(calibration, FirstRows { times_s: times, readings, fresh, leg: None });
    let pipeline = setup.finish(calibration).unwrap();
    let profile = Profile::velociroach();
    let result = evaluate(&TrialInput {
        trial: &Trial::from_window(String::new(), trial.window_s.into()),
        instrument: Instrument { profile: &profile, calibration: Some(calibration) },
        times: &log_times,
        rows: &rows,
        pipeline: Some(&pipeline),
        options: &options,
    });
    let row = result.unwrap().row;
    let interval = row.drag_energy_95_j.unwrap();
    let error = row.measures.drag_energy_j.unwrap() - trial.truth().drag_energy_j;
    (error, 0.5 * (interval.high - interval.low))
}

/// Calibrations, and trials of each condition with each: a thousand trials.
const CALIBRATIONS: u64 = 40;
const RUNS: u64 = 5;

#[test]
fn ninety_five_percent_intervals_of_drag_energy_hold_the_truth() {
    // Springs that a calibration can follow, and springs with creep and play, under which the small
    // loads of trials come out some ten percent too small.
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
        // What is asked for; the Monte-Carlo error of 1000 trials is 0.7 %.
        assert!((share - 0.95).abs() < 0.02, "{share}");
        // No condition pays for another: 1.5 % of Monte-Carlo error, three times.
        for held in held {
            let share = held as f64 / each as f64;
            assert!((0.90..0.995).contains(&share), "{share}");
        }
    }
}
