//! Equations of a step.

use super::super::cholesky::Cholesky;
use super::load::OWN;
use least_squares::symmetric::{SymmetricMatrix, UpperTriangle, product};

/// The minimised sum and its equations. The border holds the shared unknowns: sensors, then offsets.
pub(super) struct LoadEquations {
    pub(super) cost: f64,
    pub(super) border: SymmetricMatrix,
    pub(super) descent: Vec<f64>,
    pub(super) loads: Vec<OfLoad>,
}

pub(super) struct OfLoad {
    pub(super) curvature: [[f64; OWN]; OWN],
    pub(super) descent: [f64; OWN],
    /// A row for each deviation.
    pub(super) coupling: [Vec<f64>; OWN],
    pub(super) rows: Vec<Row>,
}

pub(super) struct Row {
    pub(super) residual: f64,
    pub(super) slope: f64,
    pub(super) by_load: [f64; OWN],
    /// Positions in the border that it depends on, with the derivatives.
    pub(super) border: Vec<(usize, f64)>,
}

/// Inverse `h⁻¹` of a load's curvature, and `h⁻¹·coupling`, which gives the change of the load with the border.
pub(super) struct Eliminated {
    pub(super) factor: Cholesky<OWN>,
    pub(super) following: [Vec<f64>; OWN],
}

impl LoadEquations {
    pub(super) fn pull(&mut self, position: usize, precision: f64, off: f64) {
        self.border.row_mut(position)[0] += precision;
        self.descent[position] += precision * off;
        self.cost += precision * off * off;
    }

    pub(super) fn add_load(
        &mut self,
        rows: Vec<Row>,
        (of_readings, of_own): (&[f64], &[f64; OWN]),
        own: &[f64; OWN],
    ) {
        let mut of = OfLoad {
            curvature: [[0.0; OWN]; OWN],
            descent: [0.0; OWN],
            coupling: std::array::from_fn(|_| vec![0.0; self.descent.len()]),
            rows,
        };
        for k in 0..OWN {
            of.curvature[k][k] += of_own[k];
            of.descent[k] -= of_own[k] * own[k];
            self.cost += of_own[k] * own[k] * own[k];
        }
        for (row, weight) in of.rows.iter().zip(of_readings) {
            self.cost += weight * row.residual * row.residual;
            for &(position, by) in &row.border {
                self.descent[position] += weight * row.residual * by;
                let row_of = self.border.row_mut(position);
                for &(other, by_other) in row.border.iter().filter(|(other, _)| *other >= position)
                {
                    row_of[other - position] += weight * by * by_other;
                }
                (0..OWN).for_each(|k| of.coupling[k][position] += weight * row.by_load[k] * by);
            }
            for k in 0..OWN {
                of.descent[k] += weight * row.residual * row.by_load[k];
                (0..OWN)
                    .for_each(|l| of.curvature[k][l] += weight * row.by_load[k] * row.by_load[l]);
            }
        }
        self.loads.push(of);
    }

    /// Equations of the border alone, with the diagonals of all blocks multiplied by `more`.
    pub(super) fn reduced(
        &self,
        more: f64,
    ) -> Option<(SymmetricMatrix, Vec<f64>, Vec<Eliminated>)> {
        let (mut border, mut descent) = (self.border.clone(), self.descent.clone());
        (0..border.size).for_each(|i| border.row_mut(i)[0] *= more);
        let mut eliminated = Vec::with_capacity(self.loads.len());
        for load in &self.loads {
            let mut curvature = load.curvature;
            (0..OWN).for_each(|k| curvature[k][k] *= more);
            let factor = Cholesky::new(&curvature)?;
            // With h = L·Lᵀ: L⁻¹·coupling, whose squares are subtracted from the border.
            let mut taken: [Vec<f64>; OWN] = std::array::from_fn(|_| vec![0.0; border.size]);
            let mut following = taken.clone();
            for (position, descent) in descent.iter_mut().enumerate() {
                let column = std::array::from_fn(|k| load.coupling[k][position]);
                let (half, whole) = (factor.forward(&column), factor.solve(&column));
                for k in 0..OWN {
                    (taken[k][position], following[k][position]) = (half[k], whole[k]);
                    *descent -= whole[k] * load.descent[k];
                }
            }
            border.subtract_squares(&taken);
            eliminated.push(Eliminated { factor, following });
        }
        Some((border, descent, eliminated))
    }

    /// Factor of the inverse covariance of the border, and the eliminated loads.
    pub(super) fn factor(&self) -> Option<(UpperTriangle, Vec<Eliminated>)> {
        let (border, _, eliminated) = self.reduced(1.0)?;
        Some((border.cholesky()?, eliminated))
    }
}

impl Eliminated {
    /// Change of a load's deviations that compensates a step of the border, to be subtracted.
    pub(super) fn follow(&self, step: &[f64]) -> [f64; OWN] {
        self.following.each_ref().map(|row| product(row, step))
    }

    /// Standard errors of a load's deviations, with the factor of the border.
    pub(super) fn standard_errors(&self, border: &UpperTriangle) -> [f64; OWN] {
        let own = self.factor.inverse();
        std::array::from_fn(|k| (own[k][k] + border.square(self.following[k].clone())).sqrt())
    }
}
