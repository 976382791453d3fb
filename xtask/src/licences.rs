//! Licences, duplicates and sources of the dependencies, held against `deny.toml`.
//!
//! `cargo deny` does it where it is installed. Elsewhere the same table is checked here, by what
//! `cargo tree` says. Advisories need a database from the network: `cargo deny check advisories`.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Context, Result, bail};
use cargo_metadata::semver::{Version, VersionReq};
use serde::Deserialize;
use spdx::{Expression, Licensee, ParseMode};

use crate::measure::installed;
use crate::steps::{self, cargo, workspace};

const TABLE: &str = "deny.toml";

/// Where dependencies come from.
const CRATES_IO: &str = "registry+https://github.com/rust-lang/crates.io-index";

/// What the program says of what it is made of.
const NOTICES: &str = "host-cli/assets/licences.tsv";

#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub(crate) struct Args {
    /// Write what the program says of its own dependencies
    #[arg(long)]
    write: bool,
}

pub(crate) fn run(args: Args) -> Result<()> {
    if args.write {
        std::fs::write(workspace().join(NOTICES), notices()?).context(NOTICES)?;
    }
    check()
}

pub(crate) fn check() -> Result<()> {
    if std::fs::read_to_string(workspace().join(NOTICES)).ok() != Some(notices()?) {
        bail!("`{NOTICES}` is not what the program is made of: `cargo xtask licences --write`");
    }
    check_table()
}

/// The packages in the program, on any of the systems that it is released for.
fn notices() -> Result<String> {
    let mut packages = BTreeSet::new();
    for target in SYSTEMS {
        packages.extend(program_for(target)?);
    }
    let line = |of: &Package| format!("{}\t{}\t{}\n", of.name, of.version, of.licence);
    Ok(packages.iter().map(line).collect())
}

/// The packages in the program on a system, without our own.
pub(crate) fn program_for(target: &str) -> Result<Vec<Package>> {
    let packages = tree(&["--package", "shellcal", "--edges", "normal"], target)?;
    let is_ours = |package: &Package| OURS.contains(&package.name.as_str());
    Ok(packages.into_iter().filter(|package| !is_ours(package)).collect())
}

/// Systems that there are releases for.
const SYSTEMS: [&str; 4] = [
    "x86_64-unknown-linux-gnu",
    "aarch64-unknown-linux-gnu",
    "aarch64-apple-darwin",
    "x86_64-pc-windows-msvc",
];

/// The packages of this workspace that the program is made of.
const OURS: [&str; 8] = [
    "beam-channel",
    "calibration",
    "firmware",
    "log-file",
    "shared-proto",
    "shell-data",
    "shellcal",
    "table-file",
];

fn check_table() -> Result<()> {
    if installed("cargo-deny", &["--version"]) {
        let arguments = ["deny", "--all-features", "check", "licenses", "bans", "sources"];
        return steps::run("licences and duplicates", &mut cargo(&arguments));
    }
    eprintln!("\n==> licences and duplicates, by {TABLE} (cargo-deny is not installed)");
    let read = |name: &str| -> Result<String> {
        std::fs::read_to_string(workspace().join(name)).with_context(|| format!("no `{name}`"))
    };
    let table: Table = toml::from_str(&read(TABLE)?).context(TABLE)?;
    let mut packages = BTreeSet::new();
    for target in &table.graph.targets {
        packages.extend(packages_for(target)?);
    }
    let lock: Lock = toml::from_str(&read("Cargo.lock")?).context("Cargo.lock")?;
    let faults = [table.licence_faults(&packages)?, table.duplicates(&packages)?, lock.faults()];
    let faults = faults.concat();
    faults.iter().for_each(|fault| println!("{fault}"));
    if !faults.is_empty() {
        bail!("{} faults of dependencies", faults.len());
    }
    eprintln!("    {} packages; advisories are not checked, they need the network", packages.len());
    Ok(())
}

/// What is read of `deny.toml`.
#[derive(Debug, Deserialize)]
struct Table {
    graph: Graph,
    licenses: Licences,
    bans: Bans,
}

#[derive(Debug, Deserialize)]
struct Graph {
    targets: Vec<String>,
}

#[derive(Debug, Deserialize)]
struct Licences {
    allow: Vec<String>,
    #[serde(default)]
    exceptions: Vec<Exception>,
}

/// Licences that one package may have on top.
#[derive(Debug, Deserialize)]
struct Exception {
    #[serde(rename = "crate")]
    package: String,
    allow: Vec<String>,
}

#[derive(Debug, Deserialize)]
struct Bans {
    #[serde(default)]
    skip: Vec<Skip>,
}

/// A version that may stand beside another: `name@requirement`.
#[derive(Debug, Deserialize)]
struct Skip {
    #[serde(rename = "crate")]
    package: String,
}

/// What is read of `Cargo.lock`.
#[derive(Debug, Deserialize)]
struct Lock {
    package: Vec<Locked>,
}

#[derive(Debug, Deserialize)]
struct Locked {
    name: String,
    source: Option<String>,
}

/// A package of the tree of dependencies.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Package {
    pub(crate) name: String,
    pub(crate) version: Version,
    pub(crate) licence: String,
}

fn packages_for(target: &str) -> Result<Vec<Package>> {
    tree(&["--workspace", "--all-features", "--edges", "normal,build,dev"], target)
}

fn tree(arguments: &[&str], target: &str) -> Result<Vec<Package>> {
    let format = ["--prefix", "none", "--format", "{p}|{l}", "--target", target];
    let output =
        cargo(&["tree"]).args(arguments).args(format).output().context("cannot start cargo")?;
    if !output.status.success() {
        bail!("cargo tree: {}", String::from_utf8_lossy(&output.stderr).trim_end());
    }
    let text = String::from_utf8(output.stdout)?;
    text.lines().filter(|line| !line.is_empty()).map(Package::parse).collect()
}

