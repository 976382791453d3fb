//! Fits mass, centre of mass and zero of a sensor to still poses: least squares with equal weights,
//! in closed form. With `Δ` for the difference from the mean over the poses and `w = m·Δg`,
//!
//! ```text
//! m = Σ Δg·ΔF / Σ |Δg|²                         F₀ = F̄ − m·ḡ
//! c = (Σ |w|²·I − w·wᵀ)⁻¹ Σ w × ΔT              T₀ = T̄ − c × m·ḡ
//! ```
//!
//! Standard errors treat the residuals as independent between poses and axes, with one variance for all forces and one
//! for all moments; those of c and T₀ include the error of m. The directions of gravity must not lie on a line: the
//! component of c along that line would have no lever.

use shell_data::hint::Hint;
use shell_data::wrench::PerAxis;

use super::vector::{Vector, add, cross, dot, inverse, mean, norm, scaled, subtract, times};
use super::{Payload, STANDARD_GRAVITY_M_S2};

/// Least spread of the directions of gravity perpendicular to their main line, rad RMS, that
/// determines the centre of mass.
pub const LEAST_SPREAD: f64 = 1e-3;

/// The minimum number of poses: each gives six equations, and residuals need some to spare.
const LEAST_POSES: usize = 4;

#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PayloadError {
    #[error("`{0}` poses are too few to tell what the sensor carries, `{LEAST_POSES}` are needed")]
    TooFewPoses(usize),
    /// All directions of gravity are equal or lie on a line; `lost` names the undetermined parameters.
    #[error(
        "gravity turns by only `{spread_deg:.2}`° in all but one direction of the sensor's frame, which \
         gives {lost}"
    )]
    SameOrientation { spread_deg: f64, lost: &'static str },
    #[error(
        "the mass is `{mass_kg:.4}` kg, standard error {standard_error_kg:.4}: the forces do not follow \
         gravity"
    )]
    NoMass { mass_kg: f64, standard_error_kg: f64 },
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

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PayloadPose {
    pub wrench: PerAxis<f64>,
    pub gravity_m_s2: Vector,
}

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PayloadFit {
    #[serde(flatten)]
    pub payload: Payload,
    pub standard_errors: Payload,
    pub residual_rms_n: f64,
    pub residual_rms_nm: f64,
    pub poses: usize,
    /// Mean magnitude of gravity over the poses, m/s²; the mass is a force divided by this.
    #[serde(default = "standard_gravity")]
    pub gravity_m_s2: f64,
    /// RMS deviation of gravity from its mean, rad: along the main line of the deviations, and across it.
    pub spread_rad: [f64; 2],
}

fn standard_gravity() -> f64 {
    STANDARD_GRAVITY_M_S2
}

