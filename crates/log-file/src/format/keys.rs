//! Keys and values above the names: the rate, the units, and the counts per unit.

use super::column_name::plain;
use super::meaning::{Meaning, StatedUnit};
use shell_data::unit::{Quantity, Scale, Unit};

/// The values of known keys, each with its line number.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Keys {
    pub(crate) rate_hz: Option<(f64, u64)>,
    /// Units, and counts per unit, of forces and of moments.
    pub(crate) units: [Option<(String, u64)>; 2],
    pub(crate) counts: [Option<(f64, u64)>; 2],
    /// Units of single columns by name, and a list of units for all columns.
    pub(crate) units_of: Vec<(String, String)>,
    pub(crate) units_of_all: Option<String>,
    pub(crate) is_labview: bool,
    /// True for an export from Vicon, whose sections end at a blank line.
    pub(crate) is_vicon: bool,
}

/// Endings of keys for the number of rows per second. Other keys that end in
/// `frequency` belong to filters and emitters.
const RATES: [&str; 8] = [
    "samplerate",
    "samplingrate",
    "samplefrequency",
    "samplingfrequency",
    "acquisitionrate",
    "datarate",
    "scanrate",
    "samplespersecond",
];

const PERIODS: [&str; 8] = [
    "deltax",
    "sampleinterval",
    "samplinginterval",
    "sampleperiod",
    "samplingperiod",
    "sampletime",
    "timestep",
    "dt",
];

/// Titles in Vicon exports that are followed by a line with only the rate.
const VICON: [&str; 4] = ["devices", "modeloutputs", "trajectories", "forceplates"];

impl Keys {
    /// Reads numbered lines. If a key occurs several times, its first value counts.
    pub(crate) fn new<'a>(lines: impl Iterator<Item = (u64, &'a [u8])>) -> Self {
        let mut keys = Self::default();
        let mut is_below_vicon = false;
        for (number, line) in lines {
            let line = String::from_utf8_lossy(line);
            let line = line.trim().trim_matches(['"', ',', ';']);
            if std::mem::replace(&mut is_below_vicon, VICON.contains(&plain(line).as_str()))
                && let Ok(rate) = line.parse()
            {
                keys.set_rate(rate, number);
                keys.is_vicon = true;
            }
            if let Some((key, value)) = line.split_once([':', '=', '\t', ',', ';']) {
                keys.read(key, value.trim_matches(['"', ' ', '\t', ',', ';']), number);
            }
        }
        keys
    }

    /// Reads a key and its value, at a line number.
    pub(crate) fn read(&mut self, key: &str, value: &str, number: u64) {
        let (key, unit) = key.split_once(['(', '[']).unwrap_or((key, ""));
        let key = plain(key);
        let key = key.strip_suffix("hz").unwrap_or(&key);
        let length = value.find(|c: char| !(c.is_ascii_alphanumeric() || ".,+-".contains(c)));
        let (figure, behind) = value.split_at(length.unwrap_or(value.len()));
        let unit = if unit.is_empty() { behind } else { unit };
        let unit = unit.trim_matches([' ', ')', ']']);
        let figure = figure_of(figure);
        // `FS: 100 100 200` states full scales, not a rate.
        let is_alone = !behind.contains(|c: char| c.is_ascii_digit());
        let is_short = key == "frequency" || ["rate", "fs"].contains(&key) && is_alone;
        if RATES.iter().any(|rate| key.ends_with(rate)) || is_short {
            let thousand = if unit.eq_ignore_ascii_case("khz") { 1e3 } else { 1.0 };
            figure.into_iter().for_each(|rate| self.set_rate(rate * thousand, number));
        } else if PERIODS.contains(&key) {
            let scale = Unit::parse(unit, Quantity::Time).map_or(1.0, |unit| unit.scale.to_si(1.0));
            figure.into_iter().for_each(|period| self.set_rate(1.0 / (period * scale), number));
        }
        let is_moment = ["torque", "moment"].iter().any(|it| key.contains(it)) || key == "cpt";
        let is_load = is_moment || key.contains("force") || key == "cpf";
        let at = usize::from(is_moment);
        if is_load && (key.contains("countsper") || key.starts_with("cp")) {
            let counts = figure.filter(|&counts| counts > 0.0 && counts.is_finite());
            self.counts[at] = self.counts[at].or(counts.map(|counts| (counts, number)));
        } else if is_load && key.contains("unit") && self.units[at].is_none() {
            self.units[at] = Some((value.to_owned(), number));
        } else if !is_load {
            let at_start = ["units", "unit"].iter().find_map(|it| key.strip_prefix(it));
            let stem = at_start.or_else(|| key.strip_suffix("units"));
            match stem.or_else(|| key.strip_suffix("unit")) {
                Some("") if self.units_of_all.is_none() => {
                    self.units_of_all = Some(value.to_owned());
                }
                Some(name) => self.units_of.push((name.to_owned(), value.to_owned())),
                None => {}
            }
        }
    }

    /// Returns the unit that the keys state for a quantity in a column.
    pub(crate) fn unit(&self, column: &str, meaning: Meaning) -> StatedUnit {
        let Some(quantity) = meaning.quantity() else { return StatedUnit::None };
        let words = meaning.in_words().unwrap_or_default();
        let names = [plain(column), plain(&words)];
        let of_column = self.units_of.iter().find(|(name, _)| names.contains(name));
        let of_loads = match quantity {
            Quantity::Force => self.units[0].as_ref(),
            Quantity::Moment => self.units[1].as_ref(),
            _ => None,
        };
        let text = of_column.map(|(_, unit)| unit).or(of_loads.map(|(unit, _)| unit));
        match text {
            Some(text) => StatedUnit::new(text, quantity),
            None => self.unit_of_all(quantity),
        }
    }

    /// Returns the unit of a quantity in a list such as `N, Nm`. If it has only a force unit other than N, the unit of
    /// moments is unknown.
    fn unit_of_all(&self, quantity: Quantity) -> StatedUnit {
        let Some(text) = &self.units_of_all else { return StatedUnit::None };
        let list = text.replace(" and ", ",");
        let units: Vec<&str> =
            list.split([',', ';', '|']).map(str::trim).filter(|unit| !unit.is_empty()).collect();
        let is_one = units.len() == 1;
        let known = units.iter().find_map(|unit| Unit::parse(unit, quantity));
        let is_foreign = |unit: &&str| {
            let force = Unit::parse(unit, Quantity::Force).is_some_and(|it| it.scale != Scale::ONE);
            force || ["english", "imperial"].contains(&unit.to_lowercase().as_str())
        };
        match known {
            Some(_) if quantity == Quantity::Time && is_one => StatedUnit::None,
            Some(unit) => StatedUnit::Known(unit),
            None if quantity != Quantity::Time && units.iter().any(is_foreign) => {
                StatedUnit::Unknown(text.clone())
            }
            None => StatedUnit::None,
        }
    }

    fn set_rate(&mut self, rate_hz: f64, number: u64) {
        let is_one = rate_hz > 0.0 && rate_hz.is_finite();
        self.rate_hz = self.rate_hz.or(is_one.then_some((rate_hz, number)));
    }
}

