//! Logs: recordings of readings, wrenches and robot telemetry as files, read as a stream.
//!
//! [`Log::open`] looks at the first lines, recognises the [`Format`] and what the columns are;
//! [`Mapping`] says what cannot be recognised. [`Log::read`] then streams the rows as [`Block`]s in
//! SI units, parsing only the columns that are [`Wanted`], on as many threads as there are; memory
//! does not grow with the length of the file. A file that is compressed with gzip is unpacked on
//! the way.
//!
//! ```text
//! Source ── bytes ──▶ Chunker ── whole lines ──▶ RowPlan ── columns ──▶ Block ──▶ map ──▶ fold
//! plain or gzip       one at a time              └─────── any thread ──────────────┘    in order
//! ```
//!
//! Where blocks begin depends on the file alone, and `fold` sees them in order, so results are the
//! same for any number of threads.
//!
//! Left out: files whose quoted fields span lines, and text that is not UTF-8 or ASCII.

pub mod checksum;
mod chunk;
mod columns;
mod console;
mod cores;
mod error;
mod head;
mod lanes;
#[cfg(target_arch = "x86_64")]
mod lanes_avx512;
#[cfg(target_arch = "x86_64")]
mod lanes_x86;
mod many;
mod mapping;
mod number;
pub mod pipeline;
mod places;
mod plan;
mod rows;
mod source;

use std::io::Read;
use std::path::Path;
use std::sync::atomic::Ordering;
use std::sync::{Arc, LazyLock};

pub use columns::{Column, Meaning};
pub use error::{Field, LogError, RowProblem};
pub use many::read_all;
pub use mapping::{ColumnRef, Format, Mapping, MomentUnit, TimeUnit};

use chunk::{CHUNK_BYTES, ChunkError, Chunker, LINE_LIMIT, Room};
use head::{HEAD_BYTES, Layout};
use plan::Plan;
use rows::RowError;
use shell_data::block::Block;
use shell_data::telemetry::Telemetry;
use shell_data::wrench::Axis;
use source::Source;

/// A log whose layout is known.
#[derive(Debug)]
pub struct Log {
    source: Source,
    layout: Layout,
    chunk_bytes: usize,
}

/// Which columns are wanted. The others are not parsed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Wanted {
    /// Time.
    pub time: bool,
    /// The readings of all channels.
    pub readings: bool,
    /// The wrench.
    pub wrench: bool,
    /// Group labels.
    pub groups: bool,
    /// Further columns by place in the row, from 0; they are given as they stand in the log.
    pub others: Vec<usize>,
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
    /// Told on the caller's thread how many bytes of the file on disk have been read.
    pub progress: Option<&'a (dyn Fn(u64) + Sync)>,
}

/// What chooses the rows that are read, see [`Log::read_where`].
pub trait Selection {
    /// Why reading may end early.
    type Error: From<LogError>;

    /// Whether the next rows, at these times in s, are of interest; there is one row or more.
    ///
    /// # Errors
    /// Whatever is to end the reading.
    fn is_of_interest(&mut self, times_s: &[f64]) -> Result<bool, Self::Error>;

    /// Takes those rows.
    ///
    /// # Errors
    /// Whatever is to end the reading.
    fn take(&mut self, block: &mut Block) -> Result<(), Self::Error>;
}

/// What a whole log was.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ReadSummary {
    /// Rows that were read.
    pub rows: u64,
    /// Those among them whose readings equal those of the row before; 0 if readings were not
    /// wanted.
    pub repeated_rows: u64,
    /// Rows that were wrong and left out, and a last one that is cut off.
    pub skipped_rows: u64,
    /// The [checksum](crate::checksum) of the file on disk, if asked for.
    pub checksum: Option<String>,
}

/// One per core. Asked for once: finding out reads several files.
static AVAILABLE_THREADS: LazyLock<usize> =
    LazyLock::new(|| std::thread::available_parallelism().map_or(1, usize::from));

impl ReadOptions<'_> {
    /// The number of threads that parse.
    pub fn thread_count(&self) -> usize {
        match self.threads {
            0 => *AVAILABLE_THREADS,
            threads => threads,
        }
    }
}

