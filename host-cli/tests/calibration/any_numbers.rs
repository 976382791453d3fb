//! Readings without exact sums: standard errors by group, partial fits, fits to means.

use std::fs;
use std::path::Path;

use system_tests::program::{document, ended, json, refused, succeed};
use system_tests::real_recording;
use tempfile::TempDir;

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../calibration-data/synthetic-train.csv");

/// Not a whole number divided by a power of two or by a small power of ten.
const VOLT: f64 = 0.1 + 1e-9;

/// Writes `train.csv`; `volts.csv`, the same rows in other units; and `a.csv` to `c.csv`, three
/// consecutive parts of `volts.csv`.
fn folder() -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    let text = fs::read_to_string(DATA).unwrap();
    let (header, rows) = text.split_once('\n').unwrap();
    let volts = |row: &str| -> String {
        let of = |(at, field): (usize, &str)| match at {
            1..=8 => (field.parse::<f64>().unwrap() * VOLT).to_string(),
            _ => field.to_owned(),
        };
        row.split(',').enumerate().map(of).collect::<Vec<_>>().join(",")
    };
    let rows: Vec<String> = rows.lines().map(volts).collect();
    let write = |name: &str, rows: &[String]| {
        fs::write(dir.path().join(name), format!("{header}\n{}\n", rows.join("\n"))).unwrap();
    };
    write("volts.csv", &rows);
    let third = rows.len() / 3;
    write("a.csv", &rows[..third]);
    write("b.csv", &rows[third..third + 500]);
    write("c.csv", &rows[third + 500..]);
    fs::write(dir.path().join("train.csv"), text).unwrap();
    dir
}

/// Returns wrench, standard errors and ends of intervals, for the rows of a log.
fn converted(dir: &Path, calibration: &str, log: &str) -> Vec<Vec<f64>> {
    succeed(dir, &format!("convert {calibration} {log} --no-tare --no-lowpass -o out.csv"));
    let text = fs::read_to_string(dir.join("out.csv")).unwrap();
    let rows = text.lines().skip(1);
    rows.map(|row| row.split(',').skip(1).take(12).map(|x| x.parse().unwrap()).collect()).collect()
}

fn assert_close(found: &[Vec<f64>], expected: &[Vec<f64>], relative: f64) {
    assert_eq!(found.len(), expected.len());
    let sizes: Vec<f64> =
        (0..12).map(|at| expected.iter().map(|row| row[at].abs()).fold(0.0, f64::max)).collect();
    for (found, expected) in found.iter().zip(expected) {
        for at in 0..12 {
            let difference = (found[at] - expected[at]).abs();
            assert!(difference < relative * sizes[at], "{at}: {} {}", found[at], expected[at]);
        }
    }
}

/// The exact sums of the counts are the truth: a fit is the same in any unit.
#[test]
fn standard_errors_by_group_equal_those_of_exact_sums() {
    let dir = folder();
    let dir = dir.path();
    for model in ["linear", "cubic --no-intercept", "quadratic"] {
        succeed(dir, &format!("fit train.csv --model {model} -o exact.json"));
        let (_, said) =
            ended(dir, &format!("fit volts.csv --model {model} --verbose -o volts.json"), 0);
        // No precision is lost here, so there is no message on inexact sums or independent rows.
        assert!(!said.contains("exact"), "{said}");
        assert!(!said.contains("independent"), "{said}");
        let (exact, volts) = (document(dir, "exact.json"), document(dir, "volts.json"));
        for field in ["degrees_of_freedom", "residual", "shared"] {
            let (exact, volts) = (&exact["covariance"][field], &volts["covariance"][field]);
            assert_eq!(exact.is_null(), volts.is_null(), "{field}");
        }
        assert_eq!(volts["covariance"]["degrees_of_freedom"], 124);
        // Converting the unit rounds every reading by up to 2⁻⁵³; the condition number, about 1e4,
        // multiplies this.
        let exact = converted(dir, "exact.json", "train.csv");
        assert_close(&converted(dir, "volts.json", "volts.csv"), &exact, 1e-11);
    }
}

