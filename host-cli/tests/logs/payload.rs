//! The payload of a sensor: estimated from poses, subtracted from runs.

use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::fs;

use system_tests::program::{ended, json, refused, succeed};
use system_tests::random::Random;
use system_tests::real_recording;

fn numbers(value: &serde_json::Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|value| value.as_f64().unwrap()).collect()
}

/// A body of 0.25 kg at (10, −20, 30) mm on a sensor with an offset.
fn wrench_in(gravity: [f64; 3]) -> [f64; 6] {
    let [x, y, z] = gravity.map(|g| 0.25 * g);
    let c = [0.01, -0.02, 0.03];
    [
        x + 1.0,
        y - 2.0,
        z + 0.5,
        c[1] * z - c[2] * y + 0.1,
        c[2] * x - c[0] * z,
        c[0] * y - c[1] * x - 0.2,
    ]
}

fn directions(count: usize) -> impl Iterator<Item = [f64; 3]> {
    (0..count).map(|i| {
        let (a, b) = (0.7 * i as f64, 2.4 * i as f64);
        [a.cos() * b.cos(), a.cos() * b.sin(), a.sin()].map(|value| 9.81 * value)
    })
}

fn join(values: &[f64]) -> String {
    values.iter().map(f64::to_string).collect::<Vec<_>>().join(",")
}

/// All printed digits equal those of NumPy's least squares on the same 24 poses.
#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn a_tool_on_a_commercial_sensor_is_found_to_all_digits() {
    let dir = tempfile::tempdir().unwrap();
    let poses = real_recording("others/payload/0-calibration_fts-accel.csv");
    let found = json(dir.path(), &format!("payload fit {} --json", poses.display()));
    let digits = |value: f64, digits: usize| format!("{value:.digits$}");
    let all = |name: &str, decimals: usize| {
        numbers(&found[name]).iter().map(|value| digits(*value, decimals)).collect::<Vec<_>>()
    };
    assert_eq!(digits(found["mass_kg"].as_f64().unwrap(), 10), "0.9323080574");
    assert_eq!(all("force_bias_n", 6), ["9.076516", "-1.018148", "9.984755"]);
    assert_eq!(all("centre_m", 6), ["0.000279", "0.000054", "0.043896"]);
    assert_eq!(all("moment_bias_nm", 6), ["0.432505", "-0.691553", "-0.157035"]);
    assert_eq!(digits(found["residual_rms_n"].as_f64().unwrap(), 5), "0.08649");
    assert_eq!(digits(found["residual_rms_nm"].as_f64().unwrap(), 6), "0.003018");
    // Rotation matrices and the local gravity are named, because names alone would find the gravity columns first.
    let by_rotation =
        format!("payload fit {} --orientation 13-21 --gravity 9.82085 --json", poses.display());
    let by_rotation = json(dir.path(), &by_rotation);
    let (a, b) = (&by_rotation["mass_kg"], &found["mass_kg"]);
    // The matrices have six digits.
    assert!((a.as_f64().unwrap() / b.as_f64().unwrap() - 1.0).abs() < 1e-5, "{a} {b}");
    // With accelerations alone, the accelerometer adds a scale error of 2 % and a noise of 0.003 g.
    let text = fs::read_to_string(&poses).unwrap();
    let without: Vec<String> =
        text.lines().map(|line| line.split(',').take(9).collect::<Vec<_>>().join(",")).collect();
    fs::write(dir.path().join("accelerations.csv"), without.join("\n") + "\n").unwrap();
    let alone = json(dir.path(), "payload fit accelerations.csv --gravity 9.82085 --json");
    assert!((alone["mass_kg"].as_f64().unwrap() / 0.9323 - 1.0).abs() < 0.02, "{alone}");
    for (alone, known) in numbers(&alone["centre_m"]).iter().zip(numbers(&found["centre_m"])) {
        assert!((alone - known).abs() < 1e-3, "{alone} {known}");
    }
}

