//! Arguments that are not looked into before their subcommand is called.

use clap::builder::Resettable;
use clap::{ArgMatches, Args, Command, Error, FromArgMatches};

/// The arguments of one subcommand among many: to set up those of all of them would take half of
/// the time that it takes to start.
///
/// What they are for is said where the subcommands are listed, as it is wanted there.
#[derive(Debug)]
pub(crate) struct Deferred<T>(pub(super) Box<T>);

impl<T: Args> Args for Deferred<T> {
    fn augment_args(command: Command) -> Command {
        command.defer(keep_about::<T>)
    }

    /// clap's updates in place are not used.
    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

/// Sets of arguments that are part of others would say what they are for, too. What is there before are the
/// options of every command, which go to the end of help.
fn keep_about<T: Args>(command: Command) -> Command {
    let about = Resettable::from(command.get_about().cloned());
    let long_about = Resettable::from(command.get_long_about().cloned());
    let shared: Vec<_> = command.get_arguments().map(|arg| arg.get_id().clone()).collect();
    let to_the_end = |command: Command, id: clap::Id| command.mut_arg(id, |arg| arg);
    let command = shared.into_iter().fold(T::augment_args(command), to_the_end);
    command.about(about).long_about(long_about)
}

impl<T: FromArgMatches> FromArgMatches for Deferred<T> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, Error> {
        T::from_arg_matches(matches).map(Box::new).map(Self)
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), Error> {
        self.0.update_from_arg_matches(matches)
    }
}
