//! The Python package: its extension built beside the tests, and its tests in an environment of their own
//! below `target`.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};

use crate::measure::installed;
use crate::steps::{self, cargo, target, workspace};

/// The Python that the environment is made with.
const SYSTEM_PYTHON: &str = "python3";

/// The oldest that the package is for.
const OLDEST: &str = "import sys; sys.exit(sys.version_info < (3, 10))";

/// What there is to import in a finished environment: the last package of the requirements.
const LAST: &str = "import sklearn, pyarrow, mypy, nbmake, distributed";

/// Runs the tests of the package, on the extension of this profile. Where there is no Python for them they
/// are ignored, and that is said.
pub(crate) fn test(profile: &[&str]) -> Result<()> {
    let python = match set_up() {
        Ok(python) => python,
        Err(reason) => {
            eprintln!("{reason:#}: the tests of the Python package are ignored");
            return Ok(());
        }
    };
    // With the packages of the test run, so that what these have built serves here.
    let build = ["build", "--workspace"];
    steps::run("extension of Python", &mut cargo(&[&build[..], profile].concat()))?;
    let package = assemble("checked")?;
    let mut tests = Command::new(&python);
    tests.args([
        "-m",
        "pytest",
        "--quiet",
        "--nbmake",
        "--nbmake-timeout=300",
        "tests",
        "examples",
    ]);
    tests.current_dir(workspace().join("python"));
    tests.env("PYTHONPATH", &package).env("PYTHONSAFEPATH", "1");
    tests.env("SHELLCAL_PROGRAM", target().join("checked/shellcal"));
    steps::run("tests of the Python package", &mut tests)
}

/// The package with the extension in it, as a wheel has it; returns the folder that holds it.
fn assemble(profile: &str) -> Result<PathBuf> {
    let folder = target().join("python-package");
    let package = folder.join("shellcal");
    let _ = std::fs::remove_dir_all(&package);
    std::fs::create_dir_all(&package).context("no folder for the Python package")?;
    for entry in std::fs::read_dir(workspace().join("python/python/shellcal"))? {
        let path = entry?.path();
        if let Some(name) = path.file_name().filter(|_| path.is_file()) {
            std::fs::copy(&path, package.join(name))?;
        }
    }
    let (built, name) = match std::env::consts::OS {
        "macos" => ("lib_native.dylib", "_native.abi3.so"),
        "windows" => ("_native.dll", "_native.pyd"),
        _ => ("lib_native.so", "_native.abi3.so"),
    };
    let built = target().join(profile).join(built);
    std::fs::copy(&built, package.join(name))
        .with_context(|| format!("`{}` was not built", built.display()))?;
    Ok(folder)
}

/// Finds the Python of the environment, or makes it.
fn set_up() -> Result<PathBuf> {
    let environment = target().join("python-tests");
    let python = environment.join("bin/python");
    let has = |python: &Path, code| installed(&python.to_string_lossy(), &["-c", code]);
    if has(&python, LAST) {
        return Ok(python);
    }
    ensure!(has(Path::new(SYSTEM_PYTHON), OLDEST), "`{SYSTEM_PYTHON}` of 3.10 or later is missing");
    let mut make = Command::new(SYSTEM_PYTHON);
    steps::run("Python environment", make.args(["-m", "venv"]).arg(&environment))?;
    let mut pip = Command::new(&python);
    pip.args(["-m", "pip", "install", "--quiet", "--requirement"]);
    steps::run(
        "packages of the tests",
        pip.arg(workspace().join("python/tests/requirements.txt")),
    )?;
    ensure!(has(&python, LAST), "the packages are installed but cannot be used");
    Ok(python)
}
