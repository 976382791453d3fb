//! What to do about an error: which flag, which file, which column.

use std::error::Error;
use std::io;

use alignment::AlignError;
use beam_channel::SetupError;
use board_link::recording::NoFrame;
use board_link::{LinkError, NotForBoard, RecordError};
use calibration::FitError;
use calibration::validation::ValidationError;
use calibration_file::matrix::MatrixError;
use calibration_file::{CalibrationFileError, MergeError, Problem, SCHEMA_VERSION};
use forces::ForceError;
use forces::filter::FilterError;
use forces::payload::PayloadError;
use log_file::{LogError, TableError};
use output_file::OutputError;
use shared_proto::Refusal;
use shellcal::workflow::WorkflowError;
use shellcal::workflow::align::AlignLogsError;
use shellcal::workflow::convert::ConvertError;
use shellcal::workflow::drift::DriftError;
use shellcal::workflow::noise::NoiseError;
use shellcal::workflow::payload::PayloadLogError;
use shellcal::workflow::trial::TrialLogError;
use trial::TrialError;
use trial::manifest::suggest;

/// The next step after `error`, where one is known.
pub(crate) fn for_error(error: &anyhow::Error) -> Option<String> {
    let hint = error.chain().find_map(|cause| match cause.downcast_ref() {
        Some(WorkflowError::Log(error)) => after_log(error),
        Some(WorkflowError::Fit(error)) => after_fit(error),
        Some(WorkflowError::Channels(_)) => Some(CHANNELS),
        Some(WorkflowError::Copy { .. }) => {
            Some("leave one of them out: errors on a copy say nothing about other data")
        }
        Some(WorkflowError::Changed { .. }) => Some("wait until it is written, and fit again"),
        Some(WorkflowError::Validation(error)) => after_validation(error),
        Some(WorkflowError::Merge(error)) => after_merge(error),
        Some(WorkflowError::NoGroupSums) => {
            Some("make the partial fits with `shellcal fit --partial --groups`")
        }
        _ => known(cause, after_log)
            .or_else(|| known(cause, after_calibration))
            .or_else(|| known(cause, after_conversion))
            .or_else(|| known(cause, after_noise))
            .or_else(|| known(cause, after_drift))
            .or_else(|| known(cause, after_payload))
            .or_else(|| known(cause, after_alignment))
            .or_else(|| known(cause, after_trial))
            .or_else(|| known(cause, after_validation))
            .or_else(|| known(cause, after_merge))
            .or_else(|| known(cause, after_link))
            .or_else(|| known(cause, after_recording))
            .or_else(|| known(cause, after_not_for_board))
            .or_else(|| known(cause, after_setup))
            .or_else(|| known(cause, after_output)),
    });
    error.chain().find_map(nearest_columns).or_else(|| hint.map(str::to_owned))
}

/// The names that are like those of columns that a log does not have.
fn nearest_columns(cause: &(dyn Error + 'static)) -> Option<String> {
    let error: &LogError = match cause.downcast_ref() {
        Some(WorkflowError::Log(error)) => error,
        _ => match (cause.downcast_ref(), cause.downcast_ref()) {
            (Some(ConvertError::Log(error)), _) | (_, Some(TrialLogError::Log(error))) => error,
            _ => cause.downcast_ref()?,
        },
    };
    let LogError::MissingColumns { missing, found, .. } = error else { return None };
    if let Some(name) = missing.iter().find(|name| found.contains(name)) {
        return Some(format!(
            "`{name}` is there, but was said to be something else: check `--sensors`, `--wrench` and `--time`"
        ));
    }
    // A column by its place is like no other.
    let is_place = |name: &str| {
        name.strip_prefix("column ").is_some_and(|place| place.parse::<usize>().is_ok())
    };
    let nearest = |name: &String| {
        if is_place(name) {
            return None;
        }
        let like = suggest(name, found.iter().map(String::as_str))?;
        Some(format!("`{like}` for `{name}`"))
    };
    let nearest: Vec<String> = missing.iter().filter_map(nearest).collect();
    (!nearest.is_empty()).then(|| format!("did you mean {}?", nearest.join(", ")))
}

/// What `after` says if the cause is of its kind.
fn known<E: Error + 'static>(
    cause: &(dyn Error + 'static),
    after: fn(&E) -> Option<&'static str>,
) -> Option<&'static str> {
    cause.downcast_ref().and_then(after)
}

