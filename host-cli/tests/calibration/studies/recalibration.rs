//! `shellcal fit --from`: a calibration updated by a few loads.

use std::fmt::Write;
use std::fs;

use calibration::fit::{FitOptions, HeldOut, ModelRule, Workers, evaluate};
use calibration::physics::{Observation, TrainingRows};
use calibration::recalibration::{ChangedQuantity, NewLoads, Recalibration};
use calibration::{Calibration, Fit};
use shell_data::block::Block;
use shell_data::dataset::Dataset;
use shell_data::wrench::{Axes, PerAxis, cross, force_at};
use simulation::sensor_model::{SensorModel, SensorParameters};
use system_tests::program::{ended, json, refused, succeed};
use system_tests::random::Random;

struct State {
    unit: SensorParameters,
    lever_m: [f64; 3],
    turn_rad: [f64; 3],
    session: u64,
}

impl State {
    fn new(seed: u64) -> Self {
        let mut unit = SensorParameters::nominal().unit(seed);
        unit.elastic = true;
        Self { unit, lever_m: [0.0; 3], turn_rad: [0.0; 3], session: 10 * seed }
    }

    /// The sensor mounted again, with the lever off by a length in m, turned by an angle in rad,
    /// and every gain changed by a random share; the number given is the standard deviation of this
    /// share.
    fn changed(&self, (lever_m, turn_rad, gain): (f64, f64, f64), random: &mut Random) -> Self {
        let mut direction = |length: f64| {
            let v: [f64; 3] = std::array::from_fn(|_| random.normal());
            let size = v.iter().map(|x| x * x).sum::<f64>().sqrt();
            v.map(|x| length * x / size)
        };
        let (lever_m, turn_rad) = (direction(lever_m), direction(turn_rad));
        let mut unit = self.unit.clone();
        unit.channels.iter_mut().for_each(|of| of.gain *= 1.0 + gain * random.normal());
        Self { unit, lever_m, turn_rad, session: self.session + 1 }
    }

    /// Returns the wrench at the shell for one in the reference frame.
    fn felt(&self, [fx, fy, fz, mx, my, mz]: PerAxis<f64>) -> PerAxis<f64> {
        let more = cross(self.lever_m, [fx, fy, fz]);
        let back = |v| turned_back(v, self.turn_rad);
        let ([fx, fy, fz], [mx, my, mz]) =
            (back([fx, fy, fz]), back([mx - more[0], my - more[1], mz - more[2]]));
        [fx, fy, fz, mx, my, mz]
    }

    /// 20 rows at each load.
    fn record(&self, loads: &[PerAxis<f64>], part: u64) -> Dataset {
        let mut sensor = SensorModel::new(&self.unit, self.session).unwrap();
        let mut block = Block {
            rows: 20 * loads.len(),
            readings: vec![Vec::new(); 8],
            wrench: vec![Vec::new(); 6],
            ..Block::default()
        };
        for (at, &load) in loads.iter().enumerate() {
            block.groups.push((format!("{part}-{at}"), 20));
            for row in 0..20 {
                let time = 0.01 * (20 * at + row) as f64;
                let frame = sensor.sample(time, &self.felt(load));
                let pairs = block.readings.iter_mut().zip(frame.readings);
                pairs.for_each(|(column, reading)| column.push(f64::from(reading)));
                block.wrench.iter_mut().zip(load).for_each(|(column, value)| column.push(value));
            }
        }
        let mut data = Dataset::from_blocks("poses", Axes::ALL, vec![block]);
        data.logs.iter_mut().for_each(|log| log.has_groups = true);
        data
    }
}

/// Turns `v` by the opposite of a rotation vector: Rodrigues' formula, written out.
fn turned_back(v: [f64; 3], by: [f64; 3]) -> [f64; 3] {
    let angle = by.iter().map(|x| x * x).sum::<f64>().sqrt();
    if angle == 0.0 {
        return v;
    }
    let k = by.map(|x| -x / angle);
    let along: f64 = k.iter().zip(v).map(|(a, b)| a * b).sum();
    let across = cross(k, v);
    std::array::from_fn(|i| {
        v[i] * angle.cos() + across[i] * angle.sin() + k[i] * along * (1.0 - angle.cos())
    })
}

