//! OpenDocument spreadsheets (OASIS ODF 1.3, part 3): the cells of one sheet, streamed.
//!
//! A sheet is a `table` in `content.xml`. Consecutive equal cells and rows are stored once, with a number of
//! repetitions. Empty cells are repeated up to the end of the sheet.

use std::io::Read;
use std::sync::Arc;

use crate::budget::{self, Unpacked};
use crate::calendar::seconds_of_iso;
use crate::format::{Cell, FileSource, FoundTable};
use crate::kind::{FileKind, TableError};
use crate::sheet::{LAST_ROW, NumberedRows, Sheet, choose};
use crate::xml::{LONGEST, Xml, XmlTag};
use crate::zip::{ZipEntry, entries};

const KIND: FileKind = FileKind::Ods;

#[derive(Debug)]
struct OdsSheet {
    file: FileSource,
    content: ZipEntry,
    /// Position among the sheets, from 0.
    position: usize,
}

pub(crate) fn open(file: &FileSource, part: Option<&str>) -> Result<FoundTable, TableError> {
    let content = entries(KIND, file)?.into_iter().find(|entry| entry.name == "content.xml");
    let content = content.ok_or_else(|| KIND.damaged("it has no `content.xml`"))?;
    let mut xml = Xml::new(content.open(KIND, file)?);
    let mut names = Vec::new();
    while let Some(tag) = xml.next().map_err(wrong)? {
        if tag.name == "table" && tag.is_start {
            names.push(tag.attribute("name").unwrap_or_default());
            budget::check_columns(KIND, names.len())?;
        }
    }
    if names.is_empty() {
        return Err(
            KIND.unsupported("it has no sheet, or is encrypted: save it without a password")
        );
    }
    let sheet = |position| {
        let (file, content) = (file.clone(), content.clone());
        Ok(OdsSheet { file, content, position })
    };
    choose(KIND, names, part, sheet)
}

fn wrong(what: String) -> TableError {
    KIND.damaged(format!("`content.xml`: {what}"))
}

/// Returns a number of repetitions; 1 if none is given.
fn repetitions(tag: &XmlTag, attribute: &str) -> u64 {
    tag.attribute(attribute).and_then(|count| count.trim().parse().ok()).unwrap_or(1)
}

impl Sheet for OdsSheet {
    fn numbered(self: Arc<Self>) -> Result<NumberedRows, TableError> {
        let mut xml = Xml::new(self.content.open(KIND, &self.file)?);
        let mut before = self.position;
        while let Some(tag) = xml.next().map_err(wrong)? {
            if tag.name == "table" && tag.is_start {
                match before.checked_sub(1) {
                    None => break,
                    Some(left) => before = left,
                }
            }
        }
        let length = self.file.length()?;
        let mut rows = OdsRows {
            xml,
            length,
            number: 0,
            row: Vec::new(),
            left: 0,
            unpacked: Unpacked::default(),
        };
        Ok(Box::new(move || rows.next()))
    }
}

struct OdsRows<R> {
    xml: Xml<R>,
    length: u64,
    /// The number of the last row.
    number: u64,
    /// A repeated row, and its remaining number of repetitions.
    row: Vec<Cell>,
    left: u64,
    unpacked: Unpacked,
}

impl<R: Read> OdsRows<R> {
    /// Returns the next row with a filled cell, after its number.
    fn next(&mut self) -> Result<Option<(u64, Vec<Cell>)>, TableError> {
        if self.left > 0 {
            self.left -= 1;
            self.number += 1;
            return Ok(Some((self.number, self.row.clone())));
        }
        let (mut cells, mut column, mut bytes, mut repeated) = (Vec::new(), 0_u64, 0_u64, 1);
        let mut cell: Option<OpenCell> = None;
        while let Some(tag) = self.xml.next().map_err(wrong)? {
            if let Some(cell) = &mut cell {
                cell.add(&tag).map_err(wrong)?;
            }
            match tag.name.as_str() {
                "table-row" => {
                    if tag.is_start {
                        (cells, column, bytes) = (Vec::new(), 0, 0);
                        repeated = repetitions(&tag, "number-rows-repeated");
                    }
                    if tag.is_end {
                        let last = self.number.saturating_add(repeated);
                        if cells.is_empty() {
                            self.number = last;
                            continue;
                        }
                        if last > LAST_ROW {
                            return Err(wrong(format!("a row after row {LAST_ROW}")));
                        }
                        self.unpacked.add(KIND, bytes.saturating_mul(repeated), self.length)?;
                        self.number += 1;
                        self.left = repeated.saturating_sub(1);
                        if self.left > 0 {
                            self.row.clone_from(&cells);
                        }
                        return Ok(Some((self.number, cells)));
                    }
                }
                "table-cell" | "covered-table-cell" => {
                    if tag.is_start {
                        cell = Some(OpenCell::new(&tag));
                    }
                    if tag.is_end
                        && let Some(cell) = cell.take()
                    {
                        let count = cell.repeated;
                        let end = column.saturating_add(count);
                        let value = cell.value();
                        if value != Cell::Missing {
                            let size = size_of::<Cell>() + value.text().len();
                            bytes = bytes.saturating_add(count.saturating_mul(size as u64));
                            budget::check_columns(
                                KIND,
                                usize::try_from(end).unwrap_or(usize::MAX),
                            )?;
                            budget::check(KIND, "a row", bytes, self.length)?;
                            cells.resize(column as usize, Cell::Missing);
                            cells.resize(end as usize, value);
                        }
                        column = end;
                    }
                }
                "table" if tag.is_end => break,
                _ => {}
            }
        }
        Ok(None)
    }
}

