//! The features of a calibration and their order.
//!
//! A feature is a product of up to three readings, in the order of the lab's own tools: `cubic` goes channel by
//! channel (s1, s1², s1³, s2, …); models with cross terms go degree by degree, each lexicographic (s1, …, s8, s1²,
//! s1·s2, …); `cubic+products` has the terms of `cubic`, then the products of two channels. Linear memory terms
//! follow, for each time constant one per channel. The intercept, the empty product, comes last.

/// A family of features.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Basis {
    /// Each reading: 8 features for 8 channels.
    Linear,
    /// Each reading, its square and its cube: 24 features for 8 channels, the model of the paper.
    #[default]
    Cubic,
    /// All products of up to two readings: 44 features for 8 channels.
    Quadratic,
    /// The features of `Cubic`, and the products of two different readings: 52 features for 8 channels.
    #[serde(rename = "cubic+products")]
    CubicProducts,
    /// All products of up to three readings: 164 features for 8 channels.
    Poly3,
}

impl Basis {
    /// All families, from the smallest to the largest.
    pub const ALL: [Basis; 5] =
        [Basis::Linear, Basis::Cubic, Basis::Quadratic, Basis::CubicProducts, Basis::Poly3];

    /// Name in files and on the command line.
    pub const fn name(self) -> &'static str {
        self.facts().0
    }

    pub const fn description(self) -> &'static str {
        self.facts().1
    }

    pub const fn degree(self) -> usize {
        self.facts().2
    }

    const fn facts(self) -> (&'static str, &'static str, usize) {
        match self {
            Basis::Linear => ("linear", "Each reading", 1),
            Basis::Cubic => ("cubic", "Each reading, its square and its cube", 3),
            Basis::Quadratic => ("quadratic", "Products of up to two readings", 2),
            Basis::CubicProducts => {
                ("cubic+products", "As `cubic`, and products of two readings", 3)
            }
            Basis::Poly3 => ("poly3", "Products of up to three readings", 3),
        }
    }
}

/// The largest number in a document: squares and products of such numbers do not overflow.
pub const LARGEST: f64 = 1e100;

/// The largest number of channels; their indices are bytes.
pub const MAX_CHANNELS: usize = 255;

