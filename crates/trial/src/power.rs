//! Electrical power of the leg motors.
//!
//! The source is the first of these in the log: columns of power, battery voltage times columns of current (power and
//! current need units in the profile), or the motor's formula with duty and back EMF.

use std::ops::Range;

use super::diagnostic::Diagnostic;
use super::input::TrialRows;
use super::profile::{Profile, key_of};
use shell_data::statistics::upper_median;
use shell_data::telemetry::Telemetry;

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Power {
    pub(super) total_w: Vec<f64>,
    /// Right and left motor, if the log has both.
    pub(super) sides_w: Option<[Vec<f64>; 2]>,
}

const POWERS: [Telemetry; 3] = [Telemetry::Power, Telemetry::RightPower, Telemetry::LeftPower];
const CURRENTS: [Telemetry; 3] =
    [Telemetry::Current, Telemetry::RightCurrent, Telemetry::LeftCurrent];

const NO_ENERGY: &str = "electrical energy and specific resistance are left out";

/// Plausible battery voltages, V. Other readings have another unit than the profile states.
const BATTERY_V: std::ops::RangeInclusive<f64> = 0.5..=100.0;

impl Power {
    /// Computes power from telemetry; the error says why it cannot. The battery is checked in the rows `window`.
    pub(super) fn new(
        rows: &TrialRows,
        profile: &Profile,
        window: Range<usize>,
    ) -> Result<Self, Diagnostic> {
        let telemetry = PowerColumns { rows, profile };
        if let Some(power) = Self::from_columns(POWERS.map(|kind| telemetry.in_si(kind, None))) {
            return Ok(power);
        }
        let currents = CURRENTS.map(|kind| telemetry.in_si(kind, None));
        let has_battery = rows.telemetry(Telemetry::Battery).is_some();
        if has_battery && let Some(currents) = Self::from_columns(currents) {
            let battery = telemetry.battery(window)?;
            let times =
                |current: Vec<f64>| current.iter().zip(&battery).map(|(i, v)| i * v).collect();
            let sides_w = currents.sides_w.map(|sides| sides.map(times));
            return Ok(Self { total_w: times(currents.total_w), sides_w });
        }
        telemetry.motors(window)
    }

    fn from_columns([total, right, left]: [Option<Vec<f64>>; 3]) -> Option<Self> {
        let sides_w = right.zip(left).map(|(right, left)| [right, left]);
        let total_w = total.or_else(|| sides_w.as_ref().map(sum))?;
        Some(Self { total_w, sides_w })
    }
}

fn sum([right, left]: &[Vec<f64>; 2]) -> Vec<f64> {
    right.iter().zip(left).map(|(right, left)| right + left).collect()
}

struct PowerColumns<'a> {
    rows: &'a TrialRows,
    profile: &'a Profile,
}

