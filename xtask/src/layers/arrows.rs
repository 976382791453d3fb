//! Who imports what from whom: one arrow from file to file, with the names taken.
//!
//! A name is followed through re-exports to the file that defines it, so a `mod.rs` that only
//! declares modules and hands on their names has no arrows.

use std::collections::{BTreeMap, BTreeSet};

use super::modules::{Id, Modules};
use super::names::{Import, NamePath};

/// Arrows by the file that takes names and the file that defines them.
pub(super) type Arrows<'a> = BTreeMap<(&'a str, &'a str), Arrow>;

/// What one file takes from another.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Arrow {
    pub(super) names: BTreeSet<String>,
    /// Whether all of it is of modules around the one that takes it, which may see their private
    /// items.
    pub(super) is_to_parent: bool,
}

/// Paths into crates that are not ours, by the file that names them.
pub(super) type Externals<'a> = BTreeMap<&'a str, BTreeSet<NamePath>>;

/// What a path leads to.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Target {
    Module(Id),
    /// An item and the module that defines it.
    Item(Id, String),
    /// Something of another crate, such as `std`.
    External(NamePath),
}

/// What was asked on the way to a target, so that names that lead to each other end.
type Asked = BTreeSet<(Id, String, bool)>;

/// All arrows between files, and all paths that lead out of the crates.
pub(super) fn arrows(modules: &Modules) -> (Arrows<'_>, Externals<'_>) {
    let (mut arrows, mut externals) = (Arrows::new(), Externals::new());
    for (id, module) in modules.all.iter().enumerate() {
        let names = &module.names;
        let imports = names.imports.values().flatten();
        let imported = imports.filter(|import| !hands_on(modules, id, import));
        let imported = imported.map(|import| (&import.path, true));
        let used = names.used.iter().map(|path| (path, path.len() > 1));
        let globs = names.globs.iter().map(|path| (path, true));
        for (path, may_be_external) in imported.chain(used).chain(globs) {
            match resolve(modules, id, path, &mut Asked::new()) {
                Some(Target::Item(definer, name)) => {
                    let to = modules.all[definer].file.as_str();
                    if to != module.file {
                        let new = Arrow { is_to_parent: true, ..Arrow::default() };
                        let arrow = arrows.entry((module.file.as_str(), to)).or_insert(new);
                        arrow.names.insert(name);
                        arrow.is_to_parent &= modules.is_inside(id, definer);
                    }
                }
                Some(Target::External(path)) if may_be_external => {
                    externals.entry(module.file.as_str()).or_default().insert(path);
                }
                _ => {}
            }
        }
    }
    (arrows, externals)
}

/// Whether an import only hands on the name of a module inside this one.
fn hands_on(modules: &Modules, id: Id, import: &Import) -> bool {
    let definer = match resolve(modules, id, &import.path, &mut Asked::new()) {
        Some(Target::Item(definer, _) | Target::Module(definer)) => definer,
        _ => return false,
    };
    import.is_reexport && modules.is_inside(definer, id)
}

/// Follows a path that stands in a module.
fn resolve(modules: &Modules, from: Id, path: &[String], asked: &mut Asked) -> Option<Target> {
    let external = || Some(Target::External(path.to_vec()));
    let (first, mut rest) = path.split_first()?;
    let mut at = match first.as_str() {
        "" => match modules.libraries.get(rest.first()?) {
            Some(&root) => {
                rest = &rest[1..];
                Target::Module(root)
            }
            None => return Some(Target::External(rest.to_vec())),
        },
        "crate" => Target::Module(modules.all[from].root),
        "self" => Target::Module(from),
        "super" => Target::Module(modules.all[from].parent?),
        "Self" => return None,
        name => match look_up(modules, from, name, rest.is_empty(), asked) {
            Some(target) => target,
            None => match modules.libraries.get(name) {
                Some(&root) => Target::Module(root),
                None => return external(),
            },
        },
    };
    for (i, name) in rest.iter().enumerate() {
        at = match at {
            Target::Module(id) if name == "super" => Target::Module(modules.all[id].parent?),
            Target::Module(id) if name == "self" => Target::Module(id),
            Target::Module(id) => {
                let is_last = i + 1 == rest.len();
                // What a macro has made is not seen; it belongs to the module that it is taken from.
                look_up(modules, id, name, is_last, asked)
                    .unwrap_or_else(|| Target::Item(id, name.clone()))
            }
            // What follows is a variant, a method or a constant of the type.
            Target::Item(..) => return Some(at),
            Target::External(mut path) => {
                path.extend_from_slice(&rest[i..]);
                return Some(Target::External(path));
            }
        };
    }
    Some(at)
}

/// A name in the scope of a module. At the end of a path an item goes before a module of the same
/// name, before the end it can only be the module.
fn look_up(
    modules: &Modules,
    id: Id,
    name: &str,
    is_last: bool,
    asked: &mut Asked,
) -> Option<Target> {
    if !asked.insert((id, name.to_owned(), is_last)) {
        return None;
    }
    let module = &modules.all[id];
    let child = || module.children.get(name).map(|&child| Target::Module(child));
    if let (false, Some(child)) = (is_last, child()) {
        return Some(child);
    }
    if module.names.defined.contains(name) {
        return Some(Target::Item(id, name.to_owned()));
    }
    let imports = module.names.imports.get(name).into_iter().flatten();
    let mut imported = imports.filter_map(|import| resolve(modules, id, &import.path, asked));
    if let Some(target) = imported.next() {
        return Some(target);
    }
    child().or_else(|| {
        module.names.globs.iter().find_map(|glob| {
            match resolve(modules, id, glob, &mut asked.clone())? {
                Target::Module(from) => look_up(modules, from, name, is_last, asked),
                _ => None,
            }
        })
    })
}
