//! How far shared factors move the displacement of each sensor.

/// Most factors: beyond two, held-out groups of no recording that was tried gain.
pub const FACTORS: usize = 2;

/// How far each factor of variance one moves a sensor's displacement.
pub type Loadings = [f64; FACTORS];

/// Factors that sensors with these loadings share.
pub(super) fn factor_count<'a>(loadings: impl IntoIterator<Item = &'a Loadings> + Clone) -> usize {
    let is_used = |&factor: &usize| loadings.clone().into_iter().any(|c| c[factor] != 0.0);
    (0..FACTORS).rev().find(is_used).map_or(0, |last| last + 1)
}

/// Adds a sensor to `M = I + LᵀL/v` and `Lᵀr/v`, where `loading` is its row of `L = D·C`.
pub(super) fn add_factors(
    m: &mut [Loadings; FACTORS],
    pull: &mut Loadings,
    loading: Loadings,
    (residual, variance): (f64, f64),
) {
    for k in 0..FACTORS {
        let weighted = loading[k] / variance;
        pull[k] += weighted * residual;
        (0..FACTORS).for_each(|l| m[k][l] += weighted * loading[l]);
    }
}
