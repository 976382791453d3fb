//! Rows that are handed over together.

/// They arrive as a whole, or are lost as a whole.
#[derive(Debug, Default)]
pub(crate) struct FrameBatch {
    pub(crate) bytes: Vec<u8>,
    pub(crate) rows: u64,
}