struct OpenCell {
    tag: XmlTag,
    repeated: u64,
    text: String,
    is_text: bool,
    is_comment: bool,
}

impl OpenCell {
    fn new(tag: &XmlTag) -> Self {
        let repeated = repetitions(tag, "number-columns-repeated");
        Self { tag: tag.clone(), repeated, text: String::new(), is_text: false, is_comment: false }
    }

    /// Adds the text before a tag, and the blanks that the tag stands for.
    fn add(&mut self, tag: &XmlTag) -> Result<(), String> {
        if self.is_text && !self.is_comment {
            self.text.push_str(&tag.text);
        }
        match tag.name.as_str() {
            "annotation" => self.is_comment = !tag.is_end,
            "p" => {
                self.is_text = !tag.is_end;
                if tag.is_start && !self.is_comment && !self.text.is_empty() {
                    self.text.push(' ');
                }
            }
            "s" | "tab" | "line-break" if self.is_text && tag.is_start => self.text.push(' '),
            _ => {}
        }
        match self.text.len() > LONGEST {
            true => Err("a cell is too long".to_owned()),
            false => Ok(()),
        }
    }

    fn value(self) -> Cell {
        let attribute = |name: &str| self.tag.attribute(name).filter(|value| !value.is_empty());
        let text = self.text.trim();
        let found = match attribute("value-type").as_deref() {
            Some("float" | "percentage" | "currency") => {
                attribute("value").and_then(|value| value.trim().parse().ok()).map(Cell::Real)
            }
            Some("boolean") => {
                attribute("boolean-value").map(|value| Cell::Whole(i64::from(value == "true")))
            }
            Some("date") => attribute("date-value").map(|date| match seconds_of_iso(&date) {
                Some(seconds) => {
                    Cell::Time { units: (seconds * 1e6).round() as i64, per_second: 1_000_000 }
                }
                None => Cell::Text(date),
            }),
            Some("time") => attribute("time-value").map(|time| match duration(&time) {
                Some(seconds) => Cell::Elapsed(seconds),
                None => Cell::Text(time),
            }),
            _ => attribute("string-value").filter(|_| text.is_empty()).map(Cell::Text),
        };
        found.unwrap_or_else(|| match text {
            "" => Cell::Missing,
            text => Cell::Text(text.to_owned()),
        })
    }
}

/// Returns the seconds of a duration in ISO 8601: `PT01H30M05.25S`.
fn duration(text: &str) -> Option<f64> {
    let (sign, text) = text.strip_prefix('-').map_or((1.0, text), |rest| (-1.0, rest));
    let (days, clock) = text.strip_prefix('P')?.split_once('T')?;
    let mut seconds = match days {
        "" => 0.0,
        days => 86_400.0 * days.strip_suffix('D')?.parse::<u32>().map(f64::from).ok()?,
    };
    let mut rest = clock;
    for (mark, of) in [('H', 3600.0), ('M', 60.0), ('S', 1.0)] {
        if let Some((number, after)) = rest.split_once(mark) {
            seconds += of * number.replace(',', ".").parse::<f64>().ok()?;
            rest = after;
        }
    }
    // The sum of the parts (60 s and 30.1 s) is rounded to the nanosecond, so that it equals 90.1 s.
    rest.is_empty().then(|| sign * (seconds * 1e9).round() / 1e9)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_are_seconds() {
        for (text, expected) in [
            ("PT00H00M00S", Some(0.0)),
            ("PT01H30M05.25S", Some(5405.25)),
            ("PT00H01M30.100000000S", Some(90.1)),
            ("PT25H00M00,5S", Some(90_000.5)),
            ("P1DT1S", Some(86_401.0)),
            ("-PT1M", Some(-60.0)),
            ("PT1M1H", None),
            ("1:30", None),
            ("PT", Some(0.0)),
        ] {
            assert_eq!(duration(text), expected, "{text}");
        }
    }
}
