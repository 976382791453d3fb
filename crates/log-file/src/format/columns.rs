//! The meanings of a log's columns, from their names and the user's mapping.

use super::clock_parts::{ClockPart, fraction_by_name, has_fraction};
use super::column_name::{ColumnRef, plain};
use super::mapping::{LogFormat, Mapping, TimeUnit};
use super::meaning::{
    GROUPS, Meaning, StatedUnit, capitals, default_time_unit, meaning_of, numbered, split_unit,
    suffixes, unit_in_name, without_unit,
};
use crate::error::PlacedProblem;
use crate::parse::date::DateOrder;
use shell_data::unit::{Quantity, Scale, Unit, is_letter};
use shell_data::wrench::{Axis, PerAxis};

#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// The name in the header, or a description if the file has no header.
    pub name: String,
    pub meaning: Meaning,
    /// The unit from the name, the line below the names or an option, if the meaning has a unit.
    pub unit: StatedUnit,
}

impl Column {
    pub fn in_words(&self) -> Option<String> {
        let meaning = self.meaning.in_words()?;
        let unit = self.unit.known().map(|unit| unit.symbol.as_str());
        Some(match (self.meaning, unit) {
            (Meaning::Time(scale), unit) => {
                let symbol = |of: &TimeUnit| of.per_second() == scale.per;
                let usual = TimeUnit::ALL.into_iter().find(symbol).map_or("s", TimeUnit::symbol);
                format!("{meaning} ({})", unit.unwrap_or(usual))
            }
            (Meaning::Load(axis, scale), Some(unit)) if scale != Scale::ONE => {
                format!("{meaning} ({}, from {unit})", axis.unit())
            }
            (Meaning::Load(axis, _), _) => format!("{meaning} ({})", axis.unit()),
            _ => meaning,
        })
    }

    pub(crate) fn set_unit(&mut self, unit: StatedUnit) {
        if let StatedUnit::Known(unit) = &unit {
            self.meaning = self.meaning.scaled(unit.scale);
        }
        self.unit = unit;
    }
}

/// Positions in a row, from 0, of the columns with a meaning.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct ColumnRoles {
    pub(crate) sensors: Vec<usize>,
    pub(crate) wrench: PerAxis<Option<usize>>,
    pub(crate) time: Option<usize>,
    /// Columns that are added to the time.
    pub(crate) time_parts: Vec<ClockPart>,
    pub(crate) group: Option<usize>,
}

/// The requested columns. Others are not parsed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Wanted {
    pub time: bool,
    /// Readings of all channels.
    pub readings: bool,
    /// Wrench, for the axes that the log has.
    pub wrench: bool,
    pub groups: bool,
    /// Additional columns by position in the row, from 0, unconverted.
    pub others: Vec<usize>,
    /// Text columns by position in the row, from 0, without repetitions.
    pub texts: Vec<usize>,
}

impl ColumnRoles {
    pub(crate) fn numbers(&self, wanted: &Wanted) -> Vec<usize> {
        let mut positions = wanted.others.clone();
        positions.extend(self.time.filter(|_| wanted.time));
        let parts = self.time_parts.iter().filter(|_| wanted.time);
        positions.extend(parts.map(|part| part.column));
        positions.extend(self.sensors.iter().filter(|_| wanted.readings));
        positions.extend(self.wrench.iter().flatten().filter(|_| wanted.wrench));
        positions
    }
}

pub(crate) fn duplicate(names: &[String], meaning: String, columns: [usize; 2]) -> PlacedProblem {
    let names = Box::new(columns.map(|at| names[at].clone()));
    PlacedProblem::DuplicateColumn { meaning, columns, names }
}

/// Assigns a meaning to each column from its name. `units` belong to the names, if there are any.
pub(crate) fn recognise(
    names: Vec<String>,
    units: &[String],
    format: LogFormat,
    mapping: &Mapping,
) -> Result<(Vec<Column>, ColumnRoles), PlacedProblem> {
    let mapping = &mapping.for_columns(&names);
    let named: Vec<(Meaning, StatedUnit)> =
        names.iter().map(|name| meaning_of(name, format)).collect();
    let mut meanings: Vec<Meaning> = named.iter().map(|(meaning, _)| *meaning).collect();
    recognise_other_readings(&names, &mut meanings);
    recognise_other_wrench(&names, &mut meanings);
    recognise_other_times(&names, &mut meanings);
    prefer_usual_names(&names, &mut meanings);
    let group = apply_mapping(&names, format, mapping, &mut meanings)?;
    // Seconds and their fraction are one time.
    for at in 1..names.len() {
        let are_times = matches!(meanings[at - 1..=at], [Meaning::Time(_), Meaning::Time(_)]);
        if are_times && has_fraction(&names, at - 1) {
            meanings[at] = Meaning::Other;
        }
    }
    let mut roles = roles(&names, &mut meanings)?;
    let fraction = roles.time.and_then(|at| fraction_by_name(&names, at));
    roles.time_parts.extend(fraction.filter(|part| meanings[part.column] == Meaning::Other));
    roles.group = group.or(roles.group);
    let mut columns = Vec::with_capacity(names.len());
    for (at, ((name, meaning), (named, in_name))) in
        names.into_iter().zip(meanings).zip(named).enumerate()
    {
        let mut column = Column { name, meaning, unit: StatedUnit::None };
        if let Some(quantity) = meaning.quantity() {
            let in_name = match named.quantity() == Some(quantity) {
                true => in_name,
                // A name may be a unit as well: `micros`.
                false => match Unit::parse(&column.name, quantity) {
                    Some(unit) if quantity == Quantity::Time => StatedUnit::Known(unit),
                    _ => unit_in_name(&column.name, quantity),
                },
            };
            column.set_unit(one_unit(in_name, unit_below(units, at, quantity)));
        }
        columns.push(column);
    }
    specify_units(&mut columns, mapping)?;
    Ok((columns, roles))
}