/// Maximum number of coefficients per axis. The equations take some 40 MB, and a time that grows with its cube.
pub const MAX_TERMS: usize = 2200;

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{}` with `{}` channels has `{}` coefficients, at most `{MAX_TERMS}` can be fitted: {}",
    model.name(), model.channels, model.term_count(), fitting(model)
)]
pub struct TooLarge {
    model: Model,
}

fn fitting(model: &Model) -> String {
    let fits = |&basis: &Basis| Model { basis, ..*model }.check_size().is_ok();
    let names: Vec<_> = Basis::ALL.iter().copied().filter(fits).map(Basis::name).collect();
    let channels = (1..=model.channels).rev();
    let most =
        channels.map(|channels| Model { channels, ..*model }).find(|m| m.check_size().is_ok());
    let most = most.map_or(0, |model| model.channels);
    format!("use `{}`, or at most `{most}` channels", names.join("`, `"))
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Model {
    pub basis: Basis,
    pub intercept: bool,
    /// Number of channels. Channels and memory terms together are at most 255.
    pub channels: usize,
    /// Number of time constants. Each adds a memory term for every channel.
    #[serde(default, skip_serializing_if = "is_none")]
    pub memory: usize,
}

fn is_none(memory_terms: &usize) -> bool {
    *memory_terms == 0
}

/// A product of up to three channels, given by their indices from 0 in ascending order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Term {
    factors: [u8; 3],
    degree: u8,
}

impl Term {
    /// The constant: the empty product.
    pub const INTERCEPT: Term = Term { factors: [0; 3], degree: 0 };

    /// The product of the channels in `factors`, at most three.
    pub fn product(factors: &[u8]) -> Self {
        let mut term = Self { factors: [0; 3], degree: factors.len() as u8 };
        term.factors[..factors.len()].copy_from_slice(factors);
        term.factors[..factors.len()].sort_unstable();
        term
    }

    /// The factors in ascending order, repeated for squares and cubes.
    pub fn factors(&self) -> &[u8] {
        &self.factors[..usize::from(self.degree)]
    }

    /// The displayed name, with channels counted from 1: `s1`, `s1^2`, `s1*s3`, `1`.
    pub fn name(&self) -> String {
        if self.degree == 0 {
            return "1".to_owned();
        }
        self.factors()
            .chunk_by(|a, b| a == b)
            .map(|run| match run.len() {
                1 => format!("s{}", run[0] + 1),
                power => format!("s{}^{power}", run[0] + 1),
            })
            .collect::<Vec<_>>()
            .join("*")
    }
}

impl Model {
    /// Number of input columns of the features: the channels, then their memory terms.
    pub fn columns(&self) -> usize {
        self.channels * (1 + self.memory)
    }

    /// Terms in the order of the coefficients.
    pub fn terms(&self) -> Vec<Term> {
        let index = |column: usize| u8::try_from(column).expect("at most 255 columns");
        let channels = index(self.channels);
        let mut terms = Vec::new();
        if matches!(self.basis, Basis::Cubic | Basis::CubicProducts) {
            for i in 0..channels {
                terms.extend((1..=3).map(|power| Term::product(&[i; 3][..power])));
            }
            if self.basis == Basis::CubicProducts {
                let different = pairs(channels).filter(|(i, j)| i != j);
                terms.extend(different.map(|(i, j)| Term::product(&[i, j])));
            }
        } else {
            terms.extend((0..channels).map(|i| Term::product(&[i])));
            if self.basis.degree() >= 2 {
                terms.extend(pairs(channels).map(|(i, j)| Term::product(&[i, j])));
            }
            if self.basis.degree() >= 3 {
                terms.extend(
                    pairs(channels)
                        .flat_map(|(i, j)| (j..channels).map(move |k| Term::product(&[i, j, k]))),
                );
            }
        }
        terms.extend((channels..index(self.columns())).map(|i| Term::product(&[i])));
        if self.intercept {
            terms.push(Term::INTERCEPT);
        }
        terms
    }

    pub fn term_count(&self) -> usize {
        let n = self.channels;
        let pairs = n * (n + 1) / 2;
        let features = match self.basis {
            Basis::Linear => n,
            Basis::Cubic => 3 * n,
            Basis::Quadratic => n + pairs,
            Basis::CubicProducts => 2 * n + pairs,
            Basis::Poly3 => n + pairs + n * (n + 1) * (n + 2) / 6,
        };
        features + self.memory * n + usize::from(self.intercept)
    }

    /// Displayed name: [`Term::name`], or for a memory term `s2-EMA3(s2)`, where 3 is the number of the time constant.
    pub fn term_name(&self, term: &Term) -> String {
        match term.factors() {
            &[column] if usize::from(column) >= self.channels => {
                let (time, channel) =
                    (usize::from(column) / self.channels, usize::from(column) % self.channels + 1);
                format!("s{channel}-EMA{time}(s{channel})")
            }
            _ => term.name(),
        }
    }

    /// Checks that the model has few enough coefficients to fit, without listing them.
    ///
    /// # Errors
    /// [`TooLarge`].
    pub fn check_size(&self) -> Result<(), TooLarge> {
        if self.term_count() > MAX_TERMS { Err(TooLarge { model: *self }) } else { Ok(()) }
    }

    /// The displayed name, such as `cubic + memory + offset` with memory terms and intercept.
    pub fn name(&self) -> String {
        let memory = if self.memory > 0 { " + memory" } else { "" };
        format!("{}{memory}{}", self.basis.name(), if self.intercept { " + offset" } else { "" })
    }
}

fn pairs(channels: u8) -> impl Iterator<Item = (u8, u8)> {
    (0..channels).flat_map(move |i| (i..channels).map(move |j| (i, j)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(basis: Basis, channels: usize, intercept: bool) -> Vec<String> {
        Model { basis, intercept, channels, memory: 0 }.terms().iter().map(Term::name).collect()
    }

    #[test]
    fn eight_channels_give_the_published_numbers_of_features() {
        let counts = Basis::ALL.map(|basis| names(basis, 8, false).len());
        assert_eq!(counts, [8, 24, 44, 52, 164]);
        let counted = Basis::ALL
            .map(|basis| Model { basis, intercept: true, channels: 8, memory: 0 }.term_count());
        assert_eq!(counted, [9, 25, 45, 53, 165]);
    }

    #[test]
    fn a_model_that_is_too_large_is_refused_with_alternatives() {
        let model = Model { basis: Basis::Poly3, intercept: true, channels: 64, memory: 0 };
        let error = model.check_size().unwrap_err().to_string();
        assert!(error.contains("`47905` coefficients"), "{error}");
        // `quadratic` has 2145 coefficients and `cubic+products` 2209.
        assert!(
            error.ends_with("use `linear`, `cubic`, `quadratic`, or at most `21` channels"),
            "{error}"
        );
        assert!(Model { channels: 21, ..model }.check_size().is_ok());
        assert!(Model { channels: 22, ..model }.check_size().is_err());
    }

    #[test]
    fn cubic_goes_channel_by_channel_and_the_intercept_comes_last() {
        assert_eq!(names(Basis::Cubic, 2, true), ["s1", "s1^2", "s1^3", "s2", "s2^2", "s2^3", "1"]);
    }

    #[test]
    fn cross_terms_go_degree_by_degree_in_lexicographic_order() {
        assert_eq!(
            names(Basis::Poly3, 2, false),
            ["s1", "s2", "s1^2", "s1*s2", "s2^2", "s1^3", "s1^2*s2", "s1*s2^2", "s2^3"]
        );
    }

    #[test]
    fn products_of_two_channels_follow_the_powers_and_memory_terms_follow_both() {
        let model = Model { basis: Basis::CubicProducts, intercept: true, channels: 2, memory: 2 };
        let names: Vec<_> = model.terms().iter().map(|term| model.term_name(term)).collect();
        let powers = ["s1", "s1^2", "s1^3", "s2", "s2^2", "s2^3", "s1*s2"];
        let memory = ["s1-EMA1(s1)", "s2-EMA1(s2)", "s1-EMA2(s1)", "s2-EMA2(s2)", "1"];
        assert_eq!(names, [&powers[..], &memory].concat());
        assert_eq!((model.term_count(), model.columns()), (12, 6));
    }
}
