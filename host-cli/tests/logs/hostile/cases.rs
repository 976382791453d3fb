//! Regression tests of former failures, with the commands that showed them.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use system_tests::program;
use tempfile::TempDir;

use crate::sealed::sealed;

fn says(dir: &TempDir, arguments: &str, code: i32) -> String {
    let (_, said) = program::ended(dir, arguments, code);
    assert!(!said.contains("panicked"), "{arguments}: {said}");
    said
}

fn folder() -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    says(&dir, "synth train --rows 2600 --seed 3 -o train.csv", 0);
    says(&dir, "synth test --rows 800 -o test.csv", 0);
    says(&dir, "fit --model cubic train.csv -o cal.json --covariance rows", 0);
    dir
}

fn read(dir: &TempDir, name: &str) -> String {
    fs::read_to_string(dir.path().join(name)).unwrap()
}

fn write(dir: &TempDir, name: &str, text: impl AsRef<[u8]>) {
    fs::write(dir.path().join(name), text).unwrap();
}

fn hidden(dir: &Path) -> Vec<String> {
    let names = fs::read_dir(dir).unwrap().map(|entry| entry.unwrap().file_name());
    names.map(|name| name.to_string_lossy().into_owned()).filter(|n| n.starts_with('.')).collect()
}

#[test]
fn inputs_are_never_replaced() {
    let dir = folder();
    says(&dir, "fit train.csv --partial partial.json", 0);
    says(&dir, "fit --model cubic train.csv --export-matrix matrix.csv", 0);
    says(&dir, "synth trials trials --per-condition 1", 0);
    fs::copy(dir.path().join("trials/manifest.csv"), dir.path().join("trials/trials.csv")).unwrap();
    fs::hard_link(dir.path().join("train.csv"), dir.path().join("same.svg")).unwrap();
    let before: Vec<String> =
        ["train.csv", "test.csv", "cal.json", "matrix.csv", "partial.json", "trials/manifest.csv"]
            .map(|name| read(&dir, name))
            .to_vec();
    for command in [
        "fit --model cubic train.csv --test test.csv -o test.csv",
        "fit train.csv --partial train.csv",
        "fit --model cubic train.csv --export-matrix ./train.csv",
        "fit --model cubic train.csv --plot same.svg",
        "eval cal.json train.csv --plot same.svg",
        "convert cal.json test.csv -o trials/../test.csv",
        "convert cal.json train.csv -o x.csv --plot same.svg",
        "merge partial.json -o partial.json",
        "merge partial.json --partial partial.json",
        "import matrix.csv -o matrix.csv",
        "trial trials/3cm-1.txt --calibration cal.json --trace trials/3cm-1.txt",
        "trial trials/3cm-1.txt --calibration cal.json --trace cal.json",
        "report trials/manifest.csv --calibration cal.json -o trials/manifest.csv",
        "report trials/manifest.csv --calibration cal.json -o trials/free-1.txt",
        "report trials/manifest.csv --calibration cal.json -o cal.json",
        "batch trials/trials.csv --calibration cal.json --csv trials",
        "record --replay train.csv -o train.csv --overwrite",
        "align train.csv test.csv -o train.csv",
        "stream train.csv -o train.csv --overwrite",
        "stream train.csv -o ./train.csv --overwrite",
        "stream train.csv -o same.svg --overwrite",
        "stream train.csv -o x.jsonl -o file:trials/../train.csv --overwrite",
        "stream train.csv --calibration cal.json -o cal.json --overwrite",
        "record --replay train.csv --stream train.csv",
        "record --replay train.csv --calibration cal.json -o x.csv --stream same.svg",
    ] {
        let said = says(&dir, command, 2);
        assert!(said.contains("would replace the input"), "{command}: {said}");
        assert!(said.contains("hint: choose another name"), "{command}: {said}");
    }
    let after =
        ["train.csv", "test.csv", "cal.json", "matrix.csv", "partial.json", "trials/manifest.csv"]
            .map(|name| read(&dir, name));
    assert!(before == after);
}

#[test]
fn two_outputs_are_never_one_file() {
    let dir = folder();
    for command in [
        "fit --model cubic train.csv -o x.json --export-matrix x.json",
        "fit --model cubic train.csv -o x.json --export-matrix ./x.json",
        "synth pair x.csv x.csv",
        "record --replay test.csv -o x --raw x",
        "stream test.csv -o x.csv -o ./x.csv",
        "record --replay test.csv -o x.csv --stream x.csv",
    ] {
        let said = says(&dir, command, 2);
        assert!(said.contains("two outputs would be written to one file"), "{command}: {said}");
    }
    assert!(!dir.path().join("x.json").exists() && !dir.path().join("x.csv").exists());
}