/// Weights of 50 to 300 g on strings at points of the shell.
fn loads(count: usize, random: &mut Random) -> Vec<PerAxis<f64>> {
    let load = |_| {
        let size = 9.80665 * (0.05 + 0.25 * random.unit());
        let (turn, up) = (std::f64::consts::TAU * random.unit(), 2.0 * random.unit() - 1.0);
        let flat = (1.0 - up * up).sqrt();
        let along = [flat * turn.cos(), flat * turn.sin(), up];
        let point = [0.06 * random.unit() - 0.03, 0.06 * random.unit() - 0.03, 0.02];
        force_at(along.map(|x| size * x), point)
    };
    (0..count).map(load).collect()
}

fn fit(data: Dataset) -> Fit {
    let options = FitOptions {
        model: ModelRule::Physics,
        cross_validation: Some(HeldOut::Column),
        ..FitOptions::default()
    };
    calibration::fit(data, Dataset::default(), &options).unwrap()
}

fn observations(data: &Dataset) -> Vec<Observation> {
    TrainingRows::from_dataset(data).0.observations().unwrap()
}

fn brought_up_to_date(before: &Fit, data: &Dataset) -> Recalibration {
    let observations = observations(data);
    let held_out = before.cross_validation.as_ref().unwrap().grouped;
    let loads = NewLoads {
        observations: &observations,
        reference_errors: &vec![[0.0; 6]; observations.len()],
        calibration_errors: held_out.map(|axis| axis.rms),
    };
    before.calibration.recalibrated(&loads).unwrap()
}

/// Root mean square error over all axes, each in units of its loads.
fn error(calibration: &Calibration, data: &Dataset) -> f64 {
    let errors = evaluate(calibration, data, Workers::default()).unwrap()[0].quality().unwrap();
    let scales = [1.0, 1.0, 1.0, 0.03, 0.03, 0.03];
    let square = errors.iter().zip(scales).map(|(of, scale)| (of.rms / scale).powi(2));
    (square.sum::<f64>() / 6.0).sqrt()
}

fn seeds() -> std::ops::RangeInclusive<u64> {
    1..=std::env::var("RECALIBRATION_SEEDS").map_or(6, |count| count.parse().unwrap())
}

#[test]
fn four_poses_give_the_accuracy_of_a_full_calibration() {
    let mut ratios = Vec::new();
    for seed in seeds() {
        let mut random = Random(seed);
        let state = State::new(seed);
        let before = fit(state.record(&loads(32, &mut random), 0));
        let now = state.changed((2e-3, 2_f64.to_radians(), 0.05), &mut random);
        let full = fit(now.record(&loads(32, &mut random), 1));
        // Four poses, and one pose of the unloaded sensor.
        let mut few = loads(4, &mut random);
        few.push([0.0; 6]);
        let found = brought_up_to_date(&before, &now.record(&few, 2));
        assert!(!found.is_contradicted(), "{seed}: {:?}", found.disagreement);
        assert_eq!(found.quantities, ChangedQuantity::ALL, "{seed}");
        let test = now.record(&loads(100, &mut random), 3);
        let of = [&before.calibration, &full.calibration, &found.calibration];
        let [old, full, found] = of.map(|calibration| error(calibration, &test));
        // Without the update, errors are mostly ten to forty times as large.
        assert!(old > 2.0 * found, "{seed}: {old} {found}");
        println!("{seed}: as it was {old:.3}, 32 new poses {full:.3}, four {found:.3}");
        ratios.push(found / full);
    }
    ratios.sort_unstable_by(f64::total_cmp);
    println!("ratio: {ratios:.2?}");
    assert!(ratios[ratios.len() / 2] < 1.3, "{ratios:.2?}");
}

#[test]
fn an_unchanged_sensor_keeps_its_calibration() {
    let mut changed = 0;
    for seed in seeds() {
        let mut random = Random(1000 + seed);
        let state = State::new(seed);
        let before = fit(state.record(&loads(32, &mut random), 0));
        let mut few = loads(4, &mut random);
        few.push([0.0; 6]);
        let found = brought_up_to_date(&before, &state.record(&few, 1));
        match found.quantities.is_empty() {
            true => assert_eq!(found.calibration, before.calibration),
            false => changed += 1,
        }
    }
    // Fewer than one of twenty unchanged sensors reach the required evidence of 400 to 1 by chance.
    // Some do, because errors are not white noise.
    assert!(changed <= seeds().count().div_ceil(20), "{changed}");
}

