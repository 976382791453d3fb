//! The options of `shellcal simulate`: numbers with units, also as they are printed.

use beam_channel::{Beam, Channel, Ellipse, Normal, Rules, Setup};
use clap::ValueEnum;
use serde::Serialize;
use simulation::channel_study::{Dimension, GridAxis, Parameter};

use crate::cmd::outputs::FigureArgs;
use crate::files::OutputPath;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal simulate                                    the paper's channels: 1, 2 and 3 cm
  shellcal simulate --deflection 15mm --output sweep.csv   drag at every mm of the way
  shellcal simulate --plot drag.svg                    the paper's figure
  shellcal simulate --beam clamped                     plates that bend, in place of bars on springs
  shellcal simulate --grid friction=0:1:11 --grid rx=6cm,9cm")]
pub(crate) struct SimulateArgs {
    /// Deflections of the beams, d = ry − width/2
    #[arg(long, value_name = "LENGTH", value_delimiter = ',', value_parser = length,
          allow_hyphen_values = true, default_value = "1cm,2cm,3cm")]
    pub(super) deflection: Vec<f64>,

    /// Semi-axis of the body along its path
    #[arg(long, value_name = "LENGTH", default_value = "9cm", value_parser = length)]
    rx: f64,

    /// Semi-axis of the body across its path
    #[arg(long, value_name = "LENGTH", default_value = "5cm", value_parser = length)]
    ry: f64,

    /// Length of a beam from base to tip
    #[arg(long, value_name = "LENGTH", default_value = "27mm", value_parser = length)]
    beam_length: f64,

    /// Thickness of a beam in the bending direction
    #[arg(long, value_name = "LENGTH", default_value = "0.12mm", value_parser = length)]
    thickness: f64,

    /// Flexural modulus of the beams
    #[arg(long, value_name = "PRESSURE", default_value = "5.3GPa", value_parser = |text: &str| quantity(text, Dimension::Pressure))]
    modulus: f64,

    /// Kinetic friction of the beams on the shell
    #[arg(long, value_name = "NUMBER", default_value_t = 0.53, allow_hyphen_values = true)]
    friction: f64,

    /// How a beam gives way
    #[arg(long, value_enum, default_value_t)]
    pub(super) beam: BeamKind,

    /// Distance between the eleven beams of a row [default: 28 cm / 11]
    #[arg(long, value_name = "LENGTH", value_parser = length)]
    spacing: Option<f64>,

    /// Every combination of values: NAME=FROM:TO:COUNT or NAME=VALUE,VALUE; of rx, ry, width, beam-length,
    /// beam-width, thickness, modulus, friction, spacing, off-centre, yaw
    #[arg(long, value_name = "NAME=VALUES", value_parser = grid_axis, conflicts_with = "plot")]
    pub(super) grid: Vec<GridAxis>,

    /// Write drag, side force, moment and contacts at every mm of the path, as CSV; with `--grid`, the
    /// figures of every combination
    #[arg(long, short, value_name = "FILE")]
    pub(super) output: Option<OutputPath>,

    #[command(flatten)]
    pub(super) figure: FigureArgs,
}

impl SimulateArgs {
    pub(super) fn setups(&self) -> Vec<Setup> {
        let base = self.setup();
        let of_deflection = |depth_m: &f64| {
            // Double before subtracting, so that decimal widths come out as written.
            let width_m = 2.0 * base.ellipse.semi_width_m - 2.0 * depth_m;
            Setup { channel: Channel { width_m, ..base.channel }, ..base }
        };
        self.deflection.iter().map(of_deflection).collect()
    }

    /// The set-up without the channel's width, by default that of the paper.
    pub(super) fn setup(&self) -> Setup {
        let usual = Setup::default();
        let pitch_m = self.spacing.unwrap_or(usual.channel.pitch_m);
        Setup {
            ellipse: Ellipse { semi_length_m: self.rx, semi_width_m: self.ry },
            beam: Beam {
                length_m: self.beam_length,
                thickness_m: self.thickness,
                flexural_modulus_pa: self.modulus,
                friction: self.friction,
                ..usual.beam
            },
            channel: Channel { pitch_m, ..usual.channel },
            rules: Rules { normal: self.beam.normal(), ..usual.rules },
            ..usual
        }
    }
}

/// Mechanics of a beam.
#[derive(Clone, Copy, Debug, Default, ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum BeamKind {
    /// A rigid bar on a torsional spring, as in the paper
    #[default]
    Hinged,
    /// A beam clamped at its base that bends, of the same bending stiffness, and touches by its tip
    Clamped,
    /// A clamped plate, which also touches with its face where it bends far enough
    Plate,
}

impl BeamKind {
    fn normal(self) -> Normal {
        match self {
            Self::Hinged => Normal::Unit,
            Self::Clamped => Normal::Elastica,
            Self::Plate => Normal::Plate,
        }
    }
}

/// Maximum number of values in a list or range: a typing error must not fill the memory.
const MOST_VALUES: f64 = 1e6;

/// Parses a quantity: a number with one of the units of its dimension, or in SI units without one.
fn quantity(text: &str, dimension: Dimension) -> Result<f64, String> {
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

/// Units with their powers of ten, `None` for degrees. If one name ends with another, the longer comes first.
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

fn length(text: &str) -> Result<f64, String> {
    quantity(text, Dimension::Length)
}

/// Parses `NAME=FROM:TO:COUNT` or `NAME=VALUE,VALUE,…`.
fn grid_axis(text: &str) -> Result<GridAxis, String> {
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

fn named(text: &str) -> Result<(Parameter, &str), String> {
    let (name, value) = text.split_once('=').ok_or("expected `NAME=…`")?;
    let known = Parameter::named(name.trim()).ok_or_else(|| {
        let names: Vec<_> = Parameter::ALL.iter().map(|parameter| parameter.name).collect();
        format!("no parameter `{name}`; there are {}", names.join(", "))
    })?;
    Ok((known, value))
}

/// A length in cm, without rounding errors in its digits.
pub(super) fn cm(length_m: f64) -> String {
    let rounded = (length_m * 1e8).round() / 1e6;
    // Avoid −0.
    format!("{}", rounded + 0.0)
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
        assert_eq!(quantity("180deg", Dimension::Angle), Ok(std::f64::consts::PI));
        assert_eq!(quantity("5.3GPa", Dimension::Pressure), Ok(5.3e9));
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
    fn figures_are_printed_without_rounding_noise() {
        assert_eq!([cm(2.0 * (0.05 - 0.01)), cm(-1e-12), cm(0.0255)], ["8", "0", "2.55"]);
    }
}