/// A prototype left 0.20, 0.07 and 0.09 N of the forces of an arm without contact, under a mean of 30 ms. A zero-phase
/// low-pass at 20 Hz halves the same frequency as that mean.
#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn weight_and_inertia_are_taken_off_a_moving_arm() {
    let dir = tempfile::tempdir().unwrap();
    let file = |name: &str| real_recording(&format!("others/payload/{name}"));
    let [poses, wrench, accelerations, orientations] = [
        "0-calibration_fts-accel.csv",
        "1-baseline_wrench.csv",
        "1-baseline_accel.csv",
        "1-baseline_orientations.csv",
    ]
    .map(|name| file(name).display().to_string());
    succeed(dir.path(), &format!("payload fit {poses} -o payload.json"));
    let subtract =
        format!("payload subtract payload.json {wrench} --time-unit us --json -o out.csv");
    let deviation = |options: &str| {
        let summary = json(dir.path(), &format!("{subtract} {options}"));
        let deviation = &summary["load"]["standard_deviation"];
        (["fx_n", "fy_n", "fz_n"].map(|axis| deviation[axis].as_f64().unwrap()), summary)
    };
    let (left, summary) = deviation(&format!("--motion {accelerations} --lowpass 20"));
    assert!(left[0] <= 0.22 && left[1] <= 0.08 && left[2] <= 0.10, "{left:?}");
    let lag_s = summary["load"]["lag"]["lag_s"].as_f64().unwrap();
    assert!((0.005..0.007).contains(&lag_s), "{lag_s}");
    println!("left at 20 Hz: {left:?} N; lag {:.2} ms", 1e3 * lag_s);
    // Only gravity is subtracted, without a filter, as in the README.
    let options = format!("--motion {orientations} --gravity 9.82085 --motion-lag 0 --no-lowpass");
    let (left, summary) = deviation(&options);
    for (left, expected) in left.into_iter().zip([1.218, 0.471, 0.372]) {
        assert!((left - expected).abs() < 6e-4, "{left} {expected}");
    }
    assert_eq!(summary["load"]["has_inertia"], false);
    let text = fs::read_to_string(dir.path().join("out.csv")).unwrap();
    assert!(text.starts_with("t_s,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm\n"));
    let rows = fs::read_to_string(&wrench).unwrap().lines().count();
    assert_eq!(text.lines().count(), rows);
}

/// Steps on the arm's tool, 1.3 a second and 10 N each, do not hide the lag of its accelerations.
#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn the_lag_of_a_moving_arm_is_found_under_contact() {
    let dir = tempfile::tempdir().unwrap();
    let [poses, wrench, accelerations] =
        ["0-calibration_fts-accel.csv", "1-baseline_wrench.csv", "1-baseline_accel.csv"]
            .map(|name| real_recording(&format!("others/payload/{name}")));
    succeed(dir.path(), &format!("payload fit {} -o payload.json", poses.display()));
    let text = fs::read_to_string(&wrench).unwrap();
    let (header, rows) = text.split_once('\n').unwrap();
    let mut touched = format!("{header}\n");
    for row in rows.lines() {
        let (time, wrench) = row.split_once(',').unwrap();
        let mut wrench: Vec<f64> = wrench.split(',').map(|field| field.parse().unwrap()).collect();
        let seconds = (time.parse::<u64>().unwrap() % 1_000_000_000) as f64 / 1e6;
        wrench[2] += 10.0 * (TAU * 1.3 * seconds).sin().max(0.0);
        writeln!(touched, "{time},{}", join(&wrench)).unwrap();
    }
    fs::write(dir.path().join("touched.csv"), touched).unwrap();
    let subtract = format!(
        "payload subtract payload.json touched.csv --time-unit us --motion {} --json -o out.csv",
        accelerations.display()
    );
    let (found, said) = ended(dir.path(), &subtract, 0);
    let found: serde_json::Value = serde_json::from_str(&found).unwrap();
    let lag = &found["load"]["lag"];
    let [lag_s, error_s] = ["lag_s", "standard_error_s"].map(|name| lag[name].as_f64().unwrap());
    assert_eq!(found["load"]["lag_taken_s"], lag["lag_s"]);
    println!("under contact: {:.2} ± {:.2} ms", 1e3 * lag_s, 1e3 * error_s);
    // 6.22 ms without contact; the steps change that by less than its standard error.
    assert!((lag_s - 0.00622).abs() < error_s && error_s < 0.002, "{lag}");
    assert!(said.contains("the lag of the motion uncertain") && said.contains("taken"), "{said}");
}

