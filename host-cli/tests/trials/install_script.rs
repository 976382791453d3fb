//! `install.sh` in an empty home, with only the tools that it names.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use super::book::root;

/// Tools of POSIX, and those that the script's head names.
const TOOLS: [&str; 14] = [
    "sh",
    "uname",
    "mktemp",
    "rm",
    "curl",
    "sed",
    "wc",
    "sha256sum",
    "tar",
    "gzip",
    "mkdir",
    "cp",
    "mv",
    "cat",
];

/// A simulated machine: a home, a path, and a release to fetch from.
struct Machine {
    folder: tempfile::TempDir,
}

impl Machine {
    fn new() -> Self {
        let machine = Self { folder: tempfile::tempdir().unwrap() };
        for folder in ["home", "tools", "release"] {
            fs::create_dir(machine.path(folder)).unwrap();
        }
        for tool in TOOLS {
            let found = std::env::split_paths(&std::env::var_os("PATH").unwrap())
                .map(|folder| folder.join(tool))
                .find(|path| path.is_file());
            symlink(
                found.unwrap_or_else(|| panic!("no `{tool}`")),
                machine.path("tools").join(tool),
            )
            .unwrap();
        }
        let name = format!("shellcal-0.0.0-{}-unknown-linux-gnu", std::env::consts::ARCH);
        let staged = machine.path(&name);
        for folder in ["completions", "man"] {
            fs::create_dir_all(staged.join(folder)).unwrap();
        }
        // A copy of the program is large.
        let program = Path::new(env!("CARGO_BIN_EXE_shellcal"));
        let script = format!("#!/bin/sh\nexec '{}' \"$@\"\n", program.display());
        let runs = staged.join("shellcal");
        fs::write(&runs, script).unwrap();
        use std::os::unix::fs::PermissionsExt;
        fs::set_permissions(&runs, fs::Permissions::from_mode(0o755)).unwrap();
        for (folder, file) in [
            ("completions", "shellcal.bash"),
            ("completions", "_shellcal"),
            ("completions", "shellcal.fish"),
            ("man", "shellcal.1"),
            ("man", "shellcal-fit.1"),
            (".", "THIRD-PARTY.txt"),
        ] {
            fs::write(staged.join(folder).join(file), file).unwrap();
        }
        let archive = format!("release/{name}.tar.gz");
        machine
            .sh(&format!("tar -czf {archive} {name} && cd release && sha256sum *.gz > SHA256SUMS"));
        machine
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn sh(&self, line: &str) {
        let status = Command::new("sh").args(["-c", line]).current_dir(self.folder.path()).status();
        assert!(status.unwrap().success(), "{line}");
    }

    fn install(&self) -> Output {
        Command::new("/bin/sh")
            .arg(root().join("install.sh"))
            .env_clear()
            .env("HOME", self.path("home"))
            .env("PATH", self.path("tools"))
            .env("SHELLCAL_RELEASE", format!("file://{}", self.path("release").display()))
            .output()
            .unwrap()
    }

    /// The script must fail, and leave nothing behind.
    fn refuses(&self) -> String {
        let output = self.install();
        assert_eq!(output.status.code(), Some(1));
        assert_eq!(fs::read_dir(self.path("home")).unwrap().count(), 0);
        String::from_utf8(output.stderr).unwrap()
    }
}

#[test]
fn a_release_is_installed_into_an_empty_home() {
    let machine = Machine::new();
    for _ in 0..2 {
        let output = machine.install();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{said}");
        assert!(said.contains("put ") && said.contains(".local/bin on the path"), "{said}");
        let version = format!("shellcal {}\n", env!("CARGO_PKG_VERSION"));
        assert_eq!(String::from_utf8_lossy(&output.stdout), version);
    }
    let home = machine.path("home/.local");
    for file in [
        "bin/shellcal",
        "share/bash-completion/completions/shellcal",
        "share/zsh/site-functions/_shellcal",
        "share/fish/vendor_completions.d/shellcal.fish",
        "share/man/man1/shellcal-fit.1",
        "share/doc/shellcal/THIRD-PARTY.txt",
    ] {
        assert!(home.join(file).is_file(), "{file}");
    }
}

#[test]
fn damaged_or_missing_files_are_not_installed() {
    let machine = Machine::new();
    let sums = fs::read_to_string(machine.path("release/SHA256SUMS")).unwrap();
    machine.sh("for archive in release/*.tar.gz; do printf x >> \"$archive\"; done");
    assert!(machine.refuses().contains("is damaged"));
    fs::write(machine.path("release/SHA256SUMS"), sums.replace("-unknown-linux-gnu", "-other"))
        .unwrap();
    assert!(machine.refuses().contains("no archive for"));
    fs::remove_file(machine.path("release/SHA256SUMS")).unwrap();
    assert!(machine.refuses().contains("cannot fetch"));
}
