//! Excel workbooks (Office Open XML, ECMA-376): the cells of one sheet, streamed.
//!
//! Rows keep their numbers in the sheet. Formulas yield their stored values; dates are in ISO 8601.

use std::collections::HashMap;
use std::io::Read;
use std::sync::Arc;

use crate::budget;
use crate::format::{Cell, FileSource, FoundTable};
use crate::kind::{FileKind, TableError};
use crate::sheet::{LAST_ROW, NumberedRows, Sheet, choose};
use crate::xml::{LONGEST, Xml, XmlTag};
use crate::zip::{ZipEntry, entries};

const KIND: FileKind = FileKind::Xlsx;

#[derive(Debug)]
struct XlsxSheet {
    file: FileSource,
    entry: ZipEntry,
    texts: Arc<[String]>,
    styles: HashMap<usize, TimeStyle>,
    /// True if days count from 1904, not 1900.
    since_1904: bool,
}

/// Calls `take` with every tag of an archived file.
fn each(
    file: &FileSource,
    entry: &ZipEntry,
    mut take: impl FnMut(XmlTag) -> Result<(), TableError>,
) -> Result<(), TableError> {
    let wrong = |what: String| KIND.damaged(format!("`{}`: {what}", entry.name));
    let mut xml = Xml::new(entry.open(KIND, file)?);
    while let Some(tag) = xml.next().map_err(wrong)? {
        take(tag)?;
    }
    Ok(())
}

pub(crate) fn open(file: &FileSource, part: Option<&str>) -> Result<FoundTable, TableError> {
    let files = entries(KIND, file)?;
    let find = |name: &str| {
        let name = name.trim_start_matches('/');
        files.iter().find(|file| file.name.eq_ignore_ascii_case(name))
    };
    let workbook =
        find("xl/workbook.xml").ok_or_else(|| KIND.damaged("it has no `xl/workbook.xml`"))?;
    let mut sheets: Vec<(String, String)> = Vec::new();
    let mut since_1904 = false;
    each(file, workbook, |tag| {
        let is_true = |value: String| value == "1" || value == "true";
        match tag.name.as_str() {
            "sheet" => sheets.extend(tag.attribute("name").zip(tag.attribute("id"))),
            "workbookPr" if tag.is_start => {
                since_1904 = tag.attribute("date1904").is_some_and(is_true);
            }
            _ => {}
        }
        budget::check_columns(KIND, sheets.len())
    })?;
    let mut targets = HashMap::new();
    if let Some(relations) = find("xl/_rels/workbook.xml.rels") {
        each(file, relations, |tag| {
            targets.extend(tag.attribute("Id").zip(tag.attribute("Target")));
            budget::check_columns(KIND, targets.len())
        })?;
    }
    let texts = find("xl/sharedStrings.xml").map(|texts| shared_texts(file, texts)).transpose()?;
    let styles = find("xl/styles.xml").map(|styles| time_styles(file, styles)).transpose()?;
    let texts: Arc<[String]> = texts.unwrap_or_default().into();
    let styles = styles.unwrap_or_default();
    let sheet = |at: usize| {
        let target = targets.get(&sheets[at].1);
        let nowhere = || KIND.damaged(format!("its sheet `{}` is nowhere", sheets[at].1));
        let target = target.ok_or_else(nowhere)?;
        let path = if target.starts_with('/') { target.clone() } else { format!("xl/{target}") };
        let entry = find(&path).ok_or_else(|| KIND.damaged(format!("it has no `{path}`")))?.clone();
        let (file, texts, styles) = (file.clone(), Arc::clone(&texts), styles.clone());
        Ok(XlsxSheet { file, entry, texts, styles, since_1904 })
    };
    choose(KIND, sheets.iter().map(|(name, _)| name.clone()).collect(), part, sheet)
}

fn shared_texts(file: &FileSource, entry: &ZipEntry) -> Result<Vec<String>, TableError> {
    let mut texts = Vec::new();
    let (mut text, mut is_phonetic, mut bytes) = (String::new(), false, 0);
    each(file, entry, |tag| {
        match tag.name.as_str() {
            "t" if !tag.is_start && !is_phonetic => text.push_str(&tag.text),
            "rPh" => is_phonetic = !tag.is_end,
            "si" if tag.is_end => {
                bytes += (text.len() + size_of::<String>()) as u64;
                texts.push(std::mem::take(&mut text));
            }
            _ => {}
        }
        let bytes = bytes + text.len() as u64;
        budget::check(KIND, "its texts", bytes, entry.packed).map(drop)
    })?;
    Ok(texts)
}

