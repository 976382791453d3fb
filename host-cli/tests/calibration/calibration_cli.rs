//! `shellcal fit`, `eval` and `import`: results, failures, exit codes.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use system_tests::program::{self, ended, json, refused, succeed};
use system_tests::random::Random;
use system_tests::real_recording;
use tempfile::TempDir;

const HEADER: &str = "s1,s2,s3,s4,s5,s6,s7,s8,Fx_N,Fy_N,Fz_N,Mx_Nm,My_Nm,Mz_Nm";

/// Pseudo-random readings in 0..4096, the same on every machine.
fn readings(row: usize) -> [f64; 8] {
    let mut random = Random(row as u64);
    std::array::from_fn(|_| random.bits(12) as f64)
}

/// A cubic function of the readings, plus `noise` of alternating sign.
fn wrench(s: &[f64; 8], noise: f64, row: usize) -> [f64; 6] {
    let sign = if row.is_multiple_of(2) { noise } else { -noise };
    std::array::from_fn(|axis| {
        let z = |i: usize| s[i % 8] / 4096.0;
        z(axis) + 0.5 * z(axis + 1).powi(2) - 0.25 * z(axis + 2).powi(3) + 0.125 + sign
    })
}

/// A log of such rows, with readings changed by `change`.
fn log(rows: usize, noise: f64, change: impl Fn(&mut [f64; 8])) -> String {
    let mut text = format!("{HEADER}\n");
    for row in 0..rows {
        let mut s = readings(row);
        change(&mut s);
        let fields: Vec<String> =
            s.iter().chain(&wrench(&s, noise, row)).map(f64::to_string).collect();
        writeln!(text, "{}", fields.join(",")).unwrap();
    }
    text
}

fn with_files(files: &[(&str, &str)]) -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    for (name, text) in files {
        fs::write(dir.path().join(name), text).unwrap();
    }
    dir
}

#[test]
fn a_model_that_holds_exactly_is_found_exactly() {
    let dir =
        with_files(&[("train.csv", &log(400, 0.0, |_| ())), ("test.csv", &log(50, 0.0, |_| ()))]);
    let report = json(&dir, "fit --model cubic train.csv --test test.csv -o cal.json --json");
    assert_eq!(report["rank"], 25);
    assert_eq!(report["rows"], 400);
    for set in ["train", "test"] {
        for axis in 0..6 {
            // Wrenches of about 1, their decimal text read to 2⁻⁵³.
            assert!(report[set][axis]["rms"].as_f64().unwrap() < 1e-14);
            assert!(report[set][axis]["r_squared"].as_f64().unwrap() > 1.0 - 1e-14);
        }
    }
    let evaluated = json(&dir, "eval cal.json test.csv --json --max-rms 1e-12");
    assert_eq!(evaluated["all"]["errors"], report["test"]);
}

#[test]
fn the_table_names_axes_figures_and_rows() {
    let rows = log(400, 0.01, |_| ());
    let test: String = rows.lines().take(300).map(|line| format!("{line}\n")).collect();
    let dir = with_files(&[("train.csv", &rows), ("test.csv", &test)]);
    let text = succeed(&dir, "fit --model cubic train.csv --test test.csv --verbose");
    for word in ["RMS train", "RMS test", "max train", "R² test", "Fx", "Mz", "N·m"] {
        assert!(text.contains(word), "{word} in {text}");
    }
    assert!(text.contains("cubic + offset, solver exact: rank 25 of 25"), "{text}");
    assert!(text.contains("400 rows used, 0 skipped, 0 repeated"), "{text}");
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let text = log(30_000, 0.01, |_| ());
    let dir = with_files(&[("train.csv", &text)]);
    let bytes = |threads: usize| {
        let arguments =
            format!("fit --model cubic train.csv --threads {threads} -o {threads}.json");
        succeed(&dir, &arguments);
        fs::read(dir.path().join(format!("{threads}.json"))).unwrap()
    };
    let one = bytes(1);
    assert_eq!(bytes(2), one);
    assert_eq!(bytes(7), one);
}

#[test]
fn an_exported_matrix_imports_to_the_same_wrench() {
    let dir = with_files(&[("train.csv", &log(400, 0.01, |_| ()))]);
    let fitted = json(&dir, "fit --model cubic train.csv -o cal.json --export-matrix m.csv --json");
    succeed(&dir, "import m.csv -o imported.json");
    let evaluated = json(&dir, "eval imported.json train.csv --json");
    for axis in 0..6 {
        let rms = |report: &serde_json::Value| report[axis]["rms"].as_f64().unwrap();
        let (a, b) = (rms(&fitted["train"]), rms(&evaluated["all"]["errors"]));
        // Terms of some 1 N, rounded at 2⁻⁵³, against a residual of 0.01 N.
        assert!((a / b - 1.0).abs() < 1e-12, "{a} {b}");
    }
}

