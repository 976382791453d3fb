//! Answers that may not have been asked for, and may not be possible.

/// The answer to something that a fit may be asked.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Outcome<T, E> {
    /// It was not asked for.
    #[default]
    NotAsked,
    /// It cannot be had of these rows, and why.
    NotPossible(E),
    /// It was found.
    Found(T),
}

impl<T, E> Outcome<T, E> {
    /// The answer, where there is one.
    pub fn found(&self) -> Option<&T> {
        match self {
            Self::Found(found) => Some(found),
            Self::NotAsked | Self::NotPossible(_) => None,
        }
    }

    /// The reason why there is none, where it was asked for.
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
