//! Dates and times of the Gregorian calendar, in ISO 8601 and in seconds since 1970.

/// Parses a date and time in ISO 8601 into seconds since 1970-01-01T00:00:00Z: `2026-03-01T12:00:00.25Z`,
/// `2026-03-01 12:00:00,25+01:00`. A text without an offset is read as UTC.
///
/// Returns `None` if the text is not a date and time. The integer part is exact, and the sum is rounded once.
pub fn seconds_of_iso(text: &str) -> Option<f64> {
    let bytes = text.trim().as_bytes();
    let (date, rest) = bytes.split_at_checked(10)?;
    let [y1, y2, y3, y4, b'-', m1, m2, b'-', d1, d2] = *date else { return None };
    let (year, month, day) = (digits(&[y1, y2, y3, y4])?, digits(&[m1, m2])?, digits(&[d1, d2])?);
    let days = days_since_1970(year, month, day);
    // An invalid month or day converts back to a different date.
    if date_of(days) != (year, month, day) {
        return None;
    }
    let midnight = days * 86_400;
    let Some((b'T' | b't' | b' ', rest)) = rest.split_first() else {
        return rest.is_empty().then_some(midnight as f64);
    };
    let (clock, rest) = rest.split_at_checked(5)?;
    let [h1, h2, b':', n1, n2] = *clock else { return None };
    let (hour, minute) = (digits(&[h1, h2])?, digits(&[n1, n2])?);
    let mut seconds = midnight + hour * 3600 + minute * 60;
    let (mut second, mut fraction, mut rest) = (0, "", rest);
    if let [b':', s1, s2, after @ ..] = rest {
        second = digits(&[*s1, *s2])?;
        rest = after;
        if let [b'.' | b',', after @ ..] = rest {
            let length = after.iter().take_while(|byte| byte.is_ascii_digit()).count();
            fraction = str::from_utf8(&after[..length]).ok().filter(|text| !text.is_empty())?;
            rest = &after[length..];
        }
    }
    // A leap second counts as the first second after it.
    if hour > 23 || minute > 59 || second > 60 {
        return None;
    }
    seconds += second - offset_s(rest)?;
    if fraction.is_empty() {
        return Some(seconds as f64);
    }
    match seconds {
        // Parses the decimal number of seconds, so that it is rounded once.
        0.. => format!("{seconds}.{fraction}").parse().ok(),
        _ => Some(seconds as f64 + format!("0.{fraction}").parse::<f64>().ok()?),
    }
}

fn offset_s(zone: &[u8]) -> Option<i64> {
    let zone = zone.trim_ascii_start();
    let (sign, zone) = match zone {
        [] | [b'Z' | b'z'] | b"UTC" => return Some(0),
        [b'+', zone @ ..] => (1, zone),
        [b'-', zone @ ..] => (-1, zone),
        _ => return None,
    };
    let (hours, minutes) = match *zone {
        [h1, h2] => (digits(&[h1, h2])?, 0),
        [h1, h2, m1, m2] | [h1, h2, b':', m1, m2] => (digits(&[h1, h2])?, digits(&[m1, m2])?),
        _ => return None,
    };
    (hours <= 23 && minutes <= 59).then_some(sign * (hours * 3600 + minutes * 60))
}

fn digits(bytes: &[u8]) -> Option<i64> {
    bytes.iter().try_fold(0, |value, byte| {
        byte.is_ascii_digit().then(|| 10 * value + i64::from(byte - b'0'))
    })
}

/// Returns the days from 1970-01-01 to a date, computed in eras of 400 years that begin on 1 March.
fn days_since_1970(year: i64, month: i64, day: i64) -> i64 {
    let year = year - i64::from(month <= 2);
    let (era, of_era) = (year.div_euclid(400), year.rem_euclid(400));
    let of_year = (153 * ((month + 9) % 12) + 2) / 5 + day - 1;
    era * 146_097 + of_era * 365 + of_era / 4 - of_era / 100 + of_year - 719_468
}

/// Formats seconds since 1970 as a date and time in UTC, in ISO 8601 with a `Z`.
pub fn iso_of_seconds(seconds: u64) -> String {
    iso_of(seconds.try_into().unwrap_or(i64::MAX), 1) + "Z"
}

