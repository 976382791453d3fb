//! `cargo xtask test`: tests that the program works on this machine. After the set-up, everything
//! is built once, and the test programs run in parallel. A test that needs more than the compiler
//! is marked `#[ignore = "needs …"]`, so that plain `cargo test` leaves it out; here it runs if its
//! requirement is met. `cargo xtask check studies` runs modules named `studies`.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;

use anyhow::{Context, Result, bail, ensure};
use clap::ValueEnum;
use serde_json::Value;
use system_tests::{flashed, program};

use crate::compiler::{BOARD_TARGET, PAGE_TARGET};
use crate::image::Board;
use crate::need::{BROWSER, Need, PYTHON, SHELLS};
use crate::steps::{
    self, BUILD, EndedJob, Job, PROFILE, REAL_DATA, SCREENS, cargo, real_data, screens,
};
use crate::{firmware, python, web};

#[derive(Debug, clap::Args)]
pub(crate) struct TestArgs {
    /// Leave out the tests that need this
    #[arg(long, value_enum, value_delimiter = ',')]
    without: Vec<Part>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Part {
    /// The flashed images on a model of their microcontrollers
    Board,
    /// Pages in Chromium
    Browser,
    /// The Python package
    Python,
    /// Completions and manual in zsh, fish and groff
    Shells,
}

impl Part {
    fn needs(self) -> &'static [Need] {
        match self {
            Self::Board => &[Need::Target(BOARD_TARGET), PYTHON],
            Self::Browser => &[BROWSER],
            Self::Python => &[PYTHON],
            Self::Shells => &[SHELLS],
        }
    }
}

/// Modules that measure errors of methods over many cases, the same on every machine.
const STUDIES: &str = "studies::";

/// Reason to ignore tests that compare times: they run last, one by one.
const QUIET: &str = "needs a machine that is not busy";

const AXE: &str = "SHELLCAL_AXE";

const PAGE: &str = "SHELLCAL_WEB_PAGE";

#[derive(Default)]
struct TestEquipment {
    /// Reasons to ignore a test that do not apply here.
    met: Vec<&'static str>,
    variables: Vec<(&'static str, OsString)>,
    python: Option<PathBuf>,
}

pub(crate) fn run(args: &TestArgs) -> Result<()> {
    let is_wanted = |part: &Part| !args.without.contains(part);
    let parts: Vec<Part> = Part::value_variants().iter().copied().filter(is_wanted).collect();
    let (equipment, programs) = set_up_and_build(&parts)?;
    let without_studies = ["--skip", STUDIES];
    let job = |program: &Program| program.job(&without_studies, &equipment);
    let mut jobs: Vec<Job> = programs.iter().map(job).collect();
    if let Some(python) = &equipment.python {
        jobs.extend(python::jobs(python)?);
    }
    let documentation = cargo(&[&["test", "--workspace", "--doc"][..], &PROFILE].concat());
    jobs.push(Job { name: "examples in the documentation".to_owned(), command: documentation });
    println!("\n==> tests");
    let mut ended = run_all(jobs, &programs, &equipment)?;
    let quiet = programs.iter().filter_map(|program| program.quiet_job(&ended, &equipment));
    let quiet = steps::run_side_by_side(quiet.collect(), 1, |_| None)?;
    ended.extend(quiet);
    report(&ended, &args.without)
}

pub(crate) fn studies() -> Result<()> {
    let (equipment, programs) = set_up_and_build(&[Part::Board])?;
    let jobs = programs.iter().map(|program| program.job(&[STUDIES], &equipment)).collect();
    report(&run_all(jobs, &programs, &equipment)?, &[])
}

/// Runs jobs, and after each its ignored tests whose requirements are met.
fn run_all(
    jobs: Vec<Job>,
    programs: &[Program],
    equipment: &TestEquipment,
) -> Result<Vec<EndedJob>> {
    let more = |ended: &EndedJob| {
        let program = programs.iter().find(|program| program.name == ended.name)?;
        program.job_of_ignored(&ended.output, |reason| equipment.met.contains(&reason), equipment)
    };
    // Many tests mostly wait.
    let at_once = 1 + thread::available_parallelism()?.get();
    steps::run_side_by_side(jobs, at_once, more)
}

fn set_up_and_build(parts: &[Part]) -> Result<(TestEquipment, Vec<Program>)> {
    let needs = parts.iter().flat_map(|part| part.needs());
    let missing: Vec<_> = needs.filter_map(|need| need.meet().err()).collect();
    if !missing.is_empty() {
        missing.iter().for_each(|reason| eprintln!("{reason}"));
        bail!("not all is here that the tests need; `--without` leaves out a part of them");
    }
    let has = |part| parts.contains(&part);
    let mut equipment = TestEquipment::default();
    thread::scope(|scope| {
        let model_python =
            scope.spawn(|| has(Part::Board).then(firmware::set_up_model).transpose());
        let python = scope.spawn(|| has(Part::Python).then(python::set_up).transpose());
        // The linker of the page works on one core.
        let page = scope.spawn(|| has(Part::Browser).then(page).transpose());
        if has(Part::Board) {
            let [board, ..] = Board::ALL.map(Board::build);
            equipment.give("needs the flashed image", flashed::IMAGE, board?);
        }
        let programs = programs()?;
        let joined = "an environment is set up without a panic";
        if let Some(python) = model_python.join().expect(joined)? {
            equipment.variables.push((flashed::PYTHON, python.into()));
        }
        equipment.python = python.join().expect(joined)?;
        if let Some(python) = equipment.python.clone() {
            let reason = "needs a Python with packages that read tables and bags";
            equipment.give(reason, program::PYTHON, python);
        }
        if let Some(page) = page.join().expect(joined)?.flatten() {
            equipment.give("needs Chromium and the page", PAGE, page);
        }
        equipment.add_rest(has(Part::Browser))?;
        Ok((equipment, programs))
    })
}

impl TestEquipment {
    fn give(&mut self, reason: &'static str, variable: &'static str, value: impl Into<OsString>) {
        self.met.push(reason);
        self.variables.push((variable, value.into()));
    }

