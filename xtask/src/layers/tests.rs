//! Small crates with a planted fault, and without.

use tempfile::TempDir;

use super::*;

/// A crate of a library and perhaps a program, `main.rs`.
struct Crate {
    _folder: TempDir,
    modules: Modules,
}

impl Crate {
    fn new(files: &[(&str, &str)]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in files {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        }
        let mut modules = Modules::new(folder.path());
        modules.add_crate(&folder.path().join("lib.rs"), Some("house")).unwrap();
        if folder.path().join("main.rs").exists() {
            modules.add_crate(&folder.path().join("main.rs"), None).unwrap();
        }
        Self { _folder: folder, modules }
    }

    fn findings(&self, rules: &str) -> Findings<'_> {
        Findings::new(&self.modules, &toml::from_str(rules).unwrap(), false)
    }

    fn circles(&self) -> Vec<Vec<&str>> {
        self.findings("").circles
    }

    /// `from → to: names`, a line each.
    fn arrows(&self) -> Vec<String> {
        let findings = self.findings("");
        let lines = findings.arrows.iter().map(|((from, to), arrow)| {
            let names: Vec<&str> = arrow.names.iter().map(String::as_str).collect();
            format!("{from} → {to}: {}", names.join(", "))
        });
        lines.collect()
    }
}

#[test]
fn files_that_import_each_other_are_a_circle() {
    let house = Crate::new(&[
        ("lib.rs", "mod a; mod b; mod c; mod d;"),
        ("a.rs", "use crate::b::B; pub struct A(B);"),
        ("b.rs", "pub struct B; fn f() { super::c::c(); }"),
        ("c.rs", "pub fn c() { let _ = core::mem::size_of::<crate::a::A>(); }"),
        ("d.rs", "use crate::a::A; fn d(_: A) {}"),
    ]);
    assert_eq!(house.circles(), [["a.rs", "b.rs", "c.rs"]]);
    let report = house.findings("").to_string();
    assert!(report.contains("circle of 3 files:\n  a.rs → b.rs: B\n"), "{report}");
    assert!(!report.contains("d.rs →"), "{report}");
}

#[test]
fn a_name_is_followed_through_reexports_to_the_file_that_defines_it() {
    let house = Crate::new(&[
        ("lib.rs", "mod room; mod user; pub use room::Thing;"),
        ("room/mod.rs", "mod inner; pub use self::inner::*; pub use inner::deep::Deep as Low;"),
        ("room/inner/mod.rs", "pub mod deep; pub struct Thing;"),
        ("room/inner/deep.rs", "pub struct Deep;"),
        (
            "user.rs",
            "use crate::{Thing, room::{self, Low}}; fn f(_: Thing, _: room::Low, _: Low) {}",
        ),
    ]);
    assert_eq!(
        house.arrows(),
        ["user.rs → room/inner/deep.rs: Deep", "user.rs → room/inner/mod.rs: Thing"]
    );
}

#[test]
fn a_module_that_hands_on_names_and_uses_them_imports_them() {
    let house = Crate::new(&[
        ("lib.rs", "mod room;"),
        ("room/mod.rs", "mod a; mod b; pub use a::A; pub use b::B; fn f(_: A) {}"),
        ("room/a.rs", "pub struct A;"),
        ("room/b.rs", "pub struct B;"),
    ]);
    assert_eq!(house.arrows(), ["room/mod.rs → room/a.rs: A"]);
}

#[test]
fn a_function_is_told_from_the_module_of_its_name() {
    let house = Crate::new(&[
        ("lib.rs", "pub mod fit; mod user;"),
        ("fit/mod.rs", "mod solve; mod other; pub use solve::solve;"),
        (
            "fit/solve.rs",
            "pub fn solve() { super::other::solve::<super::solve::Way>() } pub struct Way;",
        ),
        ("fit/other.rs", "pub fn solve<T>() {}"),
        ("user.rs", "use crate::fit::solve; fn f() { solve() }"),
    ]);
    assert_eq!(
        house.arrows(),
        ["fit/solve.rs → fit/other.rs: solve", "user.rs → fit/solve.rs: solve"]
    );
}

#[test]
fn tests_visibilities_and_documentation_are_no_imports() {
    let house = Crate::new(&[
        ("lib.rs", "mod a; mod b;"),
        (
            "a.rs",
            "pub struct A;\n#[cfg(test)]\nmod tests { use crate::b::B; fn f(_: B) {} }\n#[cfg(all(test, unix))]\nuse crate::b::B;",
        ),
        (
            "b.rs",
            "/// See [`A`](crate::a::A).\npub(in crate::b) struct B;\n#[test]\nfn f() { crate::a::A; }",
        ),
    ]);
    assert_eq!(house.arrows(), [""; 0]);
}

