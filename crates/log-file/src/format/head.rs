//! Finds the first row of a text, and the lines above it that name the columns and units.
//!
//! Most of the first lines are rows: they have the same number of fields, mostly numbers in the same columns. The names
//! are in a line with as many texts above the first row, possibly after `#`, `%` or `//`; a line of units may follow.
//! Lines above them may contain keys and values ([`keys`](super::keys)).

use super::keys::Keys;
use super::lines::{LayoutLine, all_lines, fields, texts};
use super::mapping::{LogFormat, Mapping};
use super::meaning::{Meaning, StatedUnit, are_units, known_names, meaning_of};
use crate::error::FieldProblem;
use crate::parse::date::is_date;
use crate::parse::form::{
    RowBody, RowForm, behind_arrow, blank_fields, labelled, object, without_brackets,
};
use crate::parse::marks::is_marked_number;
use crate::parse::number::parse_field;

#[derive(Debug, Default)]
pub(crate) struct Head {
    pub(crate) separator: u8,
    pub(crate) form: RowForm,
    /// The line number of the names, and the names, if there are any.
    pub(crate) names: Option<(u64, Vec<String>)>,
    /// Line number and units below the names, if there are any.
    pub(crate) units: Option<(u64, Vec<String>)>,
    /// Position of the first row, and its line number.
    pub(crate) rows_start: usize,
    pub(crate) rows_line: u64,
    pub(crate) columns: usize,
    pub(crate) keys: Keys,
}

/// The largest number of lines between the names and the first row.
const ABOVE: usize = 4;

/// The largest number of lines that a board prints when it starts.
const STARTING: usize = 40;

/// Finds the first row and the names above it; `None` if no lines resemble each other.
pub(crate) fn find(
    head: &[u8],
    start: usize,
    comma: Option<u8>,
    mapping: &Mapping,
) -> Option<Head> {
    let skipped = mapping.skip_lines.unwrap_or(0);
    let mut lines: Vec<LayoutLine<'_>> =
        all_lines(head, start, 1).filter(|line| line.number > skipped).collect();
    let declared = lines.first().and_then(|line| declared_separator(line.text));
    if declared.is_some() {
        lines.remove(0);
    }
    let declared = declared.or(comma);
    let bodies: Vec<Option<(&str, &str)>> = lines
        .iter()
        .map(|line| str::from_utf8(line.text).ok().and_then(behind_arrow))
        .map(|parts| parts.filter(|(time, _)| is_numeric(time.trim().as_bytes())))
        .collect();
    let has_arrow = 2 * bodies.iter().flatten().count() > lines.len();
    let texts: Vec<&[u8]> = lines
        .iter()
        .zip(&bodies)
        .map(|(line, body)| {
            body.filter(|_| has_arrow).map_or(line.text, |(_, rest)| rest.as_bytes())
        })
        .collect();
    let in_brackets = |text: &&[u8]| {
        text.trim_ascii_end().ends_with(b")") || text.trim_ascii_end().ends_with(b"]")
    };
    let has_brackets = 2 * texts.iter().filter(|text| in_brackets(text)).count() > texts.len();
    let bare: Vec<String> = match has_brackets {
        true => texts.iter().map(|text| without_brackets(&String::from_utf8_lossy(text))).collect(),
        false => Vec::new(),
    };
    let of_fields = || match has_brackets {
        true => {
            let bare: Vec<&[u8]> = bare.iter().map(String::as_bytes).collect();
            let mut found = of_fields(&lines, &bare, declared, comma.is_some(), mapping)?;
            found.form.has_brackets = true;
            Some(found)
        }
        false => of_fields(&lines, &texts, declared, comma.is_some(), mapping),
    };
    let mut found = of_labview(&lines)
        .or_else(|| of_objects(&lines, &texts))
        .or_else(|| of_labels(&lines, &texts))
        .or_else(of_fields)?;
    if has_arrow {
        found.form.has_arrow = true;
        found.separator = found.form.separator(found.separator);
        let columns = found.columns;
        let names = found.names.map_or_else(|| numbered(2, columns), |(_, names)| names);
        let names = std::iter::once("time".to_owned()).chain(names).collect();
        found.names = Some((found.rows_line, names));
        found.columns += 1;
    }
    Some(found)
}

