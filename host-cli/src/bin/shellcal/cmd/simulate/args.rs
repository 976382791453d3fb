//! The options of `shellcal simulate`: numbers with units, also as they are printed.

use std::ops::Bound;

use beam_channel::{Angle, Beam, Channel, Ellipse, Normal, Pose, Rules, Setup};
use simulation::channel_study::{Dimension, GridAxis, Parameter, ParameterSpread, Uncertain};

use crate::cmd::choices::{POSITIVE, number_in};
use crate::cmd::outputs::FigureArgs;
use crate::files::{InputPath, OutputPath};

/// Headings in help.
const GEOMETRY: &str = "Geometry";
const SWEEP: &str = "Sweep over positions";
const STUDY: &str = "Studies of parameters";

/// A share of a whole, between its ends.
const INSIDE: (Bound<f64>, Bound<f64>) = (Bound::Excluded(0.0), Bound::Excluded(1.0));

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal simulate                                    the paper's channels: 1, 2 and 3 cm
  shellcal simulate --width 7cm --output sweep.csv     drag at every mm of the way
  shellcal simulate --plot drag.svg                    the paper's figure
  shellcal simulate --at 10cm --deflection 2cm         every beam's force at one position
  shellcal simulate --grid friction=0:1:11 --grid rx=6cm,9cm
  shellcal simulate --uncertain thickness=5% --uncertain friction=0.05
  shellcal simulate --compare trials.csv               measured drags beside the model's")]
