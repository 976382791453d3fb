//! The fields of the JSON documents of polynomials and physics models.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::LARGEST;
use super::layout::to_json;
use super::origin::Origin;
use super::{
    CalibrationFile, FEWER_AXES_SCHEMA_VERSION, Problem, SCHEMA_VERSION, SIX_AXES_SCHEMA_VERSION,
};
use calibration::dynamics::ReferenceLag;
use calibration::memory::MemoryTerms;
use calibration::model::Model;
use calibration::physics::{
    GroupIntervals, MOST_CHANNELS, PhysicsCalibration, PhysicsModel, Sensor,
};
use calibration::reading_ranges::ReadingRange;
use calibration::scaling::{Scaling, is_power_of_two};
use calibration::uncertainty::{CoefficientCovariance, Covariance, ErrorShape};
use calibration::{Calibration, Kind, Polynomial, model};
use shell_data::by_axis::{self, Among, Row};
use shell_data::wrench::{Axes, Axis, PerAxis};

#[derive(Serialize, Deserialize)]
struct PolynomialDocument {
    schema_version: u64,
    #[serde(flatten)]
    origin: Origin,
    model: Model,
    terms: Vec<String>,
    scaling: Scaling,
    axes: Axes,
    coefficients: Vec<Row<f64>>,
    covariance: Option<Covariance>,
    valid_range: Option<Vec<ReadingRange>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    memory: Option<MemoryTerms>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    lag: Option<ReferenceLag>,
}

/// Axes of a document, read first; absent if they are all six.
#[derive(Deserialize)]
struct AxesHeader {
    axes: Option<Axes>,
}

pub(super) fn read<T: DeserializeOwned>(text: &[u8]) -> Result<T, Problem> {
    let AxesHeader { axes } = serde_json::from_slice(text)?;
    let document = || serde_json::from_slice(text);
    Ok(by_axis::among(axes.unwrap_or(Axes::ALL), document)?)
}

pub(super) fn format(file: &CalibrationFile, polynomial: &Polynomial) -> String {
    let calibration = &file.calibration;
    let axes = calibration.axes;
    let document = PolynomialDocument {
        schema_version: SCHEMA_VERSION,
        origin: file.origin.clone(),
        model: polynomial.model(),
        terms: term_names(&polynomial.model()),
        scaling: polynomial.scaling().clone(),
        axes,
        coefficients: polynomial.coefficients.iter().copied().map(Row).collect(),
        covariance: calibration.covariance.clone(),
        valid_range: calibration.valid_range.clone(),
        memory: calibration.memory.clone(),
        lag: calibration.lag,
    };
    to_json(&Among(axes, document))
}

fn term_names(model: &Model) -> Vec<String> {
    model.terms().iter().map(|term| model.term_name(term)).collect()
}

pub(super) fn parse(text: &[u8]) -> Result<CalibrationFile, Problem> {
    read::<PolynomialDocument>(text)?.value().map_err(Problem::Inconsistent)
}

impl PolynomialDocument {
    fn value(mut self) -> Result<CalibrationFile, String> {
        if let Some(covariance) = &mut self.covariance {
            set_absent_to_zero(covariance, self.axes, self.terms.len());
        }
        self.check()?;
        let coefficients = self.coefficients.into_iter().map(|Row(row)| row).collect();
        let mut calibration = Calibration::new(self.model, self.scaling, coefficients);
        calibration.axes = self.axes;
        calibration.covariance = self.covariance;
        calibration.valid_range = self.valid_range;
        calibration.memory = self.memory;
        calibration.lag = self.lag;
        Ok(CalibrationFile { calibration, origin: self.origin })
    }