fn after_setup(error: &SetupError) -> Option<&'static str> {
    Some(match error {
        SetupError::Jams { .. } => {
            "give a wider channel (`--width`) or longer beams (`--beam-length`)"
        }
        SetupError::Locks { .. } => {
            "give less friction (`--friction`) or a wider channel (`--width`)"
        }
        SetupError::BeyondTips { .. } => "the offset is a length: `--off-centre 5mm`",
        _ => return None,
    })
}

fn after_validation(error: &ValidationError) -> Option<&'static str> {
    Some(match error {
        ValidationError::TooFewGroups { .. } => {
            "record more poses, give several logs, or name the column of groups with `--group`"
        }
        ValidationError::TooManyGroups { .. } => {
            "name the column of groups with `--group`, or deal them into K folds with `--cv=K`"
        }
        ValidationError::Folds { .. } => "leave the number out to hold out one group at a time",
        ValidationError::Undetermined(_) | ValidationError::NoModel => {
            "record more poses, choose a smaller `--model`, or accept a damped answer with \
             `--ridge 1e-6`"
        }
        _ => return None,
    })
}

fn after_merge(error: &MergeError) -> Option<&'static str> {
    Some(match error {
        MergeError::Model { .. } => "make both with the same `--model` and `--no-intercept`",
        MergeError::Channels { .. } => "name the same sensor columns with `--sensors`",
        MergeError::Twice(_) => {
            "leave one of them out; `--skip-counted` leaves out partial fits that were delivered twice"
        }
        MergeError::Kind { .. } => {
            "make all with `fit --partial --solver tsqr`, which keeps triangles of any numbers"
        }
        MergeError::Groups { .. } => "make all with `--groups`, or all without",
        MergeError::GroupsAre { .. } => {
            "make all with `--groups=file`, or all with `--groups=column`"
        }
        MergeError::Split { .. } => "make all with the same `--cv-seed`",
        MergeError::SameName(_) => {
            "groups are files: give them different names, such as those of their folders"
        }
        MergeError::TooManyGroups { .. } => "name a column of fewer groups with `--group`",
        _ => return None,
    })
}

fn after_conversion(error: &ConvertError) -> Option<&'static str> {
    Some(match error {
        ConvertError::Log(error) => return after_log(error),
        ConvertError::Channels(_) => CHANNELS,
        ConvertError::TareFrames { .. } => "take fewer frames with `--tare`, or `--no-tare`",
        ConvertError::RestsUnderLoad => {
            "leave out `--tare rests`, or take the weight off by `payload subtract` first"
        }
        ConvertError::RestsWithoutTime { .. } => {
            "name it with `--time`, or tare on the first frames"
        }
        ConvertError::TareTime { .. } => "`shellcal info` tells the times of a log",
        ConvertError::NoRate { .. } => {
            "say how many rows there are in a second with `--rate`, or leave the filter out with `--no-lowpass`"
        }
        ConvertError::Filter(FilterError::Cutoff { .. }) => {
            "the low-pass runs at the rate of the log's rows; choose a lower `--lowpass`"
        }
        ConvertError::Filter(FilterError::TooFewSamples { .. }) => {
            "filter forward only with `--causal`, or not at all with `--no-lowpass`"
        }
        ConvertError::NoCovariance => {
            "leave out `--interval`, and `se` of `--columns`; `shellcal fit` puts a covariance into the calibration unless there are fewer than twice as many groups as features, or `--covariance none`"
        }
        _ => return None,
    })
}

