//! QEMU: getting it, and runs that are counted.

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result, bail};
use serde_json::{Value, json};
use system_tests::emulation::{COUNTED_TIME, Memory, QEMU};

use crate::image::RAM;
use crate::need::{Need, Way};
use crate::steps::installed;

/// How long QEMU may be silent: a run takes a second.
const PATIENCE: Duration = Duration::from_secs(120);

/// How much RAM the emulated board has.
const RAM_SIZE: u32 = 64 * 1024;

/// What RAM holds before the start, to see which of it was used. No address and no small number.
const PAINT: u8 = 0xA5;

pub(crate) const NEED: Need = Need {
    what: "QEMU for Arm",
    is_met: || installed(QEMU, &["--version"]),
    ways: &[Way::Packages(&["qemu-system-arm"])],
};

/// Finds QEMU, or gets it.
pub(crate) fn set_up() -> Result<()> {
    NEED.meet()
}

/// A run from the reset of the board to the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Run {
    /// Instructions executed.
    pub(crate) instructions: u64,
    /// The deepest that the stack has been, in bytes.
    pub(crate) stack: u32,
}

/// Runs an image until it resets itself, with its variables ending at `ram_end`. The same image and
/// memory always give the same.
pub(crate) fn run(image: &Path, memory: Memory, ram_end: u32, dir: &Path) -> Result<Run> {
    let room = RAM + RAM_SIZE - ram_end;
    let memory = memory.bytes(ram_end, vec![PAINT; room as usize]);
    let mut qemu = memory.start(image, dir)?;
    // A reset stops the emulator instead, and lets us ask it.
    qemu.args(COUNTED_TIME).args(["-serial", "null", "-no-reboot", "-no-shutdown"]);
    qemu.args(["-qmp", "stdio"]).stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut child = qemu.spawn().with_context(|| format!("cannot start {QEMU}"))?;
    let run = examine(&mut child, ram_end, room, dir);
    // Ends by itself when all went well.
    child.kill().ok();
    child.wait()?;
    run
}

fn examine(child: &mut Child, ram_end: u32, room: u32, dir: &Path) -> Result<Run> {
    let mut monitor = Monitor::new(child)?;
    monitor.ask("qmp_capabilities", json!({}))?;
    monitor.wait_for(|message| message["event"] == "STOP")?;
    let replay = monitor.ask("query-replay", json!({}))?;
    let instructions = replay["icount"].as_u64().context("QEMU does not count instructions")?;
    let dump = dir.join("stack.bin");
    let area = json!({ "val": ram_end, "size": room, "filename": dump.to_string_lossy() });
    monitor.ask("pmemsave", area)?;
    monitor.ask("quit", json!({}))?;
    let stack = std::fs::read(&dump)?;
    let unused = stack.iter().take_while(|&&byte| byte == PAINT).count();
    Ok(Run { instructions, stack: room - unused as u32 })
}

/// QEMU's monitor, which speaks a JSON document a line (QEMU, "QEMU Machine Protocol").
struct Monitor {
    input: ChildStdin,
    lines: Receiver<String>,
}

impl Monitor {
    fn new(child: &mut Child) -> Result<Self> {
        let input = child.stdin.take().context("no way to QEMU")?;
        let output = BufReader::new(child.stdout.take().context("no way from QEMU")?);
        let (sender, lines) = channel();
        // Ends with QEMU.
        thread::spawn(move || {
            output.lines().map_while(Result::ok).try_for_each(|line| sender.send(line))
        });
        Ok(Self { input, lines })
    }

    /// Runs a command of the monitor and returns what it answers.
    fn ask(&mut self, command: &str, arguments: Value) -> Result<Value> {
        let message = json!({ "execute": command, "arguments": arguments });
        writeln!(self.input, "{message}").context("QEMU does not listen")?;
        let mut answer = self.wait_for(|message| {
            message.get("return").is_some() || message.get("error").is_some()
        })?;
        match answer.get("error") {
            Some(error) => bail!("QEMU refuses `{command}`: {}", error["desc"]),
            None => Ok(answer["return"].take()),
        }
    }

    /// The next message that is one of those wanted; others are passed over.
    fn wait_for(&mut self, wanted: impl Fn(&Value) -> bool) -> Result<Value> {
        loop {
            let line = match self.lines.recv_timeout(PATIENCE) {
                Ok(line) => line,
                Err(RecvTimeoutError::Timeout) => bail!("QEMU says nothing any more"),
                Err(RecvTimeoutError::Disconnected) => bail!("the emulated board has failed"),
            };
            // What is no JSON is what the firmware says.
            match serde_json::from_str::<Value>(&line) {
                Ok(message) if wanted(&message) => return Ok(message),
                Ok(_) => {}
                Err(_) => eprintln!("{line}"),
            }
        }
    }
}
