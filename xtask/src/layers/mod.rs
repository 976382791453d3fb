//! `cargo xtask layers`: no circle of files, and no import against `layers.toml`.
//!
//! Read are the libraries and programs of the workspace, without tests, examples and benchmarks, as
//! `rustc` reads them: module by module from the root, names followed through re-exports to the file
//! that defines them.

mod arrows;
mod circles;
mod modules;
mod names;
mod rules;
#[cfg(test)]
mod tests;

use std::collections::BTreeSet;
use std::fmt;
use std::path::Path;

use anyhow::{Result, bail};
use cargo_metadata::{MetadataCommand, TargetKind};

use crate::steps::workspace;
use arrows::{Arrows, arrows};
use modules::Modules;
use rules::{Rules, Violation};

/// The table of layers, at the root of the workspace.
const RULES: &str = "layers.toml";

#[derive(Debug, Default, clap::Args)]
pub(crate) struct Args {
    /// Count it as a circle, too, where a module and the `mod.rs` around it take from each other
    #[arg(long)]
    strict: bool,
}

/// Prints what is wrong, and is an error if anything is.
pub(crate) fn run(args: &Args) -> Result<()> {
    let modules = crates(workspace())?;
    let rules = Rules::read(&workspace().join(RULES))?;
    let findings = Findings::new(&modules, &rules, args.strict);
    print!("{findings}");
    let Findings { circles, violations, without_layer, idle_names, .. } = &findings;
    let others = without_layer.len() + idle_names.len();
    if !(circles.is_empty() && violations.is_empty() && others == 0) {
        bail!(
            "{} circles of files, {} imports against the layers, {others} gaps in {RULES}",
            circles.len(),
            violations.len()
        );
    }
    println!(
        "{} files, {} imports: no circle, none against the layers",
        modules.files().len(),
        findings.arrows.len()
    );
    Ok(())
}

/// The libraries and programs of the workspace in a folder.
fn crates(base: &Path) -> Result<Modules> {
    let metadata = MetadataCommand::new().current_dir(base).no_deps().exec()?;
    let mut modules = Modules::new(base);
    for target in metadata.packages.iter().flat_map(|package| &package.targets) {
        let kinds = [TargetKind::Lib, TargetKind::CDyLib];
        let is_library = kinds.iter().any(|kind| target.kind.contains(kind));
        if is_library || target.kind.contains(&TargetKind::Bin) {
            let library = is_library.then_some(target.name.as_str());
            modules.add_crate(target.src_path.as_std_path(), library)?;
        }
    }
    Ok(modules)
}

/// What is wrong with the imports.
#[derive(Debug)]
struct Findings<'a> {
    arrows: Arrows<'a>,
    strict: bool,
    circles: Vec<Vec<&'a str>>,
    violations: Vec<Violation>,
    without_layer: Vec<&'a str>,
    idle_names: Vec<String>,
}

impl<'a> Findings<'a> {
    fn new(modules: &'a Modules, rules: &Rules, strict: bool) -> Self {
        let (arrows, externals) = arrows(modules);
        let files = modules.files();
        Self {
            circles: circles::circles(&arrows, strict),
            violations: rules.violations(&arrows, &externals),
            without_layer: rules.without_layer(&files),
            idle_names: rules.idle_names(&files).into_iter().map(str::to_owned).collect(),
            arrows,
            strict,
        }
    }
}

impl fmt::Display for Findings<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let list = |names: &BTreeSet<String>| {
            names.iter().map(String::as_str).collect::<Vec<_>>().join(", ")
        };
        for circle in &self.circles {
            writeln!(f, "circle of {} files:", circle.len())?;
            for ((from, to), arrow) in &self.arrows {
                let is_counted = self.strict || !arrow.is_to_parent;
                if is_counted && circle.contains(from) && circle.contains(to) {
                    writeln!(f, "  {from} → {to}: {}", list(&arrow.names))?;
                }
            }
        }
        for Violation { why, from, to, names } in &self.violations {
            writeln!(f, "{why}:\n  {from} → {to}: {}", list(names))?;
        }
        for file in &self.without_layer {
            writeln!(f, "in no layer of {RULES}: {file}")?;
        }
        for name in &self.idle_names {
            writeln!(f, "{RULES} names `{name}`, where there is no file")?;
        }
        Ok(())
    }
}
