//! Held-out errors from sums against fits without the rows; the choice of a model; the warning.

use std::fs;

use calibration::exact::{Accumulator, ExactSums, PartitionedSums};
use calibration::model::{Basis, Model};
use calibration::scaling::Scaling;
use calibration::solver::{self, FitProblem, SolverKind};
use calibration::validation::cross_validation::cross_validate;
use calibration::validation::grouped::{Apart, GroupSums, RandomSplit, SumsByGroup};
use calibration::validation::selection::{self, select};
use calibration::{Calibration, FitError};
use shell_data::block::Block;
use shell_data::wrench::PerAxis;
use system_tests::program::{ended, json, refused, succeed};
use system_tests::random::Random;

/// Rows in `groups` poses: the readings of each stay within `spread` counts of its centre. Wrenches
/// are `truth` of the readings over 1000, plus noise.
fn poses(
    seed: u64,
    groups: usize,
    rows_each: usize,
    spread: f64,
    noise: f64,
    truth: impl Fn(&[f64], usize) -> f64,
) -> Block {
    let mut random = Random(seed);
    let mut block = Block { rows: groups * rows_each, ..Block::default() };
    block.readings = vec![Vec::new(); 4];
    block.wrench = vec![Vec::new(); 6];
    for group in 0..groups {
        let centre: Vec<f64> = (0..4).map(|_| 1000.0 + 1000.0 * random.unit()).collect();
        for _ in 0..rows_each {
            let s: Vec<f64> =
                centre.iter().map(|c| (c + spread * (random.unit() - 0.5)).round()).collect();
            let z: Vec<f64> = s.iter().map(|s| s / 1000.0 - 1.5).collect();
            s.iter().zip(&mut block.readings).for_each(|(&s, column)| column.push(s));
            for (axis, column) in block.wrench.iter_mut().enumerate() {
                column.push(truth(&z, axis) + noise * random.normal());
            }
        }
        block.groups.push((format!("pose {group}"), rows_each));
    }
    block
}

fn rows_of(block: &Block, keep: impl Fn(usize) -> bool) -> Block {
    let runs = block.groups.iter().enumerate();
    let flags: Vec<bool> =
        runs.flat_map(|(group, (_, rows))| std::iter::repeat_n(keep(group), *rows)).collect();
    block.kept(&flags)
}

fn sums(block: &Block, basis: Basis, random_folds: usize) -> SumsByGroup {
    let random = RandomSplit { folds: random_folds, held_out: random_folds, seed: 1 };
    let mut all = GroupSums::new(basis, block.readings.len(), Apart::Groups, random);
    let mut worker = all.worker();
    all.add(worker.add(block, &block.groups).unwrap()).unwrap();
    all.finish([worker]).unwrap()
}

fn moments(block: &Block, basis: Basis) -> ExactSums {
    let mut sums = Accumulator::new(basis, block.readings.len());
    sums.absorb(&block.readings, &block.wrench).unwrap();
    sums.finish().unwrap()
}

/// Returns squares and sums of every axis's errors on `test`, by Householder QR on `train`.
fn brute_force(train: &Block, test: &Block, model: Model) -> PerAxis<(f64, f64)> {
    let scaling = Scaling::from_sample(&train.readings, model.intercept);
    let problem = FitProblem { model, scaling, ridge: 0.0 };
    let (solution, ranges) = solver::fit(SolverKind::Tsqr, problem, &train.into()).unwrap();
    errors(&Calibration::from_solution(&solution, &ranges), test)
}

fn errors(calibration: &Calibration, test: &Block) -> PerAxis<(f64, f64)> {
    let mut predicted = PerAxis::default();
    calibration.wrench(&test.readings, &mut predicted);
    std::array::from_fn(|axis| {
        let errors = predicted[axis].iter().zip(&test.wrench[axis]).map(|(p, m)| p - m);
        errors.fold((0.0, 0.0), |(squares, sum), e| (squares + e * e, sum + e))
    })
}

fn curved(z: &[f64], axis: usize) -> f64 {
    z[axis % 4] + 0.7 * z[(axis + 1) % 4] * z[axis % 4] - 0.3 * z[(axis + 2) % 4].powi(3)
}

