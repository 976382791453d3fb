//! Sums over some of the rows, in the units of all: what fits without a part, and the spread of
//! coefficients from part to part, are computed from.

use super::cholesky::{AxisRow, axis_row};
use crate::exact::moments::layout::pair;
use crate::exact::moments::product_sums::Moments;
use crate::exact::moments::reading_unit::ReadingUnit;
use crate::exact::moments::rounding::round_scaled;
use crate::model::Term;

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

/// Where the origin is, and the powers of two that columns and axes are divided by: their exponents,
/// zero where there are only zeros.
#[derive(Clone, Debug)]
pub(crate) struct EquationScales {
    pub(crate) terms: Vec<Term>,
    /// Where the products of each two terms stand among the sums of readings, row by row.
    pub(crate) positions: Vec<usize>,
    /// The unit that readings are counted in.
    pub(crate) units: Vec<ReadingUnit>,
    pub(crate) centre: Vec<i64>,
    pub(crate) columns: Vec<i32>,
    pub(crate) axes: [i32; 6],
}

impl EquationScales {
    /// Powers of two just above the norms of columns and axes. `readings` are the sums of `moments` about the centre.
    pub(crate) fn new(
        moments: &Moments,
        readings: &[i128],
        terms: Vec<Term>,
        positions: Vec<usize>,
        centre: Vec<i64>,
    ) -> Self {
        let half = |exponent: i32| exponent.div_euclid(2) + 1;
        let size = terms.len();
        let columns = (0..size).map(|j| match readings[positions[j * size + j]] {
            0 => 0,
            square => half(square.ilog2() as i32),
        });
        let axes = std::array::from_fn(|axis| {
            let square = &moments.squares[pair(axis, axis)];
            match square.values[0].bits() {
                0 => 0,
                bits => half(square.exponent + bits as i32 - 1),
            }
        });
        let (columns, units) = (columns.collect(), moments.units());
        Self { columns, axes, positions, units, centre, terms }
    }

    /// The sums of some of the rows, about this origin.
    pub(crate) fn part(&self, moments: &Moments) -> PartMoments {
        let moments = moments.in_units(&self.units);
        let (readings, wrench) = moments.about(&self.centre);
        let size = self.terms.len();
        let ones: Vec<usize> = (self.terms.iter())
            .map(|&term| moments.layout.position(term, Term::INTERCEPT))
            .collect();
        let upper = (0..size).flat_map(|a| &self.positions[a * size + a..(a + 1) * size]);
        let sum = |axis: usize, position: usize, column: i32| {
            let exponent = moments.wrench[axis].exponent - column - self.axes[axis];
            round_scaled(&wrench[axis][position], exponent)
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
