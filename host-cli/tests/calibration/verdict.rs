//! The verdict of `fit`: its first lines, the check of `--max-rms`, and the leaks that it names.

use std::fs;
use std::path::Path;

use calibration::fit::{Fit, HeldOut};
use calibration::{Basis, FitOptions, fit};
use log_file::{ColumnRef, Log, Mapping, ReadOptions};
use shell_data::block::Block;
use shell_data::dataset::Dataset;
use shell_data::wrench::Axes;
use shellcal::workflow::fit::FitData;
use system_tests::program::{ended, json, refused, succeed};
use system_tests::random::Random;
use system_tests::real_recording;

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../calibration-data");

fn shipped(change: impl Fn(Vec<String>) -> Vec<String>) -> String {
    let text = fs::read_to_string(Path::new(DATA).join("synthetic-train.csv")).unwrap();
    let mut lines = text.lines().map(str::to_owned);
    let header = lines.next().unwrap();
    let mut changed = vec![header];
    changed.extend(change(lines.collect()));
    changed.join("\n") + "\n"
}

fn shuffle<T>(items: &mut [T], random: &mut Random) {
    for last in (1..items.len()).rev() {
        items.swap(last, random.below(last as u64 + 1) as usize);
    }
}

#[test]
fn the_verdict_comes_first_and_limits_check_what_was_held_out() {
    let dir = tempfile::tempdir().unwrap();
    let fit = format!("fit {DATA}/synthetic-train.csv --model cubic");
    let text = succeed(&dir, &format!("{fit} --cv"));
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines[0], "OK: use it within the calibrated range");
    assert!(lines[3].starts_with(" Fx (N)") && lines[3].contains("0.116"), "{text}");
    assert!(lines[3].contains("±0.2") && lines[3].contains("-2.8 to 2.9"), "{text}");
    let model = "model  OK: cubic + offset, judged by 125 groups, each held out once";
    assert!(lines.contains(&model), "{text}");
    assert!(lines.contains(&"files  nothing saved: give -o FILE"), "{text}");
    assert!(lines.len() <= 14 && lines.iter().all(|of| of.chars().count() <= 100), "{text}");
    let text = succeed(&dir, &fit);
    assert!(
        text.starts_with("NOT KNOWN how large the error on new loads is: nothing was held out"),
        "{text}"
    );
    assert!(text.contains("no 95 % interval: nothing was held out"), "{text}");
    ended(&dir, &format!("{fit} --strict"), 1);
    ended(&dir, &format!("{fit} --cv --strict"), 0);
    // The training error is 0.117 N at most, on held-out groups 0.125 N.
    ended(&dir, &format!("{fit} --cv --max-rms 0.12"), 1);
    ended(&dir, &format!("{fit} --cv --max-rms 0.14 --max-rms-moment 0.006"), 0);
    let (_, said) = ended(&dir, &format!("{fit} --max-rms 0.14"), 1);
    assert!(said.contains("the error on new loads is not known"), "{said}");
    // The limit applies to the printed test as well, which errs by at most 0.143 N.
    let test = format!("--test {DATA}/synthetic-test.csv");
    ended(&dir, &format!("{fit} --cv {test} --max-rms 0.15"), 0);
    let (_, said) = ended(&dir, &format!("{fit} --cv {test} --max-rms 0.13"), 1);
    assert!(said.contains("above the limit of 0.1300 N"), "{said}");
}

