//! Which features depend on others, decided in exact integers.

use num_bigint::BigInt;
use num_traits::Zero;

use super::modular::{Elimination, fraction, residue};
use crate::exact::moments::product_sums::Moments;
use crate::model::Term;
use crate::rank_loss::{RankLoss, Relation};

/// The loss of rank of a model's features, `None` if they are independent.
///
/// Independence is certain: a minor of the integer Gram matrix that does not vanish modulo a prime
/// does not vanish. Dependence is certain where its relation is [`Relation::exact`], and otherwise
/// wrong with a probability near 2⁻⁶¹ per feature.
///
/// `positions`: where the products of each two terms stand among the sums, row by row.
pub(crate) fn rank_loss(
    moments: &Moments,
    model_terms: &[Term],
    positions: &[usize],
) -> Option<RankLoss> {
    let size = model_terms.len();
    // The simplest first, so that what depends on what reads best.
    let mut order: Vec<usize> = (0..size).collect();
    order.sort_unstable_by_key(|&i| (model_terms[i].factors().len(), i));
    let terms: Vec<Term> = order.iter().map(|&i| model_terms[i]).collect();
    let sum = |a: usize, b: usize| moments.readings[positions[order[a] * size + order[b]]];
    let mut gram = vec![0; size * size];
    for a in 0..size {
        for b in a..size {
            gram[a * size + b] = residue(sum(a, b));
        }
    }
    let elimination = Elimination::new(size, gram);
    let dependent = elimination.dependent();
    if dependent.is_empty() {
        return None;
    }
    // A multiple of a dependent feature is dependent too, which need not be said.
    let mut leading: Vec<usize> = Vec::new();
    for &j in &dependent {
        if !leading.iter().any(|&i| divides(terms[i], terms[j])) {
            leading.push(j);
        }
    }
    let relations = leading.into_iter().map(|j| {
        let shares = elimination.combination(j);
        let shares: Option<Vec<(usize, (i64, i64))>> = (shares.into_iter().enumerate())
            .filter(|&(_, share)| share != 0)
            .map(|(i, share)| Some((i, fraction(share)?)))
            .collect();
        let exact = shares.filter(|shares| vanishes(j, shares, sum));
        let counts = |term: Term| -> f64 {
            let per_count = |&c: &u8| moments.channels[usize::from(c)].unit.per_count();
            term.factors().iter().map(per_count).map(f64::from).product()
        };
        Relation {
            feature: terms[j],
            exact: exact.is_some(),
            shares: (exact.unwrap_or_default().into_iter())
                .map(|(i, (n, d))| {
                    (terms[i], n as f64 / d as f64 * (counts(terms[i]) / counts(terms[j])))
                })
                .collect(),
        }
    });
    let rank = size - dependent.len();
    Some(RankLoss::from_relations(rank, size, relations, &moments.reading_ranges()))
}

/// Whether `‖x_j − Σ shares·x‖² = 0`.
fn vanishes(j: usize, shares: &[(usize, (i64, i64))], sum: impl Fn(usize, usize) -> i128) -> bool {
    let common: BigInt = shares.iter().map(|&(_, (_, d))| BigInt::from(d)).product();
    let mut weights: Vec<(usize, BigInt)> =
        shares.iter().map(|&(i, (n, d))| (i, -(&common / d * n))).collect();
    weights.push((j, common));
    let mut square = BigInt::zero();
    for (a, weight_a) in &weights {
        for (b, weight_b) in &weights {
            square += weight_a * weight_b * sum(*a, *b);
        }
    }
    square.is_zero()
}

/// Whether `multiple` is `term` times other channels.
fn divides(term: Term, multiple: Term) -> bool {
    let mut rest = multiple.factors().iter();
    term.factors().iter().all(|factor| rest.any(|other| other == factor))
}
