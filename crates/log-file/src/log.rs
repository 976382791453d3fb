//! A log file whose layout has been recognised.

use std::path::Path;
use std::sync::Arc;

use crate::checksum;
use crate::error::{LogError, PlacedProblem};
use crate::format::choice::Interleaving;
use crate::format::columns::{
    Column, ColumnRoles, Wanted, duplicate, positions, recognise, stated_unit,
};
use crate::format::layout::{FileLayout, HEAD_BYTES, Header, recognise_layout};
use crate::format::mapping::{ColumnRef, LogFormat, Mapping};
use crate::format::meaning::{Meaning, StatedUnit};
use crate::line::line_ends;
use crate::stream::chunk::CHUNK_BYTES;
use crate::stream::source::LogSource;
use shell_data::ColumnNames;
use shell_data::telemetry::{COUNTS, Telemetry, are_counts};
use shell_data::unit::{Quantity, Scale, Unit};
use shell_data::wrench::{Axes, Axis, PerAxis};
use table_file::{FileKind, Table};

#[derive(Debug)]
pub struct Log {
    pub(crate) source: LogSource,
    pub(crate) layout: FileLayout,
    pub(crate) chunk_bytes: usize,
    pub(crate) replaces_wrench: bool,
}

/// Returns the columns that may hold the time: the clock, its parts, and other columns with a date or time in their
/// name. `None` without a clock.
fn clock_columns(columns: &[Column], roles: &ColumnRoles) -> Option<Vec<usize>> {
    let clock = roles.time?;
    let is_called =
        |name: &str| ["date", "datum", "time", "zeit"].iter().any(|it| name.contains(it));
    let others = columns.iter().enumerate().filter(|(_, column)| {
        column.meaning == Meaning::Other && is_called(&column.name.to_lowercase())
    });
    let parts = roles.time_parts.iter().map(|part| part.column);
    let mut all: Vec<usize> =
        std::iter::once(clock).chain(parts).chain(others.map(|(at, _)| at)).collect();
    all.sort_unstable();
    all.dedup();
    Some(all)
}

impl Log {
    /// Recognises the log at `path` from its first lines.
    ///
    /// # Errors
    /// [`LogError`] if the file cannot be read, is empty, has an unsupported format or layout, has two
    /// columns with the same meaning, or lacks a column that `mapping` names.
    pub fn open(path: &Path, mapping: &Mapping) -> Result<Self, LogError> {
        Self::new(LogSource::new(path, mapping.table.as_deref())?, mapping)
    }

    /// Recognises a log in memory, which is called `name` in messages.
    ///
    /// # Errors
    /// Errors of [`Log::open`].
    pub fn in_memory(name: &Path, bytes: Arc<[u8]>, mapping: &Mapping) -> Result<Self, LogError> {
        Self::new(LogSource::in_memory(name, bytes, mapping.table.as_deref())?, mapping)
    }

    pub(crate) fn new(source: LogSource, mapping: &Mapping) -> Result<Self, LogError> {
        Self::with_header(source, mapping, None)
    }

    pub(crate) fn with_header(
        source: LogSource,
        mapping: &Mapping,
        header: Option<Header>,
    ) -> Result<Self, LogError> {
        let table = source.as_whole_table();
        if table.is_some() && mapping.format == Some(LogFormat::Console) {
            let (format, found) = (LogFormat::Console, table.map_or(0, Table::width));
            let problem = PlacedProblem::LayoutMismatch { format, expected: 9, found };
            return Err(source.error_at(1, problem));
        }
        // If a name says which column is the time, only its values are needed to recognise the log. Otherwise, any
        // column that does not hold floating-point numbers may have dates.
        let shown = table.and_then(|table| {
            let names = table.names()?;
            let may_tell =
                |at: &usize| !table.is_real(*at) || Interleaving::is_identity(&names[*at]);
            let others = (0..names.len()).filter(may_tell).collect();
            let (columns, roles) = recognise(names, &[], LogFormat::Csv, mapping).ok()?;
            Some(clock_columns(&columns, &roles).unwrap_or(others))
        });
        let head = source.head(shown.as_deref(), HEAD_BYTES as usize)?;
        // A row may be empty in the columns that are shown.
        let has_rows = |table: &Table| line_ends(&head) > u64::from(table.columns.is_some());
        let whole = (head.len() as u64) < HEAD_BYTES && !table.is_some_and(has_rows);
        let layout = recognise_layout(&source, &head, whole, mapping, header)?;
        Ok(Self { source, layout, chunk_bytes: CHUNK_BYTES, replaces_wrench: false })
    }

    /// Sets the approximate bytes per block, to test that results do not depend on them.
    #[doc(hidden)]
    pub fn with_chunk_bytes(self, chunk_bytes: usize) -> Self {
        Self { chunk_bytes: chunk_bytes.max(1), ..self }
    }

    pub fn path(&self) -> &Path {
        &self.source.path
    }

    pub fn format(&self) -> LogFormat {
        self.layout.header.format
    }

    pub fn kind(&self) -> String {
        let kind = self.table_kind().map(|kind| kind.to_string());
        kind.unwrap_or_else(|| self.layout.header.kind())
    }

