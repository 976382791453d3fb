//! Results that may not be requested, and may not be possible.

/// The outcome of an optional part of a fit.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Outcome<T, E> {
    /// Not requested.
    #[default]
    NotAsked,
    /// Not possible with these rows, for this reason.
    NotPossible(E),
    /// The result.
    Found(T),
}

impl<T, E> Outcome<T, E> {
    /// The result, if there is one.
    pub fn found(&self) -> Option<&T> {
        match self {
            Self::Found(found) => Some(found),
            Self::NotAsked | Self::NotPossible(_) => None,
        }
    }

    /// The reason why a requested result is missing.
    pub fn reason(&self) -> Option<&E> {
        match self {
            Self::NotPossible(reason) => Some(reason),
            Self::NotAsked | Self::Found(_) => None,
        }
    }
}

impl<T, E> From<Result<T, E>> for Outcome<T, E> {
    fn from(asked: Result<T, E>) -> Self {
        asked.map_or_else(Self::NotPossible, Self::Found)
    }
}
