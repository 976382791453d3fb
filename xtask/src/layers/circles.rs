//! Circles: files that import each other, directly or through others.
//!
//! What a module takes from the modules around it makes a circle only if asked: by Rust's rules of
//! privacy a module is part of those around it, and a `mod.rs` with the types that its children work
//! on is common. Layers hold for it all the same.

use petgraph::algo::tarjan_scc;
use petgraph::graphmap::DiGraphMap;

use super::arrows::Arrows;

/// The circles, each as its files in order; `strict` counts imports from modules around, too.
pub(super) fn circles<'a>(arrows: &Arrows<'a>, strict: bool) -> Vec<Vec<&'a str>> {
    let counted = arrows.iter().filter(|(_, arrow)| strict || !arrow.is_to_parent);
    let graph: DiGraphMap<&str, ()> = counted.map(|(&ends, _)| ends).collect();
    let mut circles: Vec<Vec<&str>> =
        tarjan_scc(&graph).into_iter().filter(|files| files.len() > 1).collect();
    circles.iter_mut().for_each(|files| files.sort_unstable());
    circles.sort_unstable();
    circles
}
