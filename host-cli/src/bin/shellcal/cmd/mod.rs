//! The subcommands: each is a set of arguments with a `run`, those of one subject in one file.

mod align;
mod board;
mod check;
mod choices;
mod compare;
mod convert;
mod doctor;
mod eval;
mod exchange;
mod fit;
mod frames;
mod info;
#[cfg(feature = "live")]
mod live;
mod mapping;
mod merge;
mod outputs;
mod payload;
mod plan;
mod ports;
mod quality;
mod record;
mod simulate;
mod simulate_board;
mod stream;
mod synth;
mod synth_trial;
mod trials;

use clap::builder::Resettable;
use clap::{ArgMatches, Args, Error, FromArgMatches, Subcommand};

use crate::printer::{Outcome, Printer};

/// Defines the subcommands by what help says of them and their arguments, which have a `run`; `if` is followed by the
/// feature that a command needs.
macro_rules! commands {
    ($(
        $(#[$about:meta])*
        $name:ident($args:ty) $(if $feature:literal)?,
    )+) => {
        #[derive(Debug, Subcommand)]
        pub(crate) enum Command {$(
            $(#[$about])*
            $(#[cfg(feature = $feature)])?
            $name(Deferred<$args>),
        )+}

        impl Command {
            /// Runs it.
            pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<Outcome> {
                match self {$(
                    $(#[cfg(feature = $feature)])?
                    Self::$name(args) => args.0.run(printer).map(Outcome::from),
                )+}
            }
        }
    };
}

commands! {
    /// Ask a board what it is and how it does, and set it up; list the ports; or be a board
    ///
    /// Without a port the serial ports of this computer are listed. With `--simulate` the program is a board itself, on a port of its own that it prints: the
    /// firmware's library over the sensor model, for who has no board.
    Board(board::BoardArgs),

    /// Record what a board sends as CSV, until Ctrl-C or for `--duration`
    ///
    /// Columns: t_s (the board's clock), s1 to s8 in steps of the 12-bit converter or, if the board
    /// streams wrenches, fx_n to mz_nm; index (sequence number), missing (frames lost before the row),
    /// dropped (the board's own count, modulo 256), temperature_c, how the board is about once a second
    /// (supply_v, and vrefint and dark1 to dark8 in steps), after an edge at the sync input its number and
    /// time (sync, sync_s), and flags (s3:saturated, s3:range, late, restart, skewed, untared). The channels
    /// of a row are brought to one time, unless `--as-sampled`.
    /// The file grows by whole lines twice a second and keeps what has arrived whatever happens.
    Record(record::RecordArgs),

    /// Show forces and readings as they come, in the terminal or in a browser
    ///
    /// Traces of the six axes with scale and noise, the eight channels in their calibrated range, the
    /// force as an arrow from above and from the side, rate and losses. What is recorded does not wait
    /// for what is shown.
    Live(live::LiveArgs) if "live",

    /// Pass frames on to other programs as they arrive: JSON lines or CSV, over a pipe, UDP or TCP
    ///
    /// Each row has t_s (the board's clock), index (sequence number), host_s (when it arrived), the readings s1 to s8,
    /// with a calibration the forces fx_n to mz_nm and their standard errors fx_se_n to mz_se_nm, flags, row (number of
    /// the row), and lost (rows that this reader was too slow for). A slow reader loses rows and delays no other.
    /// Lines on the standard input are commands: tare, untare, mark, rate HZ, rate all.
    Stream(stream::StreamArgs),

    /// Say what is wrong with a port and its board, a log or a calibration, and what to do about it
    ///
    /// Each thing that is looked at is named with what was seen. The exit code is 1 where there is a
    /// fault, which makes results wrong or impossible; warnings alone leave it at 0. A board is only
    /// asked: nothing that it holds is changed, and a stream that stood still is stopped again. Without
    /// a name the ports of this computer are looked at.
    Doctor(doctor::DoctorArgs),

    /// Say what a log is: format, columns, rows, timing, repeats, saturated or constant channels; how a sensor at
    /// rest behaves
    ///
    /// With `--noise` or `--drift` the log is one of an unloaded sensor: its scatter, or how its zero moves. `--plot`
    /// draws the zeros of the stretches at rest over time.
    Info(info::InfoArgs),

    /// Line up a reference sensor's recording with a board log from another clock
    ///
    /// Finds the offset of the two clocks, whatever it is, and how much faster one runs, from the loads
    /// that both saw; no map from wrench to readings is needed. Writes a training log: the board's
    /// frames with the reference at the same times, low-passed below the board's Nyquist frequency.
    /// Where the match is not clear, nothing is written and the exit code is 1. `--plot` draws the match.
    Align(align::AlignArgs),

    /// Say which loads to hang next, in which order, and when that is enough
    ///
    /// Of all loads that the rig can do, the one that tells most comes next: by a D-optimal design before anything is
    /// recorded, and by what a model of the sensors does not know yet afterwards. A calibration then takes about half
    /// the poses of a random order. `--plot` draws the predicted error against the number of poses.
    Plan(plan::PlanArgs),

    /// Fit a calibration to logs with readings and a measured wrench
    ///
    /// Compares models on groups of rows that are held out (a group column, files, poses that are found, or
    /// stretches of time) and takes the best. The output starts with a verdict: the error on data that were not
    /// used for the fit, the 95 % interval of a frame, what to use the calibration for, what to record next.
    /// `--plot` draws predicted against measured, and the residuals.
    /// Exits with 1 when that error is above `--max-rms`.
    Fit(fit::FitArgs),

    /// Merge partial fits to a calibration
    ///
    /// Partial fits are written by `shellcal fit --partial`, on as many machines as there are files.
    /// Sums are exact: the result is the one fit over all their rows, bit for bit, in any order.
    Merge(merge::MergeArgs),

    /// Compare a calibration with the wrench measured in logs
    ///
    /// Exits with 1 when the RMS error of an axis over all logs is above its limit. `--plot` draws predicted against
    /// measured, and the residuals, over all logs.
    Eval(eval::EvalArgs),

    /// Check a calibrated sensor with a known weight or two
    ///
    /// Compares the weights of a table with what the sensor says, axis by axis, and allows for the calibration's 95 %
    /// intervals and the errors of the weights. Exits with 1 when a difference is more than these explain.
    Check(check::CheckArgs),

    /// Compare two calibrations on the same test logs
    ///
    /// Prints the errors of both, their paired difference with a 95 % interval over groups of rows (the group column,
    /// files, poses that are found), and which errs less on each axis.
    Compare(compare::CompareArgs),

    /// Convert logs of readings to forces and moments
    ///
    /// Writes one row per frame: time, wrench, the standard error of each axis where the calibration
    /// carries a covariance, and flags for readings that cannot be trusted. `--plot` draws the wrench over time.
    Convert(convert::ConvertArgs),

    /// Find what a sensor carries, and take its weight and inertia off a wrench
    Payload(payload::PayloadArgs),

    /// Evaluate one trial: drag, lift, energies and specific resistance, and those of its strides
    ///
    /// Without `--enter` and `--exit` the window is looked for in the drag; with `--find-window` it is proposed and
    /// nothing else is done, and `--plot` draws the drag of one log and what was found in it. A manifest can say
    /// `auto` in place of times, and gets the same.
    Trial(trials::trial::TrialArgs),

    /// Evaluate all trials of a manifest: per trial, per stride, and by condition
    ///
    /// One bad trial does not hold up the others: it is named and left out, and the exit code is 1.
    Batch(trials::batch::BatchArgs),

    /// Draw one figure of a trial or of a manifest's trials, as SVG, PDF or PNG
    Plot(trials::plot::PlotArgs),

    /// Report on all trials of a manifest: tables and figures to zoom into, in one HTML file
    ///
    /// The file needs no network. It has what it takes to make it again: settings, command line, and the
    /// checksum of everything that went in.
    Report(trials::report::ReportArgs),

    /// Statistics of a table of values by condition: mean, interval, quartiles, whiskers, differences
    ///
    /// One table for each column of numbers. Quartiles are those of NumPy and matplotlib (type 7),
    /// whiskers Tukey's, intervals BCa bootstrap intervals of the mean.
    Stats(trials::stats::StatsArgs),

    /// Make a calibration from a coefficient matrix for raw readings
    ///
    /// CSV with a header `feature,Fx_N,…,Mz_mNm` and rows `s1^1,…`; bare numbers, features by axes or
    /// axes by features (8 channels; linear, cubic, quadratic or poly3, one feature more with an
    /// intercept); a MATLAB 5 file with such a matrix; or the calibration of an ATI sensor, `.cal`, for
    /// volts of its gauges.
    Import(exchange::ImportArgs),

    /// Write a calibration as a function in Python or MATLAB, or as a matrix
    Export(exchange::ExportArgs),

    /// Make a synthetic recording from a physical model of the sensor
    ///
    /// A rigid plate on springs, eight reflectors, the response of the GP2S60, noise, drift, creep and
    /// hysteresis, a reference sensor. The same command makes the same bytes on every machine.
    Synth(synth::SynthArgs),

    /// Simulate the body's drag in a channel of springy beams
    ///
    /// The paper's quasi-static model: an ellipse pushes through two rows of beams, each a bar on a
    /// torsional spring. Prints, for every channel, the drag where the body is wholly among the beams,
    /// and the energy of a crossing. Lengths take mm, cm or m, and are in m without a unit; positions
    /// are those of the body's middle past the first beam. `--plot` draws drag over position and contact counts.
    Simulate(simulate::SimulateArgs),
}

/// Commands of earlier releases, and where what they did has gone.
pub(crate) const MOVED: [(&str, &str); 9] = [
    ("bench", "`cargo bench -p shellcal --bench solvers` measures solvers"),
    (
        "completions",
        "a release has the scripts of the shells; `cargo xtask manual DIR` writes them",
    ),
    ("drift", "use `shellcal info LOG --drift`"),
    ("licences", "a release lists the packages in THIRD-PARTY.txt"),
    ("man", "a release has the pages; `cargo xtask manual DIR` writes them"),
    ("noise", "use `shellcal info LOG --noise --calibration CAL`"),
    ("ports", "use `shellcal board`, without a port"),
    ("profile", "use `shellcal info --robot`"),
    ("window", "use `shellcal trial LOG --find-window`"),
];

/// The arguments of one subcommand among many: to set up those of all of them would take half of
/// the time that it takes to start.
///
/// What they are for is said where the subcommands are listed, as it is wanted there.
#[derive(Debug)]
pub(crate) struct Deferred<T>(Box<T>);

impl<T: Args> Args for Deferred<T> {
    fn augment_args(command: clap::Command) -> clap::Command {
        command.defer(keep_about::<T>)
    }

    /// clap's updates in place are not used.
    fn augment_args_for_update(command: clap::Command) -> clap::Command {
        Self::augment_args(command)
    }
}

/// Sets of arguments that are part of others would say what they are for, too. What is there before are the
/// options of every command, which go to the end of help.
fn keep_about<T: Args>(command: clap::Command) -> clap::Command {
    let about = Resettable::from(command.get_about().cloned());
    let long_about = Resettable::from(command.get_long_about().cloned());
    let shared: Vec<_> = command.get_arguments().map(|arg| arg.get_id().clone()).collect();
    let to_the_end = |command: clap::Command, id: clap::Id| command.mut_arg(id, |arg| arg);
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
