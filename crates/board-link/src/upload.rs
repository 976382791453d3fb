//! Conversion of a host calibration to one for the board.

use shared_proto::{
    AXES, CHANNELS, COUNTS_PER_LSB, Cubic, FACTOR, FEATURES, PRIOR, Physics, PhysicsSensor,
};
use shell_data::hint::Hint;

use calibration::physics::{PhysicsModel, Sensor};
use calibration::{Basis, Calibration, Kind, Polynomial};
use shell_data::wrench::Axes;

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotForBoard {
    #[error("the board computes models `linear`, `cubic` and `physics`, this calibration is `{0}`")]
    Basis(&'static str),
    #[error("the board has {CHANNELS} channels, this calibration is for {0}")]
    Channels(usize),
    #[error(
        "the board needs all six axes, this calibration gives {0}: stream readings, and convert on the host"
    )]
    Axes(Axes),
    #[error("the board computes no memory terms: stream readings, and convert them on the host")]
    MemoryTerms,
    #[error("a number of the calibration is too large for the board's single precision")]
    Overflow,
}

impl Hint for NotForBoard {
    fn hint(&self) -> Option<String> {
        let text = "fit one for the board with `shellcal fit --model cubic` or `physics`";
        matches!(self, Self::Basis { .. }).then(|| text.to_owned())
    }
}

/// Converts a calibration to single precision, for readings in counts of 1/[`COUNTS_PER_LSB`] step.
pub fn for_board(calibration: &Calibration) -> Result<shared_proto::Calibration, NotForBoard> {
    let channels = calibration.channels();
    if channels != CHANNELS {
        return Err(NotForBoard::Channels(channels));
    }
    if !calibration.axes.are_all() {
        return Err(NotForBoard::Axes(calibration.axes));
    }
    if calibration.memory.is_some() {
        return Err(NotForBoard::MemoryTerms);
    }
    let board = match &calibration.kind {
        Kind::Polynomial(polynomial) => shared_proto::Calibration::Cubic(cubic(polynomial)?),
        Kind::Physics(model) => shared_proto::Calibration::Physics(physics(model.model())),
    };
    // The board rejects numbers that it cannot compute with.
    match shared_proto::Calibration::from_bytes(&board.to_bytes()) {
        Some(_) => Ok(board),
        None => Err(NotForBoard::Overflow),
    }
}

/// `z = (r/16 − c)/k = (r − 16c)·1/(16k)`.
fn cubic(polynomial: &Polynomial) -> Result<Cubic, NotForBoard> {
    let model = polynomial.model();
    if !matches!(model.basis, Basis::Linear | Basis::Cubic) {
        return Err(NotForBoard::Basis(model.basis.name()));
    }
    let scaling = polynomial.scaling();
    let counts = f64::from(COUNTS_PER_LSB);
    let mut board = Cubic {
        centre: std::array::from_fn(|i| (scaling.centre[i] * counts) as f32),
        scale: std::array::from_fn(|i| (scaling.scale[i] * counts).recip() as f32),
        coefficients: [[0.0; AXES]; FEATURES],
        intercept: [0.0; AXES],
    };
    for (term, row) in model.terms().iter().zip(&polynomial.coefficients) {
        let row = row.map(|value| value as f32);
        match term.factors() {
            [] => board.intercept = row,
            // A term of these models is a power of one channel.
            factors @ [channel, ..] => {
                board.coefficients[3 * usize::from(*channel) + factors.len() - 1] = row;
            }
        }
    }
    Ok(board)
}

/// Converts a physics model to single precision, for readings in counts of 1/[`COUNTS_PER_LSB`] step. The board solves
/// for the wrench alone: factors shared by the sensors become independent noise of each sensor.
fn physics(model: &PhysicsModel) -> Physics {
    let model = model.without_factors();
    let mut sensors = [PhysicsSensor::default(); CHANNELS];
    for sensor in &model.sensors {
        if let Some(slot) = sensors.get_mut(sensor.channel) {
            *slot = one_for_board(sensor);
        }
    }
    let mut prior = [0.0; PRIOR];
    pack(&mut prior, |i, j| model.lambda * model.load_precision[i][j], AXES);
    Physics {
        wrench_scale: model.wrench_scale.map(|scale| scale as f32),
        prior,
        reading_variance: model.noise.reading as f32,
        displacement_variance: model.noise.displacement as f32,
        sensors,
    }
}

