//! Decimal marks, and marks between thousands: `1,5`, `1.075,2`, `"1,075.2"`, `1'075.2`, `1 075,2`.
//!
//! `1.075` is ambiguous. The other numbers of its column decide: `0.5` has a decimal mark, `1.075,2` has both marks,
//! and `981` beside `1.075` is below a thousand. Otherwise the other columns decide.

use memchr::memchr;

use super::number::{parse_field, set_points, with_points};

/// Marks that may be decimal: a point and a comma.
const MARKS: [u8; 2] = *b".,";

/// Other marks between thousands: blanks, also in Windows' code page, and apostrophes.
const BLANKS: [&[u8]; 8] = [
    "\u{a0}".as_bytes(),
    "\u{202f}".as_bytes(),
    "\u{2009}".as_bytes(),
    "\u{2019}".as_bytes(),
    b" ",
    b"'",
    b"\xa0",
    b"\x92",
];

/// The marks in the numbers of a text.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct NumberMarks {
    pub(crate) has_decimal_commas: bool,
    /// Marks between the thousands of each column; empty if no column may have any.
    thousands: Vec<Thousands>,
    /// Positions of the columns that have such marks in the first rows.
    pub(crate) grouped: Vec<usize>,
}

#[derive(Clone, Debug, Default, PartialEq)]
enum Thousands {
    #[default]
    None,
    Between(u8),
    Blanks,
    /// A number with two readings.
    Unclear(String),
}

/// The marks in a field.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Notation {
    /// An integer of at most three digits; [`Long`](Self::Long) has more.
    Short,
    Long,
    /// The mark is decimal.
    Decimal(usize),
    /// The mark is decimal or between thousands.
    Either(usize),
    /// Marks between thousands, `None` for blanks; the decimal mark, if there is one.
    Grouped(Option<usize>, Option<usize>),
    Other,
}

impl Notation {
    fn of(field: &[u8]) -> Self {
        let field = field.trim_ascii();
        let digits = field.strip_prefix(b"-").or_else(|| field.strip_prefix(b"+")).unwrap_or(field);
        if !digits.first().is_some_and(u8::is_ascii_digit)
            && !MARKS.contains(digits.first().unwrap_or(&0))
        {
            return Self::Other;
        }
        if digits.iter().all(u8::is_ascii_digit) {
            return match digits.len() {
                1..=3 if digits.iter().any(|digit| *digit != b'0') => Self::Short,
                1..=3 => Self::Other,
                _ => Self::Long,
            };
        }
        let mark_of = |byte: u8| MARKS.iter().position(|mark| *mark == byte);
        if let Some(groups) = Groups::of(digits) {
            let decimal = groups.decimal.and_then(mark_of);
            return match (groups.mark.and_then(mark_of), groups.count, decimal) {
                (Some(mark), 1, None) => Self::Either(mark),
                (mark, _, decimal) => Self::Grouped(mark, decimal),
            };
        }
        let mark = field.iter().copied().find_map(mark_of);
        match mark {
            Some(mark) if parse_field(&with_points(field)).is_ok() => Self::Decimal(mark),
            _ => Self::Other,
        }
    }
}

/// Digits in groups of three.
struct Groups {
    /// The point or comma between the groups, `None` for blanks.
    mark: Option<u8>,
    count: usize,
    decimal: Option<u8>,
}

impl Groups {
    /// Splits digits without a sign: `1.075`, `12,345.6`, `1 075,2`.
    fn of(digits: &[u8]) -> Option<Self> {
        let run = |from: &[u8]| from.iter().take_while(|byte| byte.is_ascii_digit()).count();
        let first = run(digits);
        if !(1..=3).contains(&first) || digits[0] == b'0' {
            return None;
        }
        let mut rest = &digits[first..];
        let separator: &[u8] = match rest.first()? {
            b'.' => b".",
            b',' => b",",
            _ => BLANKS.iter().find(|blank| rest.starts_with(blank))?,
        };
        let mut count = 0;
        while let Some(group) = rest.strip_prefix(separator)
            && run(group) == 3
        {
            rest = &group[3..];
            count += 1;
        }
        let mark = Some(separator[0]).filter(|mark| MARKS.contains(mark));
        let decimal =
            rest.first().copied().filter(|byte| MARKS.contains(byte) && Some(*byte) != mark);
        let decimals = rest.get(usize::from(decimal.is_some())..)?;
        let is_number = count > 0 && decimals.iter().all(u8::is_ascii_digit);
        let is_whole = decimal.is_some() || decimals.is_empty();
        (is_number && is_whole).then_some(Self { mark, count, decimal })
    }
}

