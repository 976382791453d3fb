//! The tutorial, by its own commands in a shell.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

use system_tests::program::{Recording, Running};
use system_tests::transcript::{Step, are_like, steps};

use super::book::root;

/// A shell in a folder, with the program on its path.
fn shell(folder: &Path, command: &str) -> Command {
    let program = Path::new(env!("CARGO_BIN_EXE_shellcal")).parent().unwrap();
    let path = format!("{}:{}", program.display(), std::env::var("PATH").unwrap());
    let mut shell = Command::new("sh");
    shell.args(["-c", command]).current_dir(folder).env("PATH", path).stdin(Stdio::null());
    shell
}

#[test]
fn the_tutorial_leads_from_nothing_to_the_report() {
    let page = fs::read_to_string(root().join("docs/tutorial.md")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut background = Vec::new();
    let steps = steps(&page, "console");
    assert!(steps.len() > 15, "{}", steps.len());
    for Step { command, expected } in steps {
        if let Some(command) = command.strip_suffix(" &") {
            // `exec`, so that the program itself is ended.
            let mut shell = shell(folder, &format!("exec {command}"));
            let mut child = Running(shell.stdout(Stdio::piped()).spawn().unwrap());
            let mut first = String::new();
            let output = child.0.stdout.take().unwrap();
            BufReader::new(output).read_line(&mut first).unwrap();
            assert!(are_like(&[first.trim_end()], &expected), "{command}: {first}");
            background.push(child);
            continue;
        }
        let mut shell = shell(folder, &format!("exec 2>&1\n{command}"));
        let output = shell.output().unwrap();
        let said = String::from_utf8(output.stdout).unwrap();
        assert!(output.status.success(), "{command}: {said}");
        let lines: Vec<&str> = said.lines().collect();
        assert!(are_like(&lines, &expected), "{command}:\n{said}\nexpected:\n{expected:#?}");
    }
    assert_eq!(background.len(), 1);
    for file in ["fit.svg", "fit.html", "report.html", "wrench.csv"] {
        assert!(fs::metadata(folder.join(file)).unwrap().len() > 0, "{file}");
    }

    // The page says that the known weight is read within the interval of the fit.
    let fz_n = Recording::read(&folder.join("check-wrench.csv")).numbers("fz_n");
    let ends = fz_n
        .iter()
        .copied()
        .fold([0.0_f64, 0.0], |[least, most], fz| [least.min(fz), most.max(fz)]);
    let weight_n = ends[0] - ends[1];
    assert!((weight_n + 0.981).abs() < 0.22, "{weight_n} N");

    // Every column of every table that it made is in the reference.
    let reference = fs::read_to_string(root().join("docs/reference.md")).unwrap();
    let mut columns = 0;
    for position in ["", "results"] {
        for entry in fs::read_dir(folder.join(position)).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_none_or(|extension| extension != "csv") {
                continue;
            }
            let text = fs::read_to_string(&path).unwrap();
            for column in text.lines().next().unwrap().split(',') {
                columns += 1;
                let is_known =
                    named(column).iter().any(|name| reference.contains(&format!("`{name}`")));
                assert!(is_known, "{}: `{column}` is not in docs/reference.md", path.display());
            }
        }
    }
    assert!(columns > 100, "{columns}");
}

/// Names of a column in the reference: its own, or the first and last of its series, as `s1` … `s8`.
fn named(column: &str) -> Vec<String> {
    let first = |prefix: &str| {
        let number = column.strip_prefix(prefix).and_then(|rest| rest.parse::<u8>().ok());
        number.map(|_| format!("{prefix}1` … `{prefix}8"))
    };
    let mut names = vec![column.to_owned()];
    names.extend(["s", "dark"].iter().filter_map(|prefix| first(prefix)));
    for kind in ["se", "lower", "upper"] {
        if column.contains(&format!("_{kind}_")) {
            names.push(format!("fx_{kind}_n` … `mz_{kind}_nm"));
        }
    }
    names
}
