//! The only place that writes to the terminal: results to stdout, talk to stderr.

use std::borrow::Cow;
use std::io::{self, IsTerminal, Write};
use std::time::Duration;

use comfy_table::{CellAlignment, ContentArrangement, LineStyle, Table, TableStyle};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::Serialize;

/// Tables as papers set them: a rule below the header and no other lines.
const TABLE: TableStyle =
    TableStyle::new().header_separator(LineStyle::none().fill('─').junction('─'));

/// How much is said, and in which form.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(crate) struct OutputArgs {
    /// Print one JSON document instead of tables
    #[arg(long, global = true)]
    json: bool,

    /// Print nothing but results and errors: no progress, no notes
    #[arg(long, short, global = true)]
    quiet: bool,

    /// Say more about how the work is done
    #[arg(long, global = true, conflicts_with = "quiet")]
    verbose: bool,
}

/// Where a command's results and remarks go.
#[derive(Debug)]
pub(crate) struct Printer {
    options: OutputArgs,
}

impl Printer {
    pub(crate) fn new(options: OutputArgs) -> Self {
        Self { options }
    }

    /// Whether the user asked for one JSON document in place of tables.
    pub(crate) fn json(&self) -> bool {
        self.options.json
    }

    /// Prints the result of a command as one JSON document, every figure at full precision.
    pub(crate) fn document(&mut self, value: &impl Serialize) -> anyhow::Result<()> {
        // At one go: stdout would pass it on line by line.
        let mut text = serde_json::to_vec_pretty(value).map_err(io::Error::from)?;
        text.push(b'\n');
        io::stdout().lock().write_all(&text)?;
        Ok(())
    }

    /// Where a result goes that is a stream of bytes.
    pub(crate) fn stream(&self) -> impl Write + use<> {
        io::stdout().lock()
    }

    /// Prints one line of a result that people read.
    pub(crate) fn line(&mut self, text: impl AsRef<str>) -> anyhow::Result<()> {
        writeln!(io::stdout().lock(), "{}", harmless(text.as_ref()))?;
        Ok(())
    }

    /// Prints a table: the first column is a label, the others are numbers.
    pub(crate) fn table(&mut self, header: &[&str], rows: &[Vec<String>]) -> anyhow::Result<()> {
        let mut table = Table::new();
        table.load_style(TABLE);
        table.set_content_arrangement(ContentArrangement::Disabled);
        table.set_header(header.iter().copied());
        table.add_rows(rows);
        for column in table.column_iter_mut().skip(1) {
            column.set_cell_alignment(CellAlignment::Right);
        }
        for line in table.lines() {
            self.line(line.trim_end())?;
        }
        Ok(())
    }

    /// Writes a note about the work to stderr, but not with `--quiet`.
    pub(crate) fn note(&mut self, text: impl AsRef<str>) {
        if !self.options.quiet {
            self.talk(text.as_ref());
        }
    }

    /// Writes a note about how the work is done to stderr, with `--verbose` only.
    pub(crate) fn detail(&mut self, text: impl AsRef<str>) {
        if self.options.verbose {
            self.talk(text.as_ref());
        }
    }

    /// Warns on stderr, even when quiet: the user must not miss it.
    pub(crate) fn warning(&mut self, text: impl AsRef<str>) {
        self.talk(&format!("warning: {}", text.as_ref()));
    }

    /// Reports what could not be done among other things that could.
    pub(crate) fn failure(&mut self, text: impl AsRef<str>) {
        self.talk(&format!("error: {}", text.as_ref()));
    }

    /// Reports why the command could not run.
    pub(crate) fn error(&mut self, error: &anyhow::Error, hint: Option<&str>) {
        self.talk(&format!("error: {error:#}"));
        if let Some(hint) = hint {
            self.talk(&format!("hint: {hint}"));
        }
    }

    /// A progress bar over `bytes` on stderr; draws nothing when quiet or not on a terminal.
    pub(crate) fn progress(&self, label: &str, bytes: u64) -> ProgressBar {
        self.bar(label, bytes, "{msg} {wide_bar} {bytes}/{total_bytes} {eta}")
    }

    /// The same over things that are counted.
    pub(crate) fn count(&self, label: &str, total: u64) -> ProgressBar {
        self.bar(label, total, "{msg} {wide_bar} {human_pos}/{human_len} {eta}")
    }

    fn bar(&self, label: &str, total: u64, style: &str) -> ProgressBar {
        let bar = ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::hidden());
        if !self.options.quiet && io::stderr().is_terminal() {
            bar.set_style(ProgressStyle::with_template(style).expect("a template that parses"));
            bar.set_message(label.to_owned());
            bar.set_draw_target(ProgressDrawTarget::stderr());
            bar.enable_steady_tick(Duration::from_millis(200));
        }
        bar
    }

    /// A progress bar over `count` things on stderr, likewise.
    pub(crate) fn progress_of(&self, things: &str, count: u64) -> ProgressBar {
        let bar = self.progress(things, count);
        let style = "{wide_bar} {pos}/{len} {msg} {eta}";
        bar.set_style(ProgressStyle::with_template(style).expect("a template that parses"));
        bar
    }

    /// A line on stderr that says how it goes; draws nothing when quiet or not on a terminal.
    pub(crate) fn status(&self) -> ProgressBar {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::hidden());
        if !self.options.quiet && io::stderr().is_terminal() {
            bar.set_style(
                ProgressStyle::with_template("{wide_msg}").expect("a template that parses"),
            );
            bar.set_draw_target(ProgressDrawTarget::stderr());
        }
        bar
    }

    /// A closed stderr leaves nobody to tell.
    fn talk(&self, text: &str) {
        let _ = writeln!(io::stderr().lock(), "{}", harmless(text));
    }
}

/// A text whose control characters do nothing to a terminal: names of files and columns may hold any.
fn harmless(text: &str) -> Cow<'_, str> {
    let is_harmful = |c: char| c.is_control() && !matches!(c, '\n' | '\t');
    if !text.contains(is_harmful) {
        return Cow::Borrowed(text);
    }
    let escaped = text.chars().map(|c| match is_harmful(c) {
        true => c.escape_default().to_string(),
        false => c.to_string(),
    });
    Cow::Owned(escaped.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_shown_and_do_nothing() {
        assert_eq!(harmless("a\tµ\n"), "a\tµ\n");
        assert_eq!(harmless("\u{1b}[2J\u{9b}1m\r"), "\\u{1b}[2J\\u{9b}1m\\r");
    }
}
