//! `shellcal simulate`: the quasi-static model of the beam channel.

mod args;
mod comparison;
mod grid;
mod outputs;
mod quantity;
mod report;
pub(crate) use args::SimulateArgs;

use std::collections::BTreeMap;

use anyhow::Context;
use beam_channel::{Angle, Model, Normal, Setup};
use outputs::SweepFiles;
use quantity::cm;
use simulation::channel_study::{ChannelSummary, Course, Parameter, beam_rows, monte_carlo};

use crate::printer::Printer;

/// Room on either side of the contacts that a sweep shows by itself, in m.
const MARGIN_M: f64 = 0.01;

/// Positions of a sweep at most.
const MOST_POSITIONS: f64 = 1e9;

impl SimulateArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        if !self.grid.is_empty() {
            return self.run_grid(printer);
        }
        let setups = self.setups();
        let models = setups.iter().map(model).collect::<anyhow::Result<Vec<_>>>()?;
        let course = self.course(&models)?;
        let mut files = SweepFiles::open(self, printer)?;
        let comparison = self.compare()?;
        comparison::warn(printer, comparison.as_deref().unwrap_or_default());

        let mut studies = Vec::new();
        for (model, setup) in models.iter().zip(&setups) {
            let summary = ChannelSummary::new(model);
            report::warn(printer, &summary);
            files.sweep(printer, model, &course)?;
            let uncertainty = (!self.uncertain.is_empty()).then(|| {
                let bar = printer.count("drawing channels", self.draws);
                let progress = |done| bar.set_position(done as u64);
                let (draws, seed) = (self.draws as usize, self.seed);
                let result =
                    monte_carlo(setup, &self.uncertain, draws, seed, self.level, &progress);
                bar.finish_and_clear();
                result
            });
            studies.push((summary, uncertainty));
        }
        files.finish(&models, &course, self)?;
        if printer.json() {
            let channels = models.iter().zip(&studies).map(|(model, (summary, uncertainty))| {
                let at = self.at.map(|x_m| {
                    let total = model.total(x_m);
                    document! {
                        x_m: x_m,
                        drag_n: 0.0 - total.fx_n,
                        fy_n: total.fy_n,
                        mz_nm: total.mz_nm,
                        // Those that touch.
                        beams: beam_rows(model, x_m).collect::<Vec<_>>(),
                    }
                });
                document! {
                    ..summary: summary,
                    at?: at,
                    uncertainty?: uncertainty.as_ref(),
                    positions: course.rows(model).collect::<Vec<_>>(),
                }
            });
            let setup = self.setup();
            let common = Parameter::ALL.into_iter().filter(|of| of.name != Parameter::WIDTH.name);
            let parameters = common.map(|of| (of.column(), of.get(&setup)));
            let normal = setup.rules.normal;
            return printer.document(&document! {
                parameters: parameters.collect::<BTreeMap<_, _>>(),
                beams: setup.channel.beams,
                torsional_stiffness_nm_rad: setup.beam.torsional_stiffness(),
                as_printed: normal == Normal::AsPrinted,
                true_angle: setup.rules.angle == Angle::True,
                moment_balance?: (normal == Normal::MomentBalance).then_some(true),
                channels: channels.collect::<Vec<_>>(),
                comparison?: comparison,
            });
        }
        report::print_channels(printer, &studies)?;
        if let Some(x_m) = self.at {
            models.iter().try_for_each(|model| report::print_beams(printer, model, x_m))?;
        }
        report::print_uncertainty(printer, &studies)?;
        comparison.map_or(Ok(()), |comparison| comparison::print(printer, &comparison))
    }

    /// The positions of the sweep, the same for all channels.
    fn course(&self, models: &[Model]) -> anyhow::Result<Course> {
        let channel = self.setup().channel;
        let row = [0.0, channel.pitch_m * f64::from(channel.beams - 1)];
        let extents = models.iter().filter_map(Model::extent_m);
        let all = extents.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]).unwrap_or(row);
        let step = self.step;
        // Whole steps, so that positions are round figures.
        let from = ((all[0] - MARGIN_M) / step).floor() * step;
        let to = ((all[1] + MARGIN_M) / step).ceil() * step;
        let (from, to) = (self.from.unwrap_or(from), self.to.unwrap_or(to));
        anyhow::ensure!(from <= to, "the sweep would begin at {from} m and end before, at {to} m");
        let positions = (to - from) / step;
        anyhow::ensure!(
            positions < MOST_POSITIONS,
            "the sweep would have {positions:.1e} positions: take a longer `--step`"
        );
        Ok(Course::new(from, to, step, self.speed))
    }
}

/// The model of a channel; an error says of which.
fn model(setup: &Setup) -> anyhow::Result<Model> {
    Model::new(setup).with_context(|| format!("a channel {} cm wide", cm(setup.channel.width_m)))
}
