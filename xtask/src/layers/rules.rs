//! `layers.toml`: which files may import which.
//!
//! Files are named by a folder or a file; of several names that fit, the longest counts.

use std::collections::BTreeSet;
use std::path::Path;

use anyhow::{Context, Result};
use serde::Deserialize;

use super::arrows::{Arrows, Externals};

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Rules {
    /// From the ground up. A file imports from its own layer and from those below.
    #[serde(default)]
    layer: Vec<Layer>,
    #[serde(default)]
    rule: Vec<Rule>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Layer {
    name: String,
    files: Vec<String>,
}

/// What some files must not import, whatever their layer.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Rule {
    why: String,
    /// What the rule is for: files, and all files of layers.
    #[serde(default)]
    files: Vec<String>,
    #[serde(default)]
    layers: Vec<String>,
    /// All that these may import, beside each other.
    only: Option<Vec<String>>,
    #[serde(default)]
    never: Vec<String>,
    /// Paths into other crates, such as `clap` or `std::fs`.
    #[serde(default)]
    never_outside: Vec<String>,
}

/// An import that a rule forbids.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Violation {
    pub(super) why: String,
    pub(super) from: String,
    pub(super) to: String,
    pub(super) names: BTreeSet<String>,
}

impl Rules {
    pub(super) fn read(file: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(file)
            .with_context(|| format!("cannot read `{}`", file.display()))?;
        toml::from_str(&text).with_context(|| format!("`{}`", file.display()))
    }

    /// Imports that the layers or a rule forbid.
    pub(super) fn violations(
        &self,
        arrows: &Arrows<'_>,
        externals: &Externals<'_>,
    ) -> Vec<Violation> {
        let mut found = Vec::new();
        for (&(from, to), arrow) in arrows {
            let whys = self.rule.iter().filter(|rule| self.is_for(rule, from) && rule.forbids(to));
            let whys = whys.map(|rule| rule.why.clone()).chain(self.upward(from, to));
            found.extend(whys.map(|why| violation(why, from, to, arrow.names.clone())));
        }
        for (&from, paths) in externals {
            for rule in self.rule.iter().filter(|rule| self.is_for(rule, from)) {
                for outside in &rule.never_outside {
                    let is_inside = |path: &&Vec<String>| lies_in(&path.join("::"), outside, "::");
                    let names: BTreeSet<String> =
                        paths.iter().filter(is_inside).map(|path| path.join("::")).collect();
                    if !names.is_empty() {
                        found.push(violation(rule.why.clone(), from, outside, names));
                    }
                }
            }
        }
        found.sort();
        found
    }

    /// Files that belong to no layer.
    pub(super) fn without_layer<'a>(&self, files: &BTreeSet<&'a str>) -> Vec<&'a str> {
        files.iter().copied().filter(|file| self.layer_of(file).is_none()).collect()
    }

    /// Names in this table that fit no file: of a room that was moved, whose rule would be idle.
    pub(super) fn idle_names(&self, files: &BTreeSet<&str>) -> BTreeSet<&str> {
        let of_layers = self.layer.iter().flat_map(|layer| &layer.files);
        let of_rules = self.rule.iter().flat_map(|rule| {
            let only = rule.only.iter().flatten();
            rule.files.iter().chain(&rule.never).chain(only)
        });
        let names = of_layers.chain(of_rules).map(String::as_str);
        names.filter(|name| !files.iter().any(|file| lies_in(file, name, "/"))).collect()
    }

    fn is_for(&self, rule: &Rule, file: &str) -> bool {
        let layer = self.layer_of(file).map(|layer| &self.layer[layer].name);
        is_among(file, &rule.files) || layer.is_some_and(|layer| rule.layers.contains(layer))
    }

    fn upward(&self, from: &str, to: &str) -> Option<String> {
        let (from, to) = (self.layer_of(from)?, self.layer_of(to)?);
        let [lower, upper] = [from, to].map(|layer| &self.layer[layer].name);
        (from < to).then(|| format!("{lower} must not import {upper}"))
    }

    fn layer_of(&self, file: &str) -> Option<usize> {
        let layers = self.layer.iter().enumerate();
        let names = layers.flat_map(|(i, layer)| layer.files.iter().map(move |name| (i, name)));
        let fitting = names.filter(|(_, name)| lies_in(file, name, "/"));
        fitting.max_by_key(|(_, name)| name.len()).map(|(i, _)| i)
    }
}

impl Rule {
    fn forbids(&self, to: &str) -> bool {
        let is_outside = |only: &Vec<String>| !is_among(to, only) && !is_among(to, &self.files);
        is_among(to, &self.never) || self.only.as_ref().is_some_and(is_outside)
    }
}

fn violation(why: String, from: &str, to: &str, names: BTreeSet<String>) -> Violation {
    Violation { why, from: from.to_owned(), to: to.to_owned(), names }
}

fn is_among(file: &str, names: &[String]) -> bool {
    names.iter().any(|name| lies_in(file, name, "/"))
}

/// Whether a path is `outer` or lies below it.
fn lies_in(path: &str, outer: &str, separator: &str) -> bool {
    path.strip_prefix(outer).is_some_and(|rest| rest.is_empty() || rest.starts_with(separator))
}
