//! Columns with suitable unit prefixes, and estimates with their intervals.

use super::markup::{Column, significant};
use shell_data::wrench::{Axes, Axis};
use trial::{ConditionRow, Interval};

/// One prefix for all values of a column.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ColumnUnit {
    pub(super) factor: f64,
    /// The unit with its prefix, empty for pure numbers.
    pub(super) unit: String,
}

impl ColumnUnit {
    /// Chooses the prefix that gives the largest value one to three digits before the decimal point.
    pub(super) fn new(unit: &str, values: impl IntoIterator<Item = f64>) -> Self {
        let finite = values.into_iter().filter(|value| value.is_finite());
        let largest = finite.fold(0.0, |largest: f64, value| largest.max(value.abs()));
        let (factor, prefix) = match largest {
            _ if unit.is_empty() || largest == 0.0 => (1.0, ""),
            _ if largest >= 1e3 => (1e-3, "k"),
            _ if largest >= 1.0 => (1.0, ""),
            _ if largest >= 1e-3 => (1e3, "m"),
            _ => (1e6, "µ"),
        };
        Self { factor, unit: format!("{prefix}{unit}") }
    }

    pub(super) fn name(&self, name: &str) -> String {
        match self.unit.as_str() {
            "" => name.to_owned(),
            unit => format!("{name} ({unit})"),
        }
    }

    /// A value and its interval, `12.3 ± 0.4`, or `12.3 +0.5 −0.3` if the sides differ: two digits
    /// of the interval, and as many decimals of the value.
    pub(super) fn estimate(&self, value: Option<f64>, interval: Option<Interval>) -> String {
        let value = value.map(|value| value * self.factor);
        let Some((value, interval)) = value.zip(interval) else { return significant(value, 3) };
        let (down, up) = (value - interval.low * self.factor, interval.high * self.factor - value);
        let largest = down.abs().max(up.abs());
        if !(largest.is_finite() && value.is_finite()) || largest == 0.0 {
            return significant(value, 3);
        }
        let decimals = (1 - largest.log10().floor() as i32).clamp(0, 6) as usize;
        let text = |value: f64| format!("{value:.decimals$}").replace('-', "\u{2212}");
        let (down, up) = (text(down), text(up));
        match down == up {
            true => format!("{} ± {up}", text(value)),
            false => format!("{} +{up} \u{2212}{down}", text(value)),
        }
    }

    pub(super) fn mean(&self, row: &ConditionRow) -> String {
        self.estimate(Some(row.statistics.mean), row.statistics.mean_95)
    }

    pub(super) fn difference(&self, row: &ConditionRow) -> String {
        let difference = row.difference.as_ref();
        self.estimate(difference.map(|d| d.mean), difference.and_then(|d| d.mean_95))
    }

    pub(super) fn value(&self, value: Option<f64>) -> String {
        significant(value.map(|value| value * self.factor), 3)
    }

    /// Both ends in three digits.
    pub(super) fn range(&self, low: f64, high: f64) -> String {
        format!("{} … {}", self.value(Some(low)), self.value(Some(high)))
    }
}

impl Column {
    pub(super) fn measured(
        name: &str,
        unit: &str,
        values: impl Iterator<Item = Option<f64>> + Clone,
    ) -> Self {
        let scale = ColumnUnit::new(unit, values.clone().flatten());
        Self::numbers(&scale.name(name), values.map(|value| scale.value(value)))
    }
}

pub(super) struct AxisUnits([ColumnUnit; 2]);

impl AxisUnits {
    pub(super) fn new(figures: impl Fn(Axis) -> Vec<f64>) -> Self {
        Self([&Axis::ALL[..3], &Axis::ALL[3..]].map(|axes| {
            ColumnUnit::new(axes[0].unit(), axes.iter().flat_map(|&axis| figures(axis)))
        }))
    }

    pub(super) fn of(&self, axis: Axis) -> &ColumnUnit {
        &self.0[axis.index() / 3]
    }

    pub(super) fn column(
        &self,
        name: &str,
        axes: Axes,
        value: impl Fn(Axis) -> Option<f64>,
    ) -> Column {
        Column::numbers(name, axes.iter().map(|axis| self.of(axis).value(value(axis))))
    }

    pub(super) fn units(&self, axes: Axes) -> Column {
        Column::text("unit", axes.iter().map(|axis| &self.of(axis).unit))
    }
}

pub(super) fn axis_names(axes: Axes) -> Column {
    Column::text("axis", axes.iter().map(Axis::name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_column_has_one_unit_that_suits_its_largest_value() {
        let unit = |values: &[f64]| ColumnUnit::new("J", values.iter().copied()).unit;
        assert_eq!(unit(&[5.5e-6, -2e-6]), "µJ");
        assert_eq!(unit(&[5.5e-6, -0.012]), "mJ");
        assert_eq!([unit(&[0.0]), unit(&[3.0, f64::NAN]), unit(&[-4e3])], ["J", "J", "kJ"]);
        assert_eq!(ColumnUnit::new("", [1e-5]), ColumnUnit { factor: 1.0, unit: String::new() });
        assert_eq!(ColumnUnit::new("J", [2e-3]).name("drag energy"), "drag energy (mJ)");
    }

    #[test]
    fn an_interval_has_two_digits_and_says_where_its_sides_differ() {
        let scale = ColumnUnit::new("J", [0.012]);
        let of = |value, low, high| scale.estimate(Some(value), Some(Interval { low, high }));
        assert_eq!(of(0.0123, 0.0119, 0.0127), "12.30 ± 0.40");
        assert_eq!(of(-0.0123, -0.0143, -0.0113), "\u{2212}12.3 +1.0 \u{2212}2.0");
        assert_eq!(scale.estimate(Some(0.0123), None), "12.3");
        assert_eq!(scale.estimate(None, None), "–");
    }
}
