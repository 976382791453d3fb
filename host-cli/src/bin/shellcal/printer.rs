//! The only place that writes to the terminal: results to stdout, talk to stderr.

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

/// How a command that could run has ended, and the exit code for it. [`Printer::judge`] and [`Printer::decide`] make
/// one, before anything is printed: a reader that goes away changes nothing.
#[must_use]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// Done.
    Done = 0,
    /// Ran, but a check that the user asked for has failed.
    CheckFailed = 1,
}

/// A command without checks.
impl From<()> for Outcome {
    fn from((): ()) -> Self {
        Self::Done
    }
}

/// What help calls the options of every command, which stand at its end.
pub(crate) const GLOBAL: &str = "Every command";

/// How much is said, and in which form.
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

    /// Whether to colour what goes to a terminal: auto, always or never; `NO_COLOR` counts as never
    #[arg(long, global = true, help_heading = GLOBAL, value_name = "WHEN", value_enum, default_value_t = ColorChoice::Auto, hide_possible_values = true)]
    color: ColorChoice,
}

/// A column of a table: its name, and what it shows of a record.
pub(crate) type TableColumn<'a, T> = (&'a str, &'a dyn Fn(&T) -> String);

/// How often progress is told.
const REDRAWN: Duration = Duration::from_millis(200);

/// Where a command's results and remarks go.
#[derive(Clone, Debug)]
pub(crate) struct Printer {
    options: OutputArgs,
    /// Whether a table was printed.
    has_table: Arc<AtomicBool>,
    /// Whether the standard output has taken all that was printed.
    printed: Arc<Mutex<io::Result<()>>>,
    /// Whether a check has failed.
    has_failed: Arc<AtomicBool>,
    /// The files that the command reads and writes.
    pub(crate) files: Arc<Outputs>,
}

impl Printer {
    pub(crate) fn new(options: OutputArgs) -> Self {
        let printed = Arc::new(Mutex::new(Ok(())));
        let (has_table, has_failed) = Default::default();
        Self { options, has_table, printed, has_failed, files: Arc::default() }
    }

    /// Whether the user asked for one JSON document in place of tables.
    pub(crate) fn json(&self) -> bool {
        self.options.json
    }

    /// Whether a stream is coloured, which the environment has `usual`ly: no-color.org, a terminal or not.
    fn is_painted(&self, usual: bool) -> bool {
        match self.options.color {
            ColorChoice::Always => true,
            ColorChoice::Never => false,
            ColorChoice::Auto => usual,
        }
    }

    /// Whether what goes to the standard output is coloured.
    pub(crate) fn is_colored(&self) -> bool {
        self.is_painted(console::colors_enabled())
    }

    /// Decides by a gate how the command ends, and says what fails.
    pub(crate) fn judge(&self, gate: &Gate) -> Outcome {
        gate.failures().iter().for_each(|failure| self.warning(failure.to_string()));
        self.decide(gate.passes())
    }

    /// Decides how the command ends.
    pub(crate) fn decide(&self, passes: bool) -> Outcome {
        self.has_failed.store(!passes, Ordering::Relaxed);
        self.decided()
    }

    /// The decision, also where the command could not print its result.
    pub(crate) fn decided(&self) -> Outcome {
        match self.has_failed.load(Ordering::Relaxed) {
            true => Outcome::CheckFailed,
            false => Outcome::Done,
        }
    }

    /// Prints the result of a command as one JSON document, every figure at full precision.
    pub(crate) fn document(&self, value: &impl Serialize) -> anyhow::Result<()> {
        let text = serde_json::to_string_pretty(value).expect("every document has keys of text");
        self.print(&escape::json(&(text + "\n")));
        self.printed()
    }

    /// Prints the result of a command that is done: as one JSON document where that was asked for, otherwise as
    /// `print` shows it.
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

    /// Creates an output file, if one is named.
    pub(crate) fn create(&self, path: Option<&OutputPath>) -> anyhow::Result<Option<AtomicFile>> {
        Ok(path.map(|path| self.files.create(path)).transpose()?)
    }

    /// Creates the output file at `path`. Without one, or at `-`, it is the standard output, which `--json` has for
    /// its document.
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

    /// Prints what would be a file of its own, as it stands, at one go; nothing, once the standard output has failed.
    pub(crate) fn print(&self, content: &str) {
        let mut printed = lock(&self.printed);
        if printed.is_ok() {
            *printed = io::stdout().lock().write_all(content.as_bytes());
        }
    }

