//! `cargo xtask package`: what a release consists of. An archive with the program, its manual, completions and
//! the licences of all that it is made of; and, where `dpkg-deb` is, a package of Debian.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};
use cargo_metadata::MetadataCommand;

use crate::licences;
use crate::measure::installed;
use crate::steps::{self, cargo, target, workspace};

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// The system to build for [default: this one]
    #[arg(long)]
    target: Option<String>,

    /// Take a program that has been built already, elsewhere perhaps
    #[arg(long, value_name = "FILE")]
    program: Option<PathBuf>,
}

/// What the names of files with a licence begin with.
const LICENCES: [&str; 5] = ["LICENSE", "LICENCE", "COPYING", "NOTICE", "UNLICENSE"];

/// Where each shell looks for completions, and what it calls them.
const SHELLS: [(&str, &str, &str); 3] = [
    ("bash", "shellcal.bash", "usr/share/bash-completion/completions/shellcal"),
    ("zsh", "_shellcal", "usr/share/zsh/vendor-completions/_shellcal"),
    ("fish", "shellcal.fish", "usr/share/fish/vendor_completions.d/shellcal.fish"),
];

pub(crate) fn run(args: &Args) -> Result<()> {
    let host = host()?;
    let system = args.target.as_deref().unwrap_or(&host);
    let program = match &args.program {
        Some(program) => program.clone(),
        None => build(args.target.as_deref())?,
    };
    // Completions and manual are what a program says that runs here.
    let is_native = system.contains(std::env::consts::OS) || system.contains("apple");
    let speaker = if is_native { program.clone() } else { build(None)? };
    let version = version(&speaker)?;
    let folder = target().join("package");
    fs::create_dir_all(&folder)?;
    let name = format!("shellcal-{version}-{system}");
    let staged = folder.join(&name);
    stage(&program, &speaker, system, &staged)?;
    let is_windows = system.contains("windows");
    let archive = folder.join(format!("{name}.{}", if is_windows { "zip" } else { "tar.gz" }));
    let _ = fs::remove_file(&archive);
    let mut pack = Command::new(if is_windows { "zip" } else { "tar" });
    pack.args(if is_windows { ["-qr"] } else { ["-czf"] }).arg(&archive).arg(&name);
    steps::run("archive", pack.current_dir(&folder))?;
    println!("{}", archive.display());
    if system.contains("linux") && installed("dpkg-deb", &["--version"]) {
        println!("{}", debian(&staged, system, &version, &folder)?.display());
    }
    Ok(())
}

fn build(system: Option<&str>) -> Result<PathBuf> {
    let mut build = cargo(&["build", "--release", "--locked", "--package", "shellcal"]);
    let mut folder = target();
    if let Some(system) = system {
        build.args(["--target", system]);
        folder.push(system);
    }
    steps::run("program", &mut build)?;
    Ok(folder.join("release").join(format!("shellcal{}", std::env::consts::EXE_SUFFIX)))
}

/// The system that this compiler is of.
fn host() -> Result<String> {
    let output = Command::new("rustc").arg("-vV").output().context("cannot start rustc")?;
    let text = String::from_utf8(output.stdout)?;
    let host = text.lines().find_map(|line| line.strip_prefix("host: "));
    Ok(host.context("rustc names no host")?.to_owned())
}

fn version(program: &Path) -> Result<String> {
    let said = said(program, &["--version"])?;
    Ok(said.trim().strip_prefix("shellcal ").context("no version")?.to_owned())
}

/// What the program prints.
fn said(program: &Path, arguments: &[&str]) -> Result<String> {
    let output = Command::new(program).args(arguments).output();
    let output = output.with_context(|| format!("cannot start `{}`", program.display()))?;
    ensure!(output.status.success(), "`shellcal {}` fails", arguments.join(" "));
    Ok(String::from_utf8(output.stdout)?)
}

/// Puts all that is in an archive into a folder; `speaker` is the program as it runs here.
fn stage(program: &Path, speaker: &Path, system: &str, staged: &Path) -> Result<()> {
    let _ = fs::remove_dir_all(staged);
    for folder in ["completions", "man", "linux"] {
        fs::create_dir_all(staged.join(folder))?;
    }
    let name = if system.contains("windows") { "shellcal.exe" } else { "shellcal" };
    fs::copy(program, staged.join(name)).with_context(|| program.display().to_string())?;
    for file in ["README.md", "CHANGELOG.md", "LICENSE-APACHE", "LICENSE-MIT"] {
        fs::copy(workspace().join(file), staged.join(file)).context(file)?;
    }
    fs::copy(
        workspace().join("host-cli/assets/linux/60-shellcal.rules"),
        staged.join("linux/60-shellcal.rules"),
    )?;
    for (shell, file, _) in SHELLS {
        fs::write(staged.join("completions").join(file), said(speaker, &["completions", shell])?)?;
    }
    let script = said(speaker, &["completions", "powershell"])?;
    fs::write(staged.join("completions/_shellcal.ps1"), script)?;
    said(speaker, &["man", &staged.join("man").to_string_lossy()])?;
    fs::write(staged.join("THIRD-PARTY.txt"), third_party(system)?)?;
    Ok(())
}

