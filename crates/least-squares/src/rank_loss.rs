//! Causes of a loss of rank, from the R factor alone, whose columns have the lengths and angles of the features.

use std::fmt;

use faer::perm::swap_cols_idx;
use faer::prelude::*;
use faer::{Col, ColRef, Mat, MatRef};

use crate::features::{Features, Recipe};
use crate::model::Term;
use crate::reading_ranges::ReadingRanges;

/// A relation that holds in every row of the training data, except for rounding.
#[derive(Clone, Debug, PartialEq)]
pub enum Dependence {
    /// A channel, from 0, that always has the same value.
    Constant {
        channel: usize,
        /// Value of all readings, in counts.
        value: f64,
    },
    /// `s[second] = ratio·s[first] + offset`, channels counted from 0, offset in counts.
    Line {
        first: usize,
        second: usize,
        /// Counts of the second per count of the first.
        ratio: f64,
        offset: f64,
    },
    /// Features with coefficients, whose sum is always zero. The largest coefficient is one.
    Combination(Vec<(Term, f64)>),
    /// A feature that is a combination of others, found in integer arithmetic.
    Relation(Relation),
}

#[derive(Clone, Debug, PartialEq)]
pub struct Relation {
    pub feature: Term,
    /// Terms that add up to `feature`, with coefficients in counts, simplest first. Empty, and not [`Self::exact`], if
    /// the coefficients are not fractions of moderate size.
    pub shares: Vec<(Term, f64)>,
    /// True if the relation was found and checked in exact integers.
    pub exact: bool,
}

/// Number of independent features, and the relations that make the others depend on them.
#[derive(Clone, Debug, PartialEq)]
pub struct RankLoss {
    pub rank: usize,
    pub features: usize,
    /// Constant channels first.
    pub dependences: Vec<Dependence>,
}

/// Relative distance below which a column counts as a combination of two others. Rounding errors are some hundred times
/// smaller; one count of 16 bits is more than a hundred million times larger.
const SAME_LINE: f64 = 1e-13;

/// Size below which a coefficient of a combination counts as a rounding error and is omitted.
const NEGLIGIBLE_SHARE: f64 = 1e-6;

impl RankLoss {
    /// Explains a rank loss from the p × p R factor `r` and from `null_space`, p × (p − rank): the directions in which
    /// the columns of `r`, scaled to norm one, cancel.
    pub fn explain(
        features: &Features,
        ranges: &ReadingRanges,
        r: MatRef<'_, f64>,
        null_space: MatRef<'_, f64>,
    ) -> Self {
        let (constant, mut dependences) = Dependence::constants(ranges);
        let moving: Vec<usize> =
            (0..features.model.columns()).filter(|i| !constant.contains(i)).collect();
        dependences.extend(lines(features, r, &moving));
        if dependences.is_empty() {
            let terms = features.model.terms();
            let directions = echelon(null_space.to_owned());
            dependences
                .extend(directions.col_iter().map(|v| Dependence::Combination(shares(&terms, v))));
        }
        Self { rank: features.len() - null_space.ncols(), features: features.len(), dependences }
    }

    /// Explains a rank loss by relations found in integers. Relations of constant channels are left out.
    pub(crate) fn from_relations(
        rank: usize,
        features: usize,
        relations: impl Iterator<Item = Relation>,
        ranges: &ReadingRanges,
    ) -> Self {
        let (constant, mut dependences) = Dependence::constants(ranges);
        let moves = |channel: &u8| !constant.contains(&usize::from(*channel));
        let others = relations.filter(|of| of.feature.factors().iter().all(moves));
        dependences.extend(others.map(Dependence::from));
        Self { rank, features, dependences }
    }
}

