//! The tutorial, by its own commands in a shell.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

use system_tests::program::{Recording, Running};

use super::book::root;

struct Step {
    command: String,
    expected: Vec<String>,
}

/// The commands of a page's console blocks: `$ ` begins one, `> ` continues it.
fn steps(page: &str) -> Vec<Step> {
    let mut steps: Vec<Step> = Vec::new();
    let mut in_console = false;
    for line in page.lines() {
        match line {
            "```console" => in_console = true,
            "```" => in_console = false,
            _ if !in_console => {}
            line => {
                if let Some(command) = line.strip_prefix("$ ") {
                    steps.push(Step { command: command.to_owned(), expected: Vec::new() });
                } else if let Some(more) = line.strip_prefix("> ") {
                    let command = &mut steps.last_mut().unwrap().command;
                    *command += &format!("\n{more}");
                } else {
                    steps.last_mut().unwrap().expected.push(line.to_owned());
                }
            }
        }
    }
    steps
}

/// `[..]` matches anything.
fn is_like(line: &str, expected: &str) -> bool {
    let mut parts = expected.split("[..]");
    let first = parts.next().unwrap();
    let Some(mut rest) = line.strip_prefix(first) else { return false };
    let parts: Vec<&str> = parts.collect();
    for (at, part) in parts.iter().enumerate() {
        if at + 1 == parts.len() {
            return rest.ends_with(part);
        }
        let Some(found) = rest.find(part) else { return false };
        rest = &rest[found + part.len()..];
    }
    rest.is_empty()
}

/// `...` matches any number of lines.
fn are_like(lines: &[&str], expected: &[String]) -> bool {
    match expected.split_first() {
        None => lines.is_empty(),
        Some((any, expected)) if any == "..." => {
            (0..=lines.len()).any(|skipped| are_like(&lines[skipped..], expected))
        }
        Some((first, expected)) => lines
            .split_first()
            .is_some_and(|(line, lines)| is_like(line, first) && are_like(lines, expected)),
    }
}

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
    let steps = steps(&page);
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

/// Names of a column in the reference: its own, or with the ends of its row.
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

#[test]
fn lines_match_with_wildcards() {
    assert!(
        is_like("a 12 b 3 c", "a [..] b [..] c") && is_like("x", "x") && is_like("ab", "a[..]")
    );
    assert!(!is_like("a 12 d", "a [..] b") && !is_like("xy", "x") && !is_like("b", "a[..]"));
    let lines = ["one", "two", "three"];
    let like = |expected: &[&str]| {
        are_like(&lines, &expected.iter().map(|&line| line.to_owned()).collect::<Vec<_>>())
    };
    assert!(like(&["one", "..."]) && like(&["...", "three"]) && like(&["...", "two", "..."]));
    assert!(!like(&["..."; 0]) && !like(&["one", "three"]) && !like(&["...", "four"]));
}