#[test]
fn macros_attributes_and_inline_modules_are_looked_into() {
    let house = Crate::new(&[
        ("lib.rs", "mod a; mod b; mod c;"),
        (
            "a.rs",
            "pub const NAME: u8 = 1; pub fn check() {} pub fn write() {} made! { pub struct Made; }",
        ),
        (
            "b.rs",
            "fn f() { println!(\"{} {}\", x.check(), crate::a::NAME) }\n#[arg(parser = super::a::check)] #[serde(with = \"crate::a::write\")] struct B;",
        ),
        ("c.rs", "mod linux { pub fn f(_: super::super::a::Made) {} }"),
    ]);
    assert_eq!(house.arrows(), ["b.rs → a.rs: NAME, check, write", "c.rs → a.rs: Made"]);
}

#[test]
fn a_program_imports_from_its_library() {
    let house = Crate::new(&[
        ("lib.rs", "pub mod a;"),
        ("a.rs", "pub struct A;"),
        ("main.rs", "use house::a::A; fn main() { let _ = ::house::a::A; }"),
    ]);
    assert_eq!(house.arrows(), ["main.rs → a.rs: A"]);
}

#[test]
fn a_module_and_the_one_around_it_are_a_circle_only_if_asked() {
    let house = Crate::new(&[
        ("lib.rs", "mod room;"),
        ("room/mod.rs", "mod inner; pub struct Room; fn f() { inner::g(Room) }"),
        ("room/inner.rs", "use super::Room; pub fn g(_: Room) {}"),
    ]);
    assert_eq!(house.circles(), [[""; 0]; 0]);
    let strict = Findings::new(&house.modules, &toml::from_str("").unwrap(), true);
    assert_eq!(strict.circles, [["room/inner.rs", "room/mod.rs"]]);
}

const LAYERS: &str = r#"
    layer = [{ name = "core", files = ["lib.rs", "core"] }, { name = "edge", files = ["edge"] }]
    rule = [
        { why = "no command line", layers = ["core"], never_outside = ["clap", "std::fs"] },
        { why = "readers are alone", files = ["edge/reader.rs"], only = ["core/a.rs"] },
        { why = "b is left alone", files = ["edge"], never = ["core/b.rs"] },
    ]
"#;

fn layered(a: &str, b: &str, reader: &str) -> Vec<String> {
    let house = Crate::new(&[
        ("lib.rs", "mod core; mod edge;"),
        ("core/mod.rs", "pub mod a; pub mod b;"),
        ("core/a.rs", a),
        ("core/b.rs", b),
        ("edge/mod.rs", "pub mod reader; pub mod writer;"),
        ("edge/reader.rs", reader),
        ("edge/writer.rs", "pub struct Writer;"),
    ]);
    let violations = house.findings(LAYERS).violations;
    violations.iter().map(|v| format!("{}: {} → {}", v.why, v.from, v.to)).collect()
}

#[test]
fn imports_along_the_layers_are_allowed() {
    let (a, b) = ("pub struct A; fn f() -> std::fmt::Result { Ok(()) }", "use super::a::A;");
    assert_eq!(layered(a, b, "use crate::core::a::A; use std::fs::File;"), [""; 0]);
}

#[test]
fn imports_against_the_layers_are_named() {
    let found = layered(
        "use clap::Parser; fn f() { std::fs::read(\"\"); }",
        "pub struct B(crate::edge::writer::Writer);",
        "use crate::core::b::B; use super::writer::Writer;",
    );
    assert_eq!(
        found,
        [
            "b is left alone: edge/reader.rs → core/b.rs",
            "core must not import edge: core/b.rs → edge/writer.rs",
            "no command line: core/a.rs → clap",
            "no command line: core/a.rs → std::fs",
            "readers are alone: edge/reader.rs → core/b.rs",
            "readers are alone: edge/reader.rs → edge/writer.rs",
        ]
    );
}

#[test]
fn files_without_a_layer_and_names_without_a_file_are_told() {
    let house = Crate::new(&[("lib.rs", "mod a;"), ("a.rs", "")]);
    let findings = house.findings("layer = [{ name = \"core\", files = [\"lib.rs\", \"gone\"] }]");
    assert_eq!(findings.without_layer, ["a.rs"]);
    assert_eq!(findings.idle_names, ["gone"]);
}
