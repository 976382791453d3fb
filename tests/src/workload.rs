//! Workloads for measuring the firmware.

use shared_proto::{
    AXES, CHANNELS, COUNTS_PER_LSB, Calibration, Cubic, FEATURES, Physics, PhysicsSensor,
};

use crate::flashed::PlayedFrame;
use crate::random::Random;

/// Distance in steps between the plateaus of the modelled sensors, and the lower plateau.
const RANGE: f64 = 2_000.0;
const LEAST: f64 = 500.0;

/// A calibration without special values, which would take less time.
pub fn cubic() -> Calibration {
    let mut coefficients = [[0.0; AXES]; FEATURES];
    for (i, value) in coefficients.as_flattened_mut().iter_mut().enumerate() {
        *value = ((i * 7 % 11) as f32 - 5.3) / 8.0;
    }
    Calibration::Cubic(Cubic {
        centre: [30_000.0; CHANNELS],
        scale: [6e-5; CHANNELS],
        coefficients,
        intercept: [0.1; AXES],
    })
}

/// Eight sensors with different gains for every axis, known to a few hundredths.
pub fn physics() -> Calibration {
    let counts = f64::from(COUNTS_PER_LSB);
    let mut prior = [0.0; shared_proto::PRIOR];
    let diagonal = (0..AXES).map(|i| i * (i + 3) / 2);
    diagonal.for_each(|position| prior[position] = 0.3);
    let sensor = |sensor: usize| PhysicsSensor {
        least: (LEAST * counts) as f32,
        per_count: (RANGE * counts).recip() as f32,
        offset: 0.2 * sensor as f32 - 0.8,
        gains: std::array::from_fn(|axis| match (sensor + 3 * axis) % 7 {
            0 => 1.5,
            position => 0.4 * (position as f32 - 3.5),
        }),
        low: 0.05,
        height: 0.9,
        shape: 1.2,
        factor: std::array::from_fn(|i| ((i * 5 % 7) as f32 - 2.5) / 100.0),
    };
    Calibration::Physics(Physics {
        wrench_scale: [1.5, 1.5, 1.5, 0.05, 0.05, 0.05],
        prior,
        reading_variance: 1e-4,
        displacement_variance: 1e-3,
        sensors: std::array::from_fn(sensor),
    })
}

/// Readings from the whole range, since some bytes take longer to encode.
pub fn everywhere() -> Vec<PlayedFrame> {
    let codes = |frame: u32, channel: u32| {
        let dark = (frame * 7 + channel * 31) % 300;
        let lit = dark + 500 + (frame * 13 + channel * 401) % 3_000;
        (dark as u16, lit as u16)
    };
    (0..500).map(|frame| std::array::from_fn(|channel| codes(frame, channel as u32))).collect()
}

/// Readings of [`physics`] under up to twice the training loads, with errors of its variance.
pub fn poses() -> Vec<PlayedFrame> {
    let Calibration::Physics(model) = physics() else { return Vec::new() };
    let mut random = Random(1);
    let mut pose = || {
        let load: [f64; AXES] = std::array::from_fn(|_| random.unit() * 4.0 - 2.0);
        std::array::from_fn(|channel| {
            let PhysicsSensor { offset, gains, low, height, shape, .. } = model.sensors[channel];
            let pull: f64 = gains.iter().zip(load).map(|(&gain, x)| f64::from(gain) * x).sum();
            let sigma = 1.0 / (1.0 + (-f64::from(offset) - pull).exp());
            let answer = f64::from(low) + f64::from(height) * sigma.powf(f64::from(shape));
            let noise = random.normal() * f64::from(model.reading_variance).sqrt();
            let dark = 100;
            (dark, dark + (LEAST + RANGE * (answer + noise)).round() as u16)
        })
    };
    (0..500).map(|_| pose()).collect()
}
