//! Calibrations: fitting to arrays, reading and writing, application.

use std::path::PathBuf;
use std::sync::Mutex;

use calibration::dynamics::DynamicsRule;
use calibration::fit::{FitOptions, HeldOut, Outlier, RowName, Workers};
use calibration::memory::{MemoryState, NoTime, TimeBase};
use calibration::solver::SolverKind;
use calibration_file::{CalibrationFile, CalibrationFileError, Origin, Role, SourceFile};
use figures::{FitPlot, Size, fit_figure};
use forces::ForcePipeline;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, ndarray::Array2};
use pyo3::prelude::*;
use shell_data::dataset::BLOCK_ROWS;
use shell_data::lock::lock;
use shell_data::wrench::{Axes, Axis, PerAxis};
use shellcal::workflow::convert::interval_factors;
use shellcal::workflow::fit::{FitData, calibration_file};

use crate::arrays::{Arrays, range_of_columns, repeated};
use crate::error::{PythonFailure, PythonMessage};
use crate::interrupt::without_lock;
use crate::options;

/// A calibration with its origin, and the memory terms' state after frames converted one by one.
#[pyclass(frozen, module = "shellcal._native")]
pub(crate) struct Fitted(pub(crate) CalibrationFile, Mutex<Option<MemoryState>>);

impl From<CalibrationFile> for Fitted {
    fn from(file: CalibrationFile) -> Self {
        let memory = file.calibration.start_memory();
        Self(file, Mutex::new(memory))
    }
}

type Predicted<'py> = (Bound<'py, PyArray2<f64>>, Option<Bound<'py, PyArray2<f64>>>);

/// Arrays from Python: readings, wrench, position of each row's label with the labels, number of
/// repetitions of each row, its weight, and its time.
pub(crate) type RowArrays<'py> = (
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray2<'py, f64>,
    Option<(PyReadonlyArray1<'py, u32>, Vec<String>)>,
    Option<PyReadonlyArray1<'py, u32>>,
    Option<PyReadonlyArray1<'py, f64>>,
    Option<PyReadonlyArray1<'py, f64>>,
);

/// Creates the error for a calibration with memory terms that was applied without times.
fn no_time(error: NoTime) -> PythonMessage {
    let told = PythonMessage::new("OptionError", error.to_string());
    PythonMessage { hint: Some("give `time`, in s".to_owned()), ..told }
}

/// Passes the rows to `fit` without the interpreter's lock.
pub(crate) fn over_rows<T: Send>(
    py: Python<'_>,
    (x, y, groups, repeats, weights, time): RowArrays<'_>,
    progress: Option<Py<PyAny>>,
    fit: impl FnOnce(&Arrays<'_, '_>) -> Result<T, PythonFailure> + Send,
) -> Result<T, PythonFailure> {
    let (readings, wrench) = (x.as_array(), y.as_array());
    let groups =
        groups.as_ref().map(|(positions, labels)| (positions.as_array(), labels.as_slice()));
    let repeats = repeats.as_ref().map(|of| (of.as_array(), repeated(of.as_array())));
    let weights = weights.as_ref().filter(|_| repeats.is_none()).map(|of| of.as_array());
    let time = time.as_ref().map(|time| time.as_array());
    without_lock(py, progress.as_ref(), |watch| {
        fit(&Arrays { readings, wrench, groups, time, repeats, weights, watch })
    })
}

pub(crate) fn source(rows: &Arrays<'_, '_>) -> SourceFile {
    SourceFile {
        role: Role::Train,
        path: "<array>".into(),
        checksum: Some(rows.checksum()),
        digest: None,
        rows: rows.rows() as u64,
    }
}

/// Fits a calibration. Returns it with the warnings, and the verdict.
#[pyfunction]
#[pyo3(signature = (rows, *, model, intercept, ridge, solver, truncate, lag, memory_terms, cross_validation, seed,
    covariance, threads, made_by, serial, progress))]
