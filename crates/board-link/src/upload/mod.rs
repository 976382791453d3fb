//! A calibration of the host as one for the board.

mod physics;

use shared_proto::{AXES, CHANNELS, COUNTS_PER_LSB, Cubic, FEATURES};
use shell_data::hint::Hint;

use calibration::{Basis, Calibration, Kind, Polynomial};
use shell_data::wrench::Axes;

/// Why a calibration cannot be used on the board.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotForBoard {
    /// It is of a kind that the board does not compute.
    #[error(
        "the board computes models `linear`, `cubic` and `physics`, this calibration is `{basis}`"
    )]
    Basis {
        /// Its basis.
        basis: &'static str,
    },
    /// It is for another number of channels.
    #[error("the board has {CHANNELS} channels, this calibration is for {channels}")]
    Channels {
        /// Its channels.
        channels: usize,
    },
    /// It gives fewer axes than the board sends.
    #[error(
        "the board sends all six axes of a wrench, this calibration gives {axes}: stream readings, and \
         convert them on the host"
    )]
    Axes {
        /// Its axes.
        axes: Axes,
    },
    /// The board keeps no memory of past readings.
    #[error("the board computes no memory terms: stream readings, and convert them on the host")]
    MemoryTerms,
    /// A number is not one that the board can compute with.
    #[error("a number of the calibration is too large for the board's single precision")]
    Overflow,
}

impl Hint for NotForBoard {
    fn hint(&self) -> Option<String> {
        let text = "fit one for the board with `shellcal fit --model cubic` or `physics`";
        matches!(self, Self::Basis { .. }).then(|| text.to_owned())
    }
}

/// The same model in single precision, for readings in counts of which [`COUNTS_PER_LSB`] are a step
/// of the converter.
///
/// # Errors
/// [`NotForBoard`].
pub fn for_board(calibration: &Calibration) -> Result<shared_proto::Calibration, NotForBoard> {
    let channels = calibration.channels();
    if channels != CHANNELS {
        return Err(NotForBoard::Channels { channels });
    }
    if !calibration.axes.are_all() {
        return Err(NotForBoard::Axes { axes: calibration.axes });
    }
    if calibration.memory.is_some() {
        return Err(NotForBoard::MemoryTerms);
    }
    let board = match calibration.kind() {
        Kind::Polynomial(polynomial) => shared_proto::Calibration::Cubic(cubic(polynomial)?),
        Kind::Physics(model) => {
            shared_proto::Calibration::Physics(physics::for_board(model.model()))
        }
    };
    // The board says no to numbers that it could not compute with.
    match shared_proto::Calibration::from_bytes(&board.to_bytes()) {
        Some(_) => Ok(board),
        None => Err(NotForBoard::Overflow),
    }
}

/// `z = (r/16 − c)/k = (r − 16c)·1/(16k)`.
fn cubic(polynomial: &Polynomial) -> Result<Cubic, NotForBoard> {
    let model = polynomial.model();
    if !matches!(model.basis, Basis::Linear | Basis::Cubic) {
        return Err(NotForBoard::Basis { basis: model.basis.name() });
    }
    let scaling = polynomial.scaling();
    let counts = f64::from(COUNTS_PER_LSB);
    let mut board = Cubic {
        centre: std::array::from_fn(|i| (scaling.centre[i] * counts) as f32),
        scale: std::array::from_fn(|i| (scaling.scale[i] * counts).recip() as f32),
        coefficients: [[0.0; AXES]; FEATURES],
        intercept: [0.0; AXES],
    };
    for (term, row) in model.terms().iter().zip(polynomial.coefficients()) {
        let row = row.map(|value| value as f32);
        match term.factors() {
            [] => board.intercept = row,
            // Of these models a term is a power of one channel.
            factors @ [channel, ..] => {
                board.coefficients[3 * usize::from(*channel) + factors.len() - 1] = row;
            }
        }
    }
    Ok(board)
}

#[cfg(test)]
mod tests {
    use super::*;
    use calibration::{Model, scaling::Scaling};
    use shell_data::wrench::{Axis, PerAxis};

    fn calibration(basis: Basis, intercept: bool) -> Calibration {
        let model = Model { basis, intercept, channels: 8, memory: 0 };
        let scaling = Scaling {
            centre: (0..8).map(|i| 1900.0 + 37.0 * f64::from(i)).collect(),
            scale: vec![512.0; 8],
        };
        let coefficients = (0..model.terms().len())
            .map(|j| std::array::from_fn(|axis| ((j * 37 + axis * 11) as f64).sin()))
            .collect();
        Calibration::new(model, scaling, coefficients)
    }

    /// By the definition of the upload's layout, in double precision.
    fn on_the_board(calibration: &Cubic, counts: [u16; 8]) -> [f64; 6] {
        std::array::from_fn(|axis| {
            let features = (0..FEATURES).map(|j| {
                let z = (f64::from(counts[j / 3]) - f64::from(calibration.centre[j / 3]))
                    * f64::from(calibration.scale[j / 3]);
                z.powi(j as i32 % 3 + 1) * f64::from(calibration.coefficients[j][axis])
            });
            features.sum::<f64>() + f64::from(calibration.intercept[axis])
        })
    }

    #[test]
    fn the_board_gets_the_wrench_that_the_host_computes() {
        for (basis, intercept) in
            [(Basis::Linear, true), (Basis::Cubic, true), (Basis::Cubic, false)]
        {
            let host = calibration(basis, intercept);
            let shared_proto::Calibration::Cubic(board) = for_board(&host).unwrap() else {
                panic!()
            };
            for row in 0..50_u32 {
                let counts: [u16; 8] =
                    std::array::from_fn(|c| ((row * 7919 + c as u32 * 12_553) % 65_520) as u16);
                let readings: Vec<_> =
                    counts.iter().map(|&counts| vec![f64::from(counts) / 16.0]).collect();
                let mut wrench = PerAxis::default();
                host.wrench(&readings, &mut wrench);
                for (axis, value) in on_the_board(&board, counts).into_iter().enumerate() {
                    // z reaches 4.5, z³ 91: 24 coefficients that round at 2⁻²⁴ of 91.
                    assert!((value - wrench[axis][0]).abs() < 24.0 * 91.0 * 6e-8);
                }
            }
        }
    }

    #[test]
    fn models_that_the_board_cannot_compute_are_refused() {
        for basis in [Basis::Quadratic, Basis::Poly3] {
            let refused = for_board(&calibration(basis, true)).unwrap_err();
            assert_eq!(refused, NotForBoard::Basis { basis: basis.name() });
        }
        let model = Model { basis: Basis::Linear, intercept: false, channels: 7, memory: 0 };
        let seven = Calibration::new(model, Scaling::identity(7), vec![[1.0; 6]; 7]);
        assert_eq!(for_board(&seven), Err(NotForBoard::Channels { channels: 7 }));
        let mut flat = calibration(Basis::Linear, true);
        flat.axes = [Axis::Fx, Axis::Fy].into_iter().collect();
        assert_eq!(for_board(&flat), Err(NotForBoard::Axes { axes: flat.axes }));
        let model = Model { channels: 8, ..model };
        let huge = Calibration::new(model, Scaling::identity(8), vec![[1e39; 6]; 8]);
        assert_eq!(for_board(&huge), Err(NotForBoard::Overflow));
    }
}
