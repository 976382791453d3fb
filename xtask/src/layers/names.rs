//! What the items of one module define, import and name.
//!
//! Code under `#[cfg(test)]` is passed over. Names inside macros and attributes are taken from their
//! tokens, as a macro's arguments need not be Rust.

use std::collections::{BTreeMap, BTreeSet};

use proc_macro2::{TokenStream, TokenTree};
use syn::visit::{self, Visit};
use syn::{Attribute, Item, Lit, Meta, UseTree, Visibility};

/// The segments of a path. An empty first segment stands for a leading `::`.
pub(super) type NamePath = Vec<String>;

/// What a `use` brings into a module.
#[derive(Clone, Debug)]
pub(super) struct Import {
    pub(super) path: NamePath,
    /// Whether other modules can take the name from here.
    pub(super) is_reexport: bool,
}

/// The names of one module.
#[derive(Debug, Default)]
pub(super) struct Names {
    /// Items that are defined here.
    pub(super) defined: BTreeSet<String>,
    /// Names that `use` brings here. A name can be that of a module and of a function.
    pub(super) imports: BTreeMap<String, Vec<Import>>,
    /// Paths before `::*`.
    pub(super) globs: Vec<NamePath>,
    /// Paths in signatures, bodies, attributes and macros.
    pub(super) used: BTreeSet<NamePath>,
}

/// Whether an item is compiled for tests alone.
pub(super) fn is_for_tests(attributes: &[Attribute]) -> bool {
    let names_test = |meta: &Meta| match meta {
        Meta::Path(path) => path.is_ident("test"),
        Meta::List(list) if list.path.is_ident("all") => list
            .tokens
            .clone()
            .into_iter()
            .any(|token| matches!(token, TokenTree::Ident(ident) if ident == "test")),
        _ => false,
    };
    attributes.iter().any(|attribute| {
        attribute.path().is_ident("test")
            || attribute.path().is_ident("cfg")
                && attribute.parse_args::<Meta>().is_ok_and(|meta| names_test(&meta))
    })
}

impl Names {
    /// Adds an item of the module; modules inside it are for the caller.
    pub(super) fn add(&mut self, item: &Item) {
        self.defined.extend(defined_by(item));
        self.visit_item(item);
    }

    fn import(&mut self, tree: &UseTree, mut path: NamePath, is_reexport: bool) {
        match tree {
            UseTree::Path(tree) => {
                path.push(tree.ident.to_string());
                self.import(&tree.tree, path, is_reexport);
            }
            UseTree::Group(group) => {
                group.items.iter().for_each(|tree| self.import(tree, path.clone(), is_reexport));
            }
            UseTree::Glob(_) => self.globs.push(path),
            UseTree::Name(name) => {
                if name.ident != "self" {
                    path.push(name.ident.to_string());
                }
                let Some(name) = path.last().cloned() else { return };
                self.imports.entry(name).or_default().push(Import { path, is_reexport });
            }
            UseTree::Rename(rename) => {
                if rename.ident != "self" {
                    path.push(rename.ident.to_string());
                }
                // Without a name, as traits are taken, it is still an import.
                let name = rename.rename.to_string();
                self.imports.entry(name).or_default().push(Import { path, is_reexport });
            }
        }
    }

    /// Takes every `a::b::c` of a stream of tokens, but no fields and methods.
    fn add_tokens(&mut self, tokens: TokenStream) {
        let mut path = NamePath::new();
        let mut before = String::new();
        for token in tokens {
            let text = match &token {
                TokenTree::Ident(ident) => ident.to_string(),
                TokenTree::Punct(punct) => punct.as_char().to_string(),
                TokenTree::Group(_) | TokenTree::Literal(_) => String::new(),
            };
            let is_name = matches!(token, TokenTree::Ident(_));
            let continues = if before == "::" { is_name } else { text == ":" && !path.is_empty() };
            if !continues {
                self.used.extend((!path.is_empty()).then(|| std::mem::take(&mut path)));
            }
            if is_name && before != "." {
                path.push(text.clone());
            }
            if let TokenTree::Group(group) = token {
                self.add_tokens(group.stream());
            }
            before = if before == ":" && text == ":" { "::".to_owned() } else { text };
        }
        self.used.extend((!path.is_empty()).then_some(path));
    }
}