    /// Describes the decisions about the lines above the rows; empty if the first line names the columns.
    pub fn decisions(&self) -> &[String] {
        &self.layout.decisions
    }

    /// Returns the time in s after which the clock wraps around, and the event in words; `None` if it cannot.
    pub fn clock_turn(&self) -> Option<(f64, &'static str)> {
        let column = &self.layout.columns[self.layout.roles.time?];
        let (turn, event) = self.layout.clock()?.turn();
        Some((column.meaning.scale().to_si(turn), event))
    }

    /// Returns a column that distinguishes alternating sensors, if none of them is selected.
    pub fn interleaving(&self) -> Option<&Interleaving> {
        self.layout.interleaving.as_ref()
    }

    pub fn columns(&self) -> &[Column] {
        &self.layout.columns
    }

    /// Returns the names of the sensor columns in channel order, followed by the log's wrench columns.
    pub fn value_names(&self) -> Vec<&str> {
        let positions =
            self.layout.roles.sensors.iter().chain(self.layout.roles.wrench.iter().flatten());
        positions.map(|&position| self.layout.columns[position].name.as_str()).collect()
    }

    /// Describes the sensor columns in channel order, then the wrench columns. A column that `mapping` specifies is
    /// described by its name in the log, or else its position; a recognised column by its usual name. A moment unit
    /// that `mapping` specifies is appended to the moments.
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

    /// Returns the column references of `mapping` by name in this log, for reading logs of the same kind. Columns
    /// without a unique name are omitted.
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
        // If any axis has no unique name, no axis is named, because another log could not be read completely.
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

    /// Lists the kinds of [usual](Mapping::usual) columns that the log has and that are used to read it.
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

    /// Returns true if the companion's wrench replaces the log's own.
    pub fn replaces_wrench(&self) -> bool {
        self.replaces_wrench
    }

    pub fn companion(&self) -> Option<&Path> {
        self.source.companion.as_ref().map(|companion| companion.path.as_path())
    }

    /// # Errors
    /// [`LogError`] if the companion cannot be read.
    pub fn companion_checksum(&self) -> Result<Option<String>, LogError> {
        let Some(companion) = &self.source.companion else { return Ok(None) };
        let checksum = checksum::of_stream(companion.open_file()?);
        checksum.map(Some).map_err(|error| companion.error(error))
    }

    fn column_names(&self) -> Vec<String> {
        self.layout.columns.iter().map(|column| column.name.clone()).collect()
    }

    pub fn channels(&self) -> usize {
        self.layout.roles.sensors.len()
    }

    pub fn axes(&self) -> Axes {
        let is_there = |axis: &Axis| self.layout.roles.wrench[axis.index()].is_some();
        Axis::ALL.into_iter().filter(is_there).collect()
    }

    pub fn has_wrench(&self) -> bool {
        !self.axes().is_empty()
    }

    /// Removes all other axes from the log.
    ///
    /// # Errors
    /// [`PlacedProblem::MissingColumns`] with the missing axes.
    pub fn keep_axes(&mut self, axes: Axes) -> Result<(), LogError> {
        self.require_axes(axes)?;
        for axis in Axes::ALL.without(axes).iter() {
            self.layout.roles.wrench[axis.index()] = None;
        }
        Ok(())
    }

    /// Checks that the log has all of `axes`.
    ///
    /// # Errors
    /// [`PlacedProblem::MissingColumns`] with all missing axes and the existing columns.
    pub fn require_axes(&self, axes: Axes) -> Result<(), LogError> {
        let absent = axes.without(self.axes());
        self.check_missing(absent.iter().map(|axis| axis.name().to_owned()).collect())
    }

    /// Returns true if the log has a time column or a rate.
    pub fn has_time(&self) -> bool {
        self.layout.roles.time.is_some() || self.layout.rate_hz.is_some()
    }

    pub fn has_groups(&self) -> bool {
        self.layout.roles.group.is_some()
    }

    /// Returns the position of a telemetry column in a row, from 0, for use in [`Wanted::others`]; `None` if
    /// the log lacks it.
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

    /// Returns the unit of a telemetry column, given by its position: from its name, the line below, or the profile
    /// (`expected`); [`COUNTS`] if it is counts, `None` if nothing states it.
    ///
    /// # Errors
    /// [`PlacedProblem::OtherUnit`] if the profile contradicts the log, [`PlacedProblem::UnknownUnit`] if the log's unit
    /// is not understood and the profile has none.
    pub fn telemetry_unit(
        &self,
        at: usize,
        quantity: Quantity,
        expected: Option<&str>,
    ) -> Result<Option<String>, LogError> {
        let column = self.layout.columns[at].name.clone();
        let stated = stated_unit(&column, &self.layout.header.units, at, quantity);
        let unit = match stated {
            StatedUnit::Unknown(unit) if are_counts(&unit) => COUNTS.to_owned(),
            StatedUnit::Unknown(unit) if expected.is_none() => {
                let problem = PlacedProblem::UnknownUnit { column, unit, quantity };
                return Err(self.error_in_names(problem));
            }
            // A unit of something else is a contradiction, any other word is a remark.
            StatedUnit::Unknown(unit) if Unit::is_spelled(&unit) => unit,
            StatedUnit::Unknown(_) | StatedUnit::None => return Ok(expected.map(str::to_owned)),
            StatedUnit::Known(unit) => unit.symbol,
        };
        let scale =
            |unit: &str| (unit == COUNTS, Unit::parse(unit, quantity).map(|unit| unit.scale));
        match expected {
            Some(expected) if scale(expected) != scale(&unit) => {
                let expected = expected.to_owned();
                Err(self.error_in_names(PlacedProblem::OtherUnit { column, unit, expected }))
            }
            _ => Ok(Some(unit)),
        }
    }

