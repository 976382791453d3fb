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
    let said = program::output(Path::new("."), "");
    assert_eq!(said.status.code(), Some(2));
    let text = String::from_utf8(said.stderr).unwrap();
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
