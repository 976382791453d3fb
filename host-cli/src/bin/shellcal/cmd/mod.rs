//! The subcommands: each is a set of arguments with a `run`; related ones share a file.

mod align;
mod board;
#[cfg(feature = "live")]
mod calibrate;
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
mod simulated_unit;
mod stream;
mod synth;
mod synth_trial;
mod trials;
pub(crate) use trials::evaluation::manifest_logs;

use clap::builder::Resettable;
use clap::{ArgMatches, Args, Error, FromArgMatches, Subcommand};

use crate::printer::{Outcome, Printer};

/// Defines the subcommands by their help texts and their arguments, which have a `run`; `if` is followed by
/// the feature that a command needs.
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
            /// Runs the command.
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
    /// Identify and set up a board, list the ports, or simulate a board
    ///
    /// Without a port, the serial ports of this computer are listed. With `--simulate` the program is a board
    /// itself, on a new port whose name it prints: the firmware's library with the sensor model, for users
    /// without a board.
    Board(board::BoardArgs),

    /// Record what a board sends as CSV, until Ctrl-C or for `--duration`
    ///
    /// Columns: t_s (the board's clock), s1 to s8 in steps of the 12-bit converter or, if the board streams
    /// wrenches, fx_n to mz_nm; index (sequence number), missing (frames lost before the row), dropped (the
    /// board's own count, modulo 256), temperature_c, the board's state about once a second (supply_v, and
    /// vrefint and dark1 to dark8 in steps), after an edge at the sync input its number and time (sync,
    /// sync_s), and flags (s3:saturated, s3:range, late, restart, skewed, untared). The channels of a row are
    /// interpolated to one time, unless `--as-sampled`. The file grows by whole lines twice a second, and
    /// data written so far survive any failure.
    Record(record::RecordArgs),

    /// Show forces and readings as they come, in the terminal or in a browser
    ///
    /// Shows traces of the six axes with scale and noise, the eight channels in their calibrated range, the
    /// force as an arrow from above and from the side, rate and losses. Recording does not wait for the
    /// display.
    Live(live::LiveArgs) if "live",

    /// Calibrate a sensor in one sitting: load by load, with the error on new poses after each
    ///
    /// Examines the board, asks for the most informative of the loads that the rig can do, records it once it
    /// is held still for 2 s, and refits the model. Names a load that contradicts the others, a channel that
    /// does not answer, and a reference that moved. Ends with the loads when the error is small enough, asks
    /// for a check weight, and writes calibration, report and certificate. The exit code is 1 if there are
    /// too few loads, or the check is off.
    Calibrate(calibrate::CalibrateArgs) if "live",

    /// Pass frames on to other programs as they arrive: JSON lines or CSV, over a pipe, UDP or TCP
    ///
    /// Each row has t_s (the board's clock), index (sequence number), host_s (time of arrival), the readings
    /// s1 to s8, with a calibration the forces fx_n to mz_nm and their standard errors fx_se_n to mz_se_nm,
    /// flags, row (number of the row), and lost (rows that this reader was too slow for). A slow reader loses
    /// rows and does not delay others. Lines on the standard input are commands: tare, untare, mark, rate HZ,
    /// rate all.
    Stream(stream::StreamArgs),

    /// Find faults of a port and its board, a log or a calibration, and suggest remedies
    ///
    /// Prints each finding with the observation behind it. The exit code is 1 if there is a fault, which
    /// makes results wrong or impossible; warnings alone leave it at 0. A board is only queried: its settings
    /// are not changed, and a stream that was stopped is stopped again. Without a name, the ports of this
    /// computer are examined.
    Doctor(doctor::DoctorArgs),

    /// Describe a log: format, columns, rows, timing, repeats, saturated or constant channels; or a sensor at
    /// rest
    ///
    /// With `--noise` or `--drift`, the log has to be of an unloaded sensor: reports its scatter, or the
    /// drift of its zero. `--plot` draws the zeros of the stationary intervals over time.
    Info(info::InfoArgs),

    /// Align a reference sensor's recording with a board log from another clock
    ///
    /// Finds the offset of the two clocks, of any size, and their relative rate from the loads that both
    /// recorded; no map from wrench to readings is needed. Writes a training log: the board's frames with the
    /// reference at the same times, low-passed below the board's Nyquist frequency. If the match is not
    /// clear, nothing is written and the exit code is 1. `--plot` draws the match.
    Align(align::AlignArgs),

    /// Plan which loads to hang next, in which order, and when to stop
    ///
    /// Picks the most informative of all loads that the rig can do: by a D-optimal design before anything is
    /// recorded, and afterwards by the remaining uncertainty of a model of the sensors. A calibration then
    /// takes about half the poses of a random order. `--plot` draws the predicted error against the number of
    /// poses.
    Plan(plan::PlanArgs),

    /// Fit a calibration to logs with readings and a measured wrench
    ///
    /// Compares models by cross-validation over groups of rows (a group column, files, poses that are found,
    /// or blocks of time) and takes the best. The output starts with a verdict: the error on data that
    /// were not used for the fit, the 95 % interval of a frame, what to use the calibration for, and what to
    /// record next. `--plot` draws predicted against measured, and the residuals. The exit code is 1 if that
    /// error is above `--max-rms`.
    Fit(fit::FitArgs),

    /// Merge partial fits to a calibration
    ///
    /// Partial fits are written by `shellcal fit --partial`, on as many machines as there are files. Sums are
    /// exact: the result equals the one fit over all their rows, bit for bit, in any order.
    Merge(merge::MergeArgs),

    /// Compare a calibration with the wrench measured in logs, or with another calibration
    ///
    /// The exit code is 1 if the RMS error of an axis over all logs is above its limit. `--plot` draws
    /// predicted against measured, and the residuals, over all logs.
    Eval(eval::EvalArgs),

    /// Check a calibrated sensor with a known weight or two
    ///
    /// Compares the weights of a table with the sensor's forces, axis by axis, and allows for the
    /// calibration's 95 % intervals and the errors of the weights. The exit code is 1 if a difference is
    /// larger than these explain.
    Check(check::CheckArgs),

    /// Convert logs of readings to forces and moments
    ///
    /// Writes one row per frame: time, wrench, the standard error of each axis if the calibration has a
    /// covariance, and flags for readings that cannot be trusted. `--plot` draws the wrench over time.
    Convert(convert::ConvertArgs),

    /// Find the payload of a sensor, and subtract its weight and inertia from a wrench
    Payload(payload::PayloadArgs),

    /// Evaluate one trial: drag, lift, energies and specific resistance, in total and per stride
    ///
    /// Without `--enter` and `--exit` the window is found in the drag. `--find-window` only proposes it, and
    /// `--plot` then draws the drag of one log with the proposed window. A manifest can have `auto` instead
    /// of times for the same search.
    Trial(trials::trial::TrialArgs),

    /// Evaluate all trials of a manifest: per trial, per stride, and by condition
    ///
    /// A bad trial does not stop the others: it is named and left out, and the exit code is 1.
    Batch(trials::batch::BatchArgs),

    /// Draw one figure of a trial or of a manifest's trials, as SVG, PDF or PNG
    Plot(trials::plot::PlotArgs),

    /// Report on all trials of a manifest: tables and zoomable figures, in one HTML file
    ///
    /// The file needs no network. It contains everything needed to reproduce it: settings, command line, and
    /// the checksums of all inputs.
    Report(trials::report::ReportArgs),

    /// Compute statistics of a table of values by condition: mean, interval, quartiles, whiskers, differences
    ///
    /// One table for each column of numbers. Quartiles as in NumPy and matplotlib (type 7), Tukey's whiskers,
    /// and BCa bootstrap intervals of the mean.
    Stats(trials::stats::StatsArgs),

    /// Make a calibration from a coefficient matrix for raw readings
    ///
    /// CSV with a header `feature,Fx_N,…,Mz_mNm` and rows `s1^1,…`; bare numbers, features by axes or axes by
    /// features (8 channels; linear, cubic, quadratic or poly3, one feature more with an intercept); a MATLAB
    /// 5 file with such a matrix; or the calibration of an ATI sensor, `.cal`, for its gauge voltages.
    Import(exchange::ImportArgs),

    /// Write a calibration as a function in Python or MATLAB, or as a matrix
    Export(exchange::ExportArgs),

    /// Make a synthetic recording from a physical model of the sensor
    ///
    /// A rigid plate on springs, eight reflectors, the response of the GP2S60, noise, drift, creep and
    /// hysteresis, a reference sensor. Output is identical, byte for byte, on every machine.
    Synth(synth::SynthArgs),

    /// Simulate the body's drag in a channel of springy beams
    ///
    /// The paper's quasi-static model: an ellipse pushes through two rows of beams, each a bar on a torsional
    /// spring. Prints, for every channel, the drag while the body is wholly among the beams, and the energy
    /// of a crossing. Lengths take mm, cm or m, and are in m without a unit; positions are of the body's
    /// centre relative to the first beam. `--plot` draws drag over position and contact counts.
    Simulate(simulate::SimulateArgs),
}

/// Commands of earlier releases, and their replacements.
pub(crate) const MOVED: [(&str, &str); 10] = [
    ("bench", "`cargo bench -p shellcal --bench solvers` measures solvers"),
    ("compare", "use `shellcal eval A.json LOG --against B.json`"),
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

/// The arguments of one subcommand, set up only when needed: setting up those of all subcommands would take
/// half of the program's start-up time. Their description is in the list of subcommands.
#[derive(Debug)]
pub(crate) struct Deferred<T>(Box<T>);

impl<T: Args> Args for Deferred<T> {
    fn augment_args(command: clap::Command) -> clap::Command {
        command.defer(keep_about::<T>)
    }

    /// The program does not use clap's updates in place.
    fn augment_args_for_update(command: clap::Command) -> clap::Command {
        Self::augment_args(command)
    }
}

/// Adds the arguments but keeps the description of the command, which a flattened set of arguments would
/// replace with its own. Moves the options of every command, which were added before, to the end of help.
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