/// Returns true if a field is a number in any notation.
pub(crate) fn is_marked_number(field: &[u8]) -> bool {
    !matches!(Notation::of(field), Notation::Other) || parse_field(field).is_ok()
}

/// Returns true for a number with a comma that can only be decimal.
pub(crate) fn has_decimal_comma(field: &[u8]) -> bool {
    Notation::of(field) == Notation::Decimal(1)
}

/// The notations in a column.
#[derive(Clone, Debug, Default)]
struct Votes {
    decimal: [bool; 2],
    grouped: [bool; 2],
    has_blanks: bool,
    short: bool,
    long: bool,
    either: [Option<String>; 2],
}

impl Votes {
    fn add(&mut self, field: &[u8]) {
        match Notation::of(field) {
            Notation::Short => self.short = true,
            Notation::Long => self.long = true,
            Notation::Decimal(mark) => self.decimal[mark] = true,
            Notation::Either(mark) => {
                let text = || String::from_utf8_lossy(field.trim_ascii()).into_owned();
                self.either[mark].get_or_insert_with(text);
            }
            Notation::Grouped(mark, decimal) => {
                match mark {
                    Some(mark) => self.grouped[mark] = true,
                    None => self.has_blanks = true,
                }
                decimal.into_iter().for_each(|mark| self.decimal[mark] = true);
            }
            Notation::Other => {}
        }
    }

    /// Determines the marks of a column. `of_file` says which marks are certainly decimal in any column. `is_list` is
    /// true if semicolons or tabs separate columns, so that either mark may be decimal.
    fn thousands(&self, of_file: [bool; 2], is_list: bool) -> Thousands {
        let unclear =
            |mark: usize| Thousands::Unclear(self.either[mark].clone().unwrap_or_default());
        if self.has_blanks {
            return Thousands::Blanks;
        }
        for (mark, other) in [(0, 1), (1, 0)] {
            // A log with decimal points has commas between thousands only if the first rows have some.
            let may_have = mark == 0 || self.either[mark].is_some();
            let has_other = self.decimal[other] && !self.decimal[mark];
            if self.grouped[mark] || (has_other && may_have) {
                return Thousands::Between(MARKS[mark]);
            }
        }
        if self.decimal.contains(&true) {
            return Thousands::None;
        }
        for (mark, other) in [(0, 1), (1, 0)] {
            let is_foreign = of_file[other] && !of_file[mark];
            if self.either[mark].is_none() {
                continue;
            }
            return match () {
                () if self.either[other].is_some() => unclear(mark),
                () if self.long => Thousands::None,
                () if is_foreign && self.short => Thousands::Between(MARKS[mark]),
                () if is_foreign => unclear(mark),
                () if of_file[mark] && !of_file[other] => Thousands::None,
                // The number must be quoted, because commas separate columns.
                () if MARKS[mark] == b',' && !is_list => unclear(mark),
                () if self.short && is_list => unclear(mark),
                () => Thousands::None,
            };
        }
        // Later rows may have the mark.
        match of_file {
            [false, true] if !self.long => Thousands::Between(b'.'),
            _ => Thousands::None,
        }
    }
}