pub(super) fn is_of_other_form(text: &[u8]) -> bool {
    let of_text =
        |text| behind_arrow(text).is_some() || labelled(text).is_some() || object(text).is_some();
    str::from_utf8(text).is_ok_and(of_text)
}

/// Names columns without a name: `column 2` and so on.
pub(crate) fn numbered(first: usize, count: usize) -> Vec<String> {
    (first..first + count).map(|number| format!("column {number}")).collect()
}

/// Parses a separator declared as spreadsheets do: `sep=;`.
fn declared_separator(line: &[u8]) -> Option<u8> {
    let line = line.trim_ascii().trim_ascii_start();
    let line = line.strip_prefix(b"\"").and_then(|it| it.strip_suffix(b"\"")).unwrap_or(line);
    match line.strip_prefix(b"sep=").or_else(|| line.strip_prefix(b"SEP=")) {
        Some([separator]) => Some(*separator),
        Some([]) => Some(b'\t'),
        _ => None,
    }
}

/// The line that ends each of the two headers of a LabVIEW measurement file.
const END_OF_HEADER: &[u8] = b"***End_of_Header***";

/// Recognises a LabVIEW measurement file, whose second header describes the columns.
fn of_labview(lines: &[LayoutLine<'_>]) -> Option<Head> {
    if !lines.first()?.text.starts_with(b"LabVIEW Measurement") {
        return None;
    }
    let end = lines.iter().take(STARTING).rposition(|line| line.text.starts_with(END_OF_HEADER))?;
    let (names, first) = (lines.get(end + 1)?, lines.get(end + 2)?);
    let is_comma = |line: &LayoutLine<'_>| line.text.starts_with(b"Separator,");
    let separator = if lines[..end].iter().any(is_comma) { b',' } else { b'\t' };
    let fields = |line: &LayoutLine<'_>| to_names(&split(line.text, separator));
    let mut names = (names.number, fields(names));
    // The names end with a comment column, which rows have only if there is a comment.
    let columns = split(first.text, separator).len();
    names.1.resize(columns, String::new());
    let units = lines[..end].iter().find(|line| line.text.starts_with(b"Y_Unit_Label"));
    let units = units.map(|line| {
        let mut units = fields(line);
        // The first field is the key, not a unit; below it are the times.
        units[0].clear();
        (line.number, units)
    });
    let lines_of_keys = lines[..end].iter().map(|line| (line.number, line.text));
    Some(Head {
        separator,
        names: Some(names),
        units,
        rows_start: first.start,
        rows_line: first.number,
        columns,
        keys: Keys { is_labview: true, ..Keys::new(lines_of_keys) },
        ..Head::default()
    })
}

fn of_objects(lines: &[LayoutLine<'_>], texts: &[&[u8]]) -> Option<Head> {
    let fields = |text: &&[u8]| str::from_utf8(text).ok().and_then(object);
    let first =
        texts.iter().take(ABOVE).position(|text| text.trim_ascii_start().starts_with(b"{"))?;
    let names = |at: usize| -> Option<Vec<String>> {
        Some(fields(texts.get(at)?)?.into_iter().map(|(name, _)| name).collect())
    };
    // JSON objects above the first row have other names, and describe the log.
    let is_row = |at: &usize| names(*at).is_some_and(|of| names(*at + 1).as_ref() == Some(&of));
    let at = (first..texts.len().min(STARTING)).find(is_row).unwrap_or(first);
    let names = names(at)?;
    let mut keys = Keys::default();
    for (line, text) in lines[first..at].iter().zip(&texts[first..at]) {
        let pairs = fields(text).into_iter().flatten();
        pairs.for_each(|(key, value)| keys.read(&key, &value, line.number));
    }
    Some(Head { keys, ..of_form(RowBody::Json(names.clone()), names, lines[at]) })
}

fn of_labels(lines: &[LayoutLine<'_>], texts: &[&[u8]]) -> Option<Head> {
    let labels = |text: &[u8]| -> Option<Vec<String>> {
        let pairs = labelled(str::from_utf8(text).ok()?)?;
        Some(pairs.into_iter().map(|(label, _)| label).collect())
    };
    // A board may print a few lines when it starts.
    let at = (0..texts.len().min(STARTING)).find(|&at| {
        let rows = texts[at..].iter().take(3);
        rows.len() > 1
            && rows.map(|text| labels(text)).all(|of| of.is_some() && of == labels(texts[at]))
    })?;
    let names = labels(texts[at])?;
    Some(of_form(RowBody::Labels(names.clone()), names, lines[at]))
}

fn of_form(body: RowBody, names: Vec<String>, first: LayoutLine<'_>) -> Head {
    Head {
        separator: b'\t',
        form: RowForm { body, ..RowForm::default() },
        columns: names.len(),
        names: Some((first.number, names)),
        rows_start: first.start,
        rows_line: first.number,
        ..Head::default()
    }
}

/// A line's separator, number of fields, and numeric fields.
#[derive(Debug, Default)]
struct Shape {
    separator: u8,
    numbers: Vec<bool>,
    /// True if at least half of the non-empty fields are numbers.
    is_row: bool,
}

/// A blank as the separator; it stands for any number of blanks.
const BLANK: u8 = b' ';

impl Shape {
    fn new(text: &[u8], declared: Option<u8>) -> Self {
        let separator = declared.unwrap_or_else(|| line_separator(text));
        let fields = split(text, separator);
        let numbers: Vec<bool> = fields.iter().map(|field| is_numeric(field)).collect();
        let empty = fields.iter().filter(|field| field.trim_ascii().is_empty()).count();
        let count = numbers.iter().filter(|is| **is).count();
        let is_row = count > 0 && 2 * count >= numbers.len() - empty;
        Self { separator, numbers, is_row }
    }

    fn key(&self) -> (u8, usize) {
        (self.separator, self.numbers.len())
    }
}

/// Recognises separated values below other lines. A line of a sheet ends with its last non-empty cell, which may lie
/// beside the table.
fn of_fields(
    lines: &[LayoutLine<'_>],
    texts: &[&[u8]],
    declared: Option<u8>,
    is_sheet: bool,
    mapping: &Mapping,
) -> Option<Head> {
    let mut shapes: Vec<Shape> = texts.iter().map(|text| Shape::new(text, declared)).collect();
    if is_sheet {
        let rows = shapes.iter().filter(|shape| shape.is_row);
        let width = rows.map(|shape| shape.numbers.len()).max().unwrap_or(0);
        shapes.iter_mut().for_each(|shape| shape.numbers.resize(width, false));
    }
    let is_row = |at: usize| shapes[at].is_row && uncommented(texts[at]).is_none();
    let first = match mapping.header_line {
        Some(number) => {
            let names = lines.iter().position(|line| line.number >= number)?;
            (names + 1..lines.len()).find(|&at| is_row(at))?
        }
        None => first_row(&shapes, is_row)?,
    };
    let shape = &shapes[first];
    let (separator, columns) = shape.key();
    let above = (0..first).rev().take(ABOVE);
    // Some boards write a separator behind the last value.
    let ends_empty =
        split(texts[first], separator).last().is_some_and(|it| it.trim_ascii().is_empty());
    let has_row_names = has_row_names(&texts[first..], separator);
    let of_names = |at: usize| {
        name_fields(bare(texts[at]), separator).into_iter().find_map(|names| {
            let named = names.iter().filter(|name| !name.trim_ascii().is_empty()).count();
            let is_text = !names.iter().any(|name| is_numeric(name));
            let mut names = to_names(&names);
            if names.len() + 1 == columns && ends_empty {
                names.push(String::new());
            } else if names.len() + 1 == columns && has_row_names {
                names.insert(0, String::new());
            }
            let is_beside = is_sheet && names.len() < columns;
            let is_table = is_beside && named > 1 && (known_names(&names) > 0 || are_units(&names));
            // The last columns of a sheet may be empty at first.
            let is_above = is_sheet && names.len() > columns && named == names.len();
            let is_whole = is_above || names.len() == columns && 2 * named >= columns;
            ((is_whole || is_table) && is_text).then_some((at, names))
        })
    };
    let candidates: Vec<(usize, Vec<String>)> = match mapping.header_line {
        Some(number) => {
            above.take_while(|&at| lines[at].number >= number).filter_map(of_names).collect()
        }
        None => above.filter_map(of_names).collect(),
    };
    let candidates: Vec<(usize, Vec<String>)> = candidates
        .into_iter()
        .map(|(at, names)| {
            let above = at.checked_sub(1).map(|at| to_names(&split(bare(texts[at]), separator)));
            let grouped = above.and_then(|above| with_groups(&above, &names));
            (at, grouped.unwrap_or(names))
        })
        .collect();
    let names = match (mapping.header_line, candidates.as_slice()) {
        (_, []) => None,
        (Some(_), [.., last]) => Some(last),
        (None, [first, second, ..]) if are_units(&first.1) => Some(second),
        (None, all) => all.iter().rev().max_by_key(|(_, names)| known_names(names)),
    };
    let number = |at: usize| lines[at].number;
    let units = names.and_then(|(names, _)| {
        let is_above = |(at, texts): &&(usize, Vec<String>)| at + 1 == *names && are_units(texts);
        let below = candidates.first().filter(|(at, _)| at > names);
        below.or_else(|| candidates.iter().find(is_above))
    });
    let keys_end = names.map_or(first, |(at, _)| *at);
    let body = if separator == BLANK { RowBody::Blanks } else { RowBody::Separated };
    let form = RowForm { body, ..RowForm::default() };
    // Lines between the names and the first valid row are invalid rows.
    let last_named = units.into_iter().chain(names).map(|(at, _)| *at).max();
    let is_text = |at: &usize| uncommented(texts[*at]).is_none();
    let first = last_named.and_then(|at| (at + 1..=first).find(is_text)).unwrap_or(first);
    Some(Head {
        separator: form.separator(separator),
        form,
        names: names.map(|(at, names)| (number(*at), names.clone())),
        units: units.map(|(at, units)| (number(*at), units.clone())),
        rows_start: lines[first].start,
        rows_line: number(first),
        columns: names.map_or(columns, |(_, names)| names.len()),
        keys: Keys::new(lines[..keys_end].iter().map(|line| (line.number, bare(line.text)))),
    })
}

/// Adds the names and units of groups of columns, as in the merged cells above others: `Force (mN),,` over `x,y,z`.
/// `None` if the line above holds no such names.
pub(super) fn with_groups(above: &[String], names: &[String]) -> Option<Vec<String>> {
    let has_gaps = above.len() < names.len() || above.iter().any(String::is_empty);
    let is_text = !above.iter().any(|name| is_numeric(name.as_bytes()));
    if above.len() > names.len() || !has_gaps || !is_text || are_units(names) {
        return None;
    }
    let is_load = |name: &str| matches!(meaning_of(name, LogFormat::Csv).0, Meaning::Load(..));
    // The line of dashes in a Markdown table has no names.
    let is_word = |name: &str| name.contains(char::is_alphanumeric);
    let mut group = "";
    let of_column = |(at, name): (usize, &String)| {
        group = above.get(at).filter(|name| !name.is_empty()).map_or(group, String::as_str);
        let cut = group.find(['(', '[']).unwrap_or(group.len());
        let (base, unit) = (group[..cut].trim(), &group[cut..]);
        let has_unit = meaning_of(name, LogFormat::Csv).1 != StatedUnit::None;
        match () {
            () if name.is_empty() => above.get(at).cloned().unwrap_or_default(),
            () if is_load(name) && !has_unit && is_load(&format!("{name} {unit}")) => {
                format!("{name} {unit}").trim_end().to_owned()
            }
            () if !is_load(name)
                && is_word(name)
                && !base.is_empty()
                && is_load(&format!("{base} {name}")) =>
            {
                format!("{base} {name} {unit}").trim_end().to_owned()
            }
            () => name.clone(),
        }
    };
    let grouped: Vec<String> = names.iter().enumerate().map(of_column).collect();
    let loads = |names: &[String]| names.iter().filter(|name| is_load(name)).count();
    let is_changed = |(made, name): (&String, &String)| !name.is_empty() && made != name;
    let is_grouped = grouped.iter().zip(names).any(is_changed);
    (loads(&grouped) > 0 && is_grouped).then_some(grouped)
}

/// Returns the first line that resembles most rows: it has as many fields, and numbers in most of the numeric columns.
fn first_row(shapes: &[Shape], is_row: impl Fn(usize) -> bool) -> Option<usize> {
    let rows: Vec<usize> = (0..shapes.len()).filter(|&at| is_row(at)).collect();
    let weight =
        |key: (u8, usize)| rows.iter().filter(|&&at| shapes[at].key() == key).count() * key.1;
    let keys = rows.iter().map(|&at| shapes[at].key());
    // `max_by_key` returns the last maximum, so the reversed order selects the first.
    let key = keys.rev().max_by_key(|&key| weight(key))?;
    let like: Vec<&Shape> =
        rows.iter().map(|&at| &shapes[at]).filter(|shape| shape.key() == key).collect();
    // Lines above the rows may resemble rows, but those in the second half are real rows.
    let like = &like[like.len() / 2..];
    let usual: Vec<usize> = (0..key.1)
        .filter(|&column| {
            2 * like.iter().filter(|shape| shape.numbers[column]).count() > like.len()
        })
        .collect();
    rows.into_iter().find(|&at| {
        let shape = &shapes[at];
        let fits = |column: &&usize| shape.numbers.get(**column).is_some_and(|is| *is);
        let begins = usual.first() != Some(&0) || shape.numbers[0];
        shape.key() == key && begins && 5 * usual.iter().filter(fits).count() >= 3 * usual.len()
    })
}

/// Returns a line without its comment mark; `None` if it has none.
fn uncommented(text: &[u8]) -> Option<&[u8]> {
    let text = text.trim_ascii_start();
    let rest = text.strip_prefix(b"//").or_else(|| {
        let rest = text.strip_prefix(b"#").or_else(|| text.strip_prefix(b"%"))?;
        Some(rest.trim_ascii_start())
    })?;
    Some(rest.strip_prefix(b" ").unwrap_or(rest))
}

/// Returns true for units, where `1` means a quantity without a unit. A label beside ones, as in `a,1`, is no unit.
pub(super) fn are_units_or_ones(names: &[String]) -> bool {
    let is_one = |name: &&String| ["1", "nan"].contains(&name.trim().to_lowercase().as_str());
    let units: Vec<String> = names.iter().filter(|name| !is_one(name)).cloned().collect();
    units.iter().filter(|unit| !unit.is_empty()).count() > 2 && are_units(&units)
}

/// Returns a line without its comment mark, if it has one.
pub(super) fn bare(text: &[u8]) -> &[u8] {
    uncommented(text).unwrap_or(text)
}

/// Splits a line of names at the separator of the rows. If this is a blank, also splits it in other ways: at other
/// separators, at two or more blanks, or at blanks that do not precede a bracket.
fn name_fields(text: &[u8], separator: u8) -> Vec<Vec<Vec<u8>>> {
    let mut ways = vec![split(text, separator)];
    if separator != BLANK {
        return ways;
    }
    ways.push(fields(text, line_separator(text)));
    let mut joined: Vec<Vec<u8>> = Vec::new();
    for part in &ways[0] {
        match joined.last_mut() {
            Some(name) if part.starts_with(b"(") || part.starts_with(b"[") => {
                name.push(b' ');
                name.extend_from_slice(part);
            }
            _ => joined.push(part.clone()),
        }
    }
    ways.push(joined);
    if let Ok(text) = str::from_utf8(text) {
        let wide = text.replace('\t', "  ");
        let wide = wide.split("  ").map(str::trim).filter(|part| !part.is_empty());
        ways.push(wide.map(|part| part.as_bytes().to_vec()).collect());
    }
    ways
}

/// Returns true if the first column has row names, for which R writes no column name. They are numbers from one, or
/// quoted texts before unquoted numbers.
fn has_row_names(rows: &[&[u8]], separator: u8) -> bool {
    let is_name = |(number, row): (usize, &&[u8])| {
        let bare = row.trim_ascii_start();
        match bare.strip_prefix(b"\"") {
            Some(quoted) => {
                let end = quoted.iter().position(|&byte| byte == b'"').unwrap_or(0);
                quoted.get(end + 2).is_some_and(|&byte| byte != b'"')
            }
            None => {
                let first = split(bare, separator).into_iter().next().unwrap_or_default();
                separator == BLANK && first == number.to_string().as_bytes()
            }
        }
    };
    rows.len() > 2 && (1..).zip(rows.iter().take(3)).all(is_name)
}

fn to_names(fields: &[Vec<u8>]) -> Vec<String> {
    texts(fields)
}

fn split(text: &[u8], separator: u8) -> Vec<Vec<u8>> {
    match separator {
        BLANK if text.contains(&b'"') => {
            let text = String::from_utf8_lossy(text);
            blank_fields(&text).map(|part| part.replace('"', "").into_bytes()).collect()
        }
        BLANK => {
            let parts = text.split(u8::is_ascii_whitespace).filter(|part| !part.is_empty());
            parts.map(|part| part.trim_ascii().to_vec()).collect()
        }
        _ => fields(text, separator),
    }
}

/// Returns true if a field is a number, a date or a time of day.
pub(super) fn is_numeric(field: &[u8]) -> bool {
    let is_not_finite = matches!(parse_field(field), Err(FieldProblem::NotFinite));
    is_not_finite || is_marked_number(field) || is_date(field)
}

/// Returns the most frequent separator of a line outside quotes. Without any, returns a blank for a line of numbers,
/// else a comma.
pub(crate) fn line_separator(line: &[u8]) -> u8 {
    let candidates = *b",;\t|";
    let mut counts = [0_usize; 4];
    let mut quoted = false;
    for byte in line {
        quoted ^= *byte == b'"';
        if let Some(i) = candidates.iter().position(|c| c == byte).filter(|_| !quoted) {
            counts[i] += 1;
        }
    }
    // If there is another separator, the commas may be decimal marks.
    let other = (1..4).filter(|&i| counts[i] > 0).max_by_key(|&i| (counts[i], 4 - i));
    match other {
        Some(i) if counts[0] <= counts[i] + 1 => return candidates[i],
        Some(_) => return b',',
        None => {}
    }
    let parts = split(line, BLANK);
    if parts.iter().any(|part| part == b",") {
        return b',';
    }
    let are_numbers = parts.iter().filter(|part| is_numeric(part)).count();
    match parts.len() > 1 && parts.len() + 1 > counts[0] && 2 * are_numbers > parts.len() {
        true => BLANK,
        false => b',',
    }
}