#[test]
fn leaving_out_each_group_equals_refitting_without_its_rows() {
    let block = poses(3, 14, 60, 400.0, 0.01, curved);
    for (basis, intercept) in [
        (Basis::Linear, true),
        (Basis::Cubic, true),
        (Basis::Quadratic, false),
        (Basis::Poly3, true),
    ] {
        let model = Model { basis, intercept, channels: 4, memory: 0 };
        let found = cross_validate(&sums(&block, basis, 0), &model, 0.0, None).unwrap();
        assert_eq!((found.groups, found.folds, found.rows), (14, 14, 840));
        let mut expected = [(0.0, 0.0); 6];
        for group in 0..14 {
            let train = rows_of(&block, |g| g != group);
            let test = rows_of(&block, |g| g == group);
            for (all, errors) in expected.iter_mut().zip(brute_force(&train, &test, model)) {
                *all = (all.0 + errors.0, all.1 + errors.1);
            }
        }
        for (axis, (squares, sum)) in expected.into_iter().enumerate() {
            let (rms, bias) = (f64::sqrt(squares / 840.0), sum / 840.0);
            // Householder QR at conditions up to 1e4 leaves eleven digits or so.
            assert!((found.grouped[axis].rms / rms - 1.0).abs() < 1e-9, "{basis:?}");
            assert!((found.grouped[axis].bias - bias).abs() < 1e-9 * rms, "{basis:?}");
        }
    }
}

#[test]
fn folds_of_groups_equal_refits_and_sums_of_a_larger_basis_serve_a_smaller_one() {
    let block = poses(4, 9, 80, 300.0, 0.02, curved);
    let sums = sums(&block, Basis::Poly3, 0);
    let model = Model { basis: Basis::Quadratic, intercept: true, channels: 4, memory: 0 };
    let found = cross_validate(&sums, &model, 0.0, Some(3)).unwrap();
    // Groups of one size are assigned in turns.
    let mut squares = 0.0;
    for fold in 0..3 {
        let train = rows_of(&block, |g| g % 3 != fold);
        let test = rows_of(&block, |g| g % 3 == fold);
        squares += brute_force(&train, &test, model)[2].0;
    }
    let rms = (squares / block.rows as f64).sqrt();
    assert_eq!(found.folds, 3);
    assert!((found.grouped[2].rms / rms - 1.0).abs() < 1e-9);
}

#[test]
fn groups_and_random_folds_both_add_up_to_all_rows_bit_for_bit() {
    let block = poses(5, 70, 13, 300.0, 0.02, curved);
    let sums = sums(&block, Basis::Cubic, 7);
    let whole = moments(&block, Basis::Cubic);
    assert_eq!(sums.groups.len(), 70);
    assert_eq!(sums.total().unwrap(), &whole);
    let mut random = sums.random[0].clone();
    sums.random[1..].iter().for_each(|fold| random.merge(fold).unwrap());
    assert_eq!(random, whole);
    assert_eq!(sums.groups[3].1, moments(&rows_of(&block, |g| g == 3), Basis::Cubic));
}

#[test]
fn errors_keep_their_digits_where_almost_nothing_is_left_of_large_squares() {
    // An exact law under offsets a million times larger than its residuals: with noise of 1e-6 on
    // wrenches near 1, 12 digits of the squares cancel.
    let block = poses(6, 12, 100, 900.0, 1e-6, |z, axis| z[axis % 4] + 1.0);
    let model = Model { basis: Basis::Poly3, intercept: true, channels: 4, memory: 0 };
    let found = cross_validate(&sums(&block, Basis::Poly3, 0), &model, 0.0, None).unwrap();
    let mut squares = 0.0;
    for group in 0..12 {
        let train = rows_of(&block, |g| g != group);
        let test = rows_of(&block, |g| g == group);
        let train = moments(&train, Basis::Poly3);
        let solution = train.solve(&model, 0.0).unwrap().solution;
        let calibration = Calibration::from_solution(&solution, &train.reading_ranges());
        squares += errors(&calibration, &test)[0].0;
    }
    let rms = (squares / block.rows as f64).sqrt();
    // Predictions near 1 are accurate to 1e-15, so errors of 1e-6 have a relative accuracy of 1e-9.
    assert!((found.grouped[0].rms / rms - 1.0).abs() < 1e-8);
}