#[cfg(unix)]
#[test]
fn signals_leave_no_temporary_files() {
    for (signal, number) in [("-INT", 2), ("-TERM", 15), ("-HUP", 1)] {
        use std::os::unix::process::ExitStatusExt;
        let dir = tempfile::tempdir().unwrap();
        // Background programs of a script ignore interrupts; this one must end even if it starts that way.
        let mut child = std::process::Command::new("env")
            .args(["--default-signal=INT,TERM,HUP", env!("CARGO_BIN_EXE_shellcal")])
            .args(["synth", "train", "--rows", "10000000", "-o", "big.csv"])
            .current_dir(dir.path())
            .spawn()
            .unwrap();
        let started = std::time::Instant::now();
        while hidden(dir.path()).is_empty() {
            assert!(started.elapsed().as_secs() < 20, "no temporary file");
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        let id = child.id().to_string();
        assert!(std::process::Command::new("kill").args([signal, &id]).status().unwrap().success());
        assert_eq!(child.wait().unwrap().signal(), Some(number));
        assert_eq!(hidden(dir.path()), Vec::<String>::new());
    }
}

#[test]
fn copies_do_not_leak_through_validation() {
    let dir = folder();
    let half: String =
        read(&dir, "train.csv").lines().take(1300).fold(String::new(), |mut all, l| {
            writeln!(all, "{l}").unwrap();
            all
        });
    write(&dir, "h1.csv", &half);
    // The rows of `half` in another file, with CRLF line ends.
    write(&dir, "h1b.csv", half.replace('\n', "\r\n"));
    for command in [
        "fit h1.csv h1b.csv --cv=file --model poly3",
        "fit --model cubic h1.csv h1.csv",
        "fit --model cubic h1.csv --test h1b.csv",
    ] {
        let said = says(&dir, command, 2);
        assert!(said.contains("has the same rows as"), "{command}: {said}");
    }
}

#[test]
fn a_penalised_fit_is_the_same_in_any_order_of_rows() {
    let dir = folder();
    let text = read(&dir, "train.csv");
    let (header, rows) = text.split_once('\n').unwrap();
    let mut rows: Vec<&str> = rows.lines().collect();
    rows.sort_by_key(|row| row.chars().rev().collect::<String>());
    write(&dir, "sorted.csv", format!("{header}\n{}\n", rows.join("\n")));
    for solver in ["tsqr", "svd"] {
        let rms = |file: &str| {
            let command = format!(
                "fit --model cubic {file} --test test.csv --solver {solver} --ridge 1e-2 --json"
            );
            let report = program::json(dir.path(), &command);
            (0..6).map(|axis| report["test"][axis]["rms"].as_f64().unwrap()).collect::<Vec<_>>()
        };
        // Results are equal except for rounding, which depends on the blocks of rows.
        for (a, b) in rms("train.csv").iter().zip(rms("sorted.csv")) {
            assert!((a - b).abs() < 1e-9 * b, "{solver}: {a} {b}");
        }
    }
    let said = says(&dir, "fit --model cubic train.csv --solver ridge-gcv --ridge 1", 2);
    assert!(said.contains("leave out `--ridge`"), "{said}");
}

#[test]
fn calibrations_that_cannot_be_read_back_are_not_written() {
    let dir = folder();
    let text = read(&dir, "train.csv");
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let mut fields: Vec<&str> = lines[20].split(',').collect();
    fields[10] = "1e300";
    lines[20] = fields.join(",");
    write(&dir, "big.csv", lines.join("\n") + "\n");
    let said = says(&dir, "fit --model cubic big.csv -o big.json", 2);
    assert!(said.contains("column 11 (`fy_n`): expected a load of at most 1e15"), "{said}");
    assert!(!dir.path().join("big.json").exists());
}

#[test]
fn an_impossible_reading_is_an_error_with_its_position() {
    let dir = folder();
    let text = read(&dir, "test.csv");
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let mut fields: Vec<&str> = lines[19].split(',').collect();
    fields[3] = "1e63";
    lines[19] = fields.join(",");
    write(&dir, "flipped.csv", lines.join("\n") + "\n");
    let said = says(&dir, "convert cal.json flipped.csv -o out.csv", 2);
    assert!(said.contains("line 20: column 4 (`s3`)") && said.contains("`1e63`"), "{said}");
    says(&dir, "convert cal.json flipped.csv -o out.csv --skip-bad-rows", 0);
}

#[cfg(target_os = "linux")]
#[test]
fn names_that_are_not_unicode_are_names() {
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt;
    let dir = folder();
    let name = OsStr::from_bytes(b"x\xff.csv");
    fs::copy(dir.path().join("train.csv"), dir.path().join(name)).unwrap();
    for arguments in [
        &["fit", "X", "-o", "n.json", "--json"][..],
        &["fit", "X", "--partial", "p.json"],
        &["eval", "cal.json", "X", "--json"],
        &["convert", "cal.json", "X", "--output-dir", "tables", "--json"],
        &["synth", "zero", "--rows", "10", "--json", "-o", "X"],
    ] {
        let arguments =
            arguments.iter().map(|&word| if word == "X" { name } else { word.as_ref() });
        let output = program::command(dir.path()).args(arguments).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{said}");
    }
}

#[test]
fn sizes_are_refused_before_they_are_taken() {
    let dir = folder();
    let names: Vec<String> = (1..=64).map(|i| format!("s{i}")).collect();
    let mut wide = format!("{},Fx,Fy,Fz,Mx,My,Mz\n", names.join(","));
    for row in 0..400_u64 {
        let cells: Vec<String> =
            (0..70).map(|i| ((row * 7919 + i * 104_729) % 4000).to_string()).collect();
        wide += &format!("{}\n", cells.join(","));
    }
    write(&dir, "wide.csv", wide);
    for solver in ["exact", "tsqr"] {
        let said = says(&dir, &format!("fit wide.csv --model poly3 --solver {solver}"), 2);
        assert!(said.contains("`quadratic`, or at most `21` channels"), "{said}");
    }
    let said = says(&dir, "convert cal.json test.csv --lowpass 1e-6 -o out.csv", 2);
    assert!(said.contains("too low for 100 samples per second: at least `0.002` Hz"), "{said}");
    says(&dir, "fit train.csv --model linear --partial partial.json", 0);
    let partial = read(&dir, "partial.json");
    let (start, rest) = partial.split_once("\"channels\": [").unwrap();
    let (_, end) = rest.split_once("],").unwrap();
    let range = "{\"unit\": {\"twos\": 0, \"fives\": 0}, \"lowest\": 0, \"highest\": 9}";
    let ranges = vec![range; 255].join(",");
    let bomb = format!("{start}\"channels\": [{ranges}],{end}").replace("linear", "poly3");
    write(&dir, "bomb.json", bomb);
    let said = says(&dir, "merge bomb.json", 2);
    assert!(said.contains("at most `2200` can be fitted"), "{said}");
}

#[cfg(target_os = "linux")]
#[test]
fn endless_and_enormous_files_are_refused_at_once() {
    let dir = folder();
    let zeros = fs::File::create(dir.path().join("zeros")).unwrap();
    zeros.set_len(10 << 30).unwrap();
    for file in ["/dev/zero", "zeros"] {
        for command in [
            "eval F test.csv",
            "eval cal.json F",
            "merge F",
            "import F -o i.json",
            "stats F",
            "batch F",
            "report F",
            "info F",
            "fit --model cubic F",
            "convert cal.json F",
            "trial F",
            "trial test.csv --profile F",
        ] {
            says(&dir, &command.replace('F', file), 2);
        }
    }
}

#[test]
fn degrees_of_freedom_without_end_have_quantiles() {
    let dir = folder();
    // There are too many groups for leave-one-group-out, so the interval is Student's.
    says(&dir, "synth train --rows 11000 --seed 3 -o many.csv", 0);
    says(&dir, "fit --model linear many.csv -o many.json", 0);
    let text = read(&dir, "many.json");
    let at = text.find("\"degrees_of_freedom\": ").unwrap() + 22;
    let end = at + text[at..].find(',').unwrap();
    let endless = format!("{}100000000{}", &text[..at], &text[end..]);
    write(&dir, "dof.json", sealed(&endless));
    says(&dir, "convert dof.json test.csv -o out.csv --interval", 0);
}

#[test]
fn partial_fits_that_were_changed_are_refused() {
    let dir = folder();
    says(&dir, "fit train.csv --model linear --partial partial.json", 0);
    let text = read(&dir, "partial.json");
    says(&dir, "merge partial.json", 0);
    write(&dir, "changed.json", text.replacen("train.csv", "other.csv", 1));
    let said = says(&dir, "merge changed.json", 2);
    assert!(said.contains("its checksum does not match"), "{said}");
    // Another program has rewritten the file, and may have changed anything.
    let mut document: serde_json::Value = serde_json::from_str(&text).unwrap();
    write(&dir, "changed.json", document.to_string());
    let said = says(&dir, "merge changed.json", 2);
    assert!(said.contains("its last line but one is no checksum"), "{said}");
    document.as_object_mut().unwrap().remove("checksum");
    document["sources"] = serde_json::json!([]);
    write(&dir, "changed.json", document.to_string());
    let said = says(&dir, "merge partial.json changed.json", 2);
    assert!(said.contains("`sources` have 0 rows, `moments` are of 2600"), "{said}");
    // Earlier versions wrote no checksum.
    let content = text.rsplit_once(",\n  \"checksum\"").unwrap().0.to_owned() + "\n}\n";
    write(&dir, "old.json", &content);
    let said = says(&dir, "merge old.json", 2);
    assert!(said.contains("is no checksum") && said.contains("--edited"), "{said}");
    says(&dir, "merge old.json --edited", 0);
    // Parsing a number takes time proportional to the square of its digits.
    let mut long: serde_json::Value = serde_json::from_str(&content).unwrap();
    long["moments"]["wrench"][0]["values"][0] = "7".repeat(3_000_000).into();
    write(&dir, "long.json", long.to_string());
    let said = says(&dir, "merge long.json --edited", 2);
    assert!(said.contains("an integer has `3000000` digits, at most `2000`"), "{said}");
    let document: serde_json::Value = serde_json::from_str(&content).unwrap();
    for index in [1, 12, 40] {
        for change in ["-170141183460469231731687303715884105728", "99999999999999999999"] {
            let mut changed = document.clone();
            changed["moments"]["readings"][index] = change.into();
            write(&dir, "changed.json", changed.to_string());
            let said = says(&dir, "merge changed.json", 2);
            assert!(said.contains("`moments`"), "{index}: {change}: {said}");
        }
    }
    let mut changed = document.clone();
    changed["moments"]["squares"][0]["values"][0] = "-12345".into();
    write(&dir, "changed.json", changed.to_string());
    let said = says(&dir, "merge changed.json", 2);
    assert!(said.contains("sum of squares of axis 1 is negative"), "{said}");
}

#[test]
fn a_saturated_fit_is_warned_of() {
    let dir = folder();
    let text: Vec<String> = read(&dir, "train.csv").lines().take(10).map(str::to_owned).collect();
    write(&dir, "nine.csv", text.join("\n") + "\n");
    let said = says(&dir, "fit nine.csv --model linear", 0);
    assert!(said.contains("warning: 9 rows for 9 coefficients"), "{said}");
}

#[test]
fn names_are_escaped_on_the_terminal() {
    let dir = folder();
    write(&dir, "esc.csv", "a\u{1b}[31mb,s1,s2\n1,2,3\n");
    let output = program::output(dir.path(), "info esc.csv");
    assert!(!output.stdout.contains(&0x1b));
}

#[test]
fn a_skew_that_no_clock_has_is_refused() {
    let said = says(&folder(), "synth pair a.csv b.csv --skew=1e300", 2);
    assert!(said.contains("clocks that differ"), "{said}");
}

#[test]
fn a_last_line_that_is_cut_after_a_separator_is_left_out() {
    let dir = folder();
    let text = read(&dir, "test.csv");
    let rows = text.trim_end().rsplit_once('\n').unwrap().0;
    let cut = rows.rsplit_once(',').unwrap().0;
    write(&dir, "cut.csv", format!("{cut},"));
    says(&dir, "convert cal.json cut.csv -o out.csv", 0);
}

#[test]
fn a_clock_of_32_bits_comes_round_in_telemetry() {
    const TURN_US: u64 = 1 << 32;
    const BEFORE_US: u64 = 4_000_000;
    let dir = tempfile::tempdir().unwrap();
    says(&dir, "synth trial -o run.txt", 0);
    let turned = |line: &str| {
        let (time, rest) = line.split_once(',')?;
        let time: u64 = time.parse().ok()?;
        Some(format!("{},{rest}\n", (time + TURN_US - BEFORE_US) % TURN_US))
    };
    let text = read(&dir, "run.txt");
    let lines = text.lines().map(|line| turned(line).unwrap_or_else(|| format!("{line}\n")));
    write(&dir, "turned.txt", lines.collect::<String>());
    let number = |command: &str, path: &str| {
        let report = program::json(dir.path(), command);
        report.pointer(path).and_then(serde_json::Value::as_f64).unwrap()
    };
    let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-6 * a, "{a} {b}");
    let duration = |file: &str| number(&format!("info {file} --json"), "/0/time/duration_s");
    close(duration("run.txt"), duration("turned.txt"));
    let energy = |file: &str, from_s: f64| {
        let (enter_s, exit_s) = (2.5 + from_s, 7.5 + from_s);
        let command = format!("trial {file} --enter {enter_s} --exit {exit_s} --json");
        number(&command, "/electrical_energy_j")
    };
    let offset_s = (TURN_US - BEFORE_US) as f64 / 1e6;
    close(energy("run.txt", 0.0), energy("turned.txt", offset_s));
}

