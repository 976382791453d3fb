//! Zero drift: reported, warned about, and followed, on the sensor model with and without warm-up.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use calibration::Calibration;
use calibration_file::CalibrationFile;
use forces::stationary::{FALSE_ALARMS, ZeroWatch};
use serde_json::Value;
use simulation::sensor_model::{SensorModel, SensorParameters};
use system_tests::program::{self, ended, json, refused, succeed};

use crate::recording::column;

const RATE_HZ: f64 = 100.0;

/// Returns unit 1 of the sensor model with this warm-up, without ambient light and hysteresis.
fn sensor(warm_up_k: f64, warm_up_s: f64, seed: u64) -> SensorModel {
    let mut unit = SensorParameters::nominal().unit(1);
    unit.elastic = true;
    unit.surroundings.start_k = 0.0;
    unit.surroundings.ambient = 0.0;
    (unit.surroundings.warm_up_k, unit.surroundings.warm_up_s) = (warm_up_k, warm_up_s);
    SensorModel::new(&unit, seed).unwrap()
}

/// Returns a calibration of the same unit at the initial temperature.
fn calibration(folder: &Path) -> Calibration {
    program::run(folder, "synth train --rows 6000 --elastic -o train.csv", 0);
    program::run(folder, "fit --model cubic train.csv -o cal.json", 0);
    CalibrationFile::read(&folder.join("cal.json")).unwrap().calibration
}

/// Returns a push down, forward and to the left, or no load.
fn load(is_loaded: bool) -> [f64; 6] {
    if is_loaded { [0.8, 0.5, -1.0, 0.0, 0.0, 0.0] } else { [0.0; 6] }
}

/// Returns times and readings of a sensor that is loaded at the times for which `is_loaded` is true.
fn recorded(
    mut sensor: SensorModel,
    seconds: f64,
    is_loaded: impl Fn(f64) -> bool,
) -> (Vec<f64>, Vec<Vec<f64>>) {
    let times: Vec<f64> = (0..(seconds * RATE_HZ) as u32).map(|i| f64::from(i) / RATE_HZ).collect();
    let mut readings = vec![Vec::new(); 8];
    for &time in &times {
        let frame = sensor.sample(time, &load(is_loaded(time)));
        readings
            .iter_mut()
            .zip(frame.readings)
            .for_each(|(column, reading)| column.push(f64::from(reading)));
    }
    (times, readings)
}

/// Formats the recording as a log; `extra` returns additional cells of a row.
fn log(
    (times, readings): &(Vec<f64>, Vec<Vec<f64>>),
    name: &str,
    extra: impl Fn(usize) -> String,
) -> String {
    let mut text = format!("t_s,s1,s2,s3,s4,s5,s6,s7,s8{name}\n");
    for (row, time) in times.iter().enumerate() {
        write!(text, "{time}").unwrap();
        readings.iter().for_each(|column| write!(text, ",{}", column[row]).unwrap());
        writeln!(text, "{}", extra(row)).unwrap();
    }
    text
}

#[test]
fn alarms_have_the_stated_rate_and_a_drift_raises_them() {
    let folder = tempfile::tempdir().unwrap();
    let calibration = calibration(folder.path());
    let alarms = |warm_up_k: f64, logs: u64| {
        let mut alarms = 0;
        for seed in 0..logs {
            let start = 2.0 + 0.01 * (seed % 37) as f64;
            let sensor = sensor(warm_up_k, 3.0, seed);
            let (times, readings) = recorded(sensor, 6.0, |t| t >= start && t < start + 1.0);
            let mut watch = ZeroWatch::default();
            watch.look_at(&times, &readings);
            let zero = watch.finish(&calibration).unwrap();
            // Stationary intervals lie before and after the load, but not within.
            assert!((4..=10).contains(&zero.rests) && zero.last_s > 4.0, "{zero:?}");
            alarms += u64::from(zero.largest().is_some());
        }
        alarms as f64 / logs as f64
    };
    let false_alarms = alarms(0.0, 1000);
    // The tolerance is three standard deviations of a share of 1000.
    assert!(false_alarms <= FALSE_ALARMS + 0.0095, "{false_alarms}");
    // A rise of 3 K, with a time constant of 3 s, changes 2000 counts by 12; the noise is 4 counts.
    let power = alarms(3.0, 200);
    assert!(power >= 0.99, "{power}");
    println!(
        "alarms in {:.1} % of 1000 logs without drift, in {:.1} % of 200 with",
        100.0 * false_alarms,
        100.0 * power
    );
}

