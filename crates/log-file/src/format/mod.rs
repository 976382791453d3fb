//! Recognising a log: its format, its header, and the meaning of its columns.

pub(crate) mod choice;
pub(crate) mod clock;
pub(crate) mod clock_parts;
mod column_name;
pub(crate) mod columns;
pub(crate) mod head;
mod keys;
pub(crate) mod layout;
mod lines;
pub(crate) mod mapping;
pub(crate) mod meaning;
mod stated_units;