/// With few groups, intervals come from held-out groups.
#[test]
fn intervals_of_few_groups_equal_those_of_exact_sums() {
    let dir = folder();
    let dir = dir.path();
    for name in ["train", "volts"] {
        let text = fs::read_to_string(dir.join(format!("{name}.csv"))).unwrap();
        let is_in = |(line, row): &(usize, &str)| {
            *line == 0 || row.rsplit_once(',').unwrap().1.parse::<u32>().unwrap() < 45
        };
        let rows: Vec<&str> = text.lines().enumerate().filter(is_in).map(|(_, row)| row).collect();
        fs::write(dir.join(format!("{name}.csv")), rows.join("\n") + "\n").unwrap();
    }
    let intervals = |name: &str| -> Vec<f64> {
        let printed = succeed(dir, &format!("fit {name}.csv --model linear --json -o {name}.json"));
        let report: serde_json::Value = serde_json::from_str(&printed).unwrap();
        assert_eq!(report["covariance"]["groups"], 45);
        let of = report["covariance"]["interval_95"].as_array().unwrap();
        of.iter().map(|x| x.as_f64().unwrap()).collect()
    };
    for (exact, volts) in intervals("train").iter().zip(intervals("volts")) {
        assert!((volts / exact - 1.0).abs() < 1e-10, "{exact} {volts}");
    }
}

#[test]
fn merged_r_factors_are_the_fit_over_all_files() {
    let dir = folder();
    let dir = dir.path();
    for model in
        ["--model cubic", "--model quadratic --no-intercept", "--model linear --ridge 1e-3"]
    {
        let (features, ridge) = model.split_once(" --ridge").unwrap_or((model, ""));
        let ridge = if ridge.is_empty() { String::new() } else { format!("--ridge{ridge}") };
        succeed(dir, &format!("fit a.csv b.csv c.csv {model} --group group -o whole.json"));
        for file in ["a", "b", "c"] {
            let (_, said) =
                ended(dir, &format!("fit {file}.csv {features} --groups --partial {file}.json"), 0);
            assert!(!said.contains("warning"), "{said}");
            assert_eq!(document(dir, &format!("{file}.json"))["partial_schema_version"], 4);
        }
        succeed(dir, &format!("merge a.json b.json c.json {ridge} -o merged.json"));
        succeed(dir, "merge c.json a.json --partial late.json");
        succeed(dir, &format!("merge late.json b.json {ridge} -o other.json"));
        let whole = converted(dir, "whole.json", "volts.csv");
        // Condition numbers are some hundred, or 1e4 without a constant, in double precision; features
        // and their scale are rounded once more for each file.
        let relative = if model.contains("no-intercept") { 1e-9 } else { 1e-12 };
        for name in ["merged.json", "other.json"] {
            assert_close(&converted(dir, name, "volts.csv"), &whole, relative);
            let (found, expected) = (document(dir, name), document(dir, "whole.json"));
            assert_eq!(found["diagnostics"]["rows"], expected["diagnostics"]["rows"]);
            assert_eq!(found["solver"]["name"], "tsqr");
            for axis in 0..6 {
                for figure in ["rms", "r_squared"] {
                    let of = |file: &serde_json::Value| {
                        file["diagnostics"]["train"][axis][figure].as_f64().unwrap()
                    };
                    assert!((of(&found) / of(&expected) - 1.0).abs() < 1e-9, "{figure}");
                }
            }
        }
        // Merging in the same order again gives the same bytes, except for the date.
        succeed(dir, &format!("merge a.json b.json c.json {ridge} -o again.json"));
        assert_eq!(
            document(dir, "again.json")["coefficients"],
            document(dir, "merged.json")["coefficients"]
        );
    }
}

