//! The options of `shellcal simulate`.

use std::ops::Bound;

use beam_channel::{Angle, Beam, Channel, Ellipse, Normal, Pose, Rules, Setup};
use simulation::channel_study::{GridAxis, Uncertain};

use super::quantity::{angle, grid_axis, length, positive_length, pressure, uncertain};
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
    #[arg(long, value_name = "PRESSURE", default_value = "5.3GPa", value_parser = pressure, help_heading = GEOMETRY)]
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
    #[arg(long, value_name = "ANGLE", default_value = "0", value_parser = angle, allow_hyphen_values = true, help_heading = GEOMETRY)]
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
