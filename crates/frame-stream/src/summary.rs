#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReaderSummary {
    pub name: String,
    /// Rows received; for UDP, rows sent.
    pub rows: u64,
    /// Rows lost because the reader was too slow.
    pub lost: u64,
    pub problem: Option<String>,
    /// True if a file or the standard output ended early.
    pub is_broken: bool,
}