/// The sensor is turned through 12 directions in free air. With gravity upwards the weight would be added instead.
#[test]
fn a_weight_that_is_added_by_a_wrong_convention_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let log = |sign: f64| {
        let mut log = "t_s,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm,gx,gy,gz\n".to_owned();
        for (pose, gravity) in directions(12).enumerate() {
            let stated = gravity.map(|g| sign * g);
            writeln!(log, "{pose},{},{}", join(&wrench_in(gravity)), join(&stated)).unwrap();
        }
        log
    };
    fs::write(dir.path().join("right.csv"), log(1.0)).unwrap();
    fs::write(dir.path().join("upwards.csv"), log(-1.0)).unwrap();
    succeed(dir.path(), "payload fit right.csv -o payload.json");
    for (file, is_told) in [("right.csv", false), ("upwards.csv", true)] {
        let command = format!(
            "payload subtract payload.json {file} --orientation gx,gy,gz --no-lowpass -o o.csv"
        );
        let (_, said) = ended(dir.path(), &command, 0);
        assert_eq!(said.contains("--inverse-orientation"), is_told, "{said}");
    }
}

#[test]
fn moments_in_another_unit_are_named() {
    let dir = tempfile::tempdir().unwrap();
    for (unit, is_named) in [(1.0, false), (1e3, true)] {
        let mut log = "fx_n,fy_n,fz_n,mx,my,mz,gx,gy,gz\n".to_owned();
        for gravity in directions(12) {
            let mut wrench = wrench_in(gravity);
            wrench[3..].iter_mut().for_each(|moment| *moment *= unit);
            writeln!(log, "{},{}", join(&wrench), join(&gravity)).unwrap();
        }
        fs::write(dir.path().join("poses.csv"), log).unwrap();
        let (_, said) = ended(dir.path(), "payload fit poses.csv", 0);
        assert_eq!(said.contains("moments are probably in mN·m"), is_named, "{said}");
    }
}

#[test]
fn labelled_poses_are_averaged_and_set_the_standard_errors() {
    let dir = tempfile::tempdir().unwrap();
    let mut text = "Fx,Fy,Fz,Mx (mN·m),My (mN·m),Mz (mN·m),qx,qy,qz,qw,pose\n".to_owned();
    let mut random = Random(3);
    for (pose, angle) in (0..12).map(|pose| (pose, f64::from(pose) * 1.1)) {
        // The sensor is turned about x, then about the new y.
        let ((a, b), (c, d)) = ((angle / 2.0).sin_cos(), (0.8 * angle).sin_cos());
        let [qx, qy, qz, qw] = [a * d, b * c, a * c, b * d];
        let up =
            [2.0 * (qx * qz - qw * qy), 2.0 * (qy * qz + qw * qx), 1.0 - 2.0 * (qx * qx + qy * qy)];
        let mut wrench = wrench_in(up.map(|value| -9.806_65 * value));
        wrench[3..].iter_mut().for_each(|moment| *moment *= 1e3);
        for _ in 0..20 {
            let row = wrench.map(|value| value + 0.05 * (random.bits(10) as f64 / 512.0 - 1.0));
            writeln!(text, "{},{},p{pose}", join(&row), join(&[qx, qy, qz, qw])).unwrap();
        }
    }
    fs::write(dir.path().join("poses.csv"), text).unwrap();
    let found = json(dir.path(), "payload fit poses.csv --json -o payload.json");
    assert_eq!(found["poses"], 12);
    let file = fs::read_to_string(dir.path().join("payload.json")).unwrap();
    assert_eq!(serde_json::from_str::<serde_json::Value>(&file).unwrap(), found);
    let errors = &found["standard_errors"];
    let close = |found: &[f64], errors: &[f64], truth: &[f64]| {
        for ((found, error), truth) in found.iter().zip(errors).zip(truth) {
            // At 26 to 30 degrees of freedom, one error in 2,000 exceeds four standard errors.
            assert!((found - truth).abs() < 4.0 * error, "{found} ± {error}, {truth}");
        }
    };
    let mass = |value: &serde_json::Value| [value["mass_kg"].as_f64().unwrap()];
    close(&mass(&found), &mass(errors), &[0.25]);
    // The noise is 0.029 N; there are 12 poses of 20 rows.
    assert!(mass(errors)[0] < 5e-4, "{errors}");
    for (name, truth) in [
        ("centre_m", [0.01, -0.02, 0.03]),
        ("force_bias_n", [1.0, -2.0, 0.5]),
        ("moment_bias_nm", [0.1, 0.0, -0.2]),
    ] {
        close(&numbers(&found[name]), &numbers(&errors[name]), &truth);
    }
}

