//! Finds a Chromium on this machine.

use std::process::{Command, Stdio};

pub const CHROMIUM: &str = "SHELLCAL_CHROMIUM";
const NAMES: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];

pub fn find() -> Option<String> {
    let named = std::env::var(CHROMIUM).ok().filter(|name| !name.is_empty());
    let starts = |name: &String| {
        let mut command = Command::new(name);
        command.arg("--version").stdout(Stdio::null()).stderr(Stdio::null());
        command.status().is_ok_and(|status| status.success())
    };
    named.into_iter().chain(NAMES.map(str::to_owned)).find(starts)
}
