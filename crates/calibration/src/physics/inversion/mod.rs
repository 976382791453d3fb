//! From frames of readings to wrenches.
//!
//! ```text
//! minimise  Σ (yᵢ − fᵢ(x))²/vᵢ + λ·xᵀΣ_w⁻¹x      vᵢ = σ² + τ²·(dfᵢ/dq)² + gᵢᵀCᵢgᵢ
//! ```
//!
//! by Gauss's and Newton's steps with `v` from the step before. `gᵀCg` is what the parameters of the
//! sensor are unsure about there, so a sensor counts little where it was not trained; on a plateau
//! `df/dx` is nothing, so a saturated sensor drops out by itself. The start inverts each curve for its
//! displacement and solves the linear problem that is left. Nothing is carried from frame to frame:
//! results do not depend on the order of rows, on the rows beside them or on the width of vectors.
//!
//! Standard errors are those of Laplace's approximation, the curvature at the end (MacKay, Neural
//! Computation 4, 1992).

mod lane_cholesky;
mod newton;
mod ready;

use pulp::Arch;

use self::newton::Invert;
use self::ready::Ready;
use super::model::PhysicsModel;
use super::noise::Noise;
use shell_data::wrench::PerAxis;

/// A wrench and how far to trust it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// N and N·m.
    pub wrench: PerAxis<f64>,
    /// N and N·m.
    pub standard_errors: PerAxis<f64>,
    /// What is to be said of the frame.
    pub flags: Flags,
}

/// What is to be said of a frame. Masks have bit `i` for channel `i`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flags {
    /// Channels on a plateau of their curve: they say nothing about this wrench.
    pub saturated: u16,
    /// Channels that were left out: constant in the training data, or not a number in this frame.
    pub left_out: u16,
    /// Channels whose reading is far from what the others say.
    pub misfit: u16,
    /// Whether the steps came to rest.
    pub converged: bool,
}

/// The wrenches of some rows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Estimates {
    /// N and N·m.
    pub wrench: PerAxis<Vec<f64>>,
    /// N and N·m.
    pub standard_errors: PerAxis<Vec<f64>>,
    /// What is to be said of each row.
    pub flags: Vec<Flags>,
}

/// A model made ready to convert frames.
#[derive(Clone, Debug, PartialEq)]
pub struct Inversion {
    sensors: Vec<Ready>,
    channels: usize,
    scale: PerAxis<f64>,
    /// `λ·Σ_w⁻¹`.
    prior: PerAxis<PerAxis<f64>>,
    noise: Noise,
    dead: u16,
}

impl Inversion {
    /// Makes a model ready.
    pub fn new(model: &PhysicsModel) -> Self {
        let all = ((1_u32 << model.channels) - 1) as u16;
        let known = model.sensors.iter().fold(0, |mask, sensor| mask | 1 << sensor.channel);
        Self {
            sensors: model.sensors.iter().map(|s| Ready::new(s, &model.noise)).collect(),
            channels: model.channels,
            scale: model.wrench_scale,
            prior: model.load_precision.map(|row| row.map(|x| model.lambda * x)),
            noise: model.noise,
            dead: all & !known,
        }
    }

    /// The wrench of one frame of readings, in counts.
    ///
    /// # Panics
    /// If there are not as many readings as the model has channels.
    pub fn invert(&self, readings: &[f64]) -> Estimate {
        let columns: Vec<Vec<f64>> = readings.iter().map(|&reading| vec![reading]).collect();
        self.estimates(&columns).row(0)
    }

    /// The wrenches of all rows. `readings` has one column per channel, in counts.
    ///
    /// # Panics
    /// If `readings` are not the model's channels, or of different lengths.
    pub fn estimates(&self, readings: &[Vec<f64>]) -> Estimates {
        assert_eq!(readings.len(), self.channels, "one column per channel");
        let rows = readings.first().map_or(0, Vec::len);
        assert!(readings.iter().all(|column| column.len() == rows), "columns of one length");
        let column = || vec![0.0; rows];
        let mut out = Estimates {
            wrench: std::array::from_fn(|_| column()),
            standard_errors: std::array::from_fn(|_| column()),
            flags: vec![Flags::default(); rows],
        };
        Arch::new().dispatch(Invert { inversion: self, readings, out: &mut out });
        out
    }
}

impl Estimates {
    /// One row.
    pub fn row(&self, row: usize) -> Estimate {
        let of = |columns: &PerAxis<Vec<f64>>| std::array::from_fn(|axis| columns[axis][row]);
        Estimate {
            wrench: of(&self.wrench),
            standard_errors: of(&self.standard_errors),
            flags: self.flags[row],
        }
    }
}