/// Six sensors, in counts, on a bouncing robot: without the payload, the contact remains.
#[test]
fn convert_takes_off_a_payload_before_tare_and_low_pass() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let write = |name: &str, text: String| fs::write(dir.join(name), text).unwrap();
    // An accelerometer in another frame, in g, with offsets.
    let says = |g: [f64; 3]| [0.02 - g[2] / 9.81, g[0] / 9.81 + 0.01, -g[1] / 9.81];
    let mut poses = "fx,fy,fz,mx,my,mz,gx,gy,gz,ax,ay,az\n".to_owned();
    for gravity in directions(14) {
        let row = [&wrench_in(gravity)[..], &gravity, &says(gravity)].concat();
        writeln!(poses, "{}", join(&row)).unwrap();
    }
    write("poses.csv", poses);
    succeed(dir, "payload fit poses.csv -o payload.json");
    // Readings are counts of 0.1 mN (0.1 mN·m); the calibration is fitted to them.
    let readings = |wrench: [f64; 6]| wrench.map(|value| (value * 1e4).round() + 5e4);
    let mut training = "s1,s2,s3,s4,s5,s6,fx,fy,fz,mx,my,mz\n".to_owned();
    let mut random = Random(11);
    for _ in 0..40 {
        let wrench: [f64; 6] = std::array::from_fn(|_| (random.bits(12) as f64 - 2048.0) / 1e3);
        writeln!(training, "{},{}", join(&readings(wrench)), join(&wrench)).unwrap();
    }
    write("training.csv", training);
    succeed(dir, "fit training.csv --model linear --covariance none -o cal.json");
    // Half a second without load, then a swing; contact pushes with 0.3 N from 3 s to 4 s.
    let mut run = "t,s1,s2,s3,s4,s5,s6,ax,ay,az\n".to_owned();
    let contact = |t: f64| if (3.0..4.0).contains(&t) { 0.3 } else { 0.0 };
    for i in 0..1500 {
        let t = f64::from(i) / 200.0;
        let swing = if t < 0.5 { 0.0 } else { (TAU * (t - 0.5)).sin() };
        let gravity = [3.0 * swing, -2.0 * swing, -9.81 + 4.0 * swing * swing];
        let mut wrench = wrench_in(gravity);
        wrench[0] += contact(t);
        let row = [&[t][..], &readings(wrench), &says(gravity)].concat();
        writeln!(run, "{}", join(&row)).unwrap();
    }
    write("run.csv", run);
    let left = |options: &str| {
        let (_, said) = ended(dir, &format!("convert cal.json run.csv {options} -o out.csv"), 0);
        let text = fs::read_to_string(dir.join("out.csv")).unwrap();
        let rows: Vec<Vec<f64>> = text
            .lines()
            .skip(1)
            .map(|line| line.split(',').take(7).map(|field| field.parse().unwrap()).collect())
            .collect();
        (rows, said)
    };
    let worst = |rows: &[Vec<f64>]| {
        let off = |row: &Vec<f64>| -> f64 {
            let other = row[2..].iter().map(|value| value.abs()).fold(0.0, f64::max);
            other.max((row[1] - contact(row[0])).abs())
        };
        rows.iter().map(off).fold(0.0, f64::max)
    };
    for tare in ["--tare 50", "--no-tare", "--tare-time 0:0.3"] {
        let (rows, said) = left(&format!("--payload payload.json {tare} --no-lowpass"));
        // The rounding error is half a count per reading, in the run and in the fits.
        assert!(worst(&rows) < 2e-4, "{tare}: {}", worst(&rows));
        assert!(said.contains("weight and inertia taken off"), "{said}");
    }
    let (rows, _) = left("--no-lowpass");
    assert!(worst(&rows) > 0.5, "the swing would be there");
    // The low-pass is linear: the payload goes first, and the corners of contact are rounded.
    let (rows, _) = left("--payload payload.json --lowpass 10");
    let quiet: Vec<Vec<f64>> =
        rows.into_iter().filter(|row| row[0] < 2.5 || row[0] > 4.5).collect();
    assert!(worst(&quiet) < 3e-4, "{}", worst(&quiet));
    // The accelerations come from a separate file, whose clock is 12.5 ms late.
    let run = fs::read_to_string(dir.join("run.csv")).unwrap();
    let motion: Vec<String> = run
        .lines()
        .skip(1)
        .map(|line| {
            let fields: Vec<f64> = line.split(',').map(|field| field.parse().unwrap()).collect();
            join(&[&[fields[0] + 0.0125][..], &fields[7..]].concat())
        })
        .collect();
    write("motion.csv", format!("t,ax,ay,az\n{}\n", motion.join("\n")));
    let (_, said) = left("--payload payload.json --motion motion.csv --no-lowpass");
    let late = said.split("its clock is ").nth(1).unwrap().split(' ').next().unwrap();
    assert!((late.parse::<f64>().unwrap() - 12.5).abs() < 0.5, "{said}");
    let (rows, _) =
        left("--payload payload.json --motion motion.csv --motion-lag 0.0125 --no-lowpass");
    // The first rows precede the motion, which is reported.
    assert!(worst(&rows) < 2e-4, "{}", worst(&rows));
    let said = refused(dir, "convert cal.json run.csv --motion motion.csv -o out.csv");
    assert!(said.contains("with `--payload` only"), "{said}");
}

