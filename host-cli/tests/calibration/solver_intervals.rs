//! Standard errors and intervals by group, whatever the solver.
use std::path::Path;

use serde_json::Value;
use system_tests::program;

const SOLVERS: [&str; 6] = ["exact", "tsqr", "svd", "svd --truncate 1e-9", "ridge-gcv", "huber"];

/// The covariance in the calibration file of a fit of the shipped set's first groups, and the root mean square of
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
                // The same least squares except for rounding: the ridge chosen by GCV for a well-conditioned
                // fit is nearly zero. A robust fit has other weights.
                let tolerance = if solver == "huber" { 0.5 } else { 0.02 };
                assert!((found / exact - 1.0).abs() < tolerance, "{solver}: {found} {exact}");
            }
        }
    }
}
