//! `shellcal plan`: which load to hang next.

mod replay;
mod report;
mod rig;

use calibration::Kind;
use calibration::load_plan::{
    Coupling, Criterion, PlannedLoad, Planner, PredictedError, SensorKnowledge, couplings,
};
use calibration_file::CalibrationFile;
use load_table::{HungLoad, HungLoads};
use shell_data::wrench::PerAxis;
use shellcal::workflow::plan::RecordedSession;

use self::rig::RigArgs;
pub(crate) use self::rig::read_table;
use super::choices::one_of;
use super::figure_size::FigureSize;
use super::mapping::{MappingArgs, open_logs};
use crate::files::{InputPath, OutputPath};
use crate::printer::Printer;

/// Loads of a plan that is given no end.
const USUAL_COUNT: usize = 16;

/// Loads of a plan that ends where an error is reached: nobody hangs more.
const MOST_COUNT: usize = 200;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal plan --masses 0.2kg,0.5kg --point 0,0,40 --point 30,0,40 --directions +x,-x,+y,-y,down -o plan.csv
  shellcal plan --box fx=-5..5,fy=-5..5,fz=-10..0,mx=-0.2..0.2,my=-0.2..0.2,mz=-0.1..0.1
  shellcal plan session1.csv --rig loads.csv --until 0.5N
  shellcal plan session1.csv --replay 20 --held-out 8 --plot orders.svg")]
#[group(skip)]
pub(crate) struct PlanArgs {
    /// What was recorded so far: logs with readings and a measured wrench, or a calibration of the physics model
    #[arg(value_name = "LOG|CAL.json")]
    recorded: Vec<InputPath>,

    #[command(flatten)]
    rig: RigArgs,

    /// What the next load is chosen by: `gain` of information, average variance over the range of loads (`alc`), or
    /// `d-optimal` on 1, w and w·w, which needs no model of the sensors [default: gain where there is a model]
    #[arg(long, value_name = "CRITERION", value_parser = one_of(&CRITERIA), hide_possible_values = true)]
    by: Option<CriterionArg>,

    /// How many loads to plan [default: 16; with `--until` as many as it takes, at most 200]
    #[arg(long, short = 'n', value_name = "N", value_parser = clap::value_parser!(u32).range(1..=20_000))]
    count: Option<u32>,

    /// Stop when the predicted error of every force, or of every moment, is this small: 0.5N, 0.02Nm, or both with a
    /// comma
    #[arg(long, value_name = "ERROR", value_parser = parse_limits)]
    until: Option<PlanLimits>,

    /// Write the loads in their order, for `live --plan` (CSV)
    #[arg(long, short, value_name = "PLAN.csv", conflicts_with = "replay")]
    output: Option<OutputPath>,

    /// Draw the predicted error against the number of poses
    #[arg(long, value_name = "FILE.svg|pdf|png")]
    plot: Option<OutputPath>,

    #[command(flatten)]
    figure_size: FigureSize,

    #[command(flatten)]
    replay: replay::ReplayArgs,

