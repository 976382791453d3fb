//! What calibrations are made of, as documents hold it.
//!
//! The names of fields are those of the documents: the program may rename its own, and then the two
//! are matched here. A field that the program adds or drops is an error of compilation.
//!
//! What the program has for each axis, a document has for the axes that there are: [`OfAxes`].

use std::path::PathBuf;

use calibration::dynamics::ReferenceLag;
use calibration::exact::{ChannelRange, ReadingUnit, StoredIntegers, StoredMoments};
use calibration::memory::{MemoryTerms, TimeBase};
use calibration::model::{Basis, Model};
use calibration::physics::response::{PARAMETERS, Parameters};
use calibration::physics::{GroupIntervals, Loadings, Noise, PhysicsModel, Sensor};
use calibration::quality::AxisQuality;
use calibration::reading_ranges::ReadingRange;
use calibration::scaling::Scaling;
use calibration::solver::SolverKind;
use calibration::uncertainty::{CoefficientCovariance, Covariance, ErrorShape};
use calibration::validation::cross_validation::{CrossValidation, HeldOutQuality};
use calibration::validation::excitation::{AxisExcitation, Excitation};
use calibration::validation::grouped::GroupKind;
use calibration::validation::selection::{Candidate, CandidateErrors, Selection};
use forces::payload::{Accelerometer, Matrix, Payload, Vector};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};
use shell_data::hint::quoted;
use shell_data::wrench::{Axes, Axis, MomentUnit, PerAxis};
use shell_data::{ColumnNames, TimeUnit};

use super::origin::{Diagnostics, Origin, Role, SolverRecord, SourceFile};

/// What a document holds of a value.
pub trait Stored: Sized {
    /// The type that the program works with.
    type Value;

    /// What is written of a value, where there are these axes.
    fn of(value: &Self::Value, axes: Axes) -> Self;

    /// The value that was written.
    ///
    /// # Errors
    /// If it is not for as many axes as these.
    fn value(self, axes: Axes) -> Result<Self::Value, String>;
}

/// Types that documents hold as they are.
macro_rules! as_it_is {
    ($($type:ty),*) => {$(
        impl Stored for $type {
            type Value = Self;

            fn of(value: &Self, _: Axes) -> Self {
                value.clone()
            }

            fn value(self, _: Axes) -> Result<Self, String> {
                Ok(self)
            }
        }
    )*};
}

as_it_is!(bool, f64, i32, i64, u32, u64, usize, String);
as_it_is!(Role, Parameters, [Parameters; PARAMETERS], Loadings, Vector, Matrix);

/// A path in a document. Names that are not Unicode, which JSON cannot hold, are written with
/// replacement characters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct StoredPath(String);

impl Stored for StoredPath {
    type Value = PathBuf;

    fn of(value: &PathBuf, _: Axes) -> Self {
        Self(value.to_string_lossy().into_owned())
    }

    fn value(self, _: Axes) -> Result<PathBuf, String> {
        Ok(self.0.into())
    }
}

impl<S: Stored> Stored for Option<S> {
    type Value = Option<S::Value>;

    fn of(value: &Self::Value, axes: Axes) -> Self {
        value.as_ref().map(|value| S::of(value, axes))
    }

    fn value(self, axes: Axes) -> Result<Self::Value, String> {
        self.map(|stored| stored.value(axes)).transpose()
    }
}

impl<S: Stored> Stored for Vec<S> {
    type Value = Vec<S::Value>;

    fn of(value: &Self::Value, axes: Axes) -> Self {
        value.iter().map(|value| S::of(value, axes)).collect()
    }

    fn value(self, axes: Axes) -> Result<Self::Value, String> {
        self.into_iter().map(|stored| stored.value(axes)).collect()
    }
}

/// The axes that a document names in its field `axes`; all six where it does not.
pub(super) fn axes_of(columns: Option<&[String]>) -> Result<Axes, String> {
    let Some(columns) = columns else { return Ok(Axes::ALL) };
    let known = |column: &String| Axis::ALL.into_iter().find(|axis| axis.column() == *column);
    let axes: Axes = columns.iter().filter_map(known).collect();
    let (found, all) = (columns.join("`, `"), Axes::ALL.columns().join("`, `"));
    let are_known = !axes.is_empty() && axes.columns() == columns;
    ensure!(are_known, "`axes` has `{found}`, expected some of `{all}`, in this order");
    Ok(axes)
}

