//! Electrical power of the leg motors.
//!
//! The source is the first of these in the log: columns of power, battery voltage times columns of current (power and
//! current need units in the log or the profile), or the motor's formula with duty and back EMF.

use std::ops::Range;

use super::diagnostic::Diagnostic;
use super::input::TrialRows;
use super::profile::{Profile, key_of};
use shell_data::hint::quoted;
use shell_data::statistics::upper_median;
use shell_data::telemetry::COUNTS;
use shell_data::telemetry::Telemetry::{
    self, Battery, Current, LeftBackEmf, LeftCurrent, LeftDuty, LeftPower, RightBackEmf,
    RightCurrent, RightDuty, RightPower,
};

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Power {
    pub(super) total_w: Vec<f64>,
    /// Right and left motor, if the log has both.
    pub(super) sides_w: Option<[Vec<f64>; 2]>,
}

const POWERS: [Telemetry; 3] = [Telemetry::Power, RightPower, LeftPower];
const CURRENTS: [Telemetry; 3] = [Current, RightCurrent, LeftCurrent];

const OF_CURRENT: &[Telemetry] = &[Current, Battery];
const OF_CURRENTS: &[Telemetry] = &[RightCurrent, LeftCurrent, Battery];

/// The columns of each source of power.
const WAYS: [&[Telemetry]; 5] =
    [&[Telemetry::Power], &[RightPower, LeftPower], OF_CURRENT, OF_CURRENTS, &Telemetry::MOTORS];

const NO_ENERGY: &str = "electrical energy and specific resistance are left out";

/// Plausible battery voltages, V. Other readings have another unit than the profile states.
const BATTERY_V: std::ops::RangeInclusive<f64> = 0.5..=100.0;