    #[command(flatten)]
    mapping: MappingArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum CriterionArg {
    Gain,
    AverageVariance,
    DOptimal,
}

const CRITERIA: [(&str, &str, CriterionArg); 3] = [
    ("gain", "", CriterionArg::Gain),
    ("alc", "", CriterionArg::AverageVariance),
    ("d-optimal", "", CriterionArg::DOptimal),
];

/// When a plan is long enough: the error of forces in N and of moments in N·m.
type PlanLimits = [Option<f64>; 2];

/// Loads in their order, and what was known before.
struct LoadPlan {
    table: HungLoads,
    /// Poses that were recorded.
    recorded: usize,
    criterion: &'static str,
    before: PredictedError,
    order: Vec<PlannedLoad>,
    limits: Option<PlanLimits>,
    couplings: Vec<Coupling>,
}

impl PlanArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        let figure = self.figure_size.create(self.plot.as_ref(), printer)?;
        if let Some(splits) = self.replay.splits() {
            let logs = open_logs(&self.recorded, ("", &[]), &self.mapping.mapping())?;
            let read = self.mapping.read_options();
            return self.replay.run(splits, &logs, &read, figure, printer);
        }
        let Some(table) = self.rig.table()? else {
            anyhow::bail!(
                "nothing is said of the rig: give its loads with `--rig`, `--masses`, or `--box`"
            );
        };
        let output = printer.create(self.output.as_ref())?;
        let plan = self.plan(table, printer)?;
        if let Some(output) = output {
            output.commit_with(plan.csv().as_bytes())?;
        }
        if let Some(figure) = figure {
            figure.draw(|size| plan.figure(size))?;
        }
        printer.finish(&plan.document(), |printer| plan.print(printer))
    }

    fn plan(&self, table: HungLoads, printer: &Printer) -> anyhow::Result<LoadPlan> {
        let candidates: Vec<PerAxis<f64>> = table.loads().iter().map(HungLoad::wrench).collect();
        let session = self.session(printer)?;
        let sensors = match (session.sensors, self.by) {
            (Ok(sensors), None | Some(CriterionArg::Gain | CriterionArg::AverageVariance)) => {
                Some(sensors)
            }
            (Err(reason), _) if self.until.is_some() => {
                anyhow::bail!("`--until` takes a model of the sensors, and there is none: {reason}")
            }
            (sensors, _) => {
                if let Err(reason) = sensors
                    && !self.recorded.is_empty()
                {
                    printer.note(format!("the plan takes no model of the sensors: {reason}"));
                }
                None
            }
        };
        let by = match self.by {
            Some(CriterionArg::AverageVariance) => Criterion::AverageVariance,
            _ => Criterion::Gain,
        };
        let mut planner = Planner::new(sensors, by, &session.loads, &candidates);
        let before = planner.error();
        let criterion = match (before, self.by) {
            (_, Some(CriterionArg::AverageVariance)) => "average variance (ALC)",
            (PredictedError::Wrench(_), _) => "information gain",
            (PredictedError::Relative(_), _) => "D-optimal on 1, w and w·w",
        };
        let count = match (self.count, self.until) {
            (Some(count), _) => count as usize,
            (None, Some(_)) => MOST_COUNT,
            (None, None) => USUAL_COUNT,
        };
        let (mut order, mut error) = (Vec::new(), before);
        while order.len() < count && !self.until.is_some_and(|limits| are_met(limits, &error)) {
            let Some(next) = planner.next() else { break };
            error = next.error;
            order.push(next);
        }
        let loads = if session.loads.is_empty() { &candidates } else { &session.loads };
        let couplings = couplings(loads, &candidates);
        let (recorded, limits) = (session.loads.len(), self.until);
        Ok(LoadPlan { table, recorded, criterion, before, order, limits, couplings })
    }

    /// What was recorded.
    fn session(&self, printer: &Printer) -> anyhow::Result<RecordedSession> {
        let none = || RecordedSession {
            loads: Vec::new(),
            sensors: Err("nothing is recorded".to_owned()),
        };
        match self.recorded.as_slice() {
            [] => Ok(none()),
            [path] if path.extension().is_some_and(|extension| extension == "json") => {
                let file = CalibrationFile::read(path)?;
                match file.calibration.kind() {
                    Kind::Physics(physics) => {
                        let sensors = Ok(SensorKnowledge::from_calibration(physics));
                        Ok(RecordedSession { sensors, ..none() })
                    }
                    Kind::Polynomial(_) => anyhow::bail!(
                        "`{}` is a polynomial, which does not say what it was fitted to: give its logs",
                        path.display()
                    ),
                }
            }
            paths => {
                let logs = open_logs(paths, ("", &[]), &self.mapping.mapping())?;
                let bar = printer.progress("plan", logs.iter().map(log_file::Log::bytes).sum());
                let session = RecordedSession::read(&logs, &self.mapping.read_options())?;
                bar.finish_and_clear();
                Ok(session)
            }
        }
    }
}

fn are_met([force_n, moment_nm]: PlanLimits, error: &PredictedError) -> bool {
    error.is_within(force_n, moment_nm)
}

fn parse_limits(text: &str) -> Result<PlanLimits, String> {
    let [mut force_n, mut moment_nm] = [None; 2];
    for part in text.split(',') {
        let part = part.trim().replace('·', "");
        let (number, limit) = match part.strip_suffix("Nm") {
            Some(number) => (number, &mut moment_nm),
            None => (part.strip_suffix('N').unwrap_or_default(), &mut force_n),
        };
        let number = number.trim().parse::<f64>().ok().filter(|x| x.is_finite() && *x > 0.0);
        let expected = || "expected an error with its unit, such as 0.5N or 0.02Nm".to_owned();
        *limit = Some(number.ok_or_else(expected)?);
    }
    Ok([force_n, moment_nm])
}