/// `eval` reports the same of test rows, from the calibration file, as `fit --test` does.
#[test]
fn eval_has_the_screen_and_the_words_of_fit() {
    let dir = tempfile::tempdir().unwrap();
    let (train, test) =
        (format!("{DATA}/synthetic-train.csv"), format!("{DATA}/synthetic-test.csv"));
    let fit = format!("fit {train} --model cubic --cv -o cal.json");
    let fitted = json(&dir, &format!("{fit} --test {test} --json"));
    let found = json(&dir, &format!("eval cal.json {test} --json"));
    assert_eq!(found["verdict"]["ok"], true);
    assert_eq!(found["verdict"]["test_ratio"], fitted["verdict"]["test_ratio"]);
    assert_eq!(found["verdict"]["promised_rms"], fitted["verdict"]["unseen_rms"]);
    let text = succeed(&dir, &format!("eval cal.json {test}"));
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines[0], "OK: use it within the calibrated range");
    assert!(lines[3].starts_with(" Fx (N)") && lines[3].contains(" holds 9"), "{text}");
    assert!(lines[3].contains("0.116") && lines[3].contains("-2.8 to 2.9"), "{text}");
    let line = |label: &str| lines.iter().find(|line| line.starts_with(label)).copied();
    let of_fit = fitted["verdict"]["text"].as_array().unwrap();
    let of_fit = of_fit.iter().filter_map(|line| line.as_str());
    for label in ["test", "clock"] {
        assert_eq!(line(label), of_fit.clone().find(|line| line.starts_with(label)), "{text}");
    }
    assert!(lines.len() <= 14 && lines.iter().all(|of| of.chars().count() <= 100), "{text}");
    let text = succeed(&dir, &format!("eval cal.json {test} --verbose"));
    assert!(text.contains("800 rows used, 0 skipped") && text.contains(" bias "), "{text}");

    // Shares of the rows within the stated 95 % intervals.
    let held = found["verdict"]["interval_95_held"].as_array().unwrap();
    assert!(held.iter().all(|held| (0.85..=1.0).contains(&held.as_f64().unwrap())), "{held:?}");

    let (text, _) = ended(&dir, &format!("eval cal.json {train}"), 0);
    // A long path begins a line of its own.
    let said = text.replace('\n', " ");
    assert!(said.starts_with("NOT KNOWN how large the error on new loads is: `"), "{text}");
    assert!(said.contains("was used for the fit"), "{text}");

    let swapped = fs::read_to_string(&test).unwrap().replacen("fx_n,fy_n", "fy_n,fx_n", 1);
    fs::write(dir.path().join("swapped.csv"), swapped).unwrap();
    let text = succeed(&dir, "eval cal.json swapped.csv");
    assert!(text.starts_with("NOT OK on the test: exchanging Fx and Fy brings "), "{text}");

    fs::copy(&test, dir.path().join("other.csv")).unwrap();
    let text = succeed(&dir, "eval cal.json swapped.csv other.csv");
    assert!(text.starts_with("NOT OK on the test: in `swapped.csv` exchanging"), "{text}");
    assert!(text.contains(" other.csv "), "{text}");

    // Without held-out errors, test errors are compared with those of the training rows.
    succeed(&dir, &format!("fit {train} --model cubic -o plain.json"));
    let text = succeed(&dir, &format!("eval plain.json {test}"));
    assert!(text.starts_with("OK: ") && text.contains("error on training rows"), "{text}");
}

#[test]
fn every_use_of_a_calibration_repeats_that_its_fit_was_not_ok() {
    let dir = tempfile::tempdir().unwrap();
    let file = |name: &str| Path::new(DATA).join(name).display().to_string();
    let (train, test) = (file("synthetic-train.csv"), file("synthetic-test.csv"));
    let swapped = fs::read_to_string(&test).unwrap().replacen("fx_n,fy_n", "fy_n,fx_n", 1);
    fs::write(dir.path().join("swapped.csv"), swapped).unwrap();
    succeed(&dir, &format!("fit {train} --model cubic --test swapped.csv -o bad.json"));
    succeed(&dir, &format!("fit {train} --model cubic --test {test} -o good.json"));
    succeed(&dir, "synth trial -o trial.csv");
    for name in ["bad", "good"] {
        for command in [
            format!("eval {name}.json {test}"),
            format!("eval good.json {test} --against {name}.json"),
            format!("convert {name}.json {test} -o forces.csv"),
            format!("export {name}.json wrench.py"),
            format!("trial trial.csv --calibration {name}.json"),
        ] {
            let (_, said) = ended(&dir, &command, 0);
            let repeated = said.matches("its fit said: NOT OK").count();
            assert_eq!(repeated, usize::from(name == "bad"), "{command}: {said}");
        }
    }
}