/// Formats a time since 1970 in units of 1/`per_second` s as a date and time in ISO 8601.
pub(crate) fn iso_of(units: i64, per_second: i64) -> String {
    let (seconds, part) = (units.div_euclid(per_second), units.rem_euclid(per_second));
    let (year, month, day) = date_of(seconds.div_euclid(86_400));
    let second = seconds.rem_euclid(86_400);
    let (hour, minute, second) = (second / 3600, second / 60 % 60, second % 60);
    let mut text = format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}");
    if part != 0 {
        let digits = per_second.ilog10() as usize;
        text.push_str(&format!(".{part:0digits$}"));
    }
    text
}

/// Converts units of 1/`per_second` s to seconds, rounded once.
pub(crate) fn seconds_of(units: i64, per_second: i64) -> f64 {
    if units.unsigned_abs() < 1 << 53 {
        return units as f64 / per_second as f64;
    }
    // Computes 64 additional bits. The last bit is set if any further bit is.
    let per_second = u128::from(per_second.unsigned_abs());
    let scaled = u128::from(units.unsigned_abs()) << 64;
    let bits = (scaled / per_second) | u128::from(!scaled.is_multiple_of(per_second));
    let seconds = bits as f64 * 2_f64.powi(-64);
    if units < 0 { -seconds } else { seconds }
}

/// Returns the year, month and day of a number of days after 1970-01-01.
fn date_of(days: i64) -> (i64, i64, i64) {
    let days = days.saturating_add(719_468);
    let (era, of_era) = (days.div_euclid(146_097), days.rem_euclid(146_097));
    let year_of_era = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month = (5 * of_year + 2) / 153;
    let day = of_year - (153 * month + 2) / 5 + 1;
    let month = if month < 10 { month + 3 } else { month - 9 };
    let year = year_of_era + era * 400 + i64::from(month <= 2);
    (year, month, day)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected values: `date -u -d … +%s`.
    #[test]
    fn times_are_those_of_the_calendar() {
        for (text, expected) in [
            ("1970-01-01", 0.0),
            ("1970-01-01T00:00:00Z", 0.0),
            ("2000-02-29T12:34:56", 951_827_696.0),
            ("2026-11-22 10:41:49.25", 1_795_344_109.25),
            ("2026-11-22T11:41:49,250+01:00", 1_795_344_109.25),
            ("2026-11-22T05:11:49-0530", 1_795_344_109.0),
            ("1969-12-31T23:59:59.5Z", -0.5),
            ("2026-11-22T10:41", 1_795_344_060.0),
        ] {
            assert_eq!(seconds_of_iso(text), Some(expected), "{text}");
        }
        for text in [
            "",
            "2026",
            "2026-13-01",
            "2025-02-29",
            "2026-11-22T25:00:00",
            "22.11.2026",
            "2026-11-22T10:41:49.",
            "2026-11-22T10:41:49X",
            "2026-11-22x",
        ] {
            assert_eq!(seconds_of_iso(text), None, "{text}");
        }
    }

    /// Compares with the decimal number of seconds, which the standard library rounds once.
    #[test]
    fn seconds_are_those_of_their_decimal_number() {
        for units in
            [0, 1, -1, 1_795_344_109_123_456_789, i64::MAX, i64::MIN + 1, 9_007_199_254_740_993]
        {
            for offset in 0..999 {
                let units: i64 = units.saturating_sub(offset * 7_777_777);
                let digits = units.unsigned_abs();
                let sign = if units < 0 { "-" } else { "" };
                let text =
                    format!("{sign}{}.{:09}", digits / 1_000_000_000, digits % 1_000_000_000);
                assert_eq!(
                    seconds_of(units, 1_000_000_000),
                    text.parse::<f64>().unwrap(),
                    "{text}"
                );
            }
        }
    }

    #[test]
    fn what_is_written_reads_back() {
        for seconds in [0, 1, 951_827_696, 1_795_344_109, -1, -86_400 * 365 * 200, 253_402_300_799]
        {
            assert_eq!(seconds_of_iso(&iso_of(seconds, 1)), Some(seconds as f64), "{seconds}");
        }
        assert_eq!(
            iso_of(1_795_344_109_000_000_001, 1_000_000_000),
            "2026-11-22T10:41:49.000000001"
        );
        assert_eq!(iso_of(-500, 1000), "1969-12-31T23:59:59.500");
    }
}
