//! `shellcal`: from the recordings of an optical force/torque shell to forces and moments.

#[macro_use]
mod document;

mod cmd;
mod config;
mod files;
#[cfg(test)]
mod manual;
mod printer;
mod signals;
mod tables;

use std::borrow::Cow;
use std::ffi::OsString;
use std::io::{self, Write};
use std::process::ExitCode;

use clap::error::{ContextKind, ContextValue};
use clap::{ArgMatches, ColorChoice, CommandFactory, FromArgMatches, Parser};
use shell_data::{escape, instructions};

/// From the recordings of an optical 6-axis force/torque shell to forces and moments.
///
/// Exit codes: 0 done, 1 ran but a check failed, 2 could not run.
#[derive(Debug, Parser)]
#[command(name = "shellcal", version, max_term_width = 100)]
struct Args {
    #[command(flatten)]
    output: printer::OutputArgs,

    #[command(flatten)]
    config: config::ConfigArgs,

    #[command(subcommand)]
    command: cmd::Command,
}

/// Colour choice for help and for errors of the command line, which are printed while it is still being parsed.
fn color_of(arguments: impl Iterator<Item = OsString>) -> ColorChoice {
    let arguments: Vec<OsString> = arguments.take_while(|argument| argument != "--").collect();
    let value = |at: usize| match arguments[at].to_str()?.strip_prefix("--color")? {
        "" => arguments.get(at + 1)?.to_str(),
        joined => joined.strip_prefix('='),
    };
    match (0..arguments.len()).find_map(value) {
        Some("always") => ColorChoice::Always,
        Some("never") => ColorChoice::Never,
        _ => ColorChoice::Auto,
    }
}

const GREETING: &str = "\
From recordings of an optical force/torque shell to forces and moments:

  shellcal info LOG                           what a log holds
  shellcal fit TRAIN --test TEST -o CAL       fit a calibration
  shellcal convert CAL LOG -o OUT             readings to forces and moments
  shellcal batch MANIFEST --calibration CAL   drag, lift and energies of trials
  shellcal record PORT -o LOG                 record from a board

`shellcal help` lists all commands, `shellcal help COMMAND` has examples.";

fn main() -> ExitCode {
    if std::env::args_os().len() < 2 {
        let _ = writeln!(io::stderr(), "{}", GREETING);
        return ExitCode::from(2);
    }
    let mut command = Args::command().color(color_of(std::env::args_os()));
    let matches = command.try_get_matches_from_mut(std::env::args_os());
    let matches = matches.unwrap_or_else(|error| refuse(&error));
    let said = parsed(&mut command, &matches);
    output_file::before_unfinished(signals::listen);
    let printer = printer::Printer::new(said.output);
    let outcome = run(&mut command, &said.config, matches, &printer);
    match outcome.and_then(|outcome| printer.printed().map(|()| outcome)) {
        Ok(outcome) => ExitCode::from(outcome as u8),
        Err(error) if printer::is_closed_pipe(&error) => ExitCode::from(printer.decided() as u8),
        Err(error) => {
            printer.error(&error);
            ExitCode::from(2)
        }
    }
}

/// Builds the arguments from the matches; ends the program if they are invalid.
fn parsed(command: &mut clap::Command, matches: &ArgMatches) -> Args {
    Args::from_arg_matches(matches).unwrap_or_else(|error| refuse(&error.format(command)))
}