#[test]
fn shuffled_rows_without_groups_are_reported_as_optimistic() {
    let dir = tempfile::tempdir().unwrap();
    let without_group = |line: &String| line.rsplit_once(',').unwrap().0.to_owned();
    let in_time = shipped(|lines| lines.iter().map(without_group).collect());
    let shuffled = shipped(|mut lines| {
        shuffle(&mut lines, &mut Random(5));
        lines.iter().map(without_group).collect()
    });
    for (name, text) in [("time.csv", in_time), ("shuffled.csv", shuffled)] {
        fs::write(dir.path().join(name), text.replacen(",group\n", "\n", 1)).unwrap();
    }
    let rows =
        |log: &str| json(&dir, &format!("fit {log} --model linear --cv --json"))["verdict"].clone();
    assert_eq!(rows("time.csv")["unseen_rows"], "held_out");
    let verdict = rows("shuffled.csv");
    assert_eq!(verdict["unseen_rows"], "held_out_of_shuffled_rows");
    assert!(verdict["text"].to_string().contains("optimistic"), "{verdict}");
}

#[test]
fn a_test_set_beyond_the_calibrated_range_is_no_result() {
    let dir = tempfile::tempdir().unwrap();
    let moved = shipped(|lines| {
        let zeroed_anew = |line: &String| {
            let mut fields: Vec<String> = line.split(',').map(str::to_owned).collect();
            fields[1] = (20_000 + fields[1].parse::<i32>().unwrap()).to_string();
            fields.join(",")
        };
        lines.iter().map(zeroed_anew).collect()
    });
    fs::write(dir.path().join("moved.csv"), moved).unwrap();
    let train = format!("{DATA}/synthetic-train.csv");
    let fit = format!("fit {train} --test moved.csv --model linear --cv --json");
    let found = json(&dir, &fit);
    let said = found["verdict"]["reasons"][0].as_str().unwrap();
    // A linear model turns an offset of a reading into an offset of the wrench.
    assert!(said.contains("on the test: another zero of forces"), "{said}");
    assert_eq!(found["verdict"]["ok"], false);
    assert!(found["test"][0]["rms"].is_number() && !found["test"][0]["r_squared"].is_number());
    assert!(found["train"][0]["r_squared"].is_number());
}

