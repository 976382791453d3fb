//! Which features depend on others, decided in exact integers.

use std::fmt;

use num_bigint::BigInt;
use num_traits::Zero;

use super::modular::{Elimination, fraction, residue};
use crate::exact::moments::product_sums::Moments;
use crate::model::Term;

/// Features that are not independent over the rows.
#[derive(Clone, Debug, PartialEq)]
pub struct ExactRankLoss {
    /// Independent features.
    pub rank: usize,
    /// Features.
    pub features: usize,
    /// What makes the others dependent: the relations that do not follow from others of these.
    pub relations: Vec<Relation>,
}

/// A feature that is a combination of others in every row.
#[derive(Clone, Debug, PartialEq)]
pub struct Relation {
    /// The feature.
    pub feature: Term,
    /// What it is the sum of: features and their shares, in counts, simplest features first. Empty
    /// and not [`Self::exact`] if the shares are no fractions of moderate size.
    pub shares: Vec<(Term, f64)>,
    /// Whether the relation was found and checked in exact integers.
    pub exact: bool,
}

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
) -> Option<ExactRankLoss> {
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
    let relations = relations.collect();
    Some(ExactRankLoss { rank: size - dependent.len(), features: size, relations })
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

impl fmt::Display for ExactRankLoss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        /// More do not help to find the cause.
        const SHOWN: usize = 4;
        write!(f, "only `{}` of `{}` features are independent: ", self.rank, self.features)?;
        for (i, relation) in self.relations.iter().take(SHOWN).enumerate() {
            write!(f, "{}{relation}", if i == 0 { "" } else { "; " })?;
        }
        if self.relations.len() > SHOWN {
            write!(f, "; and `{}` more relations", self.relations.len() - SHOWN)?;
        }
        Ok(())
    }
}

impl Relation {
    /// The share of `term`, zero if it has none.
    pub fn share(&self, term: Term) -> f64 {
        self.shares.iter().find(|(t, _)| *t == term).map_or(0.0, |&(_, share)| share)
    }

    /// If the relation says that `s_j − s_i`, or `s_j` itself, has only two values: these.
    fn two_values(&self) -> Option<(Vec<u8>, f64, f64)> {
        let &[i, j] = self.feature.factors() else { return None };
        if i != j {
            return None;
        }
        let constant = self.share(Term::INTERCEPT);
        let slope = self.share(Term::product(&[j]));
        // d² = (a + b)·d − a·b for d = s_j or d = s_j − s_i.
        let roots = |sum: f64, product: f64| {
            let root = (sum * sum / 4.0 - product).sqrt();
            let (low, high) = (sum / 2.0 - root, sum / 2.0 + root);
            (low + high == sum && low * high == product).then_some((low, high))
        };
        let others: Vec<_> = self
            .shares
            .iter()
            .filter(|(t, _)| *t != Term::INTERCEPT && *t != Term::product(&[j]))
            .collect();
        let (low, high) = roots(slope, -constant)?;
        if others.is_empty() {
            return Some((vec![j], low, high));
        }
        let i = others.iter().find_map(|(t, _)| match t.factors() {
            &[a, b] if a == b => Some(a),
            _ => None,
        })?;
        let expected = [
            (Term::product(&[i]), -slope),
            (Term::product(&[i, i]), -1.0),
            (Term::product(&[i, j]), 2.0),
        ];
        let matches = expected.iter().all(|&(term, share)| self.share(term) == share);
        let count = expected.iter().filter(|(_, share)| *share != 0.0).count();
        (matches && others.len() == count).then(|| (vec![j, i], low, high))
    }
}

impl fmt::Display for Relation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        /// Longer sums are cut short.
        const SHOWN: usize = 8;
        let name = self.feature.name();
        if !self.exact {
            return write!(f, "`{name}` is a combination of simpler features");
        }
        if let ([_], []) = (self.feature.factors(), &self.shares[..]) {
            return write!(f, "`{name}` is always 0");
        }
        if let ([_], &[(Term::INTERCEPT, value)]) = (self.feature.factors(), &self.shares[..]) {
            return write!(f, "`{name}` is constant (always {value})");
        }
        if let Some((channels, low, high)) = self.two_values() {
            let names: Vec<String> = channels.iter().map(|c| format!("s{}", c + 1)).collect();
            return write!(f, "`{}` takes only the values {low} and {high}", names.join(" - "));
        }
        write!(f, "`{name}` = ")?;
        if self.shares.is_empty() {
            return write!(f, "0");
        }
        for (i, &(term, share)) in self.shares.iter().take(SHOWN).enumerate() {
            let sign = match (i, share < 0.0) {
                (0, false) => "",
                (0, true) => "-",
                (_, false) => " + ",
                (_, true) => " - ",
            };
            let (size, name) = (share.abs(), term.name());
            match (term == Term::INTERCEPT, size == 1.0) {
                (true, _) => write!(f, "{sign}{size}")?,
                (false, true) => write!(f, "{sign}{name}")?,
                (false, false) => write!(f, "{sign}{size}*{name}")?,
            }
        }
        if self.shares.len() > SHOWN {
            write!(f, " + ...")?;
        }
        Ok(())
    }
}