#[test]
fn merged_r_factors_validate_and_choose_as_a_fit_does() {
    let dir = folder();
    let dir = dir.path();
    for file in ["a", "b", "c"] {
        succeed(dir, &format!("fit {file}.csv --model auto --groups --partial {file}.json"));
    }
    let report =
        |arguments: &str| -> serde_json::Value { json(dir, &format!("{arguments} --json")) };
    let merged = report("merge a.json b.json c.json --model cubic --cv=9");
    let whole = report("fit a.csv b.csv c.csv --model cubic --cv=9 --group group");
    for axis in 0..6 {
        let of = |report: &serde_json::Value| {
            report["cross_validation"]["grouped"][axis]["rms"].as_f64().unwrap()
        };
        // One report refits the rows, the other uses R factors. Condition numbers are below 1e3.
        assert!((of(&merged) / of(&whole) - 1.0).abs() < 1e-9, "{axis}");
    }
    assert!(merged["cross_validation"]["random"].is_null());
    let chosen = |report: &serde_json::Value| {
        let at = report["selection"]["chosen"].as_u64().unwrap() as usize;
        report["selection"]["candidates"][at].clone()
    };
    let merged = chosen(&report("merge a.json b.json c.json --model auto"));
    // Parts keep no order of rows, which a lag or memory needs.
    let of_rows = "--model auto --group group --lag 0 --memory-terms none";
    let whole = chosen(&report(&format!("fit a.csv b.csv c.csv {of_rows}")));
    assert_eq!((&merged["basis"], &merged["ridge"]), (&whole["basis"], &whole["ridge"]));
    let score = |of: &serde_json::Value| of["errors"]["score"].as_f64().unwrap();
    // In merged fits a ridge is relative to the mean of the rows of a fold; in a fit of the rows,
    // to the mean of all rows.
    assert!((score(&merged) / score(&whole) - 1.0).abs() < 1e-3, "{merged} {whole}");
}

/// `info` looks for suspicious rows with a separate fit.
#[test]
fn a_spike_in_volts_is_found_as_in_counts() {
    let dir = folder();
    let dir = dir.path();
    for (name, spike) in [("train", 900.0), ("volts", 900.0 * VOLT)] {
        let text = fs::read_to_string(dir.join(format!("{name}.csv"))).unwrap();
        let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
        let mut fields: Vec<String> = lines[1000].split(',').map(str::to_owned).collect();
        fields[3] = (fields[3].parse::<f64>().unwrap() + spike).to_string();
        lines[1000] = fields.join(",");
        fs::write(dir.join("spike.csv"), lines.join("\n") + "\n").unwrap();
        let report = json(dir, "info spike.csv --json");
        let found = report[0]["outliers"].as_array().unwrap();
        assert_eq!(found.len(), 1, "{name}: {found:?}");
        assert_eq!(
            (&found[0]["line"], &found[0]["columns"][0]["name"]),
            (&1001.into(), &"s3".into())
        );
    }
}

#[test]
fn exact_sums_and_r_factors_are_not_merged_and_damaged_r_factors_are_refused() {
    let dir = folder();
    let dir = dir.path();
    succeed(dir, "fit train.csv --model linear --partial exact.json");
    succeed(dir, "fit a.csv --model linear --groups --partial a.json");
    succeed(dir, "fit b.csv --model linear --partial b.json");
    succeed(dir, "fit train.csv --model linear --solver tsqr --partial triangle.json");
    let said = refused(dir, "merge exact.json b.json -o cal.json");
    assert!(said.contains("`b.json`: it has R factors, expected exact sums"), "{said}");
    assert!(said.contains("--solver tsqr"), "{said}");
    assert!(!dir.join("cal.json").exists());
    succeed(dir, "merge triangle.json b.json -o cal.json");
    let said = refused(dir, "fit b.csv --model linear --solver huber --partial c.json");
    assert!(said.contains("leave out `--solver`"), "{said}");
    assert!(refused(dir, "merge b.json --cv").contains("keep no sums of groups"));
    assert!(refused(dir, "merge b.json --model cubic").contains("not for `cubic + offset`"));
    let text = fs::read_to_string(dir.join("a.json")).unwrap();
    let sealed = |text: &str| {
        let (content, _) = text.rsplit_once(",\n  \"checksum\"").unwrap();
        let hash = twox_hash::XxHash3_128::oneshot(content.as_bytes());
        format!("{content},\n  \"checksum\": \"xxh128:{hash:032x}\"\n}}\n")
    };
    assert_eq!(sealed(&text), text);
    let cases = [
        ("\"triangle\"", "\"square\"", "missing field `moments` or `triangle`"),
        ("\"rows\": 833,\n    \"scaling\"", "\"rows\": 834,\n    \"scaling\"", "the sum of ones"),
        ("\"channels\": 8", "\"channels\": 7", "`triangle` are not those of `model`"),
        ("\"held_out_folds\": 0", "\"held_out_folds\": 1", "that are held out"),
    ];
    for (from, to, expected) in cases {
        assert!(text.contains(from), "{from} in {}", &text[..1500]);
        fs::write(dir.join("bad.json"), sealed(&text.replacen(from, to, 1))).unwrap();
        let said = refused(dir, "merge bad.json");
        assert!(said.contains(expected), "{from}: {said}");
        fs::write(dir.join("bad.json"), text.replacen(from, to, 1)).unwrap();
        refused(dir, "merge bad.json");
    }
}

