//! Hands the memory map of the board that is built to the linker.

use std::path::Path;
use std::{env, fs, io};

fn main() -> io::Result<()> {
    println!("cargo:rerun-if-changed=memory");
    let maps = [("CARGO_FEATURE_EMULATED", "emulated.x"), ("CARGO_FEATURE_SKINPROC", "skinproc.x")];
    let map = maps.iter().find(|(feature, _)| env::var_os(feature).is_some());
    if let (Some((_, map)), Some(out)) = (map, env::var_os("OUT_DIR")) {
        fs::copy(Path::new("memory").join(map), Path::new(&out).join("memory.x"))?;
        println!("cargo:rustc-link-search={}", Path::new(&out).display());
    }
    Ok(())
}
