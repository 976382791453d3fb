//! The JSON document of a physics model.

use serde::{Deserialize, Serialize};

use super::document::{check_intervals, column_names, read};
use super::layout::to_json;
use super::origin::Origin;
use super::{CalibrationFile, Problem, SCHEMA_VERSION};
use calibration::dynamics::ReferenceLag;
use calibration::physics::observation::MOST_CHANNELS;
use calibration::physics::{GroupIntervals, PhysicsCalibration, PhysicsModel, Sensor};
use calibration::reading_ranges::ReadingRange;
use calibration::{Calibration, Kind};
use shell_data::wrench::{Axes, PerAxis};

/// What `model` says.
const NAME: &str = "physics";

#[derive(Serialize, Deserialize)]
struct PhysicsDocument {
    schema_version: u64,
    #[serde(flatten)]
    origin: Origin,
    model: String,
    axes: Vec<String>,
    physics: PhysicsModel,
    #[serde(default = "as_they_are")]
    standard_error_scale: PerAxis<f64>,
    intervals: Option<GroupIntervals>,
    valid_range: Option<Vec<ReadingRange>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    lag: Option<ReferenceLag>,
}

/// The scale of standard errors in a document that has none.
fn as_they_are() -> PerAxis<f64> {
    [1.0; 6]
}

pub(super) fn format(file: &CalibrationFile, physics: &PhysicsCalibration) -> String {
    to_json(&PhysicsDocument {
        schema_version: SCHEMA_VERSION,
        origin: file.origin.clone(),
        model: NAME.to_owned(),
        axes: column_names(Axes::ALL),
        physics: physics.model().clone(),
        standard_error_scale: *physics.error_scale(),
        intervals: physics.intervals.clone(),
        valid_range: file.calibration.valid_range.clone(),
        lag: file.calibration.lag,
    })
}

/// Parses the document of a physics model, of a known version.
pub(super) fn parse(text: &[u8]) -> Result<CalibrationFile, Problem> {
    let (axes, document): (_, PhysicsDocument) = read(text)?;
    document.value(axes).map_err(Problem::Inconsistent)
}

impl PhysicsDocument {
    /// # Errors
    /// What does not fit together.
    fn value(self, axes: Axes) -> Result<CalibrationFile, String> {
        self.check(axes)?;
        let mut physics = PhysicsCalibration::new(self.physics, self.standard_error_scale);
        physics.intervals = self.intervals;
        if let Some(intervals) = &physics.intervals {
            check_intervals("intervals", intervals)?;
        }
        let mut calibration = Calibration::from_kind(Kind::Physics(Box::new(physics)));
        calibration.valid_range = self.valid_range;
        calibration.lag = self.lag;
        Ok(CalibrationFile { calibration, origin: self.origin })
    }