#[test]
fn a_calibration_is_exported_as_the_matrix_of_its_fit_and_as_code() {
    let dir = with_files(&[("train.csv", &log(400, 0.01, |_| ()))]);
    succeed(&dir, "fit --model cubic train.csv -o cal.json --export-matrix m.csv");
    let export = |file: &str| {
        succeed(&dir, &format!("export cal.json {file}"));
        std::fs::read_to_string(dir.path().join(file)).unwrap()
    };
    assert_eq!(export("again.csv"), export("m.csv"));
    // The Python package tests the result of the code.
    assert!(export("shell_wrench.m").starts_with("function w = shell_wrench(readings)\n"));
    assert!(export("shell_wrench.py").contains("from shell_wrench import wrench"));
    assert!(refused(&dir, "export cal.json 7.m").contains("`7` cannot be the name of a function"));
    assert!(refused(&dir, "export cal.json c.txt").contains("in none of `.py`, `.m` and `.csv`"));
}

#[test]
fn a_limit_that_is_exceeded_is_exit_code_1() {
    let dir = with_files(&[("train.csv", &log(400, 0.01, |_| ()))]);
    succeed(&dir, "fit --model cubic train.csv -o cal.json");
    succeed(&dir, "eval cal.json train.csv --max-rms 0.02 --max-rms-moment 0.02");
    ended(&dir, "eval cal.json train.csv --max-rms-moment 0.001", 1);
    let (_, error) = ended(&dir, "eval cal.json train.csv --max-rms 0.001", 1);
    assert!(error.contains("the RMS error of `Fx`"), "{error}");
    // Sound data, whose errors are some 0.07 N.
    let sound = concat!(env!("CARGO_MANIFEST_DIR"), "/../calibration-data/synthetic-train.csv");
    let (printed, _) = ended(&dir, &format!("fit {sound} --max-rms 0.01"), 1);
    assert!(printed.starts_with("NOT OK: above the limit: Fx, Fy, Fz\n"), "{printed}");
    let (printed, _) = ended(&dir, &format!("fit {sound} --max-rms 0.2"), 0);
    assert!(printed.starts_with("OK"), "{printed}");
}

#[test]
fn a_rank_loss_names_the_channels_and_a_hint() {
    let dir = with_files(&[
        ("constant.csv", &log(400, 0.01, |s| s[2] = 1234.0)),
        ("twice.csv", &log(400, 0.01, |s| s[1] = 2.0 * s[0])),
        ("shifted.csv", &log(400, 0.01, |s| s[7] = 0.5 * s[4] + 100.0)),
        ("same.csv", &log(400, 0.01, |s| *s = [100.0; 8])),
        ("few.csv", &log(24, 0.01, |_| ())),
        ("coarse.csv", &log(400, 0.01, |s| s[3] = f64::from(s[3] > 2000.0))),
    ]);
    let cases = [
        ("fit --model cubic constant.csv", "channel `s3` is constant (always `1234`)", "--ridge"),
        (
            "fit --model cubic twice.csv",
            "channels `s1` and `s2` are proportional (s2 = 2·s1)",
            "--ridge",
        ),
        ("fit --model cubic twice.csv --no-intercept", "(s2 = 2·s1)", "--ridge"),
        (
            "fit --model cubic shifted.csv",
            "`s5` and `s8` move as one (s8 = 0.5·s5 + 100)",
            "--ridge",
        ),
        ("fit --model cubic same.csv", "all `400` rows have the same readings", "cable"),
        ("fit --model cubic few.csv", "`24` rows are too few for the `25` coefficients", "--model"),
        ("fit --model cubic coarse.csv", "`s4", "--ridge"),
    ];
    for (arguments, expected, hint) in cases {
        let error = refused(&dir, &format!("{arguments} -o cal.json"));
        assert!(error.contains(expected), "{arguments}: {error}");
        assert!(error.contains("hint: ") && error.contains(hint), "{arguments}: {error}");
    }
    let damped = json(&dir, "fit --model cubic twice.csv --ridge 1e-9 --json");
    assert_eq!(damped["rank"], 22);
    assert!((damped["train"][4]["rms"].as_f64().unwrap() - 0.01).abs() < 1e-3);
}

