//! `shellcal plan --replay`: what planning would have saved in a session that was recorded.

use std::num::NonZeroU64;

use calibration::fit::Workers;
use calibration::load_plan::{Order, Replay, ReplayOptions};
use calibration::quality::significant;
use figures::{ChartMark, Series, Spacing};
use log_file::{Log, ReadOptions};
use serde::Serialize;
use shellcal::workflow::plan::observations;

use super::super::figure_size::FigureFile;
use super::report::chart;
use crate::printer::Printer;

/// How near to the error with all poses counts as there.
const NEAR: f64 = 0.15;

#[derive(Debug, clap::Args)]
#[command(next_help_heading = "A session in other orders")]
#[group(skip)]
pub(super) struct ReplayArgs {
    /// Plan nothing: take the poses of the logs in random and in planned orders, in so many random splits, and
    /// compare the errors on poses that were held out
    #[arg(long, value_name = "SPLITS", value_parser = clap::value_parser!(u64).range(1..=10_000), requires = "recorded")]
    replay: Option<u64>,

    /// Poses that are held out in each split
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..), requires = "replay", hide_default_value = false)]
    held_out: u32,

    /// Poses at random that every order begins with
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..), requires = "replay")]
    start: u32,

    /// Which way they are drawn
    #[arg(long, value_name = "N", default_value_t = 1, requires = "replay")]
    seed: u64,
}

/// What `--json` prints.
#[derive(Serialize)]
struct ReplayDocument {
    splits: u64,
    poses: Vec<usize>,
    orders: Vec<ReplayedOrder>,
}

#[derive(Serialize)]
struct ReplayedOrder {
    order: &'static str,
    relative_errors: Vec<f64>,
    /// The fewest from which on the error is within 15 % of that with all.
    poses_needed: usize,
}

impl ReplayArgs {
    /// In how many splits a session is replayed, if it is.
    pub(super) fn splits(&self) -> Option<NonZeroU64> {
        self.replay.and_then(NonZeroU64::new)
    }

    pub(super) fn run(
        &self,
        splits: NonZeroU64,
        logs: &[Log],
        read: &ReadOptions<'_>,
        figure: Option<FigureFile>,
        printer: &Printer,
    ) -> anyhow::Result<()> {
        let options = ReplayOptions {
            held_out: self.held_out as usize,
            start: self.start as usize,
            seed: self.seed,
            splits,
        };
        let observations = observations(logs, read)?;
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
        let document = document(splits.get(), &replayed);
        printer.finish(&document, |printer| print(printer, &document, &replayed))
    }
}

fn document(splits: u64, replayed: &Replay) -> ReplayDocument {
    let order = |order: Order| ReplayedOrder {
        order: order.name(),
        relative_errors: replayed.errors[order as usize].clone(),
        poses_needed: replayed.poses_within(order, NEAR),
    };
    ReplayDocument { splits, poses: replayed.poses.clone(), orders: Order::ALL.map(order).into() }
}

fn print(printer: &Printer, document: &ReplayDocument, replayed: &Replay) -> anyhow::Result<()> {
    printer.line(format!(
        "error on poses that were held out, relative to the load, mean of {} splits",
        document.splits
    ))?;
    let names: Vec<&str> = document.orders.iter().map(|of| of.order).collect();
    let header: Vec<&str> = std::iter::once("poses").chain(names).collect();
    let row = |(at, poses): (usize, &usize)| {
        let errors = document.orders.iter().map(|of| significant(of.relative_errors[at], 3));
        std::iter::once(poses.to_string()).chain(errors).collect()
    };
    let rows = document.poses.iter().enumerate().map(row);
    printer.table(&header, rows)?;
    let random = replayed.poses_within(Order::Random, NEAR);
    for order in &document.orders {
        let share = 100.0 * order.poses_needed as f64 / random as f64;
        printer.line(format!(
            "{}: within 15 % of the error with all from {} poses on ({share:.0} % of those of a random order)",
            order.order, order.poses_needed
        ))?;
    }
    Ok(())
}