#[test]
fn windows_of_no_length_are_refused() {
    let dir = folder();
    says(&dir, "synth trial -o trial.txt", 0);
    let said = says(&dir, "trial trial.txt --calibration cal.json --enter 3 --exit 3.0001", 2);
    assert!(said.contains("shorter than 10 periods of the log"), "{said}");
}

#[test]
fn headers_and_line_ends_that_no_log_has_are_named() {
    let dir = folder();
    let names: Vec<String> = (0..9000).map(|i| format!("column{i}")).collect();
    write(&dir, "wide.csv", format!("{}\n{}\n", names.join(","), vec!["1"; 9000].join(",")));
    let said = says(&dir, "info wide.csv", 2);
    assert!(said.contains("line 1: longer than 65536 bytes"), "{said}");
    write(&dir, "mac.csv", read(&dir, "test.csv").replace('\n', "\r"));
    let said = says(&dir, "info mac.csv", 2);
    assert!(said.contains("a carriage return and no line feed"), "{said}");
}

#[cfg(unix)]
#[test]
fn a_pipe_without_a_writer_is_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let made = std::process::Command::new("mkfifo").arg(dir.path().join("pipe.csv")).status();
    assert!(made.unwrap().success());
    let said = says(&dir, "info pipe.csv", 2);
    assert!(said.contains("not a regular file"), "{said}");
}

