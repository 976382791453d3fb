//! Loads that a rig can apply, as masses, points and directions, or as a box.

use std::fmt::Write as _;

use super::table::HungLoads;
use shell_data::wrench::{Axis, PerAxis};

const MOST: usize = 20_000;

/// Combines every mass (kg), point (mm from the origin) and direction: a word as in the column
/// `direction`, or azimuth and elevation in degrees: `30:-45`.
///
/// # Errors
/// A message about a wrong direction, or too many loads.
pub fn combinations(
    masses_kg: &[f64],
    points_mm: &[[f64; 3]],
    directions: &[String],
) -> Result<HungLoads, String> {
    let count = masses_kg.len() * points_mm.len() * directions.len();
    if count > MOST {
        return Err(format!(
            "`{count}` loads are too many, at most `{MOST}`: give fewer masses, points or directions"
        ));
    }
    let mut text = "group,mass_kg,x_mm,y_mm,z_mm,direction,azimuth_deg,elevation_deg\n".to_owned();
    let mut number = 0;
    for mass in masses_kg {
        for [x, y, z] in points_mm {
            for direction in directions {
                let how = match direction.split_once(':') {
                    Some((azimuth, elevation)) => format!(",{azimuth},{elevation}"),
                    None => format!("{direction},,"),
                };
                number += 1;
                writeln!(text, "{number},{mass},{x},{y},{z},{how}").expect("a string takes all");
            }
        }
    }
    HungLoads::parse(&text).map_err(|error| error.to_string())
}

/// Ranges of the wrench's axes: `fx=-5..5,fz=-10..0,my=-0.2..0.2`, in N and N·m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WrenchBox(PerAxis<[f64; 2]>);

impl WrenchBox {
    /// Parses ranges; other axes stay at 0.
    ///
    /// # Errors
    /// A message with the part of the text that is not a range of an axis.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut ranges = [[0.0; 2]; 6];
        for part in text.split(',') {
            let fault = || {
                format!("`{part}` is not a range such as `fx=-5..5` (N) or `my=-0.2..0.2` (N·m)")
            };
            let (name, range) = part.split_once('=').ok_or_else(fault)?;
            let (low, high) = range.split_once("..").ok_or_else(fault)?;
            let name = name.trim().to_lowercase();
            let is_named =
                |axis: &&Axis| axis.name().to_lowercase() == name || axis.column() == name;
            let axis = Axis::ALL.iter().find(is_named).ok_or_else(fault)?;
            let number = |text: &str| text.trim().parse().ok().filter(|x: &f64| x.is_finite());
            let (low, high): (f64, f64) =
                number(low).zip(number(high)).filter(|(low, high)| low < high).ok_or_else(fault)?;
            ranges[axis.index()] = [low, high];
        }
        Ok(Self(ranges))
    }

    /// Returns all combinations of both ends and the middle of each axis, labelled from 1: the
    /// candidates of an optimal second-order design (a 3ᵏ factorial; Box & Draper, Response
    /// Surfaces, 2nd ed., §11.3).
    pub fn table(&self) -> HungLoads {
        let Self(ranges) = self;
        let mut rows = vec![[0.0; 6]];
        for (axis, &[low, high]) in ranges.iter().enumerate().filter(|(_, [low, high])| low < high)
        {
            let middle = if low < 0.0 && high > 0.0 { 0.0 } else { f64::midpoint(low, high) };
            let with = |row: &PerAxis<f64>| {
                [low, middle, high].map(|value| {
                    let mut row = *row;
                    row[axis] = value;
                    row
                })
            };
            rows = rows.iter().flat_map(with).collect();
        }
        let labelled = (1..).zip(rows).map(|(number, row): (usize, _)| (number.to_string(), row));
        HungLoads::from_wrenches(labelled).expect("a table of finite numbers")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn combinations_are_all_of_them() {
        let points_mm = [[0.0, 0.0, 40.0], [30.0, 0.0, 40.0]];
        let directions = ["+x", "30:-45", "down"].map(str::to_owned);
        let table = combinations(&[0.1, 0.5], &points_mm, &directions).unwrap();
        assert_eq!(table.loads().len(), 12);
        assert_eq!(table.loads()[11].to_string(), "0.5 kg at (30, 0, 40) mm, down");
        assert_eq!(table.loads()[11].group, "12");
        let refused = combinations(&[1.0; 10_000], &points_mm, &directions).unwrap_err();
        assert!(refused.starts_with("`60000` loads are too many"), "{refused}");
    }

    #[test]
    fn a_box_has_its_corners_and_middles() {
        let table = WrenchBox::parse("fx=-2..4, mz_nm=0.1..0.3").unwrap().table();
        assert_eq!(table.loads().len(), 9);
        let first = table.loads()[0].wrench();
        assert_eq!(first, [-2.0, 0.0, 0.0, 0.0, 0.0, 0.1]);
        assert_eq!(table.loads()[4].wrench()[0], 0.0);
        assert!((table.loads()[4].wrench()[5] - 0.2).abs() < 1e-15);
        for wrong in ["fx=1", "fx=2..1", "gx=1..2", "fx=nan..2", ""] {
            assert!(WrenchBox::parse(wrong).is_err(), "{wrong}");
        }
    }
}
