//! `fit --partial` and `merge`: parts of a fit, put together, are the whole.

use std::fs;
use std::process::Output;

use system_tests::program;
use tempfile::TempDir;

fn shellcal(dir: &TempDir, arguments: &str) -> Output {
    program::output(dir.path(), arguments)
}

fn done(dir: &TempDir, arguments: &str) -> Output {
    let output = shellcal(dir, arguments);
    let error = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{arguments}: {error}");
    output
}

fn refused(dir: &TempDir, arguments: &str) -> String {
    let output = shellcal(dir, arguments);
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{arguments}: {error}");
    error
}

fn json(dir: &TempDir, name: &str) -> serde_json::Value {
    serde_json::from_str(&fs::read_to_string(dir.path().join(name)).unwrap()).unwrap()
}

/// Three recordings of different lengths.
fn recordings() -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    for (seed, rows) in [(1, 900), (2, 1700), (3, 400)] {
        done(&dir, &format!("synth train --rows {rows} --rate 10 --seed {seed} -o {seed}.csv"));
    }
    dir
}

#[test]
fn merged_parts_are_the_fit_over_all_files_bit_for_bit_in_any_grouping() {
    let dir = recordings();
    for model in ["--model cubic", "--model poly3", "--model quadratic --no-intercept"] {
        // Sums know nothing of groups.
        let by_rows = "--covariance rows -o whole.json";
        done(&dir, &format!("fit 1.csv 2.csv 3.csv {model} {by_rows}"));
        for file in 1..=3 {
            done(&dir, &format!("fit {file}.csv {model} --partial {file}.json"));
        }
        done(&dir, "merge 1.json 2.json 3.json -o all.json");
        done(&dir, "merge 3.json 2.json --partial late.json");
        done(&dir, "merge late.json 1.json -o other.json");
        done(&dir, &format!("fit 3.csv 1.csv {model} --threads 1 --partial two.json"));
        done(&dir, "merge 2.json two.json -o third.json");
        let whole = json(&dir, "whole.json");
        for name in ["all.json", "other.json", "third.json"] {
            let merged = json(&dir, name);
            for field in ["model", "terms", "scaling", "coefficients", "valid_range"] {
                assert!(whole[field] == merged[field], "{model}: {field} of {name}");
            }
            // How the errors are distributed cannot be told from sums.
            for field in ["residual", "degrees_of_freedom", "coefficients"] {
                let of = |file: &serde_json::Value| file["covariance"][field].clone();
                assert!(of(&whole) == of(&merged), "{model}: covariance {field} of {name}");
            }
            for field in ["rows", "rank", "condition", "repeated_rows", "skipped_rows"] {
                assert_eq!(whole["diagnostics"][field], merged["diagnostics"][field]);
            }
            for axis in 0..6 {
                let figures = |file: &serde_json::Value, figure: &str| {
                    file["diagnostics"]["train"][axis][figure].as_f64().unwrap()
                };
                for figure in ["rms", "r_squared"] {
                    let (from_rows, from_sums) =
                        (figures(&whole, figure), figures(&merged, figure));
                    // Those of the whole come from predictions in `f64`, row by row.
                    assert!((from_rows - from_sums).abs() < 1e-9 * from_rows, "{figure}");
                }
                let difference = figures(&whole, "bias") - figures(&merged, "bias");
                assert!(difference.abs() < 1e-9 * figures(&whole, "rms"));
                assert!(merged["diagnostics"]["train"][axis]["max"].is_null());
            }
        }
        assert_eq!(json(&dir, "all.json")["sources"], whole["sources"]);
    }
}

#[test]
fn a_part_that_could_not_be_fitted_alone_can_be_merged() {
    let dir = recordings();
    done(&dir, "synth train --rows 20 --seed 4 -o 4.csv");
    assert!(refused(&dir, "fit 4.csv").contains("too few"));
    done(&dir, "fit 4.csv --partial 4.json");
    done(&dir, "fit 1.csv --partial 1.json");
    assert!(refused(&dir, "merge 4.json -o cal.json").contains("too few"));
    done(&dir, "merge 4.json 1.json -o cal.json");
    done(&dir, "eval cal.json 3.csv");
}

#[test]
fn parts_of_different_fits_are_refused() {
    let dir = recordings();
    done(&dir, "fit 1.csv --partial 1.json");
    done(&dir, "fit 2.csv --model linear --partial linear.json");
    done(&dir, "fit 2.csv --no-intercept --partial bare.json");
    done(&dir, "fit 2.csv --sensors 2-8 --partial seven.json");
    let cases = [
        ("linear.json", "`linear.json`: it is for `linear+1`, expected `cubic+1`"),
        ("bare.json", "it is for `cubic`, expected `cubic+1`"),
        ("seven.json", "it has `7` channels, expected `8`"),
        ("1.json", "counted already"),
        ("1.csv", "not valid JSON"),
        ("missing.json", "cannot read it"),
    ];
    for (other, expected) in cases {
        let error = refused(&dir, &format!("merge 1.json {other} -o cal.json"));
        assert!(error.contains(expected), "{other}: {error}");
    }
    assert!(!dir.path().join("cal.json").exists());
}

#[test]
fn a_damaged_or_foreign_part_is_refused() {
    let dir = recordings();
    done(&dir, "fit 1.csv --model linear --partial 1.json");
    let text = fs::read_to_string(dir.path().join("1.json")).unwrap();
    let cases = [
        ("\"partial_schema_version\": 1", "\"partial_schema_version\": 2", "schema version is `2`"),
        ("\"channels\": 8", "\"channels\": 7", "`moments` are not those of `model`"),
        ("\"rows\": 900,\n    \"channels\"", "\"rows\": 901,\n    \"channels\"", "sum of ones"),
        ("\"moments\"", "\"sums\"", "missing field `moments`"),
    ];
    for (from, to, expected) in cases {
        assert!(text.contains(from), "{from} in {}", &text[..600]);
        fs::write(dir.path().join("bad.json"), text.replacen(from, to, 1)).unwrap();
        let error = refused(&dir, "merge bad.json");
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn readings_that_cannot_be_summed_exactly_have_no_partial_fit() {
    let dir = tempfile::tempdir().unwrap();
    let header = "s1,s2,s3,s4,s5,s6,s7,s8,Fx_N,Fy_N,Fz_N,Mx_Nm,My_Nm,Mz_Nm";
    let row = "0.123456789,2,3,4,5,6,7,8,1,1,1,1,1,1";
    fs::write(dir.path().join("odd.csv"), format!("{header}\n{row}\n")).unwrap();
    let error = refused(&dir, "fit odd.csv --partial odd.json");
    assert!(error.contains("`0.123456789` of channel `s1`"), "{error}");
    assert!(!dir.path().join("odd.json").exists());
}