fn lines(features: &Features, r: MatRef<'_, f64>, channels: &[usize]) -> Vec<Dependence> {
    let column_of = |wanted: Recipe| features.recipe().iter().position(|&recipe| recipe == wanted);
    let constant = column_of(Recipe::One).map(|j| r.col(j));
    let mut found: Vec<Dependence> = Vec::new();
    let mut dependent: Vec<usize> = Vec::new();
    for (i, &first) in channels.iter().enumerate() {
        for &second in &channels[i + 1..] {
            let of = |channel| column_of(Recipe::Reading(channel)).map(|j| r.col(j));
            let (Some(x), Some(y)) = (of(first), of(second)) else { continue };
            if dependent.contains(&second) {
                continue;
            }
            if let Some((slope, offset)) = line(x, y, constant) {
                let scaling = &features.scaling;
                let ratio = slope * scaling.scale[second] / scaling.scale[first];
                let offset = scaling.centre[second] + offset * scaling.scale[second]
                    - ratio * scaling.centre[first];
                found.push(Dependence::Line { first, second, ratio, offset });
                dependent.push(second);
            }
        }
    }
    found
}

fn line(
    x: ColRef<'_, f64>,
    y: ColRef<'_, f64>,
    one: Option<ColRef<'_, f64>>,
) -> Option<(f64, f64)> {
    let about_mean = |v: ColRef<'_, f64>| -> (Col<f64>, f64) {
        let Some(one) = one else { return (v.to_owned(), 0.0) };
        let mean = (one.transpose() * v) / one.squared_norm_l2();
        (v - one * Scale(mean), mean)
    };
    let ((x, x_mean), (y, y_mean)) = (about_mean(x), about_mean(y));
    let slope = (x.transpose() * &y) / x.squared_norm_l2();
    let distance = (&y - &x * Scale(slope)).norm_l2();
    (distance <= SAME_LINE * y.norm_l2()).then_some((slope, y_mean - slope * x_mean))
}

/// Computes a basis of the same space in which each direction has a feature that the others lack, by Gauss–Jordan
/// elimination on columns, with the largest remaining element as the pivot.
fn echelon(mut v: Mat<f64>) -> Mat<f64> {
    for k in 0..v.ncols() {
        let pivots = (k..v.ncols()).flat_map(|j| (0..v.nrows()).map(move |i| (i, j)));
        let Some((row, column)) = pivots.max_by(|&a, &b| v[a].abs().total_cmp(&v[b].abs())) else {
            break;
        };
        swap_cols_idx(v.as_mut(), k, column);
        let pivot = v[(row, k)];
        v.col_mut(k).iter_mut().for_each(|x| *x /= pivot);
        for j in (0..v.ncols()).filter(|&j| j != k) {
            let share = v[(row, j)];
            for i in 0..v.nrows() {
                v[(i, j)] -= share * v[(i, k)];
            }
        }
    }
    v
}

fn shares(terms: &[Term], direction: ColRef<'_, f64>) -> Vec<(Term, f64)> {
    let largest = direction.norm_max();
    let mut shares: Vec<(Term, f64)> = terms
        .iter()
        .zip(direction.iter())
        .map(|(&term, &share)| (term, share / largest))
        .filter(|(_, share)| share.abs() > NEGLIGIBLE_SHARE)
        .collect();
    shares.sort_by(|(_, a), (_, b)| b.abs().total_cmp(&a.abs()));
    shares
}

impl Dependence {
    fn constants(ranges: &ReadingRanges) -> (Vec<usize>, Vec<Self>) {
        let constant = ranges.constant_channels();
        let of = |&channel: &usize| Dependence::Constant {
            channel,
            value: ranges.channels[channel].min,
        };
        let dependences = constant.iter().map(of).collect();
        (constant, dependences)
    }
}

impl Relation {
    /// The coefficient of `term`; zero if it is not in the relation.
    pub fn share(&self, term: Term) -> f64 {
        self.shares.iter().find(|(t, _)| *t == term).map_or(0.0, |&(_, share)| share)
    }

