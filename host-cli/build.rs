//! How the program is linked.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let target = |key: &str| std::env::var(format!("CARGO_CFG_TARGET_{key}")).unwrap_or_default();
    if target("OS") == "linux" && target("ENV") == "gnu" {
        // At a fixed address nothing has to be relocated before `main`: an eighth of the time that
        // `shellcal --version` takes.
        println!("cargo::rustc-link-arg-bins=-no-pie");
    }
}