#[expect(clippy::too_many_arguments, reason = "each has a name in Python")]
pub(crate) fn fit(
    py: Python<'_>,
    rows: RowArrays<'_>,
    model: &str,
    intercept: bool,
    ridge: f64,
    solver: &str,
    truncate: Option<f64>,
    lag: Option<f64>,
    memory_terms: Option<Vec<f64>>,
    cross_validation: Option<(Option<usize>,)>,
    seed: u64,
    covariance: &str,
    threads: usize,
    made_by: (String, String),
    serial: Option<String>,
    progress: Option<Py<PyAny>>,
) -> Result<(Fitted, Vec<String>, Vec<String>), PythonFailure> {
    let for_polynomials_only = [
        (ridge > 0.0, "ridge"),
        (solver != SolverKind::Exact.name(), "solver"),
        (!intercept, "intercept=False"),
        (rows.1.as_array().ncols() < Axis::ALL.len(), "a wrench of fewer than six axes"),
    ];
    let options = FitOptions {
        model: options::model(model)?,
        intercept,
        ridge,
        solver: options::solver(solver)?,
        truncate,
        // Parameters that are not given are searched for.
        dynamics: DynamicsRule { lag, memory: memory_terms.as_deref() },
        cross_validation: cross_validation.map(|(folds,)| HeldOut::from(folds)),
        seed,
        covariance: options::covariance(covariance)?,
        polynomials_only: for_polynomials_only.iter().find(|(given, _)| *given).map(|it| it.1),
        ..FitOptions::default()
    };
    over_rows(py, rows, progress, |rows| {
        let watch = |count: usize| {
            rows.watch.note(count as u64);
            !rows.watch.is_stopped()
        };
        let workers = Workers { watch: Some(&watch), ..Workers::new(threads) };
        let data = rows.dataset(false)?;
        let channels = data.channels();
        let mut data = FitData { train: data, ..FitData::default() };
        let fitted = data.fit(&FitOptions { workers, ..options })?;
        let mut warnings: Vec<String> = fitted.warnings.iter().map(ToString::to_string).collect();
        if let Some(reason) = fitted.dynamics.reason() {
            warnings.push(format!("lag and memory were not searched for: {reason}"));
        }
        if let Some(found) = fitted.outliers.found() {
            let columns = (1..=channels).map(|i| format!("s{i}"));
            let columns = columns.chain(Axis::ALL.map(|axis| axis.name().to_owned()));
            let columns: Vec<String> = columns.collect();
            // Counted from 1, like the lines of a file.
            let name = |row: &Outlier| RowName {
                file: "<array>".to_owned(),
                line: row.offset + row.row as u64 + 1,
                columns: columns.clone(),
            };
            let names: Vec<RowName> = found.rows.iter().map(name).collect();
            warnings.extend(found.warnings(Axes::ALL, &names));
        }
        let (made_by, date) = made_by;
        let origin = Origin {
            made_by,
            date,
            sensor_serial: serial,
            sources: vec![source(rows)],
            ..Origin::default()
        };
        let verdict = fitted.verdict().screen("").lines();
        Ok((calibration_file(&fitted, origin).into(), warnings, verdict))
    })
}