/// Prints help, or the error in the command line, and ends the program. Arguments may contain any bytes.
fn refuse(error: &clap::Error) -> ! {
    if let Some(ContextValue::String(name)) = error.get(ContextKind::InvalidSubcommand)
        && let Some((name, instead)) = cmd::MOVED.iter().find(|(old, _)| old == name)
    {
        let _ =
            writeln!(io::stderr(), "error: there is no command `{name}` any more\nhint: {instead}");
        std::process::exit(2);
    }
    let steers =
        |word: OsString| matches!(escape::terminal(&word.to_string_lossy()), Cow::Owned(_));
    if error.use_stderr() && std::env::args_os().any(steers) {
        // Without colours, which are escape sequences, too.
        let text = error.render().to_string();
        let lines: Vec<_> = text.lines().map(escape::terminal).collect();
        let _ = writeln!(io::stderr(), "{}", lines.join("\n"));
        std::process::exit(error.exit_code());
    }
    match error.print().and_then(|()| io::stdout().flush()) {
        Err(failure) if failure.kind() != io::ErrorKind::BrokenPipe => {
            let _ = writeln!(io::stderr(), "error: cannot write standard output: {failure}");
            std::process::exit(2);
        }
        _ => std::process::exit(error.exit_code()),
    }
}

fn run(
    command: &mut clap::Command,
    config: &config::ConfigArgs,
    matches: ArgMatches,
    printer: &printer::Printer,
) -> anyhow::Result<printer::Outcome> {
    instructions::chosen().map_err(anyhow::Error::msg)?;
    let words: Vec<_> = std::env::args_os().collect();
    let configured = config::configure(words.clone(), command, config, matches)?;
    let args = parsed(command, &configured.matches);
    if let Some(why) = files::misplaced_value(command, &configured.matches, &words) {
        anyhow::bail!(why);
    }
    files::collect(&configured.matches, &printer.files)?;
    if let Some(file) = &configured.file {
        printer.files.protect(file)?;
    }
    configured.explain(command, printer);
    args.command.run(printer)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use clap::CommandFactory;

    #[test]
    fn the_colour_is_known_before_the_command_line_is_read() {
        let of = |line: &str| super::color_of(line.split(' ').map(Into::into));
        assert_eq!(of("shellcal fit --color never --help"), clap::ColorChoice::Never);
        assert_eq!(of("shellcal --color=always"), clap::ColorChoice::Always);
        assert_eq!(of("shellcal fit -- --color never"), clap::ColorChoice::Auto);
        assert_eq!(of("shellcal fit --color"), clap::ColorChoice::Auto);
    }

    #[test]
    fn the_command_line_is_consistent() {
        super::Args::command().debug_assert();
    }

    /// Wider lines wrap on a terminal. `cargo xtask check words` reads the same texts for phrases to avoid.
    #[test]
    fn lines_of_help_have_at_most_100_characters() {
        fn check(command: &mut clap::Command) {
            for text in [command.render_help(), command.render_long_help()] {
                let text = text.to_string();
                let longest = text.lines().max_by_key(|line| line.chars().count()).unwrap_or("");
                assert!(longest.chars().count() <= 100, "{}: {longest}", command.get_name());
            }
            command.get_subcommands_mut().for_each(check);
        }
        let mut command = super::Args::command().term_width(100);
        command.build();
        check(&mut command);
    }

    /// A new command or option has to be worth removing another. Options shared by commands are declared
    /// once, with one text, and count once.
    #[test]
    fn commands_and_options_are_few() {
        fn options(command: &clap::Command, found: &mut BTreeSet<(String, String)>) {
            for argument in command.get_arguments().filter(|argument| !argument.is_hide_set()) {
                let Some(name) = argument.get_long() else { continue };
                if !["help", "version"].contains(&name) {
                    let help = argument.get_help().map(ToString::to_string).unwrap_or_default();
                    found.insert((name.to_owned(), help));
                }
            }
            command.get_subcommands().for_each(|command| options(command, found));
        }
        let mut command = super::Args::command();
        command.build();
        let commands = command.get_subcommands().filter(|command| command.get_name() != "help");
        let (commands, mut found) = (commands.count(), BTreeSet::new());
        options(&command, &mut found);
        println!("{commands} commands, {} options", found.len());
        assert!(commands <= 24, "{commands} commands");
        assert!(found.len() <= 214, "{} options: {found:#?}", found.len());
    }
}