    fn add_rest(&mut self, has_browser: bool) -> Result<()> {
        if has_browser {
            self.met.push("needs Chromium");
            let screens = screens();
            std::fs::create_dir_all(&screens)?;
            self.variables.push((SCREENS, screens.into()));
            match axe() {
                Ok(file) => self.variables.push((AXE, file.into())),
                Err(reason) => eprintln!("{reason:#}: pages are not held against axe-core"),
            }
        }
        let Some(recordings) = real_data() else { return Ok(()) };
        ensure!(recordings.is_dir(), "{REAL_DATA} names `{}`", recordings.display());
        if recordings.join(system_tests::REFERENCE_VALUES).exists() {
            self.met.push("needs the reference values beside the recordings");
        }
        self.give("needs the recordings", REAL_DATA, recordings);
        if self.met.contains(&"needs Chromium and the page") {
            self.met.push("needs Chromium, the page and the recordings");
        }
        Ok(())
    }
}

/// Builds the page that fits; `None`, with a message, if there is no compiler for it.
fn page() -> Result<Option<PathBuf>> {
    match Need::Target(PAGE_TARGET).meet() {
        Ok(()) => web::build().map(Some),
        Err(reason) => {
            eprintln!("{reason:#}: the page that fits is not tested");
            Ok(None)
        }
    }
}

/// Fetches axe-core, the accessibility rules, from npm's registry; returns its file.
fn axe() -> Result<PathBuf> {
    let folder = steps::scratch("axe-core")?;
    let file = folder.join("node_modules/axe-core/axe.min.js");
    if !file.exists() {
        let mut npm = Command::new("npm");
        npm.args(["install", "--silent", "--no-audit", "--no-fund", "--ignore-scripts"]);
        steps::run("axe-core", npm.arg("--prefix").arg(&folder).arg("axe-core@4.10.3"))?;
    }
    file.canonicalize().context("npm has installed no axe-core")
}

#[derive(Debug)]
struct Program {
    name: String,
    file: PathBuf,
    folder: PathBuf,
}

/// Builds everything with one command, so that no crate is built twice; returns the test programs,
/// those of the largest packages first.
fn programs() -> Result<Vec<Program>> {
    let format = ["--message-format", "json-render-diagnostics"];
    let mut build = cargo(&[&BUILD[..], &format, &PROFILE].concat());
    eprintln!("\n==> build: {}", steps::line(&build));
    let built = build.stdin(Stdio::null()).stderr(Stdio::inherit()).output()?;
    ensure!(built.status.success(), "the tests do not compile");
    let messages = String::from_utf8(built.stdout)?;
    let mut programs = Vec::new();
    for line in messages.lines() {
        let message: Value = serde_json::from_str(line).context("cargo says no JSON")?;
        let (Some(file), true) =
            (message["executable"].as_str(), message["profile"]["test"] == true)
        else {
            continue;
        };
        let manifest = Path::new(message["manifest_path"].as_str().context("no manifest")?);
        let folder = manifest.parent().context("a manifest has a folder")?;
        let package = folder.strip_prefix(steps::workspace()).unwrap_or(folder).display();
        let name =
            format!("{package}, {} {}", message["target"]["kind"][0], message["target"]["name"]);
        let (name, file) = (name.replace('"', ""), PathBuf::from(file));
        programs.push(Program { name, file, folder: folder.to_owned() });
    }
    let size = |program: &Program| program.file.metadata().map_or(0, |file| file.len());
    programs.sort_by_key(|program| std::cmp::Reverse(size(program)));
    Ok(programs)
}

impl Program {
    fn job(&self, which: &[&str], equipment: &TestEquipment) -> Job {
        let mut command = Command::new(&self.file);
        command.args(which);
        command.current_dir(&self.folder).env("CARGO_MANIFEST_DIR", &self.folder);
        command.envs(equipment.variables.iter().map(|(name, value)| (name, value)));
        Job { name: self.name.clone(), command }
    }

