//! What cannot be modelled.

use core::fmt;

use crate::Wall;

/// A set-up that has no solution in this model.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum SetupError {
    /// A quantity is not a number, or outside the range in which it makes sense.
    OutOfRange {
        /// What it is.
        quantity: &'static str,
        /// Its value, SI.
        value: f64,
        /// The smallest value that is taken.
        least: f64,
        /// The largest value that is taken.
        greatest: f64,
    },
    /// The body reaches so far past a wall's beam tips that the beams cannot turn out of its way.
    Jams {
        /// Which wall.
        wall: Wall,
        /// How far the body reaches past the line of the tips, in m.
        depth_m: f64,
        /// The length of a beam in m; the depth must be less than twice this.
        beam_length_m: f64,
    },
    /// Friction holds a tip where bar and spring balance: the body cannot pass.
    Locks {
        /// Which wall.
        wall: Wall,
        /// The coefficient of friction.
        friction: f64,
    },
    /// The middle of the body lies on or beyond the line of a wall's beam tips.
    BeyondTips {
        /// Which wall.
        wall: Wall,
        /// How far the body's middle is from the channel's, towards the left, in m.
        offset_m: f64,
        /// Half the width of the channel in m.
        half_width_m: f64,
    },
}

impl SetupError {
    /// What to do about it, in the options of the program.
    #[must_use]
    pub fn hint(&self) -> Option<&'static str> {
        Some(match self {
            Self::Jams { .. } => {
                "give a wider channel (`--width`) or longer beams (`--beam-length`)"
            }
            Self::Locks { .. } => {
                "give less friction (`--friction`) or a wider channel (`--width`)"
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
