//! All output to the terminal: results to stdout, messages to stderr.

use std::error::Error;
use std::io::{self, IsTerminal, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use beam_channel::SetupError;
use clap::ColorChoice;
use console::{Color, Style, StyledObject};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle, WeakProgressBar};
use log_file::{Log, ReadOptions};
use output_file::{AtomicFile, Outputs};
use serde::Serialize;
use shell_data::escape;
use shell_data::hint::Hint;
use shell_data::lock::lock;
use shellcal::workflow;
use shellcal::workflow::gates::Gate;
use shellcal::workflow::remark::Remark;

use crate::files::{OutputPath, is_standard};
use crate::tables::{self, TableForm};

/// Outcome of a command that could run, and its exit code. [`Printer::judge`] and [`Printer::decide`] decide it
/// before anything is printed, so it stays the same if the reader of the output goes away.
#[must_use]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Outcome {
    Done = 0,
    /// The command ran, but a check that the user requested has failed.
    CheckFailed = 1,
}

impl From<()> for Outcome {
    fn from((): ()) -> Self {
        Self::Done
    }
}

/// Help heading of the options of every command, which come last.
pub(crate) const GLOBAL: &str = "Every command";

/// Amount and form of the output.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(crate) struct OutputArgs {
    /// Print one JSON document instead of tables
    #[arg(long, global = true, help_heading = GLOBAL)]
    json: bool,

    /// Print nothing but results and errors: no progress, no notes
    #[arg(long, short, global = true, help_heading = GLOBAL)]
    quiet: bool,

    /// Say more: what each setting is and where it comes from, how the work is done
    #[arg(long, global = true, help_heading = GLOBAL, conflicts_with = "quiet")]
    verbose: bool,

    /// Tell progress as lines on stderr, for a program that runs this one
    #[arg(long, global = true, hide = true)]
    progress_lines: bool,

    /// How tables are printed: text, markdown or csv; with csv nothing else goes to the standard output
    #[arg(long = "as", global = true, help_heading = GLOBAL, value_name = "FORM", value_enum, default_value_t = TableForm::Text, conflicts_with = "json", hide_possible_values = true)]
    form: TableForm,

    /// When to colour terminal output: auto, always or never; `NO_COLOR` counts as never
    #[arg(long, global = true, help_heading = GLOBAL, value_name = "WHEN", value_enum, default_value_t = ColorChoice::Auto, hide_possible_values = true)]
    color: ColorChoice,
}

pub(crate) type TableColumn<'a, T> = (&'a str, &'a dyn Fn(&T) -> String);

const REDRAWN: Duration = Duration::from_millis(200);

#[derive(Clone, Debug)]
pub(crate) struct Printer {
    options: OutputArgs,
    /// True if a table was printed.
    has_table: Arc<AtomicBool>,
    /// The first error of the standard output, if any.
    printed: Arc<Mutex<io::Result<()>>>,
    has_failed: Arc<AtomicBool>,
    pub(crate) files: Arc<Outputs>,
}

impl Printer {
    pub(crate) fn new(options: OutputArgs) -> Self {
        let printed = Arc::new(Mutex::new(Ok(())));
        let (has_table, has_failed) = Default::default();
        Self { options, has_table, printed, has_failed, files: Arc::default() }
    }

    pub(crate) fn json(&self) -> bool {
        self.options.json
    }

    pub(crate) fn is_csv(&self) -> bool {
        self.options.form == TableForm::Csv
    }

    /// True if a stream is coloured. `usual` is the choice without `--color`: by environment variables
    /// (no-color.org), and true only for a terminal.
    fn is_painted(&self, usual: bool) -> bool {
        match self.options.color {
            ColorChoice::Always => true,
            ColorChoice::Never => false,
            ColorChoice::Auto => usual,
        }
    }

    pub(crate) fn is_colored(&self) -> bool {
        self.is_painted(console::colors_enabled())
    }

    /// Decides the outcome by a gate, and prints its failures.
    pub(crate) fn judge(&self, gate: &Gate) -> Outcome {
        gate.failures().iter().for_each(|failure| self.warning(failure.to_string()));
        self.decide(gate.passes())
    }

    pub(crate) fn decide(&self, passes: bool) -> Outcome {
        self.has_failed.store(!passes, Ordering::Relaxed);
        self.decided()
    }

    /// The decided outcome, also if the command could not print its result.
    pub(crate) fn decided(&self) -> Outcome {
        match self.has_failed.load(Ordering::Relaxed) {
            true => Outcome::CheckFailed,
            false => Outcome::Done,
        }
    }

    /// Prints the result of a command as one JSON document, with all numbers at full precision.
    pub(crate) fn document(&self, value: &impl Serialize) -> anyhow::Result<()> {
        let text = serde_json::to_string_pretty(value).expect("every document has keys of text");
        self.print(&escape::json(&(text + "\n")));
        self.printed()
    }