    fn job_of_ignored(
        &self,
        said: &str,
        is_met: impl Fn(&str) -> bool,
        equipment: &TestEquipment,
    ) -> Option<Job> {
        let met = ignored(said).filter(|(_, reason)| is_met(reason));
        let names: Vec<&str> = met.map(|(name, _)| name).collect();
        let mut job = self.job(&[&["--ignored", "--exact"], &names[..]].concat(), equipment);
        job.name = format!("{}, {} that need more", self.name, names.len());
        (!names.is_empty()).then_some(job)
    }

    fn quiet_job(&self, ended: &[EndedJob], equipment: &TestEquipment) -> Option<Job> {
        let own = ended.iter().find(|job| job.name == self.name)?;
        let mut job = self.job_of_ignored(&own.output, |reason| reason == QUIET, equipment)?;
        job.command.arg("--test-threads=1");
        Some(job)
    }
}

fn ignored(said: &str) -> impl Iterator<Item = (&str, &str)> {
    said.lines().filter_map(|line| line.strip_prefix("test ")?.split_once(" ... ignored, "))
}

/// Prints passed tests and the parts left out; an error if a test failed.
fn report(ended: &[EndedJob], without: &[Part]) -> Result<()> {
    let failed: Vec<_> = ended.iter().filter(|it| !it.succeeded).map(|it| &*it.name).collect();
    println!("\n{} passed", ended.iter().map(|it| passed(&it.output)).sum::<u64>());
    let ran = |name: &str| {
        let ok = format!("test {name} ... ok");
        ended.iter().any(|it| it.output.lines().any(|line| line == ok))
    };
    for (name, reason) in ended.iter().flat_map(|it| ignored(&it.output)) {
        if !ran(name) {
            println!("left out: {name}: {reason}");
        }
    }
    without.iter().for_each(|part| println!("left out: {part:?}"));
    ensure!(failed.is_empty(), "failed: {}", failed.join("; "));
    Ok(())
}

fn passed(output: &str) -> u64 {
    let count = |line: &str| line.split_once(" passed")?.0.rsplit(' ').next()?.parse::<u64>().ok();
    output.lines().filter_map(count).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SAID: &str = "running 3 tests\ntest a::b ... ok\ntest a::c ... ignored, needs Chromium\n\
        test d ... FAILED\n\ntest result: FAILED. 1 passed; 1 failed; 1 ignored; 0 measured; 0 filtered out\n";

    #[test]
    fn ignored_tests_are_found_with_their_reasons() {
        assert_eq!(ignored(SAID).collect::<Vec<_>>(), [("a::c", "needs Chromium")]);
    }

    #[test]
    fn tests_are_counted_by_the_closing_lines() {
        assert_eq!(passed(SAID), 1);
        assert_eq!(passed("2 failed, 80 passed, 1 skipped in 65.31s (0:01:05)\n"), 80);
        assert_eq!(passed("nothing passed here"), 0);
    }
}