/// The way a style displays days.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum TimeStyle {
    /// A date, with or without a time.
    Date,
    /// A time of day, or an elapsed time of less than a day.
    Clock,
    /// An elapsed time of any length.
    Elapsed,
}

fn time_styles(
    file: &FileSource,
    entry: &ZipEntry,
) -> Result<HashMap<usize, TimeStyle>, TableError> {
    let (mut formats, mut styles) = (HashMap::new(), HashMap::new());
    let (mut in_cells, mut style) = (false, 0);
    each(file, entry, |tag| {
        match tag.name.as_str() {
            "numFmt" => {
                let code = tag.attribute("formatCode").unwrap_or_default();
                formats.extend(tag.attribute("numFmtId").zip(time_style(&code)));
            }
            "cellXfs" => in_cells = !tag.is_end,
            "xf" if in_cells && tag.is_start => {
                let format = tag.attribute("numFmtId").unwrap_or_default();
                let known = match format.parse() {
                    Ok(14..=17 | 22) => Some(TimeStyle::Date),
                    Ok(18..=21 | 45 | 47) => Some(TimeStyle::Clock),
                    Ok(46) => Some(TimeStyle::Elapsed),
                    _ => formats.get(&format).copied(),
                };
                styles.extend(known.map(|known| (style, known)));
                style += 1;
            }
            _ => {}
        }
        budget::check(KIND, "its styles", 64 * style as u64, entry.packed).map(drop)
    })?;
    Ok(styles)
}

/// Determines how a number format displays days; `None` if it does not display a date or time. Quoted letters have no
/// meaning, and brackets enclose hours, minutes or seconds that may exceed a day, an hour or a minute.
fn time_style(code: &str) -> Option<TimeStyle> {
    let (mut quoted, mut bracket, mut escaped) = (false, None, false);
    let mut letters = String::new();
    for c in code.to_ascii_lowercase().chars() {
        match (c, &mut bracket) {
            _ if std::mem::take(&mut escaped) => {}
            ('"', None) => quoted = !quoted,
            _ if quoted => {}
            ('\\', None) => escaped = true,
            ('[', None) => bracket = Some(String::new()),
            (']', Some(inner)) => {
                let is_time =
                    !inner.is_empty() && inner.chars().all(|c| matches!(c, 'h' | 'm' | 's'));
                if is_time {
                    return Some(TimeStyle::Elapsed);
                }
                bracket = None;
            }
            (c, Some(inner)) => inner.push(c),
            (c, None) => letters.push(c),
        }
    }
    let has = |wanted: &[char]| letters.contains(wanted);
    match letters.as_str() {
        "general" => None,
        _ if has(&['y', 'd']) => Some(TimeStyle::Date),
        _ if has(&['h', 'm', 's']) => Some(TimeStyle::Clock),
        _ => None,
    }
}

impl Sheet for XlsxSheet {
    fn numbered(self: Arc<Self>) -> Result<NumberedRows, TableError> {
        let mut xml = Xml::new(self.entry.open(KIND, &self.file)?);
        let mut before = 0;
        Ok(Box::new(move || {
            let next = self.next_row(&mut xml, before)?;
            before = next.as_ref().map_or(before, |(row, _)| *row);
            Ok(next)
        }))
    }
}

impl XlsxSheet {
    /// Reads the next row in the file, which follows row number `before`; returns it with its number.
    fn next_row(
        &self,
        xml: &mut Xml<impl Read>,
        before: u64,
    ) -> Result<Option<(u64, Vec<Cell>)>, TableError> {
        let wrong = |what: String| KIND.damaged(format!("`{}`: {what}", self.entry.name));
        let mut number = before + 1;
        let mut cells: Vec<Cell> = Vec::new();
        let mut cell: Option<OpenCell> = None;
        while let Some(tag) = xml.next().map_err(wrong)? {
            match tag.name.as_str() {
                "row" if tag.is_start => {
                    if let Some(given) = tag.attribute("r") {
                        let given =
                            given.parse().ok().filter(|row| (number..=LAST_ROW).contains(row));
                        let unnumbered = || format!("a row after row {before} has no number");
                        number = given.ok_or_else(|| wrong(unnumbered()))?;
                    }
                }
                "c" if tag.is_start => {
                    let misplaced = || format!("a cell of row {number} has no place");
                    let opened = OpenCell::new(&tag, cells.len());
                    cell = Some(opened.ok_or_else(|| wrong(misplaced()))?);
                }
                "v" | "t" if !tag.is_start => {
                    if let Some(cell) = &mut cell {
                        cell.text.push_str(&tag.text);
                        if cell.text.len() > LONGEST {
                            return Err(wrong(format!("a cell of row {number} is too long")));
                        }
                    }
                }
                _ => {}
            }
            match tag.name.as_str() {
                "c" if tag.is_end => {
                    if let Some(cell) = cell.take() {
                        let position = cell.column;
                        let value = cell.value(self).map_err(|what| {
                            wrong(format!("row {number}, column {}: {what}", position + 1))
                        })?;
                        cells.resize(cells.len().max(position), Cell::Missing);
                        cells.push(value);
                    }
                }
                "row" if tag.is_end => return Ok(Some((number, cells))),
                "sheetData" if tag.is_end => break,
                _ => {}
            }
        }
        Ok(None)
    }
}

