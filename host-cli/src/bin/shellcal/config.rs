//! Settings that belong to a set of data: `shellcal.toml` in the same directory, or the file of `--config`. Each key
//! is the long name of an option. It sets that option in every command that has it, unless the command line sets it.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

use anyhow::bail;
use clap::parser::ValueSource;
use clap::{Arg, ArgMatches, Command};
use shell_data::hint::quoted;
use toml::{Spanned, Value};

use crate::cmd::manifest_logs;
use crate::files::{InputPath, innermost, read_text};
use crate::printer::{GLOBAL, Printer};

const FILE: &str = "shellcal.toml";

/// The argument that names logs indirectly.
const MANIFEST: &str = "manifest";

/// Source of the settings.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct ConfigArgs {
    /// Take settings from this file, not from `shellcal.toml` beside the data
    #[arg(long, global = true, help_heading = GLOBAL, value_name = "FILE", conflicts_with = "no_config")]
    config: Option<InputPath>,

    /// Take no settings from a file
    #[arg(long, global = true, help_heading = GLOBAL)]
    no_config: bool,
}

/// Keys by the help heading of their options: an option with the same name may mean something else in another
/// command.
const KEYS: [(Option<&str>, &[&str]); 4] = [
    (
        Some("Reading logs"),
        &[
            "format",
            "table",
            "sensors",
            "wrench",
            "time",
            "time-unit",
            "group",
            "moment-unit",
            "unit",
            "header-line",
            "skip-lines",
        ],
    ),
    (Some("Taring"), &["tare", "tare-time", "no-tare"]),
    (Some("Filtering"), &["lowpass", "no-lowpass", "order", "causal", "rate"]),
    (None, &["profile", "reference"]),
];

/// Mutually exclusive options: if the command line has one, none of its group is taken from the file.
const ALTERNATIVES: [&[&str]; 2] = [&["tare", "tare-time", "no-tare"], &["lowpass", "no-lowpass"]];

/// A list to which the file adds what the command line does not say.
const MERGED: &str = "unit";

/// The settings of a file, by key: the line, and the option as it would be written on a command line.
type Settings = BTreeMap<String, (usize, OsString)>;

#[derive(Debug)]
pub(crate) struct Configured {
    pub(crate) matches: ArgMatches,
    pub(crate) file: Option<PathBuf>,
    lines: BTreeMap<&'static str, usize>,
}

/// Adds the settings of a file to the command line. Fails on a file that cannot be read, or an invalid key or value.
pub(crate) fn configure(
    mut arguments: Vec<OsString>,
    command: &mut Command,
    args: &ConfigArgs,
    matches: ArgMatches,
) -> anyhow::Result<Configured> {
    let path = match &args.config {
        _ if args.no_config => None,
        Some(path) => Some(path.to_path_buf()),
        None => beside_data(command, &matches)?,
    };
    let settings = path.as_deref().map(read).transpose()?.unwrap_or_default();
    let (of_command, given) = innermost(command, &matches);
    let mut lines = BTreeMap::new();
    // Insert before the end of options, if it is marked.
    let mut end = arguments.iter().position(|argument| argument == "--").unwrap_or(arguments.len());
    for (key, _) in options_of_keys(of_command) {
        let Some((line, argument)) = settings.get(key) else { continue };
        let is_given = |key: &&str| {
            option(of_command, key).is_some_and(|option| is_on_command_line(given, option))
        };
        if key == MERGED && is_given(&key) {
            // Units of the command line follow, and take precedence.
            let is_unit = |argument: &OsString| {
                argument.to_str().is_some_and(|it| it == "--unit" || it.starts_with("--unit="))
            };
            let first = arguments.iter().position(is_unit).unwrap_or(end);
            arguments.insert(first, argument.clone());
            end += 1;
            lines.insert(key, *line);
            continue;
        }
        let alternatives = ALTERNATIVES.iter().find(|all| all.contains(&key));
        if !alternatives.map_or(is_given(&key), |all| all.iter().any(is_given)) {
            arguments.insert(end, argument.clone());
            lines.insert(key, *line);
        }
    }
    let Some(path) = path.filter(|_| !lines.is_empty()) else {
        return Ok(Configured { matches, file: None, lines });
    };
    let matches = command.try_get_matches_from_mut(arguments).map_err(|error| {
        let said = error.to_string();
        let said = said.lines().next().unwrap_or_default();
        let said = said.strip_prefix("error: ").unwrap_or(said);
        anyhow::anyhow!("`{}`: {said}", path.display())
    })?;
    Ok(Configured { matches, file: Some(path), lines })
}

impl Configured {
    /// Prints the source of each setting, if that is wanted.
    pub(crate) fn explain(&self, command: &Command, printer: &Printer) {
        let (of_command, given) = innermost(command, &self.matches);
        for (key, option) in options_of_keys(of_command) {
            let values = given.get_raw(option.get_id().as_str()).into_iter().flatten();
            let values: Vec<_> = values.map(|value| value.to_string_lossy()).collect();
            let origin = match (&self.file, self.lines.get(key)) {
                (Some(path), Some(line)) => {
                    let and = if is_on_command_line(given, option) && key == MERGED {
                        " and the command line"
                    } else {
                        ""
                    };
                    format!("`{}`, line {line}{and}", path.display())
                }
                _ if is_on_command_line(given, option) => "the command line".to_owned(),
                _ if values.is_empty() => continue,
                _ => "the default".to_owned(),
            };
            printer.detail(format!("--{key} {}: from {origin}", values.join(",")));
        }
    }
}