/// Returns the unit that the line below the names states.
fn unit_below(units: &[String], at: usize, quantity: Quantity) -> StatedUnit {
    // A field without letters, such as a dash, is not a unit, except for the `1` of a share.
    let is_said = |unit: &&String| {
        unit.contains(is_letter) || (quantity == Quantity::Share && unit.trim() == "1")
    };
    units.get(at).filter(is_said).map_or(StatedUnit::None, |unit| StatedUnit::new(unit, quantity))
}

/// Returns the unit that the log states for a column whose meaning is not in its name.
pub(crate) fn stated_unit(
    name: &str,
    units: &[String],
    at: usize,
    quantity: Quantity,
) -> StatedUnit {
    one_unit(unit_in_name(name, quantity), unit_below(units, at, quantity))
}

fn one_unit(in_name: StatedUnit, below: StatedUnit) -> StatedUnit {
    match (&in_name, &below) {
        (StatedUnit::Known(name), StatedUnit::Known(row)) if name.scale != row.scale => {
            StatedUnit::Unknown(format!("{}` or `{}", name.symbol, row.symbol))
        }
        (StatedUnit::None, _) => below,
        _ => in_name,
    }
}

/// Replaces the log's units by the user's, and fills in the usual units where the log has none.
fn specify_units(columns: &mut [Column], mapping: &Mapping) -> Result<(), PlacedProblem> {
    let is_known = |key: &str| UNIT_KEYS.contains(&key.to_ascii_lowercase().as_str());
    let is_there = |key: &&String| is_known(key) || columns.iter().any(|of| of.name == **key);
    if let Some((key, _)) = mapping.units.iter().find(|(key, _)| !is_there(&key)) {
        let found = columns.iter().map(|column| column.name.clone()).collect();
        return Err(PlacedProblem::MissingColumns { missing: vec![key.clone()], found });
    }
    for column in columns {
        let Some(quantity) = column.meaning.quantity() else { continue };
        let is_of = |key: &str| {
            let is_axis = column.meaning.in_words().is_some_and(|it| it.eq_ignore_ascii_case(key));
            let kind = match quantity {
                Quantity::Force => "force",
                Quantity::Moment => "moment",
                _ => "time",
            };
            is_axis || kind.eq_ignore_ascii_case(key) || column.name == key
        };
        let of_list = |list: &[(String, String)]| {
            // The order of day and month in dates (an option value, too) is not a unit.
            let is_unit = |unit: &str| DateOrder::from_option(unit).is_none();
            let last = list.iter().rev().find(|(key, unit)| is_of(key) && is_unit(unit));
            last.map(|(_, unit)| StatedUnit::new(unit, quantity))
        };
        let usual = || of_list(&mapping.usual_units).filter(|_| column.unit == StatedUnit::None);
        let by_kind = match quantity {
            Quantity::Time => mapping.time_unit.map(StatedUnit::from),
            Quantity::Moment => {
                mapping.moment_unit.map(|unit| StatedUnit::new(unit.symbol(), Quantity::Moment))
            }
            _ => None,
        };
        if let Some(unit) = of_list(&mapping.units).or(by_kind).or_else(usual) {
            column.set_unit(unit);
        }
    }
    Ok(())
}

/// Replaces recognised meanings by the user's. Returns the user's group column, which may also have another meaning.
fn apply_mapping(
    names: &[String],
    format: LogFormat,
    mapping: &Mapping,
    meanings: &mut [Meaning],
) -> Result<Option<usize>, PlacedProblem> {
    let mut mapped: Vec<(Meaning, ColumnRef)> = Vec::new();
    if let Some(sensors) = &mapping.sensors {
        let channels = of_matrices(names, sensors).into_iter().enumerate();
        mapped.extend(channels.map(|(channel, column)| (Meaning::Sensor(channel), column)));
    }
    if let Some(wrench) = &mapping.wrench {
        let loads = Axis::ALL.into_iter().zip(wrench_columns(names, wrench));
        mapped.extend(
            loads.filter_map(|(axis, column)| Some((Meaning::Load(axis, Scale::ONE), column?))),
        );
    }
    let time = Meaning::Time(Scale::per_si(default_time_unit(format).per_second()));
    mapped.extend(mapping.time.clone().map(|column| (time, column)));
    let columns = mapped.iter().map(|(_, column)| column).chain(&mapping.group);
    let mut places = positions(names, &columns.cloned().collect::<Vec<_>>())?.into_iter();
    let is_replaced = |meaning: &Meaning| match meaning {
        Meaning::Sensor(_) => mapping.sensors.is_some(),
        Meaning::Load(..) => mapping.wrench.is_some(),
        Meaning::Time(_) => mapping.time.is_some(),
        Meaning::Group => mapping.group.is_some(),
        Meaning::Telemetry(_) | Meaning::TimePart | Meaning::Other => false,
    };
    meanings.iter_mut().filter(|m| is_replaced(m)).for_each(|m| *m = Meaning::Other);

    let mut is_mapped = vec![false; names.len()];
    for ((meaning, _), at) in mapped.into_iter().zip(&mut places) {
        if std::mem::replace(&mut is_mapped[at], true) {
            let words = meaning.in_words().unwrap_or_default();
            let meaning = format!("mapped to {words} and to something else");
            return Err(duplicate(names, meaning, [at, at]));
        }
        meanings[at] = meaning;
    }
    let group = places.next();
    if let Some(meaning) = group.map(|at| &mut meanings[at]).filter(|at| **at == Meaning::Other) {
        *meaning = Meaning::Group;
    }
    Ok(group)
}