#[test]
fn a_fit_to_means_takes_each_group_once() {
    let dir = folder();
    let dir = dir.path();
    let text = fs::read_to_string(dir.join("train.csv")).unwrap();
    let (header, rows) = text.split_once('\n').unwrap();
    let mut means: Vec<(String, f64, Vec<f64>)> = Vec::new();
    for row in rows.lines() {
        let fields: Vec<&str> = row.split(',').collect();
        let (label, numbers) = (fields[15], &fields[..15]);
        let numbers = numbers.iter().map(|field| field.parse::<f64>().unwrap());
        match means.iter_mut().find(|(known, ..)| known == label) {
            Some((_, count, sums)) => {
                *count += 1.0;
                sums.iter_mut().zip(numbers).for_each(|(sum, x)| *sum += x);
            }
            None => means.push((label.to_owned(), 1.0, numbers.collect())),
        }
    }
    assert_eq!(means.len(), 125);
    let lines = means.iter().map(|(label, count, sums)| {
        let numbers: Vec<String> = sums.iter().map(|sum| (sum / count).to_string()).collect();
        format!("{},{label}", numbers.join(","))
    });
    let lines: Vec<String> = lines.collect();
    fs::write(dir.join("means.csv"), format!("{header}\n{}\n", lines.join("\n"))).unwrap();
    succeed(dir, "fit means.csv --model linear --cv -o expected.json");
    let (_, said) =
        ended(dir, "fit train.csv --means --model linear --cv --verbose -o found.json", 0);
    assert!(said.contains("a row is the mean of a group: 125 of 2500 rows"), "{said}");
    let expected = converted(dir, "expected.json", "train.csv");
    // The means in `means.csv` are sums of twenty numbers in double precision, so they are rounded.
    assert_close(&converted(dir, "found.json", "train.csv"), &expected, 1e-10);
    let (found, expected) = (document(dir, "found.json"), document(dir, "expected.json"));
    assert_eq!(found["diagnostics"]["rows"], 125);
    assert_eq!(found["covariance"]["degrees_of_freedom"], 124);
    for axis in 0..6 {
        let of = |file: &serde_json::Value| {
            file["diagnostics"]["cross_validation"]["grouped"][axis]["rms"].as_f64().unwrap()
        };
        assert!((of(&found) / of(&expected) - 1.0).abs() < 1e-9);
    }
    succeed(dir, "fit train.csv --model linear -o rows.json");
    assert_eq!(found["sources"], document(dir, "rows.json")["sources"]);
    let said = refused(dir, "fit train.csv --means --model physics");
    assert!(said.contains("leave out `--means`"), "{said}");
    assert!(refused(dir, "fit train.csv --means --partial x.json").contains("--partial"));
    let (_, alone) = text.split_once('\n').unwrap();
    let alone: Vec<&str> = alone.lines().take(30).collect();
    fs::write(dir.join("alone.csv"), format!("{header}\n{}\n", alone.join("\n"))).unwrap();
    let said = refused(dir, "fit alone.csv --means --model linear");
    assert!(said.contains("too few"), "{said}");
}

/// Reference figures of other people's sensors, on means.
#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn figures_of_pose_means_are_reached() {
    let log = real_recording("others/photointerrupters/poses.csv");
    let dir = tempfile::tempdir().unwrap();
    // Computed with numpy, plain least squares on the means of the poses.
    for (model, expected) in [
        ("linear", [2.3784, 1.7835, 2.6591, 0.0621, 0.1165, 0.0724]),
        ("cubic", [10.68, 4.716, 1.013, 0.0663, 0.2280, 0.2799]),
    ] {
        let means = format!("--means --group pose --cv --json --model {model}");
        let report = json(&dir, &format!("fit {means} {}", log.display()));
        for (axis, expected) in expected.into_iter().enumerate() {
            let found = &report["cross_validation"]["grouped"][axis]["rms"];
            let found = found.as_f64().unwrap();
            // Half of the last digit given.
            assert!((found / expected - 1.0).abs() < 1e-3, "{model} {axis}: {found} {expected}");
        }
    }
}