#[test]
fn standard_errors_by_group_that_were_asked_for_are_found_or_refused() {
    let dir = folder();
    let text = read(&dir, "train.csv");
    let numbered =
        |(row, line): (usize, &str)| format!("{},{row}\n", line.rsplit_once(',').unwrap().0);
    let header = text.lines().next().unwrap();
    let rows: String = text.lines().skip(1).enumerate().map(numbered).collect();
    write(&dir, "many.csv", format!("{header}\n{rows}"));
    let said = says(&dir, "fit --model cubic many.csv --covariance groups", 2);
    assert!(said.contains("more than `2000` groups"), "{said}");
    says(&dir, "fit --model cubic train.csv --covariance groups", 0);
}

/// Rows are not kept in memory between two passes, and the file changes before the second pass.
#[test]
fn folds_may_be_of_any_number_of_groups() {
    let dir = tempfile::tempdir().unwrap();
    says(&dir, "synth train --rows 5200 --seed 3 -o train.csv", 0);
    let text = read(&dir, "train.csv");
    let mut lines = text.lines();
    let mut labelled = format!("{},pose\n", lines.next().unwrap());
    for (row, line) in lines.enumerate() {
        writeln!(labelled, "{line},{}", row / 2).unwrap();
    }
    write(&dir, "poses.csv", labelled);
    let said = says(&dir, "fit --model cubic poses.csv --group pose --cv", 2);
    assert!(said.contains("more than `2000` groups") && said.contains("--cv=K"), "{said}");
    let document =
        program::json(dir.path(), "fit --model cubic poses.csv --group pose --cv=10 --json");
    let found = &document["cross_validation"];
    assert_eq!((&found["groups"], &found["folds"]), (&2600.into(), &10.into()), "{document}");
    assert_eq!(found["rows"], 5200, "{document}");
}