#[test]
fn two_calibrations_are_compared_by_groups_and_eval_names_its_inputs() {
    let dir = tempfile::tempdir().unwrap();
    let (train, test) =
        (format!("{DATA}/synthetic-train.csv"), format!("{DATA}/synthetic-test.csv"));
    succeed(&dir, &format!("fit {train} --model cubic -o cubic.json"));
    succeed(&dir, &format!("fit {train} --model linear -o linear.json"));
    let found = json(&dir, &format!("eval cubic.json {test} --against linear.json --json"));
    let evaluated =
        |cal: &str| json(&dir, &format!("eval {cal} {test} --json"))["all"]["errors"].clone();
    let errors = [evaluated("cubic.json"), evaluated("linear.json")];
    for (axis, of) in found["axes"].as_array().unwrap().iter().enumerate() {
        let number = |value: &serde_json::Value| value.as_f64().unwrap();
        for (which, errors) in errors.iter().enumerate() {
            let expected = number(&errors[axis]["rms"]);
            // The sums over groups are added in another order.
            assert!((number(&of["rms"][which]) / expected - 1.0).abs() < 1e-9, "{of}");
        }
        let [low, high] = [0, 1].map(|end| number(&of["interval_95"][end]));
        assert!(low < number(&of["difference"]) && number(&of["difference"]) < high, "{of}");
        let better = [(high < 0.0).then_some("first"), (low > 0.0).then_some("second")];
        let better = better.into_iter().flatten().next();
        assert_eq!(of["better"].as_str(), better, "{of}");
    }
    let text = succeed(&dir, &format!("eval cubic.json {test} --against cubic.json"));
    assert!(text.contains("no significant difference") && !text.contains("errs less"), "{text}");
    let (_, said) = ended(&dir, &format!("eval cubic.json {test} --against linear.json"), 0);
    assert!(!said.contains("was used for the fit"), "{said}");
    let (_, said) = ended(&dir, &format!("eval cubic.json {train} --against linear.json"), 0);
    for name in ["cubic.json", "linear.json"] {
        assert!(said.contains(&format!("was used for the fit of `{name}`")), "{said}");
    }
    let said = refused(&dir, &format!("eval cubic.json linear.json {test}"));
    assert!(said.contains("shellcal eval cubic.json LOG --against linear.json"), "{said}");
    let (_, said) = ended(&dir, &format!("eval cubic.json {train}"), 0);
    assert!(said.contains("was used for the fit"), "{said}");
    let (_, said) = ended(&dir, &format!("eval cubic.json {test}"), 0);
    assert!(!said.contains("was used for the fit"), "{said}");
}

#[test]
fn units_that_are_not_known_are_refused_and_moments_in_other_units_are_reported() {
    let dir = tempfile::tempdir().unwrap();
    let text = fs::read_to_string(Path::new(DATA).join("synthetic-train.csv")).unwrap();
    fs::write(dir.path().join("stone.csv"), text.replacen(",fz_n,", ",Fz (stone),", 1)).unwrap();
    let said = refused(&dir, "fit stone.csv --model cubic");
    assert!(
        said.contains("column `Fz (stone)`: the unit `stone` of its force is not understood"),
        "{said}"
    );
    // N·mm in columns without a unit.
    let large = shipped(|lines| {
        let in_mm = |line: String| {
            let mut fields: Vec<String> = line.split(',').map(str::to_owned).collect();
            for field in &mut fields[12..15] {
                *field = (1e3 * field.parse::<f64>().unwrap()).to_string();
            }
            fields.join(",")
        };
        lines.into_iter().map(in_mm).collect()
    });
    let large = large.replacen("mx_nm,my_nm,mz_nm", "mx,my,mz", 1);
    fs::write(dir.path().join("mm.csv"), large).unwrap();
    let (_, said) = ended(&dir, "fit mm.csv --model cubic", 0);
    assert!(said.contains("moments are probably in mN·m"), "{said}");
    let (_, said) = ended(&dir, "fit mm.csv --model cubic --moment-unit mnm", 0);
    assert!(!said.contains("lever"), "{said}");
}

fn fit_rows(train: &[Row], test: &[Row]) -> Fit {
    let data = |rows: &[Row]| {
        let column = |of: &dyn Fn(&Row) -> f64| rows.iter().map(of).collect::<Vec<f64>>();
        let block = Block {
            rows: rows.len(),
            readings: (0..8).map(|channel| column(&|row| row.readings[channel])).collect(),
            wrench: (0..6).map(|axis| column(&|row| row.load[axis])).collect(),
            groups: rows.iter().map(|row| (row.group.to_string(), 1)).collect(),
            ..Block::default()
        };
        Dataset::from_blocks("rows", Axes::ALL, vec![block])
    };
    let cross_validation = Some(HeldOut::Column);
    let options =
        FitOptions { model: Basis::Linear.into(), cross_validation, ..FitOptions::default() };
    fit(data(train), data(test), &options).unwrap()
}

#[derive(Clone, Copy)]
struct Row {
    load: [f64; 6],
    readings: [f64; 8],
    group: usize,
}

