//! The only place that writes to the terminal: results to stdout, talk to stderr.

use std::borrow::Cow;
use std::env;
use std::error::Error;
use std::io::{self, IsTerminal, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use beam_channel::SetupError;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle, TermLike};
use log_file::{Log, ReadOptions};
use output_file::{AtomicFile, Outputs};
use serde::Serialize;
use shell_data::escape;
use shell_data::hint::Hint;
use shellcal::workflow;
use shellcal::workflow::remark::Remark;

use crate::files::OutputPath;
use crate::tables::{self, TableForm};

/// How a command that could run has ended, and the exit code for it.
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
    #[arg(long, global = true, help_heading = GLOBAL, value_name = "WHEN", value_enum, default_value_t = ColorArg::Auto, hide_possible_values = true)]
    color: ColorArg,
}

/// When to colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum ColorArg {
    /// On a terminal, unless `NO_COLOR` is set
    Auto,
    /// Also in a pipe or a file
    Always,
    /// Not at all
    Never,
}

impl ColorArg {
    /// Whether a stream is coloured.
    pub(crate) fn is_on(self, is_terminal: bool) -> bool {
        match self {
            ColorArg::Always => true,
            ColorArg::Never => false,
            // The environment may have something against colours (no-color.org).
            ColorArg::Auto => {
                let is_set = |name: &str| env::var_os(name).is_some_and(|value| !value.is_empty());
                is_terminal
                    && !is_set("NO_COLOR")
                    && env::var_os("TERM").is_none_or(|it| it != "dumb")
            }
        }
    }
}

/// What a colour says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Tint {
    None,
    Good,
    Warning,
    Bad,
    Hint,
}

impl Tint {
    /// A word in bold and in this colour, by ECMA-48.
    fn paint(self, word: &str, is_on: bool) -> Cow<'_, str> {
        let code = match self {
            Tint::None => return Cow::Borrowed(word),
            Tint::Good => 32,
            Tint::Warning => 33,
            Tint::Bad => 31,
            Tint::Hint => 36,
        };
        match is_on && !word.is_empty() {
            true => Cow::Owned(format!("\u{1b}[1;{code}m{word}\u{1b}[0m")),
            false => Cow::Borrowed(word),
        }
    }
}

/// A column of a table: its name, and what it shows of a record.
pub(crate) type TableColumn<'a, T> = (&'a str, &'a dyn Fn(&T) -> String);

/// Where a command's results and remarks go.
#[derive(Clone, Debug)]
pub(crate) struct Printer {
    options: OutputArgs,
    /// Whether a table was printed.
    has_table: Arc<AtomicBool>,
    /// The files that the command reads and writes.
    pub(crate) files: Arc<Outputs>,
}

impl Printer {
    pub(crate) fn new(options: OutputArgs) -> Self {
        Self { options, has_table: Arc::default(), files: Arc::new(Outputs::new()) }
    }

    /// Whether the user asked for one JSON document in place of tables.
    pub(crate) fn json(&self) -> bool {
        self.options.json
    }

    /// Whether what goes to the standard output is coloured.
    pub(crate) fn is_colored(&self) -> bool {
        self.options.color.is_on(io::stdout().is_terminal())
    }

    /// Prints the result of a command as one JSON document, every figure at full precision.
    pub(crate) fn document(&self, value: &impl Serialize) -> anyhow::Result<()> {
        // At one go: stdout would pass it on line by line.
        let text = serde_json::to_string_pretty(value).map_err(io::Error::from)? + "\n";
        io::stdout().lock().write_all(escape::json(&text).as_bytes())?;
        Ok(())
    }

    /// Prints the result of a command that is done: as one JSON document where that was asked for, otherwise as
    /// `print` shows it.
    pub(crate) fn finish(
        &self,
        value: &impl Serialize,
        print: impl FnOnce(&Self) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        if self.json() { self.document(value) } else { print(self) }
    }

    /// Creates an output file, if one is named.
    pub(crate) fn create(&self, path: Option<&OutputPath>) -> anyhow::Result<Option<AtomicFile>> {
        Ok(path.map(|path| self.files.create(path)).transpose()?)
    }

    /// Prints what would be a file of its own, as it stands.
    pub(crate) fn file(&self, content: &[u8]) -> anyhow::Result<()> {
        Ok(io::stdout().lock().write_all(content)?)
    }

    /// Prints one line of a result that people read.
    pub(crate) fn line(&self, text: impl AsRef<str>) -> anyhow::Result<()> {
        self.tinted("", Tint::None, text.as_ref())
    }

    /// The same with a word before it that is coloured.
    pub(crate) fn tinted(&self, word: &str, tint: Tint, text: &str) -> anyhow::Result<()> {
        let text = escape::terminal(text);
        match self.options.form {
            TableForm::Csv => self.note(format!("{word}{text}")),
            TableForm::Markdown if text.is_empty() => {}
            // Each line a paragraph of its own.
            TableForm::Markdown => writeln!(io::stdout().lock(), "{word}{text}\n")?,
            TableForm::Text => {
                let word = tint.paint(word, self.is_colored());
                writeln!(io::stdout().lock(), "{word}{text}")?;
            }
        }
        Ok(())
    }

