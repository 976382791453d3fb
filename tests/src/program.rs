//! Runs `shellcal` as users do, and reads its output. Errors are panics.
#![expect(clippy::unwrap_used, reason = "a test may panic and say why")]

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use serde_json::Value;

/// Python with packages for tables and bags.
pub const PYTHON: &str = "SHELLCAL_PYTHON";

const ATTEMPTS: u32 = 20;

pub fn shellcal() -> PathBuf {
    let this = std::env::current_exe().unwrap();
    let program = this.ancestors().nth(2).unwrap().join("shellcal");
    assert!(program.exists(), "build the package `shellcal` first, in the profile of the tests");
    program
}

/// Returns the program in a directory. Its calibrations are dated to a day in 2017.
pub fn command(dir: &(impl AsRef<Path> + ?Sized)) -> Command {
    let mut command = Command::new(shellcal());
    command.current_dir(dir).env("SOURCE_DATE_EPOCH", "1500000000");
    command
}

pub fn python() -> Command {
    Command::new(std::env::var_os(PYTHON).unwrap())
}

/// A process that is killed when its owner is dropped.
#[derive(Debug)]
pub struct Running(pub Child);

impl Drop for Running {
    fn drop(&mut self) {
        _ = self.0.kill();
        _ = self.0.wait();
    }
}

/// Starts a command; spaces separate its arguments.
pub fn start(dir: &(impl AsRef<Path> + ?Sized), arguments: &str) -> Child {
    command(dir)
        .args(arguments.split_whitespace())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

pub fn output(dir: &(impl AsRef<Path> + ?Sized), arguments: &str) -> Output {
    start(dir, arguments).wait_with_output().unwrap()
}

/// Runs a command with this exit code; returns its output and its messages.
pub fn ended(dir: &(impl AsRef<Path> + ?Sized), arguments: &str, code: i32) -> (String, String) {
    check(output(dir, arguments), arguments, code)
}

pub fn succeed(dir: &(impl AsRef<Path> + ?Sized), arguments: &str) -> String {
    ended(dir, arguments, 0).0
}

pub fn json(dir: &(impl AsRef<Path> + ?Sized), arguments: &str) -> Value {
    serde_json::from_str(&succeed(dir, arguments)).unwrap()
}

/// Runs a command that must refuse to run, without output or files; returns its messages.
pub fn refused(dir: &(impl AsRef<Path> + ?Sized), arguments: &str) -> String {
    let before = names(dir.as_ref());
    let (printed, said) = ended(dir, arguments, 2);
    assert_eq!(printed, "", "{arguments}: {said}");
    assert_eq!(names(dir.as_ref()), before, "{arguments}: {said}");
    said
}

fn names(dir: &Path) -> Vec<OsString> {
    let mut names: Vec<_> =
        fs::read_dir(dir).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    names
}

pub fn run(dir: &(impl AsRef<Path> + ?Sized), arguments: &str, code: i32) -> String {
    finish(start(dir, arguments), arguments, code)
}

/// Runs a command until there is an answer: on a busy machine a simulated board may be too slow.
pub fn run_patiently(dir: &Path, arguments: &str, code: i32) -> String {
    for _ in 0..ATTEMPTS {
        let output = output(dir, arguments);
        if !String::from_utf8_lossy(&output.stderr).contains("no answer to") {
            return both(check(output, arguments, code));
        }
    }
    panic!("{arguments}: no answer in {ATTEMPTS} attempts");
}

pub fn finish(child: Child, arguments: &str, code: i32) -> String {
    both(check(child.wait_with_output().unwrap(), arguments, code))
}

fn both((printed, said): (String, String)) -> String {
    printed + &said
}

fn check(output: Output, arguments: &str, code: i32) -> (String, String) {
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(code), "{arguments}: {said}");
    (String::from_utf8(output.stdout).unwrap(), said)
}

pub fn document(dir: &(impl AsRef<Path> + ?Sized), name: &str) -> Value {
    serde_json::from_slice(&fs::read(dir.as_ref().join(name)).unwrap()).unwrap()
}

pub fn interrupt(child: &Child) {
    let kill = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    assert!(kill.unwrap().success());
}

pub fn wait_for_rows(log: &Path, rows: usize) {
    // A timeout, far longer than expected.
    let deadline = Instant::now() + Duration::from_secs(180);
    while fs::read(log).map_or(0, |text| text.iter().filter(|&&byte| byte == b'\n').count()) <= rows
    {
        assert!(Instant::now() < deadline, "the log does not grow any more");
        thread::sleep(Duration::from_millis(20));
    }
}

pub fn number(json: &str, name: &str) -> u64 {
    let document: Value = serde_json::from_str(json).unwrap();
    document[name].as_u64().unwrap_or_else(|| panic!("no number `{name}` in {json}"))
}

#[derive(Clone, Debug)]
pub struct Recording {
    header: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Recording {
    pub fn read(path: &Path) -> Self {
        let text = fs::read_to_string(path).unwrap();
        let fields = |line: &str| line.split(',').map(str::to_owned).collect::<Vec<_>>();
        let mut lines = text.lines().map(fields);
        Self { header: lines.next().unwrap(), rows: lines.collect() }
    }

    pub fn rows(&self) -> usize {
        self.rows.len()
    }

    pub fn text(&self, name: &str) -> Vec<&str> {
        let at = self.header.iter().position(|column| column == name).unwrap();
        self.rows.iter().map(|row| row[at].as_str()).collect()
    }

    pub fn numbers(&self, name: &str) -> Vec<f64> {
        self.text(name).iter().map(|field| field.parse().unwrap()).collect()
    }

    pub fn table<const N: usize>(&self, names: [&str; N]) -> Vec<[f64; N]> {
        let columns = names.map(|name| self.numbers(name));
        (0..self.rows()).map(|row| columns.each_ref().map(|column| column[row])).collect()
    }
}