    /// Returns true if equal consecutive readings are one frame, as in robot telemetry, which is faster than the
    /// sensor. In other formats, they may be separate samples.
    pub fn repeats_are_stale(&self) -> bool {
        self.layout.header.format == LogFormat::Telemetry
    }

    /// Returns the positions, from 0, of the columns that a user refers to.
    ///
    /// # Errors
    /// [`PlacedProblem::MissingColumns`] with all missing columns.
    pub fn column_positions(&self, references: &[ColumnRef]) -> Result<Vec<usize>, LogError> {
        let names = self.column_names();
        positions(&names, references).map_err(|problem| self.error_in_names(problem))
    }

    /// Returns the format of a binary table.
    pub fn table_kind(&self) -> Option<FileKind> {
        self.source.as_table().map(|table| table.kind)
    }

    /// Returns notes on contents that the tables of the log and its companion leave out, and on decisions.
    pub fn notes(&self) -> Vec<&str> {
        let companion = self.source.companion.as_deref();
        let tables = [Some(&self.source), companion].into_iter().flatten();
        let notes = tables.filter_map(LogSource::as_table).flat_map(|table| &table.notes);
        notes.map(String::as_str).collect()
    }

    /// Returns true if a table of the log or its companion ends in the middle of its content.
    pub fn is_cut_off(&self) -> bool {
        let companion = self.source.companion.as_deref();
        let mut tables = [Some(&self.source), companion].into_iter().flatten();
        tables.any(|source| source.as_table().is_some_and(|table| table.is_cut_off))
    }

    pub fn compression(&self) -> Option<&'static str> {
        self.source.compression()
    }

    /// Returns the size on disk in bytes.
    pub fn bytes(&self) -> u64 {
        self.source.bytes
    }

    /// Checks that the log has all wanted columns, and at least one axis of a wanted wrench.
    ///
    /// # Errors
    /// [`PlacedProblem::MissingColumns`] with all missing columns and the existing ones.
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

    /// Checks that the times are not whole numbers without a unit that may number the rows, for results that depend on
    /// durations.
    ///
    /// # Errors
    /// [`PlacedProblem::UnclearTimeUnit`].
    pub fn require_time_unit(&self) -> Result<(), LogError> {
        let FileLayout { roles, unclear_time, columns, .. } = &self.layout;
        let Some((step, at)) = unclear_time.zip(roles.time) else { return Ok(()) };
        let column = columns[at].name.clone();
        Err(self.error_in_names(PlacedProblem::UnclearTimeUnit { column, step }))
    }

    /// Checks that the units of the time and the wrench are known, if these are wanted.
    fn check_units(&self, wanted: &Wanted) -> Result<(), LogError> {
        let roles = &self.layout.roles;
        let unclear = self.layout.dates.as_ref().and_then(|dates| dates.unclear.clone());
        if let (Some(date), Some(at), true) = (unclear, roles.time, wanted.time) {
            let column = self.layout.columns[at].name.clone();
            return Err(self.error_in_names(PlacedProblem::UnclearDate { column, date }));
        }
        if wanted.wrench {
            self.check_all_have_units()?;
        }
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

    /// Checks that no load lacks a unit if another of its kind has a unit other than N or N·m.
    fn check_all_have_units(&self) -> Result<(), LogError> {
        for is_moment in [false, true] {
            let axes = Axis::ALL.into_iter().filter(|axis| axis.is_moment() == is_moment);
            let columns = axes.filter_map(|axis| self.layout.roles.wrench[axis.index()]);
            let columns: Vec<&Column> = columns.map(|at| &self.layout.columns[at]).collect();
            let is_foreign = |column: &&&Column| {
                column.unit.known().is_some_and(|unit| unit.scale != Scale::ONE)
            };
            let bare = columns.iter().find(|column| column.unit == StatedUnit::None);
            if let (Some(stated), Some(bare)) = (columns.iter().find(is_foreign), bare) {
                let unit = stated.unit.known().map_or_else(String::new, |unit| unit.symbol.clone());
                let columns = Box::new([bare.name.clone(), stated.name.clone()]);
                let problem = PlacedProblem::UnitOfSome { columns, unit, is_moment };
                return Err(self.error_in_names(problem));
            }
        }
        Ok(())
    }

    /// Checks that all wanted columns of a binary table can be read.
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

    fn error_in_names(&self, problem: PlacedProblem) -> LogError {
        self.source.error_at(self.layout.header.names_line, problem)
    }
}
