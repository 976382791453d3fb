//! The fields of an entry, from text.

use super::entry::{Entry, Placed};
use crate::cell_position::{CellPosition, ManifestProblem};

/// What is left of an entry's fields once they are read.
pub(super) struct EntryFields<'a> {
    pub(super) position: CellPosition,
    pub(super) get: &'a dyn Fn(&str) -> Option<Placed<String>>,
}

/// The names of the columns or keys, the first four of which have to be there.
pub(super) const KEYS: [&str; 9] = [
    "file",
    "condition",
    "t_enter_s",
    "t_exit_s",
    "velocity_m_s",
    "mass_kg",
    "channel_length_m",
    "notes",
    "exclude",
];

/// How many of [`KEYS`] have to be there.
pub(super) const REQUIRED: usize = 4;

impl EntryFields<'_> {
    /// The entry that the fields make.
    pub(super) fn entry(&self) -> Result<Entry, ManifestProblem> {
        let entry = Entry {
            position: self.position,
            file: self.text("file")?,
            condition: self.text("condition")?,
            enter: self.moment("t_enter_s")?,
            exit: self.moment("t_exit_s")?,
            velocity_m_s: self.positive("velocity_m_s")?,
            mass_kg: self.positive("mass_kg")?,
            channel_length_m: self.positive("channel_length_m")?,
            notes: (self.get)("notes").map(|notes| notes.value),
            exclude: self.flag("exclude")?,
        };
        if let (Some(enter), Some(exit)) = (entry.enter.value, entry.exit.value)
            && exit <= enter
        {
            let message = format!("the exit at `{exit}` s is not after the entry at `{enter}` s");
            return Err(ManifestProblem::new(entry.exit.position, message));
        }
        Ok(entry)
    }

    fn text(&self, key: &str) -> Result<Placed<String>, ManifestProblem> {
        let missing = || ManifestProblem::new(self.position, format!("`{key}` is missing"));
        (self.get)(key).ok_or_else(missing)
    }

    fn moment(&self, key: &str) -> Result<Placed<Option<f64>>, ManifestProblem> {
        read(key, self.text(key)?, "a time in s or `auto`", |text| match text.parse::<f64>() {
            _ if text.eq_ignore_ascii_case("auto") => Some(None),
            Ok(time) if time.is_finite() => Some(Some(time)),
            _ => None,
        })
    }

    fn positive(&self, key: &str) -> Result<Option<f64>, ManifestProblem> {
        let number = |text: &str| text.parse().ok().filter(|&x: &f64| x > 0.0 && x.is_finite());
        let read = |cell| Ok(read(key, cell, "a positive number", number)?.value);
        (self.get)(key).map(read).transpose()
    }

    fn flag(&self, key: &str) -> Result<bool, ManifestProblem> {
        let Some(cell) = (self.get)(key) else { return Ok(false) };
        let flag = read(key, cell, "`yes`, `no` or nothing", |text| {
            match text.to_ascii_lowercase().as_str() {
                "yes" | "true" | "x" | "1" => Some(true),
                "no" | "false" | "0" => Some(false),
                _ => None,
            }
        });
        Ok(flag?.value)
    }
}

/// The value of a cell by `meaning`; a problem that says what is `expected` where the text has none.
fn read<T>(
    key: &str,
    Placed { value, position }: Placed<String>,
    expected: &str,
    meaning: impl Fn(&str) -> Option<T>,
) -> Result<Placed<T>, ManifestProblem> {
    let refused = || format!("`{key}` is `{value}`, expected {expected}");
    let found = meaning(&value).ok_or_else(|| ManifestProblem::new(position, refused()));
    Ok(Placed { value: found?, position })
}