#[pymethods]
impl Fitted {
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf, edited: bool) -> Result<Self, PythonFailure> {
        py.detach(|| match edited {
            true => Ok(CalibrationFile::read_edited(&path)?.into()),
            false => Ok(CalibrationFile::read(&path)?.into()),
        })
    }

    #[staticmethod]
    fn parse(
        py: Python<'_>,
        document: &[u8],
        name: PathBuf,
        edited: bool,
    ) -> Result<Self, PythonFailure> {
        let named = |problem| CalibrationFileError { path: name.clone(), problem };
        py.detach(|| {
            let file = match edited {
                true => CalibrationFile::parse_edited(document),
                false => CalibrationFile::parse(document),
            };
            Ok(file.map_err(named)?.into())
        })
    }

    fn to_json(&self, py: Python<'_>) -> String {
        py.detach(|| self.0.to_json())
    }

    /// Returns the model, such as `cubic + offset`.
    fn name(&self) -> String {
        self.0.calibration.name()
    }

    fn channels(&self) -> usize {
        self.0.calibration.channels()
    }

    fn has_standard_errors(&self) -> bool {
        self.0.calibration.has_standard_errors()
    }

    /// Returns the half-width of an interval of this level in standard errors, per axis.
    fn interval_factors(&self, level: f64) -> Result<Vec<f64>, PythonFailure> {
        let calibration = &self.0.calibration;
        Ok(calibration.axes.of(&interval_factors(calibration, level)?))
    }

    fn has_memory(&self) -> bool {
        self.0.calibration.memory.is_some()
    }

    /// Returns the wrench of every row, and its standard errors if requested. With memory terms,
    /// the rows must be those of one recording, in order, at `time`.
    fn predict<'py>(
        &self,
        py: Python<'py>,
        x: PyReadonlyArray2<'py, f64>,
        errors: bool,
        time: Option<PyReadonlyArray1<'py, f64>>,
    ) -> Result<Predicted<'py>, PythonFailure> {
        let (readings, calibration) = (x.as_array(), &self.0.calibration);
        let time = time.as_ref().map(|time| time.as_array());
        let rows = readings.nrows();
        let (wrench, deviations) = without_lock(py, None, |watch| {
            let axes = calibration.axes;
            let new = || Array2::<f64>::zeros((rows, axes.count()));
            let (mut wrench, mut deviations) = (new(), errors.then(new));
            let mut of_block = PerAxis::default();
            let mut memory = calibration.start_memory();
            // Shifts forces to the rows' times on the reference's clock, if these are known.
            let lag = calibration.lag;
            let lag = lag.filter(|of| of.time_base == TimeBase::Rows || time.is_some());
            let mut moved = ForcePipeline::default();
            moved.lag = lag;
            let mut moved = moved.stream(&[]);
            let mut known = 0;
            for start in (0..rows).step_by(BLOCK_ROWS) {
                if watch.is_stopped() {
                    break;
                }
                let range = start..rows.min(start + BLOCK_ROWS);
                let mut block = range_of_columns(&readings, range.clone());
                let times_s: Vec<f64> =
                    time.map_or_else(Vec::new, |time| range.map(|row| time[row]).collect());
                if let Some(memory) = &mut memory {
                    block.extend(memory.terms(&times_s, &block).map_err(no_time)?);
                }
                calibration.wrench(&block, &mut of_block);
                let forces = moved.push(&times_s, std::mem::take(&mut of_block));
                let forces = forces.expect("no filter refuses rows");
                let forces = axes.of(&forces);
                copy(&forces, known, &mut wrench);
                known += forces.first().map_or(0, Vec::len);
                if let Some(deviations) = &mut deviations {
                    let errors = calibration.standard_errors(&block, None).unwrap_or_default();
                    copy(&axes.of(&errors), start, deviations);
                }
            }
            let last = moved.finish().expect("no filter refuses rows");
            copy(&axes.of(&last), known, &mut wrench);
            Ok((wrench, deviations))
        })?;
        Ok((wrench.into_pyarray(py), deviations.map(|errors| errors.into_pyarray(py))))
    }

    /// Returns the wrench of one frame at `time_s`, following the previous frames.
    #[pyo3(signature = (readings, time_s = None))]
    fn convert<'py>(
        &self,
        py: Python<'py>,
        readings: Vec<f64>,
        time_s: Option<f64>,
    ) -> Result<Bound<'py, PyArray1<f64>>, PythonFailure> {
        let calibration = &self.0.calibration;
        let (found, expected) = (readings.len(), calibration.channels());
        if found != expected {
            let message =
                format!("a frame has {found} readings, the calibration {expected} channels");
            return Err(PythonMessage::new("ArrayError", message).into());
        }
        let mut columns: Vec<Vec<f64>> =
            readings.into_iter().map(|reading| vec![reading]).collect();
        if let Some(memory) = &mut *lock(&self.1) {
            columns.extend(memory.terms(time_s.as_slice(), &columns).map_err(no_time)?);
        }
        let mut wrench = PerAxis::default();
        calibration.wrench(&columns, &mut wrench);
        let wrench = calibration.axes.iter().map(|axis| wrench[axis.index()][0]);
        Ok(PyArray1::from_iter(py, wrench))
    }

    /// Returns the figure of `--plot` for these rows, as SVG.
    fn figure(
        &self,
        py: Python<'_>,
        x: PyReadonlyArray2<'_, f64>,
        y: PyReadonlyArray2<'_, f64>,
        title: &str,
    ) -> String {
        let (readings, measured) = (x.as_array(), y.as_array());
        py.detach(|| {
            let of_readings = range_of_columns(&readings, 0..readings.nrows());
            let mut of_wrench = range_of_columns(&measured, 0..measured.nrows());
            of_wrench.resize(Axis::ALL.len(), vec![0.0; readings.nrows()]);
            let mut predicted = PerAxis::default();
            self.0.calibration.wrench(&of_readings, &mut predicted);
            let mut plot = FitPlot::default();
            plot.add(&predicted, &of_wrench);
            fit_figure(Size::Screen, title, self.0.calibration.axes, &plot, None).svg()
        })
    }

    /// Returns for each row whether a reading is outside the range of the training data.
    fn out_of_range(&self, py: Python<'_>, x: PyReadonlyArray2<'_, f64>) -> Vec<bool> {
        let readings = x.as_array();
        py.detach(|| {
            let all = range_of_columns(&readings, 0..readings.nrows());
            self.0.calibration.out_of_range(&all).into_iter().map(|flags| flags != 0).collect()
        })
    }
}

/// Copies columns into the rows of an array from `start` on.
fn copy(columns: &[Vec<f64>], start: usize, out: &mut Array2<f64>) {
    for (axis, column) in columns.iter().enumerate() {
        for (row, &value) in column.iter().enumerate() {
            out[(start + row, axis)] = value;
        }
    }
}