fn columns_of(names: &[String], name: &str) -> Vec<String> {
    let numbered = |first: usize, [before, after]: [&str; 2]| -> Vec<String> {
        let columns = (first..).map(|number| format!("{name}{before}{number}{after}"));
        columns.take_while(|column| names.contains(column)).collect()
    };
    let forms = [["", ""], ["_", ""], [".", ""], ["[", "]"]];
    let all = forms.into_iter().flat_map(|form| [numbered(1, form), numbered(0, form)]);
    all.max_by_key(Vec::len).unwrap_or_default()
}

/// Returns the columns of a wrench. If the user names a matrix, its columns may have other names in the log.
fn wrench_columns(
    names: &[String],
    wrench: &PerAxis<Option<ColumnRef>>,
) -> PerAxis<Option<ColumnRef>> {
    let stem = || match wrench.first() {
        Some(Some(ColumnRef::Name(first))) => first.strip_suffix('1'),
        _ => None,
    };
    let is_there = |column: &Option<ColumnRef>| {
        column.as_ref().is_none_or(|column| position(names, column).is_some())
    };
    if wrench.iter().all(is_there) {
        return wrench.clone();
    }
    let columns = stem().map(|stem| columns_of(names, stem)).unwrap_or_default();
    match <[String; 6]>::try_from(columns) {
        Ok(six) => six.map(|name| Some(ColumnRef::Name(name))),
        Err(_) => wrench.clone(),
    }
}

/// Extends `mapping` if neither it nor the names identify readings and wrench. If there are two matrices, the one with
/// six columns is the wrench and the other one has the readings.
pub(crate) fn by_shape(names: &[String], mapping: &Mapping) -> Mapping {
    let mut mapping = mapping.for_columns(names);
    // `a1` is the first column of `a`; `a11` is not taken as a column of `a1`.
    let first = names.iter().filter_map(|name| name.strip_suffix('1'));
    let first = first.filter(|name| !names.iter().any(|other| other == name));
    let matrices: Vec<Vec<String>> =
        first.map(|name| columns_of(names, name)).filter(|columns| columns.len() > 1).collect();
    let has_meaning = |name: &String| {
        !matches!(meaning_of(name, LogFormat::Csv).0, Meaning::Other | Meaning::Time(_))
    };
    let is_specified = mapping.sensors.is_some() || mapping.wrench.is_some();
    if is_specified || names.iter().any(has_meaning) {
        return mapping;
    }
    let references = |columns: &[String]| -> Vec<ColumnRef> {
        columns.iter().cloned().map(ColumnRef::Name).collect()
    };
    if let [one, other] = matrices.as_slice()
        && let (wrench, readings) = if one.len() == 6 { (one, other) } else { (other, one) }
        && readings.len() != 6
        && let Ok(wrench) = <[ColumnRef; 6]>::try_from(references(wrench))
    {
        mapping.wrench = Some(wrench.map(Some));
        mapping.sensors = Some(references(readings));
    }
    mapping
}

fn of_matrices(names: &[String], references: &[ColumnRef]) -> Vec<ColumnRef> {
    let columns = |reference: &ColumnRef| match reference {
        ColumnRef::Name(name) if position(names, reference).is_none() => {
            let columns = columns_of(names, name).into_iter().map(ColumnRef::Name);
            Some(columns.collect::<Vec<_>>()).filter(|columns| !columns.is_empty())
        }
        _ => None,
    };
    let all = references.iter();
    all.flat_map(|one| columns(one).unwrap_or_else(|| vec![one.clone()])).collect()
}

/// Returns the positions of the columns that a user refers to, or an error with the missing ones.
pub(crate) fn positions(
    names: &[String],
    references: &[ColumnRef],
) -> Result<Vec<usize>, PlacedProblem> {
    let found: Vec<_> = references.iter().map(|r| position(names, r)).collect();
    let missing = references.iter().zip(&found).filter(|(_, at)| at.is_none());
    let missing: Vec<String> = missing.map(|(reference, _)| reference.to_string()).collect();
    match missing.is_empty() {
        true => Ok(found.into_iter().flatten().collect()),
        false => Err(PlacedProblem::MissingColumns { missing, found: names.to_vec() }),
    }
}

/// Returns the position of a user's column. An exact match takes precedence over one that ignores case.
fn position(names: &[String], reference: &ColumnRef) -> Option<usize> {
    match reference {
        ColumnRef::Position(position) => position.checked_sub(1).filter(|&at| at < names.len()),
        ColumnRef::Name(name) => names
            .iter()
            .position(|n| n == name)
            .or_else(|| names.iter().position(|n| n.eq_ignore_ascii_case(name))),
    }
}

