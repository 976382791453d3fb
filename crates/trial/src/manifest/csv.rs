//! Manifests as CSV, with commas, semicolons or tabs.

use csv::{ReaderBuilder, StringRecord, Trim};

use super::{CellPosition, Entry, KEYS, Manifest, ManifestProblem, Placed, hint_for};
use shell_data::hint::quoted;

const REQUIRED: usize = 4;

const OTHER_NAMES: [(&str, &str); 9] = [
    ("log", "file"),
    ("t_enter", "t_enter_s"),
    ("t_exit", "t_exit_s"),
    ("velocity", "velocity_m_s"),
    ("mass", "mass_kg"),
    ("channel_length", "channel_length_m"),
    ("length", "channel_length_m"),
    ("length_m", "channel_length_m"),
    ("note", "notes"),
];

pub(super) fn parse(text: &str) -> Result<Manifest, ManifestProblem> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let separator = separator(text);
    let mut reader = ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .comment(Some(b'#'))
        .delimiter(separator)
        .trim(Trim::All)
        .from_reader(text.as_bytes());
    let mut record = StringRecord::new();
    let mut keys: Option<Vec<Option<&str>>> = None;
    let mut manifest = Manifest::default();
    loop {
        let read = reader.read_record(&mut record);
        if !read.map_err(|error| ManifestProblem::new(CellPosition::START, error.to_string()))? {
            break;
        }
        let start = record.position().map_or(0, |position| position.byte() as usize);
        let lexed = Lexed::new(text, start, separator);
        match &keys {
            None => keys = Some(header(&record, &lexed)?),
            Some(_) if record.iter().all(str::is_empty) => {}
            Some(keys) => manifest.rows.push(row(keys, &record, &lexed)),
        }
    }
    let empty = || ManifestProblem::new(CellPosition::START, "the manifest is empty".to_owned());
    keys.map(|_| manifest).ok_or_else(empty)
}

/// The separator in the first line that is neither blank nor a comment.
pub(crate) fn separator(text: &str) -> u8 {
    let is_header = |line: &&str| !line.trim().is_empty() && !line.starts_with('#');
    let first = text.lines().find(is_header).unwrap_or_default();
    *b";\t".iter().find(|s| first.as_bytes().contains(s)).unwrap_or(&b',')
}

fn header(
    record: &StringRecord,
    lexed: &Lexed,
) -> Result<Vec<Option<&'static str>>, ManifestProblem> {
    let mut keys: Vec<Option<&'static str>> = Vec::new();
    for (i, name) in record.iter().enumerate() {
        let plain = name.to_lowercase().replace([' ', '-'], "_");
        let other = OTHER_NAMES.iter().find(|(other, _)| *other == plain).map(|(_, key)| *key);
        let key = KEYS.into_iter().find(|key| *key == plain).or(other);
        if key.is_none() && !name.is_empty() {
            let message = format!("unknown column `{name}`{}", hint_for(&plain));
            return Err(ManifestProblem::new(lexed.field(i), message));
        }
        if key.is_some() && keys.contains(&key) {
            let message = format!("a second column `{name}`");
            return Err(ManifestProblem::new(lexed.field(i), message));
        }
        keys.push(key);
    }
    let absent = KEYS[..REQUIRED].iter().filter(|key| !keys.contains(&Some(**key)));
    match &*quoted(absent, ", ") {
        "" => Ok(keys),
        absent => Err(ManifestProblem::new(lexed.field(0), format!("no column {absent}"))),
    }
}

fn row(
    keys: &[Option<&str>],
    record: &StringRecord,
    lexed: &Lexed,
) -> Result<Entry, ManifestProblem> {
    if record.len() > keys.len() {
        let message = format!("{} fields, the header has {}", record.len(), keys.len());
        return Err(ManifestProblem::new(lexed.field(keys.len()), message));
    }
    let cells = keys.iter().zip(record).enumerate().filter_map(|(column, (key, value))| {
        Some(((*key)?, Placed { value: value.to_owned(), position: lexed.field(column) }))
    });
    Entry::new(lexed.field(0), cells.collect())
}

pub(crate) struct Lexed {
    line: usize,
    columns: Vec<usize>,
}

