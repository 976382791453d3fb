#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReaderSummary {
    pub name: String,
    /// Rows received; for UDP, rows sent.
    pub rows: u64,
    /// Rows lost because the reader was too slow.
    pub lost: u64,
    pub problem: Option<String>,
    pub is_broken: bool,
}
