//! What the rig can do.

use anyhow::Context;
use load_table::{Combinations, HungLoads, WrenchBox};

use crate::cmd::choices::numbers;
use crate::files::InputPath;

#[derive(Debug, clap::Args)]
#[command(next_help_heading = "What the rig can do")]
#[group(skip)]
pub(super) struct RigArgs {
    /// A table with one line for each load that can be hung: mass or force, point, direction, or the wrench
    #[arg(long, value_name = "LOADS.csv", conflicts_with_all = ["masses", "points", "directions", "wrench_box"])]
    rig: Option<InputPath>,

    /// Masses that can be hung, such as 100g,0.5kg
    #[arg(long, value_name = "MASSES", value_delimiter = ',', value_parser = parse_mass, requires = "directions")]
    masses: Vec<f64>,

    /// A point where they can be hung, in mm from the sensor's origin, such as 30,0,40; may be given again
    #[arg(long = "point", value_name = "X,Y,Z", value_parser = parse_point, allow_hyphen_values = true, requires = "masses")]
    points: Vec<[f64; 3]>,

    /// Directions in which they can pull: down, up, +x … -z, or azimuth and elevation in degrees, such as 30:-45
    #[arg(long, value_name = "DIRECTIONS", value_delimiter = ',', value_parser = parse_direction, allow_hyphen_values = true, requires = "masses")]
    directions: Vec<String>,

    /// Ranges of the axes, for a rig that presses any wrench: fx=-5..5,fz=-10..0,my=-0.2..0.2 (N and N·m)
    #[arg(long = "box", value_name = "RANGES", value_parser = WrenchBox::parse, conflicts_with = "masses")]
    wrench_box: Option<WrenchBox>,
}

impl RigArgs {
    /// The loads; `None` where nothing is said of a rig.
    pub(super) fn table(&self) -> anyhow::Result<Option<HungLoads>> {
        if let Some(path) = &self.rig {
            return read_table(path).map(Some);
        }
        if let Some(wrench_box) = &self.wrench_box {
            return Ok(Some(wrench_box.table()?));
        }
        if self.masses.is_empty() {
            return Ok(None);
        }
        let points_mm = match self.points.is_empty() {
            true => vec![[0.0; 3]],
            false => self.points.clone(),
        };
        let (masses_kg, directions) = (self.masses.clone(), self.directions.clone());
        Ok(Some(Combinations { masses_kg, points_mm, directions }.table()?))
    }
}

/// Reads a table of loads.
pub(crate) fn read_table(path: &InputPath) -> anyhow::Result<HungLoads> {
    let name = || format!("`{}`", path.display());
    let text = std::fs::read_to_string(path).with_context(name)?;
    HungLoads::parse(&text).with_context(name)
}

fn parse_mass(text: &str) -> Result<f64, String> {
    let text = text.trim();
    let (number, unit) = match text.strip_suffix("kg") {
        Some(number) => (number, 1.0),
        None => (text.strip_suffix('g').unwrap_or_default(), 1e-3),
    };
    let mass = number.trim().parse::<f64>().ok().map(|mass| mass * unit);
    let mass = mass.filter(|mass| mass.is_finite() && *mass >= 0.0);
    mass.ok_or_else(|| "expected a mass with its unit, such as 100g or 0.5kg".to_owned())
}

fn parse_point(text: &str) -> Result<[f64; 3], String> {
    numbers(text).ok_or_else(|| "expected three coordinates in mm, such as 30,0,40".to_owned())
}

fn parse_direction(text: &str) -> Result<String, String> {
    let known = ["down", "up", "+x", "-x", "+y", "-y", "+z", "-z", "x", "y", "z"];
    let is_angle = |text: &str| text.parse::<f64>().is_ok_and(f64::is_finite);
    let is_angles = text.split_once(':').is_some_and(|(a, e)| is_angle(a) && is_angle(e));
    match known.contains(&text) || is_angles {
        true => Ok(text.to_owned()),
        false => Err("expected down, up, +x … -z, or AZIMUTH:ELEVATION in degrees".to_owned()),
    }
}
