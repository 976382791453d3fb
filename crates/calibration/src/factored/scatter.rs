//! The [scatter](crate::sandwich) of coefficients over groups of rows, from their triangles.
//!
//! With `M = R·F` for a group, `K_g = MᵀM` and `u_g = Mᵀ(Z − R·C)`: errors of about κ(X)·2⁻⁵³.

use faer::Mat;

use super::groups::FactoredGroups;
use super::rows::FactoredRows;
use crate::exact::NewGroup;
use crate::sandwich::{ClusterShare, GroupScatter, ScatterError, ScatterSums};
use crate::solver::Solution;

impl FactoredGroups {
    /// The scatter of the coefficients of a solution over these groups, or all but one of them, which are
    /// all rows that it was fitted to. The bias that a ridge brings is left out.
    ///
    /// # Errors
    /// [`ScatterError`] if some group alone determines a coefficient, or the features are too nearly dependent.
    pub(crate) fn scatter(
        &self,
        solution: &Solution,
        held_out: Option<usize>,
    ) -> Result<GroupScatter, ScatterError> {
        let others = self.groups.iter().enumerate().filter(|(place, _)| Some(*place) != held_out);
        let groups: Vec<&FactoredRows> =
            others.map(|(_, (_, rows))| rows).filter(|rows| rows.rows() > 0).collect();
        let factor = solution.factor.matrix();
        let products = &solution.residual_products;
        let products =
            std::array::from_fn(|a| std::array::from_fn(|b| products[(a.min(b), a.max(b))]));
        let mut sums = ScatterSums::new(groups.len(), factor.nrows(), products);
        // All are about one centre.
        let change =
            groups.first().and_then(|rows| rows.change(&solution.model, &solution.scaling));
        let change = change.ok_or(ScatterError::NearlyDependent)?;
        let (factors, coefficients) = (&change * &*factor, &change * &solution.coefficients);
        for (place, rows) in groups.iter().enumerate() {
            let columns = rows.times(&factors);
            let share = columns.transpose() * &columns;
            let score = columns.transpose() * rows.misfit(coefficients.as_ref());
            let errors = rows.errors_of(coefficients.as_ref());
            let errors = errors.map(|of| (of.rows, of.sum, of.squares));
            sums.add(place, ClusterShare { share, score, errors })?;
        }
        sums.finish(&factor.transpose().to_owned(), solution.ridge)
    }

    /// What the fit to all other groups, whose coefficients scatter by `scatter`, says of a group.
    pub(crate) fn on_new_group(
        &self,
        group: usize,
        solution: &Solution,
        scatter: &GroupScatter,
    ) -> Option<NewGroup> {
        let rows = &self.groups[group].1;
        let change = rows.change(&solution.model, &solution.scaling)?;
        let variance = scatter.factors.each_ref().map(|factor: &Mat<f64>| {
            let spread = rows.times(&(&change * factor));
            spread.squared_norm_l2() / rows.rows().max(1) as f64
        });
        Some(NewGroup { errors: rows.errors(solution)?, variance })
    }
}
