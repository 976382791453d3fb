//! Hints on how to fix an error: the flag, the file or the column. They are defined next to their errors. An error that
//! only wraps another error returns the hint of that error.

use std::error::Error;
use std::fmt::Display;

pub trait Hint {
    fn hint(&self) -> Option<String>;
}

pub fn with_causes(error: &dyn Error) -> String {
    let text = error.to_string();
    match error.source().map(with_causes) {
        // The text of some errors already includes the cause.
        Some(cause) if !text.ends_with(&cause) => format!("{text}: {cause}"),
        _ => text,
    }
}

/// Formats names for an error message: `` `a`, `b` ``.
pub fn quoted(names: impl IntoIterator<Item = impl Display>, between: &str) -> String {
    names.into_iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(between)
}

/// Hint for a log whose number of channels differs from the calibration's.
pub const OTHER_CHANNELS: &str = "name the sensor columns of the log with `--sensors`, or use the calibration \
                                  of this sensor";

/// Returns the known name most similar to a mistyped one, if one is similar.
pub fn suggest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let name = name.to_lowercase();
    let likeness = |known: &str| strsim::jaro_winkler(&name, &known.to_lowercase());
    let candidates = known.into_iter().map(|known| (likeness(known), known));
    let best =
        candidates.filter(|(likeness, _)| *likeness > 0.75).max_by(|a, b| a.0.total_cmp(&b.0));
    best.map(|(_, known)| known)
}

pub fn did_you_mean<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    suggest(name, known).map_or_else(String::new, |known| format!(", did you mean `{known}`?"))
}
