//! What the report of a calibration is made from.

use super::super::outliers::OutlierTable;
use super::super::{CalibrationFacts, Heading};
use calibration::fit::{FewGroups, GroupErrors};
use calibration::validation::excitation::Excitation;
use calibration::validation::selection::Selection;
use figures::Figure;

/// What the report of a calibration says. N and N·m.
#[derive(Clone, Debug)]
pub struct CalibrationReport<'a> {
    /// What it is about, and where it comes from.
    pub heading: Heading<'a>,
    /// The calibration, its errors and what it was made from.
    pub calibration: CalibrationFacts<'a>,
    /// What it is worth on data that it has not seen, in sentences.
    pub verdict: &'a [String],
    /// Features of the model, and how many of them the data determine.
    pub features: usize,
    /// See there.
    pub rank: usize,
    /// Whether converted frames have standard errors.
    pub has_standard_errors: bool,
    /// Too few groups for the features, where that is so.
    pub few_groups: Option<FewGroups>,
    /// What models were compared, if they were.
    pub selection: Option<&'a Selection>,
    /// Why this model, in sentences.
    pub reasons: &'a [String],
    /// What is to be done about it, in sentences.
    pub warnings: &'a [String],
    /// How the training loads cover the six axes.
    pub excitation: Option<&'a Excitation>,
    /// Rows of the test logs, and those of them with a reading outside the range of the training data.
    pub test_rows: [u64; 2],
    /// Errors by group of the training logs.
    pub train_groups: &'a [GroupErrors],
    /// Errors by group of the test logs.
    pub test_groups: &'a [GroupErrors],
    /// Suspicious rows; `None` where nobody looked.
    pub outliers: Option<OutlierTable>,
    /// Predicted against measured.
    pub figure: &'a Figure,
    /// The loads of training and test rows.
    pub coverage: &'a Figure,
}
