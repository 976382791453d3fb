//! A log file whose layout has been recognised.

use std::path::Path;
use std::sync::Arc;

use crate::checksum;
use crate::error::{LogError, PlacedProblem};
use crate::format::choice::Interleaving;
use crate::format::columns::{Column, Wanted, duplicate, positions, recognise};
use crate::format::layout::{FileLayout, HEAD_BYTES, recognise_layout};
use crate::format::mapping::{ColumnRef, LogFormat, Mapping};
use crate::format::meaning::{Meaning, StatedUnit};
use crate::stream::chunk::{CHUNK_BYTES, line_ends};
use crate::stream::clock_turns::TURN;
use crate::stream::source::LogSource;
use shell_data::ColumnNames;
use shell_data::telemetry::Telemetry;
use shell_data::wrench::{Axes, Axis, PerAxis};
use table_file::{FileKind, Table};

/// A log whose layout is known.
#[derive(Debug)]
pub struct Log {
    pub(crate) source: LogSource,
    pub(crate) layout: FileLayout,
    pub(crate) chunk_bytes: usize,
}

impl Log {
    /// Recognises the log at `path` from its first lines.
    ///
    /// # Errors
    /// [`LogError`] if the file cannot be read, is empty, of a kind or layout that is not read, has two
    /// columns for one thing, or lacks a column that `mapping` names.
    pub fn open(path: &Path, mapping: &Mapping) -> Result<Self, LogError> {
        Self::new(LogSource::new(path, mapping.table.as_deref())?, mapping)
    }

    /// The same of a file in memory, which is called `name`.
    ///
    /// # Errors
    /// Those of [`Log::open`].
    pub fn in_memory(name: &Path, bytes: Arc<[u8]>, mapping: &Mapping) -> Result<Self, LogError> {
        Self::new(LogSource::in_memory(name, bytes, mapping.table.as_deref())?, mapping)
    }

    /// The same with the columns of the file `companion`, row by row: they follow those of the log. Where
    /// neither has names and nothing is specified, those of the log are readings and the six beside them the
    /// wrench.
    ///
    /// # Errors
    /// Those of [`Log::open`] for either file, and [`LogError::RowMismatch`] if their rows are not the same.
    pub fn open_with_companion(
        path: &Path,
        companion: &Path,
        mapping: &Mapping,
    ) -> Result<Self, LogError> {
        let source = LogSource::new(path, mapping.table.as_deref())?;
        let source = source.with_companion(LogSource::new(companion, None)?)?;
        let mut mapping = mapping.clone();
        if !source.sides.has_names {
            let [readings, others] = source.sides.columns;
            mapping.format = mapping.format.or(Some(LogFormat::Csv));
            if mapping.sensors.is_none() && mapping.time.is_none() {
                mapping.sensors = Some((1..=readings).map(ColumnRef::Position).collect());
            }
            if mapping.wrench.is_none() && others == 6 {
                let position = |axis| Some(ColumnRef::Position(readings + 1 + axis));
                mapping.wrench = Some(std::array::from_fn(position));
            }
        }
        Self::new(source, &mapping)
    }

