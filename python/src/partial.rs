//! Partial fits: sums that can be merged.

use std::path::PathBuf;

use calibration::fit::{
    FitOptions, HeldOut, ModelRule, RANDOM_FOLDS, Workers, random_split, sum_groups,
};
use calibration::validation::grouped::{Apart, GroupKind, RandomSplit};
use calibration::{Basis, FitError, Model};
use calibration_file::{
    CalibrationFileError, PartialFit, PartialGroups, PartialStream, SourceFile, Sums,
};
use log_file::Log;
use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use shellcal::workflow::partial::{self, KeptGroups, PartialOptions, fit_merged, merged_file};

use crate::error::{PythonFailure, PythonMessage};
use crate::fitted::{Fitted, over_rows, source};
use crate::interrupt::without_lock;
use crate::log::{ReadRules, mapping, read_options};
use crate::options;

#[pyclass(module = "shellcal._native")]
pub(crate) struct Partial(PartialFit);

/// The kind of sums: model, intercept, groups kept, seed of the random split.
type What = (String, bool, Option<String>, u64);

fn largest_basis(model: &str) -> Result<Basis, PythonFailure> {
    Ok(match options::model(model)? {
        ModelRule::Given(basis) => basis,
        // The sums of the largest model serve all models that `auto` compares.
        ModelRule::Auto | ModelRule::Physics => Basis::Poly3,
    })
}

