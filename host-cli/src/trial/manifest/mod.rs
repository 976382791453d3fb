//! Manifests: which trials there are, in CSV or TOML.
//!
//! ```csv
//! file,condition,t_enter_s,t_exit_s,velocity_m_s,mass_kg,channel_length_m,notes,exclude
//! logs/run1.txt,3 cm,4.2,8.9,,,,,
//! logs/run2.txt,3 cm,auto,auto,,0.091,,new battery,
//! logs/run3.txt,2 cm,3.1,6.0,,,,fell over,yes
//! ```
//!
//! Only the first four columns have to be there. The same in TOML is one `[[trial]]` table for each,
//! with the same keys, and optionally `conditions = ["free", "3 cm"]`, which are then all that there
//! may be.

mod csv;
mod faults;
mod toml;

use std::fmt;

pub use faults::{Fault, Remarkable};

/// A manifest.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Manifest {
    /// Its rows in order: trials, or what is wrong with them.
    pub rows: Vec<Result<Entry, Problem>>,
    /// All the conditions that there may be, if it says.
    pub conditions: Option<Vec<String>>,
}

/// A trial as the manifest has it.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Where it starts.
    pub place: Place,
    /// The log, relative to the manifest's folder.
    pub file: Placed<String>,
    /// The condition.
    pub condition: Placed<String>,
    /// Entry into the channel.
    pub enter: Placed<Moment>,
    /// Exit from it.
    pub exit: Placed<Moment>,
    /// Mean velocity, m/s.
    pub velocity_m_s: Option<Placed<f64>>,
    /// Mass, kg.
    pub mass_kg: Option<Placed<f64>>,
    /// Length of the channel, m.
    pub channel_length_m: Option<Placed<f64>>,
    /// What there is to say.
    pub notes: Option<String>,
    /// Whether it is left out.
    pub exclude: bool,
}

/// When something happens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Moment {
    /// At this time, s on the log's clock.
    At(f64),
    /// To be found in the forces.
    Auto,
}

/// A line and a column of a manifest, from 1; columns in characters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Place {
    /// The line.
    pub line: usize,
    /// The column.
    pub column: usize,
}

/// A value and where it stands.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed<T> {
    /// The value.
    pub value: T,
    /// Where it stands.
    pub place: Place,
}

/// What is wrong at some place of a manifest.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{place}: {message}")]
pub struct Problem {
    /// Where.
    pub place: Place,
    /// What.
    pub message: String,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.line, self.column)
    }
}

impl Manifest {
    /// Reads a manifest: TOML if `is_toml`, else CSV.
    ///
    /// # Errors
    /// [`Problem`] if the manifest as a whole makes no sense: no TOML, columns missing or unknown, no
    /// trials. What is wrong with one trial is in its row.
    pub fn parse(text: &str, is_toml: bool) -> Result<Self, Problem> {
        let manifest = if is_toml { toml::parse(text)? } else { csv::parse(text)? };
        if manifest.rows.is_empty() {
            let place = Place { line: 1, column: 1 };
            return Err(Problem { place, message: "the manifest has no trials".to_owned() });
        }
        Ok(manifest)
    }
}

/// What is left of an entry's fields once they are read.
pub(super) struct Fields<'a> {
    place: Place,
    get: &'a dyn Fn(&str) -> Option<Placed<String>>,
}

/// The names of the columns or keys, the first four of which have to be there.
const KEYS: [&str; 9] = [
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
const REQUIRED: usize = 4;

impl Fields<'_> {
    /// The entry that the fields make.
    fn entry(&self) -> Result<Entry, Problem> {
        let entry = Entry {
            place: self.place,
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
            return Err(Problem { place: entry.exit.place, message });
        }
        Ok(entry)
    }

    fn text(&self, key: &str) -> Result<Placed<String>, Problem> {
        let missing = || Problem { place: self.place, message: format!("`{key}` is missing") };
        (self.get)(key).ok_or_else(missing)
    }

    fn moment(&self, key: &str) -> Result<Placed<Moment>, Problem> {
        let Placed { value, place } = self.text(key)?;
        let moment = match value.parse::<f64>() {
            _ if value.eq_ignore_ascii_case("auto") => Moment::Auto,
            Ok(time) if time.is_finite() => Moment::At(time),
            _ => {
                let message = format!("`{key}` is `{value}`, expected a time in s or `auto`");
                return Err(Problem { place, message });
            }
        };
        Ok(Placed { value: moment, place })
    }

    fn positive(&self, key: &str) -> Result<Option<Placed<f64>>, Problem> {
        let Some(Placed { value, place }) = (self.get)(key) else { return Ok(None) };
        match value.parse::<f64>() {
            Ok(number) if number > 0.0 && number.is_finite() => {
                Ok(Some(Placed { value: number, place }))
            }
            _ => {
                let message = format!("`{key}` is `{value}`, expected a positive number");
                Err(Problem { place, message })
            }
        }
    }

    fn flag(&self, key: &str) -> Result<bool, Problem> {
        let Some(Placed { value, place }) = (self.get)(key) else { return Ok(false) };
        match value.to_ascii_lowercase().as_str() {
            "yes" | "true" | "x" | "1" => Ok(true),
            "no" | "false" | "0" => Ok(false),
            _ => {
                let message = format!("`{key}` is `{value}`, expected `yes`, `no` or nothing");
                Err(Problem { place, message })
            }
        }
    }
}

/// The known name that `name` is most like, if it is at all.
pub fn suggest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let name = name.to_lowercase();
    let likeness = |known: &str| strsim::jaro_winkler(&name, &known.to_lowercase());
    let candidates = known.into_iter().map(|known| (likeness(known), known));
    let best =
        candidates.filter(|(likeness, _)| *likeness > 0.75).max_by(|a, b| a.0.total_cmp(&b.0));
    best.map(|(_, known)| known)
}

/// `, did you mean …?` where a name is known that is like it.
fn did_you_mean<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    suggest(name, known).map_or_else(String::new, |known| format!(", did you mean `{known}`?"))
}
