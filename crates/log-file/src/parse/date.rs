//! Dates and times of day as loggers, spreadsheets and MATLAB write them: `2026-03-01T12:00:00.25Z`,
//! `1.3.2026 12:00`, `3/1/2026 9:05:07 PM`, `01-Mar-2026 12:00:00`, `12:00:00,250`.
//!
//! A date is rewritten in ISO 8601, which the calendar of table files converts.

use table_file::seconds_of_iso;

use super::field_problem::FieldProblem;
use shell_data::unit::{Quantity, Unit};

/// The order of day and month in a numeric date whose year is last.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum DateOrder {
    DayFirst,
    MonthFirst,
}

impl DateOrder {
    pub(crate) fn from_option(text: &str) -> Option<Self> {
        match text.to_ascii_lowercase().as_str() {
            "d/m/y" | "dd/mm/yyyy" => Some(Self::DayFirst),
            "m/d/y" | "mm/dd/yyyy" => Some(Self::MonthFirst),
            _ => None,
        }
    }
}

const MONTHS: [&str; 12] =
    ["jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"];
const WEEKDAYS: [&str; 7] = ["mon", "tue", "wed", "thu", "fri", "sat", "sun"];

/// Parses a date and time, in seconds since 1970, or a time of day, in seconds since midnight.
pub(crate) fn parse_date(field: &[u8], order: DateOrder) -> Result<f64, FieldProblem> {
    let text = date_text(field).ok_or(FieldProblem::NotADate)?;
    seconds_of_iso(text)
        .or_else(|| seconds_of_iso(&in_iso(text, order)?))
        .or_else(|| seconds_of_day(text))
        .or_else(|| elapsed(text))
        .ok_or(FieldProblem::NotADate)
}

/// Returns the seconds of a duration as MATLAB (`0.25 sec`) or pandas (`0 days 00:00:00.25`) writes it.
fn elapsed(text: &str) -> Option<f64> {
    if let Some((days, time)) = text.split_once(" days ") {
        let days = days.parse::<u32>().ok()?;
        // The decimals are parsed directly, which avoids a rounding.
        let time = seconds_of_day(time.trim_start_matches('+'))?;
        return Some(f64::from(days) * 86_400.0 + time);
    }
    let (number, unit) = text.split_once(' ')?;
    let number = number.parse::<f64>().ok().filter(|number| number.is_finite())?;
    Some(Unit::parse(unit, Quantity::Time)?.scale.to_si(number))
}

pub(crate) fn is_date(field: &[u8]) -> bool {
    [DateOrder::DayFirst, DateOrder::MonthFirst].iter().any(|of| parse_date(field, *of).is_ok())
}

pub(crate) fn is_time_of_day(field: &[u8]) -> bool {
    date_text(field).is_some_and(|text| seconds_of_day(text).is_some())
}

/// Returns the order of a numeric date whose year is last: `None` if it is not one, `Some(None)` if both orders are
/// possible and differ.
pub(crate) fn order_of(field: &[u8]) -> Option<Option<DateOrder>> {
    let (date, _) = split(date_text(field)?)?;
    let parts = parts(&date);
    let (first, second) = match *parts.as_slice() {
        [first, second, year] if year.len() == 4 && !date.contains('.') => (first, second),
        _ => return None,
    };
    let (first, second): (u32, u32) = first.parse().ok().zip(second.parse().ok())?;
    Some(match (first, second) {
        (13.., _) => Some(DateOrder::DayFirst),
        (_, 13..) => Some(DateOrder::MonthFirst),
        _ if first == second => Some(DateOrder::DayFirst),
        _ => None,
    })
}

/// Returns the text of a field without quotes, and without brackets as terminals write them.
fn date_text(field: &[u8]) -> Option<&str> {
    Some(str::from_utf8(field).ok()?.trim().trim_matches(['[', ']', '"']))
}

/// Returns the seconds since midnight of a time that has seconds.
fn seconds_of_day(text: &str) -> Option<f64> {
    let time = ClockTime::new(text).filter(|time| time.rest.is_empty())?;
    let whole = time.hour * 3600 + time.minute * 60 + time.second?;
    format!("{whole}.{}", time.fraction).parse().ok()
}