    fn new(source: LogSource, mapping: &Mapping) -> Result<Self, LogError> {
        let table = source.as_whole_table();
        if table.is_some() && mapping.format == Some(LogFormat::Console) {
            let (format, found) = (LogFormat::Console, table.map_or(0, Table::width));
            let problem = PlacedProblem::LayoutMismatch { format, expected: 9, found };
            return Err(source.error_at(1, problem));
        }
        // Of columns that have names, no more than the clock says what they are.
        let names = table.and_then(Table::names);
        let clock =
            names.and_then(|names| recognise(names, &[], LogFormat::Csv, mapping).ok()?.1.time);
        let shown: Option<Vec<usize>> =
            table.and_then(|table| table.names()).map(|_| clock.into_iter().collect());
        let head = source.head(shown.as_deref(), HEAD_BYTES as usize)?;
        // A row may have nothing in what is shown of a table.
        let has_rows = |table: &Table| line_ends(&head) > u64::from(table.columns.is_some());
        let whole = (head.len() as u64) < HEAD_BYTES && !table.is_some_and(has_rows);
        let layout = recognise_layout(&source, &head, whole, mapping)?;
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

    /// Its format.
    pub fn format(&self) -> LogFormat {
        self.layout.header.format
    }

    /// What kind of file it is, in words.
    pub fn kind(&self) -> String {
        let kind = self.table_kind().map(|kind| kind.to_string());
        kind.unwrap_or_else(|| self.layout.header.format.to_string())
    }

    /// What was decided about the lines above its rows, in words; nothing where the first line names the columns.
    pub fn decisions(&self) -> &[String] {
        &self.layout.decisions
    }

    /// The time in s after which the clock wraps around, if it is a counter of 32 bits.
    pub fn clock_turn_s(&self) -> Option<f64> {
        let column = &self.layout.columns[self.layout.roles.time?];
        self.layout.clock().map(|_| column.meaning.scale().to_si(TURN))
    }

    /// A column that tells apart sensors whose rows alternate, of which none was chosen.
    pub fn interleaving(&self) -> Option<&Interleaving> {
        self.layout.interleaving.as_ref()
    }

    /// Its columns and their meanings.
    pub fn columns(&self) -> &[Column] {
        &self.layout.columns
    }

    /// The names of the sensor columns in channel order, then of those of the wrench that there are.
    pub fn value_names(&self) -> Vec<&str> {
        let positions =
            self.layout.roles.sensors.iter().chain(self.layout.roles.wrench.iter().flatten());
        positions.map(|&position| self.layout.columns[position].name.as_str()).collect()
    }

    /// The columns of the sensors in channel order, then those of the wrench that there are: by their names in the
    /// log, or positions where they have none, if `mapping` specifies them; by their usual names if they were
    /// recognised. A unit that `mapping` specifies stands beside moments.
    pub fn specified_values(&self, mapping: &Mapping) -> Vec<String> {
        let FileLayout { columns, roles, .. } = &self.layout;
        let mapping = mapping.for_columns(&self.column_names());
        let name = |position: usize| match columns[position].name.as_str() {
            "" => ColumnRef::Position(position + 1).to_string(),
            name => name.to_owned(),
        };
        let sensor = |(channel, &position): (usize, &usize)| match mapping.sensors {
            Some(_) => name(position),
            None => format!("s{}", channel + 1),
        };
        let load = |axis: Axis| {
            let position = roles.wrench[axis.index()]?;
            let column = match mapping.wrench {
                Some(_) => name(position),
                None => axis.column().to_owned(),
            };
            Some(match mapping.moment_unit {
                Some(unit) if axis.is_moment() => format!("{column} in {}", unit.symbol()),
                _ => column,
            })
        };
        let sensors = roles.sensors.iter().enumerate().map(sensor);
        sensors.chain(Axis::ALL.into_iter().filter_map(load)).collect()
    }

    /// What `mapping` specifies of this log's columns, by their names: what other logs of the same kind
    /// may be read by. Columns whose names others have, too, are left out.
    pub fn specified(&self, mapping: &Mapping) -> ColumnNames {
        let FileLayout { columns, roles, .. } = &self.layout;
        let mapping = mapping.for_columns(&self.column_names());
        let name = |position: usize| {
            let name = &columns[position].name;
            let is_own = columns.iter().filter(|column| column.name == *name).count() == 1;
            (is_own && !name.is_empty()).then(|| name.clone())
        };
        let sensors =
            mapping.sensors.and_then(|_| roles.sensors.iter().map(|&at| name(at)).collect());
        // All that there are, or none: one without a name of its own is not found again.
        let wrench: PerAxis<Option<String>> = roles.wrench.map(|position| position.and_then(name));
        let all_have = wrench.iter().zip(&roles.wrench).all(|(n, at)| n.is_some() == at.is_some());
        let wrench = mapping.wrench.and(Some(wrench)).filter(|_| all_have);
        let time = mapping.time.and(roles.time).and_then(name);
        ColumnNames {
            sensors,
            moment_unit: mapping.moment_unit.filter(|_| wrench.is_some()),
            wrench,
            time_unit: mapping.time_unit.filter(|_| time.is_some()),
            time,
            group: mapping.group.and(roles.group).and_then(name),
            units: mapping.units,
        }
    }

    /// What of the [usual](Mapping::usual) columns it has and is read by, in words.
    pub fn usual_columns(&self, mapping: &Mapping) -> Vec<&'static str> {
        let found = mapping.for_columns(&self.column_names());
        [
            (found.sensors.is_some() && mapping.sensors.is_none(), "sensors"),
            (found.wrench.is_some() && mapping.wrench.is_none(), "wrench"),
            (found.time.is_some() && mapping.time.is_none(), "time"),
            (found.group.is_some() && mapping.group.is_none(), "group"),
        ]
        .into_iter()
        .filter_map(|(is_taken, what)| is_taken.then_some(what))
        .collect()
    }

