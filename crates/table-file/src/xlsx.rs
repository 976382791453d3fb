//! Workbooks of Excel (Office Open XML, ECMA-376): the cells of one sheet, streamed.
//!
//! Rows keep the numbers that the sheet shows. Formulas give the values that were stored with them,
//! dates are given in ISO 8601.

use std::collections::HashSet;
use std::io::Read;
use std::ops::Range;
use std::sync::Arc;

use crate::budget::{self, Unpacked};
use crate::calendar::iso_of;
use crate::format::{Cell, FileSource, NamedRows, RowSource, RowStream};
use crate::kind::{FileKind, TableError};
use crate::xml::{Xml, XmlTag};
use crate::zip::{ZipEntry, entries};

const KIND: FileKind = FileKind::Xlsx;

/// As many rows and columns as a sheet can have; we read fewer columns.
const LAST_ROW: u64 = 1 << 20;

/// A sheet of a workbook.
#[derive(Debug)]
struct Sheet {
    file: FileSource,
    entry: ZipEntry,
    /// The texts that cells refer to.
    texts: Vec<String>,
    /// The styles of dates and times.
    dates: HashSet<usize>,
    /// Whether days are counted from 1904, not from 1900.
    since_1904: bool,
}

/// Calls `take` with every tag of a file in the archive.
fn each(
    file: &FileSource,
    entry: &ZipEntry,
    mut take: impl FnMut(XmlTag) -> Result<(), TableError>,
) -> Result<(), TableError> {
    let wrong = |what: String| KIND.damaged(format!("`{}`: {what}", entry.name));
    let mut xml = Xml::new(entry.open(file)?);
    while let Some(tag) = xml.next().map_err(wrong)? {
        take(tag)?;
    }
    Ok(())
}