impl NumberMarks {
    /// Determines the marks from the fields of the first rows.
    pub(crate) fn new(rows: impl Iterator<Item = Vec<Vec<u8>>>, is_list: bool) -> Self {
        let mut columns: Vec<Votes> = Vec::new();
        for fields in rows {
            columns.resize(columns.len().max(fields.len()), Votes::default());
            fields.iter().zip(&mut columns).for_each(|(field, votes)| votes.add(field));
        }
        let of_file = [0, 1].map(|mark| columns.iter().any(|votes| votes.decimal[mark]));
        let mut thousands: Vec<Thousands> =
            columns.iter().map(|votes| votes.thousands(of_file, is_list)).collect();
        // An ambiguous column uses the same mark as the columns that are certain.
        let is_sure = |mark: usize| {
            let mut pairs = columns.iter().zip(&thousands);
            pairs.any(|(votes, of)| {
                let is_there = votes.grouped[mark] || votes.either[mark].is_some();
                is_there && *of == Thousands::Between(MARKS[mark])
            })
        };
        let sure = [0, 1].map(|mark| is_sure(mark) && !of_file[mark]);
        for (votes, thousands) in columns.iter().zip(&mut thousands) {
            let mark = (0..2).find(|&mark| sure[mark] && votes.either[mark].is_some());
            if let (Thousands::Unclear(_), Some(mark)) = (&*thousands, mark) {
                *thousands = Thousands::Between(MARKS[mark]);
            }
        }
        let has_decimal_commas = of_file[1]
            || columns.iter().zip(&thousands).any(|(votes, thousands)| {
                votes.either[1].is_some() && *thousands == Thousands::None
            });
        let has_groups = |votes: &Votes, thousands: &Thousands| match thousands {
            Thousands::Between(mark) => {
                let at = usize::from(*mark == MARKS[1]);
                votes.grouped[at] || votes.either[at].is_some()
            }
            of => *of == Thousands::Blanks,
        };
        let pairs = columns.iter().zip(&thousands).enumerate();
        let grouped = pairs.filter(|(_, (votes, of))| has_groups(votes, of));
        let grouped = grouped.map(|(at, _)| at).collect();
        let is_plain = thousands.iter().all(|of| *of == Thousands::None);
        let thousands = if is_plain { Vec::new() } else { thousands };
        Self { has_decimal_commas, thousands, grouped }
    }

    pub(crate) fn is_plain(&self) -> bool {
        !self.has_decimal_commas && self.thousands.is_empty()
    }

    /// Returns an ambiguous number in a column (from 0), if its marks are unclear.
    pub(crate) fn unclear(&self, column: usize) -> Option<&str> {
        match self.thousands.get(column)? {
            Thousands::Unclear(field) => Some(field),
            _ => None,
        }
    }

    /// Rewrites numbers with points as decimal marks and without other marks. Lines keep their length, so that
    /// positions stay valid.
    pub(crate) fn rewritten(&self, lines: &[u8], separator: u8) -> Vec<u8> {
        if self.thousands.is_empty() && separator != b',' {
            return with_points(lines);
        }
        let mut text = lines.to_vec();
        let (mut start, mut column, mut is_quoted) = (0, 0, false);
        for at in 0..=lines.len() {
            let byte = lines.get(at).copied().unwrap_or(b'\n');
            is_quoted ^= byte == b'"';
            if byte == b'\n' {
                is_quoted = false;
            }
            if byte == b'\n' || (byte == separator && !is_quoted) {
                self.rewrite(&mut text[start..at], column);
                start = at + 1;
                column = if byte == b'\n' { 0 } else { column + 1 };
            }
        }
        text
    }

