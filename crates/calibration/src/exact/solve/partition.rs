//! Sums over some of the rows, in the units of all: what fits without a part, and the spread of
//! coefficients from part to part, are computed from.

use super::cholesky::{AxisRow, axis_row};
use super::fit::{ExactFit, SolveError};
use crate::double_double::DoubleDouble;
use crate::exact::moments::layout::pair;
use crate::exact::moments::product_sums::Moments;
use crate::exact::moments::rounding::round_scaled;
use crate::model::{Model, Term};
use shell_data::wrench::PerAxis;

/// Sums over all rows, ready to fit without parts of them.
#[derive(Debug)]
pub struct PartitionedMoments<'a> {
    pub(crate) total: &'a Moments,
    pub(crate) model: Model,
    pub(crate) scales: EquationScales,
    pub(crate) all: PartMoments,
}

/// Sums over a part of the rows, in the units of all. As large as the normal equations.
#[derive(Debug)]
pub struct PartMoments {
    pub(crate) rows: u64,
    /// The upper triangle of the Gram matrix, row by row.
    pub(crate) gram: Vec<i128>,
    /// Sums of the features.
    pub(crate) features: Vec<i128>,
    pub(crate) right: Vec<AxisRow>,
    /// Sums of the wrench and of its squares.
    pub(crate) wrench: AxisRow,
    pub(crate) squares: AxisRow,
}

/// Where the origin is, and the powers of two that columns and axes are divided by.
#[derive(Debug)]
pub(crate) struct EquationScales {
    pub(crate) terms: Vec<Term>,
    pub(crate) positions: Vec<usize>,
    pub(crate) centre: Vec<i64>,
    pub(crate) columns: Vec<i32>,
    pub(crate) axes: [i32; 6],
}

impl<'a> PartitionedMoments<'a> {
    /// Of the rows of `total`, to be fitted with `model`.
    ///
    /// # Errors
    /// [`SolveError::OtherFeatures`] if the features of the model were not summed;
    /// [`SolveError::TooFewRows`] for zero rows.
    pub fn new(total: &'a Moments, model: &Model) -> Result<Self, SolveError> {
        let terms = total.summed_terms(model)?;
        if total.rows() == 0 {
            return Err(SolveError::TooFewRows { rows: 0, coefficients: terms.len() });
        }
        let scales = EquationScales::new(total, terms, total.centre(model));
        let all = scales.part(total);
        Ok(Self { total, model: *model, scales, all })
    }

    /// The sums of some of the rows, in the form that is needed here.
    pub fn part(&self, moments: &Moments) -> PartMoments {
        self.scales.part(&moments.in_units_of(self.total))
    }

    /// The scales of a fit that has an origin and units of its own: its features as they are counted,
    /// in N and N·m.
    pub(crate) fn scales_of(&self, fit: &ExactFit) -> EquationScales {
        let reach = |&c: &u8| fit.counted.reach[usize::from(c)];
        let reach = |term: &Term| term.factors().iter().map(reach).sum();
        EquationScales {
            columns: self.scales.terms.iter().map(reach).collect(),
            centre: fit.counted.centre.clone(),
            positions: self.scales.positions.clone(),
            axes: [0; 6],
            terms: self.scales.terms.clone(),
        }
    }
}

impl EquationScales {
    fn new(total: &Moments, terms: Vec<Term>, centre: Vec<i64>) -> Self {
        let readings = total.readings_about(&centre);
        let positions = total.positions(&terms);
        let (columns, axes) = total.norms(&readings, &positions, terms.len());
        Self { columns, axes, positions, centre, terms }
    }

    pub(crate) fn part(&self, moments: &Moments) -> PartMoments {
        let (readings, wrench) = moments.about(&self.centre);
        let size = self.terms.len();
        let ones: Vec<usize> = (self.terms.iter())
            .map(|&term| moments.layout.position(term, Term::INTERCEPT))
            .collect();
        let upper = (0..size).flat_map(|a| &self.positions[a * size + a..(a + 1) * size]);
        let sum = |axis: usize, position: usize, column: i32| {
            let exponent = moments.wrench[axis].exponent - column - self.axes[axis];
            wrench[axis].rounded(position, exponent)
        };
        PartMoments {
            rows: moments.rows(),
            gram: upper.map(|&position| readings[position]).collect(),
            features: ones.iter().map(|&position| readings[position]).collect(),
            right: (ones.iter().zip(&self.columns))
                .map(|(&position, &column)| axis_row(|axis| sum(axis, position, column)))
                .collect(),
            wrench: axis_row(|axis| sum(axis, 0, 0)),
            squares: axis_row(|axis| {
                let square = &moments.squares[pair(axis, axis)];
                round_scaled(&square.values[0], square.exponent - 2 * self.axes[axis])
            }),
        }
    }
}

/// The coefficients of a fit for features as they are counted, axes as lanes.
pub(crate) fn counted_coefficients(fit: &ExactFit) -> Vec<AxisRow> {
    let row = |(row, &stretch): (&PerAxis<DoubleDouble>, &DoubleDouble)| -> AxisRow {
        axis_row(|axis| row[axis] * stretch)
    };
    fit.coefficients.iter().zip(&fit.counted.stretch).map(row).collect()
}