pub(crate) struct SimulateArgs {
    /// Deflections of the beams, d = ry − width/2 [default: 1cm,2cm,3cm]
    #[arg(long, value_name = "LENGTH", value_delimiter = ',', value_parser = length,
          allow_hyphen_values = true, conflicts_with = "width")]
    pub(super) deflection: Vec<f64>,

    /// Widths of the channel between opposite tips, instead of deflections
    #[arg(long, value_name = "LENGTH", value_delimiter = ',', value_parser = positive_length)]
    pub(super) width: Vec<f64>,

    /// Semi-axis of the body along its way
    #[arg(long, value_name = "LENGTH", default_value = "9cm", value_parser = length, help_heading = GEOMETRY)]
    rx: f64,

    /// Semi-axis of the body across its way
    #[arg(long, value_name = "LENGTH", default_value = "5cm", value_parser = length, help_heading = GEOMETRY)]
    ry: f64,

    /// A beam from base to tip
    #[arg(long, value_name = "LENGTH", default_value = "27mm", value_parser = length, help_heading = GEOMETRY)]
    beam_length: f64,

    /// A beam's upright side
    #[arg(long, value_name = "LENGTH", default_value = "30mm", value_parser = length, help_heading = GEOMETRY)]
    beam_width: f64,

    /// A beam's bending side
    #[arg(long, value_name = "LENGTH", default_value = "0.12mm", value_parser = length, help_heading = GEOMETRY)]
    thickness: f64,

    /// Flexural modulus of the beams
    #[arg(long, value_name = "PRESSURE", default_value = "5.3GPa", value_parser = |text: &str| quantity(text, Dimension::Pressure), help_heading = GEOMETRY)]
    modulus: f64,

    /// Kinetic friction of the beams on the shell
    #[arg(long, value_name = "NUMBER", default_value_t = 0.53, allow_hyphen_values = true, help_heading = GEOMETRY)]
    friction: f64,

    /// Beams of one row
    #[arg(long, value_name = "N", default_value_t = 11, help_heading = GEOMETRY)]
    beams: u32,

    /// Length of the channel: its beams are this over their number apart
    #[arg(long, value_name = "LENGTH", default_value = "28cm", value_parser = length, help_heading = GEOMETRY)]
    channel_length: f64,

    /// From one beam to the next, instead of the channel's length
    #[arg(long, value_name = "LENGTH", value_parser = length, help_heading = GEOMETRY)]
    spacing: Option<f64>,

    /// How far the body runs to the left of the channel's middle
    #[arg(long, value_name = "LENGTH", default_value = "0", value_parser = length, allow_hyphen_values = true, help_heading = GEOMETRY)]
    off_centre: f64,

    /// How far the body's nose is turned to the left
    #[arg(long, value_name = "ANGLE", default_value = "0", value_parser = |text: &str| quantity(text, Dimension::Angle), allow_hyphen_values = true, help_heading = GEOMETRY)]
    yaw: f64,

    /// Scale normal and tangent as the paper prints it, with its semi-axes swapped, not to length one
    #[arg(long, help_heading = GEOMETRY)]
    as_printed: bool,

    /// Scale the force so that its moment about the beam's base is that of its spring, which the paper's is not;
    /// implies `--true-angle`
    #[arg(long, conflicts_with = "as_printed", help_heading = GEOMETRY)]
    moment_balance: bool,

    /// Take the angle that a beam has turned beyond 90° too, not the paper's arcsine
    #[arg(long, help_heading = GEOMETRY)]
    true_angle: bool,

    /// Write drag, side force, moment and contacts at every position, as CSV; with `--grid`, the
    /// figures of every combination
    #[arg(long, short, value_name = "FILE", help_heading = SWEEP)]
    pub(super) output: Option<OutputPath>,

    /// Write the force of every beam that touches, at every position, as CSV
    #[arg(long, value_name = "FILE", help_heading = SWEEP)]
    pub(super) beam_forces: Option<OutputPath>,

    #[command(flatten, next_help_heading = SWEEP)]
    pub(super) figure: FigureArgs,

    /// Draw a measured trace too: CSV with columns `x_m` or, with `--speed`, `t_s`, and `drag_n` or
    /// `fx_n`, such as `shellcal convert` writes
    #[arg(long, value_name = "FILE", requires = "plot", help_heading = SWEEP)]
    pub(super) overlay: Vec<InputPath>,

    /// When the body of a measured trace with times first touched a beam, in s [default: at its
    /// first row]
    #[arg(long, value_name = "S", requires = "overlay", requires = "speed", help_heading = SWEEP)]
    #[arg(allow_hyphen_values = true)]
    pub(super) entry: Option<f64>,

    /// First position [default: 1 cm before the first contact]
    #[arg(long, value_name = "LENGTH", value_parser = length, allow_hyphen_values = true, help_heading = SWEEP)]
    pub(super) from: Option<f64>,

    /// Last position [default: 1 cm after the last contact]
    #[arg(long, value_name = "LENGTH", value_parser = length, allow_hyphen_values = true, help_heading = SWEEP)]
    pub(super) to: Option<f64>,

    /// From one position to the next
    #[arg(long, value_name = "LENGTH", default_value = "1mm", value_parser = positive_length, help_heading = SWEEP)]
    pub(super) step: f64,

    /// Speed of the body in m/s: adds the time, 0 at the first position
    #[arg(long, value_name = "M_PER_S", value_parser = number_in(POSITIVE, "expected a speed above zero, in m/s"), help_heading = SWEEP)]
    pub(super) speed: Option<f64>,

    /// Print the force of every beam that touches at this position
    #[arg(long, value_name = "LENGTH", value_parser = length, allow_hyphen_values = true, help_heading = SWEEP)]
    pub(super) at: Option<f64>,

    /// Every combination of values: NAME=FROM:TO:COUNT or NAME=VALUE,VALUE; of rx, ry, width,
    /// beam-length, beam-width, thickness, modulus, friction, spacing, off-centre, yaw
    #[arg(long, value_name = "NAME=VALUES", value_parser = grid_axis, conflicts_with_all = ["uncertain", "at", "compare", "beam_forces", "plot"], help_heading = STUDY)]
    pub(super) grid: Vec<GridAxis>,

    /// A parameter that is not known exactly: NAME=SD or NAME=PERCENT%, normal about its value;
    /// prints intervals by Monte Carlo
    #[arg(long, value_name = "NAME=SD", value_parser = uncertain, help_heading = STUDY)]
    pub(super) uncertain: Vec<Uncertain>,

    /// Channels to draw
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u64).range(2..=10_000_000), help_heading = STUDY)]
    pub(super) draws: u64,

    /// Seed of the draws
    #[arg(long, value_name = "N", default_value_t = 1, help_heading = STUDY)]
    pub(super) seed: u64,

    /// Share of the draws within an interval
    #[arg(long, value_name = "SHARE", default_value_t = 0.95, value_parser = number_in(INSIDE, "expected a number between 0 and 1"), help_heading = STUDY)]
    pub(super) level: f64,

    /// Table of trials with columns `condition` and `drag_mean_n`, as CSV: prints measured and
    /// simulated drag of every condition. A condition is a deflection (`3 cm`) or `free`
    #[arg(long, value_name = "FILE", help_heading = "Measured trials")]
    pub(super) compare: Option<InputPath>,

    /// The width of a condition's channel, where its name does not tell: NAME=WIDTH
    #[arg(long, value_name = "NAME=WIDTH", value_parser = condition, requires = "compare", help_heading = "Measured trials")]
    pub(super) condition: Vec<(String, f64)>,
}

