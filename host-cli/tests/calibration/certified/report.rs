//! The tables in `docs/certified-problems.md`, checked against the measurements.

use std::fmt::Write;
use std::path::PathBuf;

use super::problem::ALL_DIGITS;

/// A label and the digits under each heading, `None` without an answer.
pub(crate) type Line = (String, Vec<Option<f64>>);

/// Allowed difference from the page, in digits. AVX-512, AVX2 and SSE2 round in different orders:
/// results differ by up to 1.54 digits.
const SLACK: f64 = 2.0;

/// Compares the table between the marks `<!-- name -->` and `<!-- end -->` with `lines`, or writes
/// it if `SHELLCAL_WRITE_DOCS` is set.
pub(crate) fn check(name: &str, headings: &[&str], lines: &[Line]) {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../docs/certified-problems.md");
    let page = std::fs::read_to_string(&path).unwrap();
    let mark = format!("<!-- {name} -->\n");
    let (before, rest) = page.split_once(&mark).expect("a place for the table in the page");
    let (table, after) = rest.split_once("<!-- end -->").expect("an end of the table");
    if std::env::var_os("SHELLCAL_WRITE_DOCS").is_some() {
        let table = render(headings, lines);
        std::fs::write(&path, format!("{before}{mark}{table}<!-- end -->{after}")).unwrap();
        return;
    }
    let written: Vec<&str> = table.lines().skip(2).collect();
    let remedy = "the page is out of date: run the test with SHELLCAL_WRITE_DOCS=1";
    assert_eq!(written.len(), lines.len(), "{name}: {remedy}");
    for (written, (label, digits)) in written.iter().zip(lines) {
        let cells: Vec<&str> = written.trim_matches('|').split('|').map(str::trim).collect();
        assert_eq!(cells[0], label, "{remedy}");
        assert_eq!(cells.len() - 1, digits.len(), "{label}: {remedy}");
        for (cell, digits) in cells[1..].iter().zip(digits) {
            match (cell.parse::<f64>().ok(), digits) {
                (None, None) => {}
                (Some(told), Some(digits)) if (told - digits).abs() <= SLACK => {}
                _ => panic!("{label}: `{cell}` in the page, {digits:?} measured: {remedy}"),
            }
        }
    }
}

fn render(headings: &[&str], lines: &[Line]) -> String {
    let mut table =
        format!("| |{}\n", headings.iter().map(|h| format!(" {h} |")).collect::<String>());
    writeln!(table, "| --- |{}", " ---: |".repeat(headings.len())).unwrap();
    for (label, digits) in lines {
        write!(table, "| {label} |").unwrap();
        for digits in digits {
            match digits {
                // Round down, so that the table claims no digit that a method did not get.
                Some(d) => write!(table, " {:.1} |", (d.min(ALL_DIGITS) * 10.0).floor() / 10.0),
                None => write!(table, " – |"),
            }
            .unwrap();
        }
        table.push('\n');
    }
    table
}