/// Fits a payload to still poses.
///
/// # Errors
/// [`PayloadError`].
pub fn fit(poses: &[PayloadPose]) -> Result<PayloadFit, PayloadError> {
    if poses.len() < LEAST_POSES {
        return Err(PayloadError::TooFewPoses(poses.len()));
    }
    let is_finite =
        |pose: &PayloadPose| pose.wrench.iter().chain(&pose.gravity_m_s2).all(|v| v.is_finite());
    if let Some(bad) = poses.iter().position(|pose| !is_finite(pose)) {
        return Err(PayloadError::NotFinite(bad + 1));
    }
    let n = poses.len() as f64;
    let force = |pose: &PayloadPose| [pose.wrench[0], pose.wrench[1], pose.wrench[2]];
    let moment = |pose: &PayloadPose| [pose.wrench[3], pose.wrench[4], pose.wrench[5]];
    let gravity = mean(poses.iter().map(|pose| pose.gravity_m_s2));
    let (mean_force, mean_moment) = (mean(poses.iter().map(force)), mean(poses.iter().map(moment)));
    let turn = |pose: &PayloadPose| subtract(pose.gravity_m_s2, gravity);
    let spread_rad = spread(poses.iter().map(turn), poses.iter().map(|pose| pose.gravity_m_s2));
    check_spread(spread_rad)?;

    let squares: f64 = poses.iter().map(|pose| dot(turn(pose), turn(pose))).sum();
    let pull = |pose: &PayloadPose| dot(turn(pose), subtract(force(pose), mean_force));
    let mass_kg = poses.iter().map(pull).sum::<f64>() / squares;
    let force_bias_n = subtract(mean_force, scaled(gravity, mass_kg));
    let left = |pose: &PayloadPose| {
        subtract(force(pose), add(scaled(pose.gravity_m_s2, mass_kg), force_bias_n))
    };
    let force_squares: f64 = poses.iter().map(|pose| dot(left(pose), left(pose))).sum();
    let force_variance = force_squares / (3.0 * n - 4.0);
    let mass_error = (force_variance / squares).sqrt();
    // A body without weight has no centre.
    if mass_kg.is_nan() || mass_kg <= 2.0 * mass_error {
        return Err(PayloadError::NoMass { mass_kg, standard_error_kg: mass_error });
    }
    let force_bias_error = gravity.map(|g| (force_variance * (1.0 / n + g * g / squares)).sqrt());

    let weight = |pose: &PayloadPose| scaled(turn(pose), mass_kg);
    let mut normal = [[0.0; 3]; 3];
    let mut right = [0.0; 3];
    for pose in poses {
        let w = weight(pose);
        for (i, row) in normal.iter_mut().enumerate() {
            row.iter_mut().zip(w).for_each(|(entry, other)| *entry -= w[i] * other);
            row[i] += dot(w, w);
        }
        right = add(right, cross(w, subtract(moment(pose), mean_moment)));
    }
    let covariance = inverse(&normal);
    let centre_m = times(&covariance, right);
    let mean_weight = scaled(gravity, mass_kg);
    let moment_bias_nm = subtract(mean_moment, cross(centre_m, mean_weight));
    let left = |pose: &PayloadPose| {
        let lever = cross(centre_m, scaled(pose.gravity_m_s2, mass_kg));
        subtract(moment(pose), add(lever, moment_bias_nm))
    };
    let moment_squares: f64 = poses.iter().map(|pose| dot(left(pose), left(pose))).sum();
    let moment_variance = moment_squares / (3.0 * n - 6.0);
    let of_mass = mass_error / mass_kg;
    let centre_error: Vector = std::array::from_fn(|i| {
        (moment_variance * covariance[i][i] + (centre_m[i] * of_mass).powi(2)).sqrt()
    });
    // T₀ = T̄ − c × w̄: the coefficients of c are the unit vectors crossed with w̄.
    let moment_bias_error: Vector = std::array::from_fn(|i| {
        let mut unit = [0.0; 3];
        unit[i] = 1.0;
        let lever = cross(mean_weight, unit);
        (moment_variance * (1.0 / n + dot(lever, times(&covariance, lever)))).sqrt()
    });
    Ok(PayloadFit {
        payload: Payload { mass_kg, centre_m, force_bias_n, moment_bias_nm },
        standard_errors: Payload {
            mass_kg: mass_error,
            centre_m: centre_error,
            force_bias_n: force_bias_error,
            moment_bias_nm: moment_bias_error,
        },
        residual_rms_n: (force_squares / (3.0 * n)).sqrt(),
        residual_rms_nm: (moment_squares / (3.0 * n)).sqrt(),
        poses: poses.len(),
        gravity_m_s2: poses.iter().map(|pose| norm(pose.gravity_m_s2)).sum::<f64>() / n,
        spread_rad,
    })
}

/// RMS deviation of gravity from its mean, relative to its size: along the deviations' main line, and across it.
pub(super) fn spread(
    turns: impl Iterator<Item = Vector> + Clone,
    gravity: impl ExactSizeIterator<Item = Vector>,
) -> [f64; 2] {
    let count = gravity.len().max(1) as f64;
    let size = gravity.map(norm).sum::<f64>() / count;
    let total: f64 = turns.clone().map(|turn| dot(turn, turn)).sum();
    // Find the main line by power iteration; only its size is needed.
    let mut line =
        turns.clone().max_by(|a, b| dot(*a, *a).total_cmp(&dot(*b, *b))).unwrap_or_default();
    let mut along = 0.0;
    for _ in 0..200 {
        let size = norm(line);
        if size == 0.0 {
            break;
        }
        line = scaled(line, 1.0 / size);
        along = turns.clone().map(|turn| dot(turn, line).powi(2)).sum();
        line = turns.clone().fold([0.0; 3], |sum, turn| add(sum, scaled(turn, dot(turn, line))));
    }
    let share = |squares: f64| (squares.max(0.0) / count).sqrt() / size;
    [share(along), share(total - along)]
}

pub(super) fn check_spread([along, beside]: [f64; 2]) -> Result<(), PayloadError> {
    let spread_deg = beside.to_degrees();
    let lost = if along.is_nan() || along < LEAST_SPREAD {
        "neither mass nor centre of mass"
    } else if beside < LEAST_SPREAD {
        "nothing of the centre of mass along that one"
    } else {
        return Ok(());
    };
    Err(PayloadError::SameOrientation { spread_deg, lost })
}