fn options_of_keys(command: &Command) -> impl Iterator<Item = (&'static str, &Arg)> {
    let keys =
        KEYS.into_iter().flat_map(|(heading, keys)| keys.iter().map(move |key| (heading, *key)));
    keys.filter_map(|(heading, key)| {
        let is_same = |option: &&Arg| heading.is_none() || option.get_help_heading() == heading;
        Some((key, option(command, key).filter(is_same)?))
    })
}

fn option<'a>(command: &'a Command, long: &str) -> Option<&'a Arg> {
    command.get_arguments().find(|option| option.get_long() == Some(long))
}

fn is_on_command_line(matches: &ArgMatches, option: &Arg) -> bool {
    matches.value_source(option.get_id().as_str()) == Some(ValueSource::CommandLine)
}

fn beside_data(command: &Command, matches: &ArgMatches) -> anyhow::Result<Option<PathBuf>> {
    let (of_command, given) = innermost(command, matches);
    let beside = |path: &Path| {
        let beside = path.with_file_name(FILE);
        // Accept any entry with this name; one that is not a file is refused when it is read.
        beside.symlink_metadata().is_ok().then_some(beside)
    };
    let mut found: Vec<PathBuf> = Vec::new();
    for positional in of_command.get_positionals() {
        for path in given.get_raw(positional.get_id().as_str()).into_iter().flatten() {
            let path = Path::new(path);
            found.extend(beside(path));
            if positional.get_id() == MANIFEST {
                // A log whose folder has no settings takes the manifest's.
                let logs = manifest_logs(path);
                let of_logs: Vec<_> =
                    logs.iter().map(|log| beside(log).or_else(|| beside(path))).collect();
                let with = of_logs.iter().flatten().next();
                let without = logs.iter().zip(&of_logs).find(|(_, settings)| settings.is_none());
                if let (Some(with), Some((without, _))) = (with, without) {
                    bail!(
                        "there are settings in `{}`, but not beside `{}`: say which are meant with `--config`, or \
                         `--no-config`",
                        with.display(),
                        without.display()
                    );
                }
                found.extend(of_logs.into_iter().flatten());
            }
        }
    }
    let place = |path: &PathBuf| path.canonicalize().unwrap_or_else(|_| path.clone());
    let mut places = BTreeSet::new();
    found.retain(|path| places.insert(place(path)));
    match found.as_slice() {
        [first, second, ..] => bail!(
            "there are settings in `{}` and in `{}`: say which are meant with `--config`, or `--no-config`",
            first.display(),
            second.display()
        ),
        _ => Ok(found.pop()),
    }
}

fn read(path: &Path) -> anyhow::Result<Settings> {
    let text = read_text(path)?;
    let line_of = |at: usize| 1 + text.get(..at).unwrap_or_default().matches('\n').count();
    let wrong =
        |line: usize, what: String| anyhow::anyhow!("`{}`, line {line}: {what}", path.display());
    let values: BTreeMap<Spanned<String>, Value> = toml::from_str(&text).map_err(|error| {
        let line = line_of(error.span().map_or(0, |span| span.start));
        wrong(line, error.message().replace('\n', ", "))
    })?;
    let mut settings = Settings::new();
    for (key, value) in values {
        let line = line_of(key.span().start);
        let key = key.into_inner();
        let known = KEYS.iter().flat_map(|(_, keys)| *keys);
        if !known.clone().any(|known| *known == key) {
            let distance = |known: &&&str| strsim::damerau_levenshtein(known, &key);
            let nearest = known.clone().min_by_key(distance);
            let hint = match nearest.filter(|nearest| 3 * distance(nearest) <= key.chars().count())
            {
                Some(nearest) => format!("the nearest is `{nearest}`"),
                None => format!("expected one of {}", quoted(known, ", ")),
            };
            return Err(wrong(line, format!("unknown key `{key}`; {hint}")));
        }
        let mut argument = OsString::from(format!("--{key}"));
        match value {
            Value::Boolean(false) => continue,
            Value::Boolean(true) => {}
            value => {
                let plain = plain(&value).ok_or_else(|| {
                    wrong(line, format!("`{key}` is neither a text, a number nor a list of them"))
                })?;
                argument.push("=");
                // The path of a profile is relative to the settings file.
                argument.push(match key == "profile" {
                    true => path.with_file_name("").join(plain).into_os_string(),
                    false => plain.into(),
                });
            }
        }
        settings.insert(key, (line, argument));
    }
    Ok(settings)
}

fn plain(value: &Value) -> Option<String> {
    match value {
        Value::String(text) => Some(text.clone()),
        Value::Integer(number) => Some(number.to_string()),
        Value::Float(number) => Some(number.to_string()),
        Value::Array(values) => {
            let values: Option<Vec<String>> = values.iter().map(plain).collect();
            values.map(|values| values.join(","))
        }
        _ => None,
    }
}
