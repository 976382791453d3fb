//! The modules of crates, read from their files.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use syn::{Attribute, Item, Meta};

use super::names::{Names, is_for_tests};

/// An index into [`Modules`].
pub(super) type Id = usize;

/// One module, which need not be a whole file.
#[derive(Debug)]
pub(super) struct Module {
    /// The file that it stands in, from the root of the workspace, with `/`.
    pub(super) file: String,
    /// The root of its crate.
    pub(super) root: Id,
    /// `None` for the root of a crate.
    pub(super) parent: Option<Id>,
    pub(super) children: BTreeMap<String, Id>,
    pub(super) names: Names,
}

/// The modules of several crates.
#[derive(Debug, Default)]
pub(super) struct Modules {
    pub(super) all: Vec<Module>,
    /// The roots of libraries, by the name under which other crates import them.
    pub(super) libraries: BTreeMap<String, Id>,
    base: PathBuf,
}

/// Where a module comes from.
struct Place<'a> {
    file: &'a Path,
    /// Where the files of its children are.
    folder: PathBuf,
    parent: Option<Id>,
}

impl Modules {
    /// No crates yet; the paths of files are relative to `base`.
    pub(super) fn new(base: &Path) -> Self {
        Self { base: base.to_path_buf(), ..Self::default() }
    }

    /// Adds a crate by its root file; other crates know it by its name if it is a library.
    pub(super) fn add_crate(&mut self, file: &Path, library: Option<&str>) -> Result<()> {
        let folder = file.parent().context("a file lies in a folder")?.to_path_buf();
        let root = self.read(&Place { file, folder, parent: None })?;
        self.libraries.extend(library.map(|name| (name.replace('-', "_"), root)));
        Ok(())
    }

    /// All files that were read.
    pub(super) fn files(&self) -> BTreeSet<&str> {
        self.all.iter().map(|module| module.file.as_str()).collect()
    }

    /// Whether a module lies in another one, at any depth.
    pub(super) fn is_inside(&self, id: Id, outer: Id) -> bool {
        let mut parents =
            std::iter::successors(self.all[id].parent, |&parent| self.all[parent].parent);
        parents.any(|parent| parent == outer)
    }

    fn read(&mut self, place: &Place<'_>) -> Result<Id> {
        let file = place.file;
        let text = std::fs::read_to_string(file)
            .with_context(|| format!("cannot read `{}`", file.display()))?;
        let parsed =
            syn::parse_file(&text).with_context(|| format!("`{}` is not Rust", file.display()))?;
        self.add(place, &parsed.items)
    }

    fn add(&mut self, place: &Place<'_>, items: &[Item]) -> Result<Id> {
        let id = self.all.len();
        let file = place.file.strip_prefix(&self.base).unwrap_or(place.file);
        let file = file.to_string_lossy().replace('\\', "/");
        let root = place.parent.map_or(id, |parent| self.all[parent].root);
        let (children, names) = (BTreeMap::new(), Names::default());
        self.all.push(Module { file, root, parent: place.parent, children, names });
        for item in items {
            match item {
                Item::Mod(module) if is_for_tests(&module.attrs) => {}
                Item::Mod(module) => {
                    let name = module.ident.to_string();
                    let child = match &module.content {
                        Some((_, items)) => {
                            let folder = place.folder.join(&name);
                            self.add(&Place { file: place.file, folder, parent: Some(id) }, items)?
                        }
                        None => {
                            let file = file_of(&name, &module.attrs, place)?;
                            let is_folder = file.file_name().is_some_and(|name| name == "mod.rs");
                            let parent = file.parent().context("a file lies in a folder")?;
                            let folder = if is_folder {
                                parent.to_path_buf()
                            } else {
                                parent.join(file.file_stem().unwrap_or_default())
                            };
                            self.read(&Place { file: &file, folder, parent: Some(id) })?
                        }
                    };
                    self.all[id].children.insert(name, child);
                }
                item => self.all[id].names.add(item),
            }
        }
        Ok(id)
    }
}

/// The file of `mod name;`.
fn file_of(name: &str, attributes: &[Attribute], place: &Place<'_>) -> Result<PathBuf> {
    if let Some(path) = attributes.iter().find(|attribute| attribute.path().is_ident("path")) {
        let Meta::NameValue(pair) = &path.meta else { bail!("`mod {name}`: no path") };
        let syn::Expr::Lit(syn::ExprLit { lit: syn::Lit::Str(path), .. }) = &pair.value else {
            bail!("`mod {name}`: the path is no string");
        };
        return Ok(place.file.with_file_name(path.value()));
    }
    let candidates =
        [place.folder.join(format!("{name}.rs")), place.folder.join(name).join("mod.rs")];
    let found = candidates.into_iter().find(|file| file.is_file());
    found.with_context(|| format!("`{}`: no file for `mod {name}`", place.file.display()))
}