    /// Whether the parts fit together, as the rest of the program takes for granted.
    fn check(&self, axes: Axes) -> Result<(), String> {
        let is_physics = self.model == NAME;
        ensure!(is_physics, "`model` is `{}`, expected `{NAME}`", self.model);
        ensure!(axes.are_all(), "`axes` has {axes} alone, expected all six");
        let channels = self.physics.channels;
        let is_few = (1..=MOST_CHANNELS).contains(&channels);
        ensure!(is_few, "`physics.channels` is `{channels}`, expected 1 to {MOST_CHANNELS}");
        if let Some(found) = self.valid_range.as_ref().map(Vec::len) {
            let is_whole = found == channels;
            ensure!(is_whole, "`valid_range` has `{found}` entries, expected `{channels}`");
        }
        let mut next = 0;
        for (position, sensor) in self.physics.sensors.iter().enumerate() {
            let (name, last) = (format!("physics.sensors[{position}]"), channels - 1);
            let Sensor { channel, range, .. } = sensor;
            let is_in_order = (next..=last).contains(channel);
            ensure!(is_in_order, "`{name}.channel` is `{channel}`, expected `{next}` to `{last}`");
            ensure!(*range > 0.0, "`{name}.range` is `{range}`");
            next = channel + 1;
        }
        let is_positive = |scale: &f64| *scale > 0.0 && *scale < f64::INFINITY;
        let are_positive = self.standard_error_scale.iter().all(is_positive);
        ensure!(are_positive, "`standard_error_scale` is not above zero");
        let are_positive = self.physics.wrench_scale.iter().all(is_positive);
        ensure!(are_positive, "`physics.wrench_scale` is not above zero");
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use calibration::physics::Noise;

    use super::*;

    fn file() -> CalibrationFile {
        let sensor = |channel: usize| Sensor {
            channel,
            least: 100.5,
            range: 1.0 / 3.0 + channel as f64,
            parameters: std::array::from_fn(|i| (i as f64 - 4.2) / 7.0),
            covariance: std::array::from_fn(|i| {
                std::array::from_fn(|j| if i == j { 1e-3 / 7.0 } else { 1e-300 })
            }),
            loadings: [0.1 / 3.0, 0.0],
        };
        let model = PhysicsModel {
            channels: 8,
            wrench_scale: [3.0, 4.0, 5.0, 0.1, 0.2, 0.3],
            load_precision: [[1.0 / 3.0; 6]; 6],
            lambda: 0.1,
            prior_width: 0.5,
            noise: Noise { reading: 1e-4, displacement: 0.01 },
            sensors: (1..8).map(sensor).collect(),
        };
        let scale = std::array::from_fn(|axis| 0.7 + axis as f64 / 7.0);
        let mut physics = PhysicsCalibration::new(model, scale);
        let factors = std::array::from_fn(|axis| vec![0.7, 1.9 + axis as f64 / 3.0]);
        physics.intervals = Some(GroupIntervals { groups: 12, levels: vec![0.5, 0.9], factors });
        let calibration = Calibration::from_kind(Kind::Physics(Box::new(physics)));
        CalibrationFile { calibration, origin: Origin::default() }
    }

    #[test]
    fn a_file_reads_back_to_the_last_bit() {
        let file = file();
        assert_eq!(parse(file.to_json().as_bytes()).unwrap(), file);
    }

    #[test]
    fn a_document_of_the_version_before_has_no_factors_and_unscaled_standard_errors() {
        let mut document: serde_json::Value = serde_json::from_str(&file().to_json()).unwrap();
        document["schema_version"] = 2.into();
        for later in ["standard_error_scale", "checksum"] {
            document.as_object_mut().unwrap().remove(later);
        }
        for sensor in document["physics"]["sensors"].as_array_mut().unwrap() {
            sensor.as_object_mut().unwrap().remove("loadings");
        }
        let read = CalibrationFile::parse(document.to_string().as_bytes()).unwrap();
        let Kind::Physics(physics) = read.calibration.kind() else { panic!("no physics model") };
        assert_eq!((physics.model().factor_count(), *physics.error_scale()), (0, [1.0; 6]));
    }

    #[test]
    fn parts_that_do_not_fit_together_are_refused() {
        let cases = [
            ("\"physics\"", "\"magic\"", "`model` is `magic`"),
            ("\"fx_n\"", "\"fx_lbf\"", "`axes` has `fx_lbf`"),
            ("\"channels\": 8", "\"channels\": 17", "`physics.channels` is `17`"),
            ("\"channel\": 2", "\"channel\": 1", "`physics.sensors[1].channel` is `1`"),
            ("[0.7, 1.9]", "[0.7]", "`intervals.factors`"),
        ];
        for (from, to, expected) in cases {
            let text = file().to_json();
            assert!(text.contains(from), "{from} in {text}");
            match parse(text.replacen(from, to, 1).as_bytes()) {
                Err(Problem::Inconsistent(message)) => {
                    assert!(message.contains(expected), "{message}");
                }
                other => panic!("{from} → {to}: {other:?}"),
            }
        }
    }
}