    /// Channels and values of `s_j − s_i`, or of `s_j` itself, if the relation means that it has only two values.
    fn two_values(&self) -> Option<(Vec<u8>, f64, f64)> {
        let j = *self.feature.factors().first().filter(|j| self.feature.factors() == [**j; 2])?;
        // d² = (a + b)·d − a·b for d = s_j or d = s_j − s_i.
        let sum = self.share(Term::product(&[j]));
        let product = -self.share(Term::INTERCEPT);
        let root = (sum * sum / 4.0 - product).sqrt();
        let (low, high) = (sum / 2.0 - root, sum / 2.0 + root);
        let other = self.shares.iter().find_map(|(term, _)| match *term.factors() {
            [i, again] if i == again => Some(i),
            _ => None,
        });
        let mut expected = vec![(Term::INTERCEPT, -product), (Term::product(&[j]), sum)];
        expected.extend(other.into_iter().flat_map(|i| {
            let factors: [(&[u8], f64); 3] = [(&[i], -sum), (&[i, i], -1.0), (&[i, j], 2.0)];
            factors.map(|(factors, share)| (Term::product(factors), share))
        }));
        let count = expected.iter().filter(|(_, share)| *share != 0.0).count();
        let matches = expected.iter().all(|&(term, share)| self.share(term) == share);
        let is_exact = low + high == sum && low * high == product;
        (is_exact && matches && self.shares.len() == count)
            .then(|| (std::iter::once(j).chain(other).collect(), low, high))
    }
}

impl fmt::Display for Relation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        /// Number of terms to show.
        const SHOWN: usize = 8;
        let name = self.feature.name();
        if !self.exact {
            return write!(f, "`{name}` is a combination of simpler features");
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

impl From<Relation> for Dependence {
    fn from(relation: Relation) -> Self {
        let one = relation.feature.factors();
        let &[second] = one else { return Dependence::Relation(relation) };
        let (second, offset) = (usize::from(second), relation.share(Term::INTERCEPT));
        let others: Vec<_> =
            relation.shares.iter().filter(|(term, _)| *term != Term::INTERCEPT).collect();
        match others[..] {
            [] if relation.exact => Dependence::Constant { channel: second, value: offset },
            [&(term, ratio)] if term.factors().len() == 1 => {
                let first = usize::from(term.factors()[0]);
                Dependence::Line { first, second, ratio, offset }
            }
            _ => Dependence::Relation(relation),
        }
    }
}

impl fmt::Display for RankLoss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "only `{}` of `{}` features are independent: ", self.rank, self.features)?;
        for (i, dependence) in self.dependences.iter().enumerate() {
            write!(f, "{}{dependence}", if i == 0 { "" } else { "; " })?;
        }
        Ok(())
    }
}

impl fmt::Display for Dependence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        /// Number of names to show; more do not help to find the cause.
        const NAMES: usize = 6;
        match self {
            Dependence::Constant { channel, value } => {
                write!(f, "channel `s{}` is constant (always `{value}`)", channel + 1)
            }
            Dependence::Line { first, second, ratio, offset } => {
                let (first, second) = (first + 1, second + 1);
                let readings = (offset.abs() / ratio.abs().max(1.0)).max(f64::MIN_POSITIVE);
                if readings < 1e-6 {
                    write!(f, "channels `s{first}` and `s{second}` are proportional ")?;
                    write!(f, "(s{second} = {}·s{first})", rounded(*ratio))
                } else {
                    write!(f, "channels `s{first}` and `s{second}` move as one ")?;
                    let sign = if *offset < 0.0 { '-' } else { '+' };
                    let (ratio, offset) = (rounded(*ratio), rounded(offset.abs()));
                    write!(f, "(s{second} = {ratio}·s{first} {sign} {offset})")
                }
            }
            Dependence::Relation(relation) => relation.fmt(f),
            Dependence::Combination(shares) => {
                let names: Vec<String> = shares.iter().map(|(term, _)| term.name()).collect();
                let more = if names.len() > NAMES { ", …" } else { "" };
                let shown = names[..names.len().min(NAMES)].join("`, `");
                write!(f, "a combination of `{shown}`{more} never changes")
            }
        }
    }
}

/// Rounds to nine digits, so that an exact ratio looks exact despite rounding in the factorisation.
fn rounded(value: f64) -> f64 {
    format!("{value:.9e}").parse().unwrap_or(value)
}