#[test]
fn outputs_that_cannot_be_written_are_found_before_the_work() {
    let dir = with_files(&[("train.csv", &log(400, 0.01, |_| ()))]);
    for flag in ["--output", "--export-matrix"] {
        let error = refused(&dir, &format!("fit --model cubic train.csv {flag} missing/out"));
        assert!(error.contains("cannot write `missing/out`"), "{error}");
    }
    let error = refused(&dir, "fit --model cubic train.csv --plot figure.gif");
    assert!(error.contains("`figure.gif`"), "{error}");
    let error = refused(&dir, "fit --model cubic missing.csv -o cal.json");
    assert!(error.contains("missing.csv"), "{error}");
    let error = refused(&dir, "fit --model cubic train.csv --ridge=-1");
    assert!(error.contains("ridge parameter is `-1`"), "{error}");
}

#[test]
fn calibrations_that_do_not_fit_are_refused() {
    let dir = with_files(&[("train.csv", &log(400, 0.01, |_| ()))]);
    succeed(&dir, "fit --model cubic train.csv -o cal.json");
    let calibration = fs::read_to_string(dir.path().join("cal.json")).unwrap();
    let write = |name: &str, text: &str| fs::write(dir.path().join(name), text).unwrap();
    write("later.json", &calibration.replace("\"schema_version\": 4", "\"schema_version\": 9"));
    write("field.json", &calibration.replace("\"scaling\"", "\"scalling\""));
    write("cut.json", &calibration[..calibration.len() / 2]);
    write("not.json", "s1,s2\n1,2\n");
    let cases = [
        ("eval later.json train.csv", "its schema version is `9`", "later"),
        ("eval field.json train.csv", "missing field `scaling`", ""),
        ("eval cut.json train.csv", "line ", "`shellcal fit`"),
        ("eval not.json train.csv", "line 1, column 1: not valid JSON", "shellcal import"),
        ("eval missing.json train.csv", "`missing.json`: cannot read it", ""),
        (
            "eval cal.json train.csv --sensors s1,s2,s3",
            "has `3` sensor channels, expected `8`",
            "--sensors",
        ),
    ];
    for (arguments, expected, hint) in cases {
        let error = refused(&dir, arguments);
        assert!(error.contains(expected), "{arguments}: {error}");
        assert!(error.contains(hint), "{arguments}: {error}");
    }
    write("matrix.csv", "1,2\n3,4\n");
    let error = refused(&dir, "import matrix.csv -o imported.json");
    assert!(error.contains("`matrix.csv`: it is `2` by `2`"), "{error}");
}