/// The licences of all that the program is made of, each text once.
fn third_party(system: &str) -> Result<String> {
    let metadata = MetadataCommand::new().current_dir(workspace()).exec()?;
    let folders: BTreeMap<(&str, String), &Path> = metadata
        .packages
        .iter()
        .filter_map(|package| {
            let folder = package.manifest_path.parent()?.as_std_path();
            Some(((package.name.as_str(), package.version.to_string()), folder))
        })
        .collect();
    let mut packages = licences::program_for(system)?;
    packages.sort();
    packages.dedup();
    let mut texts: BTreeMap<String, Vec<String>> = BTreeMap::new();
    let mut list = String::from("shellcal is made of these packages.\n\n");
    for package in &packages {
        let name = format!("{} {}", package.name, package.version);
        list += &format!("{name}: {}\n", package.licence);
        let folder = folders.get(&(package.name.as_str(), package.version.to_string()));
        for text in folder.map_or_else(|| Ok(Vec::new()), |folder| licence_texts(folder))? {
            texts.entry(text).or_default().push(name.clone());
        }
    }
    ensure!(!texts.is_empty(), "no text of a licence was found");
    list += "\nThe plotting library of reports is plotly.js, the font of pictures DejaVu Sans:\n";
    for asset in ["report/plotly-LICENSE.txt", "DejaVu-LICENSE.txt"] {
        let text = fs::read_to_string(workspace().join("host-cli/assets").join(asset))?;
        list += &format!("\n{}\n{text}", "-".repeat(80));
    }
    for (text, of) in texts {
        list += &format!("\n{}\n{}\n\n{text}\n", "-".repeat(80), of.join(", "));
    }
    Ok(list)
}

fn licence_texts(folder: &Path) -> Result<Vec<String>> {
    let mut files: Vec<PathBuf> = Vec::new();
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().to_uppercase();
        if entry.file_type()?.is_file() && LICENCES.iter().any(|start| name.starts_with(start)) {
            files.push(entry.path());
        }
    }
    files.sort();
    files.iter().map(|file| Ok(fs::read_to_string(file)?.trim().to_owned())).collect()
}

/// A package of Debian from what is in the archive.
fn debian(staged: &Path, system: &str, version: &str, folder: &Path) -> Result<PathBuf> {
    let architecture = if system.starts_with("aarch64") { "arm64" } else { "amd64" };
    let tree = folder.join("deb");
    let _ = fs::remove_dir_all(&tree);
    let put = |from: &Path, to: &str| -> Result<()> {
        let to = tree.join(to);
        fs::create_dir_all(to.parent().context("no folder")?)?;
        fs::copy(from, to).with_context(|| from.display().to_string())?;
        Ok(())
    };
    put(&staged.join("shellcal"), "usr/bin/shellcal")?;
    put(&staged.join("linux/60-shellcal.rules"), "usr/lib/udev/rules.d/60-shellcal.rules")?;
    for (_, file, place) in SHELLS {
        put(&staged.join("completions").join(file), place)?;
    }
    for entry in fs::read_dir(staged.join("man"))? {
        let page = entry?.path();
        let name = page.file_name().context("a page has a name")?.to_string_lossy().into_owned();
        put(&page, &format!("usr/share/man/man1/{name}"))?;
    }
    let documents = "usr/share/doc/shellcal";
    put(&staged.join("THIRD-PARTY.txt"), &format!("{documents}/THIRD-PARTY.txt"))?;
    put(&staged.join("LICENSE-APACHE"), &format!("{documents}/LICENSE-APACHE"))?;
    put(&staged.join("LICENSE-MIT"), &format!("{documents}/copyright"))?;
    let control = format!(
        "Package: shellcal\nVersion: {version}\nArchitecture: {architecture}\nSection: science\n\
         Priority: optional\nMaintainer: shellcal <https://github.com/shellcal/shellcal>\n\
         Homepage: https://github.com/shellcal/shellcal\nDepends: libc6 (>= 2.35), libgcc-s1\n\
         Description: calibration and trial processing for an optical force/torque shell\n \
         Fits calibrations of an optical six-axis force/torque sensor, records from its board,\n \
         converts logs to forces and moments, and evaluates trials of robots that carry it.\n"
    );
    fs::create_dir_all(tree.join("DEBIAN"))?;
    fs::write(tree.join("DEBIAN/control"), control)?;
    let package = folder.join(format!("shellcal_{version}_{architecture}.deb"));
    let mut dpkg = Command::new("dpkg-deb");
    dpkg.args(["--root-owner-group", "--build"]).arg(&tree).arg(&package);
    steps::run("package of Debian", &mut dpkg)?;
    Ok(package)
}
