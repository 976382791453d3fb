//! Options of all commands that simulate the sensor: the seeds, the noise, and the file.

use crate::files::OutputPath;

/// The simulated unit, and one of its recordings.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct SeedArgs {
    /// Seed of the recording: its loads, noise, light, mounting and scatter [default: 1]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(..1 << 60))]
    seed: Option<u64>,

    /// Seed of the unit: its springs, reflectors and gains; 1 is the unit of the shipped data [default: 1]
    #[arg(long, value_name = "N")]
    unit_seed: Option<u64>,
}

impl SeedArgs {
    pub(super) fn seed(&self) -> u64 {
        self.seed.unwrap_or(1)
    }

    pub(super) fn unit_seed(&self) -> u64 {
        self.unit_seed.unwrap_or(1)
    }

    pub(super) fn is_given(&self) -> bool {
        self.seed.is_some() || self.unit_seed.is_some()
    }
}

/// The noise of a simulated sensor.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct NoiseArgs {
    /// Factor on all random noise; 0 for none [default: 1]
    #[arg(long, value_name = "FACTOR", allow_negative_numbers = true)]
    noise_scale: Option<f64>,
}

impl NoiseArgs {
    pub(super) fn scale(&self) -> f64 {
        self.noise_scale.unwrap_or(1.0)
    }

    pub(super) fn is_given(&self) -> bool {
        self.noise_scale.is_some()
    }
}

/// The file of a recording.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct WrittenArg {
    /// File to write [default: standard output]
    #[arg(long, short, value_name = "FILE")]
    pub(super) output: Option<OutputPath>,
}