fn in_iso(text: &str, order: DateOrder) -> Option<String> {
    let (date, time) = split(text)?;
    let (year, month, day) = year_month_day(&date, order, time.is_some())?;
    let Some(ClockTime { hour, minute, second, fraction, rest }) = time else {
        return Some(format!("{year:04}-{month:02}-{day:02}"));
    };
    let zone = if is_year(rest) { "" } else { rest };
    let zone = if zone.eq_ignore_ascii_case("gmt") { "Z" } else { zone };
    let second = second.unwrap_or(0);
    let fraction = if fraction.is_empty() { "0" } else { fraction };
    Some(format!(
        "{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}.{fraction}{zone}"
    ))
}

/// Splits a text into a date and the time of day after it; a year may follow the time.
fn split(text: &str) -> Option<(String, Option<ClockTime<'_>>)> {
    let Some(colon) = text.find(':') else { return Some((text.to_owned(), None)) };
    let start = text[..colon].rfind(|c: char| !c.is_ascii_digit()).map_or(0, |at| at + 1);
    // The mark before the hour may be longer than a byte.
    let (date, time) = text.split_at_checked(start)?;
    let time = ClockTime::new(time)?;
    let mut date = date.trim_end_matches([' ', 'T', ',', '_', '/', '-']).to_owned();
    if is_year(time.rest) {
        date = format!("{date} {}", time.rest);
    }
    (!date.is_empty()).then_some((date, Some(time)))
}

fn is_year(text: &str) -> bool {
    text.len() == 4 && text.bytes().all(|byte| byte.is_ascii_digit())
}

/// Splits a date into its parts, without the day of the week.
fn parts(date: &str) -> Vec<&str> {
    let parts = date.split([' ', '/', '-', '.', ',']).filter(|part| !part.is_empty());
    parts.filter(|part| named(part, &WEEKDAYS).is_none()).collect()
}

/// Returns the index of the element of `names` that has the same first three letters as `text`.
fn named(text: &str, names: &[&str]) -> Option<usize> {
    let is_word = text.chars().all(char::is_alphabetic) && text.len() >= 3;
    let start = text.get(..3).filter(|_| is_word)?.to_ascii_lowercase();
    names.iter().position(|name| *name == start)
}

fn year_month_day(date: &str, order: DateOrder, has_time: bool) -> Option<(u32, u32, u32)> {
    let parts = parts(date);
    let &[a, b, c] = parts.as_slice() else { return None };
    let number = |text: &str| text.parse::<u32>().ok().filter(|_| text.len() <= 4);
    // A year of two digits is in this century. Without a time of day, the text is more probably a version number.
    let year = |text: &str| match text.len() {
        4 => number(text),
        2 if has_time => Some(2000 + number(text)?),
        _ => None,
    };
    let month = |text: &str| named(text, &MONTHS).map(|at| at as u32 + 1);
    if let Some(month) = month(b) {
        return Some(match a.len() {
            4 => (year(a)?, month, number(c)?),
            _ => (year(c)?, month, number(a)?),
        });
    }
    if let Some(month) = month(a) {
        return Some((year(c)?, month, number(b)?));
    }
    match a.len() {
        4 => Some((year(a)?, number(b)?, number(c)?)),
        _ if date.contains('.') || order == DateOrder::DayFirst => {
            Some((year(c)?, number(b)?, number(a)?))
        }
        _ => Some((year(c)?, number(a)?, number(b)?)),
    }
}

/// A time of day, and the text after it.
struct ClockTime<'a> {
    hour: u32,
    minute: u32,
    second: Option<u32>,
    fraction: &'a str,
    rest: &'a str,
}

impl<'a> ClockTime<'a> {
    /// Parses the time at the start of a text: `9:05:07 PM`, `12:00:00.250`, `12:00:00:250`, `05:07.25`.
    fn new(text: &'a str) -> Option<Self> {
        let (hour, rest) = digits(text, 1..=3)?;
        let (minute, mut rest) = digits(rest.strip_prefix(':')?, 2..=2)?;
        let mut time = Self { hour, minute, second: None, fraction: "", rest: "" };
        if let Some((second, after)) = rest.strip_prefix(':').and_then(|it| digits(it, 2..=2)) {
            (time.second, rest) = (Some(second), after);
        }
        let length = |text: &str| text.bytes().take_while(u8::is_ascii_digit).count();
        let behind_colons = rest.trim_start_matches(':');
        if let Some(after) = rest.strip_prefix(['.', ',']) {
            (time.fraction, rest) = after.split_at(length(after));
            if time.second.is_none() {
                (time.hour, time.minute, time.second) = (0, time.hour, Some(time.minute));
            }
        } else if behind_colons.len() < rest.len() && length(behind_colons) == 3 {
            (time.fraction, rest) = behind_colons.split_at(3);
        }
        time.rest = rest.trim();
        let half = time.rest.get(..2).unwrap_or_default().to_ascii_lowercase();
        if ["am", "pm"].contains(&half.as_str()) {
            time.rest = time.rest[2..].trim();
            time.hour = time.hour % 12 + if half == "pm" { 12 } else { 0 };
        }
        (time.minute < 60 && time.second.is_none_or(|second| second <= 60)).then_some(time)
    }
}