/// Parses a number with commas as decimal marks, or between thousands, as in `1,000,000` and `1,000`: a rate or a count
/// with exactly three decimals is less likely.
fn figure_of(text: &str) -> Option<f64> {
    let mut groups = text.split('.').next().unwrap_or(text).split(',');
    let is_start = |start: &str| (1..=3).contains(&start.len()) && start != "0";
    let has_thousands = groups.next().is_some_and(is_start)
        && text.contains(',')
        && groups.all(|group| group.len() == 3);
    text.replace(',', if has_thousands { "" } else { "." }).parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(text: &str) -> Keys {
        Keys::new((1..).zip(text.lines().map(str::as_bytes)))
    }

    #[test]
    fn rates_are_found_by_the_keys_of_many_programs() {
        for (text, rate_hz) in [
            ("RDT Sample Rate: 7000", 7000.0),
            ("FREQUENCY\t500", 500.0),
            ("Sampling rate (Hz),250", 250.0),
            ("sample_rate = 2 kHz", 2000.0),
            ("Sampling Frequency [kHz];1,5", 1500.0),
            ("\"Fs\",\"100\"", 100.0),
            ("Delta_X\t0,01\t0,01", 100.0),
            ("Sample interval: 2 ms", 500.0),
            ("Devices\n1000", 1000.0),
            ("Filter cutoff frequency: 15 Hz\nSample Rate: 200 Hz", 200.0),
            ("Sample Rate: 1,000 Hz", 1000.0),
            ("Sample interval (s): 0,005", 200.0),
        ] {
            let found = keys(text).rate_hz.map(|(rate, _)| rate);
            assert!(found.is_some_and(|found| (found - rate_hz).abs() < 1e-9), "{text}: {found:?}");
        }
        for text in [
            "Camera: 100",
            "Rated load: 100",
            "Frequency: none",
            "1000",
            "Rate: 0",
            "FS: 100 100 200",
            "PWM frequency: 20000 Hz",
        ] {
            assert_eq!(keys(text).rate_hz, None, "{text}");
        }
    }

    #[test]
    fn counts_and_units_of_forces_and_moments_are_told_apart() {
        let text = "Force Units: lbf\nCounts per Unit Force: 1000000.0\nTorque Units: lbf-in\nCounts per Unit Torque: 2000";
        let found = keys(text);
        assert_eq!(found.units, [Some(("lbf".to_owned(), 1)), Some(("lbf-in".to_owned(), 3))]);
        assert_eq!(found.counts, [Some((1e6, 2)), Some((2000.0, 4))]);
    }
}