    /// The file that stands beside it, if one does.
    pub fn companion(&self) -> Option<&Path> {
        self.source.companion.as_ref().map(|companion| companion.path.as_path())
    }

    /// The checksum of that file.
    ///
    /// # Errors
    /// [`LogError`] if it cannot be read.
    pub fn companion_checksum(&self) -> Result<Option<String>, LogError> {
        let Some(companion) = &self.source.companion else { return Ok(None) };
        let checksum = checksum::of_stream(companion.open_file()?);
        checksum.map(Some).map_err(|error| companion.error(error))
    }

    fn column_names(&self) -> Vec<String> {
        self.layout.columns.iter().map(|column| column.name.clone()).collect()
    }

    /// The number of sensor channels, 0 if there are none.
    pub fn channels(&self) -> usize {
        self.layout.roles.sensors.len()
    }

    /// Which axes of a wrench it has.
    pub fn axes(&self) -> Axes {
        let is_there = |axis: &Axis| self.layout.roles.wrench[axis.index()].is_some();
        Axis::ALL.into_iter().filter(is_there).collect()
    }

    /// Whether it has columns of a wrench.
    pub fn has_wrench(&self) -> bool {
        !self.axes().is_empty()
    }

    /// Leaves the other axes out, as if it had them not.
    ///
    /// # Errors
    /// [`PlacedProblem::MissingColumns`] with those of `axes` that it has not.
    pub fn keep_axes(&mut self, axes: Axes) -> Result<(), LogError> {
        self.require_axes(axes)?;
        for axis in Axes::ALL.without(axes).iter() {
            self.layout.roles.wrench[axis.index()] = None;
        }
        Ok(())
    }

    /// Checks that all of `axes` are there.
    ///
    /// # Errors
    /// [`PlacedProblem::MissingColumns`] with all that are not, and what there is instead.
    pub fn require_axes(&self, axes: Axes) -> Result<(), LogError> {
        let absent = axes.without(self.axes());
        self.check_missing(absent.iter().map(|axis| axis.name().to_owned()).collect())
    }

    /// Whether it has a time column.
    pub fn has_time(&self) -> bool {
        self.layout.roles.time.is_some() || self.layout.rate_hz.is_some()
    }

    /// Whether it has a column of group labels.
    pub fn has_groups(&self) -> bool {
        self.layout.roles.group.is_some()
    }

    /// Where a column of telemetry is in a row, from 0, to be asked for as one of
    /// [`Wanted::others`]; `None` if there is none.
    ///
    /// # Errors
    /// [`PlacedProblem::DuplicateColumn`] if there are several.
    pub fn telemetry(&self, telemetry: Telemetry) -> Result<Option<usize>, LogError> {
        let columns = self.layout.columns.iter().enumerate();
        let is_wanted = |column: &Column| column.meaning == Meaning::Telemetry(telemetry);
        let found = columns.filter(|(_, column)| is_wanted(column)).map(|(position, _)| position);
        match found.collect::<Vec<_>>().as_slice() {
            [first, second, ..] => {
                let (names, meaning) = (self.column_names(), telemetry.name().to_owned());
                Err(self.error_in_names(duplicate(&names, meaning, [*first, *second])))
            }
            found => Ok(found.first().copied()),
        }
    }

    /// Whether equal readings in a row are one frame logged repeatedly: the robot's telemetry runs
    /// faster than the sensor. Elsewhere they can be honest samples.
    pub fn repeats_are_stale(&self) -> bool {
        self.layout.header.format == LogFormat::Telemetry
    }

