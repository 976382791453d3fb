//! More than two hundred spellings of units, compared with other programs that parse units.
//!
//! Pint 0.25.3 (Python) and UDUNITS 2 (cf-units 3.3.1) gave the sizes in SI units. The table lists the spellings that
//! Pint accepts, those that only UDUNITS accepts, then the rest. For the rest, Pint gave the size of the product
//! written out (`lbf * inch`): Pint reads `N-m` as a difference, UDUNITS `oz` as a volume, and neither accepts a mass
//! for its weight, words without a separator, or capitals.

use std::f64::consts::PI;

use shell_data::Quantity::{
    self, Acceleration, Angle, Current, Force, Moment, Power, Share, Time, Voltage,
};
use shell_data::Unit;

/// Pound-force and ounce-force in N, standard gravity in m/s²; inch and foot in m.
const LBF: f64 = 4.448_221_615_260_5;
const OZF: f64 = LBF / 16.0;
const G: f64 = 9.806_65;
const INCH: f64 = 0.0254;
const FOOT: f64 = 0.3048;

/// Quantity, size in SI units, and spellings: accepted by Pint, by UDUNITS alone, and the rest.
#[rustfmt::skip]
const SPELLINGS: &[(Quantity, f64, &str, &str, &str)] = &[
    (Force, 1e0, "N|newtons|kg m/s^2|kg*m/s**2|kg m s^-2|kg·m/s²|kg·m·s⁻²|kilogram meter per second squared", "Newton|Newtons|NEWTON|kg.m/s2|kg m s-2", "n"),
    (Force, 1e-3, "mN|millinewton", "milliNewtons", "mn"),
    (Force, 1e-6, "uN|µN|μN|micronewton", "", ""),
    (Force, 1e-9, "nN", "", ""),
    (Force, 1e-2, "cN", "", ""),
    (Force, 1e-1, "dN", "", ""),
    (Force, 1e1, "daN|decanewton", "", ""),
    (Force, 1e3, "kN|kilonewton|kilonewtons", "", "KN|kn"),
    (Force, 1e6, "MN|meganewton", "", ""),
    (Force, 1e9, "GN", "", ""),
    (Force, LBF, "lbf|pound_force", "pound-force|pounds-force|pound force", "LBF|Lbf|lbsf|lbs|lb|LB|pound|pounds|lb-f|lb_f|lb.f"),
    (Force, 1e3 * LBF, "klbf|kip", "", ""),
    (Force, OZF, "ozf|ounce_force", "", "oz|ounce|ounces|ounce-force|ozF"),
    (Force, 1e-3 * G, "gf|gram_force|pond", "gram-force", "g|gram|grams"),
    (Force, 1e-6 * G, "mgf", "", "mg"),
    (Force, G, "kgf|kilogram_force|kilopond", "kilogram-force", "Kgf|KGF|kg|kilogram|kilograms|kg-f|kg·f|kp"),
    (Force, 1e-5, "dyn|dyne|dynes|g cm/s^2", "", ""),
    (Moment, 1e0, "N m|N.m|N*m|N·m|N⋅m|N×m|N•m|m.N|m·N|m N|m*N|newton meter|newton metre|newton meters|kg m^2/s^2|kg·m²/s²|kN mm", "N-m|newton-meter|Newton-meters|kg m2 s-2", "Nm|NM|nm|N_m|newton_meter|newtonmeter|kNmm"),
    (Moment, 1e-3, "mN m|mN.m|mN*m|mN·m|millinewton meter|N mm|N.mm|N*mm|N·mm|mm.N|mm N|mm*N|mm·N|newton millimeter|newton millimetres", "mN-m|N-mm|newton-millimeter", "mNm|mnm|mN_m|Nmm|nmm"),
    (Moment, 1e-2, "N cm|N.cm|N*cm|N·cm|cN m|cN·m", "N-cm", "Ncm|ncm|cNm|N∙cm"),
    (Moment, 1e-1, "dN m", "", ""),
    (Moment, 1e1, "daN m", "", "daNm"),
    (Moment, 1e3, "kN m|kN.m|kN·m", "kN-m", "kNm"),
    (Moment, 1e6, "MN m|MN·m", "", "MNm"),
    (Moment, 1e-6, "mN mm|mN·mm|µN m|µN·m|uN m", "", "mNmm|uNm"),
    (Moment, LBF * INCH, "lbf in|lbf.in|lbf*in|lbf·in|in.lbf|in lbf|pound_force*inch", "lbf-in|in-lbf|pound-force inch", "lbf_in|lbfin|in-lb|inlb|in-lbs|lb-in|lb in|lbin|LBF-IN|inch-pound|inch pounds|pound-inch|inch-pounds|in·lb"),
    (Moment, LBF * FOOT, "lbf ft|lbf.ft|lbf*ft|lbf·ft|ft lbf|ft*lbf|foot_pound", "lbf-ft|ft-lbf", "lbfft|ft-lb|ftlb|ft-lbs|lb-ft|lbft|foot-pound|foot pounds|pound-feet|lb·ft|ft·lbs|foot-pounds"),
    (Moment, OZF * INCH, "ozf in|ozf·in|ozf*in|ozf.in|in·ozf", "", "ozf-in|oz-in|oz in|ozin|in-oz|ounce-inch"),
    (Moment, G, "kgf m|kgf*m|kgf·m", "kgf-m", "kgfm|kg-m"),
    (Moment, 1e-2 * G, "kgf cm|kgf*cm|kgf·cm", "kgf-cm", "kgfcm|kg-cm|kg cm|kg·cm|kgcm"),
    (Moment, 1e-3 * G, "kgf mm|kgf.mm|gf m", "", ""),
    (Moment, 1e-5 * G, "gf cm|gf·cm", "gf-cm", "gfcm|g cm|g-cm|gcm"),
    (Moment, 1e-6 * G, "gf mm", "", ""),
    (Moment, 1e-7, "dyn cm|dyn*cm", "dyne-cm", ""),
    (Time, 1e0, "s|sec|secs|second|seconds", "Sec|Seconds|seconds since 1970-01-01", "S"),
    (Time, 1e-3, "ms|msec|msecs|millisecond|milliseconds|millis", "milliseconds since 2024-01-01 00:00:00", ""),
    (Time, 1e-6, "us|µs|μs|usec|microsecond|microseconds|micros", "", ""),
    (Time, 1e-9, "ns|nsec|nanosecond|nanoseconds|nanos", "", ""),
    (Time, 60.0, "min|mins|minute|minutes", "", ""),
    (Time, 3600.0, "h|hr|hrs|hour|hours", "hours since 1970-01-01", ""),
    (Time, 86400.0, "d|day|days", "", ""),
    (Angle, 1e0, "rad|radian|radians", "", ""),
    (Angle, 1e-3, "mrad|milliradian", "", ""),
    (Angle, PI / 180.0, "deg|degree|degrees|°", "", ""),
    (Angle, 2.0 * PI, "rev|revolution|revolutions", "", ""),
    (Share, 1e0, "1|m/m|V/V", "", ""),
    (Share, 1e-2, "%|percent", "", "pct"),
    (Share, 1e-3, "mV/V", "", ""),
    (Voltage, 1e0, "V|volt|volts|W/A", "Volts", "v"),
    (Voltage, 1e-3, "mV|millivolt|millivolts", "", "mv"),
    (Current, 1e0, "A|amp|ampere|amps", "Ampere", "a"),
    (Current, 1e-3, "mA|milliampere", "", "ma"),
    (Current, 1e-6, "µA|uA|microamps", "", ""),
    (Power, 1e0, "W|watt|watts|V A|V*A", "", "w|VA"),
    (Power, 1e-3, "mW|milliwatt|milliwatts", "", "mw"),
    (Acceleration, 1e0, "m/s^2|m/s²|m/s**2|m s^-2|m·s⁻²|m*s^-2|m/s/s|meter/second^2|meters per second squared", "m/s2|m s-2", ""),
    (Acceleration, 1e-3, "mm/s^2", "", ""),
    (Acceleration, 1e-2, "cm/s^2|cm/s²", "", ""),
    (Acceleration, FOOT, "ft/s^2", "", ""),
    (Acceleration, INCH, "in/s^2", "", ""),
    (Acceleration, G, "", "", "g"),
    (Acceleration, 1e-3 * G, "", "", "mg"),
];