/// Smallest plausible maximum of a duty that is not 0: a motor does not turn the leg with less. Counts of a percent or
/// of a share, taken for counts of a pulse, are below it.
const SMALLEST_DUTY: f64 = 0.025;

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
        let way = if currents[0].is_some() { OF_CURRENT } else { OF_CURRENTS };
        if telemetry.has(Battery)
            && let Some(currents) = Self::from_columns(currents)
        {
            telemetry.check(way, window)?;
            let per_count = Some(profile.telemetry.battery_v_per_count);
            let battery = telemetry.in_si(Battery, per_count).unwrap_or_default();
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
    fn has(&self, kind: Telemetry) -> bool {
        self.rows.telemetry(kind).is_some()
    }

    /// A column in SI units, converted by the unit in the profile, or else from counts of `per_count` each.
    fn in_si(&self, kind: Telemetry, per_count: Option<f64>) -> Option<Vec<f64>> {
        let unit = self.profile.unit(kind).or(per_count)?;
        Some(self.rows.telemetry(kind)?.iter().map(|value| value * unit).collect())
    }

    /// Checks that the battery reads a voltage in the rows `window`, and that the columns `kinds` have units or can be
    /// counts.
    fn check(&self, kinds: &[Telemetry], window: Range<usize>) -> Result<(), Diagnostic> {
        let in_window = |kind| {
            self.rows.telemetry(kind).and_then(|of| of.get(window.clone())).unwrap_or_default()
        };
        let battery = in_window(Battery);
        let empty = battery.iter().filter(|&&counts| counts <= 0.0).count();
        if empty > 0 {
            let of = battery.len();
            let text = format!("the battery reads no voltage in {empty} of {of} rows: {NO_ENERGY}");
            return Err(Diagnostic::warning("no_battery", text));
        }
        let is_unstated = |kind: &Telemetry| self.profile.unit_text(*kind).is_none();
        let mut asked: Vec<_> = kinds.iter().copied().filter(is_unstated).collect();
        let doubt = self.doubtful_battery(battery);
        let doubt =
            doubt.or_else(|| asked.iter().find_map(|of| self.no_counts(*of, kinds, in_window)));
        let Some(doubt) = doubt else { return Ok(()) };
        if asked.is_empty() {
            asked.push(Battery);
        }
        let keys = quoted(asked.into_iter().filter_map(key_of), ", ");
        let text = format!(
            "{doubt}: give the profile the unit of {keys} under `[columns]`, as in `battery = {{ unit = \"V\" }}`; \
             `{COUNTS}` if these are counts; {NO_ENERGY}"
        );
        Err(Diagnostic::warning("telemetry_unit", text))
    }

    fn doubtful_battery(&self, battery: &[f64]) -> Option<String> {
        let unit = self.profile.unit(Battery);
        let unit = unit.unwrap_or(self.profile.telemetry.battery_v_per_count);
        let reads = upper_median(&mut battery.to_vec())?;
        let battery_v = reads * unit;
        (!BATTERY_V.contains(&battery_v)).then(|| {
            format!(
                "the battery reads {reads} in the log, which the profile takes for {battery_v:.3} V"
            )
        })
    }

    /// The reason why a column without a unit cannot be counts, if there is one. `kinds` are the columns used with it.
    fn no_counts<'a>(
        &self,
        kind: Telemetry,
        kinds: &[Telemetry],
        in_window: impl Fn(Telemetry) -> &'a [f64],
    ) -> Option<String> {
        let name = kind.name();
        if let Some(reads) = in_window(kind).iter().find(|reads| reads.fract().abs() > 0.0) {
            return Some(format!("the {name} reads {reads} in the log, which is no count"));
        }
        if ![RightDuty, LeftDuty].contains(&kind) {
            let other = kinds.iter().find(|kind| self.profile.unit(**kind).is_some())?.name();
            return Some(format!(
                "the unit of the {name} is not known, but that of the {other} is"
            ));
        }
        let duties = [RightDuty, LeftDuty].into_iter().flat_map(in_window);
        let largest = duties.fold(0.0, |most: f64, duty| most.max(duty.abs()));
        let share = largest / self.profile.telemetry.duty_counts;
        (share > 0.0 && share < SMALLEST_DUTY).then(|| {
            let percent = 100.0 * share;
            format!("the {name} is at most {largest}, which the profile takes for {percent:.2} %")
        })
    }

    fn motors(&self, window: Range<usize>) -> Result<Power, Diagnostic> {
        if Telemetry::MOTORS.iter().any(|kind| !self.has(*kind)) {
            return Err(self.missing());
        }
        self.check(&Telemetry::MOTORS, window)?;
        let scales = self.profile.telemetry;
        let in_si = |kind, per_count| self.in_si(kind, Some(per_count)).unwrap_or_default();
        let battery = in_si(Battery, scales.battery_v_per_count);
        let side = |duty: Telemetry, back_emf: Telemetry| -> Vec<f64> {
            let back_emf = in_si(back_emf, scales.back_emf_v_per_count);
            let unit = self.profile.unit(duty);
            let share = |duty: f64| unit.map_or(duty / scales.duty_counts, |unit| duty * unit);
            let samples = self.rows.telemetry(duty).unwrap_or_default().iter().zip(&battery);
            let power = |((&duty, &battery), &back_emf): ((&f64, &f64), &f64)| {
                self.profile.motor.power_w(share(duty), battery, back_emf)
            };
            samples.zip(&back_emf).map(power).collect()
        };
        let sides = [side(RightDuty, RightBackEmf), side(LeftDuty, LeftBackEmf)];
        Ok(Power { total_w: sum(&sides), sides_w: Some(sides) })
    }

    /// Names the missing columns of the most complete source of power.
    fn missing(&self) -> Diagnostic {
        let is_begun =
            |way: &&&[Telemetry]| way.iter().any(|kind| *kind != Battery && self.has(*kind));
        let absent = |way: &[Telemetry]| way.iter().filter(|kind| !self.has(**kind)).count();
        let way = WAYS.iter().filter(is_begun).min_by_key(|way| absent(way));
        let way = way.copied().unwrap_or(&Telemetry::MOTORS);
        let (there, missing): (Vec<_>, Vec<_>) = way.iter().partition(|kind| self.has(**kind));
        let names = |kinds: &[Telemetry], between| {
            kinds.iter().map(|kind| kind.name()).collect::<Vec<_>>().join(between)
        };
        let unknown = there.iter().find(|kind| self.profile.unit(**kind).is_none());
        let (code, what) = match unknown.and_then(|kind| Some((kind, key_of(*kind)?))) {
            Some((kind, key)) if missing.is_empty() => {
                let hint = format!("give the profile `{key} = {{ unit = … }}` under `[columns]`");
                ("no_unit", format!("{}, whose unit is not known: {hint};", kind.name()))
            }
            _ if there.is_empty() => ("no_power", format!("no {}:", names(&missing, ", no "))),
            _ => {
                let (there, missing) = (names(&there, ", "), names(&missing, ", no "));
                ("no_power", format!("{there}, but no {missing}:"))
            }
        };
        Diagnostic::warning(code, format!("the log has {what} {NO_ENERGY}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
            let counts: f64 = match kind {
                RightDuty | LeftDuty => value / 100.0 * 4096.0,
                RightBackEmf | LeftBackEmf => value / 1000.0 / 0.01009765625,
                _ => value / 0.004420549581839905,
            };
            (kind, [counts.round(); 2])
        });
        let (total, _) = power("", &counts).unwrap();
        // Half a count of the battery is 2 mV, half a count of the EMF 5 mV: 4 W · (2/4000 + 7/3300).
        assert!((total[0] - 4.0).abs() < 0.011, "{total:?}");
    }

    #[test]
    fn columns_without_units_are_reported() {
        let motors = Telemetry::MOTORS.map(|kind| (kind, [3.7; 2]));
        let Err(asked) = power("", &motors) else { panic!("3.7 counts are no battery") };
        assert_eq!(asked.code, "telemetry_unit");
        let said = asked.text;
        assert!(
            said.contains("reads 3.7") && said.contains("battery = { unit = \"V\" }"),
            "{said}"
        );
        let all = "`right_duty`, `left_duty`, `right_back_emf`, `left_back_emf`, `battery`";
        assert!(said.contains(all), "{said}");
        let millivolts = Telemetry::MOTORS.map(|kind| (kind, [3700.0; 2]));
        assert_eq!(power(VOLTS, &millivolts).unwrap_err().code, "telemetry_unit");
        let current = [(Current, [1.0; 2]), (Battery, [800.0; 2])];
        let said = power("", &current).unwrap_err().text;
        assert!(said.contains("`current = { unit = "), "{said}");
        // 800 counts are 3.536 V, but nothing says that they are counts beside a current in A.
        let ampere = "current = { unit = \"A\" }\n";
        let said = power(ampere, &current).unwrap_err().text;
        assert!(
            said.contains("the unit of the battery is not known, but that of the current is"),
            "{said}"
        );
        let counts = ampere.to_owned() + "battery = { unit = \"counts\" }\n";
        assert!((power(&counts, &current).unwrap().0[0] - 3.536).abs() < 1e-3);
        assert_eq!(power("", &[(Battery, [800.0; 2])]).unwrap_err().code, "no_power");
        assert_eq!(
            power(VOLTS, &Telemetry::MOTORS.map(|kind| (kind, [0.0, 1.0]))).unwrap_err().code,
            "no_battery"
        );
    }

    #[test]
    fn numbers_that_are_no_counts_are_not_taken_for_counts() {
        // 40 % of 7.4 V with 3.7 V of back EMF, as shares and V, in % and mV, and rounded.
        for (unstated, [duty, emf, battery]) in [
            ("right_duty", [0.4, 3.7, 7.4]),
            ("right_duty", [0.4, 370.0, 1674.0]),
            ("right_duty", [40.0, 370.0, 1674.0]),
            ("right_back_emf", [1638.0, 3698.4, 1674.0]),
            ("battery", [1638.0, 370.0, 7396.9]),
        ] {
            let telemetry = Telemetry::MOTORS.map(|kind| match kind {
                RightDuty | LeftDuty => (kind, [duty; 2]),
                Battery => (kind, [battery; 2]),
                _ => (kind, [emf; 2]),
            });
            let why = power("", &telemetry).unwrap_err();
            assert_eq!(why.code, "telemetry_unit");
            assert!(why.text.contains(&format!("`{unstated}`")), "{}", why.text);
            // A battery in V says nothing of the others.
            assert!(power(VOLTS, &telemetry).is_err(), "{telemetry:?}");
        }
        // A motor that stands still has a duty of 0, and slow ones of a few percent.
        let counts = |duty| {
            let others =
                [(LeftDuty, 0.0), (RightBackEmf, 0.0), (LeftBackEmf, 0.0), (Battery, 900.0)];
            [(RightDuty, duty)].into_iter().chain(others).map(|(kind, of)| (kind, [of; 2]))
        };
        for duty in [0.0, 120.0, -3000.0] {
            let telemetry: Vec<_> = counts(duty).collect();
            assert!(power("", &telemetry).is_ok(), "{duty}");
        }
    }

    #[test]
    fn what_a_source_of_power_lacks_is_named() {
        for (there, said) in [
            (vec![RightPower], "the log has right motor power, but no left motor power:"),
            (vec![Current], "the log has current, but no battery:"),
            (
                vec![Battery, RightCurrent],
                "has right motor current, battery, but no left motor current:",
            ),
            (vec![Battery], "the log has battery, but no right motor duty, no left motor duty, no"),
            (vec![], "the log has no right motor duty, no left motor duty, no right back EMF,"),
            (vec![RightDuty, LeftDuty, Battery, RightBackEmf], "but no left back EMF:"),
        ] {
            let telemetry: Vec<_> = there.into_iter().map(|kind| (kind, [800.0; 2])).collect();
            let why = power("", &telemetry).unwrap_err();
            assert_eq!(why.code, "no_power");
            assert!(why.text.contains(said), "{}", why.text);
        }
    }
}