#[test]
fn slopes_equal_those_of_the_warm_up() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    calibration(folder);
    // A rise of 10 K with a time constant of half a minute, reported every second.
    let model = sensor(10.0, 30.0, 5);
    let warmth: Vec<f64> = (0..6000).map(|i| model.warmth_k(f64::from(i) / RATE_HZ)).collect();
    let recorded = recorded(model, 60.0, |t| (20.0..30.0).contains(&t));
    let temperature = |row: usize| match row % 100 {
        0 => format!(",{:.2}", 25.0 + warmth[row]),
        _ => ",".to_owned(),
    };
    fs::write(folder.join("log.csv"), log(&recorded, ",temperature_c", temperature)).unwrap();
    let found = &json(folder, "info log.csv --drift --calibration cal.json --plot d.svg --json")[0];
    assert_eq!(found["tare_holds"], false);
    let channels = found["channels"].as_array().unwrap();
    assert_eq!(channels.len(), 8);
    for (channel, drift) in channels.iter().enumerate() {
        // The true slope is the difference of two readings of the model without noise, 58 s apart, per K.
        let mut quiet = SensorParameters::nominal().unit(1);
        quiet.elastic = true;
        quiet.scale_noise(0.0);
        quiet.adc_bits = 16;
        quiet.surroundings.start_k = 0.0;
        quiet.surroundings.ambient = 0.0;
        (quiet.surroundings.warm_up_k, quiet.surroundings.warm_up_s) = (10.0, 30.0);
        let mut quiet = SensorModel::new(&quiet, 5).unwrap();
        let mut at = |time: f64| f64::from(quiet.sample(time, &[0.0; 6]).readings[channel]) / 16.0;
        let truth = (at(59.0) - at(1.0)) / (warmth[5900] - warmth[100]);
        let trend = &drift["per_degree"];
        let (slope, error) =
            (trend["slope"].as_f64().unwrap(), trend["standard_error"].as_f64().unwrap());
        // Tolerance: four standard errors, and the error from half a second of delay in thirty, 1.7 % of the slope.
        assert!(
            (slope - truth).abs() < 4.0 * error + 0.03 * truth.abs(),
            "{channel}: {slope} {truth} {error}"
        );
        assert!(error < 0.1 * truth.abs(), "{channel}: {error}");
        // The warm-up is linear in temperature, but not in time.
        let left = |by: &str| drift[by]["residual_rms"].as_f64().unwrap();
        let ratio = left("per_degree") / left("per_s");
        assert!(ratio < 0.7, "{channel}: {ratio}");
        let change = drift["change"].as_f64().unwrap();
        let expected = at(59.7) - at(0.25);
        assert!((change - expected).abs() < 4.0, "{channel}: {change} {expected}");
    }
    let text = program::run(folder, "info log.csv --drift --calibration cal.json", 0);
    for part in [
        "per degree",
        "Fz (N)",
        "s8 (counts)",
        "does not hold",
        "closer to the zeros than one against time in",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    assert!(fs::read_to_string(folder.join("d.svg")).unwrap().contains(">Fz (N)<"));
    program::run(folder, "info log.csv --drift --plot channels.svg", 0);
    assert!(fs::read_to_string(folder.join("channels.svg")).unwrap().contains(">s8<"));
}

#[test]
fn a_still_zero_holds() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let recorded = recorded(sensor(0.0, 1.0, 3), 10.0, |_| false);
    fs::write(folder.join("log.csv"), log(&recorded, ",temp", |_| ",21.5".to_owned())).unwrap();
    let found = &json(folder, "info log.csv --drift --temperature temp --json")[0];
    assert_eq!((&found["tare_holds"], &found["rests"]), (&Value::Bool(true), &Value::from(20)));
    assert_eq!(
        (&found["axes"], &found["temperature"]),
        (&Value::Null, &serde_json::json!([21.5, 21.5]))
    );
    for drift in found["channels"].as_array().unwrap() {
        // At a noise of 4 counts, the mean of a stationary interval has a noise of 0.6 counts.
        assert!(drift["wander"].as_f64().unwrap() < 0.6, "{drift}");
        assert_eq!(drift["per_degree"], Value::Null);
    }
    let text = program::run(folder, "info log.csv --drift --temperature temp", 0);
    assert!(
        text.contains("holds to the end") && text.contains("temperature 21.50 throughout"),
        "{text}"
    );
}

/// A zero that has jumped looks like a load that is held to the end.
#[test]
fn a_zero_that_is_not_seen_at_the_end_is_not_called_still() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let held = recorded(sensor(0.0, 1.0, 3), 20.0, |time| time > 10.0);
    fs::write(folder.join("log.csv"), log(&held, "", |_| String::new())).unwrap();
    assert_eq!(json(folder, "info log.csv --drift --json")[0]["tare_holds"], Value::Null);
    let text = program::run(folder, "info log.csv --drift", 0);
    assert!(text.contains("the zero at the end is not known"), "{text}");
}