impl Log {
    /// Recognises the log at `path` from its first lines.
    ///
    /// # Errors
    /// [`LogError`] if the file cannot be read, is empty, binary or of no known layout, has two
    /// columns for one thing, or lacks a column that `mapping` names.
    pub fn open(path: &Path, mapping: &Mapping) -> Result<Self, LogError> {
        let source = Source::new(path)?;
        let mut head = Vec::with_capacity(HEAD_BYTES as usize);
        let mut stream = source.open()?.take(HEAD_BYTES);
        stream.read_to_end(&mut head).map_err(|error| source.error(error))?;
        let whole = (head.len() as u64) < HEAD_BYTES;
        let layout = head::recognise_layout(&source, &head, whole, mapping)?;
        Ok(Self { source, layout, chunk_bytes: CHUNK_BYTES })
    }

    /// Cuts the file into blocks of about this many bytes rather than the usual number, for tests
    /// that results do not depend on it.
    #[doc(hidden)]
    pub fn with_chunk_bytes(self, chunk_bytes: usize) -> Self {
        Self { chunk_bytes: chunk_bytes.max(1), ..self }
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.source.path
    }

    /// What kind of file it is.
    pub fn format(&self) -> Format {
        self.layout.format
    }

    /// Its columns and what they are taken for.
    pub fn columns(&self) -> &[Column] {
        &self.layout.columns
    }

    /// The number of sensor channels, 0 if there are none.
    pub fn channels(&self) -> usize {
        self.layout.roles.sensors.len()
    }

    /// Whether it has all six columns of a wrench.
    pub fn has_wrench(&self) -> bool {
        self.layout.roles.wrench.iter().all(Option::is_some)
    }

    /// Whether it has a time column.
    pub fn has_time(&self) -> bool {
        self.layout.roles.time.is_some()
    }

    /// Whether it has a column of group labels.
    pub fn has_groups(&self) -> bool {
        self.layout.roles.group.is_some()
    }

    /// Where a column of telemetry is in a row, from 0, to be asked for as one of
    /// [`Wanted::others`]; `None` if there is none.
    ///
    /// # Errors
    /// [`LogError::DuplicateColumn`] if there are several.
    pub fn telemetry(&self, telemetry: Telemetry) -> Result<Option<usize>, LogError> {
        let columns = self.layout.columns.iter().enumerate();
        let mut places = columns
            .filter(|(_, column)| column.meaning == Meaning::Telemetry(telemetry))
            .map(|(place, _)| place);
        match (places.next(), places.next()) {
            (Some(first), Some(second)) => Err(LogError::DuplicateColumn {
                path: self.source.path.clone(),
                line: self.layout.names_line,
                meaning: telemetry.name().to_owned(),
                columns: [first, second],
                names: [first, second].map(|at| self.layout.columns[at].name.clone()),
            }),
            (place, _) => Ok(place),
        }
    }

    /// Whether equal readings in a row are one frame logged repeatedly: the robot's telemetry runs
    /// faster than the sensor. Elsewhere they can be honest samples.
    pub fn repeats_are_stale(&self) -> bool {
        self.layout.format == Format::Telemetry
    }

    /// Whether the file is compressed.
    pub fn is_compressed(&self) -> bool {
        self.source.compressed
    }

    /// The size of the file on disk.
    pub fn bytes(&self) -> u64 {
        self.source.bytes
    }

    /// Checks that all wanted columns are there.
    ///
    /// # Errors
    /// [`LogError::MissingColumns`] with all that are not, and what there is instead.
    pub fn require(&self, wanted: &Wanted) -> Result<(), LogError> {
        let roles = &self.layout.roles;
        let mut missing = Vec::new();
        if wanted.time && roles.time.is_none() {
            missing.push("time".to_owned());
        }
        if wanted.readings && roles.sensors.is_empty() {
            missing.push("s1 … (sensors)".to_owned());
        }
        if wanted.wrench {
            let absent = Axis::ALL.into_iter().filter(|axis| roles.wrench[axis.index()].is_none());
            missing.extend(absent.map(|axis| axis.name().to_owned()));
        }
        if wanted.groups && roles.group.is_none() {
            missing.push("group".to_owned());
        }
        let columns = &self.layout.columns;
        let beyond = wanted.others.iter().filter(|&&at| at >= columns.len());
        missing.extend(beyond.map(|at| format!("column {}", at + 1)));
        if missing.is_empty() {
            return Ok(());
        }
        Err(LogError::MissingColumns {
            path: self.source.path.clone(),
            line: self.layout.names_line,
            missing,
            found: columns.iter().map(|column| column.name.clone()).collect(),
        })
    }