#[test]
fn insufficient_poses_are_refused_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let header = "fx,fy,fz,mx,my,mz";
    let write = |name: &str, columns: &str, rows: &[Vec<f64>]| {
        let rows: Vec<String> = rows.iter().map(|row| join(row)).collect();
        fs::write(dir.join(name), format!("{header}{columns}\n{}\n", rows.join("\n"))).unwrap();
    };
    let row = |gravity: [f64; 3]| [&wrench_in(gravity)[..], &gravity].concat();
    let all: Vec<Vec<f64>> = directions(8).map(row).collect();
    write("none.csv", "", &all.iter().map(|row| row[..6].to_vec()).collect::<Vec<_>>());
    let said = refused(dir, "payload fit none.csv");
    assert!(
        said.contains("no columns of orientation") && said.contains("hint: name the"),
        "{said}"
    );
    write("few.csv", ",gx,gy,gz", &all[..3]);
    assert!(refused(dir, "payload fit few.csv").contains("`3` poses are too few"));
    write("still.csv", ",gx,gy,gz", &vec![all[0].clone(); 9]);
    let said = refused(dir, "payload fit still.csv");
    assert!(said.contains("neither mass nor centre") && said.contains("six directions"), "{said}");
    let up: Vec<Vec<f64>> = all
        .iter()
        .map(|row| [&row[..6], &row[6..].iter().map(|g| -g).collect::<Vec<_>>()].concat())
        .collect();
    write("up.csv", ",gx,gy,gz", &up);
    assert!(refused(dir, "payload fit up.csv").contains("does gravity point down"));
    let mut bent = all.clone();
    bent[4][6] *= 1.5;
    bent[4][7] += 2.0;
    write("bent.csv", ",gx,gy,gz", &bent);
    let said = refused(dir, "payload fit bent.csv --orientation gx,gy,gz");
    assert!(said.contains("`bent.csv`, data row 5: gravity is"), "{said}");
    assert!(refused(dir, "payload fit bent.csv").contains("no columns of orientation"));
    assert!(refused(dir, "payload fit up.csv --orientation gx,gy").contains("`2` columns of or"));
    assert!(refused(dir, "payload fit up.csv --accelerations gx").contains("`1` columns of acc"));
    let counts: Vec<Vec<f64>> = all
        .iter()
        .map(|row| [&row[..6], &row[6..].iter().map(|g| 1670.0 * g).collect::<Vec<_>>()].concat())
        .collect();
    write("counts.csv", ",ax,ay,az", &counts);
    assert!(refused(dir, "payload fit counts.csv").contains("neither m/s² nor multiples of g"));
    assert!(refused(dir, "payload fit none.csv missing.csv").contains("`missing.csv`"));
    write("all.csv", ",gx,gy,gz", &all);
    let (_, said) = ended(dir, "payload fit all.csv -o payload.json", 0);
    assert!(said.contains("no accelerometer"), "{said}");
    let timed: Vec<Vec<f64>> =
        counts.iter().enumerate().map(|(i, row)| [&row[..], &[i as f64]].concat()).collect();
    write("timed.csv", ",ax,ay,az,t", &timed);
    let said = refused(dir, "payload subtract payload.json timed.csv -o out.csv");
    assert!(said.contains("does not know the accelerometer's frame"), "{said}");
    assert!(refused(dir, "payload subtract all.csv timed.csv").contains("`all.csv`: line 1"));
    fs::write(dir.join("other.json"), "{\"schema_version\": 1}").unwrap();
    assert!(refused(dir, "payload subtract other.json timed.csv").contains("it is no payload"));
    assert!(!dir.join("out.csv").exists());
}
