//! Calibrations of ATI's force/torque sensors: XML files `.cal`.
//!
//! A `UserAxis` element is a row of a linear matrix: the contribution of one volt of each gauge to
//! that axis, in the units of `Calibration`. `Axis` elements hold the same matrix, scaled and
//! shifted, for ATI's own library.

use calibration::Calibration;
use calibration::model::{Basis, MAX_CHANNELS, Model};
use shell_data::wrench::{Axes, Axis, PerAxis};
use shell_data::{Quantity, Scale, Unit};

use super::matrix::{ImportOptions, divisor, from_raw_readings};

pub(super) fn is_one(bytes: &[u8]) -> bool {
    memchr::memmem::find(bytes, b"<FTSensor").is_some() && !bytes.contains(&0)
}

pub(super) fn parse(bytes: &[u8], options: &ImportOptions) -> Result<Calibration, String> {
    let text = without_comments(&String::from_utf8_lossy(bytes));
    let head = elements(&text, "Calibration").next().ok_or("it has no element `Calibration`")?;
    let gain = attribute(head, "GainMultiplier").unwrap_or("1");
    ensure!(
        gain.parse() == Ok(1.0),
        "its `GainMultiplier` is `{gain}`, only 1 is known to leave voltages as they are"
    );
    let scale = |name: &str, quantity| {
        let found = attribute(head, name).unwrap_or_default();
        let unit = Unit::parse(found, quantity).map(|unit| unit.scale);
        unit.ok_or_else(|| format!("its `{name}` are `{found}`, which is not understood"))
    };
    let force = scale("ForceUnits", Quantity::Force)?;
    let moment = match options.moment_unit {
        Some(unit) => Scale::per_si(divisor(unit)),
        None => scale("TorqueUnits", Quantity::Moment)?,
    };
    let mut rows: PerAxis<Vec<f64>> = PerAxis::default();
    for element in elements(&text, "UserAxis") {
        let name = attribute(element, "Name").unwrap_or_default();
        let is_named = |axis: &Axis| axis.name() == name || axis.name().replace('M', "T") == name;
        let axis = Axis::ALL.into_iter().find(is_named);
        let axis = axis.ok_or_else(|| format!("its `UserAxis` `{name}` is no axis"))?;
        let values: Option<Vec<f64>> = attribute(element, "values")
            .unwrap_or_default()
            .split_whitespace()
            .map(|value| value.parse().ok().filter(|value: &f64| value.is_finite()))
            .collect();
        let values = values.filter(|all| (1..=MAX_CHANNELS).contains(&all.len()));
        let values = values.ok_or_else(|| format!("its `values` of `{name}` are no numbers"))?;
        let row = &mut rows[axis.index()];
        ensure!(row.is_empty(), "its `UserAxis` `{name}` comes twice");
        *row = values;
    }
    let axes: Axes = Axis::ALL.into_iter().filter(|axis| !rows[axis.index()].is_empty()).collect();
    let channels = rows.iter().map(Vec::len).max().unwrap_or(0);
    ensure!(channels > 0, "it has no elements `UserAxis`");
    let is_whole = rows.iter().all(|row| row.is_empty() || row.len() == channels);
    ensure!(is_whole, "its elements `UserAxis` do not have as many `values` as each other");
    let model = Model { basis: Basis::Linear, intercept: false, channels, memory: 0 };
    let coefficients = (0..channels).map(|channel| {
        let mut of_channel = PerAxis::default();
        for axis in axes.iter() {
            let scale = if axis.is_moment() { moment } else { force };
            of_channel[axis.index()] = scale.to_si(rows[axis.index()][channel]);
        }
        of_channel
    });
    let mut calibration = from_raw_readings(model, coefficients.collect())?;
    calibration.axes = axes;
    Ok(calibration)
}

fn without_comments(text: &str) -> String {
    let mut parts = text.split("<!--");
    let first = parts.next().unwrap_or_default().to_owned();
    parts.fold(first, |all, part| all + part.split_once("-->").map_or("", |(_, after)| after))
}

