use std::collections::HashMap;

use faer::{Mat, MatRef};

use crate::error::FitError;
use crate::features::Features;
use crate::held_out_errors::HeldOutErrors;
use crate::methods::{Method, SolverKind, solve_r_factor};
use crate::model::{Model, Term};
use crate::quality::AxisQuality;
use crate::r_factor::{RFactor, Ridge};
use crate::reading_ranges::ReadingRanges;
use crate::scaling::{ChannelSample, Scaling};
use crate::solution::Solution;
use shell_data::block::Block;
use shell_data::wrench::{Axis, PerAxis};

/// Rows reduced to the R factor of their features, including a constant, and of their wrench.
#[derive(Clone, Debug, PartialEq)]
pub struct FactoredRows {
    pub(super) features: Features,
    pub ranges: ReadingRanges,
    pub(crate) r_factor: RFactor,
}

impl FactoredRows {
    /// Starts with zero rows. `scaling` belongs to a model with a constant, and should come from a sample of the
    /// rows.
    ///
    /// # Panics
    /// If the numbers of columns of `scaling` and `model` differ.
    pub fn new(model: Model, scaling: Scaling) -> Self {
        let model = Model { intercept: true, ..model };
        let r_factor = RFactor::new(model.term_count(), Axis::ALL.len());
        let ranges = ReadingRanges::new(model.columns());
        Self { features: Features::new(model, scaling), ranges, r_factor }
    }

    pub fn rows(&self) -> u64 {
        self.ranges.rows
    }

    /// The model whose features were kept, with intercept.
    pub fn model(&self) -> Model {
        self.features.model
    }

    pub fn scaling(&self) -> &Scaling {
        &self.features.scaling
    }

    /// # Errors
    /// [`FitError`] if a reading or a wrench is not finite, or so large that products overflow.
    pub fn absorb(&mut self, block: &Block) -> Result<(), FitError> {
        self.ranges.merge(&ReadingRanges::from_block(block, self.model().columns())?);
        let p = self.features.len();
        self.r_factor.absorb(block.rows, |rows, columns, stride| {
            self.features.fill(&block.readings, rows.clone(), columns, stride);
            for (column, axis) in columns.chunks_mut(stride).skip(p).zip(&block.wrench) {
                column[..rows.len()].copy_from_slice(&axis[rows.clone()]);
            }
        });
        match self.r_factor.whole().is_all_finite() {
            true => Ok(()),
            false => Err(FitError::Overflow),
        }
    }

    /// Adds the rows of `later`, relative to the centre of `self`.
    ///
    /// # Panics
    /// If the families of features or the numbers of channels differ.
    pub fn merge(&mut self, later: &Self) {
        match later.features == self.features {
            true => self.r_factor.merge(&later.r_factor),
            false => {
                let change = later.change(&self.features.model, self.scaling());
                let change = change.expect("rows of one family of features");
                self.r_factor.merge(&later.r_factor.in_terms_of(change.as_ref()));
            }
        }
        self.ranges.merge(&later.ranges);
    }

