//! The diagram of the crates in `docs/architecture.md`, in layers above their dependencies.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

use anyhow::{Context, Result};
use serde_json::Value;

use crate::steps::{self, cargo};

const LEFT_OUT: [&str; 2] = ["system-tests", "xtask"];

/// Width and height of a box, and the gaps between boxes and between layers.
const BOX: [f64; 2] = [112.0, 26.0];
const GAPS: [f64; 2] = [14.0, 52.0];
const MARGIN: f64 = 12.0;

type Dependencies = BTreeMap<String, BTreeSet<String>>;

pub(crate) fn draw() -> Result<String> {
    let metadata = ["metadata", "--no-deps", "--format-version", "1", "--offline"];
    let metadata: Value = serde_json::from_str(&steps::output(&mut cargo(&metadata))?)?;
    Ok(picture(&dependencies(&metadata).context("cargo's metadata have other fields")?))
}

fn dependencies(metadata: &Value) -> Option<Dependencies> {
    let packages = metadata["packages"].as_array()?.iter();
    let named = packages.map(|package| Some((package["name"].as_str()?, package)));
    let named = named.collect::<Option<BTreeMap<&str, &Value>>>()?;
    let is_drawn = |name: &str| named.contains_key(name) && !LEFT_OUT.contains(&name);
    let of = |package: &Value| {
        let all = package["dependencies"].as_array()?.iter();
        // A dependency with a kind is only for tests or build scripts.
        let normal = all.filter(|dependency| dependency["kind"].is_null());
        let names = normal.filter_map(|dependency| dependency["name"].as_str());
        Some(names.filter(|name| is_drawn(name)).map(str::to_owned).collect())
    };
    let drawn = named.iter().filter(|(name, _)| is_drawn(name));
    drawn.map(|(name, package)| Some(((*name).to_owned(), of(package)?))).collect()
}

/// Returns the longest chain of dependencies below a crate.
fn layer(of: &str, all: &Dependencies) -> usize {
    all[of].iter().map(|below| 1 + layer(below, all)).max().unwrap_or(0)
}

/// Returns true if one crate reaches another through a third, so that its arrow is redundant.
fn is_implied(from: &str, to: &str, all: &Dependencies) -> bool {
    fn reaches(from: &str, to: &str, all: &Dependencies) -> bool {
        all[from].contains(to) || all[from].iter().any(|next| reaches(next, to, all))
    }
    all[from].iter().any(|next| next != to && reaches(next, to, all))
}

fn picture(all: &Dependencies) -> String {
    let mut layers: Vec<Vec<&str>> = Vec::new();
    for name in all.keys() {
        let at = layer(name, all);
        layers.resize_with(layers.len().max(at + 1), Vec::new);
        layers[at].push(name);
    }
    let step = [BOX[0] + GAPS[0], BOX[1] + GAPS[1]];
    let widest = layers.iter().map(Vec::len).max().unwrap_or(0) as f64;
    let width = widest * step[0] - GAPS[0] + 2.0 * MARGIN;
    let height = layers.len() as f64 * step[1] - GAPS[1] + 2.0 * MARGIN;
    // Upper left corners, with the lowest layer at the bottom.
    let mut corners = BTreeMap::new();
    for (at, names) in layers.iter().enumerate() {
        let y = height - MARGIN - BOX[1] - at as f64 * step[1];
        let left = (width - (names.len() as f64 * step[0] - GAPS[0])) / 2.0;
        corners
            .extend((0..).zip(names).map(|(i, name)| (*name, [left + f64::from(i) * step[0], y])));
    }
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" \
         font-size=\"11\">\n<defs><marker id=\"tip\" viewBox=\"0 0 8 8\" refX=\"7\" refY=\"4\" markerWidth=\"6\" \
         markerHeight=\"6\" orient=\"auto\"><path d=\"M0 0L8 4L0 8z\" fill=\"#789\"/></marker></defs>\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"#fff\"/>\n"
    );
    for (from, below) in all {
        for to in below.iter().filter(|to| !is_implied(from, to, all)) {
            let ([x0, y0], [x1, y1]) = (corners[&**from], corners[&**to]);
            let (x0, y0, x1) = (x0 + BOX[0] / 2.0, y0 + BOX[1], x1 + BOX[0] / 2.0);
            let (bend0, bend1) = (y0 + GAPS[1] / 2.0, y1 - GAPS[1] / 2.0);
            writeln!(
                svg,
                "<path d=\"M{x0} {y0}C{x0} {bend0} {x1} {bend1} {x1} {y1}\" fill=\"none\" stroke=\"#789\" \
                 marker-end=\"url(#tip)\"/>"
            )
            .expect("a text takes all");
        }
    }
    for (name, [x, y]) in corners {
        let [width, height] = BOX;
        let (middle, line) = (x + width / 2.0, y + height / 2.0 + 4.0);
        writeln!(
            svg,
            "<rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" rx=\"4\" fill=\"#eef3f8\" stroke=\"#456\"/>\
             <text x=\"{middle}\" y=\"{line}\" text-anchor=\"middle\">{name}</text>"
        )
        .expect("a text takes all");
    }
    svg + "</svg>\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    fn crates() -> Dependencies {
        let of = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
        let all =
            [("top", of(&["middle", "bottom"])), ("middle", of(&["bottom"])), ("bottom", of(&[]))];
        all.map(|(name, below)| (name.to_owned(), below)).into()
    }

    #[test]
    fn a_crate_lies_above_all_that_it_depends_on() {
        let all = crates();
        assert_eq!(["bottom", "middle", "top"].map(|name| layer(name, &all)), [0, 1, 2]);
    }

    #[test]
    fn arrows_that_others_imply_are_left_out() {
        let all = crates();
        assert!(is_implied("top", "bottom", &all) && !is_implied("top", "middle", &all));
        assert_eq!(picture(&all).matches("marker-end").count(), 2);
    }

    #[test]
    fn dependencies_of_tests_are_not_drawn() {
        let metadata = serde_json::json!({ "packages": [
            { "name": "a", "dependencies": [
                { "name": "b", "kind": null }, { "name": "c", "kind": "dev" }, { "name": "serde", "kind": null },
            ] },
            { "name": "b", "dependencies": [] },
            { "name": "c", "dependencies": [] },
            { "name": "xtask", "dependencies": [] },
        ] });
        let found = dependencies(&metadata).unwrap();
        assert_eq!(found.keys().collect::<Vec<_>>(), ["a", "b", "c"]);
        assert_eq!(found["a"].iter().collect::<Vec<_>>(), ["b"]);
    }
}
