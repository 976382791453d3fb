//! Clocks in several columns: a date beside a time of day, and seconds before their milli-, micro- or nanoseconds.
//! The time is the sum of the columns.

use super::clock::ClockFields;
use super::column_name::plain;
use super::lines::{fields, lines};
use crate::parse::date::{DateOrder, is_date, is_time_of_day, parse_date};
use crate::parse::number::parse_field;
use shell_data::unit::{Quantity, Scale, Unit};

/// A column that is added to the time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ClockPart {
    pub(crate) column: usize,
    pub(crate) values: PartValues,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum PartValues {
    Dates(DateOrder),
    Numbers(Scale),
}

/// Endings of the names of whole seconds.
const SECONDS: [&str; 3] = ["sec", "secs", "seconds"];

/// Returns the next column as the fraction of the seconds in column `at`, if the names of both say so: `secs` and
/// `nsecs`, `tv_sec` and `tv_usec`, `time` and `ms`.
pub(super) fn fraction_by_name(names: &[String], at: usize) -> Option<ClockPart> {
    let (seconds, fraction) = (plain(names.get(at)?), plain(names.get(at + 1)?));
    let stem_of_seconds = SECONDS.iter().find_map(|ending| seconds.strip_suffix(ending));
    let parts = ["", stem_of_seconds.unwrap_or_default()].into_iter().filter_map(|stem| {
        let unit = Unit::parse(fraction.strip_prefix(stem)?, Quantity::Time)?;
        Some(unit.scale.per).filter(|per| [1e3, 1e6, 1e9].contains(per))
    });
    let values = parts.map(|per| PartValues::Numbers(Scale::per_si(per))).next()?;
    Some(ClockPart { column: at + 1, values })
}

/// Returns true if the names of column `at` and the next are whole seconds and their fraction.
pub(super) fn has_fraction(names: &[String], at: usize) -> bool {
    let seconds = names.get(at).map(|name| plain(name)).unwrap_or_default();
    SECONDS.iter().any(|ending| seconds.ends_with(ending)) && fraction_by_name(names, at).is_some()
}

/// Finds the seconds of a ROS time in a log without names: a column of seconds since 1970, followed by nanoseconds and
/// a text (the name of a frame).
pub(super) fn nameless_stamp(rows: &[u8], separator: u8) -> Option<usize> {
    let rows: Vec<Vec<Vec<u8>>> =
        lines(rows, 0, 1).take(3).map(|line| fields(line.text, separator)).collect();
    let is_stamp = |row: &Vec<Vec<u8>>, at: usize| {
        super::clock::is_since_1970(&row[at])
            && whole(&row[at]).is_some()
            && whole(&row[at + 1]).is_some_and(|number| number < 1e9)
            && row.get(at + 2).is_some_and(|text| parse_field(text).is_err())
    };
    let columns = rows.iter().map(Vec::len).min()?;
    (0..columns.saturating_sub(1)).find(|&at| rows.iter().all(|row| is_stamp(row, at)))
}

pub(super) const OF_NANOSECONDS: PartValues = PartValues::Numbers(Scale::per_si(1e9));

fn whole(field: &[u8]) -> Option<f64> {
    parse_field(field).ok().filter(|number| number.fract() == 0.0 && *number >= 0.0)
}

/// Returns true if `part` is the fraction of column `seconds`. The seconds must be whole numbers or times of day
/// without decimals, the fraction less than a second, and the sum must not decrease.
pub(super) fn is_fraction(rows: &[u8], separator: u8, seconds: usize, part: ClockPart) -> bool {
    let PartValues::Numbers(scale) = part.values else { return false };
    let second = |field: &[u8]| {
        let time = || parse_date(field, DateOrder::DayFirst).ok();
        whole(field).or_else(|| time().filter(|time| time.fract() == 0.0))
    };
    let of_row = |fields: &[Vec<u8>]| {
        let second = second(fields.get(seconds)?)?;
        let fraction = whole(fields.get(part.column)?).filter(|number| *number < scale.per)?;
        Some(second + scale.to_si(fraction))
    };
    let mut times = Vec::new();
    for line in lines(rows, 0, 1).filter(|line| line.next < rows.len() || rows.ends_with(b"\n")) {
        let fields = fields(line.text, separator);
        match of_row(&fields) {
            Some(time) => times.push(time),
            // The row is bad or cut off.
            None if fields.len() <= part.column => {}
            None => return false,
        }
    }
    !times.is_empty() && times.windows(2).all(|pair| pair[0] <= pair[1])
}