impl PowerColumns<'_> {
    /// A column in SI units, converted by the unit in the profile, or else from counts of `per_count` each.
    fn in_si(&self, kind: Telemetry, per_count: Option<f64>) -> Option<Vec<f64>> {
        let unit = self.profile.unit(kind).or(per_count)?;
        Some(self.rows.telemetry(kind)?.iter().map(|value| value * unit).collect())
    }

    fn battery(&self, window: Range<usize>) -> Result<Vec<f64>, Diagnostic> {
        let counts = self.rows.telemetry(Telemetry::Battery).unwrap_or_default();
        let in_window = counts.get(window).unwrap_or_default();
        let empty = in_window.iter().filter(|&&counts| counts <= 0.0).count();
        if empty > 0 {
            let of = in_window.len();
            let text = format!("the battery reads no voltage in {empty} of {of} rows: {NO_ENERGY}");
            return Err(Diagnostic::warning("no_battery", text));
        }
        let unit = self.profile.unit(Telemetry::Battery);
        let unit = unit.unwrap_or(self.profile.telemetry.battery_v_per_count);
        let reads = upper_median(&mut in_window.to_vec());
        match reads.map(|reads| (reads, reads * unit)) {
            Some((reads, battery_v)) if !BATTERY_V.contains(&battery_v) => {
                let text = format!(
                    "the battery reads {reads} in the log, which the profile takes for {battery_v:.3} V: are \
                     these volts? then give the profile `battery = {{ unit = \"V\" }}` under `[columns]`; \
                     {NO_ENERGY}"
                );
                Err(Diagnostic::warning("battery_unit", text))
            }
            _ => Ok(counts.iter().map(|value| value * unit).collect()),
        }
    }

    fn motors(&self, window: Range<usize>) -> Result<Power, Diagnostic> {
        let missing = Telemetry::MOTORS.iter().filter(|kind| self.rows.telemetry(**kind).is_none());
        let missing: Vec<&str> = missing.map(|kind| kind.name()).collect();
        if !missing.is_empty() {
            let has_no_unit = |kind: &Telemetry| {
                self.profile.unit(*kind).is_none() && self.rows.telemetry(*kind).is_some()
            };
            let unknown = POWERS.into_iter().chain(CURRENTS).find(has_no_unit);
            let (code, what) = match unknown.and_then(|kind| Some((kind, key_of(kind)?))) {
                Some((kind, key)) => {
                    let hint =
                        format!("give the profile `{key} = {{ unit = … }}` under `[columns]`");
                    ("no_unit", format!("{}, whose unit is not known: {hint};", kind.name()))
                }
                None => ("no_power", format!("no {}:", missing.join(", no "))),
            };
            let text = format!("the log has {what} {NO_ENERGY}");
            return Err(Diagnostic::warning(code, text));
        }
        let battery = self.battery(window)?;
        let scales = self.profile.telemetry;
        let side = |duty: Telemetry, back_emf: Telemetry| -> Vec<f64> {
            let per_count = Some(scales.back_emf_v_per_count);
            let back_emf = self.in_si(back_emf, per_count).unwrap_or_default();
            let unit = self.profile.unit(duty);
            let share = |duty: f64| unit.map_or(duty / scales.duty_counts, |unit| duty * unit);
            let samples = self.rows.telemetry(duty).unwrap_or_default().iter().zip(&battery);
            let power = |((&duty, &battery), &back_emf): ((&f64, &f64), &f64)| {
                self.profile.motor.power_w(share(duty), battery, back_emf)
            };
            samples.zip(&back_emf).map(power).collect()
        };
        let right = side(Telemetry::RightDuty, Telemetry::RightBackEmf);
        let sides = [right, side(Telemetry::LeftDuty, Telemetry::LeftBackEmf)];
        Ok(Power { total_w: sum(&sides), sides_w: Some(sides) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Telemetry::{
        Battery, Current, LeftBackEmf, LeftCurrent, LeftDuty, RightBackEmf, RightCurrent, RightDuty,
    };

    fn power(
        columns: &str,
        telemetry: &[(Telemetry, [f64; 2])],
    ) -> Result<([f64; 2], Option<f64>), Diagnostic> {
        let profile = format!("base = \"velociroach\"\n[columns]\n{columns}");
        let telemetry = telemetry.iter().map(|(kind, values)| (*kind, values.to_vec())).collect();
        let rows = TrialRows { telemetry, ..TrialRows::default() };
        let power = Power::new(&rows, &Profile::parse(&profile).unwrap(), 0..2)?;
        let left = power.sides_w.map(|[_, left]| left[0]);
        Ok((power.total_w.try_into().unwrap(), left))
    }

    const VOLTS: &str = "battery = { unit = \"V\" }\n";

    #[test]
    fn measured_power_is_used_unchanged() {
        let watts = [(Telemetry::Power, [1.5, 2.5]), (Battery, [4.0, 4.0]), (Current, [9.0, 9.0])];
        let units = "power = { unit = \"W\" }\ncurrent = { unit = \"A\" }\n".to_owned() + VOLTS;
        assert_eq!(power(&units, &watts), Ok(([1.5, 2.5], None)), "power before current");
        assert_eq!(power(&units, &watts[1..]), Ok(([36.0, 36.0], None)));
        // 500 mA and 250 mA at 4 V.
        let sides = [(RightCurrent, [500.0; 2]), (LeftCurrent, [250.0; 2]), (Battery, [4.0; 2])];
        let milli = "right_current = { unit = \"mA\" }\nleft_current = { unit = \"mA\" }\n";
        assert_eq!(power(&(milli.to_owned() + VOLTS), &sides), Ok(([3.0, 3.0], Some(1.0))));
    }

    #[test]
    fn the_formula_of_the_motor_takes_units_and_counts() {
        // Half duty at 4 V with 0.7 V of back EMF is 2 W, as in the motor's worked example.
        let telemetry = [
            (RightDuty, [50.0; 2]),
            (LeftDuty, [-50.0; 2]),
            (RightBackEmf, [700.0; 2]),
            (LeftBackEmf, [700.0; 2]),
            (Battery, [4.0; 2]),
        ];
        let units = "right_duty = { unit = \"%\" }\nleft_duty = { unit = \"%\" }\n\
                     right_back_emf = { unit = \"mV\" }\nleft_back_emf = { unit = \"mV\" }\n";
        let (total, left) = power(&(units.to_owned() + VOLTS), &telemetry).unwrap();
        // A handful of roundings.
        assert!((total[0] - 4.0).abs() < 1e-14 && (left.unwrap() - 2.0).abs() < 1e-14);
        let counts = telemetry.map(|(kind, [value, _])| {
            let counts = match kind {
                RightDuty | LeftDuty => value / 100.0 * 4096.0,
                RightBackEmf | LeftBackEmf => value / 1000.0 / 0.01009765625,
                _ => value / 0.004420549581839905,
            };
            (kind, [counts; 2])
        });
        let (total, _) = power("", &counts).unwrap();
        assert!((total[0] - 4.0).abs() < 1e-14);
    }

    #[test]
    fn columns_without_units_are_reported() {
        let motors = Telemetry::MOTORS.map(|kind| (kind, [3.7; 2]));
        let Err(asked) = power("", &motors) else { panic!("3.7 counts are no battery") };
        assert_eq!(asked.code, "battery_unit");
        let said = asked.text;
        assert!(
            said.contains("reads 3.7") && said.contains("battery = { unit = \"V\" }"),
            "{said}"
        );
        assert!(power(VOLTS, &motors).is_ok());
        let millivolts = Telemetry::MOTORS.map(|kind| (kind, [3700.0; 2]));
        assert_eq!(power(VOLTS, &millivolts).unwrap_err().code, "battery_unit");
        let said = power("", &[(Current, [1.0; 2]), (Battery, [800.0; 2])]).unwrap_err().text;
        assert!(said.contains("`current = { unit = "), "{said}");
        assert_eq!(power("", &[(Battery, [800.0; 2])]).unwrap_err().code, "no_power");
        assert_eq!(
            power(VOLTS, &Telemetry::MOTORS.map(|kind| (kind, [0.0, 1.0]))).unwrap_err().code,
            "no_battery"
        );
    }
}
