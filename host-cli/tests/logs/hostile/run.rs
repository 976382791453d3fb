//! Runs the program with limits, and checks its outputs.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use shell_data::escape;

/// Processor time of a command, s; wall-clock time would depend on other load.
const PROCESSOR_S: u64 = 60;

/// Time after which a program that has not ended is considered to hang.
const PATIENCE: Duration = Duration::from_secs(600);

/// Memory limit (data and stacks), KiB, for any command on files of up to 1 MB.
const MEMORY: u64 = 256 << 10;

#[derive(Clone, Copy, Debug)]
pub(super) struct Blow {
    pub(super) name: &'static str,
    pub(super) number: i32,
    pub(super) after: Duration,
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Trouble {
    pub(super) blow: Option<Blow>,
    /// Largest size of a file in blocks of 512 bytes, to simulate a full disk.
    pub(super) disk: Option<u64>,
    pub(super) reader_leaves: bool,
}

/// Runs the program; the error describes the violated rule.
pub(super) fn run(dir: &Path, arguments: &[OsString], trouble: Trouble) -> Result<(), String> {
    let (before, blow) = (contents(dir), trouble.blow);
    let disk = trouble.disk.map_or(String::new(), |of| format!("trap '' XFSZ; ulimit -f {of}; "));
    let limit = format!("{disk}ulimit -d {MEMORY}; ulimit -t {PROCESSOR_S}; exec \"$0\" \"$@\"");
    let mut command = Command::new("sh");
    command
        .args(["-c", &limit])
        .arg(env!("CARGO_BIN_EXE_shellcal"))
        .args(arguments)
        .current_dir(dir);
    let (stdout, stderr) = (dir.join(".stdout"), dir.join(".stderr"));
    let create = |path: &PathBuf| fs::File::create(path).map_err(|error| error.to_string());
    command.stdin(Stdio::null()).stdout(create(&stdout)?).stderr(create(&stderr)?);
    if trouble.reader_leaves {
        command.stdout(unread());
    }
    let mut child = command.spawn().map_err(|error| error.to_string())?;
    let status = wait(&mut child, blow)?;
    let take = |path: &PathBuf| {
        let bytes = fs::read(path).unwrap_or_default();
        fs::remove_file(path).map(|()| bytes).map_err(|error| error.to_string())
    };
    let stdout = String::from_utf8_lossy(&take(&stdout)?).into_owned();
    let stderr = String::from_utf8_lossy(&take(&stderr)?).into_owned();
    let is_ours = blow.is_some_and(|blow| status.signal() == Some(blow.number));
    if !is_ours && !matches!(status.code(), Some(0..=2)) {
        return Err(format!("it ended with {status}: {stderr}"));
    }
    // A recording on the standard output is not text for a terminal.
    let is_invisible = |c: char| c != '\n' && c != '\t' && escape::is_invisible(c);
    let is_data =
        arguments.iter().any(|word| word == "convert" || word == "align" || word == "synth");
    for (name, text) in [("stdout", &stdout), ("stderr", &stderr)] {
        if text.contains(is_invisible) && !(name == "stdout" && is_data) {
            return Err(format!("{name} steers the terminal: {text:?}"));
        }
    }
    if stderr.contains("panicked at") {
        return Err(format!("it panicked: {stderr}"));
    }
    let grows = arguments.first().is_some_and(|word| word == "stream");
    check(&before, &contents(dir), [status.success(), grows && blow.is_none()])
}

pub(super) fn unread() -> Stdio {
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    writer.into()
}

fn wait(child: &mut Child, blow: Option<Blow>) -> Result<std::process::ExitStatus, String> {
    let started = Instant::now();
    let mut blow = blow;
    loop {
        if let Some(status) = child.try_wait().map_err(|error| error.to_string())? {
            return Ok(status);
        }
        if let Some(due) = blow.take_if(|blow| started.elapsed() >= blow.after) {
            let _ = Command::new("kill")
                .args([due.name, &child.id().to_string()])
                .stderr(Stdio::null())
                .status();
        }
        if started.elapsed() > PATIENCE {
            let _ = child.kill();
            let _ = child.wait();
            return Err("it hangs".to_owned());
        }
        thread::sleep(Duration::from_millis(1));
    }
}

fn contents(dir: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![dir.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let bytes = fs::read(&path).unwrap_or_default();
                files.insert(path, bytes);
            }
        }
    }
    files
}

/// Checks that existing files are unchanged and new files are complete. A growing file must end with a whole row.
fn check(
    before: &BTreeMap<PathBuf, Vec<u8>>,
    after: &BTreeMap<PathBuf, Vec<u8>>,
    [succeeded, grows]: [bool; 2],
) -> Result<(), String> {
    // Random commands have their outputs in `out`; all other files are inputs.
    let is_output = |path: &Path| path.components().any(|part| part.as_os_str() == "out");
    if let Some((path, _)) =
        before.iter().find(|(path, bytes)| !is_output(path) && after.get(*path) != Some(*bytes))
    {
        return Err(format!("the input `{}` is not what it was", path.display()));
    }
    for (path, bytes) in after.iter().filter(|(path, _)| !before.contains_key(*path)) {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if name.starts_with(".shellcal-") {
            return Err(format!("`{name}` is left over"));
        }
        if !is_output(path) {
            return Err(format!("`{}` was not asked for", path.display()));
        }
        if grows && !bytes.is_empty() && !bytes.ends_with(b"\n") {
            return Err(format!("`{name}` ends within a row"));
        }
        if succeeded {
            is_believable(&name, bytes)?;
        }
    }
    Ok(())
}

/// Checks that an output of a successful run is complete, and that its numbers are finite.
fn is_believable(name: &str, bytes: &[u8]) -> Result<(), String> {
    let text = String::from_utf8_lossy(bytes);
    let name_ends_csv = name.ends_with(".csv");
    let is_text = [".csv", ".json", ".txt"].iter().any(|extension| name.ends_with(extension));
    let not_a_number = |word: &str| matches!(word, "NaN" | "nan" | "inf" | "-inf" | "Infinity");
    // Names that are copied from an input may be words such as `NaN`.
    let header: Vec<&str> = text.lines().next().unwrap_or_default().split(',').collect();
    let is_name = |position: usize| {
        let name = header.get(position).copied().unwrap_or_default();
        matches!(name, "file" | "condition" | "notes" | "flags") && name_ends_csv
    };
    let is_wrong = |line: &str| {
        let mut cells = line.split(',').enumerate().filter(|(position, _)| !is_name(*position));
        cells.any(|(_, cell)| cell.split([' ', '|', ':', '[', ']']).any(not_a_number))
    };
    if let Some(line) = text.lines().find(|line| is_text && is_wrong(line)) {
        return Err(format!("`{name}` holds what is not a number: {line}"));
    }
    if is_text && !text.is_empty() && !text.ends_with('\n') {
        return Err(format!("`{name}` ends within a line"));
    }
    if name.ends_with(".json") && serde_json::from_str::<serde_json::Value>(&text).is_err() {
        return Err(format!("`{name}` is not JSON"));
    }
    Ok(())
}
