//! The solver that keeps a triangle: Householder QR over row blocks.

use super::{Pass, Problem, Solution, Solver};
use crate::block::Block;
use crate::calibration::FitError;
use crate::calibration::extent::Extent;
use crate::calibration::features::Features;
use crate::calibration::triangle::{Ridge, Triangle, Workspace};
use crate::wrench::Axis;

/// Householder QR over row blocks, see [`crate::calibration::triangle`].
///
/// Its backward error is a small multiple of 2⁻⁵³, so the digits that coefficients lose are those
/// of the condition number, about six for the cubic model. The bits depend on how the rows are cut
/// into blocks, not on the number of threads.
#[derive(Clone, Debug)]
pub struct Tsqr {
    features: Features,
    ridge: Ridge,
}

impl Tsqr {
    /// A solver for `problem`.
    ///
    /// # Errors
    /// [`FitError::Ridge`] if the ridge parameter is negative or not finite.
    pub fn new(problem: Problem) -> Result<Self, FitError> {
        let Problem { model, scaling, ridge: lambda } = problem;
        if !(lambda >= 0.0 && lambda.is_finite()) {
            return Err(FitError::Ridge(lambda));
        }
        let features = Features::new(model, scaling);
        let free_column = model.intercept.then(|| features.len() - 1);
        Ok(Self { features, ridge: Ridge { lambda, free_column } })
    }

    fn workspace(&self) -> Workspace {
        Workspace::new(self.features.len(), Axis::ALL.len())
    }
}

impl Pass for Tsqr {
    type Partial = Triangle;

    fn empty(&self) -> Triangle {
        Triangle::new(self.features.len(), Axis::ALL.len())
    }

    fn reduce(&self, block: &Block) -> Result<Triangle, FitError> {
        let mut triangle = self.empty();
        let mut workspace = self.workspace();
        let step = workspace.rows();
        for start in (0..block.rows).step_by(step) {
            let rows = start..block.rows.min(start + step);
            triangle.absorb(rows.len(), &mut workspace, |columns, stride| {
                self.features.fill(&block.readings, rows.clone(), columns, stride);
                let wrench = columns.chunks_mut(stride).skip(self.features.len());
                for (column, axis) in wrench.zip(&block.wrench) {
                    column[..rows.len()].copy_from_slice(&axis[rows.clone()]);
                }
            });
        }
        Ok(triangle)
    }

    fn merge(&self, earlier: &mut Triangle, later: Triangle) {
        earlier.merge(&later);
    }
}

impl Solver for Tsqr {
    fn solve(&self, triangle: &Triangle, extent: &Extent) -> Result<Solution, FitError> {
        let solved = triangle
            .solve(self.ridge)
            .map_err(|error| FitError::of_least_squares(error, &self.features, extent))?;
        Ok(Solution::new(&self.features, solved))
    }
}