#[test]
fn logs_too_short_for_a_drift_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let short = recorded(sensor(0.0, 1.0, 3), 0.8, |_| false);
    fs::write(folder.join("short.csv"), log(&short, "", |_| String::new())).unwrap();
    let text = refused(folder, "info short.csv --drift");
    assert!(
        text.contains("`1` stationary intervals") && text.contains("hint: begin with"),
        "{text}"
    );
    let long = recorded(sensor(0.0, 1.0, 3), 4.0, |_| false);
    let cell = |row: usize| if row == 7 { ",warm".to_owned() } else { ",20".to_owned() };
    fs::write(folder.join("long.csv"), log(&long, ",temperature_c", cell)).unwrap();
    let text = refused(folder, "info long.csv --drift");
    assert!(text.contains("`warm` in column `temperature_c`"), "{text}");
    let text = refused(folder, "info long.csv --drift --temperature heat");
    assert!(text.contains("heat"), "{text}");
    let text = refused(folder, "info long.csv short.csv --drift --plot x.svg");
    assert!(text.contains("`--plot` draws one log"), "{text}");
    let no_time = log(&long, "", |_| String::new());
    let no_time: String =
        no_time.lines().map(|line| format!("{}\n", line.split_once(',').unwrap().1)).collect();
    fs::write(folder.join("rows.csv"), no_time).unwrap();
    assert!(refused(folder, "info rows.csv --drift").contains("time"));
    calibration(folder);
    let text = refused(folder, "convert cal.json rows.csv --tare rests -o x.csv");
    assert!(text.contains("no time column") && text.contains("--time"), "{text}");
    assert!(!folder.join("x.csv").exists());
    let text = refused(folder, "convert cal.json long.csv --tare rest");
    assert!(text.contains("or `rests`"), "{text}");
}

/// RMS error of a table's forces over the loaded time, N.
fn errors(table: &Path, is_loaded: impl Fn(f64) -> bool) -> f64 {
    let numbers = |name: &str| -> Vec<f64> {
        column(table, name).iter().map(|field| field.parse().unwrap()).collect()
    };
    let times = numbers("t_s");
    let mut squares = Vec::new();
    for (axis, name) in ["fx_n", "fy_n", "fz_n"].into_iter().enumerate() {
        for (time, value) in times.iter().zip(numbers(name)) {
            if is_loaded(*time) {
                squares.push((value - load(true)[axis]).powi(2));
            }
        }
    }
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

#[test]
fn a_tare_that_follows_rests_takes_a_drift_out_and_commands_warn_without_it() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    calibration(folder);
    // The temperature rises by 10 K in a minute (time constant 20 s). The load is on for 2 s in every 6 s.
    let is_loaded = |t: f64| t % 6.0 >= 2.0 && t % 6.0 < 4.0;
    let held = |t: f64| t % 6.0 >= 2.3 && t % 6.0 < 3.7;
    let drifting = recorded(sensor(10.0, 20.0, 9), 60.0, is_loaded);
    fs::write(folder.join("log.csv"), log(&drifting, "", |_| String::new())).unwrap();
    let first = ended(folder, "convert cal.json log.csv -o first.csv", 0).1;
    assert!(first.contains("warning: `log.csv`: the zero of"), "{first}");
    let rests = ended(folder, "convert cal.json log.csv --tare rests -o rests.csv", 0).1;
    assert!(
        rests.contains("stationary intervals, the first, 0 s to 0.49 s")
            && !rests.contains("the zero of"),
        "{rests}"
    );
    succeed(folder, "convert cal.json log.csv --tare rests --causal -o causal.csv");
    let error = |name: &str| errors(&folder.join(name), held);
    let (first, rests, causal) = (error("first.csv"), error("rests.csv"), error("causal.csv"));
    println!(
        "forces under load: RMS error {first:.3} N tared once, {rests:.3} N between rests, {causal:.3} N causal"
    );
    // The remaining error is the model's own at this load and temperature.
    assert!(rests < 0.4 * first && causal < 0.5 * first, "{first} {rests} {causal}");
    assert!(
        ended(folder, "info log.csv --noise --calibration cal.json", 0).1.contains("the zero of")
    );

    let trial = |options: &str| {
        json(folder, &format!("trial log.csv --calibration cal.json --json {options}"))
    };
    let codes = |document: &Value| -> Vec<String> {
        let list = document["remarks"].as_array().unwrap().iter();
        list.map(|it| it["code"].as_str().unwrap().to_owned()).collect()
    };
    assert!(codes(&trial("--enter 12 --exit 30")).contains(&"moved_zero".to_owned()));
    let followed = trial("--enter 12 --exit 30 --tare rests");
    assert!(!codes(&followed).contains(&"moved_zero".to_owned()));
    fs::write(folder.join("manifest.csv"), "file,condition,t_enter_s,t_exit_s\nlog.csv,a,12,30\n")
        .unwrap();
    let batch = "batch manifest.csv --calibration cal.json";
    assert!(ended(folder, batch, 0).1.contains("the zero of"));
    assert!(!ended(folder, &format!("{batch} --tare rests"), 0).1.contains("the zero of"));

    let still = recorded(sensor(0.0, 1.0, 9), 30.0, is_loaded);
    fs::write(folder.join("log.csv"), log(&still, "", |_| String::new())).unwrap();
    assert!(!ended(folder, "convert cal.json log.csv -o x.csv", 0).1.contains("the zero of"));
    assert!(!codes(&trial("--enter 6 --exit 18")).contains(&"moved_zero".to_owned()));
}