#[test]
fn a_ridge_with_readings_that_hardly_move_still_answers() {
    let block = poses(7, 6, 50, 0.0, 0.01, curved);
    let sums = sums(&block, Basis::Quadratic, 0);
    let model = Model { basis: Basis::Quadratic, intercept: true, channels: 4, memory: 0 };
    let error = cross_validate(&sums, &model, 0.0, None).unwrap_err();
    let FitError::Undetermined(error) = error else { panic!("{error}") };
    assert!(matches!(*error, FitError::RankDeficient(_)));
    let found = cross_validate(&sums, &model, 1e-3, None).unwrap();
    assert!(found.grouped.iter().all(|axis| axis.rms.is_finite()));
}

#[test]
fn a_group_that_alone_moves_a_channel_is_named_and_not_counted() {
    let mut block = poses(8, 5, 40, 500.0, 0.01, curved);
    // Channel 4 is constant except in the third pose.
    for (row, reading) in block.readings[3].iter_mut().enumerate() {
        if row / 40 != 2 {
            *reading = 1500.0;
        }
    }
    let model = Model { basis: Basis::Linear, intercept: true, channels: 4, memory: 0 };
    let found = cross_validate(&sums(&block, Basis::Linear, 4), &model, 0.0, None).unwrap();
    assert_eq!(found.undetermined, ["pose 2"]);
    assert!(found.random.is_some());
}

#[test]
fn a_group_with_large_readings_alone_goes_the_slow_way_to_the_same_answer() {
    // Without the first group the features are almost dependent: channel 2 differs from channel 1 by
    // one count in very few rows, and powers of both are even closer to dependent.
    let mut block = poses(9, 6, 200, 600.0, 0.01, |z, axis| z[axis % 2]);
    let first = block.readings[0].clone();
    for (row, (reading, first)) in block.readings[1].iter_mut().zip(&first).enumerate() {
        if row >= 200 {
            *reading = first + f64::from(u8::from(row % 150 == 7));
        }
    }
    let model = Model { basis: Basis::Cubic, intercept: true, channels: 4, memory: 0 };
    let whole = moments(&block, Basis::Cubic);
    let parts = PartitionedSums::new(&whole, &model).unwrap();
    let left_out = rows_of(&block, |g| g == 0);
    let part = moments(&left_out, Basis::Cubic);
    match parts.held_out(&part, &parts.part(&part), 0.0) {
        Ok(found) => {
            let rest = moments(&rows_of(&block, |g| g != 0), Basis::Cubic);
            let solution = rest.solve(&model, 0.0).unwrap().solution;
            let calibration = Calibration::from_solution(&solution, &rest.reading_ranges());
            let expected = errors(&calibration, &left_out);
            for axis in 0..6 {
                // A prediction far outside, from `f64` coefficients of near-opposite features.
                let ratio = (found[axis].squares / expected[axis].0).sqrt();
                assert!((ratio - 1.0).abs() < 1e-6, "{ratio}");
            }
        }
        Err(error) => assert!(matches!(error, FitError::RankDeficient(_)), "{error}"),
    }
}

#[test]
fn the_smallest_model_that_holds_is_chosen() {
    type Truth = fn(&[f64], usize) -> f64;
    let cases: [(Basis, Truth); 4] = [
        (Basis::Linear, |z, axis| z[axis % 4] - 0.5 * z[(axis + 1) % 4]),
        (Basis::Cubic, |z, axis| z[axis % 4] + z[(axis + 1) % 4].powi(2) - z[axis % 4].powi(3)),
        (Basis::Quadratic, |z, axis| z[axis % 4] + z[axis % 4] * z[(axis + 1) % 4]),
        (Basis::Poly3, |z, axis| z[0] + z[axis % 4] * z[(axis + 1) % 4] * z[(axis + 2) % 4] * 4.0),
    ];
    for (planted, truth) in cases {
        let block = poses(10, 60, 40, 300.0, 0.02, truth);
        let found =
            select(&sums(&block, Basis::Poly3, 0), true, &selection::RIDGES).unwrap().selection;
        // Four models and five ridges, and larger ones where those were better.
        assert!(found.candidates.len() >= 20);
        assert_eq!(found.candidates[found.chosen].basis, planted);
        let errors = found.candidates[found.chosen].errors.unwrap();
        // The planted noise, and a little for coefficients.
        assert!(errors.rms.iter().all(|rms| (0.019..0.023).contains(rms)), "{errors:?}");
    }
}