    /// Merges all parts, relative to the centre of the first; `None` without parts.
    pub(crate) fn merged<'a>(parts: impl IntoIterator<Item = &'a Self>) -> Option<Self> {
        let mut parts = parts.into_iter();
        let mut all = parts.next()?.clone();
        parts.for_each(|part| all.merge(part));
        Some(all)
    }

    /// Centre (the mean, if an intercept absorbs the shift) and scale of these rows.
    fn scaling_of_all(&self, intercept: bool) -> Scaling {
        let (r, ones) = (self.r_factor.r(), self.features.len() - 1);
        let terms = self.features.model.terms();
        let about = self.scaling();
        let channel = |i: usize| {
            let position =
                terms.iter().position(|term| term.factors() == [i as u8]).unwrap_or(ones);
            let sum = r.col(ones).transpose() * r.col(position);
            let mean = about.centre[i] + about.scale[i] * (sum / self.rows().max(1) as f64);
            let range = self.ranges.channels[i];
            ChannelSample { min: range.min, max: range.max, mean, integers: false }
        };
        Scaling::from_channels((0..self.model().columns()).map(channel), intercept)
    }

    /// Fits `model`. `ridge` is λ; it applies to powers of the readings minus their mean over these
    /// rows.
    ///
    /// # Errors
    /// [`FitError`] if the rows do not determine the coefficients, or features of the model were not kept.
    pub fn solve(&self, model: &Model, ridge: f64) -> Result<Solution, FitError> {
        self.solve_by(SolverKind::Tsqr.into(), model, ridge)
    }

    /// Like [`solve`](Self::solve), by any method that weights all rows equally. [`SolverKind::RidgeGcv`]
    /// finds λ for these rows.
    ///
    /// # Errors
    /// As [`FactoredRows::solve`].
    pub fn solve_by(
        &self,
        method: Method,
        model: &Model,
        ridge: f64,
    ) -> Result<Solution, FitError> {
        if !(ridge >= 0.0 && ridge.is_finite()) {
            return Err(FitError::Ridge(ridge));
        }
        let scaling = self.scaling_of_all(model.intercept);
        let change = self.change(model, &scaling).ok_or_else(|| FitError::OtherFeatures {
            kept: self.features.model.name(),
            asked: model.name(),
        })?;
        let features = Features::new(*model, scaling);
        let free_column = model.intercept.then(|| features.len() - 1);
        let r_factor = self.r_factor.in_terms_of(change.as_ref());
        let (solved, ridge) =
            solve_r_factor(&r_factor, method, Ridge { lambda: ridge, free_column })
                .map_err(|error| FitError::from_least_squares(error, &features, &self.ranges))?;
        Ok(Solution::new(&features, solved, ridge))
    }

    /// The errors of a solution on these rows; `None` if features of its model were not kept.
    pub fn errors(&self, solution: &Solution) -> Option<PerAxis<HeldOutErrors>> {
        let change = self.change(&solution.model, &solution.scaling)?;
        Some(self.errors_of((&change * &solution.coefficients).as_ref()))
    }

    pub(super) fn errors_of(&self, coefficients: MatRef<'_, f64>) -> PerAxis<HeldOutErrors> {
        let products = self.r_factor.residual_products(coefficients);
        let sums = self.r_factor.sums_of_residuals(coefficients, self.features.len() - 1);
        std::array::from_fn(|axis| HeldOutErrors {
            rows: self.rows(),
            sum: sums[axis],
            squares: products[(axis, axis)],
        })
    }

    /// Quality of a solution on these rows; `None` if there are no rows, or if features of the
    /// solution's model were not kept.
    pub fn quality(&self, solution: &Solution) -> Option<PerAxis<AxisQuality>> {
        let errors = self.errors(solution).filter(|_| self.rows() > 0)?;
        let variances = self.load_variances();
        let rows = self.rows() as f64;
        Some(std::array::from_fn(|axis| errors[axis].quality(variances[axis] * rows)))
    }

    /// Mean squares of the loads, N² and (N·m)².
    pub fn mean_squares(&self) -> PerAxis<f64> {
        let nothing = Mat::zeros(self.features.len(), Axis::ALL.len());
        self.errors_of(nothing.as_ref()).map(|of| of.rms().powi(2))
    }

    /// Variances of the loads, N² and (N·m)².
    pub fn load_variances(&self) -> PerAxis<f64> {
        let (p, rows) = (self.features.len(), self.rows().max(1) as f64);
        let nothing = Mat::zeros(p, Axis::ALL.len());
        let sums = self.r_factor.sums_of_residuals(nothing.as_ref(), p - 1);
        let mean = |i: usize, axis: usize| if i + 1 == p { -sums[axis] / rows } else { 0.0 };
        let mean = Mat::from_fn(p, Axis::ALL.len(), mean);
        let about_mean = self.r_factor.residual_products(mean.as_ref());
        std::array::from_fn(|axis| about_mean[(axis, axis)] / rows)
    }

    /// Matrix `T`, terms of these rows × terms of `model`. It expresses the features of `model`, relative to the
    /// centre of `scaling`, by the features of these rows. `None` if these rows lack a product that `model`
    /// needs.
    ///
    /// With `z = (s − c)/k` and `z' = (s − c')/k'`, a standardised reading is `z' = a·z + b`, `a = k/k'`, `b = (c −
    /// c')/k'`, so `X' = X·T`. Scales are powers of two, so `a` is exact.
    pub(crate) fn change(&self, model: &Model, scaling: &Scaling) -> Option<Mat<f64>> {
        if model.columns() != self.model().columns() {
            return None;
        }
        let (own, wanted, about) = (self.model().terms(), model.terms(), self.scaling());
        let positions: HashMap<Term, usize> = own.iter().copied().zip(0..).collect();
        let channel = |&channel: &u8| {
            let i = usize::from(channel);
            let scale = scaling.scale[i];
            (about.scale[i] / scale, (about.centre[i] - scaling.centre[i]) / scale)
        };
        let mut change = Mat::zeros(own.len(), wanted.len());
        for (column, term) in wanted.iter().enumerate() {
            let factors = term.factors();
            for chosen in 0..1_u32 << factors.len() {
                let (mut share, mut kept) = (1.0, Vec::new());
                for (i, factor) in factors.iter().enumerate() {
                    let (a, b) = channel(factor);
                    if chosen & (1 << i) != 0 {
                        share *= a;
                        kept.push(*factor);
                    } else {
                        share *= b;
                    }
                }
                if share != 0.0 {
                    change[(*positions.get(&Term::product(&kept))?, column)] += share;
                }
            }
        }
        Some(change)
    }
}