/// The text of every opening tag `name`, without the name.
fn elements<'a>(text: &'a str, name: &'a str) -> impl Iterator<Item = &'a str> {
    text.split('<').filter_map(move |part| {
        let rest = part.strip_prefix(name)?;
        let is_whole = rest.starts_with(|next: char| next.is_whitespace() || "/>".contains(next));
        is_whole.then(|| rest.split('>').next())?
    })
}

fn attribute<'a>(tag: &'a str, wanted: &str) -> Option<&'a str> {
    let mut rest = tag;
    loop {
        let (name, after) = rest.split_once('=')?;
        let after = after.trim_start();
        let quote = after.chars().next().filter(|quote| matches!(quote, '"' | '\''))?;
        let (value, next) = after[1..].split_once(quote)?;
        if name.trim() == wanted {
            return Some(value.trim());
        }
        rest = next;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "<?xml version=\"1.0\"?>\n<!-- use the \"UserAxis\" elements <UserAxis/> -->\n<FTSensor Serial=\"FT1\">\n";

    fn import(units: &str, rows: &str) -> Result<Calibration, String> {
        let text = format!("{HEAD}<Calibration {units}>\n{rows}</Calibration>\n</FTSensor>\n")
            .into_bytes();
        assert!(is_one(&text));
        parse(&text, &ImportOptions::default())
    }

    #[test]
    fn rows_are_forces_per_volt_in_the_units_of_the_file() {
        let rows = "<Axis Name=\"Fz\" values=\"9 9 9\" scale=\"2\"/>\n\
                    <UserAxis Name=\"Fz\" values=\" -0.5  2 1e-1 \" max=\"40\"/>\n\
                    <UserAxis max=\"4\" Name = 'Tx' values='1 0 -3'/>\n";
        for (units, force, moment) in [
            ("ForceUnits=\"N\" TorqueUnits=\"N-m\" GainMultiplier=\"1\"", 1.0, 1.0),
            ("ForceUnits=\"N\" TorqueUnits=\"N-mm\"", 1.0, 1e-3),
            (
                "ForceUnits=\"lb\" TorqueUnits=\"lb-in\"",
                4.448_221_615_260_5,
                0.112_984_829_027_616_7,
            ),
        ] {
            let calibration = import(units, rows).unwrap();
            assert_eq!(calibration.axes, [Axis::Fz, Axis::Mx].into_iter().collect());
            assert_eq!(calibration.name(), "linear");
            let coefficients = &calibration.polynomial().unwrap().coefficients;
            for (row, [fz, mx]) in coefficients.iter().zip([[-0.5, 1.0], [2.0, 0.0], [0.1, -3.0]]) {
                let expected = [0.0, 0.0, fz * force, mx * moment, 0.0, 0.0];
                for (found, expected) in row.iter().zip(expected) {
                    // Two roundings.
                    assert!((found - expected).abs() <= 4e-16 * expected.abs(), "{units}: {row:?}");
                }
            }
        }
    }

    #[test]
    fn unknown_elements_are_refused_by_name() {
        let units = "ForceUnits=\"N\" TorqueUnits=\"N-m\"";
        let row = "<UserAxis Name=\"Fx\" values=\"1 2\"/>";
        for (units, rows, expected) in [
            ("TorqueUnits=\"N-m\"", row, "`ForceUnits` are ``"),
            ("ForceUnits=\"N\" TorqueUnits=\"V\"", row, "`TorqueUnits` are `V`"),
            (&format!("{units} GainMultiplier=\"4\""), row, "`GainMultiplier` is `4`"),
            (units, "", "no elements `UserAxis`"),
            (units, "<UserAxis Name=\"Fq\" values=\"1 2\"/>", "`Fq` is no axis"),
            (units, "<UserAxis Name=\"Fx\" values=\"1 x\"/>", "`values` of `Fx`"),
            (units, "<UserAxis Name=\"Fx\" values=\"1 inf\"/>", "`values` of `Fx`"),
            (units, "<UserAxis Name=\"Fx\"/>", "`values` of `Fx`"),
            (units, &format!("{row}{row}"), "`Fx` comes twice"),
            (units, &format!("{row}<UserAxis Name=\"Tz\" values=\"1\"/>"), "as many `values`"),
        ] {
            let said = import(units, rows).unwrap_err();
            assert!(said.contains(expected), "{rows}: {said}");
        }
    }
}