/// One value for each axis that there is, in their order.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct OfAxes<S>(Vec<S>);

impl<S> OfAxes<S> {
    /// The values.
    pub fn iter(&self) -> std::slice::Iter<'_, S> {
        self.0.iter()
    }
}

impl<S: Stored<Value: Blank>> Stored for OfAxes<S> {
    type Value = PerAxis<S::Value>;

    fn of(value: &Self::Value, axes: Axes) -> Self {
        Self(axes.iter().map(|axis| S::of(&value[axis.index()], axes)).collect())
    }

    fn value(self, axes: Axes) -> Result<Self::Value, String> {
        let (found, expected) = (self.0.len(), axes.count());
        let values: Vec<S::Value> = self.0.value(axes)?;
        let blank = values.first().map(Blank::blank);
        let spread = blank.and_then(|blank| axes.spread(values, &blank));
        spread.ok_or_else(|| format!("`{found}` values for `{expected}` axes"))
    }
}

/// What the position of an axis holds that there is not.
pub trait Blank: Clone {
    /// As many zeros as `self` has numbers.
    fn blank(&self) -> Self;
}

impl<T: Blank> Blank for Vec<T> {
    fn blank(&self) -> Self {
        self.iter().map(Blank::blank).collect()
    }
}

impl<T: Blank> Blank for PerAxis<T> {
    fn blank(&self) -> Self {
        self.each_ref().map(Blank::blank)
    }
}

macro_rules! blank_by_default {
    ($($type:ty),*) => {$(
        impl Blank for $type {
            fn blank(&self) -> Self {
                Self::default()
            }
        }
    )*};
}

blank_by_default!(f64, AxisQuality, HeldOutQuality, AxisExcitation, Option<String>);