impl Package {
    /// Reads `name v1.2.3 (a note)|licence (*)`.
    fn parse(line: &str) -> Result<Self> {
        let package = || -> Option<Self> {
            let (package, licence) = line.split_once('|')?;
            let mut words = package.split(' ');
            let (name, version) = (words.next()?, words.next()?.strip_prefix('v')?);
            let licence = licence.trim_end_matches("(*)").trim_end().to_owned();
            Some(Self { name: name.to_owned(), version: version.parse().ok()?, licence })
        };
        package().with_context(|| format!("`cargo tree` says `{line}`"))
    }
}

impl Table {
    fn licence_faults(&self, packages: &BTreeSet<Package>) -> Result<Vec<String>> {
        let parse = |names: &[String]| -> Result<Vec<Licensee>> {
            let licence = |name: &String| Licensee::parse(name).with_context(|| name.clone());
            names.iter().map(licence).collect()
        };
        let allowed = parse(&self.licenses.allow)?;
        let mut faults = Vec::new();
        for Package { name, version, licence } in packages {
            let exceptions = self.licenses.exceptions.iter().filter(|it| it.package == *name);
            let more: Result<Vec<_>> =
                exceptions.map(|exception| parse(&exception.allow)).collect();
            let allowed = [allowed.clone(), more?.concat()].concat();
            let is_allowed = Expression::parse_mode(licence, ParseMode::LAX).is_ok_and(|asked| {
                asked.evaluate(|asked| allowed.iter().any(|licence| licence.satisfies(asked)))
            });
            if !is_allowed {
                faults.push(format!("{name} {version}: its licence `{licence}` is not allowed"));
            }
        }
        Ok(faults)
    }

    fn duplicates(&self, packages: &BTreeSet<Package>) -> Result<Vec<String>> {
        let mut skipped = Vec::new();
        for Skip { package } in &self.bans.skip {
            let (name, version) = package.split_once('@').unwrap_or((package, "*"));
            skipped.push((name, VersionReq::parse(version).with_context(|| package.clone())?));
        }
        let mut versions: BTreeMap<&str, BTreeSet<&Version>> = BTreeMap::new();
        for Package { name, version, .. } in packages {
            let is_skipped =
                |(of, which): &(&str, VersionReq)| of == name && which.matches(version);
            if !skipped.iter().any(is_skipped) {
                versions.entry(name).or_default().insert(version);
            }
        }
        let several = versions.into_iter().filter(|(_, versions)| versions.len() > 1);
        let fault = |(name, versions): (&str, BTreeSet<&Version>)| {
            let versions: Vec<_> = versions.iter().map(ToString::to_string).collect();
            format!("{name} is there as {}", versions.join(" and as "))
        };
        Ok(several.map(fault).collect())
    }
}

impl Lock {
    /// Dependencies that are neither of this workspace nor of crates.io.
    fn faults(&self) -> Vec<String> {
        let elsewhere =
            |it: &Locked| it.source.as_ref().filter(|source| *source != CRATES_IO).cloned();
        let faults = self.package.iter().filter_map(|it| Some((&it.name, elsewhere(it)?)));
        faults.map(|(name, source)| format!("{name} comes from `{source}`")).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        let text = r#"
            [graph]
            targets = []
            [licenses]
            allow = ["MIT", "Apache-2.0"]
            exceptions = [{ crate = "port", allow = ["MPL-2.0"] }]
            [bans]
            skip = [{ crate = "old@0.4", reason = "peer" }]
        "#;
        toml::from_str(text).unwrap()
    }

    fn packages(lines: &[&str]) -> BTreeSet<Package> {
        lines.iter().map(|line| Package::parse(line).unwrap()).collect()
    }

    #[test]
    fn lines_of_cargo_tree_are_read() {
        let line = "derive v1.0.2-rc.1 (proc-macro)|MIT OR Apache-2.0 (*)";
        let package = Package::parse(line).unwrap();
        assert_eq!(
            (package.name.as_str(), package.version.to_string()),
            ("derive", "1.0.2-rc.1".into())
        );
        assert_eq!(package.licence, "MIT OR Apache-2.0");
        assert!(Package::parse("derive").is_err());
    }

    #[test]
    fn licences_that_are_not_allowed_are_named() {
        let found = packages(&[
            "a v1.0.0|MIT/Apache-2.0",
            "b v1.0.0|GPL-3.0-only OR MIT",
            "c v1.0.0|MIT AND GPL-3.0-only",
            "d v1.0.0|",
            "port v1.0.0|MPL-2.0",
            "other v1.0.0|MPL-2.0",
        ]);
        let faults = table().licence_faults(&found).unwrap();
        let named: Vec<_> = faults.iter().map(|fault| &fault[..1]).collect();
        assert_eq!(named, ["c", "d", "o"]);
    }

    #[test]
    fn duplicates_are_named_unless_they_are_listed() {
        let found = packages(&["old v0.4.1|", "old v0.5.0|", "a v1.0.0|", "a v2.0.0|"]);
        assert_eq!(table().duplicates(&found).unwrap(), ["a is there as 1.0.0 and as 2.0.0"]);
    }

    #[test]
    fn dependencies_from_elsewhere_are_named() {
        let text = format!(
            "[[package]]\nname = \"ours\"\n[[package]]\nname = \"a\"\nsource = \"{CRATES_IO}\"\n\
             [[package]]\nname = \"b\"\nsource = \"git+https://example.org\"\n"
        );
        let lock: Lock = toml::from_str(&text).unwrap();
        assert_eq!(lock.faults(), ["b comes from `git+https://example.org`"]);
    }
}
