//! Standard errors and intervals by group, whatever the solver.
use std::path::Path;

use serde_json::Value;
use system_tests::{program, real_recording};

const SOLVERS: [&str; 6] = ["exact", "tsqr", "svd", "svd --truncate 1e-9", "ridge-gcv", "huber"];

/// Returns the covariance in a fit of the shipped set's first groups, and the root mean square of
/// the standard errors of Fx on its rows.
fn covariance(directory: &Path, solver: &str) -> (Value, f64) {
    let arguments = format!("fit train.csv --model linear --solver {solver} -o cal.json");
    let output = program::output(directory, &arguments);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{solver}: {said}");
    assert!(!said.contains("rows as independent"), "{solver}: {said}");
    let file = std::fs::read(directory.join("cal.json")).unwrap();
    let document: Value = serde_json::from_slice(&file).unwrap();
    let convert = "convert cal.json train.csv --columns fx,se --no-tare --no-lowpass -o out.csv";
    program::succeed(directory, convert);
    let text = std::fs::read_to_string(directory.join("out.csv")).unwrap();
    let position =
        text.lines().next().unwrap().split(',').position(|name| name == "fx_se_n").unwrap();
    let errors: Vec<f64> = (text.lines().skip(1))
        .map(|line| line.split(',').nth(position).unwrap().parse().unwrap())
        .collect();
    let square = errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64;
    (document["covariance"].clone(), square.sqrt())
}

#[test]
fn every_solver_has_intervals_from_groups_that_were_held_out() {
    let directory = tempfile::tempdir().unwrap();
    let shipped =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../calibration-data/synthetic-train.csv");
    let text = std::fs::read_to_string(shipped).unwrap();
    let group = text.lines().next().unwrap().split(',').position(|name| name == "group").unwrap();
    let is_early = |line: &&str| {
        line.split(',').nth(group).unwrap().parse::<f64>().is_ok_and(|group| group < 40.0)
    };
    let header = text.lines().take(1);
    let lines: Vec<&str> = header.chain(text.lines().skip(1).filter(is_early)).collect();
    std::fs::write(directory.path().join("train.csv"), lines.join("\n") + "\n").unwrap();
    let (exact, exact_error) = covariance(directory.path(), "exact");
    for solver in SOLVERS {
        let (found, error) = covariance(directory.path(), solver);
        let tolerance = if solver == "huber" { 0.2 } else { 1e-3 };
        assert!((error / exact_error - 1.0).abs() < tolerance, "{solver}: {error} {exact_error}");
        assert_eq!(found["degrees_of_freedom"], exact["degrees_of_freedom"], "{solver}");
        assert_eq!(found["intervals"]["groups"], exact["intervals"]["groups"], "{solver}");
        for axis in 0..6 {
            let factors = |of: &Value| -> Vec<f64> {
                let of = of["intervals"]["factors"].as_array().unwrap()[axis].as_array().unwrap();
                of.iter().map(|x| x.as_f64().unwrap()).collect()
            };
            let pairs = factors(&found).into_iter().zip(factors(&exact));
            for (found, exact) in pairs {
                // The same least squares except for rounding: GCV chooses nearly no ridge for a
                // well-conditioned fit. A robust fit has other weights.
                let tolerance = if solver == "huber" { 0.5 } else { 0.02 };
                assert!((found / exact - 1.0).abs() < tolerance, "{solver}: {found} {exact}");
            }
        }
    }
}

/// Compares the coefficients' degrees of freedom with `coef_test(lm(…), vcov = "CR2", cluster =
/// group, test = "Satterthwaite")` of clubSandwich 0.5.8 in R 4.2.2.
fn check_degrees(directory: &Path, arguments: &str, expected: &[Option<f64>]) {
    for solver in ["exact", "tsqr"] {
        let output = program::output(
            directory,
            &format!("fit {arguments} --solver {solver} -o cal.json --json -q"),
        );
        let said: Value = serde_json::from_slice(&output.stdout).unwrap();
        let found = said["covariance"]["coefficient_degrees_of_freedom"].as_array().unwrap();
        assert_eq!(found.len(), expected.len(), "{solver}");
        for (found, expected) in found.iter().zip(expected) {
            let Some(expected) = expected else { continue };
            let found = found.as_f64().unwrap();
            // R loses six of sixteen digits on thousands of counts that vary by some hundred.
            assert!((found / expected - 1.0).abs() < 1e-8, "{arguments} {solver}: {said}");
        }
    }
}

/// Twelve groups of 1, 3, 5 and 7 rows, from remainders that R computes as well.
#[test]
fn coefficients_have_the_degrees_of_freedom_of_club_sandwich() {
    let directory = tempfile::tempdir().unwrap();
    let mut text = "t_s,s1,s2,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm,group\n".to_owned();
    let groups = (0..12_u64).flat_map(|g| std::iter::repeat_n(g, 1 + (g as usize % 4) * 2));
    for (row, g) in groups.enumerate() {
        let r = row as u64;
        let first = 1000 + (g * g * 37) % 211 + (r * 29) % 17;
        let second = 900 + (g * 83) % 157 + (r * r * 13) % 23;
        let load =
            0.01 * first as f64 + ((g * 71) % 19) as f64 / 10.0 + ((r * 31) % 11) as f64 / 20.0;
        let loads = format!(",{load}").repeat(6);
        text += &format!("{:.1},{first},{second}{loads},{g}\n", 0.1 * r as f64);
    }
    std::fs::write(directory.path().join("train.csv"), text).unwrap();
    // The intercept and lower orders depend on the centre of the readings.
    let linear = [Some(6.160_397_831_450_81), Some(5.049_183_435_416_94), None];
    check_degrees(directory.path(), "train.csv --model linear", &linear);
    let highest = [3.575_426_651_602_18, 3.537_147_642_166_31, 3.792_126_940_157_3].map(Some);
    let quadratic = [&[None, None][..], &highest, &[None]].concat();
    check_degrees(directory.path(), "train.csv --model quadratic", &quadratic);
}

/// The slopes of 32 real poses have far fewer degrees of freedom than poses.
#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn slopes_of_real_poses_have_the_degrees_of_freedom_of_club_sandwich() {
    let slopes = [
        4.909_653_749_04,
        6.225_333_040_36,
        5.908_067_785_53,
        7.163_724_432_25,
        4.778_173_017,
        5.188_504_229_18,
        7.920_711_953_06,
        7.094_406_386_49,
    ];
    let directory = tempfile::tempdir().unwrap();
    let poses = real_recording("others/photointerrupters/poses.csv");
    std::fs::copy(poses, directory.path().join("poses.csv")).unwrap();
    let expected = [&slopes.map(Some)[..], &[None]].concat();
    check_degrees(directory.path(), "poses.csv --group pose --model linear", &expected);
}
