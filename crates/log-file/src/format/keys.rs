//! Keys and values above the names: the rate, the units, and the counts per unit.

use super::column_name::plain;
use shell_data::unit::{Quantity, Unit};

/// The values of known keys, each with its line number.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Keys {
    pub(crate) rate_hz: Option<(f64, u64)>,
    /// Units, and counts per unit, of forces and of moments.
    pub(crate) units: [Option<(String, u64)>; 2],
    pub(crate) counts: [Option<(f64, u64)>; 2],
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
    /// Reads lines with their numbers; the first of several values counts.
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

    fn read(&mut self, key: &str, value: &str, number: u64) {
        let (key, unit) = key.split_once(['(', '[']).unwrap_or((key, ""));
        let key = plain(key);
        let key = key.strip_suffix("hz").unwrap_or(&key);
        let length = value.find(|c: char| !(c.is_ascii_alphanumeric() || ".,+-".contains(c)));
        let (figure, behind) = value.split_at(length.unwrap_or(value.len()));
        let unit = if unit.is_empty() { behind } else { unit };
        let unit = unit.trim_matches([' ', ')', ']']);
        let figure = figure_of(figure);
        // `FS: 100 100 200` are ranges.
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
        }
    }

    fn set_rate(&mut self, rate_hz: f64, number: u64) {
        let is_one = rate_hz > 0.0 && rate_hz.is_finite();
        self.rate_hz = self.rate_hz.or(is_one.then_some((rate_hz, number)));
    }
}

/// Returns a number whose comma is the decimal mark, or separates thousands, as in `1,000,000` and `1,000`: a rate or
/// a count with exactly three decimals is less likely.
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
