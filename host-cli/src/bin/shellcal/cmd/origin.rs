//! Who made a file, and when.

use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::Context;
use table_file::iso_of_seconds;

/// The last second that RFC 3339 has four digits of a year for: 9999-12-31T23:59:59Z.
const LAST_SECOND: u64 = 253_402_300_799;

/// The time in UTC, RFC 3339 to the second; that of `SOURCE_DATE_EPOCH` where it is set, so that
/// results can be made again byte for byte (reproducible-builds.org).
pub(in crate::cmd) fn date() -> anyhow::Result<String> {
    let seconds = match std::env::var("SOURCE_DATE_EPOCH") {
        Ok(text) => {
            let seconds = text.parse().ok().filter(|&seconds| seconds <= LAST_SECOND);
            seconds.with_context(|| {
                format!(
                    "`SOURCE_DATE_EPOCH` is `{text}`, expected seconds since 1970, at most \
                     {LAST_SECOND}"
                )
            })?
        }
        Err(_) => SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs(),
    };
    Ok(iso_of_seconds(seconds))
}

/// What the command was called with, so that a shell takes it again.
pub(in crate::cmd) fn command_line() -> String {
    let quoted = |word: String| {
        let is_plain = |c: char| c.is_alphanumeric() || "_-./:=,+@%".contains(c);
        match !word.is_empty() && word.chars().all(is_plain) {
            true => word,
            false => format!("'{}'", word.replace('\'', r"'\''")),
        }
    };
    let words = std::env::args_os().skip(1).map(|word| quoted(word.to_string_lossy().into_owned()));
    ["shellcal".to_owned()].into_iter().chain(words).collect::<Vec<_>>().join(" ")
}
