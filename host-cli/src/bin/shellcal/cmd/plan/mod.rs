//! `shellcal plan`: the next loads to hang.

mod report;

use anyhow::Context;
use calibration::Kind;
use calibration::load_plan::{
    Coupling, Order, PlannedLoad, Planner, PredictedError, SensorKnowledge, couplings,
};
use load_table::{HungLoad, HungLoads, WrenchBox, combinations};
use shell_data::wrench::PerAxis;
use shellcal::workflow::plan::RecordedSession;

use super::mapping::{EditedArg, MappingArgs, open_logs};
use super::outputs::FigureArgs;
use crate::cmd::choices::numbers;
use crate::files::{InputPath, OutputPath, read_text};
use crate::printer::Printer;

const RIG: &str = "What the rig can do";

/// Number of loads of a plan without a limit.
const USUAL_COUNT: usize = 16;

/// Maximum number of loads of a plan with an error limit: nobody hangs more.
const MOST_COUNT: usize = 200;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal plan --masses 0.2kg,0.5kg --point 0,0,40 --point 30,0,40 --directions +x,-x,+y,-y,down -o plan.csv
  shellcal plan --box fx=-5..5,fy=-5..5,fz=-10..0,mx=-0.2..0.2,my=-0.2..0.2,mz=-0.1..0.1
  shellcal plan session1.csv --rig loads.csv --until 0.5N
  shellcal plan --loads recorded.csv --rig loads.csv")]
#[group(skip)]
pub(crate) struct PlanArgs {
    /// The session so far: logs with readings and a measured wrench, logs of `calibrate`, or a calibration
    /// of the physics model
    #[arg(value_name = "LOG|CAL.json")]
    recorded: Vec<InputPath>,

    #[command(flatten)]
    rig: RigArgs,

    /// Take the wrench from a table of the hung loads, one line for each pose: mass or force, point and
    /// direction, with their errors. Loads are matched by the group column, otherwise pose
    /// by pose, in order
    #[arg(long, value_name = "LOADS.csv")]
    loads: Option<InputPath>,

    /// Number of loads to plan [default: 16; with `--until` as many as necessary, at most 200]
    #[arg(long, short = 'n', value_name = "N", value_parser = clap::value_parser!(u32).range(1..=20_000))]
    count: Option<u32>,

    #[command(flatten)]
    until: UntilArg,

    /// Write the loads in their order (CSV)
    #[arg(long, short, value_name = "PLAN.csv")]
    output: Option<OutputPath>,

    #[command(flatten)]
    figure: FigureArgs,

    #[command(flatten)]
    edited: EditedArg,

    #[command(flatten)]
    mapping: MappingArgs,
}

/// The loads that a rig can do.
#[derive(Debug, clap::Args)]
pub(crate) struct RigArgs {
    /// Table with one line for each load that can be hung: mass or force, point, direction, or the wrench
    #[arg(long, value_name = "LOADS.csv", conflicts_with_all = ["masses", "points", "directions", "wrench_box"], help_heading = RIG)]
    rig: Option<InputPath>,

    /// Masses that can be hung, such as 100g,0.5kg
    #[arg(long, value_name = "MASSES", value_delimiter = ',', value_parser = parse_mass, requires = "directions", help_heading = RIG)]
    masses: Vec<f64>,

    /// Point where they can be hung, in mm from the sensor's origin, such as 30,0,40; can be repeated
    #[arg(long = "point", value_name = "X,Y,Z", value_parser = parse_point, allow_hyphen_values = true, requires = "masses", help_heading = RIG)]
    points: Vec<[f64; 3]>,

    /// Directions in which they can pull: down, up, +x … -z, or azimuth and elevation in degrees, such as
    /// 30:-45
    #[arg(long, value_name = "DIRECTIONS", value_delimiter = ',', value_parser = parse_direction, allow_hyphen_values = true, requires = "masses", help_heading = RIG)]
    directions: Vec<String>,

    /// Ranges of the axes, for a rig that can apply any wrench: fx=-5..5,fz=-10..0,my=-0.2..0.2 (N and N·m)
    #[arg(long = "box", value_name = "RANGES", value_parser = WrenchBox::parse, conflicts_with = "masses", help_heading = RIG)]
    wrench_box: Option<WrenchBox>,
}

/// The error that is good enough.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(crate) struct UntilArg {
    /// Stop when the error of every force, or of every moment, is this small: 0.5N, 0.02Nm, or both with a
    /// comma
    #[arg(long, value_name = "ERROR", value_parser = parse_limits)]
    pub(crate) until: Option<PlanLimits>,
}

/// Error limits that end a plan: of forces in N and of moments in N·m.
pub(crate) type PlanLimits = [Option<f64>; 2];

struct LoadPlan {
    table: HungLoads,
    recorded: usize,
    criterion: &'static str,
    before: PredictedError,
    order: Vec<PlannedLoad>,
    limits: Option<PlanLimits>,
    couplings: Vec<Coupling>,
}

