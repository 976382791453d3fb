//! Inputs of the model, and errors for invalid ones.

use core::fmt;

/// Lengths outside this range, m, are probably unit errors; those within cannot overflow.
const LENGTHS: (f64, f64) = (1e-6, 1e6);

/// Minimum friction if bar and spring balance: below it, the force at a release is unbounded.
pub(crate) const LEAST_FRICTION: f64 = 1e-3;

/// All inputs of the model. The default is the paper's robot and obstacle track (Table I) in the
/// channel of 1 cm deflection (Table II).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Setup {
    pub ellipse: Ellipse,
    pub beam: Beam,
    pub channel: Channel,
    pub pose: Pose,
    pub rules: Rules,
}

/// The body seen from above.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ellipse {
    /// `R_x`, in m.
    pub semi_length_m: f64,
    /// `R_y`, in m.
    pub semi_width_m: f64,
}

/// A beam: a rigid bar on a torsional spring at its base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// `L`, from base to tip, in m.
    pub length_m: f64,
    /// `w`, height of the cross-section, in m.
    pub width_m: f64,
    /// `t`, in the direction of bending, in m.
    pub thickness_m: f64,
    /// `E`, in Pa.
    pub flexural_modulus_pa: f64,
    /// `μ_k`, kinetic, on the shell.
    pub friction: f64,
}

/// Two rows of beams, opposite each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Channel {
    /// `b`, between the tips of opposite beams, in m.
    pub width_m: f64,
    /// `n`, in a row.
    pub beams: u32,
    /// Between neighbouring beams of a row, in m.
    pub pitch_m: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wall {
    /// The wall at positive y: the paper's top beams.
    Left,
    /// The wall at negative y.
    Right,
}

impl Wall {
    pub const BOTH: [Self; 2] = [Self::Left, Self::Right];

    pub(crate) fn sign(self) -> f64 {
        if self == Self::Left { 1.0 } else { -1.0 }
    }
}

impl fmt::Display for Wall {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if *self == Self::Left { "left" } else { "right" })
    }
}

/// Position and direction of the body; the paper's runs along the middle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Offset of the body's middle to the left of the channel's, in m.
    pub offset_m: f64,
    /// Turn of the nose to the left, in rad.
    pub yaw_rad: f64,
}

/// Interpretations of the paper's equations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rules {
    pub angle: Angle,
    pub normal: Normal,
}

/// Definition of a beam's deflection from the position of its tip.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Angle {
    /// The paper's arcsine of the tip's displacement: a beam beyond 90° seems to have turned less.
    #[default]
    Folded,
    /// The angle that the beam has turned.
    True,
}

/// Scaling of the body's normal and tangent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Normal {
    /// Unit length.
    #[default]
    Unit,
    /// The denominator printed in the paper, with swapped semi-axes: from `R_y/R_x` at the nose to
    /// `R_x/R_y` at the flank.
    AsPrinted,
    /// The balance of moments about the beam's base, between force and spring; the paper's force
    /// balances only if it is perpendicular to the beam. Belongs to [`Angle::True`]. Without
    /// friction, the force is unbounded at the release.
    MomentBalance,
    /// Force that bends a clamped beam to its tip's position: Euler's elastica. Tip contact only.
    Elastica,
    /// [`Elastica`](Self::Elastica) for a plate, which also touches with its face.
    Plate,
}

impl Default for Ellipse {
    fn default() -> Self {
        Self { semi_length_m: 0.09, semi_width_m: 0.05 }
    }
}

impl Default for Beam {
    fn default() -> Self {
        Self {
            length_m: 0.027,
            width_m: 0.03,
            thickness_m: 0.000_12,
            flexural_modulus_pa: 5.3e9,
            friction: 0.53,
        }
    }
}

impl Default for Channel {
    fn default() -> Self {
        Self { width_m: 0.08, beams: 11, pitch_m: 0.28 / 11.0 }
    }
}

impl Beam {
    /// Returns `k_t = E·I/L` in N·m/rad, with `I = w·t³/12`.
    pub fn torsional_stiffness(&self) -> f64 {
        let Self { length_m, width_m, thickness_m, flexural_modulus_pa, .. } = *self;
        flexural_modulus_pa * width_m * (thickness_m * thickness_m * thickness_m)
            / (12.0 * length_m)
    }
}

impl Setup {
    /// Largest deflection of the tips by a centred body, `d = R_y − b/2`, m; positive if it
    /// touches.
    pub fn deflection_m(&self) -> f64 {
        self.ellipse.semi_width_m - 0.5 * self.channel.width_m
    }

