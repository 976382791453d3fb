//! What is not known of the parameters, carried to the forces.

use beam_channel::Setup;
use serde::Serialize;

use super::parameter::Parameter;
use super::summary::{ChannelSummary, summarise};
use shell_data::random::{Purpose, RandomStream};
use shell_data::statistics::quantile;

/// A parameter that is not known exactly: normal about its value.
#[derive(Clone, Copy, Debug)]
pub struct Uncertain {
    /// The parameter.
    pub parameter: Parameter,
    /// How well it is known.
    pub spread: ParameterSpread,
}

/// A standard deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ParameterSpread {
    /// SI.
    Absolute(f64),
    /// As a share of the parameter's value.
    Relative(f64),
}

/// The figures of many channels that all may be the true one.
#[derive(Clone, Debug, Serialize)]
pub struct MonteCarlo {
    /// Channels drawn.
    pub draws: usize,
    /// Of those, channels that make no sense or in which the body jams; they are in no figure.
    pub refused: usize,
    /// Of those, channels without a plateau; they are in no figure but the energy's.
    pub without_plateau: usize,
    /// The share of the channels that lies within an interval.
    pub level: f64,
    /// Mean drag on the plateau in N.
    pub mean_drag_n: Option<DrawStatistics>,
    /// Greatest drag on the plateau in N.
    pub peak_drag_n: Option<DrawStatistics>,
    /// Smallest drag on the plateau in N.
    pub minimum_drag_n: Option<DrawStatistics>,
    /// Work of one crossing in J.
    pub energy_j: Option<DrawStatistics>,
}

/// A figure over all draws.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct DrawStatistics {
    /// As many of the draws are below this as above [`high`](Self::high).
    pub low: f64,
    /// Half of the draws are below.
    pub median: f64,
    /// See [`low`](Self::low).
    pub high: f64,
    /// Mean.
    pub mean: f64,
    /// Standard deviation.
    pub sd: f64,
}

/// Draws `draws` channels about `setup` and works them out; equal seeds give equal draws for every
/// channel, so that two channels differ by what differs between them. `progress` is given the draws
/// that are done.
pub fn monte_carlo(
    setup: &Setup,
    uncertain: &[Uncertain],
    draws: usize,
    seed: u64,
    level: f64,
    progress: &dyn Fn(usize),
) -> MonteCarlo {
    let mut summaries = Vec::with_capacity(draws);
    for draw in 0..draws {
        summaries.extend(summarise(&drawn(setup, uncertain, seed, draw)));
        progress(draw + 1);
    }
    let over = |figure: fn(&ChannelSummary) -> Option<f64>| {
        DrawStatistics::new(summaries.iter().filter_map(figure).collect(), level)
    };
    MonteCarlo {
        draws,
        refused: draws - summaries.len(),
        without_plateau: summaries.iter().filter(|all| all.mean_drag_n.is_none()).count(),
        level,
        mean_drag_n: over(|summary| summary.mean_drag_n),
        peak_drag_n: over(|summary| summary.peak_drag_n),
        minimum_drag_n: over(|summary| summary.minimum_drag_n),
        energy_j: over(|summary| Some(summary.energy_j)),
    }
}

fn drawn(setup: &Setup, uncertain: &[Uncertain], seed: u64, draw: usize) -> Setup {
    let mut stream = RandomStream::new(seed, Purpose::BeamChannel, draw as u64);
    let mut drawn = *setup;
    for Uncertain { parameter, spread } in uncertain {
        let value = parameter.get(setup);
        let sd = match *spread {
            ParameterSpread::Absolute(sd) => sd,
            ParameterSpread::Relative(share) => share * value.abs(),
        };
        parameter.set(&mut drawn, value + sd * stream.normal());
    }
    drawn
}

impl DrawStatistics {
    /// `None` without values.
    fn new(mut values: Vec<f64>, level: f64) -> Option<Self> {
        if values.is_empty() {
            return None;
        }
        values.sort_unstable_by(f64::total_cmp);
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let squares: f64 = values.iter().map(|value| (value - mean) * (value - mean)).sum();
        let sd = if values.len() > 1 { (squares / (count - 1.0)).sqrt() } else { 0.0 };
        let tail = 0.5 * (1.0 - level);
        let [low, median, high] = [tail, 0.5, 1.0 - tail].map(|share| quantile(&values, share));
        Some(Self { low, median, high, mean, sd })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn friction() -> Uncertain {
        let parameter = Parameter::named("friction").unwrap();
        Uncertain { parameter, spread: ParameterSpread::Absolute(0.05) }
    }

    #[test]
    fn a_figure_that_is_linear_in_a_parameter_has_its_distribution() {
        // The drag is linear in the friction: 0.185602193484356 N per unit at 1 cm, and 3 s.d. of
        // the standard errors of mean and s.d. with 2000 draws.
        let n = 2000;
        let result = monte_carlo(&Setup::default(), &[friction()], n, 1, 0.95, &|_| ());
        let found = result.mean_drag_n.unwrap();
        let sd = 0.05 * 0.185602193484356;
        let n = n as f64;
        assert!((found.mean - 0.108734173433852).abs() < 3.0 * sd / n.sqrt(), "{found:?}");
        assert!((found.sd / sd - 1.0).abs() < 3.0 / (2.0 * n).sqrt(), "{found:?}");
        // ±1.96 s.d., a quantile of which has a standard error of 2.7 s.d./√n there.
        for (end, sign) in [(found.low, -1.0), (found.high, 1.0)] {
            let expected = 0.108734173433852 + sign * 1.959964 * sd;
            assert!((end - expected).abs() < 3.0 * 2.7 * sd / n.sqrt(), "{found:?}");
        }
        assert_eq!((result.refused, result.without_plateau), (0, 0));
    }

    #[test]
    fn draws_depend_on_the_seed_alone() {
        let run = |seed| {
            let progress = |_| ();
            monte_carlo(&Setup::default(), &[friction()], 20, seed, 0.9, &progress).mean_drag_n
        };
        assert_eq!(run(1), run(1));
        assert_ne!(run(1), run(2));
    }

    #[test]
    fn channels_that_make_no_sense_are_counted() {
        let wild = Uncertain {
            parameter: Parameter::named("beam-length").unwrap(),
            spread: ParameterSpread::Relative(1.0),
        };
        let result = monte_carlo(&Setup::default(), &[wild], 200, 1, 0.9, &|_| ());
        // Below 5 mm the body jams: −0.81 s.d. and 21 % of the draws; five s.d. of their number.
        assert!((result.refused as f64 - 42.0).abs() < 29.0, "{}", result.refused);
        assert!(result.energy_j.is_some());
    }

    #[test]
    fn no_draws_have_no_figures() {
        assert_eq!(DrawStatistics::new(Vec::new(), 0.5), None);
    }
}
