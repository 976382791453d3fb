//! Files on the command line. The type of an argument states its role. Before a command runs, all paths are
//! collected by role, and no output may be an input or another output; no command has to check this itself.

use std::ffi::OsString;
use std::ops::Deref;
use std::path::{Path, PathBuf};

use anyhow::Context;
use calibration_file::input;
use clap::ArgMatches;
use frame_stream::Destination;
use output_file::{OutputError, Outputs};
use serde::{Serialize, Serializer};

/// A file to read, or `-` for the standard input if the command allows it.
#[derive(Clone, Debug)]
pub(crate) struct InputPath(PathBuf);

/// A file to write, or `-` for the standard output if the command allows it.
#[derive(Clone, Debug)]
pub(crate) struct OutputPath(PathBuf);

/// A directory to write files into, or a link to create.
#[derive(Clone, Debug)]
pub(crate) struct OutputLocation(PathBuf);

macro_rules! path {
    ($($name:ident),*) => {$(
        impl From<OsString> for $name {
            fn from(path: OsString) -> Self {
                Self(path.into())
            }
        }

        impl Deref for $name {
            type Target = PathBuf;

            fn deref(&self) -> &PathBuf {
                &self.0
            }
        }

        impl Serialize for $name {
            /// JSON cannot represent file names that are not Unicode: invalid parts become replacement characters.
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.serialize_str(&self.0.to_string_lossy())
            }
        }

        impl AsRef<Path> for $name {
            fn as_ref(&self) -> &Path {
                &self.0
            }
        }
    )*};
}

path!(InputPath, OutputPath, OutputLocation);

pub(crate) fn is_standard(path: &Path) -> bool {
    path.as_os_str() == "-"
}

pub(crate) fn create_folder(path: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(path).with_context(|| format!("cannot create `{}`", path.display()))
}

pub(crate) fn read_text(path: &Path) -> anyhow::Result<String> {
    input::read_text(path).with_context(|| format!("cannot read `{}`", path.display()))
}

pub(crate) fn innermost<'a>(
    mut command: &'a clap::Command,
    mut matches: &'a ArgMatches,
) -> (&'a clap::Command, &'a ArgMatches) {
    while let Some((name, of_subcommand)) = matches.subcommand() {
        let Some(subcommand) = command.find_subcommand(name) else { break };
        (command, matches) = (subcommand, of_subcommand);
    }
    (command, matches)
}

/// Registers all files of the command line in `outputs`. Fails with [`OutputError`] if an output is an input or
/// another output.
pub(crate) fn collect(mut matches: &ArgMatches, outputs: &Outputs) -> Result<(), OutputError> {
    loop {
        let mut inputs = values::<InputPath>(matches).filter(|path| !is_standard(path));
        inputs.try_for_each(|path| outputs.protect(path))?;
        let mut files = values::<OutputPath>(matches).filter(|path| !is_standard(path));
        files.try_for_each(|path| outputs.announce(path))?;
        for destination in values::<Destination>(matches) {
            if let Destination::File(path) = destination {
                outputs.announce(path)?;
            }
        }
        match matches.subcommand() {
            Some((_, subcommand)) => matches = subcommand,
            None => return Ok(()),
        }
    }
}

/// Message for a value that was meant for the option before it and was taken for a file, as in `--interval
/// 95`. These options need `=` before their value, since it is optional.
pub(crate) fn misplaced_value(
    command: &clap::Command,
    matches: &ArgMatches,
    arguments: &[OsString],
) -> Option<String> {
    let (command, matches) = innermost(command, matches);
    let takes_joined = |word: &str| {
        let mut options = command.get_arguments().filter(|option| option.is_require_equals_set());
        options
            .any(|option| word.strip_prefix("--").is_some_and(|it| option.get_long() == Some(it)))
    };
    values::<InputPath>(matches).find_map(|path| {
        let is_it = |pair: &[OsString]| {
            pair[1] == *path.as_os_str() && pair[0].to_str().is_some_and(takes_joined)
        };
        let option = arguments.windows(2).find(|pair| is_it(pair) && !path.exists())?;
        let (option, value) = (option[0].to_string_lossy(), path.display());
        Some(format!(
            "`{value}` is no file; if it is the value of `{option}`, join them: `{option}={value}`"
        ))
    })
}

fn values<T: Clone + Send + Sync + 'static>(matches: &ArgMatches) -> impl Iterator<Item = &T> {
    let of_argument = |id: &clap::Id| matches.try_get_many::<T>(id.as_str()).ok().flatten();
    matches.ids().filter_map(of_argument).flatten()
}

#[cfg(test)]
mod tests {
    use std::any::TypeId;

    use clap::{Command, CommandFactory};

    use crate::Args;

    /// A path without a role would not be collected.
    #[test]
    fn every_path_argument_has_a_declared_use() {
        fn look_at(command: &Command, found: &mut usize) {
            for argument in command.get_arguments() {
                let kind = argument.get_value_parser().type_id();
                let (name, of) = (argument.get_id(), command.get_name());
                assert!(kind != TypeId::of::<std::path::PathBuf>(), "`{name}` of `{of}`");
                *found += usize::from(kind == TypeId::of::<super::InputPath>());
            }
            command.get_subcommands().for_each(|command| look_at(command, found));
        }
        let mut command = Args::command();
        command.build();
        let mut found = 0;
        look_at(&command, &mut found);
        assert!(found > 20, "{found} inputs: are subcommands looked into?");
    }
}