    /// Whether all that was printed has arrived.
    pub(crate) fn printed(&self) -> anyhow::Result<()> {
        Ok(std::mem::replace(&mut *lock(&self.printed), Ok(()))?)
    }

    /// Prints one line of a result that people read.
    pub(crate) fn line(&self, text: impl AsRef<str>) {
        self.tinted("", None, text.as_ref())
    }

    /// The same with a word before it that is coloured.
    pub(crate) fn tinted(&self, word: &str, color: Option<Color>, text: &str) {
        let text = escape::terminal(text);
        match self.options.form {
            TableForm::Csv => self.note(format!("{word}{text}")),
            TableForm::Markdown if text.is_empty() => {}
            // Each line a paragraph of its own.
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
        // Of several tables every one stands on its own.
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

    /// Prints a table with a row for each record.
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

    /// Notes and warnings.
    pub(crate) fn remarks(&self, remarks: impl IntoIterator<Item = Remark>) {
        for remark in remarks {
            match remark {
                Remark::Note(text) => self.note(text),
                Remark::Warning(text) => self.warning(text),
            }
        }
    }

    /// Whether more is to be said.
    pub(crate) fn is_verbose(&self) -> bool {
        self.options.verbose
    }

    /// Writes a note about how the work is done to stderr, with `--verbose` only.
    pub(crate) fn detail(&self, text: impl AsRef<str>) {
        if self.options.verbose {
            self.talk("", None, text.as_ref());
        }
    }

    /// Warns on stderr, even when quiet: the user must not miss it.
    pub(crate) fn warning(&self, text: impl AsRef<str>) {
        self.talk("warning: ", Some(Color::Yellow), text.as_ref());
    }

    /// Reports what could not be done among other things that could.
    pub(crate) fn failure(&self, text: impl AsRef<str>) {
        self.talk("error: ", Some(Color::Red), text.as_ref());
    }

    /// Reports why the command could not run.
    pub(crate) fn error(&self, error: &anyhow::Error) {
        self.talk("error: ", Some(Color::Red), &format!("{error:#}"));
        if let Some(hint) = for_error(error) {
            self.talk("hint: ", Some(Color::Cyan), &hint);
        }
    }

    /// A progress bar over `bytes` on stderr, which goes when it is dropped; draws nothing when quiet or not on a
    /// terminal.
    pub(crate) fn progress(&self, label: &str, bytes: u64) -> ProgressBar {
        self.bar(label, bytes, "{msg} {wide_bar} {bytes}/{total_bytes} {eta}")
    }

    /// Does work that reads a log, with a progress bar over its bytes.
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

    /// The same over things that are counted.
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

    /// A line on stderr that says how it goes; draws nothing when quiet or not on a terminal.
    pub(crate) fn status(&self) -> ProgressBar {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::hidden());
        if !self.options.quiet && io::stderr().is_terminal() {
            bar.set_style(style("{wide_msg}"));
            bar.set_draw_target(ProgressDrawTarget::stderr());
        }
        bar
    }

    /// A closed stderr leaves nobody to tell.
    fn talk(&self, word: &str, color: Option<Color>, text: &str) {
        let word = painted(word, color, self.is_painted(console::colors_enabled_stderr()));
        let _ = writeln!(io::stderr().lock(), "{word}{}", escape::terminal(text));
    }
}

/// A word in bold and in a colour.
fn painted(word: &str, color: Option<Color>, is_on: bool) -> StyledObject<&str> {
    let style = color.map_or_else(Style::new, |color| Style::new().bold().fg(color));
    style.force_styling(is_on).apply_to(word)
}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).expect("a template that parses")
}

/// Tells the progress of a bar as lines, such as `progress: 3/25`, until it is finished.
fn tell(bar: &WeakProgressBar, total: u64) {
    while let Some(bar) = bar.upgrade().filter(|bar| !bar.is_finished()) {
        let _ = writeln!(io::stderr().lock(), "progress: {}/{total}", bar.position());
        drop(bar);
        thread::sleep(REDRAWN);
    }
}

/// The next step after `error`, where one is known.
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

/// Whether the reader of our output has gone away, which is not an error.
pub(crate) fn is_closed_pipe(error: &anyhow::Error) -> bool {
    error
        .chain()
        .filter_map(|cause| cause.downcast_ref::<io::Error>())
        .any(|error| error.kind() == io::ErrorKind::BrokenPipe)
}