fn one_for_board(sensor: &Sensor) -> PhysicsSensor {
    let [offset, fx, fy, fz, mx, my, mz, low, ln_height, ln_shape] = sensor.parameters;
    let counts = f64::from(COUNTS_PER_LSB);
    let factor = factor(&sensor.covariance);
    let mut packed = [0.0; FACTOR];
    pack(&mut packed, |i, j| factor[i][j], factor.len());
    PhysicsSensor {
        least: (sensor.least * counts) as f32,
        per_count: (sensor.range * counts).recip() as f32,
        offset: offset as f32,
        gains: [fx, fy, fz, mx, my, mz].map(|gain| gain as f32),
        low: low as f32,
        height: ln_height.exp() as f32,
        shape: ln_shape.exp() as f32,
        factor: packed,
    }
}

fn pack(packed: &mut [f32], at: impl Fn(usize, usize) -> f64, rows: usize) {
    let positions = (0..rows).flat_map(|i| (0..=i).map(move |j| (i, j)));
    packed.iter_mut().zip(positions).for_each(|(value, (i, j))| *value = at(i, j) as f32);
}

/// Returns the lower factor of a covariance `L·Lᵀ` (Golub & Van Loan, 4th ed., §4.2.8). A direction
/// without variance after rounding is zero.
fn factor<const N: usize>(covariance: &[[f64; N]; N]) -> [[f64; N]; N] {
    let mut l = [[0.0; N]; N];
    for j in 0..N {
        let known = |l: &[[f64; N]; N], i: usize| (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>();
        let pivot = (covariance[j][j] - known(&l, j)).max(0.0).sqrt();
        l[j][j] = pivot;
        for i in j + 1..N {
            let rest = covariance[i][j] - known(&l, i);
            l[i][j] = if pivot > 0.0 { rest / pivot } else { 0.0 };
        }
    }
    l
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
                    // z reaches 4.5 and z³ 91. Each of the 24 terms is rounded at 2⁻²⁴ of 91.
                    assert!((value - wrench[axis][0]).abs() < 24.0 * 91.0 * 6e-8);
                }
            }
        }
    }

    #[test]
    fn models_that_the_board_cannot_compute_are_refused() {
        for basis in [Basis::Quadratic, Basis::Poly3] {
            let refused = for_board(&calibration(basis, true)).unwrap_err();
            assert_eq!(refused, NotForBoard::Basis(basis.name()));
        }
        let model = Model { basis: Basis::Linear, intercept: false, channels: 7, memory: 0 };
        let seven = Calibration::new(model, Scaling::identity(7), vec![[1.0; 6]; 7]);
        assert_eq!(for_board(&seven), Err(NotForBoard::Channels(7)));
        let mut flat = calibration(Basis::Linear, true);
        flat.axes = [Axis::Fx, Axis::Fy].into_iter().collect();
        assert_eq!(for_board(&flat), Err(NotForBoard::Axes(flat.axes)));
        let model = Model { channels: 8, ..model };
        let huge = Calibration::new(model, Scaling::identity(8), vec![[1e39; 6]; 8]);
        assert_eq!(for_board(&huge), Err(NotForBoard::Overflow));
    }

    #[test]
    fn the_factor_squared_is_the_covariance() {
        // Rank three, with no variance in the second direction.
        let covariance = [
            [4.0, 0.0, 2.0, -1.0],
            [0.0, 0.0, 0.0, 0.0],
            [2.0, 0.0, 10.0, 1.0],
            [-1.0, 0.0, 1.0, 3.0],
        ];
        let l = factor(&covariance);
        for i in 0..4 {
            for j in 0..4 {
                let product: f64 = (0..4).map(|k| l[i][k] * l[j][k]).sum();
                assert!((product - covariance[i][j]).abs() < 1e-14, "{i} {j}");
                assert!(j <= i || l[i][j] == 0.0);
            }
        }
    }
}
