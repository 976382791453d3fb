//! Numbers with units: as values of options, and as they are printed.

use simulation::channel_study::{Dimension, GridAxis, Parameter, ParameterSpread, Uncertain};

/// Values of one list or range at most, so that a slip of a digit does not fill the memory.
const MOST_VALUES: f64 = 1e6;

/// Reads a quantity: a number with one of the units of its dimension, or SI without one.
pub(super) fn quantity(text: &str, dimension: Dimension) -> Result<f64, String> {
    let text = text.trim();
    let unit = dimension_units(dimension)
        .iter()
        .find_map(|(unit, power)| Some((text.strip_suffix(unit)?.trim(), *power)));
    let (number, power) = unit.unwrap_or((text, Some(0)));
    let value = match power {
        None => number.parse().map(f64::to_radians),
        // As a decimal, so that `0.12mm` is the same number as `0.00012`.
        Some(power) if !number.contains(['e', 'E']) => format!("{number}e{power}").parse(),
        Some(power) => number.parse().map(|value: f64| value * 10_f64.powi(power)),
    };
    let wanted = match dimension {
        Dimension::Length => "a length such as `8cm`, `80mm` or `0.08` (m)",
        Dimension::Pressure => "a pressure such as `5.3GPa` or `5.3e9` (Pa)",
        Dimension::Angle => "an angle such as `5deg` or `0.087` (rad)",
        Dimension::Number => "a number",
    };
    value.ok().filter(|value| value.is_finite()).ok_or_else(|| format!("expected {wanted}"))
}

/// Units with their powers of ten, `None` for degrees; longer names first where one ends with another.
fn dimension_units(dimension: Dimension) -> &'static [(&'static str, Option<i32>)] {
    match dimension {
        Dimension::Length => &[
            ("um", Some(-6)),
            ("µm", Some(-6)),
            ("mm", Some(-3)),
            ("cm", Some(-2)),
            ("m", Some(0)),
        ],
        Dimension::Pressure => &[("GPa", Some(9)), ("MPa", Some(6)), ("Pa", Some(0))],
        Dimension::Angle => &[("deg", None), ("°", None), ("rad", Some(0))],
        Dimension::Number => &[],
    }
}

/// A length.
pub(super) fn length(text: &str) -> Result<f64, String> {
    quantity(text, Dimension::Length)
}

/// A length above zero.
pub(super) fn positive_length(text: &str) -> Result<f64, String> {
    match length(text)? {
        value if value > 0.0 => Ok(value),
        _ => Err("expected a length above zero".to_owned()),
    }
}

/// A pressure.
pub(super) fn pressure(text: &str) -> Result<f64, String> {
    quantity(text, Dimension::Pressure)
}

/// An angle.
pub(super) fn angle(text: &str) -> Result<f64, String> {
    quantity(text, Dimension::Angle)
}

/// `NAME=FROM:TO:COUNT` or `NAME=VALUE,VALUE,…`.
pub(super) fn grid_axis(text: &str) -> Result<GridAxis, String> {
    let (parameter, values) = named(text)?;
    let of = |text| quantity(text, parameter.dimension);
    let values = match values.split(':').collect::<Vec<_>>()[..] {
        [list] => list.split(',').map(of).collect::<Result<Vec<_>, _>>()?,
        [from, to, count] => {
            let (from, to) = (of(from)?, of(to)?);
            let count: f64 = count.parse().map_err(|_| "expected a number of values".to_owned())?;
            if !(2.0..=MOST_VALUES).contains(&count) || count.fract() != 0.0 {
                return Err("expected a whole number of values, 2 or more".to_owned());
            }
            let last = count as usize - 1;
            let at = |i: usize| {
                if i == last { to } else { from + (to - from) * i as f64 / last as f64 }
            };
            (0..=last).map(at).collect()
        }
        _ => return Err("expected `NAME=FROM:TO:COUNT` or `NAME=VALUE,VALUE`".to_owned()),
    };
    Ok(GridAxis { parameter, values })
}

/// `NAME=SD`, or `NAME=SHARE%`.
pub(super) fn uncertain(text: &str) -> Result<Uncertain, String> {
    let (parameter, sd) = named(text)?;
    let (value, spread): (f64, fn(f64) -> ParameterSpread) = match sd.trim().strip_suffix('%') {
        Some(share) => (quantity(share, Dimension::Number)? / 100.0, ParameterSpread::Relative),
        None => (quantity(sd, parameter.dimension)?, ParameterSpread::Absolute),
    };
    if value < 0.0 {
        return Err("a standard deviation is not negative".to_owned());
    }
    Ok(Uncertain { parameter, spread: spread(value) })
}

fn named(text: &str) -> Result<(Parameter, &str), String> {
    let (name, value) = text.split_once('=').ok_or("expected `NAME=…`")?;
    let known = Parameter::named(name.trim()).ok_or_else(|| {
        let names: Vec<_> = Parameter::ALL.iter().map(|parameter| parameter.name).collect();
        format!("no parameter `{name}`; there are {}", names.join(", "))
    })?;
    Ok((known, value))
}

/// A length in cm, without digits that rounding made.
pub(super) fn cm(length_m: f64) -> String {
    let rounded = (length_m * 1e8).round() / 1e6;
    // Not −0.
    format!("{}", rounded + 0.0)
}

/// A share in %, without digits that rounding made.
pub(super) fn percent(share: f64) -> f64 {
    (share * 1e8).round() / 1e6
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_length_with_a_unit_is_the_length_without() {
        for text in ["8cm", "80mm", "0.08m", "0.08", " 8 cm "] {
            assert_eq!(length(text), Ok(0.08), "{text}");
        }
        assert_eq!(length("25mm"), Ok(0.025));
        assert_eq!(length("0.12mm"), Ok(0.000_12));
        assert_eq!(length("-1e1mm"), Ok(-0.01));
        assert_eq!(angle("180deg"), Ok(std::f64::consts::PI));
        assert_eq!(pressure("5.3GPa"), Ok(5.3e9));
        for text in ["", "cm", "8 ft", "nan", "1e400"] {
            assert!(length(text).is_err(), "{text}");
        }
    }

    #[test]
    fn a_grid_axis_is_a_range_or_a_list() {
        let values = |text| grid_axis(text).map(|axis| axis.values);
        assert_eq!(values("friction=0:1:5"), Ok(vec![0.0, 0.25, 0.5, 0.75, 1.0]));
        assert_eq!(values("width=8cm,60mm"), Ok(vec![0.08, 0.06]));
        for text in ["friction", "speed=1", "friction=0:1", "friction=0:1:1", "friction=0:1:2.5"] {
            assert!(values(text).is_err(), "{text}");
        }
    }

    #[test]
    fn a_spread_is_absolute_or_relative() {
        assert_eq!(uncertain("thickness=5um").unwrap().spread, ParameterSpread::Absolute(5e-6));
        assert_eq!(uncertain("modulus=10%").unwrap().spread, ParameterSpread::Relative(0.1));
        assert!(uncertain("modulus=-1%").is_err());
    }

    #[test]
    fn figures_are_printed_without_rounding_noise() {
        assert_eq!([cm(2.0 * (0.05 - 0.01)), cm(-1e-12), cm(0.0255)], ["8", "0", "2.55"]);
        assert_eq!(percent(0.95), 95.0);
    }
}
