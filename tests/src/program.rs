//! Running `shellcal` as its users do, and what it has written.
//!
//! For tests: what goes wrong is a panic that says what it was.
#![expect(clippy::unwrap_used, reason = "a test may panic and say why")]

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use serde_json::Value;

/// Names the Python that has packages which read tables and bags.
pub const PYTHON: &str = "SHELLCAL_PYTHON";

/// How often a command is given to a board that does not answer.
const ATTEMPTS: u32 = 20;

/// The program, which lies beside the tests.
fn shellcal() -> PathBuf {
    let this = std::env::current_exe().unwrap();
    let program = this.ancestors().nth(2).unwrap().join("shellcal");
    assert!(program.exists(), "build the package `shellcal` first, in the profile of the tests");
    program
}

/// The program in a directory, without arguments. Calibrations that it makes are of a day in 2017.
pub fn command(dir: &(impl AsRef<Path> + ?Sized)) -> Command {
    let mut command = Command::new(shellcal());
    command.current_dir(dir).env("SOURCE_DATE_EPOCH", "1500000000");
    command
}

/// The Python that has packages which read tables and bags; `cargo xtask test` sets it up.
pub fn python() -> Command {
    Command::new(std::env::var_os(PYTHON).unwrap())
}

/// A program that is ended with its owner, if it has not ended by itself.
#[derive(Debug)]
pub struct Running(pub Child);

impl Drop for Running {
    fn drop(&mut self) {
        _ = self.0.kill();
        _ = self.0.wait();
    }
}

/// Starts a command in a directory; spaces separate its arguments.
pub fn start(dir: &(impl AsRef<Path> + ?Sized), arguments: &str) -> Child {
    command(dir)
        .args(arguments.split_whitespace())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// Runs a command to its end.
pub fn output(dir: &(impl AsRef<Path> + ?Sized), arguments: &str) -> Output {
    start(dir, arguments).wait_with_output().unwrap()
}

/// Runs a command that must end with this exit code; what it prints, and what it says.
pub fn ended(dir: &(impl AsRef<Path> + ?Sized), arguments: &str, code: i32) -> (String, String) {
    check(output(dir, arguments), arguments, code)
}

/// Runs a command that must succeed; what it prints.
pub fn succeed(dir: &(impl AsRef<Path> + ?Sized), arguments: &str) -> String {
    ended(dir, arguments, 0).0
}

/// Runs a command that must succeed; the document that it prints.
pub fn json(dir: &(impl AsRef<Path> + ?Sized), arguments: &str) -> Value {
    serde_json::from_str(&succeed(dir, arguments)).unwrap()
}

/// Runs a command that must not be able to run, nor print or leave anything; what it says.
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

/// Runs a command that must end with this exit code; what it prints and says.
pub fn run(dir: &(impl AsRef<Path> + ?Sized), arguments: &str, code: i32) -> String {
    finish(start(dir, arguments), arguments, code)
}

/// Like [`run`], again and again while there is no answer: for a board that runs when the machine has
/// time for it, where the program expects one of its own.
pub fn run_patiently(dir: &Path, arguments: &str, code: i32) -> String {
    for _ in 0..ATTEMPTS {
        let output = output(dir, arguments);
        if !String::from_utf8_lossy(&output.stderr).contains("no answer to") {
            return both(check(output, arguments, code));
        }
    }
    panic!("{arguments}: no answer in {ATTEMPTS} attempts");
}

/// Waits for the end of a command, which must have this exit code; what it prints and says.
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

/// A document that a command has written into a directory.
pub fn document(dir: &(impl AsRef<Path> + ?Sized), name: &str) -> Value {
    serde_json::from_slice(&fs::read(dir.as_ref().join(name)).unwrap()).unwrap()
}

/// Ctrl-C.
pub fn interrupt(child: &Child) {
    let kill = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    assert!(kill.unwrap().success());
}

/// Waits for a log to grow.
pub fn wait_for_rows(log: &Path, rows: usize) {
    // When to give up, which is no statement on how long it should take.
    let deadline = Instant::now() + Duration::from_secs(180);
    // The header is a line too.
    while fs::read(log).map_or(0, |text| text.iter().filter(|&&byte| byte == b'\n').count()) <= rows
    {
        assert!(Instant::now() < deadline, "the log does not grow any more");
        thread::sleep(Duration::from_millis(20));
    }
}

/// A number in what `--json` prints.
pub fn number(json: &str, name: &str) -> u64 {
    let document: Value = serde_json::from_str(json).unwrap();
    document[name].as_u64().unwrap_or_else(|| panic!("no number `{name}` in {json}"))
}

/// A recording, column by column.
#[derive(Clone, Debug)]
pub struct Recording {
    header: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Recording {
    /// The recording in a file.
    pub fn read(path: &Path) -> Self {
        let text = fs::read_to_string(path).unwrap();
        let fields = |line: &str| line.split(',').map(str::to_owned).collect::<Vec<_>>();
        let mut lines = text.lines().map(fields);
        Self { header: lines.next().unwrap(), rows: lines.collect() }
    }

    /// How many rows it has.
    pub fn rows(&self) -> usize {
        self.rows.len()
    }

    /// The column of a name.
    pub fn text(&self, name: &str) -> Vec<&str> {
        let at = self.header.iter().position(|column| column == name).unwrap();
        self.rows.iter().map(|row| row[at].as_str()).collect()
    }

    /// The column of a name, in which there must be numbers.
    pub fn numbers(&self, name: &str) -> Vec<f64> {
        self.text(name).iter().map(|field| field.parse().unwrap()).collect()
    }

    /// Several columns, row by row.
    pub fn table<const N: usize>(&self, names: [&str; N]) -> Vec<[f64; N]> {
        let columns = names.map(|name| self.numbers(name));
        (0..self.rows()).map(|row| columns.each_ref().map(|column| column[row])).collect()
    }
}