    /// Prints a table: the first column is a label, the others are numbers.
    pub(crate) fn table(
        &self,
        header: &[&str],
        rows: impl IntoIterator<Item = Vec<String>>,
    ) -> anyhow::Result<()> {
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
        io::stdout().lock().write_all(text.as_bytes())?;
        Ok(())
    }

    /// Prints a table with a row for each record.
    pub(crate) fn records<T>(
        &self,
        columns: &[TableColumn<'_, T>],
        records: impl IntoIterator<Item = T>,
    ) -> anyhow::Result<()> {
        let header: Vec<&str> = columns.iter().map(|(name, _)| *name).collect();
        let row = |record: T| columns.iter().map(|(_, cell)| cell(&record)).collect();
        self.table(&header, records.into_iter().map(row))
    }

    /// Writes a note about the work to stderr, but not with `--quiet`.
    pub(crate) fn note(&self, text: impl AsRef<str>) {
        if !self.options.quiet {
            self.talk("", Tint::None, text.as_ref());
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
            self.talk("", Tint::None, text.as_ref());
        }
    }

    /// Warns on stderr, even when quiet: the user must not miss it.
    pub(crate) fn warning(&self, text: impl AsRef<str>) {
        self.talk("warning: ", Tint::Warning, text.as_ref());
    }

    /// Reports what could not be done among other things that could.
    pub(crate) fn failure(&self, text: impl AsRef<str>) {
        self.talk("error: ", Tint::Bad, text.as_ref());
    }

    /// Reports why the command could not run.
    pub(crate) fn error(&self, error: &anyhow::Error) {
        self.talk("error: ", Tint::Bad, &format!("{error:#}"));
        if let Some(hint) = for_error(error) {
            self.talk("hint: ", Tint::Hint, &hint);
        }
    }

    /// A progress bar over `bytes` on stderr; draws nothing when quiet or not on a terminal.
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
        let done = work(ReadOptions { progress: Some(&progress), ..read });
        bar.finish_and_clear();
        done
    }

    /// The same over things that are counted.
    pub(crate) fn count(&self, label: &str, total: u64) -> ProgressBar {
        self.bar(label, total, "{msg} {wide_bar} {human_pos}/{human_len} {eta}")
    }

    fn bar(&self, label: &str, total: u64, template: &str) -> ProgressBar {
        let bar = ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::hidden());
        if self.options.progress_lines && !self.options.quiet {
            let lines = Box::new(ProgressLines);
            bar.set_style(style("{pos}/{len}"));
            bar.set_draw_target(ProgressDrawTarget::term_like_with_hz(lines, LINES_A_SECOND));
        } else if !self.options.quiet && io::stderr().is_terminal() {
            bar.set_style(style(template));
            bar.set_message(escape::terminal(label).into_owned());
            bar.set_draw_target(ProgressDrawTarget::stderr());
            bar.enable_steady_tick(Duration::from_millis(200));
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
    fn talk(&self, word: &str, tint: Tint, text: &str) {
        let word = tint.paint(word, self.options.color.is_on(io::stderr().is_terminal()));
        let _ = writeln!(io::stderr().lock(), "{word}{}", escape::terminal(text));
    }
}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).expect("a template that parses")
}

/// How often progress is told as lines.
const LINES_A_SECOND: u8 = 5;

/// What a bar is drawn on where progress is told as lines, such as `progress: 3/25`.
#[derive(Debug)]
struct ProgressLines;

impl ProgressLines {
    fn say(text: &str) -> io::Result<()> {
        match text.trim() {
            "" => Ok(()),
            text => writeln!(io::stderr().lock(), "progress: {text}"),
        }
    }
}

impl TermLike for ProgressLines {
    fn width(&self) -> u16 {
        80
    }

    fn move_cursor_up(&self, _: usize) -> io::Result<()> {
        Ok(())
    }

    fn move_cursor_down(&self, _: usize) -> io::Result<()> {
        Ok(())
    }

    fn move_cursor_right(&self, _: usize) -> io::Result<()> {
        Ok(())
    }

    fn move_cursor_left(&self, _: usize) -> io::Result<()> {
        Ok(())
    }

    fn write_line(&self, text: &str) -> io::Result<()> {
        Self::say(text)
    }

    fn write_str(&self, text: &str) -> io::Result<()> {
        Self::say(text)
    }

    fn clear_line(&self) -> io::Result<()> {
        Ok(())
    }

    fn flush(&self) -> io::Result<()> {
        Ok(())
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
const HINTS: [fn(&(dyn Error + 'static)) -> Option<String>; 9] = [
    hint::<board_link::LinkError>,
    hint::<board_link::NotForBoard>,
    hint::<board_link::RecordError>,
    hint::<calibration::FitError>,
    hint::<calibration_file::CalibrationFileError>,
    hint::<calibration_file::MergeError>,
    hint::<log_file::LogError>,
    hint::<output_file::OutputError>,
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