/// Converts meanings to positions. Two columns with the same meaning are an error, except for groups: the name that
/// comes first in [`GROUPS`] wins.
fn roles(names: &[String], meanings: &mut [Meaning]) -> Result<ColumnRoles, PlacedProblem> {
    let mut roles = ColumnRoles::default();
    let mut sensors: Vec<Option<usize>> = Vec::new();
    let number = |meaning: &Meaning| match meaning {
        Meaning::Sensor(number) => Some(*number),
        _ => None,
    };
    // Names count from 0 or from 1; channels count from 0.
    let first_number = meanings.iter().filter_map(number).min().map_or(0, |number| number.min(1));
    for (at, meaning) in meanings.iter_mut().enumerate() {
        let place = match meaning {
            Meaning::Time(_) => &mut roles.time,
            Meaning::Sensor(channel) => {
                *channel -= first_number;
                sensors.resize(sensors.len().max(*channel + 1), None);
                &mut sensors[*channel]
            }
            Meaning::Load(axis, _) => &mut roles.wrench[axis.index()],
            _ => continue,
        };
        if let Some(first) = place.replace(at) {
            return Err(duplicate(names, meaning.in_words().unwrap_or_default(), [first, at]));
        }
    }
    let groups = meanings.iter().enumerate().filter(|(_, m)| **m == Meaning::Group);
    roles.group = groups.map(|(at, _)| at).min_by_key(|&at| {
        let name = plain(&names[at]);
        (GROUPS.iter().position(|g| *g == name).unwrap_or(GROUPS.len()), at)
    });
    for (at, meaning) in meanings.iter_mut().enumerate() {
        if *meaning == Meaning::Group && roles.group != Some(at) {
            *meaning = Meaning::Other;
        }
    }
    let missing: Vec<_> = (0..sensors.len()).filter(|&i| sensors[i].is_none()).collect();
    if !missing.is_empty() {
        let named = |i: usize| format!("s{}", i + first_number);
        let missing = missing.into_iter().map(named).collect();
        return Err(PlacedProblem::MissingColumns { missing, found: names.to_vec() });
    }
    roles.sensors = sensors.into_iter().flatten().collect();
    Ok(roles)
}

/// Other names of readings, in order of preference: used if no column has a usual name and their numbers have no gap.
const OTHER_READINGS: [&str; 8] = ["ch", "channel", "adc", "ain", "ai", "reading", "raw", "analog"];

/// Keys that `--unit` accepts in addition to columns.
pub(super) const UNIT_KEYS: [&str; 9] =
    ["fx", "fy", "fz", "mx", "my", "mz", "force", "moment", "time"];

fn recognise_other_readings(names: &[String], meanings: &mut [Meaning]) {
    if meanings.iter().any(|meaning| matches!(meaning, Meaning::Sensor(_))) {
        return;
    }
    for prefix in OTHER_READINGS {
        let channel = |(at, name): (usize, &String)| {
            let name = without_unit(name);
            let is_free = meanings[at] == Meaning::Other;
            numbered(&name, prefix).filter(|_| is_free).map(|channel| (channel, at))
        };
        let mut found: Vec<(usize, usize)> = names.iter().enumerate().filter_map(channel).collect();
        found.sort_unstable();
        let first = found.first().map_or(0, |(channel, _)| *channel);
        let is_whole = found.iter().enumerate().all(|(i, (channel, _))| *channel == first + i);
        if found.len() > 1 && first <= 1 && is_whole {
            found.iter().for_each(|&(channel, at)| meanings[at] = Meaning::Sensor(channel));
            return;
        }
    }
}

/// Recognises a wrench by longer names, if no column has a usual one: `/ft/wrench/force/x` (topics in PlotJuggler),
/// `Fx1` to `Mz1` (the only force plate), `wrench1` to `wrench6`, `force1` to `torque3` (lists). Each axis must occur once, or the user has to choose.
fn recognise_other_wrench(names: &[String], meanings: &mut [Meaning]) {
    let axis_of = |name: &str| match meaning_of(name, LogFormat::Csv).0 {
        Meaning::Load(axis, _) => Some(axis),
        _ => None,
    };
    if meanings.iter().any(|meaning| matches!(meaning, Meaning::Load(..))) {
        return;
    }
    let in_path = |name: &str| axis_of(&name[name.rfind("wrench")?..]);
    let of_plate = |name: &str| {
        let base = name.split(['(', '[']).next().unwrap_or_default().trim_end();
        axis_of(base.strip_suffix('1')?)
    };
    let all = |axis_in: &dyn Fn(&str) -> Option<Axis>| {
        let found = names.iter().enumerate().filter_map(|(at, name)| Some((axis_in(name)?, at)));
        let found: Vec<_> = found.filter(|(_, at)| meanings[*at] == Meaning::Other).collect();
        let has = |axis: &Axis| found.iter().any(|(of, _)| of == axis);
        (found.len() == 6 && Axis::ALL.iter().all(has)).then_some(found)
    };
    let of_element = |first: usize| {
        move |name: &str| {
            let name = plain(name.split('(').next().unwrap_or(name));
            let stem = name.trim_end_matches(|c: char| c.is_ascii_digit());
            let number: usize = name[stem.len()..].parse().ok()?;
            let ends = |ends: &[&str]| ends.iter().any(|end| stem.ends_with(end));
            let (before, count) = match () {
                () if ends(&["wrench"]) => (0, 6),
                () if ends(&["force", "forces"]) => (0, 3),
                () if ends(&["torque", "torques", "moment", "moments"]) => (3, 3),
                () => return None,
            };
            let at = number.checked_sub(first).filter(|at| *at < count)?;
            Axis::ALL.get(before + at).copied()
        }
    };
    let found = all(&in_path).or_else(|| all(&of_plate));
    let found = found.or_else(|| all(&of_element(1))).or_else(|| all(&of_element(0)));
    for (axis, at) in found.unwrap_or_default() {
        meanings[at] = Meaning::Load(axis, Scale::ONE);
    }
}