    /// Prints the final result of a command: as one JSON document if requested, otherwise with `print`.
    pub(crate) fn finish(
        &self,
        value: &impl Serialize,
        print: impl FnOnce(&Self),
    ) -> anyhow::Result<()> {
        if self.json() {
            return self.document(value);
        }
        print(self);
        self.printed()
    }

    pub(crate) fn create(&self, path: Option<&OutputPath>) -> anyhow::Result<Option<AtomicFile>> {
        Ok(path.map(|path| self.files.create(path)).transpose()?)
    }

    /// Creates the output file at `path`. Without a path, or with `-`, it is the standard output, which
    /// `--json` reserves for its document.
    pub(crate) fn create_or_stdout(&self, path: Option<&OutputPath>) -> anyhow::Result<AtomicFile> {
        if let Some(path) = path.filter(|path| !is_standard(path)) {
            return Ok(self.files.create(path)?);
        }
        anyhow::ensure!(
            !self.json(),
            "`--json` needs `--output`, or a file in place of `-`: both would go to the standard output; or leave out `--json`"
        );
        Ok(AtomicFile::stdout())
    }

    /// Prints the content of a file verbatim, in one write; prints nothing once the standard output has failed.
    pub(crate) fn print(&self, content: &str) {
        let mut printed = lock(&self.printed);
        if printed.is_ok() {
            *printed = io::stdout().lock().write_all(content.as_bytes());
        }
    }

    /// The error if some output could not be written.
    pub(crate) fn printed(&self) -> anyhow::Result<()> {
        Ok(std::mem::replace(&mut *lock(&self.printed), Ok(()))?)
    }

    pub(crate) fn line(&self, text: impl AsRef<str>) {
        self.tinted("", None, text.as_ref())
    }

    /// Prints one line of a result, with a coloured word before it.
    pub(crate) fn tinted(&self, word: &str, color: Option<Color>, text: &str) {
        let text = escape::terminal(text);
        match self.options.form {
            TableForm::Csv => self.note(format!("{word}{text}")),
            TableForm::Markdown if text.is_empty() => {}
            // In Markdown, each line is a paragraph.
            TableForm::Markdown => self.print(&format!("{word}{text}\n\n")),
            TableForm::Text => {
                let word = painted(word, color, self.is_colored());
                self.print(&format!("{word}{text}\n"));
            }
        }
    }

    /// Prints a table: the first column is a label, the others are numbers.
    pub(crate) fn table(&self, header: &[&str], rows: impl IntoIterator<Item = Vec<String>>) {
        let form = self.options.form;
        let mut text = String::new();
        // CSV tables are separated by an empty line.
        if form == TableForm::Csv && self.has_table.swap(true, Ordering::Relaxed) {
            text.push('\n');
        }
        let rows: Vec<Vec<String>> = rows.into_iter().collect();
        for line in tables::lines(form, header, &rows) {
            text += &escape::terminal(&line);
            text.push('\n');
        }
        if form == TableForm::Markdown {
            text.push('\n');
        }
        self.print(&text);
    }