fn poses() -> Vec<Row> {
    let path = real_recording("others/photointerrupters/poses.csv");
    let mapping = Mapping { group: Some(ColumnRef::Name("pose".into())), ..Mapping::default() };
    let logs = [Log::open(&path, &mapping).unwrap()];
    let options = FitOptions { cross_validation: Some(HeldOut::Column), ..FitOptions::default() };
    let data = FitData::read(&logs, &[], (&options, false), &ReadOptions::default()).unwrap().train;
    let mut rows = Vec::new();
    for (_, block) in data.blocks() {
        let labels =
            block.labels.iter().flat_map(|(label, rows)| std::iter::repeat_n(label, *rows));
        for (row, label) in labels.enumerate() {
            rows.push(Row {
                load: std::array::from_fn(|axis| block.rows.wrench[axis][row]),
                readings: std::array::from_fn(|channel| block.rows.readings[channel][row]),
                group: label.parse::<f64>().unwrap() as usize,
            });
        }
    }
    rows
}

#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn random_splits_and_permuted_labels_of_a_real_sensor_leak_and_grouped_splits_do_not() {
    let rows = poses();
    let mut groups: Vec<usize> = rows.iter().map(|row| row.group).collect();
    groups.sort_unstable();
    groups.dedup();
    assert_eq!((rows.len(), groups.len()), (15_911, 32));
    let round = |rows: &mut [Row], decimals: i32| {
        let per_unit = 10_f64.powi(decimals);
        let load = |load: f64| (load * per_unit).round() / per_unit;
        rows.iter_mut().for_each(|row| row.load = row.load.map(load));
    };
    let mut random = Random(28);
    let mut leaks = [0; 4];
    for case in 0..100 {
        let mut order = rows.clone();
        shuffle(&mut order, &mut random);
        let (test, train) = order.split_at_mut(rows.len() / 5);
        // Rounds neither set of rows, or one of them, to between nine and two decimals.
        let decimals = [9, 7, 5, 4, 3, 2][case % 6];
        match case % 3 {
            1 => round(train, decimals),
            2 => round(test, decimals),
            _ => {}
        }
        leaks[0] += usize::from(fit_rows(train, test).leaks.in_test().is_some());
        let mut labels: Vec<usize> = rows.iter().map(|row| row.group).collect();
        shuffle(&mut labels, &mut random);
        let mut permuted = rows.clone();
        permuted.iter_mut().zip(labels).for_each(|(row, group)| row.group = group);
        leaks[1] += usize::from(fit_rows(&permuted, &[]).leaks.in_groups().is_some());
        shuffle(&mut groups, &mut random);
        let (test, train): (Vec<Row>, Vec<Row>) =
            rows.iter().partition(|row| groups[..8].contains(&row.group));
        let grouped = fit_rows(&train, &test).leaks;
        leaks[2] += usize::from(grouped.in_test().is_some());
        leaks[3] += usize::from(grouped.in_groups().is_some());
    }
    assert_eq!(leaks, [100, 100, 0, 0]);
}

#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn a_plain_fit_of_few_poses_takes_physics_and_reports_held_out_errors() {
    let dir = tempfile::tempdir().unwrap();
    let path = real_recording("others/photointerrupters/poses.csv");
    let found = json(&dir, &format!("fit {} --json", path.display()));
    assert_eq!(found["model"], "physics");
    // Leave-one-pose-out errors, as in docs/physics.md, plus half of their last digit.
    for (axis, limit) in [1.105, 0.815, 0.715].into_iter().enumerate() {
        let rms = found["verdict"]["unseen_rms"][axis].as_f64().unwrap();
        assert!(rms < limit, "{axis}: {rms}");
        let held = found["verdict"]["interval_95_held"][axis].as_f64().unwrap();
        assert!((0.92..=0.99).contains(&held), "{axis}: {held}");
    }
}