#[pymethods]
impl Partial {
    #[staticmethod]
    fn from_arrays(
        py: Python<'_>,
        x: PyReadonlyArray2<'_, f64>,
        y: PyReadonlyArray2<'_, f64>,
        groups: Option<(PyReadonlyArray1<'_, u32>, Vec<String>)>,
        name: PathBuf,
        what: What,
        made: (String, String),
    ) -> Result<Self, PythonFailure> {
        let (model, intercept, kept, seed) = what;
        let basis = largest_basis(&model)?;
        over_rows(py, (x, y, groups, None, None, None), None, |rows| {
            let split = match kept {
                Some(_) => random_split(RANDOM_FOLDS, seed),
                None => RandomSplit::default(),
            };
            let (data, apart) = (rows.dataset(true)?, (Apart::Groups, split));
            let watch = |_| !rows.watch.is_stopped();
            let workers = Workers { watch: Some(&watch), ..Workers::default() };
            let sums = sum_groups(&data, basis, apart, workers)?;
            let total = sums.total().ok_or(FitError::NoRows)?.clone();
            let model = Model { basis, intercept, channels: total.channels(), memory: 0 };
            let mut partial = PartialFit::new(model, Sums::Exact(total));
            (partial.made_by, partial.date) = made;
            let digest = Some(data.fingerprint().to_string());
            partial.sources = vec![SourceFile { path: name, digest, ..source(rows) }];
            if kept.is_some() {
                let first_in = vec![0; sums.groups.len()];
                let groups = PartialGroups::exact(GroupKind::Column, split, sums, &first_in);
                partial.groups = Some(groups);
            }
            Ok(Self(partial))
        })
    }

    #[staticmethod]
    fn from_logs(
        py: Python<'_>,
        paths: Vec<PathBuf>,
        what: What,
        fresh: bool,
        reading: ReadRules,
        made: (String, String),
    ) -> Result<Self, PythonFailure> {
        let (model, intercept, kept, seed) = what;
        let (names, skipped, threads) = reading;
        let mapping = mapping(&names)?;
        let groups = match kept.as_deref() {
            None => None,
            Some("auto") => Some(KeptGroups::Auto),
            Some("file") => Some(KeptGroups::By(GroupKind::File)),
            Some("column") => Some(KeptGroups::By(GroupKind::Column)),
            Some(found) => {
                let message = format!("groups is `{found}`, expected `auto`, `file` or `column`");
                return Err(PythonMessage::new("OptionError", message).into());
            }
        };
        let options = PartialOptions {
            basis: largest_basis(&model)?,
            intercept,
            groups,
            seed,
            r_factors: false,
            fresh,
            mapping: &mapping,
            read: read_options(&skipped, threads),
        };
        without_lock(py, None, |_| {
            let open = |path: &PathBuf| Log::open(path, &mapping);
            let mut logs = paths.iter().map(open).collect::<Result<Vec<_>, _>>()?;
            let mut partial = partial::sum(&mut logs, &options)?;
            (partial.made_by, partial.date) = made;
            Ok(Self(partial))
        })
    }

    #[staticmethod]
    fn parse(py: Python<'_>, document: &[u8]) -> Result<Self, PythonFailure> {
        let error = |problem| CalibrationFileError { path: "<bytes>".into(), problem };
        py.detach(|| Ok(Self(PartialFit::parse(document).map_err(error)?)))
    }

    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> Result<Self, PythonFailure> {
        py.detach(|| Ok(Self(PartialFit::read(&path)?)))
    }

    /// Returns the document, in an order that does not depend on the order of merging.
    fn document<'py>(&mut self, py: Python<'py>) -> Bound<'py, PyBytes> {
        let partial = &mut self.0;
        let document = py.detach(|| {
            partial.put_in_order();
            partial.to_json()
        });
        PyBytes::new(py, document.as_bytes())
    }

    fn copy(&self, py: Python<'_>) -> Self {
        py.detach(|| Self(self.0.clone()))
    }

    /// Adds the rows of another partial fit; after an error this one is unchanged.
    fn merge(&mut self, py: Python<'_>, other: PyRef<'_, Self>) -> Result<(), PythonFailure> {
        let (own, other) = (&mut self.0, &other.0);
        py.detach(|| Ok(own.merge(other)?))
    }

    fn has_counted(&self, other: PyRef<'_, Self>) -> bool {
        self.0.has_counted_all_of(&other.0)
    }

    fn rows(&self) -> u64 {
        self.0.sums.rows()
    }

    fn model(&self) -> String {
        self.0.model.name()
    }

    fn channels(&self) -> usize {
        self.0.model.channels
    }

    /// Returns the labels of the groups, if they are kept.
    fn groups(&mut self) -> Option<Vec<String>> {
        self.0.put_in_order();
        let groups = self.0.groups.as_ref()?;
        Some(groups.groups.iter().map(|group| group.label.clone()).collect())
    }

    /// Returns name, checksum and rows of each source.
    fn sources(&mut self) -> Vec<(PathBuf, Option<String>, u64)> {
        self.0.put_in_order();
        let source = |of: &SourceFile| (of.path.clone(), of.checksum.clone(), of.rows);
        self.0.sources.iter().map(source).collect()
    }

    #[expect(clippy::too_many_arguments, reason = "each has a name in Python")]
    fn solve(
        &mut self,
        py: Python<'_>,
        model: Option<String>,
        ridge: f64,
        cross_validation: Option<(Option<usize>,)>,
        covariance: &str,
        made: (String, String),
        serial: Option<String>,
    ) -> Result<Fitted, PythonFailure> {
        let options = FitOptions {
            ridge,
            cross_validation: cross_validation.map(|(folds,)| HeldOut::from(folds)),
            covariance: options::covariance(covariance)?,
            ..FitOptions::default()
        };
        let model = model.map(|name| options::model(&name)).transpose()?;
        let partial = &mut self.0;
        without_lock(py, None, |_| {
            partial.put_in_order();
            let fitted = fit_merged(partial, model, &options)?;
            let mut file = merged_file(&fitted, partial);
            file.origin.sensor_serial = serial.or(file.origin.sensor_serial);
            (file.origin.made_by, file.origin.date) = made;
            Ok(file.into())
        })
    }
}

#[pyfunction]
pub(crate) fn read_partials(
    py: Python<'_>,
    documents: &[u8],
) -> Result<Vec<Partial>, PythonFailure> {
    py.detach(|| PartialStream::new(documents, "<bytes>").map(|one| Ok(Partial(one?))).collect())
}
