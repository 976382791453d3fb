//! Who made a file, and when.

use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::Context;
use jiff::Timestamp;

/// Program and version.
pub(in crate::cmd) fn program() -> String {
    concat!("shellcal ", env!("CARGO_PKG_VERSION")).to_owned()
}

/// The time in UTC, RFC 3339 to the second; that of `SOURCE_DATE_EPOCH` where it is set, so that
/// results can be made again byte for byte (reproducible-builds.org).
pub(in crate::cmd) fn date() -> anyhow::Result<String> {
    let seconds = match std::env::var("SOURCE_DATE_EPOCH") {
        Ok(text) => text
            .parse()
            .with_context(|| format!("`SOURCE_DATE_EPOCH` is `{text}`, expected seconds"))?,
        Err(_) => {
            let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
            i64::try_from(now.as_secs()).unwrap_or(i64::MAX)
        }
    };
    let time = Timestamp::from_second(seconds).context("the date is out of range")?;
    Ok(time.to_string())
}