#[test]
fn too_few_groups_and_impossible_folds_are_refused() {
    let block = poses(11, 3, 60, 400.0, 0.01, curved);
    let model = Model { basis: Basis::Linear, intercept: true, channels: 4, memory: 0 };
    let one = sums(&rows_of(&block, |g| g == 0), Basis::Linear, 0);
    let error = cross_validate(&one, &model, 0.0, None).unwrap_err();
    assert_eq!(error, FitError::TooFewGroups { found: 1 });
    let three = sums(&block, Basis::Linear, 0);
    for folds in [0, 1, 4] {
        let error = cross_validate(&three, &model, 0.0, Some(folds)).unwrap_err();
        assert_eq!(error, FitError::Folds { folds, groups: 3 });
    }
    let cubic = Model { basis: Basis::Cubic, ..model };
    let error = cross_validate(&three, &cubic, 0.0, None).unwrap_err();
    assert!(matches!(error, FitError::OtherFeatures { .. }));
}

fn log(block: &Block) -> String {
    let mut text = "s1,s2,s3,s4,Fx_N,Fy_N,Fz_N,Mx_Nm,My_Nm,Mz_Nm,group\n".to_owned();
    let labels = block.groups.iter().flat_map(|(name, rows)| std::iter::repeat_n(name, *rows));
    for (row, label) in labels.enumerate() {
        for column in block.readings.iter().chain(&block.wrench) {
            text += &format!("{},", column[row]);
        }
        text += &format!("{label}\n");
    }
    text
}

#[test]
fn the_warning_compares_models_on_new_poses() {
    let dir = tempfile::tempdir().unwrap();
    let few = poses(12, 12, 120, 60.0, 0.002, curved);
    let many = poses(13, 1440, 1, 60.0, 0.002, curved);
    fs::write(dir.path().join("few.csv"), log(&few)).unwrap();
    fs::write(dir.path().join("many.csv"), log(&many)).unwrap();
    // Each fold has eleven poses for twelve features: the linear model predicts new ones better.
    let (text, talk) = ended(&dir, "fit few.csv --model cubic --cv --verbose", 0);
    assert!(talk.contains("linear predicts new groups better than cubic"), "{talk}");
    assert!(text.contains("leave-one-group-out cross-validation (12 groups"), "{text}");
    assert!(text.contains("best on new groups: linear, squared error"), "{text}");
    let (text, talk) = ended(&dir, "fit many.csv --model cubic --cv=10 --verbose", 0);
    assert!(!talk.contains("new groups"), "{talk}");
    for stage in ["reading the rows: ", "errors on held-out groups: ", "verdict and files: "] {
        assert!(talk.contains(stage), "{talk}");
    }
    assert!(text.contains("10-fold cross-validation (1440 groups"), "{text}");
    assert!(text.contains("best on new groups: cubic, squared error"), "{text}");
}

#[test]
fn a_model_that_is_best_on_new_poses_earns_no_warning_for_any_ratio() {
    let dir = tempfile::tempdir().unwrap();
    // Little noise and a large error per pose: twice the error of a random split, still the best.
    let block =
        poses(14, 24, 100, 60.0, 0.002, |z, axis| curved(z, axis) + 0.05 * (9.0 * z[0]).sin());
    fs::write(dir.path().join("poses.csv"), log(&block)).unwrap();
    let report = json(&dir, "fit poses.csv --model quadratic --cv --json");
    let rms = |of: &str| report["cross_validation"][of][0]["rms"].as_f64().unwrap();
    assert!(rms("grouped") > 2.0 * rms("random"), "{} {}", rms("grouped"), rms("random"));
    assert_eq!(report["advice"]["best"]["basis"], "quadratic");
    assert_eq!(report["advice"]["another_is_better"], false);
    let (_, talk) = ended(&dir, "fit poses.csv --model quadratic --cv --verbose", 0);
    assert!(!talk.contains("better than"), "{talk}");
    assert!(talk.contains("rows of a group are correlated"), "{talk}");
}

