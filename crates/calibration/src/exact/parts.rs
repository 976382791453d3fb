//! Sums over some of the rows, in the units of all: what fits without a part, and the spread of
//! coefficients from part to part, are computed from.

use super::cholesky::Row;
use super::moments::Moments;
use super::open_sums::pair;
use super::rounding::round_scaled;
use super::solve::{Fit, SolveError, contains};
use crate::double_double::DoubleDouble;
use crate::model::{Model, Term};
use shell_data::wrench::PerAxis;

/// Sums over all rows, ready to fit without parts of them.
#[derive(Debug)]
pub struct Parts<'a> {
    pub(super) total: &'a Moments,
    pub(super) model: Model,
    pub(super) frame: Frame,
    pub(super) all: Part,
}

/// Sums over a part of the rows, in the units of all. As large as the normal equations.
#[derive(Debug)]
pub struct Part {
    pub(super) rows: u64,
    /// The upper triangle of the Gram matrix, row by row.
    pub(super) gram: Vec<i128>,
    /// Sums of the features.
    pub(super) features: Vec<i128>,
    pub(super) right: Vec<Row>,
    /// Sums of the wrench and of its squares.
    pub(super) wrench: Row,
    pub(super) squares: Row,
}

/// Where the origin is, and the powers of two that columns and axes are divided by.
#[derive(Debug)]
pub(super) struct Frame {
    pub(super) terms: Vec<Term>,
    pub(super) positions: Vec<usize>,
    pub(super) centre: Vec<i64>,
    pub(super) columns: Vec<i32>,
    pub(super) axes: [i32; 6],
}

impl<'a> Parts<'a> {
    /// Of the rows of `total`, to be fitted with `model`.
    ///
    /// # Errors
    /// [`SolveError::OtherFeatures`] if the features of the model were not summed;
    /// [`SolveError::TooFewRows`] of no rows.
    pub fn new(total: &'a Moments, model: &Model) -> Result<Self, SolveError> {
        let terms = model.terms();
        if model.channels != total.channels() || !contains(total, &terms) {
            let summed =
                Model { basis: total.basis(), intercept: true, channels: total.channels() };
            return Err(SolveError::OtherFeatures { summed: summed.name(), asked: model.name() });
        }
        if total.rows() == 0 {
            return Err(SolveError::TooFewRows { rows: 0, coefficients: terms.len() });
        }
        let centre = (0..model.channels)
            .map(|i| if model.intercept { total.rounded_mean(i) } else { 0 })
            .collect();
        let frame = Frame::new(total, terms, centre);
        let all = frame.part(total);
        Ok(Self { total, model: *model, frame, all })
    }

    /// The sums of some of the rows, in the form that is needed here.
    pub fn part(&self, moments: &Moments) -> Part {
        self.frame.part(&moments.in_units_of(self.total))
    }

    /// The frame of a fit that has an origin and units of its own: its features as they are counted,
    /// in N and N·m.
    pub(super) fn frame_of(&self, fit: &Fit) -> Frame {
        let reach = |&c: &u8| fit.counted.reach[usize::from(c)];
        let reach = |term: &Term| term.factors().iter().map(reach).sum();
        Frame {
            columns: self.frame.terms.iter().map(reach).collect(),
            centre: fit.counted.centre.clone(),
            positions: self.frame.positions.clone(),
            axes: [0; 6],
            terms: self.frame.terms.clone(),
        }
    }
}

impl Frame {
    fn new(total: &Moments, terms: Vec<Term>, centre: Vec<i64>) -> Self {
        let readings = total.readings_about(&centre);
        let positions = total.positions(&terms);
        let (columns, axes) = total.norms(&readings, &positions, terms.len());
        Self { columns, axes, positions, centre, terms }
    }

    pub(super) fn part(&self, moments: &Moments) -> Part {
        let (readings, wrench) = moments.about(&self.centre);
        let size = self.terms.len();
        let ones: Vec<usize> = (self.terms.iter())
            .map(|&term| moments.layout.position(term, Term::INTERCEPT))
            .collect();
        let upper = (0..size).flat_map(|a| &self.positions[a * size + a..(a + 1) * size]);
        let per_axis = |of: &dyn Fn(usize) -> DoubleDouble| -> Row {
            std::array::from_fn(|i| if i < 6 { of(i) } else { DoubleDouble::ZERO })
        };
        let sum = |axis: usize, position: usize, column: i32| {
            let exponent = moments.wrench[axis].exponent - column - self.axes[axis];
            wrench[axis].rounded(position, exponent)
        };
        Part {
            rows: moments.rows(),
            gram: upper.map(|&position| readings[position]).collect(),
            features: ones.iter().map(|&position| readings[position]).collect(),
            right: (ones.iter().zip(&self.columns))
                .map(|(&position, &column)| per_axis(&|axis| sum(axis, position, column)))
                .collect(),
            wrench: per_axis(&|axis| sum(axis, 0, 0)),
            squares: per_axis(&|axis| {
                let square = &moments.squares[pair(axis, axis)];
                round_scaled(&square.values[0], square.exponent - 2 * self.axes[axis])
            }),
        }
    }
}

/// The coefficients of a fit for features as they are counted, axes as lanes.
pub(super) fn counted_coefficients(fit: &Fit) -> Vec<Row> {
    let row = |(row, &stretch): (&PerAxis<DoubleDouble>, &DoubleDouble)| -> Row {
        std::array::from_fn(|i| row.get(i).map_or(DoubleDouble::ZERO, |&c| c * stretch))
    };
    fit.coefficients.iter().zip(&fit.counted.stretch).map(row).collect()
}
