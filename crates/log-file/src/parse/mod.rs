//! Parsing: from whole lines to fields, from fields to numbers, from numbers to a block in SI units.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod columns;
pub(crate) mod console;
pub(crate) mod date;
mod field_ends;
pub(crate) mod field_problem;
pub(crate) mod form;
mod instruction_set;
pub(crate) mod marks;
mod nearest;
#[cfg(all(target_arch = "aarch64", target_endian = "little"))]
mod neon;
pub(crate) mod number;
pub(crate) mod parsed_rows;
pub(crate) mod plan;
pub(crate) mod rows;
