//! Linear dependence of features, decided by symmetric elimination modulo the prime 2⁶¹ − 1. A minor that is nonzero
//! modulo a prime is nonzero, so nonzero pivots prove the rank. A pivot that is zero modulo the prime is truly zero,
//! except with a probability near 2⁻⁶¹. The resulting relations are checked in exact integers.

use num_bigint::BigInt;
use num_traits::Zero;

use super::held_out::EquationScales;
use super::product_sums::ExactSums;
use crate::model::Term;
use crate::rank_loss::{RankLoss, Relation};

/// Loss of rank. `None` if the features are independent, which is then certain. A dependence is certain if its relation
/// is [`Relation::exact`]; otherwise it is wrong with a probability near 2⁻⁶¹ per feature.
pub(crate) fn rank_loss(moments: &ExactSums, scales: &EquationScales) -> Option<RankLoss> {
    let EquationScales { terms: model_terms, positions, .. } = scales;
    let size = model_terms.len();
    // The simplest features come first, which gives the most readable relations.
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
    // Multiples of a dependent feature are dependent too and are not reported.
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

/// Returns true if `‖x_j − Σ shares·x‖² = 0`.
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

/// Returns true if `multiple` is `term` times further channels.
fn divides(term: Term, multiple: Term) -> bool {
    let mut rest = multiple.factors().iter();
    term.factors().iter().all(|factor| rest.any(|other| other == factor))
}

pub(crate) const PRIME: u64 = (1 << 61) - 1;

pub(crate) fn residue(value: i128) -> u64 {
    value.rem_euclid(i128::from(PRIME)) as u64
}

#[inline]
fn reduce(value: u128) -> u64 {
    let once = (value & u128::from(PRIME)) + (value >> 61);
    let twice = (once as u64 & PRIME) + (once >> 61) as u64;
    if twice >= PRIME { twice - PRIME } else { twice }
}

#[inline]
fn product(a: u64, b: u64) -> u64 {
    reduce(u128::from(a) * u128::from(b))
}

fn negative(a: u64) -> u64 {
    if a == 0 { 0 } else { PRIME - a }
}

/// Inverse by Fermat's little theorem: `a^(p − 2)`.
fn inverse(a: u64) -> u64 {
    let (mut power, mut result, mut exponent) = (a, 1, PRIME - 2);
    while exponent > 0 {
        if exponent & 1 == 1 {
            result = product(result, power);
        }
        power = product(power, power);
        exponent >>= 1;
    }
    result
}

/// The factorisation `A = Uᵀ·D⁻¹·U` of a symmetric matrix, with dependent columns left out.
pub(crate) struct Elimination {
    size: usize,
    /// Upper triangular; rows of dependent columns are zero.
    rows: Vec<u64>,
    /// Zero for dependent columns.
    inverses: Vec<u64>,
}

impl Elimination {
    /// Eliminates a symmetric matrix given by its rows. Columns keep their order: a column counts as
    /// dependent if it depends on earlier ones.
    pub(crate) fn new(size: usize, mut rows: Vec<u64>) -> Self {
        let mut inverses = vec![0; size];
        let mut sums = vec![0u128; size];
        for j in 0..size {
            let (above, row) = rows.split_at_mut(j * size);
            for (sum, &a) in sums[j..].iter_mut().zip(&row[j..size]) {
                *sum = u128::from(a);
            }
            let mut terms = 0;
            for (i, above) in above.chunks_exact(size).enumerate() {
                let factor = negative(product(above[j], inverses[i]));
                if factor == 0 {
                    continue;
                }
                for (sum, &u) in sums[j..].iter_mut().zip(&above[j..]) {
                    *sum += u128::from(factor) * u128::from(u);
                }
                // 32 terms below 2¹²² and one residue stay below 2¹²⁸.
                terms += 1;
                if terms == 32 {
                    sums[j..].iter_mut().for_each(|sum| *sum = u128::from(reduce(*sum)));
                    terms = 0;
                }
            }
            for (u, &sum) in row[j..size].iter_mut().zip(&sums[j..]) {
                *u = reduce(sum);
            }
            if row[j] == 0 {
                row[j..size].fill(0);
            } else {
                inverses[j] = inverse(row[j]);
            }
        }
        Self { size, rows, inverses }
    }

    pub(crate) fn dependent(&self) -> Vec<usize> {
        (0..self.size).filter(|&j| self.inverses[j] == 0).collect()
    }

    /// Coefficients that combine the independent columns before `j` into column `j`.
    pub(crate) fn combination(&self, j: usize) -> Vec<u64> {
        let mut shares = vec![0; j];
        for i in (0..j).rev() {
            let row = &self.rows[i * self.size..][..self.size];
            let mut rest = row[j];
            for k in i + 1..j {
                rest = reduce(u128::from(rest) + u128::from(product(row[k], negative(shares[k]))));
            }
            shares[i] = product(rest, self.inverses[i]);
        }
        shares
    }
}

/// Finds the unique fraction `n/d`, `|n| < 2³⁹`, `0 < d < 2²⁰`, that equals `value` modulo the
/// prime, if any, by Euclid's algorithm stopped half way (Wang, SYMSAC 1981).
pub(crate) fn fraction(value: u64) -> Option<(i64, i64)> {
    const NUMERATOR: i64 = 1 << 39;
    const DENOMINATOR: i64 = 1 << 20;
    let (mut r, mut next) = (PRIME as i64, value as i64);
    let (mut t, mut next_t) = (0i64, 1i64);
    while next >= NUMERATOR {
        let quotient = r / next;
        (r, next) = (next, r - quotient * next);
        (t, next_t) = (next_t, t - quotient.checked_mul(next_t)?);
        if next_t.abs() >= DENOMINATOR {
            return None;
        }
    }
    let _ = (r, t);
    Some(if next_t < 0 { (-next, -next_t) } else { (next, next_t) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn matrix(size: usize, entry: impl Fn(usize, usize) -> i128) -> Vec<u64> {
        (0..size * size).map(|k| residue(entry(k / size, k % size))).collect()
    }

    proptest! {
        #[test]
        fn fractions_are_recovered_from_residues(n in 1 - (1i64 << 39)..1 << 39, d in 1i64..1 << 20) {
            let value = product(residue(n.into()), inverse(d as u64));
            let (found_n, found_d) = fraction(value).unwrap();
            prop_assert_eq!(i128::from(found_n) * i128::from(d), i128::from(n) * i128::from(found_d));
        }

        #[test]
        fn residues_obey_the_laws_of_arithmetic(a: i64, b: i64) {
            let (a, b) = (i128::from(a), i128::from(b));
            prop_assert_eq!(product(residue(a), residue(b)), residue(a * b));
            prop_assert_eq!(negative(residue(a)), residue(-a));
        }
    }

    #[test]
    fn the_gram_matrix_of_dependent_columns_shows_which_and_how() {
        // Columns x0, x1, x2 = 3·x0 − x1/2, x3, from rows otherwise in general position.
        let rows: Vec<[i128; 4]> = (0..9)
            .map(|i: i128| {
                [i * i % 7, 2 * (i * 5 % 11), 3 * (i * i % 7) - i * 5 % 11, i * i * i % 13]
            })
            .collect();
        let gram = matrix(4, |a, b| rows.iter().map(|row| row[a] * row[b]).sum());
        let elimination = Elimination::new(4, gram);
        assert_eq!(elimination.dependent(), [2]);
        let shares: Vec<_> = elimination.combination(2).into_iter().map(fraction).collect();
        assert_eq!(shares, [Some((3, 1)), Some((-1, 2))]);
    }

    #[test]
    fn a_full_matrix_of_any_size_has_no_dependent_columns() {
        // Diagonally dominant, more than 32 rows.
        let full = matrix(50, |a, b| if a == b { -1000 } else { ((a + 1) * (b + 1) % 17) as i128 });
        assert!(Elimination::new(50, full).dependent().is_empty());
    }
}
