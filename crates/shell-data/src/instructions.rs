//! Which vectors of the processor are worked with: the widest that it has, or fewer where a test or a
//! benchmark asks for that.
//!
//! [`VARIABLE`] of the environment names a set of instructions. Results are the same bits with each.

use std::sync::LazyLock;

use pulp::Arch;

/// The variable of the environment that names a set: `avx512`, `avx2`, `neon`, or `none` for those that
/// every processor has.
pub const VARIABLE: &str = "SHELLCAL_INSTRUCTIONS";

/// Why a set of instructions cannot be worked with.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownInstructions {
    name: String,
    known: Vec<&'static str>,
}

impl std::fmt::Display for UnknownInstructions {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let known = self.known.join("`, `");
        write!(f, "`{VARIABLE}` is `{}`, but this processor has `{known}`", self.name)
    }
}

impl std::error::Error for UnknownInstructions {}

/// The sets that this processor has, the widest first.
pub fn available() -> Vec<(&'static str, Arch)> {
    let mut sets = Vec::new();
    #[cfg(target_arch = "x86_64")]
    {
        sets.extend(pulp::x86::V4::try_new().map(|set| ("avx512", Arch::V4(set))));
        sets.extend(pulp::x86::V3::try_new().map(|set| ("avx2", Arch::V3(set))));
    }
    #[cfg(target_arch = "aarch64")]
    sets.extend(pulp::aarch64::Neon::try_new().map(|set| ("neon", Arch::Neon(set))));
    sets.push(("none", Arch::Scalar));
    sets
}

/// What the environment names; the widest that there is where it names none.
///
/// # Errors
/// [`UnknownInstructions`] if there is no such set, or this processor has not got it.
pub fn chosen() -> Result<Arch, UnknownInstructions> {
    let Some(name) = std::env::var_os(VARIABLE) else { return Ok(Arch::new()) };
    let sets = available();
    match sets.iter().find(|(known, _)| name == *known) {
        Some((_, set)) => Ok(*set),
        None => Err(UnknownInstructions {
            name: name.to_string_lossy().into_owned(),
            known: sets.into_iter().map(|(known, _)| known).collect(),
        }),
    }
}

/// What is worked with: [`chosen`], and the widest where that cannot be.
#[inline]
pub fn arch() -> Arch {
    static CHOSEN: LazyLock<Arch> = LazyLock::new(|| chosen().unwrap_or_default());
    *CHOSEN
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_widest_comes_first_and_the_plainest_is_always_there() {
        let sets = available();
        assert_eq!(format!("{:?}", sets[0].1), format!("{:?}", Arch::new()));
        assert!(matches!(sets.last(), Some(("none", Arch::Scalar))));
    }
}