#[test]
fn an_edited_calibration_needs_an_option_and_an_impossible_one_is_refused() {
    let train = log(400, 0.01, |_| ());
    let dir = with_files(&[("train.csv", &train)]);
    succeed(&dir, "fit train.csv --model linear -o cal.json");
    let text = fs::read_to_string(dir.path().join("cal.json")).unwrap();
    let write = |name: &str, text: &str| fs::write(dir.path().join(name), text).unwrap();
    let document: serde_json::Value = serde_json::from_str(&text).unwrap();
    // Version control of Windows changes line ends, and nothing else.
    write("crlf.json", &text.replace('\n', "\r\n"));
    succeed(&dir, "convert crlf.json train.csv -o out.csv");

    let edited = |change: &dyn Fn(&mut serde_json::Value)| {
        let mut document = document.clone();
        change(&mut document);
        serde_json::to_string_pretty(&document).unwrap() + "\n"
    };
    let slightly = edited(&|it| it["coefficients"][1][0] = 0.125.into());
    let unsealed = edited(&|it| drop(it.as_object_mut().unwrap().remove("checksum")));
    let old = edited(&|it| {
        it["schema_version"] = 1.into();
        it["coefficients"][1][0] = 0.125.into();
    });
    for (name, text) in
        [("slightly.json", slightly), ("unsealed.json", unsealed), ("old.json", old)]
    {
        write(name, &text);
        for command in [
            "convert CAL train.csv -o out.csv",
            "eval CAL train.csv",
            "info train.csv --noise --calibration CAL",
            "info train.csv --drift --calibration CAL",
            "export CAL out.py",
        ] {
            let error = refused(&dir, &command.replace("CAL", name));
            assert!(error.contains("it is not what was written"), "{error}");
            assert!(error.contains("if you have edited it, say so with `--edited`"), "{error}");
        }
        succeed(&dir, &format!("convert {name} train.csv --edited -o out.csv"));
        let found = program::run(dir.path(), &format!("doctor {name}"), 1);
        assert!(found.contains("it is not what was written"), "{found}");
    }

    // A file that claims to be older than checksums.
    let before = edited(&|it| {
        it["schema_version"] = 1.into();
        it["coefficients"][1][0] = 0.125.into();
        drop(it.as_object_mut().unwrap().remove("checksum"));
    });
    write("before.json", &before);
    for command in [
        "convert before.json train.csv -o out.csv",
        "eval before.json train.csv --against cal.json",
        "eval cal.json train.csv --against before.json",
        "eval before.json train.csv",
        "info train.csv --noise --calibration before.json",
        "export before.json out.py",
    ] {
        let error = refused(&dir, command);
        assert!(error.contains("version `1` has no checksum"), "{command}: {error}");
        assert!(error.contains("say so with `--edited`"), "{command}: {error}");
        succeed(&dir, &format!("{command} --edited"));
    }
    for command in [
        "fit train.csv --from CAL",
        "plan --box fx=-5..5,fy=-5..5,fz=-9..0,mx=-1..1,my=-1..1,mz=-1..1 CAL",
        "doctor train.csv --calibration CAL",
    ] {
        let command = command.replace("CAL", "before.json");
        let error = refused(&dir, &command);
        assert!(error.contains("say so with `--edited`"), "{command}: {error}");
        // The file is read, even if another step fails later.
        let output = program::output(dir.path(), &format!("{command} --edited"));
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(!said.contains("checksum"), "{command}: {said}");
    }
    let found = program::run(dir.path(), "doctor before.json", 1);
    assert!(found.contains("version `1` has no checksum"), "{found}");

    type Change = fn(&mut serde_json::Value);
    let impossible: [(Change, &str); 4] = [
        (|it| it["scaling"]["centre"][0] = 1e300.into(), "the centre of channel 1 is `1e300`"),
        (|it| it["coefficients"][1][0] = 1e99.into(), "`Fx` reaches"),
        (|it| it["coefficients"][0][5] = (-1e60).into(), "`Mz` reaches"),
        (|it| it["valid_range"][2]["max"] = 1e300.into(), "reaches"),
    ];
    for (change, expected) in impossible {
        for version in [1, 4] {
            write(
                "bad.json",
                &edited(&|it| {
                    change(it);
                    it["schema_version"] = version.into();
                }),
            );
            for command in [
                "convert bad.json train.csv --edited -o out.csv",
                "info train.csv --noise --calibration bad.json --edited",
            ] {
                let error = refused(&dir, command);
                assert!(error.contains("it cannot be a calibration: "), "{error}");
                assert!(error.contains(expected), "{error}");
            }
            let found = program::run(dir.path(), "doctor bad.json", 1);
            assert!(found.contains("cannot be"), "{found}");
        }
    }
}

#[test]
fn repeated_rows_are_counted_and_left_out_on_request() {
    let text = log(300, 0.01, |_| ());
    let (header, rows) = text.split_once('\n').unwrap();
    let twice: String = rows.lines().map(|row| format!("{row}\n{row}\n")).collect();
    let dir = with_files(&[("train.csv", &format!("{header}\n{twice}"))]);
    let all = json(&dir, "fit --model cubic train.csv --json");
    assert_eq!((&all["rows"], &all["repeated_rows"]), (&600.into(), &300.into()));
    let fresh = json(&dir, "fit --model cubic train.csv --fresh --json");
    assert_eq!((&fresh["rows"], &fresh["repeated_rows"]), (&300.into(), &300.into()));
}

#[test]
fn the_unit_of_a_matrix_without_units_is_told() {
    let rows: String = (0..8).map(|row| format!("{row},1,2,3,4,5\n")).collect();
    let dir = with_files(&[("bare.csv", &rows)]);
    let (_, said) = ended(&dir, "import bare.csv -o assumed.json", 0);
    assert!(said.contains("its moments are taken as mN·m"), "{said}");
    let (_, said) = ended(&dir, "import bare.csv -o named.json --moment-unit mNm", 0);
    assert!(!said.contains("taken as"), "{said}");
    let of = |name| {
        let file = calibration_file::CalibrationFile::read(&dir.path().join(name)).unwrap();
        file.calibration
    };
    assert_eq!(of("assumed.json"), of("named.json"));
    // The header of an export has units.
    succeed(&dir, "export named.json matrix.csv");
    let (_, said) = ended(&dir, "import matrix.csv -o again.json", 0);
    assert!(!said.contains("taken as"), "{said}");
}