    fn rewrite(&self, field: &mut [u8], column: usize) {
        let is_edge = |byte: &u8| byte.is_ascii_whitespace() || *byte == b'"';
        let Some(first) = field.iter().position(|byte| !is_edge(byte)) else { return };
        let last = field.iter().rposition(|byte| !is_edge(byte)).unwrap_or(first);
        let number = &mut field[first..=last];
        let has_thousands = match self.thousands.get(column) {
            Some(Thousands::Between(mark)) => memchr(*mark, number).is_some(),
            Some(Thousands::Blanks) => true,
            _ => false,
        };
        if has_thousands && let Notation::Grouped(..) | Notation::Either(_) = Notation::of(number) {
            let sign = usize::from(!number[0].is_ascii_digit());
            let decimal = Groups::of(&number[sign..]).and_then(|groups| groups.decimal);
            let kept =
                |byte: &u8| (byte.is_ascii_digit() || Some(*byte) == decimal).then_some(*byte);
            let mut bare: Vec<u8> = number[..sign].to_vec();
            bare.extend(number[sign..].iter().filter_map(kept));
            bare.resize(number.len(), b' ');
            number.copy_from_slice(&bare);
        }
        if self.has_decimal_commas {
            set_points(number);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(text: &str, separator: u8) -> (NumberMarks, Vec<String>) {
        let rows = || {
            let of_line = |line: &str| {
                let fields = crate::line::quoted_fields(line.as_bytes(), separator);
                fields.iter().map(<[u8]>::to_vec).collect::<Vec<_>>()
            };
            text.lines().map(of_line)
        };
        let marks = NumberMarks::new(rows(), separator != b',');
        let made = marks.rewritten(text.as_bytes(), separator);
        assert_eq!(made.len(), text.len());
        let made = String::from_utf8_lossy(&made).into_owned();
        let bare = made.replace(['"', ' '], "");
        (marks, bare.lines().map(str::to_owned).collect())
    }

    #[test]
    fn marks_between_thousands_are_told_from_decimal_marks() {
        for (text, separator, expected) in [
            ("0,5;981\n1,5;1.075\n", b';', &["0.5;981", "1.5;1075"][..]),
            ("0,5;1.075,25\n1,5;-981,5\n", b';', &["0.5;1075.25", "1.5;-981.5"]),
            ("1.5\t981\n2.5\t1,075\n", b'\t', &["1.5\t981", "2.5\t1075"]),
            ("0.5,\"1,075.2\"\n1.5,\"-12,075.2\"\n", b',', &["0.5,1075.2", "1.5,-12075.2"]),
            ("\"0,5\",\"1,25\"\n", b',', &["0.5,1.25"]),
            ("0.5;1'075.5\n", b';', &["0.5;1075.5"]),
            ("0,5;1\u{202f}075,5\n", b';', &["0.5;1075.5"]),
            ("0,5;1.234.567\n", b';', &["0.5;1234567"]),
            ("0,5;1.075;981\n1,5;2.113;1.002\n", b';', &["0.5;1075;981", "1.5;2113;1002"]),
            // The column has its own decimals, or integers without marks.
            ("0,5;1.075\n1,5;12.5\n", b';', &["0.5;1.075", "1.5;12.5"]),
            ("0.010;1.075\n0.020;2.113\n", b';', &["0.010;1.075", "0.020;2.113"]),
            ("1,075;2,113\n", b';', &["1.075;2.113"]),
            ("0,5;1,075\n1,5;2\n", b';', &["0.5;1.075", "1.5;2"]),
            ("981,1.075\n", b',', &["981,1.075"]),
            ("01.03.2026 10:00;0,5\n", b';', &["01.03.202610:00;0.5"]),
        ] {
            assert_eq!(numbers(text, separator).1, expected, "{text}");
        }
    }

    #[test]
    fn a_number_with_two_readings_is_named() {
        for (text, separator, expected) in [
            ("0,5;1.075\n1,5;2.113\n", b';', Some("1.075")),
            ("7;981\n8;1.002\n", b';', Some("1.002")),
            ("0.5,\"1,075\"\n", b',', Some("1,075")),
            ("0,5;981\n1,5;1.075\n", b';', None),
        ] {
            assert_eq!(numbers(text, separator).0.unclear(1), expected, "{text}");
        }
    }

    #[test]
    fn later_rows_may_have_the_first_thousand() {
        let rows = [&b"0,5"[..], b"981"].map(<[u8]>::to_vec).to_vec();
        let marks = NumberMarks::new([rows].into_iter(), true);
        assert_eq!(marks.rewritten(b"1,5;1.075\n", b';'), b"1.5;1075 \n");
    }
}
