//! The clock of a log: the unit of numeric times, and the notation of dates.

use super::lines::{fields, lines};
use super::mapping::TimeUnit;
use crate::parse::date::{DateOrder, is_date, is_time_of_day, order_of};
use crate::parse::number::parse_field;
use shell_data::statistics::upper_median;

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct DateColumn {
    pub(crate) order: DateOrder,
    /// The first date, if no date shows whether the day or the month comes first.
    pub(crate) unclear: Option<String>,
    /// True for times without a date, which begin again at midnight.
    pub(crate) is_of_day: bool,
}

/// Fields of the time column in the first rows, without the empty ones.
pub(super) struct ClockFields(Vec<Vec<u8>>);

pub(super) const CLOCK_ROWS: usize = 64;

/// Longest plausible step between rows, s. A number with larger steps does not count from 1970.
const LONGEST_STEP_S: f64 = 100.0;

impl ClockFields {
    /// Takes the column at a position from rows. The last row may be cut off.
    pub(super) fn new(rows: &[u8], separator: u8, at: usize) -> Self {
        let whole = lines(rows, 0, 1)
            .enumerate()
            .filter(|(row, line)| *row == 0 || line.next < rows.len())
            .map(|(_, line)| fields(line.text, separator));
        let of_column = whole.filter_map(|mut fields| fields.get_mut(at).map(std::mem::take));
        Self(of_column.filter(|field| !field.trim_ascii().is_empty()).collect())
    }