impl Lexed {
    pub(crate) fn new(text: &str, start: usize, separator: u8) -> Self {
        // The reader's position is where it continued to read, which may be at a blank line or a comment.
        let mut start = start;
        loop {
            let line = text[start..].lines().next().unwrap_or_default();
            let skipped = line.trim().is_empty() || line.starts_with('#');
            match text[start..].find('\n') {
                Some(end) if skipped => start += end + 1,
                _ => break,
            }
        }
        let line = 1 + text[..start].matches('\n').count();
        let mut columns = vec![1];
        let mut quoted = false;
        for (i, c) in text[start..].chars().enumerate() {
            match c {
                '"' => quoted = !quoted,
                '\n' if !quoted => break,
                c if !quoted && c == char::from(separator) => columns.push(i + 2),
                _ => {}
            }
        }
        Self { line, columns }
    }

    /// The start of field `i`, or of the last field if there is no such field.
    pub(crate) fn field(&self, i: usize) -> CellPosition {
        let last = self.columns.last().copied().unwrap_or(1);
        CellPosition { line: self.line, column: self.columns.get(i).copied().unwrap_or(last) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "file,condition,t_enter_s,t_exit_s";

    fn rows(text: &str) -> Vec<Result<Entry, ManifestProblem>> {
        Manifest::parse(text, false).unwrap().rows
    }

    #[test]
    fn all_columns_are_read_in_any_order_with_comments_quotes_and_blank_lines() {
        let text = "\u{feff}# by hand\n\nexclude; Notes;t_exit_s;t_enter_s;condition;file;mass\n\
                    \n# run 1\n;\"a; b\";5,0;1.5;3 cm;a.txt;0.09\nyes;;5;auto;3 cm;b.txt;\n";
        let rows = rows(text);
        let message = rows[0].clone().unwrap_err().to_string();
        assert_eq!(
            message,
            "6:9: `t_exit_s` is `5,0`, expected a time in s or `auto`, with a decimal point in place of the comma"
        );
        let second = rows[1].clone().unwrap();
        assert!(second.exclude && second.trial.notes.is_none());
        assert_eq!(second.enter.value, None);
        assert_eq!((second.position.line, second.file_position.column), (7, 18));
        assert_eq!(rows.len(), 2);
    }

    #[test]
    fn a_faulty_row_is_reported_with_its_position_and_the_others_are_read() {
        let text = format!(
            "{HEADER},velocity_m_s\na,x,1,2,\nb,x,2,1,\nc,x,1,2,0\n,x,1,2,\nd,x,1,nan,\ne,x,1,2,,9\n\
             f,x,1,2\n"
        );
        let messages: Vec<_> =
            rows(&text).into_iter().map(|row| row.map_err(|e| e.to_string()).err()).collect();
        let expected = [
            None,
            Some("3:7: the exit at `1` s is not after the entry at `2` s"),
            Some("4:9: `velocity_m_s` is `0`, expected a positive number"),
            Some("5:1: `file` is missing"),
            Some("6:7: `t_exit_s` is `nan`, expected a time in s or `auto`"),
            Some("7:10: 6 fields, the header has 5"),
            None,
        ];
        assert_eq!(messages, expected.map(|message| message.map(str::to_owned)));
    }

    #[test]
    fn an_invalid_header_is_refused_with_a_suggestion() {
        for (header, message) in [
            (
                "file,conditon,t_enter_s,t_exit_s",
                "1:6: unknown column `conditon`, did you mean `condition`?",
            ),
            (
                "file,condition,t_enter_s,t_exit_s,Velocity (cm/s)",
                "1:35: unknown column `Velocity (cm/s)`: convert its values to m/s, and call it `velocity_m_s`",
            ),
            (
                "file,condition,t_enter_s,t_exit_s,mass_g",
                "1:35: unknown column `mass_g`: convert its values to kg, and call it `mass_kg`",
            ),
            ("file,condition,t_exit_s", "1:1: no column `t_enter_s`"),
            ("file,condition,t_enter_s,t_exit_s,file", "1:35: a second column `file`"),
            ("", "1:1: the manifest is empty"),
            (HEADER, "1:1: the manifest has no trials"),
        ] {
            assert_eq!(Manifest::parse(header, false).unwrap_err().to_string(), message);
        }
    }
}
