//! `shellcal simulate`: the quasi-static model of the beam channel.

mod args;
mod comparison;
mod grid;
mod outputs;
mod quantity;
mod report;
pub(crate) use args::SimulateArgs;

use anyhow::Context;
use beam_channel::{Model, Setup};
use outputs::SweepFiles;
use quantity::cm;
use report::ChannelReport;
use simulation::channel_study::{Course, monte_carlo};

use crate::printer::Printer;

/// Room on either side of the contacts that a sweep shows by itself, in m.
const MARGIN_M: f64 = 0.01;

/// Positions of a sweep at most.
const MOST_POSITIONS: f64 = 1e9;

impl SimulateArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        if !self.study.grid.is_empty() {
            return self.run_grid(printer);
        }
        let setups = self.setups();
        let models = setups.iter().map(model).collect::<anyhow::Result<Vec<_>>>()?;
        let course = self.course(&models)?;
        let mut files = SweepFiles::open(&self.sweep, printer)?;
        let comparison = self.compare()?;
        comparison::warn(printer, comparison.as_deref().unwrap_or_default());

        let mut reports = Vec::new();
        for (model, setup) in models.iter().zip(&setups) {
            let mut report = ChannelReport::new(model, self.sweep.at);
            report.warn(printer);
            files.sweep(printer, model, &course)?;
            if printer.json() {
                report.positions = Some(course.rows(model).collect());
            }
            if !self.study.uncertain.is_empty() {
                let bar = printer.count("drawing channels", self.study.draws);
                let progress = |done| bar.set_position(done as u64);
                let (draws, seed) = (self.study.draws as usize, self.study.seed);
                let uncertain = &self.study.uncertain;
                let result =
                    monte_carlo(setup, uncertain, draws, seed, self.study.level, &progress);
                bar.finish_and_clear();
                report.uncertainty = Some(result);
            }
            reports.push(report);
        }
        files.draw(&models, &course, &self.sweep)?;
        files.commit()?;

        if printer.json() {
            return printer.document(&document! {
                ..setup: report::setup(&self.geometry.setup()),
                channels: reports,
                comparison?: comparison,
            });
        }
        report::print_channels(printer, &reports)?;
        reports.iter().try_for_each(|report| report.print_beams(printer))?;
        report::print_uncertainty(printer, &reports)?;
        comparison.map_or(Ok(()), |comparison| comparison::print(printer, &comparison))
    }

    /// The positions of the sweep, the same for all channels.
    fn course(&self, models: &[Model]) -> anyhow::Result<Course> {
        let channel = self.geometry.setup().channel;
        let row = [0.0, channel.pitch_m * f64::from(channel.beams - 1)];
        let extents = models.iter().filter_map(Model::extent_m);
        let all = extents.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]).unwrap_or(row);
        let step = self.sweep.step;
        // Whole steps, so that positions are round figures.
        let from = ((all[0] - MARGIN_M) / step).floor() * step;
        let to = ((all[1] + MARGIN_M) / step).ceil() * step;
        let (from, to) = (self.sweep.from.unwrap_or(from), self.sweep.to.unwrap_or(to));
        anyhow::ensure!(from <= to, "the sweep would begin at {from} m and end before, at {to} m");
        let positions = (to - from) / step;
        anyhow::ensure!(
            positions < MOST_POSITIONS,
            "the sweep would have {positions:.1e} positions: take a longer `--step`"
        );
        Ok(Course::new(from, to, step, self.sweep.speed))
    }
}

/// The model of a channel; an error says of which.
fn model(setup: &Setup) -> anyhow::Result<Model> {
    Model::new(setup).with_context(|| format!("a channel {} cm wide", cm(setup.channel.width_m)))
}