fn after_drift(error: &DriftError) -> Option<&'static str> {
    match error {
        DriftError::Log(error) => after_log(error),
        DriftError::Channels(_) => Some(CHANNELS),
        DriftError::TooFewRests { .. } => Some(
            "begin with the sensor at rest and unloaded, and let it rest for a second or more now and then",
        ),
        DriftError::Temperature { .. } => {
            Some("name the column of temperature with `--temperature`")
        }
        _ => None,
    }
}

fn after_trial(error: &TrialLogError) -> Option<&'static str> {
    let error = match error {
        TrialLogError::Log(error) => return after_log(error),
        TrialLogError::Trial(error) => error,
        _ => return None,
    };
    Some(match error {
        TrialError::OutsideLog { .. } | TrialError::Gap { .. } => {
            "times are in s on the log's clock; `shellcal info` tells from when to when it runs"
        }
        TrialError::Backward { .. } => "cut the log there: its parts are two recordings",
        TrialError::Forces(ForceError::TareFrames { .. }) => {
            "take fewer frames with `--tare`, or name a time with `--tare-time`"
        }
        TrialError::Channels { .. } => CHANNELS,
        TrialError::Nothing(_) => {
            "forces need sensors and `--calibration`, energies need telemetry"
        }
        _ => return None,
    })
}

fn after_alignment(error: &AlignLogsError) -> Option<&'static str> {
    let error = match error {
        AlignLogsError::Log(error) => return after_log(error),
        AlignLogsError::Align { source, .. } => source,
        _ => return None,
    };
    Some(match error {
        AlignError::NoMatch { .. } => {
            "are these of the same session? both must have recorded the same loads: tap the shell a \
             few times in different places at the start and at the end"
        }
        AlignError::Ambiguous { .. } => {
            "a load that repeats itself fits at several offsets: tap the shell at uneven intervals, in \
             different places"
        }
        AlignError::TimeGoesBack { .. } | AlignError::Skew { .. } => {
            "check the time columns and their units, `--time-unit` and `--reference-time-unit`"
        }
        AlignError::TooShort { .. } | AlignError::ShortOverlap { .. } => {
            "record for longer; `shellcal info` tells the times of a log"
        }
        AlignError::Constant { .. } => {
            "check the cable, and that `--sensors` and `--wrench` name the right columns"
        }
        AlignError::NotConverged { .. } => "record a few sharp taps in different directions",
        _ => return None,
    })
}

fn after_noise(error: &NoiseError) -> Option<&'static str> {
    Some(match error {
        NoiseError::Log(error) => return after_log(error),
        NoiseError::Channels(_) => CHANNELS,
        NoiseError::TooFewFrames { .. } => "`shellcal info` tells the times of a log",
        _ => return None,
    })
}

fn after_payload(error: &PayloadLogError) -> Option<&'static str> {
    Some(match error {
        PayloadLogError::Log(error) => return after_log(error),
        PayloadLogError::Payload(PayloadError::NoMass { .. }) => {
            "does gravity point down in its columns, and is the wrench the load on the sensor, not its reaction?"
        }
        PayloadLogError::Payload(PayloadError::NotFinite { .. }) => {
            "leave the row out, or such rows with `--skip-bad-rows`"
        }
        PayloadLogError::Payload(_) => {
            "record the sensor at rest in six directions or more: upright, upside down, on each side"
        }
        PayloadLogError::NoMotion { .. }
        | PayloadLogError::OrientationColumns { .. }
        | PayloadLogError::AccelerationColumns { .. } => {
            "name the columns with `--orientation` or `--accelerations`, in a run those of another log with \
             `--motion`"
        }
        PayloadLogError::NoOrientation { .. } => {
            "correct the row, or name the right columns with `--orientation`"
        }
        PayloadLogError::AccelerationUnit { .. } => {
            "scale them to m/s², or give orientations besides: then any unit will do"
        }
        PayloadLogError::UnknownFrame { .. } => {
            "fit the payload to poses that have accelerations, too, or name columns of `--orientation`"
        }
        PayloadLogError::Motion { .. } => "`shellcal info` tells the times of a log",
        _ => return None,
    })
}