pub(crate) fn open(file: &FileSource, part: Option<&str>) -> Result<NamedRows, TableError> {
    let files = entries(file)?;
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
    let wanted = match part {
        Some(name) => sheets.iter().find(|(of, _)| of == name),
        None => sheets.first(),
    };
    let Some((_, id)) = wanted else {
        let found = sheets.into_iter().map(|(name, _)| name).collect();
        return Err(KIND.choice("sheet", Some(part.unwrap_or_default()), found));
    };
    let mut target = None;
    if let Some(relations) = find("xl/_rels/workbook.xml.rels") {
        each(file, relations, |tag| {
            if tag.attribute("Id").as_ref() == Some(id) {
                target = tag.attribute("Target");
            }
            Ok(())
        })?;
    }
    let target = target.ok_or_else(|| KIND.damaged(format!("its sheet `{id}` is nowhere")))?;
    let target = if target.starts_with('/') { target } else { format!("xl/{target}") };
    let entry = find(&target).ok_or_else(|| KIND.damaged(format!("it has no `{target}`")))?.clone();
    let texts = find("xl/sharedStrings.xml").map(|texts| shared_texts(file, texts)).transpose()?;
    let dates = find("xl/styles.xml").map(|styles| dates(file, styles)).transpose()?;
    let (texts, dates) = (texts.unwrap_or_default(), dates.unwrap_or_default());
    // Names are in a row, or nowhere.
    Ok((None, Arc::new(Sheet { file: file.clone(), entry, texts, dates, since_1904 })))
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

/// The numbers of the styles that show dates or times.
fn dates(file: &FileSource, entry: &ZipEntry) -> Result<HashSet<usize>, TableError> {
    let (mut formats, mut dates) = (HashSet::new(), HashSet::new());
    let (mut in_cells, mut style) = (false, 0);
    each(file, entry, |tag| {
        match tag.name.as_str() {
            "numFmt" => {
                let code = tag.attribute("formatCode").unwrap_or_default();
                if is_date(&code) {
                    formats.extend(tag.attribute("numFmtId"));
                }
            }
            "cellXfs" => in_cells = !tag.is_end,
            "xf" if in_cells && tag.is_start => {
                let format = tag.attribute("numFmtId").unwrap_or_default();
                let is_known = matches!(format.parse(), Ok(14..=22 | 45..=47));
                if is_known || formats.contains(&format) {
                    dates.insert(style);
                }
                style += 1;
            }
            _ => {}
        }
        budget::check(KIND, "its styles", 64 * style as u64, entry.packed).map(drop)
    })?;
    Ok(dates)
}

/// Whether a format shows a date or time: it has a letter for one outside quotes and brackets.
fn is_date(code: &str) -> bool {
    let (mut quoted, mut bracketed, mut escaped) = (false, false, false);
    code.chars().any(|c| {
        let was_escaped = std::mem::take(&mut escaped);
        match c {
            '"' => quoted = !quoted,
            '[' if !quoted => bracketed = true,
            ']' if !quoted => bracketed = false,
            '\\' => escaped = true,
            _ if quoted || bracketed || was_escaped => {}
            _ => return matches!(c.to_ascii_lowercase(), 'y' | 'd' | 'h' | 'm' | 's'),
        }
        false
    }) && !code.eq_ignore_ascii_case("general")
}

impl RowSource for Sheet {
    fn rows(self: Arc<Self>, _: Range<usize>, _: Unpacked) -> Result<RowStream, TableError> {
        let mut xml = Xml::new(self.entry.open(&self.file)?);
        // The last row that was given, and one that is further down.
        let (mut given, mut waiting) = (0, None);
        // The columns of the first row that has several: rows that end earlier are filled up.
        let mut width = 0;
        // One row at a time: rows differ in length.
        Ok(Box::new(move |batch| {
            let next = match waiting.take() {
                None => self.next_row(&mut xml, given)?,
                waiting => waiting,
            };
            let Some((row, cells)) = next else { return Ok(false) };
            batch.clear();
            given += 1;
            if row > given {
                // A row that is not in the file is blank.
                waiting = Some((row, cells));
                batch.push(vec![Cell::Missing]);
                return Ok(true);
            }
            let is_empty = cells.iter().all(|cell| *cell == Cell::Missing);
            if width == 0 && cells.len() > 1 && !is_empty {
                width = cells.len();
            }
            let width = if is_empty { 1 } else { width.max(cells.len()) };
            let mut cells = cells.into_iter();
            batch.extend((0..width).map(|_| vec![cells.next().unwrap_or_default()]));
            Ok(true)
        }))
    }
}

impl Sheet {
    /// The next row that the file has, after the one of number `before`, and its number.
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

/// A cell that is being read.
struct OpenCell {
    column: usize,
    kind: String,
    style: usize,
    text: String,
}

impl OpenCell {
    /// `None` if it stands before the cell that comes next, or too far to the right.
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

    fn value(self, sheet: &Sheet) -> Result<Cell, String> {
        let number =
            || self.text.trim().parse::<f64>().map_err(|_| format!("no number: `{}`", self.text));
        Ok(match self.kind.as_str() {
            "s" => {
                let text = self.text.trim().parse().ok().and_then(|at: usize| sheet.texts.get(at));
                Cell::Text(text.ok_or("it refers to no text")?.clone())
            }
            // Texts, errors of formulas such as #DIV/0!, and dates as text.
            "str" | "inlineStr" | "e" | "d" => Cell::Text(self.text),
            "b" => Cell::Whole(i64::from(self.text.trim() == "1")),
            _ if self.text.trim().is_empty() => Cell::Missing,
            _ if sheet.dates.contains(&self.style) => Cell::Text(date(number()?, sheet.since_1904)),
            _ => Cell::Real(number()?),
        })
    }
}

/// A date or time from its number of days, to the microsecond, as finely as such numbers go.
fn date(days: f64, since_1904: bool) -> String {
    // Excel takes 1900 for a leap year.
    let days_to_1970 = if since_1904 { 24_107.0 } else { 25_569.0 };
    let microseconds = ((days - days_to_1970) * 86_400e6).round();
    iso_of(microseconds as i64, 1_000_000)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_of_dates_are_known() {
        for (code, expected) in [
            ("yyyy-mm-dd", true),
            ("[h]:mm:ss", true),
            ("0.00", false),
            ("General", false),
            ("0.0\"mm\"", false),
            ("#,##0.00 \\d", false),
            ("[Red]0", false),
        ] {
            assert_eq!(is_date(code), expected, "{code}");
        }
        // The day that both counts give for the same date, 2026-11-22 12:00.
        assert_eq!(date(46_348.5, false), "2026-11-22T12:00:00");
        assert_eq!(date(44_886.5, true), "2026-11-22T12:00:00");
    }
}