    /// Checks that the parts are consistent; the rest of the program relies on that.
    fn check(&self) -> Result<(), String> {
        let axes = self.axes;
        let is_allowed = match self.schema_version {
            SIX_AXES_SCHEMA_VERSION => axes.are_all(),
            FEWER_AXES_SCHEMA_VERSION => !axes.are_all(),
            _ => true,
        };
        ensure!(
            is_allowed,
            "`axes` has {axes}: all six belong to version {SIX_AXES_SCHEMA_VERSION}, fewer to \
             version {FEWER_AXES_SCHEMA_VERSION}"
        );
        let model = &self.model;
        let channels = model.channels;
        let most = model::MAX_CHANNELS;
        let is_few = (1..=most).contains(&channels);
        ensure!(is_few, "`model.channels` is `{channels}`, expected 1 to {most}");
        let is_few = model.memory <= most && model.columns() <= most;
        ensure!(is_few, "`model.memory` is `{}`, too many for its channels", model.memory);
        check_memory(self.memory.as_ref(), model.memory)?;
        let is_small = |value: &f64| value.abs() <= LARGEST;
        let lag = self.lag.as_ref();
        ensure!(lag.is_none_or(|lag| is_small(&lag.by)), "`lag` has a number beyond {LARGEST:e}");
        // Compare counts before listing the terms: there may be millions.
        check_count("terms", self.terms.len(), model.term_count())?;
        let terms = term_names(model);
        check_count("coefficients", self.coefficients.len(), terms.len())?;
        check_count("scaling.centre", self.scaling.centre.len(), model.columns())?;
        check_count("scaling.scale", self.scaling.scale.len(), model.columns())?;
        if let Some(range) = &self.valid_range {
            check_count("valid_range", range.len(), channels)?;
            let is_range = range.iter().all(|range| range.min <= range.max);
            ensure!(is_range, "`valid_range` has a `min` above its `max`");
        }
        for (found, expected) in self.terms.iter().zip(&terms) {
            ensure!(found == expected, "`terms` has `{found}` where the model has `{expected}`");
        }
        for scale in &self.scaling.scale {
            let is_allowed = is_power_of_two(*scale);
            ensure!(is_allowed, "`scaling.scale` has `{scale}`, expected powers of two");
        }
        let is_centred = model.intercept || self.scaling.centre.iter().all(|&x| x == 0.0);
        ensure!(is_centred, "`scaling.centre` is not zero in a model without an intercept");
        let are_small = self.coefficients.iter().flat_map(|Row(row)| row).all(is_small);
        ensure!(are_small, "`coefficients` has a number beyond {LARGEST:e}");
        let covariance = self.covariance.as_ref();
        covariance.map_or(Ok(()), |covariance| check_covariance(covariance, terms.len()))
    }
}

fn set_absent_to_zero(covariance: &mut Covariance, axes: Axes, terms: usize) {
    for axis in Axes::ALL.without(axes).iter().map(Axis::index) {
        if let CoefficientCovariance::Groups { factors, .. } = &mut covariance.coefficients {
            factors[axis] = (1..=terms).map(|length| vec![0.0; length]).collect();
        }
        if let Some(ErrorShape { levels, quantiles }) = &mut covariance.shape {
            quantiles[axis] = vec![0.0; levels.len()];
        }
        if let Some(GroupIntervals { levels, factors, .. }) = &mut covariance.intervals {
            factors[axis] = vec![0.0; levels.len()];
        }
    }
}

fn check_covariance(covariance: &Covariance, terms: usize) -> Result<(), String> {
    let Covariance { residual, coefficients, shape, shared, intervals, .. } = covariance;
    let factors: Vec<(String, &Vec<Vec<f64>>)> = match coefficients {
        CoefficientCovariance::Rows { factor } => vec![("rows.factor".to_owned(), factor)],
        CoefficientCovariance::Groups { factors, .. } => {
            let named = |(axis, factor)| (format!("groups.factors[{axis}]"), factor);
            factors.iter().enumerate().map(named).collect()
        }
    };
    let quantiles = shape.iter().flat_map(|shape| shape.quantiles.iter().flatten());
    let numbers = residual.iter().flatten().chain(quantiles);
    let mut numbers = numbers.chain(factors.iter().flat_map(|(_, factor)| factor.iter().flatten()));
    let are_small = numbers.all(|value| value.abs() <= LARGEST);
    ensure!(are_small, "`covariance` has a number beyond {LARGEST:e}");
    for (name, factor) in factors {
        let name = format!("covariance.coefficients.{name}");
        check_count(&name, factor.len(), terms)?;
        for (j, column) in factor.iter().enumerate() {
            check_count(&format!("{name}[{j}]"), column.len(), j + 1)?;
        }
    }
    ensure!(covariance.degrees_of_freedom > 0, "`covariance.degrees_of_freedom` is `0`");
    if let CoefficientCovariance::Groups { degrees_of_freedom: Some(each), .. } = coefficients {
        let name = "covariance.coefficients.groups.degrees_of_freedom";
        check_count(name, each.len(), terms)?;
        ensure!(each.iter().all(|&one| one >= 1.0), "`{name}` has a number below `1`");
    }
    shape.as_ref().map_or(Ok(()), ErrorShape::check)?;
    if let Some(intervals) = intervals {
        check_intervals("covariance.intervals", intervals)?;
    }
    let are_shares = shared.iter().flatten().all(|share| (0.0..=1.0).contains(share));
    ensure!(are_shares, "`covariance.shared` has a share that is not from 0 to 1");
    let is_symmetric = |a: usize, b: usize| {
        let size = (residual[a][a] * residual[b][b]).abs().sqrt();
        (residual[a][b] - residual[b][a]).abs() <= 1e-6 * size
    };
    let is_symmetric = (0..36).all(|position| is_symmetric(position / 6, position % 6));
    ensure!(is_symmetric, "`covariance.residual` is not symmetric");
    let is_positive = (0..6).all(|axis| residual[axis][axis] >= 0.0);
    ensure!(is_positive, "`covariance.residual` has a negative variance");
    Ok(())
}