    /// Streams the whole log once: `map` gets its blocks on worker threads, `fold` gets what `map`
    /// makes of them on the caller's thread, in file order. `map` may take from a block what it
    /// needs; what it leaves is working memory for the next.
    ///
    /// # Errors
    /// [`LogError`] if wanted columns are missing, the file cannot be read, has no rows, or has a
    /// row that is wrong (unless those are skipped); and whatever `fold` returns, which ends the
    /// reading. The first error in file order is returned, for any number of threads.
    pub fn read<T: Send, E: From<LogError>>(
        &self,
        wanted: &Wanted,
        options: &ReadOptions<'_>,
        map: impl Fn(&mut Block) -> T + Sync,
        mut fold: impl FnMut(T) -> Result<(), E>,
    ) -> Result<ReadSummary, E> {
        let fold = |_, value| fold(value);
        let mut summaries = read_all(&[self], wanted, options, |_, block| map(block), fold)?;
        Ok(summaries.pop().expect("one of each log"))
    }

    /// Streams the log once on this thread, and parses all that is `wanted` only of pieces whose
    /// times are of interest. What is not parsed is not checked either.
    ///
    /// # Errors
    /// As [`Log::read`]; and what `selection` returns, which ends the reading.
    pub fn read_where<S: Selection>(
        &self,
        wanted: &Wanted,
        options: &ReadOptions<'_>,
        selection: &mut S,
    ) -> Result<ReadSummary, S::Error> {
        self.require(&Wanted { time: true, ..wanted.clone() })?;
        let time_only = Plan::new(&self.layout, &Wanted { time: true, ..Wanted::default() });
        let plan = Plan::new(&self.layout, wanted);
        let bytes_done = Arc::default();
        let stream = self.source.open_counting(options.checksum, &bytes_done)?;
        let chunk_bytes = self.chunk_bytes.min(SELECTED_BYTES);
        let mut chunker = Chunker::new(stream, self.layout.rows_start, chunk_bytes);
        let mut chunk = chunk::Chunk::default();
        let (mut clock, mut room) = (Room::default(), Room::default());
        let mut summary = ReadSummary::default();
        while chunker.next(&mut chunk).map_err(|error| self.chunk_error(error))? {
            let fill = |plan: &Plan, Room { parsed, block }: &mut Room| {
                plan.parse(chunk.lines(), options.skip_bad_rows, parsed)
                    .map_err(|error| self.row_error(chunk.offset, error))?;
                plan.fill(block, parsed, &chunk.context);
                Ok::<_, LogError>(parsed.skipped)
            };
            let mut skipped = fill(&time_only, &mut clock)?;
            summary.rows += clock.block.rows as u64;
            if clock.block.rows > 0 && selection.is_of_interest(&clock.block.time_s)? {
                skipped = fill(&plan, &mut room)?;
                if room.block.rows > 0 {
                    summary.repeated_rows += room.block.repeated_rows() as u64;
                    selection.take(&mut room.block)?;
                }
            }
            summary.skipped_rows += skipped;
            if let Some(progress) = options.progress {
                progress(bytes_done.load(Ordering::Relaxed));
            }
        }
        if summary.rows == 0 && summary.skipped_rows == 0 {
            return Err(LogError::NoRows { path: self.source.path.clone() }.into());
        }
        summary.checksum = chunker.stream().checksum();
        Ok(summary)
    }