    pub(super) fn first(&self) -> Option<&[u8]> {
        self.0.first().map(Vec::as_slice)
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &[u8]> {
        self.0.iter().map(Vec::as_slice)
    }

    pub(super) fn repeats(&self) -> bool {
        self.0.windows(2).any(|pair| pair[0] == pair[1])
    }

    pub(super) fn changes(&self) -> bool {
        self.0.first() != self.0.last()
    }

    /// Returns the notation of the times, if the first one is a date or a time of day. `order` is the user's choice.
    pub(super) fn dates(&self, order: Option<DateOrder>) -> Option<DateColumn> {
        let first = self.first().filter(|first| is_date(first))?;
        let is_of_day = is_time_of_day(first);
        let mut orders = self.0.iter().filter_map(|field| order_of(field));
        let found = order.or_else(|| orders.find_map(|order| order));
        let is_unclear = found.is_none() && order_of(first).is_some();
        let unclear = is_unclear.then(|| String::from_utf8_lossy(first).trim().to_owned());
        Some(DateColumn { order: found.unwrap_or(DateOrder::DayFirst), unclear, is_of_day })
    }

    /// Determines the unit of times that are numbers.
    ///
    /// # Errors
    /// The median step from row to row, if two units are possible.
    pub(super) fn unit(&self) -> Result<Option<TimeUnit>, f64> {
        if let Some(step) = self.step_in_days() {
            return Err(step);
        }
        let step = self.median_step();
        // A counter that starts at 0 may have as many digits, but its rows would be minutes apart in that unit.
        let is_dense =
            |unit: &TimeUnit| step.is_none_or(|step| step / unit.per_second() < LONGEST_STEP_S);
        match self.first().and_then(epoch_unit).filter(is_dense) {
            None => step.map(unit_by_step).transpose(),
            epoch => Ok(epoch),
        }
    }

    /// Returns the median step of times in this century that count days since 1900 (Excel) or year 0 (MATLAB's
    /// `datenum`). As seconds, such times would be less than 90 µs apart, or 1.2 ms if they have many decimals.
    fn step_in_days(&self) -> Option<f64> {
        let times: Vec<f64> =
            self.0.iter().take(CLOCK_ROWS).filter_map(|field| parse_field(field).ok()).collect();
        origin_of_days(*times.first()?)?;
        let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        steps.retain(|step| *step > 0.0);
        let step = upper_median(&mut steps)?;
        // Times in seconds have fewer decimals than times in days.
        let is_long = |field: &Vec<u8>| {
            field.iter().position(|byte| *byte == b'.').is_some_and(|at| field.len() - at > 8)
        };
        let most = if self.0.iter().any(is_long) { 1.2e-3 } else { 9e-5 };
        (step < most).then_some(step)
    }

    fn median_step(&self) -> Option<f64> {
        let times = self.0.iter().take(CLOCK_ROWS).filter_map(|field| parse_field(field).ok());
        let times: Vec<f64> = times.collect();
        if times.iter().any(|time| time.fract() != 0.0) {
            return None;
        }
        let steps = times.windows(2).map(|pair| pair[1] - pair[0]);
        let mut steps: Vec<f64> = steps.filter(|step| *step > 0.0).collect();
        upper_median(&mut steps)
    }
}

/// Returns the day number of 1970-01-01 in Excel's or MATLAB's count, if `day` in that count is in this century.
pub(super) fn origin_of_days(day: f64) -> Option<f64> {
    match day {
        36_526.0..73_051.0 => Some(25_569.0),
        730_486.0..767_011.0 => Some(719_529.0),
        _ => None,
    }
}

pub(super) fn is_since_1970(field: &[u8]) -> bool {
    epoch_unit(field).is_some()
}

/// Determines the unit of a clock that counts from 1970 by its number of digits. From 2001 to 2286, a time has ten
/// digits in s, thirteen in ms, and so on.
fn epoch_unit(first: &[u8]) -> Option<TimeUnit> {
    let time = parse_field(first).ok()?;
    let has_digits = |digits: i32| (10_f64.powi(digits - 1)..10_f64.powi(digits)).contains(&time);
    let mut units = TimeUnit::ALL.into_iter().zip([10, 13, 16, 19]);
    units.find(|(_, digits)| has_digits(*digits)).map(|(unit, _)| unit)
}

/// Determines the unit of integer times from their step per row, assumed to be between 100 µs and 2 s.
///
/// # Errors
/// The step, if two units are possible, or if the times may number the rows.
fn unit_by_step(step: f64) -> Result<TimeUnit, f64> {
    match step {
        2e3..5e5 => Ok(TimeUnit::Microsecond),
        2e6.. => Ok(TimeUnit::Nanosecond),
        _ => Err(step),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_counter_with_the_digits_of_a_clock_since_1970_is_told_by_its_steps() {
        for (start, step, expected) in [
            (2_000_000_000_u64, 1000, Err(1000.0)),
            (2_000_000_000, 5000, Ok(Some(TimeUnit::Microsecond))),
            (5_000_000_000_000, 10_000_000, Ok(Some(TimeUnit::Nanosecond))),
            (1_762_506_123, 60, Ok(Some(TimeUnit::Second))),
            (1_762_506_123_000, 10, Ok(Some(TimeUnit::Millisecond))),
        ] {
            let rows: String = (0..20).map(|row| format!("{}\n", start + row * step)).collect();
            let found = ClockFields::new(rows.as_bytes(), b',', 0).unit();
            assert_eq!(found, expected, "{start} {step}");
        }
    }

    #[test]
    fn clocks_from_1970_tell_their_unit_and_others_do_not() {
        for (first, unit) in [
            ("1762506123.5", Some(TimeUnit::Second)),
            ("1762506123500", Some(TimeUnit::Millisecond)),
            ("1762506123500123", Some(TimeUnit::Microsecond)),
            ("1762506123500123456", Some(TimeUnit::Nanosecond)),
            ("0.01", None),
            ("10000", None),
            ("x", None),
        ] {
            assert_eq!(epoch_unit(first.as_bytes()), unit, "{first}");
        }
    }

    fn clock(text: &str) -> ClockFields {
        ClockFields::new(text.as_bytes(), b',', 0)
    }

    #[test]
    fn whole_numbers_tell_their_unit_by_their_steps() {
        let head = |step: u64| -> String {
            (0..40)
                .map(|row| format!("{},7\n", if row > 20 { row - 20 } else { row } * step))
                .collect()
        };
        let unit = |text: &str| clock(text).median_step().map(unit_by_step);
        for (step, expected) in [
            (1, Err(1.0)),
            (60, Err(60.0)),
            (500, Err(500.0)),
            (10_000, Ok(TimeUnit::Microsecond)),
            (1_000_000, Err(1e6)),
            (10_000_000, Ok(TimeUnit::Nanosecond)),
        ] {
            assert_eq!(unit(&head(step)), Some(expected), "{step}");
        }
        assert_eq!(unit("1000.5,7\n12000.5,7\n24000.5,7\n"), None, "fractions are of seconds");
        assert_eq!(unit("x,7\n"), None);
    }

    #[test]
    fn dates_are_unclear_until_a_day_is_above_twelve() {
        let dates = |text: &str, order| clock(text).dates(order).unwrap();
        let unclear = dates("01/02/2026 10:00:00,7\n02/02/2026 10:00:00,8\n", None);
        assert_eq!(unclear.unclear.as_deref(), Some("01/02/2026 10:00:00"));
        let known = dates("01/02/2026,7\n02/13/2026,8\n02/14/2026,9\n", None);
        assert_eq!((known.order, known.unclear), (DateOrder::MonthFirst, None));
        let said = dates("01/02/2026,7\n", Some(DateOrder::DayFirst));
        assert_eq!((said.order, said.unclear), (DateOrder::DayFirst, None));
        assert!(dates("23:59:59.5,7\n", None).is_of_day);
        assert_eq!(clock("7,8\n").dates(None), None);
    }
}