struct OpenCell {
    column: usize,
    kind: String,
    style: usize,
    text: String,
}

impl OpenCell {
    /// Returns `None` if the cell precedes the column `next`, or is too far to the right.
    fn new(tag: &XmlTag, next: usize) -> Option<Self> {
        let column = match tag.attribute("r") {
            None => next,
            Some(position) => {
                let letters = position.bytes().take_while(u8::is_ascii_alphabetic);
                let column = letters.take(4).fold(0_usize, |column, letter| {
                    26 * column + usize::from(letter.to_ascii_uppercase() - b'A') + 1
                });
                column.checked_sub(1)?
            }
        };
        let is_right = (next..budget::COLUMNS).contains(&column);
        is_right.then(|| Self {
            column,
            kind: tag.attribute("t").unwrap_or_default(),
            style: tag.attribute("s").and_then(|style| style.parse().ok()).unwrap_or(0),
            text: String::new(),
        })
    }

    fn value(self, sheet: &XlsxSheet) -> Result<Cell, String> {
        let number =
            || self.text.trim().parse::<f64>().map_err(|_| format!("no number: `{}`", self.text));
        Ok(match self.kind.as_str() {
            "s" => {
                let text = self.text.trim().parse().ok().and_then(|at: usize| sheet.texts.get(at));
                Cell::Text(text.ok_or("it refers to no text")?.clone())
            }
            // The cell holds a text, an error of a formula such as #DIV/0!, or a date as text.
            "str" | "inlineStr" | "e" | "d" => Cell::Text(self.text),
            "b" => Cell::Whole(i64::from(self.text.trim() == "1")),
            _ if self.text.trim().is_empty() => Cell::Missing,
            _ => match (sheet.styles.get(&self.style), number()?) {
                (None, number) => Cell::Real(number),
                (Some(TimeStyle::Elapsed), days) => elapsed(days),
                (Some(TimeStyle::Clock), days) if days.abs() < FIRST_DATE => elapsed(days),
                (Some(_), days) => date(days, sheet.since_1904),
            },
        })
    }
}

/// A number of days below this is an elapsed time, not the date of a measurement.
const FIRST_DATE: f64 = 366.0;

/// Converts an elapsed time to seconds, rounded to the microsecond.
fn elapsed(days: f64) -> Cell {
    Cell::Elapsed((days * 86_400e6).round() / 1e6)
}

/// Converts days to a date or time, rounded to the microsecond, about the precision of such numbers.
fn date(days: f64, since_1904: bool) -> Cell {
    // Excel treats 1900 as a leap year.
    let days_to_1970 = if since_1904 { 24_107.0 } else { 25_569.0 };
    let microseconds = ((days - days_to_1970) * 86_400e6).round();
    Cell::Time { units: microseconds as i64, per_second: 1_000_000 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_of_dates_are_known() {
        use TimeStyle::{Clock, Date, Elapsed};
        for (code, expected) in [
            ("yyyy-mm-dd", Some(Date)),
            ("[h]:mm:ss", Some(Elapsed)),
            ("[hh]:mm:ss.000", Some(Elapsed)),
            ("[$-409]h:mm:ss AM/PM", Some(Clock)),
            ("mm:ss.0", Some(Clock)),
            ("0.00", None),
            ("General", None),
            ("0.0\"mm\"", None),
            ("#,##0.00 \\d", None),
            ("[Red]0", None),
        ] {
            assert_eq!(time_style(code), expected, "{code}");
        }
        // The number of days for the same date, 2026-11-22 12:00, in both systems.
        assert_eq!(date(46_348.5, false).text(), "2026-11-22T12:00:00");
        assert_eq!(date(44_886.5, true).text(), "2026-11-22T12:00:00");
    }
}
