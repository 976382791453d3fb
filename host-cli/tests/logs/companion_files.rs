//! Readings and wrench in two files, row by row.

use std::fs;
use std::path::Path;

use serde_json::Value;
use system_tests::{program, real_recording};

fn columns(text: &str, [from, to]: [usize; 2], with_names: bool) -> String {
    let cut = |line: &str| {
        line.split(',').skip(from).take(to - from).collect::<Vec<_>>().join(",") + "\n"
    };
    text.lines().skip(usize::from(!with_names)).map(cut).collect()
}

fn coefficients(dir: &Path, name: &str) -> Value {
    let text = fs::read_to_string(dir.join(name)).unwrap();
    serde_json::from_str::<Value>(&text).unwrap()["coefficients"].clone()
}

#[test]
fn a_wrench_in_another_file_gives_the_same_coefficients() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    program::run(dir, "synth train --rows 3000 --seed 5 -o whole.csv", 0);
    let text = fs::read_to_string(dir.join("whole.csv")).unwrap();
    program::run(dir, "fit whole.csv --model linear --covariance rows -o whole.json", 0);
    // Both files have the time; the first one's is used.
    let wrench = columns(&text, [9, 15], true);
    let wrench: String = wrench
        .lines()
        .enumerate()
        .map(|(at, line)| match at {
            0 => format!("t_s,{line}\n"),
            row => {
                format!("{},{line}\n", text.lines().nth(row).unwrap().split(',').next().unwrap())
            }
        })
        .collect();
    fs::write(dir.join("readings.csv"), columns(&text, [0, 9], true)).unwrap();
    fs::write(dir.join("wrench.csv"), &wrench).unwrap();
    fs::write(dir.join("bare_readings.csv"), columns(&text, [1, 9], false)).unwrap();
    fs::write(dir.join("bare_wrench.csv"), columns(&text, [9, 15], false)).unwrap();
    for (files, to) in [
        ("readings.csv --wrench-from wrench.csv", "two.json"),
        ("bare_readings.csv --wrench-from bare_wrench.csv", "bare.json"),
        (
            "bare_readings.csv --wrench-from bare_wrench.csv --sensors 1-8 --wrench 9-14",
            "said.json",
        ),
    ] {
        program::run(dir, &format!("fit {files} --model linear --covariance rows -o {to}"), 0);
        assert_eq!(coefficients(dir, to), coefficients(dir, "whole.json"), "{files}");
    }
    let flags = "--model linear --partial sums.json --groups";
    program::run(dir, &format!("fit readings.csv --wrench-from wrench.csv {flags}"), 0);
    program::run(dir, "merge sums.json -o merged.json", 0);
    for name in ["two.json", "merged.json"] {
        let text = fs::read_to_string(dir.join(name)).unwrap();
        let sources = serde_json::from_str::<Value>(&text).unwrap()["sources"].clone();
        let part = |at: usize, field: &str| sources[at][field].as_str().unwrap().to_owned();
        assert_eq!([part(0, "role"), part(1, "role")], ["train", "wrench"], "{sources}");
        assert_eq!(part(1, "path"), "wrench.csv");
        let files = ["readings.csv", "wrench.csv"].map(|file| fs::read(dir.join(file)).unwrap());
        let checksums = files.map(|bytes| log_file::checksum::of(&bytes));
        assert_eq!([part(0, "checksum"), part(1, "checksum")], checksums);
    }
    let rms = |command: &str| -> [f64; 6] {
        let document = program::json(dir, command);
        std::array::from_fn(|axis| document["all"]["errors"][axis]["rms"].as_f64().unwrap())
    };
    let two = rms("eval whole.json readings.csv --wrench-from wrench.csv --json");
    for (two, whole) in two.into_iter().zip(rms("eval whole.json whole.csv --json")) {
        // Squares are summed block by block, and blocks are split by bytes.
        assert!((two / whole - 1.0).abs() < 1e-12, "{two} for {whole}");
    }
}

/// The wrench is in counts of a millionth of N and N·m, below a head like that of ATI's demo.
#[test]
fn each_file_is_read_by_its_own_head() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    program::run(dir, "synth train --rows 600 --seed 5 -o whole.csv", 0);
    let text = fs::read_to_string(dir.join("whole.csv")).unwrap();
    program::run(dir, "fit whole.csv --model linear --covariance rows -o whole.json", 0);
    let in_counts = |line: &str| {
        let counts = line.split(',').map(|field| {
            let load: f64 = field.parse().unwrap();
            format!("{}", load * 1e6)
        });
        counts.collect::<Vec<_>>().join(",")
    };
    let loads = columns(&text, [9, 15], false);
    let loads: String = loads.lines().map(|line| in_counts(line) + "\n").collect();
    let head = "RDT Sample Rate: 1000\nForce Units: N\nCounts per Unit Force: 1000000.0\n\
                Torque Units: Nm\nCounts per Unit Torque: 1000000.0\nFx,Fy,Fz,Tx,Ty,Tz\n";
    fs::write(dir.join("ati.csv"), format!("{head}{loads}")).unwrap();
    let readings = columns(&text, [1, 9], true);
    fs::write(dir.join("readings.csv"), &readings).unwrap();
    // The second log has its own wrench, and another separator.
    let own: String = readings
        .lines()
        .enumerate()
        .map(|(at, line)| {
            let own = if at == 0 { "Fx,Fy,Fz,Mx,My,Mz" } else { "1,1,1,1,1,1" };
            format!("{};{}\n", line.replace(',', ";"), own.replace(',', ";"))
        })
        .collect();
    fs::write(dir.join("own.csv"), own).unwrap();
    for name in ["readings", "own"] {
        let command = format!(
            "fit {name}.csv --wrench-from ati.csv --model linear --covariance rows -o {name}.json"
        );
        let (_, said) = program::ended(dir, &command, 0);
        let expected = "`own.csv` has a wrench as well; the one of `ati.csv` is used";
        assert_eq!(said.contains(expected), name == "own", "{said}");
        let [found, whole] =
            [format!("{name}.json"), "whole.json".to_owned()].map(|file| coefficients(dir, &file));
        // Both the counts and the loads computed from them are rounded to doubles.
        let flat = |of: &Value| of.to_string().replace(['[', ']'], "");
        for (found, whole) in flat(&found).split(',').zip(flat(&whole).split(',')) {
            let [found, whole] = [found, whole].map(|number| number.parse::<f64>().unwrap());
            assert!((found - whole).abs() <= 1e-9 * whole.abs().max(1e-3), "{found} for {whole}");
        }
    }
}

