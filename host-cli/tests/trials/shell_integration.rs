//! `shellcal completions` and `shellcal man`, asked by the programs that they are for.

use std::fs;
use std::path::Path;
use std::process::Command;

use system_tests::program;

/// What bash completes the last word of a command line to; `compopt` works at a prompt only.
fn completed_by_bash(script: &Path, line: &[&str]) -> Vec<String> {
    let words: Vec<String> = line.iter().map(|word| format!("'{word}'")).collect();
    let ask = format!(
        "compopt() {{ :; }}; source '{}'; COMP_WORDS=({}); COMP_CWORD={}; _shellcal shellcal '{}' '{}'; \
         printf '%s\\n' \"${{COMPREPLY[@]}}\"",
        script.display(),
        words.join(" "),
        line.len() - 1,
        line[line.len() - 1],
        line[line.len() - 2],
    );
    let output = Command::new("bash")
        .args(["--norc", "-c", &ask])
        .current_dir(script.parent().unwrap())
        .output()
        .unwrap();
    assert!(output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect()
}

#[cfg(unix)]
#[test]
fn bash_completes_commands_options_choices_and_files() {
    let dir = tempfile::tempdir().unwrap();
    let script = dir.path().join("shellcal.bash");
    fs::write(&script, program::output(dir.path(), "completions bash").stdout).unwrap();
    fs::write(dir.path().join("training.csv"), "").unwrap();
    let complete = |line: &[&str]| completed_by_bash(&script, line);
    assert_eq!(complete(&["shellcal", "conv"]), ["convert"]);
    assert_eq!(complete(&["shellcal", "fit", "--trunc"]), ["--truncate"]);
    assert_eq!(complete(&["shellcal", "fit", "--covariance", "gr"]), ["groups"]);
    assert_eq!(complete(&["shellcal", "fit", "--output", "train"]), ["training.csv"]);
    assert_eq!(complete(&["shellcal", "synth", "tri"]), ["trial", "trials"]);
}

#[test]
fn who_says_nothing_is_told_where_to_start() {
    let text = program::refused(Path::new("."), "");
    for start in ["info", "fit", "convert", "batch", "record", "help"] {
        assert!(text.contains(&format!("shellcal {start}")), "{text}");
    }
    assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");
}

#[test]
fn every_shell_gets_a_script_that_names_all_commands() {
    let dir = tempfile::tempdir().unwrap();
    for shell in ["bash", "elvish", "fish", "powershell", "zsh"] {
        let script = program::output(dir.path(), &format!("completions {shell}")).stdout;
        let script = String::from_utf8(script).unwrap();
        for command in ["record", "fit", "convert", "report", "simulate"] {
            assert!(script.contains(command), "{shell}: {command}");
        }
    }
}

/// Groff is what `man` renders pages with.
#[cfg(unix)]
#[test]
#[cfg_attr(not(groff), ignore = "groff is not installed")]
fn the_pages_of_the_manual_render_without_warnings() {
    let dir = tempfile::tempdir().unwrap();
    program::run(dir.path(), "man pages", 0);
    let pages: Vec<_> = fs::read_dir(dir.path().join("pages")).unwrap().collect();
    assert!(pages.len() > 25, "{} pages", pages.len());
    for page in pages {
        let page = page.unwrap().path();
        let output = Command::new("groff")
            .args(["-K", "utf8", "-man", "-Tutf8", "-ww", "-z"])
            .arg(&page)
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success() && said.is_empty(), "{}: {said}", page.display());
    }
}

/// What zsh makes of command lines when somebody presses Tab at a prompt of its own: one zsh drives another.
const DRIVE_ZSH: &str = r#"
zmodload zsh/zpty
zpty -b prompt 'zsh -f -i'
heard() {
  local out chunk tries=0
  while (( tries++ < 1200 )); do
    if zpty -r -t prompt chunk; then out+=$chunk; [[ $out == *$1* ]] && break; else sleep 0.05; fi
  done
  print -r -- "$out"
}
zpty -w prompt "PS1=; unsetopt beep; fpath=($PWD \$fpath); autoload -Uz compinit; compinit -u -D"
zpty -w prompt "show() { print -r -- \"<<\$BUFFER>>\"; BUFFER=; zle accept-line }; zle -N show"
zpty -w prompt "bindkey '^X' show; print REA''DY"
heard READY > /dev/null
for line in "$@"; do
  zpty -n -w prompt "$line"$'\t\x18'
  heard '>>' | grep -a -o '<<.*>>'
done
"#;

#[cfg(unix)]
#[test]
#[cfg_attr(not(zsh), ignore = "zsh is not installed")]
fn zsh_completes_commands_options_choices_and_files() {
    let dir = tempfile::tempdir().unwrap();
    let script = program::output(dir.path(), "completions zsh").stdout;
    fs::write(dir.path().join("_shellcal"), script).unwrap();
    fs::write(dir.path().join("training.csv"), "").unwrap();
    fs::write(dir.path().join("drive.zsh"), DRIVE_ZSH).unwrap();
    let lines = [
        ("shellcal conv", "shellcal convert "),
        ("shellcal fit --trunc", "shellcal fit --truncate="),
        ("shellcal fit --covariance gr", "shellcal fit --covariance groups "),
        ("shellcal fit --output train", "shellcal fit --output training.csv "),
        ("shellcal doc", "shellcal doctor "),
    ];
    let output = Command::new("zsh")
        .args(["-f", "drive.zsh"])
        .args(lines.map(|(line, _)| line))
        .current_dir(dir.path())
        .output()
        .unwrap();
    let completed = String::from_utf8(output.stdout).unwrap();
    let expected: String = lines.iter().map(|(_, whole)| format!("<<{whole}>>\n")).collect();
    assert_eq!(completed, expected, "{}", String::from_utf8_lossy(&output.stderr));
}

#[cfg(unix)]
#[test]
#[cfg_attr(not(fish), ignore = "fish is not installed")]
fn fish_completes_commands_options_choices_and_files() {
    let dir = tempfile::tempdir().unwrap();
    let script = program::output(dir.path(), "completions fish").stdout;
    fs::write(dir.path().join("shellcal.fish"), script).unwrap();
    fs::write(dir.path().join("training.csv"), "").unwrap();
    let complete = |line: &str| {
        let ask = format!("source shellcal.fish; complete -C '{line}'");
        let output = Command::new("fish")
            .args(["--no-config", "-c", &ask])
            .current_dir(dir.path())
            .env("HOME", dir.path())
            .output()
            .unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        // A completion and, after a tab, what it is.
        text.lines().map(|line| line.split('\t').next().unwrap().to_owned()).collect::<Vec<_>>()
    };
    assert_eq!(complete("shellcal conv"), ["convert"]);
    assert_eq!(complete("shellcal fit --trunc"), ["--truncate"]);
    assert_eq!(complete("shellcal fit --covariance gr"), ["groups"]);
    assert_eq!(complete("shellcal fit --output train"), ["training.csv"]);
    assert_eq!(complete("shellcal synth tri"), ["trial", "trials"]);
}

/// The table of the shipped calibration, in each of its forms.
#[test]
fn tables_are_printed_as_they_are_asked_for() {
    let dir = tempfile::tempdir().unwrap();
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../calibration-data");
    let fit = format!("fit --model cubic {}", data.join("synthetic-train.csv").display());
    let output = program::output(dir.path(), &format!("{fit} --as csv"));
    assert!(output.status.success());
    // Nothing but the table, by an independent reader; the rest is said elsewhere.
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
fn colour_is_given_when_asked_for_and_never_into_a_pipe_by_itself() {
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