impl PlanArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        let figure = self.figure.create(printer)?;
        let table = self.rig.table()?;
        let output = printer.create(self.output.as_ref())?;
        let plan = self.plan(table, printer)?;
        output.map(|output| output.commit_with(plan.csv().as_bytes())).transpose()?;
        figure.map(|figure| figure.draw(|size| plan.figure(size))).transpose()?;
        printer.finish(&plan.document(), |printer| plan.print(printer))
    }

    fn plan(&self, table: HungLoads, printer: &Printer) -> anyhow::Result<LoadPlan> {
        let candidates: Vec<PerAxis<f64>> = table.loads().iter().map(HungLoad::wrench).collect();
        let session = self.session(&table)?;
        let sensors = match session.sensors {
            Ok(sensors) => Some(sensors),
            Err(reason) if self.until.until.is_some() => {
                anyhow::bail!("`--until` takes a model of the sensors, and there is none: {reason}")
            }
            Err(reason) => {
                if !self.recorded.is_empty() {
                    printer.note(format!("the plan takes no model of the sensors: {reason}"));
                }
                None
            }
        };
        let mut planner = Planner::new(sensors, Order::Gain, &session.loads, &candidates);
        let before = planner.error();
        let criterion = match before {
            PredictedError::Wrench(_) => "information gain",
            PredictedError::Relative(_) => "D-optimal on 1, w and w·w",
        };
        let count = match (self.count, self.until.until) {
            (Some(count), _) => count as usize,
            (None, Some(_)) => MOST_COUNT,
            (None, None) => USUAL_COUNT,
        };
        let (mut order, mut error) = (Vec::new(), before);
        while order.len() < count
            && !self
                .until
                .until
                .is_some_and(|[force_n, moment_nm]| error.is_within(force_n, moment_nm))
        {
            let Some(next) = planner.next() else { break };
            error = next.error;
            order.push(next);
        }
        let loads = if session.loads.is_empty() { &candidates } else { &session.loads };
        let couplings = couplings(loads, &candidates);
        let (recorded, limits) = (session.loads.len(), self.until.until);
        Ok(LoadPlan { table, recorded, criterion, before, order, limits, couplings })
    }

    /// The session recorded so far, with the `rig`'s loads or those of `--loads` if logs have no wrench.
    fn session(&self, rig: &HungLoads) -> anyhow::Result<RecordedSession> {
        let without_loads = |sensors| RecordedSession { loads: Vec::new(), sensors };
        let hung = self.loads.as_ref().map(read_table).transpose()?;
        match self.recorded.as_slice() {
            [] => {
                let loads: Vec<_> =
                    hung.iter().flat_map(HungLoads::loads).map(HungLoad::wrench).collect();
                let reason =
                    if loads.is_empty() { "nothing is recorded" } else { "no log is given" };
                Ok(RecordedSession { loads, sensors: Err(reason.to_owned()) })
            }
            [path] if path.extension().is_some_and(|extension| extension == "json") => {
                let file = self.edited.read(path)?;
                let Kind::Physics(physics) = &file.calibration.kind else {
                    anyhow::bail!(
                        "`{}` is a polynomial, which does not say what it was fitted to: give its logs",
                        path.display()
                    );
                };
                Ok(without_loads(Ok(SensorKnowledge::from_calibration(physics))))
            }
            paths => {
                let logs = open_logs(paths, ("", &[]), &self.mapping.mapping())?;
                let table = hung.as_ref().unwrap_or(rig);
                Ok(RecordedSession::read(&logs, table, &self.mapping.read_options())?)
            }
        }
    }
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

impl RigArgs {
    /// The loads that the rig can do. Fails if none are given, or too many, or the table cannot be read.
    pub(crate) fn table(&self) -> anyhow::Result<HungLoads> {
        if let Some(path) = &self.rig {
            return read_table(path);
        }
        if let Some(wrench_box) = &self.wrench_box {
            return Ok(wrench_box.table());
        }
        anyhow::ensure!(
            !self.masses.is_empty(),
            "no loads given: name those of the rig with `--rig`, `--masses`, or `--box`"
        );
        let points_mm = if self.points.is_empty() { &[[0.0; 3]][..] } else { &self.points };
        combinations(&self.masses, points_mm, &self.directions).map_err(anyhow::Error::msg)
    }
}

pub(crate) fn read_table(path: &InputPath) -> anyhow::Result<HungLoads> {
    HungLoads::parse(&read_text(path)?).with_context(|| format!("`{}`", path.display()))
}

fn parse_mass(text: &str) -> Result<f64, String> {
    let text = text.trim();
    let (number, unit) = match text.strip_suffix("kg") {
        Some(number) => (number, 1.0),
        None => (text.strip_suffix('g').unwrap_or_default(), 1e-3),
    };
    let mass = number.trim().parse::<f64>().ok().map(|mass| mass * unit);
    let mass = mass.filter(|mass| mass.is_finite() && *mass >= 0.0);
    mass.ok_or_else(|| "expected a mass with its unit, such as 100g or 0.5kg".to_owned())
}

fn parse_point(text: &str) -> Result<[f64; 3], String> {
    numbers(text).ok_or_else(|| "expected three coordinates in mm, such as 30,0,40".to_owned())
}

fn parse_direction(text: &str) -> Result<String, String> {
    let known = ["down", "up", "+x", "-x", "+y", "-y", "+z", "-z", "x", "y", "z"];
    let is_angle = |text: &str| text.parse::<f64>().is_ok_and(f64::is_finite);
    let is_angles = text.split_once(':').is_some_and(|(a, e)| is_angle(a) && is_angle(e));
    match known.contains(&text) || is_angles {
        true => Ok(text.to_owned()),
        false => Err("expected down, up, +x … -z, or AZIMUTH:ELEVATION in degrees".to_owned()),
    }
}
