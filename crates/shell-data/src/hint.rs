//! What to do about an error: which flag, which file, which column.
//!
//! A hint stands beside the error that it is for. An error that only wraps another gives the hint of that one.

use std::error::Error;
use std::fmt::Display;

/// An error that may know the next step.
pub trait Hint {
    /// The next step, where one is known.
    fn hint(&self) -> Option<String>;
}

/// An error with its causes, one after the other.
pub fn with_causes(error: &dyn Error) -> String {
    let text = error.to_string();
    match error.source().map(with_causes) {
        // Some errors say their cause themselves.
        Some(cause) if !text.ends_with(&cause) => format!("{text}: {cause}"),
        _ => text,
    }
}

/// Names as an error lists them: `` `a`, `b` ``.
pub fn quoted(names: impl IntoIterator<Item = impl Display>, between: &str) -> String {
    names.into_iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(between)
}

/// The next step after a log of another number of channels than the calibration.
pub const OTHER_CHANNELS: &str = "name the sensor columns of the log with `--sensors`, or use the calibration \
                                  of this sensor";

/// The name that is most like `name`, if one is: for names that were mistyped.
pub fn suggest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let name = name.to_lowercase();
    let likeness = |known: &str| strsim::jaro_winkler(&name, &known.to_lowercase());
    let candidates = known.into_iter().map(|known| (likeness(known), known));
    let best =
        candidates.filter(|(likeness, _)| *likeness > 0.75).max_by(|a, b| a.0.total_cmp(&b.0));
    best.map(|(_, known)| known)
}

/// `, did you mean …?` where a name is known that is like it.
pub fn did_you_mean<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    suggest(name, known).map_or_else(String::new, |known| format!(", did you mean `{known}`?"))
}