fn after_link(error: &LinkError) -> Option<&'static str> {
    Some(match error {
        LinkError::Missing { .. } => "`shellcal ports` lists the ports there are",
        LinkError::Busy { .. } => "close the program that has it: a terminal, another recording",
        LinkError::Denied { .. } => {
            "on Linux, join the group that owns the port, as a rule `dialout`, and log in again"
        }
        LinkError::Lost { .. } => {
            "what arrived until then is kept; with `--reconnect` `record` waits for the port"
        }
        LinkError::NoAnswer { silent: true, .. } => {
            "is the board on, and are both radios in one network? Try another `--baud`, or \
             `--framing xbee-ap1` or `xbee-ap2` for a base station in API mode"
        }
        LinkError::NoAnswer { .. } => {
            "bytes arrive but no answer: try another `--baud`, or `--framing xbee-ap1` or `xbee-ap2` \
             for a base station in API mode"
        }
        LinkError::OtherVersion { .. } => VERSIONS,
        LinkError::Refused { refusal: Refusal::NoCalibration, .. } => {
            "upload one: `shellcal board PORT upload CAL`"
        }
        LinkError::Refused { refusal: Refusal::PeriodTooShort { .. }, .. } => {
            "choose a lower rate, or fewer conversions and less settling: `shellcal board PORT \
             sampling`"
        }
        LinkError::Refused { refusal: Refusal::LineTooSlow { .. }, .. } => {
            "choose a lower rate, or stream readings in place of wrenches"
        }
        LinkError::Refused { refusal: Refusal::Unsigned | Refusal::BadSignature, .. } => {
            "name the file with the board's key by `--key KEY`"
        }
        LinkError::Refused { refusal: Refusal::Streaming, .. } => {
            "stop it first: `shellcal board PORT stop`"
        }
        LinkError::SeveralBoards { .. } => "name one of them with `--board SERIAL`",
        LinkError::NotKept { .. } => "upload it again",
        LinkError::UnknownKind { .. } => {
            "flash the firmware that belongs to this version of shellcal, or upload a calibration of \
             `shellcal fit --model cubic`"
        }
        _ => return None,
    })
}

const VERSIONS: &str = "flash the firmware that belongs to this version of shellcal";

fn after_recording(error: &RecordError) -> Option<&'static str> {
    Some(match error {
        RecordError::Link(error) => return after_link(error),
        RecordError::Output(error) => return after_output(error),
        RecordError::NoFrame { problem: NoFrame::Any { .. }, .. } => {
            "try another `--baud` (57600 unless told), or `--framing` if you know it"
        }
        RecordError::NoFrame { problem: NoFrame::OtherProtocol { .. }, .. } => {
            "leave out `--framing` to have it recognised"
        }
        RecordError::NoFrame { problem: NoFrame::OtherVersion { .. }, .. } => VERSIONS,
        RecordError::Silence { .. } | RecordError::NotStreaming { .. } => {
            "a board streams once it is started: `--start`, or `shellcal board PORT start`"
        }
        _ => return None,
    })
}

fn after_not_for_board(error: &NotForBoard) -> Option<&'static str> {
    Some(match error {
        NotForBoard::Basis { .. } => {
            "fit one for the board with `shellcal fit --model cubic` or `physics`"
        }
        _ => return None,
    })
}

fn after_output(error: &OutputError) -> Option<&'static str> {
    let source = match error {
        OutputError::Failed { source, .. } => source,
        OutputError::IsInput { .. } | OutputError::Twice { .. } => {
            return Some("choose another name for it");
        }
    };
    Some(match source.kind() {
        io::ErrorKind::AlreadyExists => "choose another name, or `--overwrite` it",
        io::ErrorKind::StorageFull => "what was written until then is whole; make room",
        _ => return None,
    })
}

const CHANNELS: &str = "name the sensor columns of the log with `--sensors`, or use the calibration \
                        of this sensor";