#[test]
fn spellings_have_the_sizes_that_other_programs_give() {
    let mut count = 0;
    for &(quantity, size, pint, udunits, rest) in SPELLINGS {
        let spellings = [pint, udunits, rest].into_iter().flat_map(|list| list.split('|'));
        for spelling in spellings.filter(|spelling| !spelling.is_empty()) {
            let unit = Unit::parse(spelling, quantity);
            let found =
                unit.unwrap_or_else(|| panic!("{quantity:?} `{spelling}`")).scale.to_si(1.0);
            // Allows for a few roundings of the product of factors.
            assert!((found / size - 1.0).abs() < 1e-14, "{quantity:?} `{spelling}`: {found}");
            count += 1;
        }
    }
    assert!(count > 300, "{count}");
}

#[test]
fn units_of_other_quantities_and_other_words_are_refused() {
    for (quantity, spellings) in [
        (
            Force,
            "N/mm|N/m|N·m|Nm|lbf/in|Pa|V|mV|counts|kgf/cm²|psi|m|in|s|g/s|t|ton|N2|-|?|N/|/N|N^|x|filtered|MMN",
        ),
        (Moment, "N|mN|N/mm|N/m|lbf|lbf/in|MNM|NMM|J|kgf|m|mm|Nm/rad|N·m·s|N·m²|lbf·in²|V|N--|·"),
        (Time, "Hz|1/s|s^2|Ms|m|MS|NS|frames|samples|ticks|seconds before|%|N·s|us/s"),
        (Angle, "rad/s|deg/s|gon|turns|°C|mdeg"),
        (Acceleration, "m/s|m|m/s^3|rad/s^2|g/s|N/kg m|kg"),
        (Share, "counts|V|rad|2|1/s|%%%"),
        (Voltage, "MV|A|mA|W|counts|raw|m|V/s|V·m|%"),
        (Current, "MA|V|mV|Ah|1"),
        (Power, "V|A|J|hp|N·m"),
    ] {
        for spelling in spellings.split('|') {
            assert_eq!(Unit::parse(spelling, quantity), None, "{quantity:?} `{spelling}`");
        }
    }
}

#[test]
fn a_unit_is_shown_in_one_way() {
    for (quantity, spelling, shown) in [
        (Moment, "lbf-in", "lbf·in"),
        (Moment, "mm.N", "mm·N"),
        (Moment, "mnm", "mN·m"),
        (Moment, "kg cm", "kgf·cm"),
        (Force, "Newtons", "N"),
        (Force, "grams", "gf"),
        (Time, "usec", "µs"),
        (Time, "milliseconds since 1970-01-01", "ms"),
        (Acceleration, "m/s2", "m·s⁻²"),
    ] {
        assert_eq!(Unit::parse(spelling, quantity).unwrap().symbol, shown, "{spelling}");
    }
}

#[test]
fn metric_units_only_divide_by_powers_of_ten() {
    // A division rounds correctly: a log in mN reads like one in N with the decimal point moved.
    let scale = |text| Unit::parse(text, Moment).unwrap().scale;
    assert_eq!((scale("N·mm").times, scale("N·mm").per), (1.0, 1e3));
    assert_eq!(scale("mNm"), scale("mm.N"));
}