/// Other names of a clock, in order of preference: used if no column has a usual name.
const OTHER_TIMES: [&str; 50] = [
    "elapsedtime",
    "timeelapsed",
    "xvalue",
    "boardtime",
    "micros",
    "millis",
    "datetime",
    "rosbagtimestamp",
    "headerstamp",
    "fieldheaderstamp",
    "stamp",
    "hosttime",
    "systemtime",
    "abstime",
    "reltime",
    "relativetime",
    "elapsed",
    "unixtime",
    "epoch",
    "rxdatetime",
    "unix",
    "zeit",
    "temps",
    "tiempo",
    "tempo",
    "uhrzeit",
    "heure",
    "hora",
    "zeitstempel",
    "horodatage",
    "datum",
    "date",
    "fecha",
    "ts",
    "timesincestart",
    "sensortime",
    "devicetime",
    "robottime",
    "rostime",
    "clock",
    "datenum",
    "time1defaultsamplerate",
    "ms",
    "msec",
    "milliseconds",
    "us",
    "usec",
    "sec",
    "secs",
    "seconds",
];

fn recognise_other_times(names: &[String], meanings: &mut [Meaning]) {
    if meanings.iter().any(|meaning| matches!(meaning, Meaning::Time(_))) {
        return;
    }
    let known = |name: &str| OTHER_TIMES.iter().position(|other| *other == plain(name));
    let rank = |at: &usize| {
        if has_fraction(names, *at) {
            return Some(0);
        }
        let name = names[*at].split(['(', '[']).next().unwrap_or_default();
        let mut bases = suffixes(name)
            .chain(capitals(name))
            .filter(|(_, unit)| Unit::parse(unit, Quantity::Time).is_some())
            .map(|(base, _)| base);
        let base = bases.next().unwrap_or(name);
        known(name).or_else(|| known(base)).or_else(|| is_clock(base).then_some(OTHER_TIMES.len()))
    };
    let free = (0..names.len()).filter(|&at| meanings[at] == Meaning::Other);
    let found = free.filter(|at| rank(at).is_some()).min_by_key(rank);
    found.into_iter().for_each(|at| meanings[at] = Meaning::Time(Scale::ONE));
}

/// Words for a time, and words that say which time it is.
const CLOCKS: [&str; 8] =
    ["time", "timestamp", "timestamps", "epoch", "clock", "stamp", "zeit", "zeitstempel"];
const WHICH: [&str; 27] = [
    "unix",
    "gps",
    "utc",
    "ros",
    "pc",
    "mcu",
    "cpu",
    "host",
    "board",
    "sensor",
    "robot",
    "device",
    "system",
    "sys",
    "sample",
    "log",
    "logger",
    "recording",
    "record",
    "since",
    "start",
    "from",
    "rel",
    "relative",
    "abs",
    "absolute",
    "elapsed",
];

/// Returns true for the name of a clock in several words: `time_unix`, `sensor timestamp`, `timeSinceStart`.
fn is_clock(name: &str) -> bool {
    let mut words: Vec<String> = vec![String::new()];
    let mut is_after_small = false;
    for c in name.chars() {
        if !c.is_alphabetic() || (is_after_small && c.is_uppercase()) {
            words.push(String::new());
        }
        is_after_small = c.is_lowercase();
        words.last_mut().into_iter().for_each(|word| word.extend(c.to_lowercase()));
    }
    let words = words.iter().map(|word| word.trim_matches(|c: char| !c.is_alphabetic()));
    let words: Vec<&str> = words.filter(|word| !word.is_empty()).collect();
    let is_time = |word: &&str| CLOCKS.contains(word);
    words.iter().any(is_time) && words.iter().all(|word| is_time(word) || WHICH.contains(word))
}