/// The names that an item defines in its module. Those that a macro makes of its arguments are found
/// behind the keywords there.
fn defined_by(item: &Item) -> Vec<String> {
    let ident = match item {
        Item::Const(item) => &item.ident,
        Item::Enum(item) => &item.ident,
        Item::Fn(item) => &item.sig.ident,
        Item::Static(item) => &item.ident,
        Item::Struct(item) => &item.ident,
        Item::Trait(item) => &item.ident,
        Item::TraitAlias(item) => &item.ident,
        Item::Type(item) => &item.ident,
        Item::Union(item) => &item.ident,
        Item::Macro(item) => match &item.ident {
            Some(ident) => ident,
            None => return defined_in_tokens(item.mac.tokens.clone()),
        },
        _ => return Vec::new(),
    };
    vec![ident.to_string()]
}

fn defined_in_tokens(tokens: TokenStream) -> Vec<String> {
    const KEYWORDS: [&str; 8] =
        ["const", "enum", "fn", "static", "struct", "trait", "type", "union"];
    let words: Vec<String> = tokens.into_iter().map(|token| token.to_string()).collect();
    let pairs = words.windows(2).filter(|pair| KEYWORDS.contains(&pair[0].as_str()));
    pairs.map(|pair| pair[1].clone()).collect()
}

impl<'ast> Visit<'ast> for Names {
    fn visit_item(&mut self, item: &'ast Item) {
        if !is_for_tests(attributes(item)) && !matches!(item, Item::Mod(_)) {
            visit::visit_item(self, item);
        }
    }

    fn visit_impl_item_fn(&mut self, function: &'ast syn::ImplItemFn) {
        if !is_for_tests(&function.attrs) {
            visit::visit_impl_item_fn(self, function);
        }
    }

    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        let start = if item.leading_colon.is_some() { vec![String::new()] } else { Vec::new() };
        self.import(&item.tree, start, !matches!(item.vis, Visibility::Inherited));
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        let start = path.leading_colon.as_ref().map(|_| String::new());
        let segments = path.segments.iter().map(|segment| segment.ident.to_string());
        self.used.insert(start.into_iter().chain(segments).collect());
        visit::visit_path(self, path);
    }

    fn visit_macro(&mut self, call: &'ast syn::Macro) {
        self.visit_path(&call.path);
        self.add_tokens(call.tokens.clone());
    }

    fn visit_attribute(&mut self, attribute: &'ast Attribute) {
        let Meta::List(list) = &attribute.meta else { return };
        self.add_tokens(list.tokens.clone());
        // Serde takes functions by name, in quotes.
        if list.path.is_ident("serde") {
            for token in list.tokens.clone() {
                let TokenTree::Literal(literal) = token else { continue };
                let Lit::Str(text) = Lit::new(literal) else { continue };
                if let Ok(path) = text.parse::<syn::Path>() {
                    self.visit_path(&path);
                }
            }
        }
    }

    /// Who may see an item is no import.
    fn visit_visibility(&mut self, _: &'ast Visibility) {}
}

fn attributes(item: &Item) -> &[Attribute] {
    match item {
        Item::Const(item) => &item.attrs,
        Item::Enum(item) => &item.attrs,
        Item::Fn(item) => &item.attrs,
        Item::Impl(item) => &item.attrs,
        Item::Macro(item) => &item.attrs,
        Item::Mod(item) => &item.attrs,
        Item::Static(item) => &item.attrs,
        Item::Struct(item) => &item.attrs,
        Item::Trait(item) => &item.attrs,
        Item::Type(item) => &item.attrs,
        Item::Use(item) => &item.attrs,
        _ => &[],
    }
}
