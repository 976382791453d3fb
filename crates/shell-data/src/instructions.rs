//! Vector instructions: by default, the widest that the processor has. The environment variable [`VARIABLE`] names a
//! narrower set for a test or benchmark; results are equal bit for bit.

use std::sync::LazyLock;

use pulp::Arch;
#[doc(hidden)]
pub use pulp::{Simd, WithSimd};

/// Variable that names an instruction set: `avx512`, `avx2`, `neon`, or `none` for the common set.
pub const VARIABLE: &str = "SHELLCAL_INSTRUCTIONS";

/// Returns the processor's sets, widest first.
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

/// Returns the set that the environment names, or the widest if it names none.
///
/// # Errors
/// A message if the name is unknown or this processor lacks the set.
pub fn chosen() -> Result<Arch, String> {
    let Some(name) = std::env::var_os(VARIABLE) else { return Ok(Arch::new()) };
    let sets = available();
    match sets.iter().find(|(known, _)| name == *known) {
        Some((_, set)) => Ok(*set),
        None => {
            let known: Vec<&str> = sets.into_iter().map(|(known, _)| known).collect();
            let (name, known) = (name.to_string_lossy(), known.join("`, `"));
            Err(format!("`{VARIABLE}` is `{name}`, but this processor has `{known}`"))
        }
    }
}

/// Returns the set in use: [`chosen`], or the widest if that fails.
#[inline]
pub fn arch() -> Arch {
    static CHOSEN: LazyLock<Arch> = LazyLock::new(|| chosen().unwrap_or_default());
    *CHOSEN
}

/// Defines functions that are compiled for every instruction set, and run with that of [`arch`].
///
/// The body and the `#[inline(always)]` functions that it calls are inlined into the code for each set. A closure may
/// remain a separate function without wide vectors.
///
/// ```
/// shell_data::vectorised! {
///     /// `y += c·x`.
///     pub fn add_multiple(y: &mut [f64], c: f64, x: &[f64]) {
///         for (y, &x) in y.iter_mut().zip(x) {
///             *y = c.mul_add(x, *y);
///         }
///     }
/// }
/// let mut y = [1.0, 2.0];
/// add_multiple(&mut y, 2.0, &[3.0, 4.0]);
/// assert_eq!(y, [7.0, 10.0]);
/// ```
///
/// A function with explicit vectors begins with a parameter for them, which callers omit:
/// `fn add<S: Simd>(simd: S, …)`. The macro can define only one such function at a time.
#[macro_export]
macro_rules! vectorised {
    (@output) => { () };
    (@output $output:ty) => { $output };
    ($(
        $(#[$attribute:meta])*
        $visibility:vis fn $name:ident($($argument:ident: $type:ty),+ $(,)?) $(-> $output:ty)?
        $body:block
    )+) => {$(
        $crate::vectorised! {
            $(#[$attribute])*
            $visibility fn $name<S: Simd>(_simd: S, $($argument: $type),+) $(-> $output)?
            $body
        }
    )+};
    (
        $(#[$attribute:meta])*
        $visibility:vis fn $name:ident<$vectors:ident: Simd>(
            $simd:ident: $_:ident, $($argument:ident: $type:ty),+ $(,)?
        ) $(-> $output:ty)?
        $body:block
    ) => {
        $(#[$attribute])*
        $visibility fn $name($($argument: $type),+) $(-> $output)? {
            struct Call<A>(A);

            impl $crate::instructions::WithSimd for Call<($($type,)+)> {
                type Output = $crate::vectorised!(@output $($output)?);

                #[inline(always)]
                fn with_simd<$vectors: $crate::instructions::Simd>(self, $simd: $vectors) -> Self::Output {
                    let Self(($($argument,)+)) = self;
                    $body
                }
            }

            $crate::instructions::arch().dispatch(Call(($($argument,)+)))
        }
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_widest_instructions_come_first_and_the_baseline_is_always_available() {
        let sets = available();
        assert_eq!(format!("{:?}", sets[0].1), format!("{:?}", Arch::new()));
        assert!(matches!(sets.last(), Some(("none", Arch::Scalar))));
    }
}