fn after_log(error: &LogError) -> Option<&'static str> {
    Some(match error {
        LogError::Foreign { remedy, .. } => remedy,
        LogError::PackedTable { .. } => "unpack it first; compressed logs are text",
        LogError::NoParts { .. } => "leave out `--table`",
        LogError::Table { problem: TableError::Choice { .. }, .. } => "choose with `--table NAME`",
        LogError::Table { problem: TableError::Damaged { .. }, .. } => {
            "copy the file again, or write it again: it is cut short or damaged"
        }
        LogError::Table { .. } => "write it again without that, or export it as CSV",
        LogError::Gzip { .. } | LogError::Zstd { .. } => {
            "copy the file again: it is cut short or damaged"
        }
        LogError::Empty { .. } | LogError::NoRows { .. } => {
            "nothing was recorded, or the file was not copied to its end"
        }
        LogError::Binary { .. } => {
            "logs are text (telemetry, CSV, console), plain or compressed with gzip or zstd, or tables \
             in Parquet, MATLAB, NumPy, Excel or MCAP"
        }
        LogError::LineTooLong { .. } => "this does not look like a log; are its line ends missing?",
        LogError::CarriageReturns { .. } => {
            "give its lines the ends that others have: `tr '\\r' '\\n' < OLD > NEW`"
        }
        LogError::NoColumnNames { .. } => {
            "add the line that names the columns, `% time | … | S1 | …`, as the last `%` line"
        }
        LogError::UnknownLayout { .. } => {
            "say which columns are which, `--sensors 2-9 --wrench 10-15 --time 1`"
        }
        LogError::LayoutMismatch { .. } => "leave out `--format` to have it recognised",
        LogError::MissingColumns { .. } => {
            "name the columns with `--sensors`, `--wrench`, `--time` or `--group`"
        }
        LogError::DuplicateColumn { .. } => {
            "say which one is meant with `--sensors`, `--wrench` or `--time`"
        }
        LogError::Row { .. } => "correct the line, or leave such rows out with `--skip-bad-rows`",
        _ => return None,
    })
}

fn after_fit(error: &FitError) -> Option<&'static str> {
    Some(match error {
        FitError::TooFewRows { .. } => "record more poses, or choose a smaller `--model`",
        FitError::IdenticalRows { .. } => {
            "the readings never move: check the cable and the shell, and that `--sensors` names the \
             right columns"
        }
        FitError::IllConditioned { .. } | FitError::NotConverged { .. } => {
            "use `--solver exact` or `--solver wide-tsqr`, or choose a smaller `--model`"
        }
        FitError::RankDeficient(_) | FitError::NearlyDependent => {
            "record loads that move the channels independently, drop a channel with `--sensors`, \
             choose a smaller `--model`, or accept a damped answer with `--ridge 1e-6`"
        }
        FitError::TooLarge(_) => {
            "choose a smaller `--model`, or name fewer columns with `--sensors`"
        }
        FitError::Overflow => "check the units of the readings and of the wrench",
        _ => return None,
    })
}

fn after_calibration(error: &CalibrationFileError) -> Option<&'static str> {
    Some(match &error.problem {
        Problem::NotJson { .. } => {
            "a calibration is the JSON file that `shellcal fit --output` or `shellcal import` writes"
        }
        Problem::SchemaVersion { found } if *found > SCHEMA_VERSION => {
            "use the version of shellcal that wrote it, or a later one"
        }
        Problem::SchemaVersion { .. } => "make it again with `shellcal fit`",
        Problem::Matrix(MatrixError::Variable { .. }) => "choose one with `--variable`",
        _ => return None,
    })
}

/// Whether the reader of our output has gone away, which is not an error.
pub(crate) fn is_closed_pipe(error: &anyhow::Error) -> bool {
    error
        .chain()
        .filter_map(|cause| cause.downcast_ref::<io::Error>())
        .any(|error| error.kind() == io::ErrorKind::BrokenPipe)
}
