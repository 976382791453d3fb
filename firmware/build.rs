//! Passes the memory map of the selected board to the linker.

use std::path::Path;
use std::{env, fs, io};

const MAPS: [(&str, &str); 2] =
    [("CARGO_FEATURE_SKINPROC", "skinproc.x"), ("CARGO_FEATURE_NUCLEO_G491RE", "nucleo-g491re.x")];

/// The part that all STM32 boards include.
const COMMON: &str = "stm32.x";

fn main() -> io::Result<()> {
    println!("cargo:rerun-if-changed=memory");
    let map = MAPS.iter().find(|(feature, _)| env::var_os(feature).is_some());
    if let (Some((_, map)), Some(out)) = (map, env::var_os("OUT_DIR")) {
        let (memory, out) = (Path::new("memory"), Path::new(&out));
        fs::copy(memory.join(map), out.join("memory.x"))?;
        fs::copy(memory.join(COMMON), out.join(COMMON))?;
        println!("cargo:rustc-link-search={}", out.display());
    }
    Ok(())
}
