//! Why poses do not give a payload.

use shell_data::hint::Hint;

/// The least poses: each gives six equations, and a residual needs some to spare.
pub(super) const LEAST_POSES: usize = 4;

/// Poses that do not give what a sensor carries.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PayloadError {
    /// So many are too few.
    #[error("`{0}` poses are too few to tell what the sensor carries, `{LEAST_POSES}` are needed")]
    TooFewPoses(usize),
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
    /// A value of a pose, counted from 1, is infinite or NaN.
    #[error("pose `{0}` has a value that is not finite")]
    NotFinite(usize),
}

impl Hint for PayloadError {
    fn hint(&self) -> Option<String> {
        let text = match self {
            Self::NoMass { .. } => {
                "does gravity point down in its columns, and is the wrench the load on the sensor, not its reaction?"
            }
            Self::NotFinite(_) => "leave the row out, or such rows with `--skip-bad-rows`",
            _ => {
                "record the sensor at rest in six directions or more: upright, upside down, on each side"
            }
        };
        Some(text.to_owned())
    }
}
