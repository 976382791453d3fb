//! The files that a simulation writes: opened before the work, put in place after it.

use std::io::Write;

use beam_channel::Model;
use figures::channel_figure;
use output_file::AtomicFile;
use shellcal::workflow::simulate::{SteadyPassage, curve, read_trace};
use simulation::channel_study::{BeamRow, Course, beam_rows};

use super::args::SimulateArgs;
use super::quantity::cm;
use crate::cmd::outputs::FigureFile;
use crate::printer::Printer;

/// What is written.
pub(super) struct SweepFiles {
    sweep: Option<AtomicFile>,
    beams: Option<AtomicFile>,
    plot: Option<FigureFile>,
}

impl SweepFiles {
    pub(super) fn open(args: &SimulateArgs, printer: &Printer) -> anyhow::Result<Self> {
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
    pub(super) fn sweep(
        &mut self,
        printer: &Printer,
        model: &Model,
        course: &Course,
    ) -> anyhow::Result<()> {
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
        bar.finish_and_clear();
        Ok(())
    }

    /// Draws all channels, with what was measured, and puts the files in their place.
    pub(super) fn finish(
        self,
        models: &[Model],
        course: &Course,
        args: &SimulateArgs,
    ) -> anyhow::Result<()> {
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