/// Finds the column of dates if `clock` has times of day, or of times of day if it has dates, among the columns that are
/// `free`. In a workbook (`is_sheet`), times of day are numbers.
pub(super) fn date_part(
    rows: &[u8],
    separator: u8,
    clock: usize,
    free: &[usize],
    is_sheet: bool,
) -> Option<usize> {
    let of_day = |field: &[u8]| {
        let is_elapsed = |time: f64| is_sheet && (0.0..86_400.0).contains(&time);
        is_time_of_day(field) || parse_field(field).is_ok_and(is_elapsed)
    };
    let day = |field: &[u8]| {
        let day = parse_date(field, DateOrder::DayFirst)
            .or_else(|_| parse_date(field, DateOrder::MonthFirst));
        is_date(field) && !is_time_of_day(field) && day.is_ok_and(|time| time % 86_400.0 == 0.0)
    };
    let all = |at: usize, is: &dyn Fn(&[u8]) -> bool| {
        let column = ClockFields::new(rows, separator, at);
        column.first().is_some() && column.iter().all(is)
    };
    let wanted: &dyn Fn(&[u8]) -> bool = match () {
        () if all(clock, &of_day) => &day,
        () if all(clock, &day) => &of_day,
        () => return None,
    };
    let found = free.iter().copied().filter(|&at| all(at, wanted));
    found.min_by_key(|at| at.abs_diff(clock))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fractions_belong_to_the_seconds_before_them() {
        for (names, expected) in [
            ("sec,msec", Some(1e3)),
            ("tv_sec,tv_usec", Some(1e6)),
            ("header.stamp.secs,header.stamp.nsecs", Some(1e9)),
            ("stamp_sec,nanosec", Some(1e9)),
            ("Time,ms", Some(1e3)),
            ("time,params", None),
            ("time,s", None),
            ("time,min", None),
            ("sec,latency_ms", None),
        ] {
            let names: Vec<String> = names.split(',').map(str::to_owned).collect();
            let found = fraction_by_name(&names, 0).map(|part| part.values);
            let expected = expected.map(|per| PartValues::Numbers(Scale::per_si(per)));
            assert_eq!(found, expected, "{names:?}");
        }
    }

    #[test]
    fn fractions_are_spelled_as_units_of_time() {
        let of_thousand = [
            "milliseconds",
            "millisekunden",
            "millisecondes",
            "millisec",
            "millis",
            "msecs",
            "msec",
            "ms",
        ];
        let of_million = [
            "mikrosekunden",
            "microsecondes",
            "microseconds",
            "microsec",
            "micros",
            "usecs",
            "usec",
            "us",
        ];
        let of_billion = ["nanoseconds", "nanosecs", "nanosec", "nanos", "nsecs", "nsec", "ns"];
        let all = [(1e3, &of_thousand[..]), (1e6, &of_million), (1e9, &of_billion)];
        for (per, unit) in
            all.iter().flat_map(|(per, units)| units.iter().map(move |of| (*per, of)))
        {
            for names in [
                ["sec".to_owned(), (*unit).to_owned()],
                ["tv_sec".to_owned(), format!("tv_{unit}")],
            ] {
                let found = fraction_by_name(&names, 0).map(|part| part.values);
                assert_eq!(found, Some(PartValues::Numbers(Scale::per_si(per))), "{names:?}");
            }
        }
    }

    #[test]
    fn a_column_that_exceeds_a_second_is_no_fraction() {
        let part = ClockPart { column: 1, values: PartValues::Numbers(Scale::per_si(1e3)) };
        let fits = |rows: &str| is_fraction(rows.as_bytes(), b',', 0, part);
        assert!(fits("5,900\n6,0\n6,100\n"));
        assert!(fits("12:00:00,900\n12:00:01,0\n"));
        // Two whole clocks, fractions in the first, and a column of something else.
        assert!(!fits("5,5900\n6,6000\n"));
        assert!(!fits("5.9,900\n6.0,0\n"));
        assert!(!fits("5,900\n5,100\n"));
    }
}
