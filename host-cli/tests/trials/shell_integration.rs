//! The program in a shell: its greeting, forms of tables, colour.

use std::path::Path;

use system_tests::program;

#[test]
fn commands_of_earlier_releases_say_where_they_have_gone() {
    for (old, new) in
        [("ports", "shellcal board"), ("noise", "info LOG --noise"), ("man", "xtask manual")]
    {
        let said = program::refused(Path::new("."), &format!("{old} log.csv"));
        assert!(
            said.contains(&format!("no command `{old}` any more")) && said.contains(new),
            "{said}"
        );
    }
}

#[test]
fn a_call_without_arguments_prints_first_steps() {
    let text = program::refused(Path::new("."), "");
    for start in ["info", "fit", "convert", "batch", "record", "help"] {
        assert!(text.contains(&format!("shellcal {start}")), "{text}");
    }
    assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");
}

#[test]
fn tables_are_printed_as_they_are_asked_for() {
    let dir = tempfile::tempdir().unwrap();
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../calibration-data");
    let fit = format!("fit --model cubic {}", data.join("synthetic-train.csv").display());
    let output = program::output(dir.path(), &format!("{fit} --as csv"));
    assert!(output.status.success());
    // By an independent reader.
    let mut reader = csv::Reader::from_reader(&output.stdout[..]);
    let header: Vec<String> = reader.headers().unwrap().iter().map(str::to_owned).collect();
    assert_eq!(header[..2], ["axis", "error on training rows"]);
    let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    assert_eq!(
        rows.iter().map(|row| &row[0]).collect::<Vec<_>>(),
        ["Fx (N)", "Fy (N)", "Fz (N)", "Mx (N·m)", "My (N·m)", "Mz (N·m)"]
    );
    assert!(rows.iter().all(|row| row[1].parse::<f64>().is_ok()), "{rows:?}");
    assert!(String::from_utf8_lossy(&output.stderr).contains("cubic + offset"));
    let quiet = program::output(dir.path(), &format!("{fit} --as csv --quiet"));
    assert_eq!(quiet.stdout, output.stdout);
    assert!(!String::from_utf8_lossy(&quiet.stderr).contains("cubic + offset"));
    let markdown = program::output(dir.path(), &format!("{fit} --as markdown")).stdout;
    let markdown = String::from_utf8(markdown).unwrap();
    let mut table =
        markdown.lines().skip_while(|line| !line.starts_with("| axis | error on training rows |"));
    assert!(table.nth(1).unwrap().starts_with("| :-- | --: |"), "{markdown}");
    program::refused(dir.path(), &format!("{fit} --as csv --json"));
}

#[test]
fn colour_is_used_on_request_and_never_by_default_into_a_pipe() {
    let styled = |arguments: &str, no_color: bool| {
        let mut command = program::command(Path::new("."));
        command.args(arguments.split_whitespace()).env("TERM", "xterm");
        match no_color {
            true => command.env("NO_COLOR", "1"),
            false => command.env_remove("NO_COLOR"),
        };
        let output = command.output().unwrap();
        [output.stdout, output.stderr].concat().contains(&0x1B)
    };
    // An error of a command, one of the command line, and help.
    for arguments in ["info no-such-file", "fit --no-such-option", "fit --help"] {
        assert!(!styled(arguments, false), "{arguments}");
        assert!(styled(&format!("--color always {arguments}"), true), "{arguments}");
        assert!(!styled(&format!("--color never {arguments}"), false), "{arguments}");
    }
}
