//! The physics model as the board inverts it.

use shared_proto::{AXES, CHANNELS, COUNTS_PER_LSB, FACTOR, PRIOR, Physics, PhysicsSensor};

use calibration::physics::{PhysicsModel, Sensor};

/// The same model in single precision, for readings in counts of which [`COUNTS_PER_LSB`] are a step of the
/// converter. The board solves for the wrench alone: factors that the sensors share are noise of each.
pub(super) fn for_board(model: &PhysicsModel) -> Physics {
    let model = model.without_factors();
    let mut sensors = [PhysicsSensor::NONE; CHANNELS];
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

/// The lower triangle of a matrix, row by row.
fn pack(packed: &mut [f32], at: impl Fn(usize, usize) -> f64, rows: usize) {
    let positions = (0..rows).flat_map(|i| (0..=i).map(move |j| (i, j)));
    packed.iter_mut().zip(positions).for_each(|(value, (i, j))| *value = at(i, j) as f32);
}

/// The lower factor of a covariance `L·Lᵀ` (Golub & Van Loan, 4th ed., §4.2.8). A direction of which rounding has
/// left no variance has none.
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

    #[test]
    fn the_factor_squared_is_the_covariance() {
        // Of rank three, with no variance in the second direction.
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