#[cfg(test)]
mod tests {
    use super::*;
    use shell_data::random::{Purpose, RandomStream};

    const TRUTH: Payload = Payload {
        mass_kg: 0.4,
        centre_m: [0.01, -0.02, 0.05],
        force_bias_n: [3.0, -1.0, 0.5],
        moment_bias_nm: [0.1, 0.2, -0.3],
    };

    fn pose(gravity_m_s2: Vector) -> PayloadPose {
        let (load, bias) = (TRUTH.load(gravity_m_s2), TRUTH.bias());
        PayloadPose { wrench: std::array::from_fn(|axis| load[axis] + bias[axis]), gravity_m_s2 }
    }

    fn directions() -> Vec<Vector> {
        let g = 9.81;
        let d = g / 3.0_f64.sqrt();
        vec![
            [g, 0.0, 0.0],
            [0.0, g, 0.0],
            [0.0, 0.0, g],
            [-g, 0.0, 0.0],
            [0.0, -g, 0.0],
            [d, d, -d],
            [-d, d, d],
            [d, -d, d],
        ]
    }

    fn numbers(payload: &Payload) -> [f64; 10] {
        let Payload { mass_kg, centre_m: c, .. } = *payload;
        let [a, b, d, e, f, g] = payload.bias();
        [mass_kg, c[0], c[1], c[2], a, b, d, e, f, g]
    }

    #[test]
    fn a_known_payload_is_recovered() {
        let poses: Vec<PayloadPose> = directions().into_iter().map(pose).collect();
        let fitted = fit(&poses).unwrap();
        for (found, truth) in numbers(&fitted.payload).into_iter().zip(numbers(&TRUTH)) {
            // A few dozen operations on numbers of order ten.
            assert!((found - truth).abs() < 1e-13, "{found} {truth}");
        }
        assert!(fitted.residual_rms_n < 1e-14 && fitted.residual_rms_nm < 1e-15);
    }

    #[test]
    fn standard_errors_are_the_scatter_of_fits() {
        let mut noise = RandomStream::new(7, Purpose::Reference, 0);
        let (draws, mut found, mut said) = (2000, Vec::new(), [0.0; 10]);
        for _ in 0..draws {
            let noisy = directions().into_iter().map(|g| {
                let mut pose = pose(g);
                for (axis, value) in pose.wrench.iter_mut().enumerate() {
                    *value += noise.normal() * if axis < 3 { 0.1 } else { 0.003 };
                }
                pose
            });
            let fitted = fit(&noisy.collect::<Vec<_>>()).unwrap();
            found.push(numbers(&fitted.payload));
            let errors = numbers(&fitted.standard_errors);
            said.iter_mut().zip(errors).for_each(|(sum, error)| *sum += error * error);
        }
        for (i, truth) in numbers(&TRUTH).into_iter().enumerate() {
            let squares: f64 = found.iter().map(|one| (one[i] - truth).powi(2)).sum();
            let ratio = (squares / said[i]).sqrt();
            // 2000 draws determine a standard deviation to 1.6 %; the limit is three times that.
            assert!((ratio - 1.0).abs() < 0.05, "{i}: {ratio}");
        }
    }

    #[test]
    fn insufficient_poses_are_refused() {
        let at = |angle: f64| pose([0.0, 9.81 * angle.sin(), 9.81 * angle.cos()]);
        let few = fit(&[at(0.0), at(1.0), at(2.0)]).unwrap_err();
        assert_eq!(few, PayloadError::TooFewPoses(3));
        let same = fit(&[at(1.0); 5]).unwrap_err();
        assert!(same.to_string().contains("neither mass nor centre"), "{same}");
        // Upright and upside down: the directions of gravity lie on a line.
        let line = [pose([0.0, 0.0, 9.81]), pose([0.0, 0.0, -9.81])].repeat(3);
        assert!(fit(&line).unwrap_err().to_string().contains("along that one"));
        // Directions in a plane suffice.
        let plane: Vec<PayloadPose> = (0..8).map(|i| at(f64::from(i))).collect();
        let fitted = fit(&plane).unwrap();
        assert!((fitted.payload.centre_m[0] - TRUTH.centre_m[0]).abs() < 1e-13);
        let upwards: Vec<PayloadPose> = plane
            .iter()
            .map(|p| PayloadPose { gravity_m_s2: p.gravity_m_s2.map(|g| -g), ..*p })
            .collect();
        assert!(matches!(fit(&upwards), Err(PayloadError::NoMass { .. })));
        let mut bad = plane;
        bad[2].wrench[4] = f64::NAN;
        assert_eq!(fit(&bad), Err(PayloadError::NotFinite(3)));
    }
}
