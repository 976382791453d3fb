//! The degrees of freedom of variances from groups, by Satterthwaite's approximation.
//!
//! The [scatter over groups](crate::sandwich) gives a combination `xᵀC` of coefficients a variance that is a quadratic
//! form of the errors. If the errors are independent and equally large, this variance has the first two moments of
//! a multiple of chi-squared with ν degrees of freedom. With `y = Fᵀx`,
//!
//! ```text
//! w_g = K_g·(I − K_g)^(−½)·y    d_g = yᵀK_g·(I − K_g)⁻¹·y    θ_gh = δ_gh·d_g − w_gᵀw_h
//! ν = (Σ θ_gg)² / Σ θ_gh²
//! ```
//!
//! (Bell & McCaffrey, Survey Methodology 28, 2002, p. 169; Pustejovsky & Tipton, J. Bus. Econ.
//! Stat. 36, 2018, p. 672). `Σ (w_gᵀw_h)²` over all pairs is the squared Frobenius norm of `Σ
//! w_g·w_gᵀ`, so groups can be added one after another. A few groups with large readings dominate:
//! 32 poses of a load cell have 5 to 8 degrees of freedom for slopes, not 31.

use crate::solution::Solution;
use crate::symmetric::{SymmetricMatrix, UpperTriangle, add_multiple, product};

/// Maximum number of features. Every coefficient takes a symmetric matrix of this order.
const MOST_FEATURES: usize = 200;

/// Vectors `y = Fᵀx`, one per coefficient. Empty with a ridge, which biases coefficients, with a dropped direction,
/// which leaves some undetermined, or with too many features.
pub(crate) fn coefficients(solution: &Solution) -> Vec<Vec<f64>> {
    let factor = UpperTriangle::new(&solution.factor);
    let features = factor.size();
    if solution.ridge > 0.0 || solution.rank < features || features > MOST_FEATURES {
        return Vec::new();
    }
    let row = |i| [&vec![0.0; i][..], factor.row(i)].concat();
    (0..features).map(row).collect()
}

pub(crate) struct Influence {
    /// `d_g`.
    pub(crate) own: f64,
    /// `w_g`.
    pub(crate) pull: Vec<f64>,
}

#[derive(Debug)]
pub(crate) struct Moments {
    trace: f64,
    squares: f64,
    products: SymmetricMatrix,
}

impl Moments {
    pub(crate) fn new(features: usize) -> Self {
        Self { trace: 0.0, squares: 0.0, products: SymmetricMatrix::zeros(features) }
    }

    pub(crate) fn add(&mut self, Influence { own, pull }: &Influence) {
        let square = product(pull, pull);
        self.trace += own - square;
        self.squares += own * (own - 2.0 * square);
        for (i, &x) in pull.iter().enumerate() {
            add_multiple(self.products.row_mut(i), x, &pull[i..]);
        }
    }

    pub(crate) fn degrees_of_freedom(&self) -> f64 {
        let norm = |i: usize| {
            let row = self.products.row(i);
            2.0 * product(row, row) - row[0] * row[0]
        };
        let pairs: f64 = (0..self.products.size).map(norm).sum();
        // A positive semi-definite θ gives a ν of at least one; rounding may give less.
        (self.trace * self.trace / (self.squares + pairs)).max(1.0)
    }
}
