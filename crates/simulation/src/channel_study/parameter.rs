//! Parameters of a channel by name, and grids over all combinations of values.

use beam_channel::{Setup, SetupError};

use super::summary::{ChannelSummary, summarise};

use Dimension::{Angle, Length, Number, Pressure};

#[derive(Clone, Copy, Debug)]
pub struct Parameter {
    pub name: &'static str,
    pub dimension: Dimension,
    position: Position,
}

type Position = fn(&mut Setup) -> &mut f64;

/// The physical dimension, with its SI unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dimension {
    /// m.
    Length,
    /// Pa.
    Pressure,
    /// rad.
    Angle,
    /// Dimensionless.
    Number,
}

impl Parameter {
    pub const WIDTH: Self = Self::new("width", Length, |setup| &mut setup.channel.width_m);

    /// All parameters: the body's semi-axes along and across its path, the channel and the beam, and the body's offset
    /// and the rotation of its nose, both to the left.
    pub const ALL: [Self; 11] = [
        Self::new("rx", Length, |setup| &mut setup.ellipse.semi_length_m),
        Self::new("ry", Length, |setup| &mut setup.ellipse.semi_width_m),
        Self::WIDTH,
        Self::new("beam-length", Length, |setup| &mut setup.beam.length_m),
        Self::new("beam-width", Length, |setup| &mut setup.beam.width_m),
        Self::new("thickness", Length, |setup| &mut setup.beam.thickness_m),
        Self::new("modulus", Pressure, |setup| &mut setup.beam.flexural_modulus_pa),
        Self::new("friction", Number, |setup| &mut setup.beam.friction),
        Self::new("spacing", Length, |setup| &mut setup.channel.pitch_m),
        Self::new("off-centre", Length, |setup| &mut setup.pose.offset_m),
        Self::new("yaw", Angle, |setup| &mut setup.pose.yaw_rad),
    ];

    const fn new(name: &'static str, dimension: Dimension, position: Position) -> Self {
        Self { name, dimension, position }
    }

    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|parameter| parameter.name == name)
    }

    pub fn column(self) -> String {
        let unit = match self.dimension {
            Length => "_m",
            Pressure => "_pa",
            Angle => "_rad",
            Number => "",
        };
        self.name.replace('-', "_") + unit
    }

    pub fn get(self, setup: &Setup) -> f64 {
        *(self.position)(&mut setup.clone())
    }

    /// Sets only this parameter, so a wider body reaches further between the beams.
    pub fn set(self, setup: &mut Setup, value: f64) {
        *(self.position)(setup) = value;
    }
}

#[derive(Clone, Debug)]
pub struct GridAxis {
    pub parameter: Parameter,
    /// Values in SI units.
    pub values: Vec<f64>,
}

#[derive(Clone, Debug)]
pub struct GridCell {
    pub values: Vec<f64>,
    pub outcome: Result<ChannelSummary, SetupError>,
}

/// Returns every combination of the values, the last axis changing fastest, around `setup`.
pub fn grid<'a>(setup: &'a Setup, axes: &'a [GridAxis]) -> impl Iterator<Item = GridCell> + 'a {
    let count: usize = axes.iter().map(|axis| axis.values.len()).product();
    (0..count).map(move |mut number| {
        let mut values = vec![0.0; axes.len()];
        for (axis, value) in axes.iter().zip(&mut values).rev() {
            *value = axis.values[number % axis.values.len()];
            number /= axis.values.len();
        }
        let mut changed = *setup;
        for (axis, &value) in axes.iter().zip(&values) {
            axis.parameter.set(&mut changed, value);
        }
        GridCell { values, outcome: summarise(&changed) }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_combination_is_there_and_a_jam_does_not_stop_the_others() {
        let axes = [
            GridAxis { parameter: Parameter::named("friction").unwrap(), values: vec![0.0, 0.53] },
            GridAxis {
                parameter: Parameter::named("beam-length").unwrap(),
                values: vec![0.001, 0.027, 0.05],
            },
        ];
        let cells: Vec<_> = grid(&Setup::default(), &axes).collect();
        let values: Vec<_> = cells.iter().map(|cell| (cell.values[0], cell.values[1])).collect();
        let expected =
            [(0.0, 0.001), (0.0, 0.027), (0.0, 0.05), (0.53, 0.001), (0.53, 0.027), (0.53, 0.05)];
        assert_eq!(values, expected);
        assert!(matches!(cells[3].outcome, Err(SetupError::Jams { .. })));
        let mean = cells[4].outcome.as_ref().unwrap().mean_drag_n.unwrap();
        assert!((mean / 0.108734173433852 - 1.0).abs() < 1e-12);
    }
}