/// A type of the documents, field by field, and its conversions from and to the one that the program works
/// with. Where it is `None`, a field with `= default` is left out.
macro_rules! stored {
    ($name:ident of $value:ident {
        $($(#[$meta:meta])* $field:ident: $type:ty $(= $default:ident)?),* $(,)?
    }) => {
        #[doc = concat!("[`", stringify!($value), "`] in a document.")]
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[allow(missing_docs, reason = "the fields are those of the program's type")]
        pub struct $name {$(
            $(#[$meta])*
            $(#[serde($default, skip_serializing_if = "Option::is_none")])?
            pub $field: $type
        ),*}

        impl Stored for $name {
            type Value = $value;

            fn of(value: &$value, axes: Axes) -> Self {
                Self { $($field: Stored::of(&value.$field, axes)),* }
            }

            fn value(self, axes: Axes) -> Result<$value, String> {
                Ok($value { $($field: self.$field.value(axes)?),* })
            }
        }
    };
}

stored!(StoredOrigin of Origin {
    made_by: String,
    date: String,
    sensor_serial: Option<String>,
    solver: Option<StoredSolverRecord>,
    diagnostics: Option<StoredDiagnostics>,
    sources: Vec<StoredSource>,
    columns: Option<StoredColumnNames> = default,
});
stored!(StoredColumnNames of ColumnNames {
    sensors: Option<Vec<String>> = default,
    wrench: Option<OfAxes<Option<String>>> = default,
    moment_unit: Option<Name<MomentUnit>> = default,
    time: Option<String> = default,
    time_unit: Option<Name<TimeUnit>> = default,
    group: Option<String> = default,
});
stored!(StoredSolverRecord of SolverRecord {
    name: Name<SolverKind>,
    ridge: f64,
    truncate: Option<f64> = default,
});
stored!(StoredDiagnostics of Diagnostics {
    rows: u64,
    skipped_rows: u64,
    repeated_rows: u64,
    rank: usize,
    condition: Option<f64>,
    train: OfAxes<StoredQuality>,
    test: Option<OfAxes<StoredQuality>>,
    cross_validation: Option<StoredCrossValidation> = default,
    selection: Option<StoredSelection> = default,
    excitation: Option<StoredExcitation> = default,
    test_leak: Option<f64> = default,
    group_leak: Option<f64> = default,
});
stored!(StoredSource of SourceFile {
    role: Role,
    path: StoredPath,
    checksum: Option<String>,
    digest: Option<String> = default,
    rows: u64,
});

stored!(StoredModel of Model {
    basis: Name<Basis>,
    intercept: bool,
    channels: usize,
    #[serde(default, skip_serializing_if = "is_none")]
    memory: usize,
});
stored!(StoredMemory of MemoryTerms {
    time_base: Name<TimeBase>,
    time_constants: Vec<f64>,
    gap: Option<f64> = default,
});
stored!(StoredLag of ReferenceLag { time_base: Name<TimeBase>, by: f64 });
stored!(StoredScaling of Scaling { centre: Vec<f64>, scale: Vec<f64> });
stored!(StoredReadingRange of ReadingRange { min: f64, max: f64 });

stored!(StoredCovariance of Covariance {
    residual: OfAxes<OfAxes<f64>>,
    degrees_of_freedom: u64,
    coefficients: StoredCoefficientCovariance,
    shape: Option<StoredErrorShape> = default,
    shared: Option<OfAxes<f64>> = default,
    intervals: Option<StoredGroupIntervals> = default,
});
stored!(StoredErrorShape of ErrorShape { levels: Vec<f64>, quantiles: OfAxes<Vec<f64>> });

stored!(StoredPhysicsModel of PhysicsModel {
    channels: usize,
    wrench_scale: OfAxes<f64>,
    load_precision: OfAxes<OfAxes<f64>>,
    lambda: f64,
    prior_width: f64,
    noise: StoredNoise,
    sensors: Vec<StoredSensor>,
});
stored!(StoredNoise of Noise { reading: f64, displacement: f64 });
stored!(StoredSensor of Sensor {
    channel: usize,
    least: f64,
    range: f64,
    parameters: Parameters,
    covariance: [Parameters; PARAMETERS],
    #[serde(default)]
    loadings: Loadings,
});
stored!(StoredGroupIntervals of GroupIntervals {
    groups: usize,
    levels: Vec<f64>,
    factors: OfAxes<Vec<f64>>,
});

fn is_none(memory_terms: &usize) -> bool {
    *memory_terms == 0
}

/// Whether memory terms fit to a model of so many time constants, and are any.
pub(super) fn check_memory(memory: Option<&StoredMemory>, expected: usize) -> Result<(), String> {
    let found = memory.map_or(0, |memory| memory.time_constants.len());
    let is_whole = found == expected;
    ensure!(is_whole, "`memory` has `{found}` time constants, the model needs `{expected}`");
    for time in memory.into_iter().flat_map(|of| of.time_constants.iter().chain(&of.gap)) {
        let is_positive = *time > 0.0 && *time <= super::LARGEST;
        ensure!(is_positive, "`memory` has the time `{time}`, which is not positive");
    }
    Ok(())
}

/// Whether the parts of intervals, in the field of this name, fit together.
pub(super) fn check_intervals(name: &str, intervals: &GroupIntervals) -> Result<(), String> {
    let GroupIntervals { levels, factors, .. } = intervals;
    let ascending = levels.windows(2).all(|pair| pair[0] < pair[1]);
    let are_whole = ascending && factors.iter().all(|factors| factors.len() == levels.len());
    ensure!(are_whole, "`{name}.factors` are not one for each ascending level");
    Ok(())
}

/// [`CoefficientCovariance`] in a document.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs, reason = "the fields are those of the program's type")]
pub enum StoredCoefficientCovariance {
    Rows { factor: Vec<Vec<f64>> },
    Groups { groups: u64, factors: OfAxes<Vec<Vec<f64>>> },
}

impl Stored for StoredCoefficientCovariance {
    type Value = CoefficientCovariance;

    fn of(value: &CoefficientCovariance, axes: Axes) -> Self {
        match value {
            CoefficientCovariance::Rows { factor } => Self::Rows { factor: factor.clone() },
            CoefficientCovariance::Groups { groups, factors } => {
                Self::Groups { groups: *groups, factors: Stored::of(factors, axes) }
            }
        }
    }

    fn value(self, axes: Axes) -> Result<CoefficientCovariance, String> {
        Ok(match self {
            Self::Rows { factor } => CoefficientCovariance::Rows { factor },
            Self::Groups { groups, factors } => {
                CoefficientCovariance::Groups { groups, factors: factors.value(axes)? }
            }
        })
    }
}

stored!(StoredQuality of AxisQuality {
    rms: f64,
    max: Option<f64>,
    bias: f64,
    r_squared: Option<f64>,
});
stored!(StoredHeldOutQuality of HeldOutQuality { rms: f64, bias: f64 });
stored!(StoredCrossValidation of CrossValidation {
    groups: usize,
    folds: usize,
    rows: u64,
    undetermined: Vec<String>,
    grouped: OfAxes<StoredHeldOutQuality>,
    random_folds: usize,
    random: Option<OfAxes<StoredHeldOutQuality>>,
});

stored!(StoredSelection of Selection {
    folds: usize,
    candidates: Vec<StoredCandidate>,
    best: usize,
    chosen: usize,
});
stored!(StoredCandidate of Candidate {
    basis: Name<Basis>,
    ridge: f64,
    features: usize,
    errors: Option<StoredCandidateErrors>,
});
stored!(StoredCandidateErrors of CandidateErrors {
    score: f64,
    standard_error: f64,
    rms: OfAxes<f64>,
});

stored!(StoredExcitation of Excitation {
    axes: OfAxes<StoredAxisExcitation>,
    correlation: OfAxes<OfAxes<f64>>,
    condition: Option<f64>,
});
stored!(StoredAxisExcitation of AxisExcitation {
    min: f64,
    max: f64,
    rms: f64,
    rows_positive: f64,
    rows_negative: f64,
    load_positive: f64,
    load_negative: f64,
});

// Messages about damaged sums have the names of these types.
stored!(MomentsDocument of StoredMoments {
    basis: Name<Basis>,
    rows: u64,
    channels: Vec<WrittenRange>,
    readings: Vec<String>,
    wrench: Vec<Integers>,
    squares: Vec<Integers>,
});
stored!(WrittenRange of ChannelRange { unit: Unit, lowest: i64, highest: i64 });
stored!(Unit of ReadingUnit { twos: u32, fives: u32 });
stored!(Integers of StoredIntegers { exponent: i32, values: Vec<String> });

stored!(StoredPayload of Payload {
    mass_kg: f64,
    centre_m: Vector,
    force_bias_n: Vector,
    moment_bias_nm: Vector,
});

stored!(StoredAccelerometer of Accelerometer {
    matrix: Matrix,
    offset_m_s2: Vector,
    residual_rms_m_s2: Vector,
});

/// One of a list, by its name.
pub trait Named: Copy + PartialEq + 'static {
    /// The list.
    const ALL: &'static [Self];

    /// The name in documents.
    fn name(self) -> &'static str;
}

macro_rules! named {
    ($($type:ident by $name:ident),*) => {$(
        impl Named for $type {
            const ALL: &'static [Self] = &$type::ALL;

            fn name(self) -> &'static str {
                $type::$name(self)
            }
        }
    )*};
}

named!(
    Basis by name, GroupKind by name, SolverKind by name, TimeBase by unit, MomentUnit by symbol, TimeUnit by symbol
);

/// A value that documents hold by its name.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Name<T>(T);

impl<T: Named> Stored for Name<T> {
    type Value = T;

    fn of(value: &T, _: Axes) -> Self {
        Self(*value)
    }

    fn value(self, _: Axes) -> Result<T, String> {
        Ok(self.0)
    }
}

impl<T: Named> Serialize for Name<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.0.name())
    }
}

impl<'de, T: Named> Deserialize<'de> for Name<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = String::deserialize(deserializer)?;
        let named = T::ALL.iter().find(|value| value.name() == name);
        named.map(|&value| Self(value)).ok_or_else(|| {
            let names = quoted(T::ALL.iter().map(|value| value.name()), ", ");
            de::Error::custom(format!("unknown `{name}`, expected one of {names}"))
        })
    }
}
