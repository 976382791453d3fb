//! A channel for every combination of parameter values.

use beam_channel::{Setup, SetupError};

use super::parameter::Parameter;
use super::summary::{ChannelSummary, summarise};

/// A parameter and the values it takes.
#[derive(Clone, Debug)]
pub struct GridAxis {
    /// The parameter.
    pub parameter: Parameter,
    /// Its values, SI.
    pub values: Vec<f64>,
}

/// One combination.
#[derive(Clone, Debug)]
pub struct GridCell {
    /// A value of every axis.
    pub values: Vec<f64>,
    /// What it comes to.
    pub outcome: Result<ChannelSummary, SetupError>,
}

/// Every combination of the values of `axes`, the last axis changing fastest; other parameters as
/// in `setup`.
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
        // The reference value of the crate's tests.
        let mean = cells[4].outcome.as_ref().unwrap().mean_drag_n.unwrap();
        assert!((mean / 0.108734173433852 - 1.0).abs() < 1e-12);
    }
}