fn check_count(name: &str, found: usize, expected: usize) -> Result<(), String> {
    ensure!(found == expected, "`{name}` has `{found}` entries, the model needs `{expected}`");
    Ok(())
}

fn check_memory(memory: Option<&MemoryTerms>, expected: usize) -> Result<(), String> {
    let found = memory.map_or(0, |memory| memory.time_constants.len());
    let is_whole = found == expected;
    ensure!(is_whole, "`memory` has `{found}` time constants, the model needs `{expected}`");
    for time in memory.into_iter().flat_map(|of| of.time_constants.iter().chain(&of.gap)) {
        let is_positive = *time > 0.0 && *time <= LARGEST;
        ensure!(is_positive, "`memory` has the time `{time}`, which is not positive");
    }
    Ok(())
}

pub(super) fn check_intervals(name: &str, intervals: &GroupIntervals) -> Result<(), String> {
    let GroupIntervals { levels, factors, .. } = intervals;
    let ascending = levels.windows(2).all(|pair| pair[0] < pair[1]);
    let are_whole = ascending && factors.iter().all(|factors| factors.len() == levels.len());
    ensure!(are_whole, "`{name}.factors` are not one for each ascending level");
    Ok(())
}

const NAME: &str = "physics";

#[derive(Serialize, Deserialize)]
struct PhysicsDocument {
    schema_version: u64,
    #[serde(flatten)]
    origin: Origin,
    model: String,
    axes: Axes,
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

pub(super) fn format_physics(file: &CalibrationFile, physics: &PhysicsCalibration) -> String {
    to_json(&PhysicsDocument {
        schema_version: SCHEMA_VERSION,
        origin: file.origin.clone(),
        model: NAME.to_owned(),
        axes: Axes::ALL,
        physics: physics.model().clone(),
        standard_error_scale: physics.error_scale,
        intervals: physics.intervals.clone(),
        valid_range: file.calibration.valid_range.clone(),
        lag: file.calibration.lag,
    })
}

pub(super) fn parse_physics(text: &[u8]) -> Result<CalibrationFile, Problem> {
    read::<PhysicsDocument>(text)?.value().map_err(Problem::Inconsistent)
}

impl PhysicsDocument {
    fn value(self) -> Result<CalibrationFile, String> {
        self.check()?;
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

    fn check(&self) -> Result<(), String> {
        let is_physics = self.model == NAME;
        ensure!(is_physics, "`model` is `{}`, expected `{NAME}`", self.model);
        let axes = self.axes;
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
    use super::super::{Diagnostics, Role, SolverRecord, SourceFile};
    use super::*;
    use calibration::model::Basis;
    use calibration::physics::Noise;
    use calibration::quality::AxisQuality;
    use calibration::solver::SolverKind;
    use shell_data::{ColumnNames, MomentUnit, TimeUnit};

    fn file() -> CalibrationFile {
        let model = Model { basis: Basis::Linear, intercept: true, channels: 2, memory: 0 };
        let scaling = Scaling { centre: vec![1500.0, 1700.0], scale: vec![512.0, 1024.0] };
        let thirds = |j: usize| std::array::from_fn(|axis| (j * 6 + axis + 1) as f64 / 3.0);
        let mut calibration = Calibration::new(model, scaling, (0..3).map(thirds).collect());
        calibration.covariance = Some(Covariance {
            residual: [[1.0 / 7.0; 6]; 6],
            degrees_of_freedom: 9,
            coefficients: CoefficientCovariance::Rows {
                factor: vec![vec![0.1], vec![0.2, 1e-300], vec![0.3, 5e-324, 0.7]],
            },
            shape: None,
            shared: None,
            intervals: None,
        });
        calibration.valid_range = Some(vec![ReadingRange { min: 0.5, max: 4095.0 }; 2]);
        let quality = AxisQuality { rms: 0.1, max: Some(0.4), bias: -1e-17, r_squared: None };
        let origin = Origin {
            made_by: "shellcal 0.1.0".into(),
            date: "2017-05-29T00:00:00Z".into(),
            sensor_serial: Some("shell 7".into()),
            solver: Some(SolverRecord { name: SolverKind::Tsqr, ridge: 0.0, truncate: None }),
            diagnostics: Some(Diagnostics {
                rows: 12,
                skipped_rows: 1,
                repeated_rows: 2,
                rank: 3,
                condition: Some(1.7e5),
                train: [quality; 6],
                test: None,
                cross_validation: None,
                spread: None,
                selection: None,
                excitation: None,
                test_leak: Some(0.5),
                group_leak: None,
                not_ok: None,
            }),
            sources: vec![SourceFile {
                role: Role::Train,
                path: "train.csv".into(),
                checksum: Some("xxh128:00".into()),
                digest: None,
                rows: 12,
            }],
            columns: Some(ColumnNames {
                sensors: Some(vec!["a".into(), "b".into()]),
                time_unit: Some(TimeUnit::Microsecond),
                moment_unit: Some(MomentUnit::MillinewtonMetre),
                ..ColumnNames::default()
            }),
        };
        CalibrationFile { calibration, origin }
    }

    #[test]
    fn a_file_reads_back_to_the_last_bit() {
        let file = file();
        assert_eq!(parse(file.to_json().as_bytes()).unwrap(), file);
    }

    #[test]
    fn a_covariance_by_groups_with_a_shape_reads_back_too() {
        let mut file = file();
        let factor = vec![vec![0.1], vec![0.2, 1e-300], vec![0.3, 5e-324, 0.7]];
        let factors = std::array::from_fn(|_| factor.clone());
        let quantiles = std::array::from_fn(|axis| vec![0.7, 1.9 + axis as f64 / 3.0]);
        if let Some(covariance) = &mut file.calibration.covariance {
            covariance.coefficients =
                CoefficientCovariance::Groups { groups: 12, factors, degrees_of_freedom: None };
            covariance.shape = Some(ErrorShape { levels: vec![0.5, 0.95], quantiles });
        }
        assert_eq!(parse(file.to_json().as_bytes()).unwrap(), file);
        let text = file.to_json().replacen("0.95", "0.45", 1);
        assert!(matches!(parse(text.as_bytes()), Err(Problem::Inconsistent(_))));
    }

    #[test]
    fn a_file_of_some_axes_reads_back_with_zeros_for_the_others() {
        let mut file = file();
        let axes: Axes = [Axis::Fx, Axis::Fz].into_iter().collect();
        file.calibration.axes = axes;
        let text = file.to_json();
        assert!(text.contains("\"schema_version\": 4"), "{text}");
        assert!(!text.contains("fy_n") && text.contains("[0.3333333333333333, 1.0]"), "{text}");
        let read = parse(text.as_bytes()).unwrap();
        assert_eq!((read.to_json(), read.calibration.axes), (text.clone(), axes));
        let coefficients = &read.calibration.polynomial().unwrap().coefficients;
        assert_eq!(coefficients[0], [1.0 / 3.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
        let cases = [(
            "\"schema_version\": 4",
            "\"schema_version\": 1",
            "`axes` has Fx, Fz: all six belong",
        )];
        for (from, to, expected) in cases {
            match parse(text.replacen(from, to, 1).as_bytes()) {
                Err(Problem::Inconsistent(message)) => {
                    assert!(message.contains(expected), "{message}");
                }
                other => panic!("{from} → {to}: {other:?}"),
            }
        }
        let unordered = text.replacen("\"fx_n\"", "\"mz_nm\"", 1);
        let Err(Problem::Field(fault)) = parse(unordered.as_bytes()) else { panic!() };
        assert!(fault.message.contains("`axes` has `mz_nm`, `fz_n`, expected"), "{fault:?}");
        let short = text.replacen("[0.3333333333333333, 1.0]", "[1.0]", 1);
        let Err(Problem::Field(fault)) = parse(short.as_bytes()) else { panic!() };
        // The parser has already reached the next row when it reports the error.
        let line = 2 + text[..text.find("[0.3333333333333333").unwrap()].matches('\n').count();
        assert_eq!((fault.message.as_str(), fault.line), ("`1` values for `2` axes", line));
    }

    #[test]
    fn invalid_json_is_refused_with_its_position() {
        let Problem::NotJson(fault) = parse(b"{\n  nonsense").unwrap_err() else { panic!() };
        assert_eq!((fault.line, fault.column), (2, 3));
        let overflow = file().to_json().replace("0.1", "1e999");
        assert!(matches!(parse(overflow.as_bytes()), Err(Problem::NotJson { .. })));
        let nan = file().to_json().replace("0.1", "NaN");
        assert!(matches!(parse(nan.as_bytes()), Err(Problem::NotJson { .. })));
    }

    #[test]
    fn a_missing_field_is_named() {
        let text = file().to_json().replace("\"scaling\"", "\"scalling\"");
        let Err(Problem::Field(fault)) = parse(text.as_bytes()) else { panic!() };
        assert!(fault.message.contains("missing field `scaling`"), "{fault:?}");
    }

    #[test]
    fn an_unknown_axis_is_named() {
        let text = file().to_json().replace("\"fx_n\"", "\"fx_lbf\"");
        let Err(Problem::Field(fault)) = parse(text.as_bytes()) else { panic!() };
        assert!(fault.message.contains("`axes` has `fx_lbf`"), "{fault:?}");
    }

    #[test]
    fn inconsistent_parts_are_refused() {
        let cases = [
            ("\"channels\": 2", "\"channels\": 3", "`terms` has `3` entries"),
            ("\"channels\": 2", "\"channels\": 0", "`model.channels` is `0`"),
            ("\"channels\": 2", "\"channels\": 256", "`model.channels` is `256`"),
            ("\"s2\"", "\"s3\"", "`terms` has `s3`"),
            ("1024.0", "1000.0", "powers of two"),
            ("1024.0", "-1024.0", "powers of two"),
            ("[0.1]", "[0.1, 0.2]", "`covariance.coefficients.rows.factor[0]` has `2` entries"),
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

    fn physics_file() -> CalibrationFile {
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
    fn a_physics_model_reads_back_to_the_last_bit() {
        let file = physics_file();
        assert_eq!(parse_physics(file.to_json().as_bytes()).unwrap(), file);
    }

    #[test]
    fn documents_of_the_previous_version_have_no_factors_and_unscaled_standard_errors() {
        let mut document: serde_json::Value =
            serde_json::from_str(&physics_file().to_json()).unwrap();
        document["schema_version"] = 2.into();
        for later in ["standard_error_scale", "checksum"] {
            document.as_object_mut().unwrap().remove(later);
        }
        for sensor in document["physics"]["sensors"].as_array_mut().unwrap() {
            sensor.as_object_mut().unwrap().remove("loadings");
        }
        let text = document.to_string();
        let unsealed = CalibrationFile::parse(text.as_bytes());
        assert!(matches!(unsealed, Err(Problem::Unsealed { version: 2 })), "{unsealed:?}");
        let read = CalibrationFile::parse_edited(text.as_bytes()).unwrap();
        let Kind::Physics(physics) = &read.calibration.kind else { panic!("no physics model") };
        assert_eq!((physics.model().factor_count(), physics.error_scale), (0, [1.0; 6]));
    }

    #[test]
    fn inconsistent_parts_of_a_physics_model_are_refused() {
        let cases = [
            ("\"physics\"", "\"magic\"", "`model` is `magic`"),
            ("\"channels\": 8", "\"channels\": 17", "`physics.channels` is `17`"),
            ("\"channel\": 2", "\"channel\": 1", "`physics.sensors[1].channel` is `1`"),
            ("[0.7, 1.9]", "[0.7]", "`intervals.factors`"),
        ];
        for (from, to, expected) in cases {
            let text = physics_file().to_json();
            assert!(text.contains(from), "{from} in {text}");
            match parse_physics(text.replacen(from, to, 1).as_bytes()) {
                Err(Problem::Inconsistent(message)) => {
                    assert!(message.contains(expected), "{message}");
                }
                other => panic!("{from} → {to}: {other:?}"),
            }
        }
        let text = physics_file().to_json().replacen("\"fx_n\"", "\"fx_lbf\"", 1);
        let Err(Problem::Field(fault)) = parse_physics(text.as_bytes()) else { panic!() };
        assert!(fault.message.contains("`axes` has `fx_lbf`"), "{fault:?}");
    }
}