    pub(crate) fn records<T>(
        &self,
        columns: &[TableColumn<'_, T>],
        records: impl IntoIterator<Item = T>,
    ) {
        let header: Vec<&str> = columns.iter().map(|(name, _)| *name).collect();
        let row = |record: T| columns.iter().map(|(_, cell)| cell(&record)).collect();
        self.table(&header, records.into_iter().map(row));
    }

    /// Writes a note about the work to stderr, but not with `--quiet`.
    pub(crate) fn note(&self, text: impl AsRef<str>) {
        if !self.options.quiet {
            self.talk("", None, text.as_ref());
        }
    }

    pub(crate) fn remarks(&self, remarks: impl IntoIterator<Item = Remark>) {
        for remark in remarks {
            match remark {
                Remark::Note(text) => self.note(text),
                Remark::Warning(text) => self.warning(text),
            }
        }
    }

    pub(crate) fn is_verbose(&self) -> bool {
        self.options.verbose
    }

    /// Writes a note about the inner workings to stderr, with `--verbose` only.
    pub(crate) fn detail(&self, text: impl AsRef<str>) {
        if self.options.verbose {
            self.talk("", None, text.as_ref());
        }
    }

    /// Warns on stderr, even with `--quiet`: the user must not miss it.
    pub(crate) fn warning(&self, text: impl AsRef<str>) {
        self.talk("warning: ", Some(Color::Yellow), text.as_ref());
    }

    /// Reports a failure of one item; others may have succeeded.
    pub(crate) fn failure(&self, text: impl AsRef<str>) {
        self.talk("error: ", Some(Color::Red), text.as_ref());
    }

    pub(crate) fn error(&self, error: &anyhow::Error) {
        self.talk("error: ", Some(Color::Red), &format!("{error:#}"));
        if let Some(hint) = for_error(error) {
            self.talk("hint: ", Some(Color::Cyan), &hint);
        }
    }

    /// A progress bar over `bytes` on stderr, removed when it is dropped. Draws nothing with `--quiet` or
    /// without a terminal.
    pub(crate) fn progress(&self, label: &str, bytes: u64) -> ProgressBar {
        self.bar(label, bytes, "{msg} {wide_bar} {bytes}/{total_bytes} {eta}")
    }

    /// Runs work that reads a log, with a progress bar over its bytes.
    pub(crate) fn scan<T>(
        &self,
        log: &Log,
        read: ReadOptions<'_>,
        work: impl FnOnce(ReadOptions<'_>) -> T,
    ) -> T {
        let bar = self.progress(&log.path().display().to_string(), log.bytes());
        let progress = |bytes| bar.set_position(bytes);
        work(ReadOptions { progress: Some(&progress), ..read })
    }

    pub(crate) fn count(&self, label: &str, total: u64) -> ProgressBar {
        self.bar(label, total, "{msg} {wide_bar} {human_pos}/{human_len} {eta}")
    }

    fn bar(&self, label: &str, total: u64, template: &str) -> ProgressBar {
        let bar = ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::hidden());
        if self.options.progress_lines && !self.options.quiet {
            let bar = bar.downgrade();
            thread::spawn(move || tell(&bar, total));
        } else if !self.options.quiet && io::stderr().is_terminal() {
            bar.set_style(style(template));
            bar.set_message(escape::terminal(label).into_owned());
            bar.set_draw_target(ProgressDrawTarget::stderr());
            bar.enable_steady_tick(REDRAWN);
        }
        bar
    }

    /// A status line on stderr; draws nothing with `--quiet` or without a terminal.
    pub(crate) fn status(&self) -> ProgressBar {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::hidden());
        if !self.options.quiet && io::stderr().is_terminal() {
            bar.set_style(style("{wide_msg}"));
            bar.set_draw_target(ProgressDrawTarget::stderr());
        }
        bar
    }

    /// Writes a message to stderr. Errors are ignored: with stderr closed, there is nowhere to report them.
    fn talk(&self, word: &str, color: Option<Color>, text: &str) {
        let word = painted(word, color, self.is_painted(console::colors_enabled_stderr()));
        let _ = writeln!(io::stderr().lock(), "{word}{}", escape::terminal(text));
    }
}

fn painted(word: &str, color: Option<Color>, is_on: bool) -> StyledObject<&str> {
    let style = color.map_or_else(Style::new, |color| Style::new().bold().fg(color));
    style.force_styling(is_on).apply_to(word)
}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).expect("a template that parses")
}

/// Prints the progress of a bar as lines, such as `progress: 3/25`, until it is finished.
fn tell(bar: &WeakProgressBar, total: u64) {
    while let Some(bar) = bar.upgrade().filter(|bar| !bar.is_finished()) {
        let _ = writeln!(io::stderr().lock(), "progress: {}/{total}", bar.position());
        drop(bar);
        thread::sleep(REDRAWN);
    }
}

/// The next step after `error`, if one is known.
fn for_error(error: &anyhow::Error) -> Option<String> {
    error.chain().find_map(|cause| {
        let setup = cause.downcast_ref().and_then(SetupError::hint).map(str::to_owned);
        setup.or_else(|| HINTS.iter().find_map(|hint| hint(cause)))
    })
}

/// An error in a chain does not say which hints it has: every type that has some is tried.
const HINTS: [fn(&(dyn Error + 'static)) -> Option<String>; 10] = [
    hint::<board_link::LinkError>,
    hint::<board_link::NotForBoard>,
    hint::<board_link::RecordError>,
    hint::<calibration::FitError>,
    hint::<calibration_file::CalibrationFileError>,
    hint::<calibration_file::MergeError>,
    hint::<log_file::LogError>,
    hint::<output_file::OutputError>,
    hint::<reference_sensor::ReferenceError>,
    hint::<workflow::WorkflowError>,
];

fn hint<E: Error + Hint + 'static>(cause: &(dyn Error + 'static)) -> Option<String> {
    cause.downcast_ref::<E>().and_then(Hint::hint)
}

/// True if the reader of the standard output has gone away, which is not an error.
pub(crate) fn is_closed_pipe(error: &anyhow::Error) -> bool {
    error
        .chain()
        .filter_map(|cause| cause.downcast_ref::<io::Error>())
        .any(|error| error.kind() == io::ErrorKind::BrokenPipe)
}