impl SimulateArgs {
    /// The set-up of every channel, in the order given.
    pub(super) fn setups(&self) -> Vec<Setup> {
        let base = self.setup();
        if !self.width.is_empty() {
            return self.width.iter().map(|&width| of_width(&base, width)).collect();
        }
        let deflections = match &self.deflection[..] {
            [] => &[0.01, 0.02, 0.03],
            given => given,
        };
        deflections.iter().map(|&depth| of_deflection(&base, depth)).collect()
    }

    /// The set-up but for the channel's width, by default that of the paper.
    pub(super) fn setup(&self) -> Setup {
        let pitch_m = self.spacing.unwrap_or(self.channel_length / f64::from(self.beams));
        let is_true = self.true_angle || self.moment_balance;
        let angle = if is_true { Angle::True } else { Angle::Folded };
        let normal = match (self.as_printed, self.moment_balance) {
            (true, _) => Normal::AsPrinted,
            (_, true) => Normal::MomentBalance,
            _ => Normal::Unit,
        };
        Setup {
            ellipse: Ellipse { semi_length_m: self.rx, semi_width_m: self.ry },
            beam: Beam {
                length_m: self.beam_length,
                width_m: self.beam_width,
                thickness_m: self.thickness,
                flexural_modulus_pa: self.modulus,
                friction: self.friction,
            },
            channel: Channel { beams: self.beams, pitch_m, ..Channel::default() },
            pose: Pose { offset_m: self.off_centre, yaw_rad: self.yaw },
            rules: Rules { angle, normal },
        }
    }
}

/// `setup` with a channel that deflects the beams by `deflection_m`.
pub(super) fn of_deflection(setup: &Setup, deflection_m: f64) -> Setup {
    // Doubled first: decimal widths then come out as they are written.
    of_width(setup, 2.0 * setup.ellipse.semi_width_m - 2.0 * deflection_m)
}

/// `setup` with a channel of `width_m`.
pub(super) fn of_width(setup: &Setup, width_m: f64) -> Setup {
    Setup { channel: Channel { width_m, ..setup.channel }, ..*setup }
}

fn condition(text: &str) -> Result<(String, f64), String> {
    let (name, width) = text.rsplit_once('=').ok_or("expected `NAME=WIDTH`")?;
    Ok((name.trim().to_owned(), positive_length(width)?))
}

/// Values of one list or range at most, so that a slip of a digit does not fill the memory.
const MOST_VALUES: f64 = 1e6;

/// Reads a quantity: a number with one of the units of its dimension, or SI without one.
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
fn positive_length(text: &str) -> Result<f64, String> {
    match length(text)? {
        value if value > 0.0 => Ok(value),
        _ => Err("expected a length above zero".to_owned()),
    }
}

/// `NAME=FROM:TO:COUNT` or `NAME=VALUE,VALUE,…`.
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

/// `NAME=SD`, or `NAME=SHARE%`.
fn uncertain(text: &str) -> Result<Uncertain, String> {
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