/// If several columns are the same axis and one has its usual name, drops the meaning of the others.
fn prefer_usual_names(names: &[String], meanings: &mut [Meaning]) {
    for axis in Axis::ALL {
        let is_usual = |at: usize| split_unit(&names[at]).0.eq_ignore_ascii_case(axis.name());
        let is_axis = |at: &usize| matches!(meanings[*at], Meaning::Load(of, _) if of == axis);
        let (usual, others): (Vec<usize>, Vec<usize>) =
            (0..names.len()).filter(is_axis).partition(|&at| is_usual(at));
        if !usual.is_empty() {
            others.into_iter().for_each(|at| meanings[at] = Meaning::Other);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::mapping::{MomentUnit, TimeUnit};
    use super::*;
    use shell_data::ColumnNames;

    fn names(line: &str) -> Vec<String> {
        line.split(',').map(str::to_owned).collect()
    }

    fn csv(line: &str) -> Result<(Vec<Column>, ColumnRoles), PlacedProblem> {
        recognise(names(line), &[], LogFormat::Csv, &Mapping::default())
    }

    fn missing(problem: PlacedProblem) -> Vec<String> {
        let PlacedProblem::MissingColumns { missing, .. } = problem else { panic!("{problem}") };
        missing
    }

    fn refs(line: &str) -> Vec<ColumnRef> {
        names(line).into_iter().map(ColumnRef::Name).collect()
    }

    #[test]
    fn sensors_count_from_zero_or_one_in_any_case() {
        for line in
            ["s0,s1,s2", "s1,s2,s3", "S1,S2,S3", " S1 , S2,S3", "sensor_1,sensor_2,sensor_3"]
        {
            assert_eq!(csv(line).unwrap().1.sensors, [0, 1, 2], "{line}");
        }
        assert_eq!(csv("S3,S1,S2").unwrap().1.sensors, [1, 2, 0]);
        assert_eq!(csv("time,AX").unwrap().1.sensors, [0; 0]);
    }

    #[test]
    fn usual_columns_are_taken_where_the_log_has_them_and_nothing_is_specified() {
        let usual = ColumnNames {
            sensors: Some(names("b,a")),
            wrench: Some(["u", "v", "w", "p", "q", "r"].map(|name| Some(name.to_owned()))),
            moment_unit: Some(MomentUnit::MillinewtonMetre),
            time: Some("clock".to_owned()),
            time_unit: Some(TimeUnit::Millisecond),
            group: Some("run".to_owned()),
            units: Vec::new(),
        };
        let mapping = Mapping { usual: Some(usual), ..Mapping::default() };
        let open = |line: &str, mapping: &Mapping| {
            recognise(names(line), &[], LogFormat::Csv, mapping).unwrap()
        };
        let (columns, roles) = open("clock,a,b,u,v,w,p,q,r,run", &mapping);
        assert_eq!(roles.sensors, [2, 1]);
        assert_eq!((roles.time, roles.group), (Some(0), Some(9)));
        assert_eq!(columns[0].meaning, Meaning::Time(Scale::per_si(1e3)));
        assert_eq!(columns[6].meaning.scale().per, 1e3);
        // The usual columns do not affect other logs, and the mapping takes precedence over them.
        let (columns, roles) = open("time,s1,s2,b,Fx,Fy,Fz,Mx,My,Mz", &mapping);
        assert_eq!((&*roles.sensors, roles.time), (&[1, 2][..], Some(0)));
        assert_eq!(columns[0].meaning, Meaning::Time(Scale::ONE));
        assert_eq!(columns[7].meaning.scale(), Scale::ONE);
        let mapping = Mapping { sensors: Some(refs("a")), ..mapping };
        assert_eq!(open("a,b", &mapping).1.sensors, [0]);
    }

    #[test]
    fn a_gap_in_the_sensors_is_named() {
        assert_eq!(missing(csv("s1,s2,s4").unwrap_err()), vec!["s3".to_owned()]);
        assert_eq!(missing(csv("s2").unwrap_err()), vec!["s1".to_owned()]);
    }

    #[test]
    fn units_of_time_and_wrench_are_read_from_the_names() {
        for (name, meaning) in [
            ("t", "time (s)"),
            ("Timestamp", "time (s)"),
            ("timestamps", "time (s)"),
            ("t_s", "time (s)"),
            ("time_us", "time (µs)"),
            ("time (µs)", "time (µs)"),
            ("Time [ms]", "time (ms)"),
            ("Time / min", "time (min)"),
            ("T (°C)", "nothing"),
            ("time_of_day", "nothing"),
            ("Fx", "Fx (N)"),
            ("fz_n", "Fz (N)"),
            ("Fy (mN)", "Fy (N, from mN)"),
            ("fz_lbf", "Fz (N, from lbf)"),
            ("Fz (lbf)", "Fz (N, from lbf)"),
            ("Fx in kN", "Fx (N, from kN)"),
            ("Fz-kgf", "Fz (N, from kgf)"),
            ("force.x.lb", "Fx (N, from lbf)"),
            ("mx_nm", "Mx (N·m)"),
            ("My (N·m)", "My (N·m)"),
            ("Mz_mNm", "Mz (N·m, from mN·m)"),
            ("Mz [N*mm]", "Mz (N·m, from N·mm)"),
            ("Mx [in-lb]", "Mx (N·m, from in·lbf)"),
            ("mx_lbf_in", "Mx (N·m, from lbf·in)"),
            ("ty_kgcm", "My (N·m, from kgf·cm)"),
            ("fx_raw", "nothing"),
            ("fx_min", "nothing"),
            ("fx_se_n", "nothing"),
            ("VBatt", "battery"),
            ("voltage", "nothing"),
        ] {
            let (columns, _) = csv(name).unwrap();
            let words = columns[0].in_words().unwrap_or_else(|| "nothing".to_owned());
            assert!(words.starts_with(meaning), "{name}: {words}");
        }
        let time = recognise(names("time"), &[], LogFormat::Telemetry, &Mapping::default());
        assert_eq!(time.unwrap().0[0].in_words().unwrap(), "time (µs)");
        for name in ["Fx (volts)", "Mx (N)", "mx_n", "fz_nm", "Mx (N/mm)", "Time (frames)"] {
            let unit = &csv(name).unwrap().0[0].unit;
            assert!(matches!(unit, StatedUnit::Unknown(_)), "{name}: {unit:?}");
        }
    }

    #[test]
    fn a_unit_counts_wherever_it_is_said() {
        let read = |line: &str, below: &str, mapping: &Mapping| {
            let units = names(below);
            recognise(names(line), &units, LogFormat::Csv, mapping).unwrap().0
        };
        let times = |columns: &[Column]| {
            columns.iter().map(|of| of.meaning.scale().to_si(1.0)).collect::<Vec<_>>()
        };
        let none = Mapping::default();
        assert_eq!(times(&read("Fx,Mx", "lbf,mm.N", &none)), [4.448_221_615_260_5, 1e-3]);
        // Contradictory units in the name and the row below are not accepted.
        assert_eq!(times(&read("fx_mn,Mx", "mN,", &none)), [1e-3, 1.0]);
        assert!(matches!(read("fx_n", "lbf", &none)[0].unit, StatedUnit::Unknown(_)));
        // The name of a mapped column may end with a unit after any separator.
        let six = "a (kN),b.N,c,d_nmm,e,f";
        let mapping = Mapping {
            wrench: Some([0, 1, 2, 3, 4, 5].map(|at| Some(ColumnRef::Position(at + 1)))),
            time: Some(ColumnRef::Name("board_us".to_owned())),
            ..Mapping::default()
        };
        let columns = read(&format!("{six},board_us"), ",,,,gf cm,", &mapping);
        assert_eq!(times(&columns), [1e3, 1.0, 1.0, 1e-3, 9.806_65e-5, 1.0, 1e-6]);
        // Options take precedence over the log, and the log over the calibration's units.
        let pair = |key: &str, unit: &str| (key.to_owned(), unit.to_owned());
        let units = vec![pair("force", "lbf"), pair("Fy", "N"), pair("mz_nm", "mNm")];
        let said = Mapping { units, ..Mapping::default() };
        let columns = read("Fx,fy_mn,mz_nm", "", &said);
        assert_eq!(times(&columns), [4.448_221_615_260_5, 1.0, 1e-3]);
        let usual_units = vec![pair("force", "kN")];
        let usual = Mapping { usual_units, ..Mapping::default() };
        assert_eq!(times(&read("Fx,fy_mn", "", &usual)), [1e3, 1e-3]);
        let missing_column = Mapping { units: vec![pair("Fq", "N")], ..Mapping::default() };
        let refused = recognise(names("Fx"), &[], LogFormat::Csv, &missing_column).unwrap_err();
        assert_eq!(missing(refused), ["Fq"]);
    }

    #[test]
    fn units_of_telemetry_are_read_where_others_are() {
        for (name, below, quantity, expected) in [
            ("RBEMF (mV)", "", Quantity::Voltage, Some("mV")),
            ("U_bat_mV", "mV", Quantity::Voltage, Some("mV")),
            ("DCR %", "", Quantity::Share, Some("%")),
            ("DCR", "1", Quantity::Share, Some("1")),
            ("duty_1", "", Quantity::Share, None),
            ("Right Leg Pos", "-", Quantity::Angle, None),
            ("hipDeg", "", Quantity::Angle, Some("°")),
        ] {
            let unit = stated_unit(name, &[below.to_owned()], 0, quantity);
            assert_eq!(unit.known().map(|unit| &*unit.symbol), expected, "{name}");
        }
        for (name, below) in [("I (mA)", "A"), ("I (V)", ""), ("I", "knots")] {
            let unit = stated_unit(name, &[below.to_owned()], 0, Quantity::Current);
            assert!(matches!(unit, StatedUnit::Unknown(_)), "{name}: {unit:?}");
        }
    }

    #[test]
    fn names_of_other_programs_are_known() {
        let line = "Time,F/T Sequence,Fx (N),Fy (N),Fz (N),Tx (N-m),Ty (N-m),Tz (N-m)";
        let six = |first: usize| -> Vec<Option<usize>> { (first..first + 6).map(Some).collect() };
        assert_eq!(csv(line).unwrap().1.wrench.to_vec(), six(2));
        for line in [
            "force_x,force_y,force_z,torque_x,torque_y,torque_z",
            "wrench.force.x,wrench.force.y,wrench.force.z,wrench.torque.x,wrench.torque.y,wrench.torque.z",
            "/wrench/force/x,/wrench/force/y,/wrench/force/z,/wrench/torque/x,/wrench/torque/y,/wrench/torque/z",
            "fx,fy,fz,tx,ty,tz",
            "Force X [N],Force Y [N],Force Z [N],Moment X [N·m],Moment Y [N·m],Moment Z [N·m]",
        ] {
            assert_eq!(csv(line).unwrap().1.wrench.to_vec(), six(0), "{line}");
        }
        for line in
            ["ch1,ch2,ch3", "adc0,adc1,adc2", "CH 1 (V),CH 2 (V),CH 3 (V)", "raw_0,raw_1,raw_2"]
        {
            assert_eq!(csv(line).unwrap().1.sensors, [0, 1, 2], "{line}");
        }
        // Usual names win, and a single column with another name is not enough.
        assert_eq!(csv("adc0,adc1,s1,s2").unwrap().1.sensors, [2, 3]);
        assert_eq!(csv("adc0,adc1,ch1,ch2").unwrap().1.sensors, [2, 3]);
        assert_eq!(csv("adc5,time").unwrap().1.sensors, [0; 0]);
        assert_eq!(csv("Tx,Mx").unwrap().1.wrench[3], Some(1));
        assert_eq!(csv("texture,fxx,forces,offset_x").unwrap().1.wrench, [None; 6]);
    }

    #[test]
    fn two_columns_for_one_thing_are_an_error() {
        let error = csv("time,s0,s1,S0").unwrap_err();
        assert_eq!(error.to_string(), "columns 2 (`s0`) and 4 (`S0`) are both sensor 1");
        assert!(csv("time,Timestamp").is_err());
        assert!(csv("AX,AX").is_ok(), "columns that nobody needs may repeat");
    }

    #[test]
    fn the_most_telling_group_column_wins() {
        assert_eq!(csv("trial,pose,x").unwrap().1.group, Some(1));
        assert_eq!(csv("trial,Group").unwrap().1.group, Some(1));
    }

    #[test]
    fn what_the_user_maps_replaces_what_was_recognised() {
        let mapping = Mapping {
            sensors: Some(refs("b,A")),
            time: Some(ColumnRef::Position(1)),
            time_unit: Some(TimeUnit::Millisecond),
            group: Some(ColumnRef::Name("run".to_owned())),
            ..Mapping::default()
        };
        let line = names("clock,time,s1,a,b,run,group");
        let (columns, roles) = recognise(line, &[], LogFormat::Csv, &mapping).unwrap();
        assert_eq!(roles.sensors, [4, 3]);
        assert_eq!(roles.time, Some(0));
        assert_eq!(roles.group, Some(5));
        assert_eq!(columns[0].meaning, Meaning::Time(Scale::per_si(1e3)));
        assert_eq!(columns[2].meaning, Meaning::Other);
    }

    #[test]
    fn any_column_can_name_the_groups_and_keeps_its_meaning() {
        for (name, meaning) in [
            ("Fz", Meaning::Load(Axis::Fz, Scale::ONE)),
            ("t", Meaning::Time(Scale::ONE)),
            ("s2", Meaning::Sensor(1)),
            ("run", Meaning::Group),
            ("pose", Meaning::Group),
        ] {
            let group = Some(ColumnRef::Name(name.to_owned()));
            let mapping = Mapping { group, ..Mapping::default() };
            let line = names("t,s1,s2,Fx,Fy,Fz,Mx,My,Mz,run,pose");
            let at = line.iter().position(|column| column == name).unwrap();
            let (columns, roles) = recognise(line, &[], LogFormat::Csv, &mapping).unwrap();
            assert_eq!(roles.group, Some(at), "{name}");
            assert_eq!(columns[at].meaning, meaning, "{name}");
            assert_eq!((roles.sensors.len(), roles.wrench[5]), (2, Some(8)), "{name}");
        }
    }

    #[test]
    fn a_mapped_column_that_is_not_there_is_named() {
        let mapping = Mapping { sensors: Some(refs("a,x,y")), ..Mapping::default() };
        let error = recognise(names("a,b"), &[], LogFormat::Csv, &mapping).unwrap_err();
        assert_eq!(missing(error), vec!["x".to_owned(), "y".to_owned()]);
        let mapping = Mapping { time: Some(ColumnRef::Position(3)), ..Mapping::default() };
        let error = recognise(names("a,b"), &[], LogFormat::Csv, &mapping).unwrap_err();
        assert_eq!(missing(error), vec!["column 3".to_owned()]);
        // The name of a matrix refers to all its columns, unless a column has that name.
        let mapping = Mapping { sensors: Some(refs("b,a")), ..Mapping::default() };
        assert_eq!(
            recognise(names("a1,a2,b,b1,a3"), &[], LogFormat::Csv, &mapping).unwrap().1.sensors,
            [2, 0, 1, 4]
        );
    }

    #[test]
    fn a_column_mapped_twice_is_an_error() {
        let mapping = Mapping { sensors: Some(refs("a,a")), ..Mapping::default() };
        assert!(recognise(names("a,b"), &[], LogFormat::Csv, &mapping).is_err());
    }

    #[test]
    fn the_user_decides_the_unit_of_moments() {
        let mapping =
            Mapping { moment_unit: Some(MomentUnit::MillinewtonMetre), ..Mapping::default() };
        let (columns, _) = recognise(names("Mx,my_nm,Fx"), &[], LogFormat::Csv, &mapping).unwrap();
        assert_eq!(columns[0].meaning, Meaning::Load(Axis::Mx, Scale::per_si(1e3)));
        assert_eq!(columns[1].meaning, Meaning::Load(Axis::My, Scale::per_si(1e3)));
        assert_eq!(columns[2].meaning, Meaning::Load(Axis::Fx, Scale::ONE));
    }

    fn found(matrices: &[(&str, usize)]) -> Option<(usize, String)> {
        let columns = matrices.iter().flat_map(|&(name, count)| match count {
            1 => vec![name.to_owned()],
            count => (1..=count).map(|column| format!("{name}{column}")).collect(),
        });
        let mapping = by_shape(&columns.collect::<Vec<_>>(), &Mapping::default());
        let wrench = mapping.wrench?[5].clone()?;
        Some((mapping.sensors?.len(), wrench.to_string()))
    }

    #[test]
    fn the_matrix_of_six_columns_is_the_wrench_where_there_is_one_other() {
        let expected = |channels| Some((channels, "ft6".to_owned()));
        assert_eq!(found(&[("cells", 12), ("ft", 6)]), expected(12));
        assert_eq!(found(&[("clock", 1), ("ft", 6), ("cells", 8)]), expected(8));
        assert_eq!(found(&[("cells", 6), ("ft", 6)]), None);
        assert_eq!(found(&[("cells", 12), ("ft", 6), ("joints", 7)]), None);
        assert_eq!(found(&[("ft", 6)]), None);
        // Known names take precedence over shapes.
        assert_eq!(found(&[("s", 12), ("joints", 6)]), None);
    }
}
