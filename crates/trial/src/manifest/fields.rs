//! The fields of an entry, from text.

use super::entry::{CellPosition, Entry, ManifestProblem, Moment, Placed};

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
        if let (Moment::At(enter), Moment::At(exit)) = (entry.enter.value, entry.exit.value)
            && exit <= enter
        {
            let message = format!("the exit at `{exit}` s is not after the entry at `{enter}` s");
            return Err(ManifestProblem { position: entry.exit.position, message });
        }
        Ok(entry)
    }

    fn text(&self, key: &str) -> Result<Placed<String>, ManifestProblem> {
        let missing =
            || ManifestProblem { position: self.position, message: format!("`{key}` is missing") };
        (self.get)(key).ok_or_else(missing)
    }

    fn moment(&self, key: &str) -> Result<Placed<Moment>, ManifestProblem> {
        let Placed { value, position } = self.text(key)?;
        let moment = match value.parse::<f64>() {
            _ if value.eq_ignore_ascii_case("auto") => Moment::Auto,
            Ok(time) if time.is_finite() => Moment::At(time),
            _ => {
                let message = format!("`{key}` is `{value}`, expected a time in s or `auto`");
                return Err(ManifestProblem { position, message });
            }
        };
        Ok(Placed { value: moment, position })
    }

    fn positive(&self, key: &str) -> Result<Option<Placed<f64>>, ManifestProblem> {
        let Some(Placed { value, position }) = (self.get)(key) else { return Ok(None) };
        match value.parse::<f64>() {
            Ok(number) if number > 0.0 && number.is_finite() => {
                Ok(Some(Placed { value: number, position }))
            }
            _ => {
                let message = format!("`{key}` is `{value}`, expected a positive number");
                Err(ManifestProblem { position, message })
            }
        }
    }

    fn flag(&self, key: &str) -> Result<bool, ManifestProblem> {
        let Some(Placed { value, position }) = (self.get)(key) else { return Ok(false) };
        match value.to_ascii_lowercase().as_str() {
            "yes" | "true" | "x" | "1" => Ok(true),
            "no" | "false" | "0" => Ok(false),
            _ => {
                let message = format!("`{key}` is `{value}`, expected `yes`, `no` or nothing");
                Err(ManifestProblem { position, message })
            }
        }
    }
}
