//! What to do about an error: which flag, which file, which column.

use std::io;

use shellcal::alignment::AlignError;
use shellcal::calibration::FitError;
use shellcal::calibration_file::matrix::MatrixError;
use shellcal::calibration_file::{CalibrationFileError, Problem, SCHEMA_VERSION};
use shellcal::filter::FilterError;
use shellcal::log_file::{LogError, RowProblem};
use shellcal::workflow::WorkflowError;
use shellcal::workflow::align::AlignLogsError;
use shellcal::workflow::convert::ConvertError;
use shellcal::workflow::noise::NoiseError;

/// The next step after `error`, where one is known.
pub(crate) fn for_error(error: &anyhow::Error) -> Option<String> {
    let hint = error.chain().find_map(|cause| match cause.downcast_ref() {
        Some(WorkflowError::Log(error)) => after_log(error),
        Some(WorkflowError::Fit(error)) => after_fit(error),
        _ => {
            let log = || cause.downcast_ref().and_then(after_log);
            let file = || cause.downcast_ref().and_then(after_calibration);
            let conversion = || cause.downcast_ref().and_then(after_conversion);
            let noise = || cause.downcast_ref().and_then(after_noise);
            let alignment = || cause.downcast_ref().and_then(after_alignment);
            log().or_else(file).or_else(conversion).or_else(noise).or_else(alignment)
        }
    });
    hint.map(str::to_owned)
}

fn after_conversion(error: &ConvertError) -> Option<&'static str> {
    Some(match error {
        ConvertError::Log(error) => return after_log(error),
        ConvertError::Channels { .. } => CHANNELS,
        ConvertError::TareFrames { .. } => "take fewer frames with `--tare`, or `--no-tare`",
        ConvertError::TareTime { .. } => "`shellcal info` tells the times of a log",
        ConvertError::NoRate { .. } => "say how many frames there are in a second with `--rate`",
        ConvertError::Filter(FilterError::Cutoff { .. }) => {
            "frames are fewer than rows where telemetry repeats them; choose a lower `--lowpass`, or \
             `--all-rows`"
        }
        ConvertError::Filter(FilterError::TooFewSamples { .. }) => "leave out `--zero-phase`",
        ConvertError::NoCovariance => {
            "leave `se` out of `--columns`; calibrations made by `shellcal fit` have a covariance"
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
        NoiseError::Channels { .. } => CHANNELS,
        NoiseError::TooFewFrames { .. } => "`shellcal info` tells the times of a log",
        _ => return None,
    })
}

const CHANNELS: &str = "name the sensor columns of the log with `--sensors`, or use the calibration \
                        of this sensor";

fn after_log(error: &LogError) -> Option<&'static str> {
    Some(match error {
        LogError::Gzip { .. } => "copy the file again: it is cut short or damaged",
        LogError::Empty { .. } | LogError::NoRows { .. } => {
            "nothing was recorded, or the file was not copied to its end"
        }
        LogError::Binary { byte: 0xfe | 0xff, .. } => "save it as UTF-8; this looks like UTF-16",
        LogError::Binary { .. } => {
            "logs are text (telemetry, CSV, console), as they are or compressed with gzip"
        }
        LogError::LineTooLong { .. } => "this does not look like a log; are its line ends missing?",
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
        LogError::Row { problem: RowProblem::NotANumber { found, .. }, .. }
            if is_decimal_comma(found) =>
        {
            "write decimals with a point; decimal commas are not read"
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
        FitError::RankDeficient(_) => {
            "record loads that move the channels independently, drop a channel with `--sensors`, \
             choose a smaller `--model`, or accept a damped answer with `--ridge 1e-6`"
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

/// Whether a field becomes a number with a point for its comma.
fn is_decimal_comma(field: &str) -> bool {
    field.matches(',').count() == 1 && field.replace(',', ".").parse::<f64>().is_ok()
}

/// Whether the reader of our output has gone away, which is not an error.
pub(crate) fn is_closed_pipe(error: &anyhow::Error) -> bool {
    error
        .chain()
        .filter_map(|cause| cause.downcast_ref::<io::Error>())
        .any(|error| error.kind() == io::ErrorKind::BrokenPipe)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimal_commas_are_recognised() {
        assert!(is_decimal_comma("1,5") && is_decimal_comma("-0,25"));
        assert!(!is_decimal_comma("1.5") && !is_decimal_comma("a,b") && !is_decimal_comma("1,2,3"));
    }
}
