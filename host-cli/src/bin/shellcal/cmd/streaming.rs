//! What `stream`, `record --stream` and `live --stream` have in common: readers, commands, what is said at the end.

use std::io::{self, BufRead};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::thread;

use board_link::Watcher;
use frame_stream::{
    Destination, FrameStream, Readers, StreamCommand, StreamHandle, StreamOptions, StreamSummary,
    StreamWatcher,
};

use crate::printer::Printer;

/// Who looks on at a recording, and the end of a stream that is among them.
type WatchedStream = (Option<Box<dyn Watcher>>, Option<StreamHandle>);

/// Where rows go beside a log or a view, as JSON lines
#[derive(Debug, clap::Args)]
pub(crate) struct StreamToArgs {
    /// Pass rows on as they arrive, as `shellcal stream` does: to `udp:HOST:PORT`, `tcp:PORT` or a file; may be
    /// given several times
    #[arg(long, value_name = "DEST")]
    stream: Vec<Destination>,
}

impl StreamToArgs {
    pub(crate) fn is_given(&self) -> bool {
        !self.stream.is_empty()
    }

    /// Lets the stream look on beside another watcher. Its end does not end the recording.
    pub(crate) fn watch(
        &self,
        printer: &Printer,
        options: StreamOptions,
        beside: Option<Box<dyn Watcher>>,
    ) -> anyhow::Result<WatchedStream> {
        if !self.is_given() {
            return Ok((beside, None));
        }
        if self.stream.contains(&Destination::Stdout) {
            anyhow::bail!("only `shellcal stream` writes rows to the standard output");
        }
        let readers = open(printer, &self.stream, false)?;
        let stream = FrameStream::new(options, readers)?;
        let (watcher, handle) = StreamWatcher::new(stream, beside, None);
        Ok((Some(Box::new(watcher)), Some(handle)))
    }
}

/// Opens all destinations, and says where readers can come to.
pub(crate) fn open(
    printer: &Printer,
    to: &[Destination],
    overwrite: bool,
) -> anyhow::Result<Readers> {
    let readers = Readers::open(to, overwrite)?;
    for address in readers.addresses() {
        printer.note(format!("readers over TCP: {address}"));
        if !address.ip().is_loopback() {
            printer.warning(format!(
                "other machines reach {address}, and what is sent is not encrypted: whoever connects can read on"
            ));
        }
    }
    Ok(readers)
}

/// Commands from the standard input, a line each. `at_end` is set when there are no more.
pub(crate) fn commands(
    printer: &Printer,
    at_end: Option<Arc<AtomicBool>>,
) -> io::Result<Receiver<StreamCommand>> {
    let (sender, commands) = channel();
    each_line("commands", printer, at_end, move |line| {
        let command: StreamCommand = line.parse().map_err(|unknown| format!("{unknown}"))?;
        Ok(sender.send(command).is_ok())
    })?;
    Ok(commands)
}

/// Reads the standard input on a thread of this name. `take` says of each line whether it wants more, or what is wrong
/// with it. `at_end` is set when there are no more.
pub(crate) fn each_line(
    name: &str,
    printer: &Printer,
    at_end: Option<Arc<AtomicBool>>,
    mut take: impl FnMut(&str) -> Result<bool, String> + Send + 'static,
) -> io::Result<()> {
    let printer = printer.clone();
    let listen = move || {
        for line in io::stdin().lock().lines().map_while(Result::ok) {
            match take(&line) {
                Ok(true) => {}
                Ok(false) => return,
                Err(wrong) => printer.warning(wrong),
            }
        }
        if let Some(at_end) = at_end {
            at_end.store(true, Ordering::Relaxed);
        }
    };
    thread::Builder::new().name(name.to_owned()).spawn(listen).map(drop)
}

/// Ends a stream, and says what came of it.
pub(crate) fn finish(
    printer: &Printer,
    handle: Option<&StreamHandle>,
) -> anyhow::Result<Option<StreamSummary>> {
    let Some(summary) = handle.map(StreamHandle::finish).transpose()?.flatten() else {
        return Ok(None);
    };
    for reader in &summary.readers {
        let lost = match reader.lost {
            0 => "none lost".to_owned(),
            lost => format!("{lost} lost"),
        };
        printer.note(format!("{}: {} rows, {lost}", reader.name, reader.rows));
        if let Some(problem) = &reader.problem {
            printer.warning(format!("{}: {problem}", reader.name));
        }
    }
    Ok(Some(summary))
}
