//! `shellcal bench` as a user meets it.

use system_tests::program;

#[test]
fn solvers_are_compared_on_rows_of_the_sensor_model_and_drawn() {
    let dir = tempfile::tempdir().unwrap();
    let arguments = "bench --rows 2000 --model linear,cubic --json --plot bench.svg";
    let benches = program::json(dir.path(), arguments);
    assert_eq!(
        (&benches[0]["model"], &benches[1]["model"]),
        (&"linear + offset".into(), &"cubic + offset".into())
    );
    for bench in benches.as_array().unwrap() {
        let solvers = bench["solvers"].as_array().unwrap();
        let of = |name: &str| solvers.iter().find(|m| m["solver"] == name).unwrap();
        assert!(solvers.iter().all(|m| m["seconds"].as_f64().unwrap() > 0.0));
        // Every digit of an `f64`, but for the last rounding.
        for name in ["exact", "refined-tsqr", "wide-gram"] {
            assert!(of(name)["coefficient_error"].as_f64().unwrap() < 5e-16, "{name}");
        }
        assert!(of("gram")["prediction_error"].as_f64().unwrap() < 1e-9);
        // Another question than least squares.
        assert!(of("huber")["coefficient_error"].is_null());
        assert!(solvers.iter().any(|m| m["on_front"] == true));
    }
    for name in ["bench.svg", "bench-prediction.svg"] {
        let svg = std::fs::read_to_string(dir.path().join(name)).unwrap();
        assert!(svg.starts_with("<svg") && svg.contains("front of cubic + offset"), "{name}");
    }
}

#[test]
fn a_model_that_the_rows_do_not_determine_is_left_out_with_the_reason() {
    let dir = tempfile::tempdir().unwrap();
    let output =
        program::output(dir.path(), "bench --rows 100 --model linear,poly3 --solver exact,gram");
    let (stdout, stderr) =
        (String::from_utf8(output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap());
    assert!(output.status.success());
    assert!(
        stderr
            .contains("warning: poly3 + offset: `100` rows are too few for the `165` coefficients")
    );
    assert!(stdout.contains("linear + offset: 9 features, 100 rows") && !stdout.contains("poly3"));
    program::refused(dir.path(), "bench --rows 100 --model poly3");
}
