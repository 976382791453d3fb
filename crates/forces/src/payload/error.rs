//! Why poses do not give a payload.

use shell_data::hint::Hint;

/// Poses that do not give what a sensor carries.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PayloadError {
    /// Too few.
    #[error("`{found}` poses are too few to tell what the sensor carries, `{needed}` are needed")]
    TooFewPoses {
        /// How many there are.
        found: usize,
        /// How many it takes.
        needed: usize,
    },
    /// Gravity has always pulled the same way, or its directions lie on a line.
    #[error(
        "gravity turns too little in the sensor's frame: by `{spread_deg:.2}`° in all but one direction, \
         which tells {lost}"
    )]
    SameOrientation {
        /// The spread of directions, in degrees.
        spread_deg: f64,
        /// What is not determined.
        lost: &'static str,
    },
    /// A body that falls upwards.
    #[error(
        "the mass comes out as `{mass_kg:.4}` kg (standard error {standard_error_kg:.4}): the forces do not \
         follow gravity"
    )]
    NoMass {
        /// The mass.
        mass_kg: f64,
        /// Its standard error.
        standard_error_kg: f64,
    },
    /// A value that is infinite or NaN.
    #[error("pose `{pose}` has a value that is not finite")]
    NotFinite {
        /// The pose, from 1.
        pose: usize,
    },
}

impl Hint for PayloadError {
    fn hint(&self) -> Option<String> {
        let text = match self {
            Self::NoMass { .. } => {
                "does gravity point down in its columns, and is the wrench the load on the sensor, not its reaction?"
            }
            Self::NotFinite { .. } => "leave the row out, or such rows with `--skip-bad-rows`",
            _ => {
                "record the sensor at rest in six directions or more: upright, upside down, on each side"
            }
        };
        Some(text.to_owned())
    }
}
