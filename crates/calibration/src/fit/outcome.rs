//! Results that are found, not possible, or not requested.

#[derive(Clone, Debug, Default, PartialEq)]
pub enum Outcome<T, E> {
    #[default]
    NotAsked,
    /// Not possible with these rows, for this reason.
    NotPossible(E),
    Found(T),
}

impl<T, E> Outcome<T, E> {
    pub fn found(&self) -> Option<&T> {
        match self {
            Self::Found(found) => Some(found),
            Self::NotAsked | Self::NotPossible(_) => None,
        }
    }

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