    /// Where the columns are that a user points to, from 0.
    ///
    /// # Errors
    /// [`PlacedProblem::MissingColumns`] with all that are not there.
    pub fn column_positions(&self, references: &[ColumnRef]) -> Result<Vec<usize>, LogError> {
        let names = self.column_names();
        positions(&names, references).map_err(|problem| self.error_in_names(problem))
    }

    /// What kind of table it is, if it is one in a binary file.
    pub fn table_kind(&self) -> Option<FileKind> {
        self.source.as_table().map(|table| table.kind)
    }

    /// What its table and that beside it leave out of their files, with the reason, and what was decided.
    pub fn notes(&self) -> Vec<&str> {
        let companion = self.source.companion.as_deref();
        let tables = [Some(&self.source), companion].into_iter().flatten();
        let notes = tables.filter_map(LogSource::as_table).flat_map(|table| &table.notes);
        notes.map(String::as_str).collect()
    }

    /// How the file is compressed, if it is.
    pub fn compression(&self) -> Option<&'static str> {
        self.source.compression()
    }

    /// The size of the file on disk.
    pub fn bytes(&self) -> u64 {
        self.source.bytes
    }

    /// Checks that all wanted columns are there, of the wrench one axis at least.
    ///
    /// # Errors
    /// [`PlacedProblem::MissingColumns`] with all that are not, and what there is instead.
    pub fn require(&self, wanted: &Wanted) -> Result<(), LogError> {
        let axes = Axis::ALL.map(Axis::name);
        let needed: [(bool, bool, &[&str]); 4] = [
            (wanted.time, self.has_time(), &["time"]),
            (wanted.readings, self.channels() > 0, &["s1 … (sensors)"]),
            (wanted.wrench, self.has_wrench(), &axes),
            (wanted.groups, self.has_groups(), &["group"]),
        ];
        let absent = needed.iter().filter(|(is_wanted, is_there, _)| *is_wanted && !is_there);
        let names = absent.flat_map(|(.., names)| *names);
        let mut missing: Vec<String> = names.map(|&name| name.to_owned()).collect();
        let columns = &self.layout.columns;
        let asked = wanted.others.iter().chain(&wanted.texts);
        let beyond = asked.filter(|&&at| at >= columns.len());
        missing.extend(beyond.map(|at| format!("column {}", at + 1)));
        self.check_missing(missing)?;
        self.check_units(wanted)?;
        self.check_are_read(wanted)
    }

    /// Checks that the units of the time and the wrench are understood, if these are wanted.
    fn check_units(&self, wanted: &Wanted) -> Result<(), LogError> {
        let roles = &self.layout.roles;
        let time = roles.time.iter().filter(|_| wanted.time);
        for &at in time.chain(roles.wrench.iter().flatten().filter(|_| wanted.wrench)) {
            let column = &self.layout.columns[at];
            if let (StatedUnit::Unknown(unit), Some(quantity)) =
                (&column.unit, column.meaning.quantity())
            {
                let (column, unit) = (column.name.clone(), unit.clone());
                let problem = PlacedProblem::UnknownUnit { column, unit, quantity };
                return Err(self.error_in_names(problem));
            }
        }
        Ok(())
    }

    /// Checks that a table in a binary file holds what can be read in all wanted columns.
    fn check_are_read(&self, wanted: &Wanted) -> Result<(), LogError> {
        let Some(table) = self.source.as_table() else { return Ok(()) };
        let roles = &self.layout.roles;
        let mut columns = roles.numbers(wanted);
        columns.extend(roles.group.filter(|_| wanted.groups));
        let columns = columns.iter().chain(&wanted.texts);
        columns
            .copied()
            .try_for_each(|column| table.check_is_read(column))
            .map_err(|problem| self.source.table_error(problem))
    }

    fn check_missing(&self, missing: Vec<String>) -> Result<(), LogError> {
        if missing.is_empty() {
            return Ok(());
        }
        let found = self.column_names();
        Err(self.error_in_names(PlacedProblem::MissingColumns { missing, found }))
    }

    /// The error of what is wrong with the names of columns.
    fn error_in_names(&self, problem: PlacedProblem) -> LogError {
        self.source.error_at(self.layout.header.names_line, problem)
    }
}
