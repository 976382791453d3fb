//! The manual of a release, and the completion scripts for shells. A test writes them, since the program
//! itself needs neither, and tests them with the programs that use them.

use std::any::TypeId;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use clap::{Arg, CommandFactory, ValueHint};
use clap_complete::Shell;
use clap_mangen::Man;

use crate::Args;
use crate::files::{InputPath, OutputLocation, OutputPath};

/// The scripts of a release, by the names that shells look for.
const SCRIPTS: [(Shell, &str); 5] = [
    (Shell::Bash, "shellcal.bash"),
    (Shell::Zsh, "_shellcal"),
    (Shell::Fish, "shellcal.fish"),
    (Shell::PowerShell, "_shellcal.ps1"),
    (Shell::Elvish, "shellcal.elv"),
];

fn completions(shell: Shell) -> String {
    let mut command = Args::command();
    command.build();
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut with_hints(command), "shellcal", &mut script);
    String::from_utf8(script).unwrap()
}

/// Adds the kinds of files that arguments name, derived from their types.
fn with_hints(command: clap::Command) -> clap::Command {
    let hint = |argument: Arg| {
        let kind = argument.get_value_parser().type_id();
        if kind == TypeId::of::<InputPath>() || kind == TypeId::of::<OutputPath>() {
            argument.value_hint(ValueHint::FilePath)
        } else if kind == TypeId::of::<OutputLocation>() {
            argument.value_hint(ValueHint::AnyPath)
        } else {
            argument
        }
    };
    command.mut_args(hint).mut_subcommands(with_hints)
}

fn write_pages(folder: &Path, command: clap::Command) -> usize {
    let is_page = |command: &&clap::Command| !command.is_hide_set() && command.get_name() != "help";
    let subcommands: Vec<_> = command.get_subcommands().filter(is_page).cloned().collect();
    let page = Man::new(command);
    let mut bytes = Vec::new();
    page.render(&mut bytes).unwrap();
    write(&folder.join(page.get_filename()), &bytes);
    1 + subcommands.into_iter().map(|command| write_pages(folder, command)).sum::<usize>()
}

fn write(path: &Path, bytes: &[u8]) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, bytes).unwrap();
}

/// Completions by bash of the last word of a command line. `compopt` works only at a prompt, so it is stubbed.
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
    fs::write(&script, completions(Shell::Bash)).unwrap();
    fs::write(dir.path().join("training.csv"), "").unwrap();
    let complete = |line: &[&str]| completed_by_bash(&script, line);
    assert_eq!(complete(&["shellcal", "conv"]), ["convert"]);
    assert_eq!(complete(&["shellcal", "fit", "--trunc"]), ["--truncate"]);
    assert_eq!(complete(&["shellcal", "fit", "--covariance", "gr"]), ["groups"]);
    assert_eq!(complete(&["shellcal", "fit", "--output", "train"]), ["training.csv"]);
    assert_eq!(complete(&["shellcal", "synth", "tri"]), ["trial", "trials"]);
}

/// `cargo xtask manual` sets `SHELLCAL_MANUAL` to the directory of a release.
#[test]
fn the_manual_is_written_with_a_script_for_every_shell() {
    let dir = tempfile::tempdir().unwrap();
    let folder = std::env::var_os("SHELLCAL_MANUAL").map_or(dir.path().to_owned(), PathBuf::from);
    for (shell, file) in SCRIPTS {
        let script = completions(shell);
        for command in ["record", "fit", "convert", "report", "simulate"] {
            assert!(script.contains(command), "{shell}: {command}");
        }
        write(&folder.join("completions").join(file), script.as_bytes());
    }
    let mut command = Args::command();
    command.build();
    let count = write_pages(&folder.join("man"), command);
    assert!(count > 25, "{count} pages");
}

/// `man` renders pages with groff.
#[cfg(unix)]
#[test]
#[cfg_attr(not(groff), ignore = "groff is not installed")]
fn the_pages_of_the_manual_render_without_warnings() {
    let dir = tempfile::tempdir().unwrap();
    let mut command = Args::command();
    command.build();
    write_pages(dir.path(), command);
    for page in fs::read_dir(dir.path()).unwrap() {
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

/// A script for zsh that drives a second zsh and prints its command lines after a Tab at the prompt.
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
    fs::write(dir.path().join("_shellcal"), completions(Shell::Zsh)).unwrap();
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
    fs::write(dir.path().join("shellcal.fish"), completions(Shell::Fish)).unwrap();
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
        // Each line is a completion and, after a tab, its description.
        text.lines().map(|line| line.split('\t').next().unwrap().to_owned()).collect::<Vec<_>>()
    };
    assert_eq!(complete("shellcal conv"), ["convert"]);
    assert_eq!(complete("shellcal fit --trunc"), ["--truncate"]);
    assert_eq!(complete("shellcal fit --covariance gr"), ["groups"]);
    assert_eq!(complete("shellcal fit --output train"), ["training.csv"]);
    assert_eq!(complete("shellcal synth tri"), ["trial", "trials"]);
}