    /// # Errors
    /// [`SetupError::OutOfRange`] for the first quantity out of range.
    pub(crate) fn check(&self) -> Result<(), SetupError> {
        let Self { ellipse, beam, channel, pose, rules } = self;
        let least_friction = match rules.normal {
            Normal::Unit | Normal::AsPrinted | Normal::Elastica | Normal::Plate => 0.0,
            Normal::MomentBalance => LEAST_FRICTION,
        };
        let quarter_turn = core::f64::consts::FRAC_PI_2;
        for (quantity, value, (least, greatest)) in [
            ("body's semi-length in m", ellipse.semi_length_m, LENGTHS),
            ("body's semi-width in m", ellipse.semi_width_m, LENGTHS),
            ("beam's length in m", beam.length_m, LENGTHS),
            ("beam's width in m", beam.width_m, LENGTHS),
            ("beam's thickness in m", beam.thickness_m, (1e-9, LENGTHS.1)),
            ("flexural modulus in Pa", beam.flexural_modulus_pa, (1.0, 1e15)),
            ("friction coefficient", beam.friction, (least_friction, 100.0)),
            ("channel's width in m", channel.width_m, LENGTHS),
            ("number of beams", f64::from(channel.beams), (1.0, 1e9)),
            ("spacing of the beams in m", channel.pitch_m, LENGTHS),
            ("offset in m", pose.offset_m, (-LENGTHS.1, LENGTHS.1)),
            ("yaw in rad", pose.yaw_rad, (-quarter_turn, quarter_turn)),
        ] {
            if !(least..=greatest).contains(&value) {
                return Err(SetupError::OutOfRange { quantity, value, least, greatest });
            }
        }
        Ok(())
    }
}

/// A set-up that has no solution in this model.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum SetupError {
    /// The named quantity is NaN, or outside its range from `least` to `greatest`, SI.
    OutOfRange { quantity: &'static str, value: f64, least: f64, greatest: f64 },
    /// The body reaches so far beyond a wall's tips, m, that the beams cannot turn away: the depth
    /// must be less than twice their length.
    Jams { wall: Wall, depth_m: f64, beam_length_m: f64 },
    /// Friction holds a tip of a wall if bar and spring, or a clamped beam, balance.
    Locks { wall: Wall, friction: f64 },
    /// The body, this far past the tips, m, presses a wall's plates against the line of bases.
    Flattens { wall: Wall, depth_m: f64, beam_length_m: f64 },
    /// The body's middle, this far to the left, m, is beyond the line of a wall's tips.
    BeyondTips { wall: Wall, offset_m: f64, half_width_m: f64 },
}

impl SetupError {
    /// Advice in terms of the program's options.
    #[must_use]
    pub fn hint(&self) -> Option<&'static str> {
        Some(match self {
            Self::Jams { .. } | Self::Flattens { .. } => {
                "give a wider channel (less `--deflection`) or longer beams (`--beam-length`)"
            }
            Self::Locks { .. } => {
                "give less friction (`--friction`) or a wider channel (less `--deflection`)"
            }
            Self::BeyondTips { .. } => "the offset is a length: `--off-centre 5mm`",
            _ => return None,
        })
    }
}

impl fmt::Display for SetupError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::OutOfRange { quantity, value, least, greatest } => {
                write!(f, "the {quantity} is {value}: expected {least} to {greatest}")
            }
            Self::Jams { wall, depth_m, beam_length_m } => write!(
                f,
                "the body jams: it reaches {:.2} mm past the tips of the {wall} beams, and at \
                 twice their length of {:.2} mm or more they cannot turn out of its way",
                1e3 * depth_m,
                1e3 * beam_length_m
            ),
            Self::Flattens { wall, depth_m, beam_length_m } => write!(
                f,
                "the body jams: it reaches {:.2} mm past the tips of the {wall} plates, and at their length of \
                 {:.2} mm or more it presses their faces against the line of their bases",
                1e3 * depth_m,
                1e3 * beam_length_m
            ),
            Self::Locks { wall, friction } => write!(
                f,
                "the body jams: at a friction coefficient of {friction} the tips of the {wall} beams do not slide \
                 along it"
            ),
            Self::BeyondTips { wall, offset_m, half_width_m } => write!(
                f,
                "the body's middle lies {:.2} mm off the channel's and so beyond the tips of the \
                 {wall} beams, which are {:.2} mm off it",
                1e3 * offset_m,
                1e3 * half_width_m
            ),
        }
    }
}

impl core::error::Error for SetupError {}
