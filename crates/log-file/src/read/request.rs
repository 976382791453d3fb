//! What is asked of a log, and what reading it reports.

/// Which columns are wanted. The others are not parsed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Wanted {
    /// Time.
    pub time: bool,
    /// The readings of all channels.
    pub readings: bool,
    /// The wrench, as far as there are columns of it.
    pub wrench: bool,
    /// Group labels.
    pub groups: bool,
    /// Further columns by position in the row, from 0; they are given as they stand in the log.
    pub others: Vec<usize>,
    /// Columns of text by position in the row, from 0, each once.
    pub texts: Vec<usize>,
}

/// How a log is read.
#[derive(Clone, Copy, Default)]
pub struct ReadOptions<'a> {
    /// How many threads parse; 0 for one per core.
    pub threads: usize,
    /// Count rows that are wrong, and go on.
    pub skip_bad_rows: bool,
    /// Compute the checksum of the file.
    pub checksum: bool,
    /// Called on the caller's thread with the number of bytes read of the file on disk.
    pub progress: Option<&'a (dyn Fn(u64) + Sync)>,
}

impl ReadOptions<'_> {
    /// The number of threads that parse.
    pub fn thread_count(&self) -> usize {
        match self.threads {
            0 => std::thread::available_parallelism().map_or(1, usize::from),
            threads => threads,
        }
    }
}
