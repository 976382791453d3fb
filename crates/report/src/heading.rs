//! What stands at the head of every report.

/// What a report is about, and where it comes from.
#[derive(Clone, Copy, Debug)]
pub struct Heading<'a> {
    /// What it is about.
    pub title: &'a str,
    /// Program and version.
    pub made_by: &'a str,
    /// When, in UTC, RFC 3339.
    pub date: &'a str,
    /// The command line that makes it again.
    pub command: &'a str,
}