#[test]
fn the_ridges_reach_beyond_the_best_or_say_that_they_do_not() {
    // The readings are independent of the loads: the stronger the penalty, the better.
    let block = poses(15, 30, 40, 300.0, 1.0, |_, _| 0.0);
    let found =
        select(&sums(&block, Basis::Linear, 0), true, &selection::RIDGES).unwrap().selection;
    let linear: Vec<_> = found.candidates.iter().filter(|c| c.basis == Basis::Linear).collect();
    let scores: Vec<f64> = linear.iter().map(|c| c.errors.unwrap().score).collect();
    let [.., before, last] = scores[..] else { panic!("{scores:?}") };
    assert!(before < last || linear.last().unwrap().ridge >= selection::LARGEST_RIDGE);
    assert!(linear.len() > selection::RIDGES.len(), "{linear:?}");
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("noise.csv"), log(&block)).unwrap();
    let text = succeed(&dir, "fit noise.csv --model auto --cv --verbose");
    let at_limit = text.contains("its ridge is the largest that was tried");
    assert_eq!(at_limit, text.contains("with ridge 1e4, squared"), "{text}");
    let text = succeed(&dir, "fit noise.csv --model cubic --ridge 0.5 --verbose");
    assert!(text.contains("cubic + offset, ridge 5e-1 on powers of centred readings"), "{text}");
    let text = succeed(&dir, "fit noise.csv --model cubic --ridge 0.5 --no-intercept --verbose");
    assert!(text.contains("ridge 5e-1 on powers of raw readings"), "{text}");
}

#[test]
fn files_can_be_the_groups_and_results_do_not_depend_on_threads() {
    let dir = tempfile::tempdir().unwrap();
    for seed in 0..4 {
        let block = poses(20 + seed, 20, 50, 400.0, 0.01, curved);
        fs::write(dir.path().join(format!("{seed}.csv")), log(&block)).unwrap();
    }
    let report = |arguments: &str| -> serde_json::Value {
        json(&dir, &format!("fit 0.csv 1.csv 2.csv 3.csv --json {arguments}"))
    };
    let files = report("--cv=file --threads 1");
    assert_eq!(files["cross_validation"]["groups"], 4);
    assert_eq!(files["cross_validation"], report("--cv=file --threads 3")["cross_validation"]);
    assert_eq!(report("--cv")["cross_validation"]["groups"], 20);
    assert!(report("--model cubic")["cross_validation"].is_null());
    let auto = report("-o cal.json");
    // A chosen model is judged on the same groups.
    assert_eq!(auto["cross_validation"]["groups"], 20);
    assert_eq!(auto["model"], report("--model auto --cv")["model"]);
    let chosen = auto["selection"]["chosen"].as_u64().unwrap() as usize;
    let chosen = &auto["selection"]["candidates"][chosen];
    assert_eq!(auto["model"], format!("{} + offset", chosen["basis"].as_str().unwrap()));
    assert_eq!(auto["solver"]["ridge"], chosen["ridge"]);
    succeed(&dir, "eval cal.json 0.csv");
}

#[test]
fn without_groups_blocks_of_time_are_held_out_and_means_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let text = log(&poses(30, 5, 50, 400.0, 0.01, curved)).replace(",group", ",remark");
    fs::write(dir.path().join("one.csv"), text).unwrap();
    let report = json(&dir, "fit one.csv --model linear --cv --json");
    assert_eq!(report["groups_found"]["found"], "stretches");
    assert_eq!(report["cross_validation"]["groups"], 40);
    assert!(refused(&dir, "fit --model cubic one.csv --means").contains("nothing to hold out"));
    assert!(refused(&dir, "fit --model cubic one.csv --cv=column").contains("group"));
    refused(&dir, "fit --model cubic one.csv --cv=0");
}