    /// Some rows from all over the file, or from its start when it is compressed: enough to choose
    /// centres and scales from. Rows that are wrong are left out.
    ///
    /// # Errors
    /// [`LogError`] if wanted columns are missing or the file cannot be read.
    pub fn sample(&self, wanted: &Wanted) -> Result<Block, LogError> {
        self.require(wanted)?;
        let plan = Plan::new(&self.layout, wanted);
        let mut lines = Vec::with_capacity((SAMPLES * SAMPLE_BYTES) as usize);
        let rows_end = self.source.bytes;
        let span = rows_end.saturating_sub(self.layout.rows_start);
        let io = |error| self.source.error(error);
        if self.source.compressed || span <= SAMPLES * SAMPLE_BYTES {
            let stream = self.source.open()?;
            let mut chunk = chunk::Chunk::default();
            let bytes = (SAMPLES * SAMPLE_BYTES) as usize;
            let mut chunker = Chunker::new(stream, self.layout.rows_start, bytes);
            if chunker.next(&mut chunk).map_err(|error| self.chunk_error(error))? {
                lines.extend_from_slice(chunk.lines());
            }
        } else {
            use std::io::{Seek, SeekFrom};
            let mut file = self.source.file()?;
            for sample in 0..SAMPLES {
                let offset =
                    self.layout.rows_start + (span - SAMPLE_BYTES) / (SAMPLES - 1) * sample;
                file.seek(SeekFrom::Start(offset)).map_err(io)?;
                let start = lines.len();
                Read::take(&mut file, SAMPLE_BYTES).read_to_end(&mut lines).map_err(io)?;
                // The first sample starts with a row; the others start somewhere within one.
                let whole = whole_lines(&lines[start..], sample > 0);
                let (from, to) = (start + whole.start, start + whole.end);
                lines.copy_within(from..to, start);
                lines.truncate(start + to - from);
            }
        }
        let Room { mut parsed, mut block } = Room::default();
        plan.parse(&lines, true, &mut parsed).map_err(|error| self.row_error(0, error))?;
        plan.fill(&mut block, &mut parsed, &[]);
        Ok(block)
    }

    fn chunk_error(&self, error: ChunkError) -> LogError {
        match error {
            ChunkError::Io(error) => self.source.error(error),
            ChunkError::LineTooLong(offset) => match self.line_number(offset) {
                Ok(line) => LogError::LineTooLong {
                    path: self.source.path.clone(),
                    line,
                    limit: LINE_LIMIT,
                },
                Err(error) => error,
            },
        }
    }

    fn row_error(&self, chunk_offset: u64, error: RowError) -> LogError {
        match self.line_number(chunk_offset + error.offset as u64) {
            Ok(line) => {
                LogError::Row { path: self.source.path.clone(), line, problem: error.problem }
            }
            Err(error) => error,
        }
    }

    /// The number of the line at `offset`, counted by reading up to there again: lines are not
    /// counted while all is well.
    fn line_number(&self, offset: u64) -> Result<u64, LogError> {
        let mut before = self.source.open()?.take(offset);
        let mut buffer = vec![0; 1 << 16];
        let mut line = 1;
        loop {
            match before.read(&mut buffer) {
                Ok(0) => return Ok(line),
                Ok(read) => line += memchr::memchr_iter(b'\n', &buffer[..read]).count() as u64,
                Err(error) => return Err(self.source.error(error)),
            }
        }
    }
}

/// How finely [`Log::read_where`] tells what is of interest: some 300 rows of telemetry.
const SELECTED_BYTES: usize = 1 << 15;

/// How many pieces of a file [`Log::sample`] reads, and how long they are.
const SAMPLES: u64 = 16;
const SAMPLE_BYTES: u64 = 1 << 12;

/// The part of `bytes` that is whole lines, without the first when that may be the end of one.
fn whole_lines(bytes: &[u8], drop_first: bool) -> std::ops::Range<usize> {
    let end = memchr::memrchr(b'\n', bytes).map_or(0, |at| at + 1);
    let start = match drop_first {
        true => memchr::memchr(b'\n', bytes).map_or(end, |at| at + 1),
        false => 0,
    };
    start..end
}