fn csv(data: &Dataset) -> String {
    let mut text = String::from("group,s1,s2,s3,s4,s5,s6,s7,s8,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm\n");
    for (_, block) in data.blocks() {
        let labels =
            block.labels.iter().flat_map(|(label, rows)| std::iter::repeat_n(label, *rows));
        for (row, label) in labels.enumerate() {
            let columns = block.rows.readings.iter().chain(&block.rows.wrench);
            let values = columns.map(|column| column[row].to_string());
            writeln!(text, "{label},{}", values.collect::<Vec<_>>().join(",")).unwrap();
        }
    }
    text
}

#[test]
fn changes_are_reported_and_calibrations_of_any_kind_are_written() {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(dir.path().join(name), text).unwrap();
    let mut random = Random(5);
    let state = State::new(5);
    let now = state.changed((2e-3, 2_f64.to_radians(), 0.05), &mut random);
    write("train.csv", &csv(&state.record(&loads(80, &mut random), 0)));
    write("again.csv", &csv(&state.record(&loads(6, &mut random), 1)));
    write("few.csv", &csv(&now.record(&loads(6, &mut random), 2)));
    write("test.csv", &csv(&now.record(&loads(60, &mut random), 3)));
    for model in ["physics", "cubic", "poly3 --ridge 1e-4"] {
        succeed(&dir, &format!("fit train.csv --model {model} --cv -o old.json"));
        let said = json(&dir, "fit few.csv --from old.json -o new.json --json");
        assert_eq!(said["contradicted"], false, "{said}");
        let changed = said["changed"].as_array().unwrap();
        assert!(changed.iter().any(|of| of == "zeros" || of == "gains"), "{model}: {said}");
        let rms = |calibration: &str| {
            let said = json(&dir, &format!("eval {calibration} test.csv --json"));
            said["all"]["errors"][1]["rms"].as_f64().unwrap_or_else(|| panic!("{said}"))
        };
        let (old, new) = (rms("old.json"), rms("new.json"));
        assert!(old > 2.0 * new, "{model}: {old} {new}");
        succeed(&dir, "convert new.json test.csv -o forces.csv");
        succeed(&dir, "export new.json new.py");
        assert!(succeed(&dir, "doctor new.json").contains("ok"));
        let said = succeed(&dir, "fit again.csv --from old.json -o same.json");
        assert!(said.starts_with("unchanged: `old.json` explains the 6 loads"), "{said}");
        let read = |name: &str| fs::read_to_string(dir.path().join(name)).unwrap();
        assert_eq!(read("same.json"), read("old.json"));
    }
}

#[test]
fn loads_of_another_sensor_contradict_a_calibration_and_inconsistent_inputs_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(dir.path().join(name), text).unwrap();
    let mut random = Random(6);
    let log = csv(&State::new(6).record(&loads(32, &mut random), 0));
    write("train.csv", &log);
    succeed(&dir, "fit train.csv --model physics -o cal.json");
    // Another sensor, whose channels are connected in another order.
    let other = csv(&State::new(7).record(&loads(12, &mut random), 1));
    write("other.csv", &other.replace("s1,s2,s3,s4,s5,s6,s7,s8", "s7,s2,s5,s4,s3,s6,s1,s8"));
    let (_, told) = ended(&dir, "fit other.csv --from cal.json -o new.json", 1);
    assert!(told.contains("the loads contradict `cal.json`"), "{told}");
    assert!(!dir.path().join("new.json").exists());
    let without = |columns: usize| {
        let keep = |line: &str| line.rsplitn(columns + 1, ',').last().unwrap().to_owned();
        log.lines().map(keep).collect::<Vec<_>>().join("\n") + "\n"
    };
    write("forces.csv", &without(3));
    let said = refused(&dir, "fit forces.csv --from cal.json -o new.json");
    assert!(said.contains("`forces.csv`") && said.contains("Mx"), "{said}");
    let said = refused(&dir, "fit train.csv --from cal.json --model cubic");
    assert!(said.contains("cannot be used with"), "{said}");
    assert!(!dir.path().join("new.json").exists());
}
