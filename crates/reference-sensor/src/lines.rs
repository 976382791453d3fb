//! Samples from any program, one per line: CSV below a header line, or JSON objects.
//!
//! A column's name gives its meaning and unit, by default SI, as in a log: `fx_n`, `Mz [N·mm]`,
//! `force_x_lbf`, `time_ms`. Dots join names in nested JSON objects (`wrench.force.x`). A time is
//! on the program's clock; a column `index`, `seq`, `sequence` or `sample` numbers the samples.

use log_file::{LogFormat, Meaning, StatedUnit, meaning_of};
use serde_json::Value;
use shell_data::{Axes, Axis, PerAxis, Scale};

#[derive(Clone, Debug, PartialEq)]
pub struct LineSample {
    /// On the program's clock.
    pub time_s: Option<f64>,
    pub number: Option<i64>,
    /// Forces in N, moments in N·m; 0 for axes without a column.
    pub wrench: PerAxis<f64>,
}

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BadNames {
    #[error("no force or moment is among the names `{0}`")]
    NoLoad(String),
    #[error("the unit `{unit}` of `{name}` is not understood")]
    Unit { name: String, unit: String },
    #[error("`{0}` is there twice")]
    Twice(&'static str),
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Role {
    Time(Scale),
    Load(Axis, Scale),
    Number,
    Other,
}

#[derive(Clone, Debug, Default)]
pub struct LineReader {
    names: Vec<String>,
    roles: Vec<Role>,
    axes: Axes,
    separator: Option<char>,
}

impl LineReader {
    pub fn axes(&self) -> Axes {
        self.axes
    }

    /// Reads a line; `None` if it is a header, empty, or no valid sample. Fails with [`BadNames`]
    /// if the column names are unsuitable, so that no line can be read.
    pub fn read(&mut self, line: &str) -> Result<Option<LineSample>, BadNames> {
        let line = line.trim();
        if line.starts_with('{') {
            return self.read_object(line);
        }
        let Some(separator) = self.separator else {
            let marks = [',', ';', '\t'];
            let found = marks.into_iter().max_by_key(|mark| line.matches(*mark).count());
            let separator = found.filter(|mark| line.contains(*mark)).unwrap_or(' ');
            let names: Vec<_> = fields(line.trim_start_matches('#'), separator).collect();
            // A line of numbers or a greeting is no header.
            let is_name =
                |name: &String| name.parse::<f64>().is_err() && role_of(name).is_ok_and(is_load);
            if names.len() > 1 && names.iter().any(|name| role_of(name).is_err() || is_name(name)) {
                self.understand(names)?;
                self.separator = Some(separator);
            }
            return Ok(None);
        };
        let values: Vec<Option<f64>> =
            fields(line, separator).map(|field| field.parse().ok()).collect();
        Ok((values.len() == self.names.len()).then(|| self.sample(&values)).flatten())
    }

    fn read_object(&mut self, line: &str) -> Result<Option<LineSample>, BadNames> {
        let Ok(value) = serde_json::from_str::<Value>(line) else { return Ok(None) };
        let mut found = Vec::new();
        flatten("", &value, &mut found);
        let is_known = found.iter().map(|(name, _)| name).eq(&self.names);
        if !is_known {
            self.understand(found.iter().map(|(name, _)| name.clone()).collect())?;
        }
        let values: Vec<Option<f64>> = found.into_iter().map(|(_, value)| value).collect();
        Ok(self.sample(&values))
    }

    fn understand(&mut self, names: Vec<String>) -> Result<(), BadNames> {
        let roles = names.iter().map(|name| role_of(name)).collect::<Result<Vec<_>, _>>()?;
        let mut axes = Vec::new();
        for role in &roles {
            if let Role::Load(axis, _) = role {
                if axes.contains(axis) {
                    return Err(BadNames::Twice(axis.name()));
                }
                axes.push(*axis);
            }
        }
        if axes.is_empty() {
            return Err(BadNames::NoLoad(names.join(", ")));
        }
        // An axis that is missing from some lines is still measured.
        self.axes = Axis::ALL
            .into_iter()
            .filter(|axis| self.axes.contains(*axis) || axes.contains(axis))
            .collect();
        (self.names, self.roles) = (names, roles);
        Ok(())
    }

    /// Returns a sample if it has a load, and all its numbers are finite.
    fn sample(&self, values: &[Option<f64>]) -> Option<LineSample> {
        let mut sample = LineSample { time_s: None, number: None, wrench: [0.0; 6] };
        let mut has_load = false;
        for (role, value) in self.roles.iter().zip(values) {
            let value = value.filter(|value| value.is_finite());
            match *role {
                Role::Time(scale) => sample.time_s = Some(scale.to_si(value?)),
                Role::Load(axis, scale) => {
                    sample.wrench[axis.index()] = scale.to_si(value?);
                    has_load = true;
                }
                // Above 2⁵³, neighbouring integers are the same `f64`.
                Role::Number => sample.number = Some(value.filter(|it| it.abs() < 9e15)? as i64),
                Role::Other => {}
            }
        }
        has_load.then_some(sample)
    }
}

fn is_load(role: Role) -> bool {
    matches!(role, Role::Load(..))
}

fn role_of(name: &str) -> Result<Role, BadNames> {
    let plain: String = name.chars().filter(|c| c.is_alphanumeric()).collect();
    if ["index", "seq", "sequence", "sample"].contains(&plain.to_lowercase().as_str()) {
        return Ok(Role::Number);
    }
    let (meaning, unit) = meaning_of(name, LogFormat::Csv);
    if let (Meaning::Time(_) | Meaning::Load(..), StatedUnit::Unknown(unit)) = (meaning, &unit) {
        return Err(BadNames::Unit { name: name.to_owned(), unit: unit.clone() });
    }
    Ok(match meaning {
        Meaning::Time(scale) => Role::Time(scale),
        Meaning::Load(axis, scale) => Role::Load(axis, scale),
        _ => Role::Other,
    })
}

fn fields(line: &str, separator: char) -> impl Iterator<Item = String> {
    let all = line.split(separator).filter(move |field| separator != ' ' || !field.is_empty());
    all.map(|field| field.trim().trim_matches('"').to_owned())
}

/// Collects the numbers of an object and of nested ones; `null` is a missing number.
fn flatten(name: &str, value: &Value, found: &mut Vec<(String, Option<f64>)>) {
    match value {
        Value::Object(members) => {
            for (member, value) in members {
                let joined =
                    if name.is_empty() { member.clone() } else { format!("{name}.{member}") };
                flatten(&joined, value, found);
            }
        }
        Value::Number(number) => found.push((name.to_owned(), number.as_f64())),
        Value::Null => found.push((name.to_owned(), None)),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn samples(lines: &[&str]) -> Vec<LineSample> {
        let mut reader = LineReader::default();
        lines.iter().filter_map(|line| reader.read(line).unwrap()).collect()
    }

    #[test]
    fn units_in_names_count_and_other_columns_do_not() {
        let found = samples(&[
            "starting up, please wait",
            "time_ms,seq,Fx (mN),Fy [N],force_z_lbf,Mx [N·mm],my_nm,Tz,temperature",
            "1500,7,2500,-1,1,250,0.5,0.25,31.2",
            "1501,8,2500,-1",
            "1502,9,x,-1,1,250,0.5,0.25,31.2",
        ]);
        let wrench = [2.5, -1.0, 4.448_221_615_260_5, 0.25, 0.5, 0.25];
        assert_eq!(found, [LineSample { time_s: Some(1.5), number: Some(7), wrench }]);
    }

    #[test]
    fn objects_of_json_are_read_also_nested_ones() {
        let found = samples(&[
            r#"{"t_s": 2, "fz_n": -3.5, "status": "ok"}"#,
            r#"{"t_s": 3, "fz_n": null}"#,
            "{\"t_s\": 3, ",
            r#"{"timestamp": 4.5, "wrench": {"force": {"x": 1, "y": 2, "z": 3}, "torque": {"z": 4}}}"#,
        ]);
        let wrench = [0.0, 0.0, -3.5, 0.0, 0.0, 0.0];
        assert_eq!(found[0], LineSample { time_s: Some(2.0), number: None, wrench });
        let wrench = [1.0, 2.0, 3.0, 0.0, 0.0, 4.0];
        assert_eq!(found[1..], [LineSample { time_s: Some(4.5), number: None, wrench }]);
    }

    #[test]
    fn names_that_cannot_be_meant_are_refused() {
        let refused = |line: &str| LineReader::default().read(line).unwrap_err();
        let unit = BadNames::Unit { name: "fx [V]".to_owned(), unit: "V".to_owned() };
        assert_eq!(refused("t,fx [V]"), unit);
        assert_eq!(refused("fx_n,force_x"), BadNames::Twice("Fx"));
        assert_eq!(refused(r#"{"a": 1}"#), BadNames::NoLoad("a".to_owned()));
    }

    proptest! {
        #[test]
        fn any_lines_are_survived(lines in prop::collection::vec(".{0,60}", 0..20)) {
            let mut reader = LineReader::default();
            for line in lines {
                _ = reader.read(&line);
            }
        }
    }
}