#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn the_lab_s_matrices_in_both_formats_make_the_same_calibration() {
    let matrix = |extension| real_recording(&format!("skinproc/N_matrix_trial9.{extension}"));
    let (csv, mat) = (matrix("csv"), matrix("mat"));
    let dir = tempfile::tempdir().unwrap();
    let import = |matrix: &Path| {
        let output = dir.path().join("cal.json");
        let arguments = [Path::new("import"), matrix, Path::new("-o"), &output];
        let status = program::command(dir.path()).args(arguments).output().unwrap();
        assert!(status.status.success());
        calibration_file::CalibrationFile::read(&output).unwrap().calibration
    };
    let calibration = import(&csv);
    assert_eq!(import(&mat), calibration);
    assert_eq!(calibration.name(), "cubic");
    // The first line of the file, moments in mN·m.
    let expected = [-0.0036893645001891415, -0.011788310916859727, -0.0054612987129912085];
    assert_eq!(calibration.polynomial().unwrap().coefficients[0][..3], expected);
    assert_eq!(calibration.polynomial().unwrap().coefficients[0][3], 0.36303638238128627 / 1e3);
}

#[test]
fn truncation_solves_rank_deficient_problems_and_reports_it() {
    let dir = with_files(&[("log.csv", &log(400, 1e-3, |s| s[1] = s[0]))]);
    let error = refused(&dir, "fit log.csv --model linear --solver svd");
    assert!(error.contains("only `8` of `9` features"), "{error}");
    let truncate = "fit log.csv --model linear --solver svd --truncate 1e-8 --json";
    let (printed, said) = ended(&dir, truncate, 0);
    assert!(said.contains("1 direction"), "{said}");
    let fitted: serde_json::Value = serde_json::from_str(&printed).unwrap();
    assert_eq!(fitted["rank"], 8);
    let error = refused(&dir, "fit --model cubic log.csv --truncate 1e-8");
    assert!(error.contains("`--truncate` is for `--solver svd`"), "{error}");
    let error = refused(&dir, "fit --model cubic log.csv --solver svd --truncate 1");
    assert!(error.contains("a share from 0 to 1"), "{error}");
}

#[test]
fn a_solver_that_only_judges_others_is_refused_and_another_named() {
    let dir = with_files(&[("log.csv", &log(400, 1e-3, |_| {}))]);
    for (solver, instead) in
        [("gram", "`exact`"), ("wide-tsqr", "`exact`"), ("pivoted-qr", "`svd`")]
    {
        let error = refused(&dir, &format!("fit log.csv --model linear --solver {solver}"));
        assert!(error.contains(&format!("use {instead}")), "{error}");
    }
}

#[test]
fn a_load_whose_square_overflows_is_refused_with_its_place() {
    let train = log(400, 1e-3, |_| {});
    let (rows, last) = train.trim_end().rsplit_once(',').unwrap();
    let corrupt = format!("{rows},{last}e300\n");
    let dir = with_files(&[("train.csv", &train), ("corrupt.csv", &corrupt)]);
    succeed(&dir, "fit --model cubic train.csv -o cal.json");
    let said = refused(&dir, "eval cal.json corrupt.csv --max-rms-moment 1e9");
    assert!(said.contains("`corrupt.csv`, line 401: column 14 (`Mz_Nm`)"), "{said}");
}

/// An optional value needs an equals sign; otherwise it is taken for a file.
#[test]
fn an_option_value_mistaken_for_a_file_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    // An interval needs twenty poses.
    program::run(dir, "synth train --rows 5000 -o train.csv", 0);
    program::run(dir, "fit --model linear train.csv -o cal.json", 0);
    for (command, joined) in [
        ("convert cal.json train.csv --interval 95 -o out.csv", "`--interval=95`"),
        ("convert cal.json --interval 95 train.csv -o out.csv", "`--interval=95`"),
        ("fit --model cubic train.csv --cv 5", "`--cv=5`"),
    ] {
        let said = program::run(dir, command, 2);
        assert!(said.contains("is no file") && said.contains(joined), "{command}: {said}");
    }
    // If a file has that name, the value means the file.
    fs::copy(dir.join("train.csv"), dir.join("95")).unwrap();
    program::run(dir, "convert cal.json --interval 95 -o out.csv", 0);
    let said = program::run(dir, "convert cal.json 96 --interval", 2);
    assert!(said.contains("cannot read `96`"), "{said}");
}