/// Takes a number from the start of a text, if the number of its digits is in `count`.
fn digits(text: &str, count: std::ops::RangeInclusive<usize>) -> Option<(u32, &str)> {
    let end = text.bytes().take_while(u8::is_ascii_digit).count();
    let (number, rest) = text.split_at(end);
    Some((number.parse().ok().filter(|_| count.contains(&end))?, rest))
}

#[cfg(test)]
mod tests {
    use super::DateOrder::{DayFirst, MonthFirst};
    use super::*;

    /// Expected values: `date -u -d … +%s`.
    #[test]
    fn dates_of_many_programs_are_seconds_since_1970() {
        for (text, order, expected) in [
            ("2026-03-01T12:00:00.25Z", DayFirst, 1_772_366_400.25),
            ("2026/3/1 12:00:00.25", MonthFirst, 1_772_366_400.25),
            ("1.3.2026 12:00:00,25", MonthFirst, 1_772_366_400.25),
            ("01/03/2026 12:00", DayFirst, 1_772_366_400.0),
            ("3/1/2026 12:00:00 PM", MonthFirst, 1_772_366_400.0),
            ("3/1/2026 9:05:07 PM", MonthFirst, 1_772_399_107.0),
            ("3/1/2026 12:05:07 AM", MonthFirst, 1_772_323_507.0),
            ("01-Mar-2026 12:00:00", MonthFirst, 1_772_366_400.0),
            ("Mar 1, 2026 12:00:00 PM", DayFirst, 1_772_366_400.0),
            ("Sun Mar 01 12:00:00 2026", DayFirst, 1_772_366_400.0),
            ("[Sun Mar 01 12:00:00.250 2026]", DayFirst, 1_772_366_400.25),
            ("1 March 2026 12:00:00 UTC", MonthFirst, 1_772_366_400.0),
            ("2026/03/01/ 12:00:00::250", DayFirst, 1_772_366_400.25),
            ("2026-03-01_12:00:00+01:00", DayFirst, 1_772_362_800.0),
            ("01/03/2026", DayFirst, 1_772_323_200.0),
            ("01/03/26 00:00:00", DayFirst, 1_772_323_200.0),
        ] {
            assert_eq!(parse_date(text.as_bytes(), order), Ok(expected), "{text}");
        }
        for (text, expected) in [
            ("14:24:42.000", 51_882.0),
            ("9:05:07 PM", 75_907.0),
            ("00:01:02,5", 62.5),
            ("01:02.5", 62.5),
            ("14:24:42:125", 51_882.125),
            ("125:00:01", 450_001.0),
            ("0.25 sec", 0.25),
            ("1.5 min", 90.0),
        ] {
            assert_eq!(parse_date(text.as_bytes(), DayFirst), Ok(expected), "{text}");
        }
    }

    #[test]
    fn other_texts_are_not_dates() {
        for text in [
            "",
            "5.3.0.7",
            "5.3.10",
            "1/2",
            "a:b",
            "12",
            "12:00",
            "31/02/2026",
            "may",
            "1-2-3",
            "::",
            "µ1:00",
            "Time: 12:00:00",
            "99/99/2026 12:00:00",
            "12:61:00",
            "2026-03-01T12:00:00 noon",
        ] {
            assert!(!is_date(text.as_bytes()), "{text}");
        }
    }

    #[test]
    fn the_order_of_day_and_month_is_known_from_a_day_above_twelve() {
        for (text, expected) in [
            ("13/03/2026 12:00:00", Some(Some(DayFirst))),
            ("03-13-2026", Some(Some(MonthFirst))),
            ("03/04/2026 12:00:00", Some(None)),
            ("04/04/2026", Some(Some(DayFirst))),
            ("3.4.2026", None),
            ("2026/03/04", None),
            ("3 Apr 2026", None),
            ("12:00:00", None),
        ] {
            assert_eq!(order_of(text.as_bytes()), expected, "{text}");
        }
    }
}