#[test]
fn files_at_other_times_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let file = |name: &str, head: &str, start: f64, rest: &str| {
        let row =
            |at: usize| format!("{:.3},{at},{}{rest}\n", start + 0.01 * at as f64, at * at % 7);
        fs::write(dir.join(name), head.to_owned() + &(0..40).map(row).collect::<String>()).unwrap();
    };
    file("log.csv", "t_s,s1,s2\n", 0.0, "");
    file("late.csv", "t_s,fx_n,fy_n\n", 0.5, "");
    file("near.csv", "t_s,fx_n,fy_n\n", 0.002, "");
    let command = |file: &str| format!("fit log.csv --wrench-from {file} --model linear");
    let said = program::run(dir, &command("late.csv"), 2).replace('\n', " ");
    let expected = "row 1 is at 0.000000 s in the one and at 0.500000 s in the other";
    assert!(said.contains(expected) && said.contains("`shellcal align`"), "{said}");
    program::run(dir, &command("near.csv"), 0);
    program::run(dir, &(command("late.csv") + " --time 1"), 0);
}

#[test]
fn files_with_different_rows_are_refused_and_nothing_is_written() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    fs::write(dir.join("a.csv"), "s1,s2\n1,2\n3,4\n5,6\n").unwrap();
    fs::write(dir.join("short.csv"), "fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm\n1,2,3,4,5,6\n").unwrap();
    fs::write(dir.join("bare.csv"), "1,2,3,4,5,6\n".repeat(4)).unwrap();
    fs::write(
        dir.join("wrong.csv"),
        "fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm\n1,2,3,4,5,6\n1,2,x,4,5,6\n1,2,3,4,5,6\n",
    )
    .unwrap();
    for (files, expected) in [
        (
            "a.csv --wrench-from short.csv",
            "`a.csv` and `short.csv` beside it: line 3 is in one of them alone",
        ),
        ("a.csv --wrench-from bare.csv", "begins with names of columns, the other with numbers"),
        ("a.csv --wrench-from nowhere.csv", "nowhere.csv"),
        ("a.csv --wrench-from a.csv bare.csv", "names 2 files for 1 logs"),
        ("a.csv --wrench-from wrong.csv", "`a.csv`, line 3"),
    ] {
        let said = program::run(dir, &format!("fit {files} --model linear -o cal.json"), 2);
        assert!(said.contains(expected), "{files}: {said}");
    }
    assert!(!dir.join("cal.json").exists());
}

/// Reference figures by plain least squares on standardised columns, in double precision.
#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn the_figures_of_soft_robotic_tongs_are_reached_by_one_command() {
    let dir = tempfile::tempdir().unwrap();
    let fit = |set: &str, model: &str| -> (Value, String) {
        let file = |name: &str| {
            real_recording(&format!("others/tongs/{set}_{name}.csv")).display().to_string()
        };
        let (train, test) = (file("pose_train"), file("pose_test"));
        let command = format!(
            "fit {train} --wrench-from {} --test {test} --test-wrench-from {} --model {model} --json",
            file("FT_train"),
            file("FT_test")
        );
        let (printed, said) = program::ended(dir.path(), &command, 0);
        (serde_json::from_str(&printed).unwrap(), said)
    };
    let rms = |errors: &Value| -> Vec<f64> {
        (0..6).map(|axis| errors[axis]["rms"].as_f64().unwrap()).collect()
    };
    let assert_digits = |found: &[f64], expected: &[f64]| {
        for (found, expected) in found.iter().zip(expected) {
            // The reference has four decimals.
            assert!((found - expected).abs() <= 0.5e-4 + 1e-12, "{found} for {expected}");
        }
    };
    for (model, expected) in [
        ("linear", [0.5989, 1.5812, 1.2457, 0.0684, 0.0227, 0.0119]),
        ("cubic", [0.4181, 1.3508, 1.1654, 0.0484, 0.0178, 0.0104]),
        ("quadratic", [0.3676, 1.1695, 1.0088, 0.0372, 0.0154, 0.0087]),
    ] {
        let (document, _) = fit("baseline", model);
        assert_digits(&rms(&document["test"]), &expected);
    }
    let (document, said) = fit("internal", "linear");
    assert_digits(&rms(&document["train"]), &[0.6971, 0.7681, 0.5627, 0.1122, 0.0839, 0.0211]);
    let fx = document["test"][0]["rms"].as_f64().unwrap();
    assert!((fx - 96.0).abs() < 0.5, "{fx}");
    assert!(
        said.contains("1500 of 1500 test rows") || document.to_string().contains("1500"),
        "{said}"
    );
}
