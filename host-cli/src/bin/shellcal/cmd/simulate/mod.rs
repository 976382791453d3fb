//! `shellcal simulate`: the quasi-static model of the beam channel.

mod args;
mod grid;
mod report;
pub(crate) use args::SimulateArgs;

use std::collections::BTreeMap;
use std::io::Write;

use anyhow::Context;
use args::cm;
use beam_channel::{Model, Setup};
use figures::channel_figure;
use output_file::AtomicFile;
use shellcal::workflow::simulate::curve;
use simulation::channel_study::{ChannelSummary, Course, Parameter};

use crate::printer::Printer;

/// Margin on either side of the contacts in a sweep, m.
const MARGIN_M: f64 = 0.01;

/// Distance between positions of a sweep, m.
const STEP_M: f64 = 0.001;

const MOST_POSITIONS: f64 = 1e9;

impl SimulateArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        if !self.grid.is_empty() {
            return self.run_grid(printer);
        }
        let setups = self.setups();
        let models = setups.iter().map(model).collect::<anyhow::Result<Vec<_>>>()?;
        let course = self.course(&models)?;
        let plot = self.figure.create(printer)?;
        let mut sweep = printer.create(self.output.as_ref())?;

        let summaries: Vec<ChannelSummary> = models.iter().map(ChannelSummary::new).collect();
        summaries.iter().for_each(|summary| report::warn(printer, summary));
        if let Some(file) = &mut sweep {
            write_sweep(file, &models, &course, printer)?;
        }
        if let Some(plot) = plot {
            let last = course.from_m + course.step_m * (course.count - 1) as f64;
            let of = |model: &Model| {
                let label = format!("{} cm deflection", cm(model.setup().deflection_m()));
                curve(model, label, course.from_m, last)
            };
            let curves: Vec<_> = models.iter().map(of).collect();
            let title = format!("Simulated drag, friction {}", self.setup().beam.friction);
            plot.draw(|size| channel_figure(size, &title, &curves))?;
        }
        sweep.map(AtomicFile::commit).transpose()?;
        let channels = models.iter().zip(&summaries).map(|(model, summary)| {
            document! {
                ..summary: summary,
                positions: course.rows(model).collect::<Vec<_>>(),
            }
        });
        let setup = self.setup();
        let common = Parameter::ALL.into_iter().filter(|of| of.name != Parameter::WIDTH.name);
        let parameters = common.map(|of| (of.column(), of.get(&setup)));
        let document = document! {
            parameters: parameters.collect::<BTreeMap<_, _>>(),
            beam: self.beam,
            beams: setup.channel.beams,
            torsional_stiffness_nm_rad: setup.beam.torsional_stiffness(),
            channels: if printer.json() { channels.collect() } else { Vec::new() },
        };
        printer.finish(&document, |printer| report::print_channels(printer, &summaries))
    }

    fn course(&self, models: &[Model]) -> anyhow::Result<Course> {
        let channel = self.setup().channel;
        let row = [0.0, channel.pitch_m * f64::from(channel.beams - 1)];
        let extents = models.iter().filter_map(Model::extent_m);
        let [first, last] = extents.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]).unwrap_or(row);
        // Round to whole steps, so that positions are round numbers.
        let from = ((first - MARGIN_M) / STEP_M).floor() * STEP_M;
        let to = ((last + MARGIN_M) / STEP_M).ceil() * STEP_M;
        let positions = (to - from) / STEP_M;
        anyhow::ensure!(
            positions < MOST_POSITIONS,
            "the sweep would have {positions:.1e} positions"
        );
        Ok(Course::new(from, to, STEP_M))
    }
}

fn model(setup: &Setup) -> anyhow::Result<Model> {
    Model::new(setup).with_context(|| format!("a channel {} cm wide", cm(setup.channel.width_m)))
}

fn write_sweep(
    file: &mut AtomicFile,
    models: &[Model],
    course: &Course,
    printer: &Printer,
) -> anyhow::Result<()> {
    writeln!(file, "width_m,x_m,drag_n,fy_n,mz_nm,contacts_left,contacts_right")?;
    let bar = printer.count("positions", (models.len() * course.count) as u64);
    for model in models {
        let channel = model.setup().channel.width_m;
        for row in course.rows(model) {
            let [x, drag, fy, mz] = [row.x_m, row.drag_n, row.fy_n, row.mz_nm];
            let (left, right) = (row.contacts_left, row.contacts_right);
            writeln!(file, "{channel},{x},{drag},{fy},{mz},{left},{right}")?;
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    Ok(())
}
