//! `shellcal simulate`: the quasi-static model of the beam channel.

mod args;
mod grid;
mod report;
pub(crate) use args::SimulateArgs;

use std::collections::BTreeMap;
use std::io::Write;

use anyhow::Context;
use args::cm;
use beam_channel::{Angle, Model, Normal, Setup};
use figures::channel_figure;
use output_file::AtomicFile;
use shellcal::workflow::simulate::{SteadyPassage, curve, read_trace};
use simulation::channel_study::{
    BeamRow, ChannelSummary, Course, Parameter, beam_rows, monte_carlo,
};

use crate::cmd::outputs::FigureFile;
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
        report::warn_of_conditions(printer, comparison.as_deref().unwrap_or_default());

        let mut studies = Vec::new();
        for (model, setup) in models.iter().zip(&setups) {
            let summary = ChannelSummary::new(model);
            report::warn(printer, &summary);
            files.sweep(printer, model, &course)?;
            let uncertainty = (!self.uncertain.is_empty()).then(|| {
                let bar = printer.count("drawing channels", self.draws);
                let progress = |done| bar.set_position(done as u64);
                let (draws, seed) = (self.draws as usize, self.seed);
                monte_carlo(setup, &self.uncertain, draws, seed, self.level, &progress)
            });
            studies.push((summary, uncertainty));
        }
        files.finish(&models, &course, self)?;
        if printer.json() {
            let channels = models.iter().zip(&studies).map(|(model, (summary, uncertainty))| {
                let at = self.at.map(|x_m| {
                    let total = model.total(x_m);
                    document! {
                        x_m,
                        drag_n: 0.0 - total.fx_n,
                        total.{fy_n, mz_nm},
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
        report::print_channels(printer, &studies);
        if let Some(x_m) = self.at {
            models.iter().for_each(|model| report::print_beams(printer, model, x_m));
        }
        report::print_uncertainty(printer, &studies);
        comparison.iter().for_each(|comparison| report::print_comparison(printer, comparison));
        Ok(())
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

/// The files that a simulation writes: opened before the work, put in place after it.
struct SweepFiles {
    sweep: Option<AtomicFile>,
    beams: Option<AtomicFile>,
    plot: Option<FigureFile>,
}

impl SweepFiles {
    fn open(args: &SimulateArgs, printer: &Printer) -> anyhow::Result<Self> {
        let plot = args.figure.create(printer)?;
        let mut sweep = printer.create(args.output.as_ref())?;
        let mut beams = printer.create(args.beam_forces.as_ref())?;
        let time = if args.speed.is_some() { "t_s," } else { "" };
        if let Some(file) = &mut sweep {
            let columns = "x_m,drag_n,fy_n,mz_nm,contacts_left,contacts_right";
            writeln!(file, "width_m,{time}{columns}")?;
        }
        if let Some(file) = &mut beams {
            let columns = "x_m,wall,beam,base_m,phi_rad,deflection_rad,fx_n,fy_n,mz_nm";
            writeln!(file, "width_m,{time}{columns}")?;
        }
        Ok(Self { sweep, beams, plot })
    }

    /// Writes the rows of one channel.
    fn sweep(&mut self, printer: &Printer, model: &Model, course: &Course) -> anyhow::Result<()> {
        let bar = printer.count("positions", course.count as u64);
        let channel = model.setup().channel.width_m;
        let time = |t_s: Option<f64>| t_s.map_or_else(String::new, |t_s| format!("{t_s},"));
        if let Some(file) = &mut self.sweep {
            for row in course.rows(model) {
                let [x, drag, fy, mz] = [row.x_m, row.drag_n, row.fy_n, row.mz_nm];
                let (left, right) = (row.contacts_left, row.contacts_right);
                let time = time(row.t_s);
                writeln!(file, "{channel},{time}{x},{drag},{fy},{mz},{left},{right}")?;
                bar.inc(1);
            }
        }
        if let Some(file) = &mut self.beams {
            bar.set_position(0);
            for x in course.positions() {
                let time = time(course.time_s(x));
                for row in beam_rows(model, x) {
                    let BeamRow { wall, beam, base_m: base, phi_rad: phi, .. } = row;
                    let [turn, fx, fy, mz] = [row.deflection_rad, row.fx_n, row.fy_n, row.mz_nm];
                    writeln!(
                        file,
                        "{channel},{time}{x},{wall},{beam},{base},{phi},{turn},{fx},{fy},{mz}"
                    )?;
                }
                bar.inc(1);
            }
        }
        Ok(())
    }

    /// Draws all channels, with what was measured, and puts the files in their place.
    fn finish(self, models: &[Model], course: &Course, args: &SimulateArgs) -> anyhow::Result<()> {
        if let Some(plot) = self.plot {
            let last = course.from_m + course.step_m * (course.count - 1) as f64;
            let mut curves: Vec<_> = models
                .iter()
                .map(|model| {
                    let label = format!("{} cm deflection", cm(model.setup().deflection_m()));
                    curve(model, label, course.from_m, last)
                })
                .collect();
            let first_contact = models.iter().find_map(Model::extent_m).map_or(0.0, |[x, _]| x);
            let passage = args.speed.map(|speed_m_s| SteadyPassage {
                speed_m_s,
                entry_s: args.entry,
                entry_x_m: first_contact,
            });
            for path in &args.overlay {
                curves.push(read_trace(path, passage)?);
            }
            let friction = models.first().map_or(0.0, |model| model.setup().beam.friction);
            let title = format!("Simulated drag, friction {friction}");
            plot.draw(|size| channel_figure(size, &title, &curves))?;
        }
        [self.sweep, self.beams].into_iter().flatten().try_for_each(AtomicFile::commit)?;
        Ok(())
    }
}
