//! `shellcal plan --replay`: what planning would have saved in a session that was recorded.

use std::num::NonZeroU64;

use calibration::fit::Workers;
use calibration::load_plan::{Order, Replay, ReplayOptions};
use calibration::quality::significant;
use figures::{ChartMark, Series, Spacing};
use shellcal::workflow::plan::observations;

use super::super::mapping::open_logs;
use super::super::outputs::FigureFile;
use super::PlanArgs;
use super::report::chart;
use crate::printer::Printer;

/// How near to the error with all poses counts as there.
const NEAR: f64 = 0.15;

impl PlanArgs {
    pub(super) fn run_replay(
        &self,
        splits: NonZeroU64,
        figure: Option<FigureFile>,
        printer: &Printer,
    ) -> anyhow::Result<()> {
        let logs = open_logs(&self.recorded, ("", &[]), &self.mapping.mapping())?;
        let read = self.mapping.read_options();
        let options = ReplayOptions {
            held_out: self.held_out as usize,
            start: self.start as usize,
            seed: self.seed,
            splits,
        };
        let observations = observations(&logs, &read)?;
        let bar = printer.count("replay", splits.get());
        let told = |done: usize, _: usize| bar.set_position(done as u64);
        let workers = Workers { folds: Some(&told), ..Workers::new(read.threads) };
        let replayed = Replay::new(&observations, options, workers)?;
        bar.finish_and_clear();
        if let Some(figure) = figure {
            let series = |order: Order| Series {
                label: order.name().to_owned(),
                points: (replayed.poses.iter().zip(&replayed.errors[order as usize]))
                    .map(|(&poses, &error)| (poses as f64, error))
                    .collect(),
                mark: ChartMark::Both,
            };
            let series = Order::ALL.map(series).into();
            let title = format!("Error on poses that were held out, mean of {splits} splits");
            let chart = chart(&title, "error relative to the load", Spacing::Log, series);
            figure.draw(|size| chart.figure(size))?;
        }
        let order = |order: Order| {
            document! {
                order: order.name(),
                relative_errors: &replayed.errors[order as usize],
                // The fewest from which on the error is within 15 % of that with all.
                poses_needed: replayed.poses_within(order, NEAR),
            }
        };
        let orders = Order::ALL.map(order);
        let document = document! { splits: splits, poses: &replayed.poses, orders: orders };
        printer.finish(&document, |printer| print(printer, splits, &replayed))
    }
}

fn print(printer: &Printer, splits: NonZeroU64, replayed: &Replay) {
    printer.line(format!(
        "error on poses that were held out, relative to the load, mean of {splits} splits"
    ));
    let header: Vec<&str> = std::iter::once("poses").chain(Order::ALL.map(Order::name)).collect();
    let row = |(at, poses): (usize, &usize)| {
        let errors = replayed.errors.iter().map(|errors| significant(errors[at], 3));
        std::iter::once(poses.to_string()).chain(errors).collect()
    };
    let rows = replayed.poses.iter().enumerate().map(row);
    printer.table(&header, rows);
    let needed = |order| replayed.poses_within(order, NEAR);
    for order in Order::ALL {
        let share = 100.0 * needed(order) as f64 / needed(Order::Random) as f64;
        printer.line(format!(
            "{}: within 15 % of the error with all from {} poses on ({share:.0} % of those of a random order)",
            order.name(),
            needed(order)
        ));
    }
}
