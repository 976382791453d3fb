//! `shellcal fit --partial`: sums for `shellcal merge`, and no fit.

use calibration::Basis;
use calibration::fit::ModelRule;
use calibration::solver::SolverKind;
use calibration_file::Sums;
use shellcal::workflow::partial::{self, PartialOptions};
use shellcal::workflow::remark::absent_axes;

use super::super::mapping::open_logs;
use super::super::outputs::{self, OpenOutput};
use super::FitArgs;
use crate::files::OutputOrStdout;
use crate::printer::Printer;

impl FitArgs {
    pub(super) fn write_partial(
        &self,
        path: &OutputOrStdout,
        printer: &Printer,
    ) -> anyhow::Result<()> {
        let wrenches = ("--wrench-from", self.wrench_from.as_slice());
        let mapping = self.mapping.mapping();
        let mut train = open_logs(&self.train, wrenches, &mapping)?;
        self.check_dropped()?;
        let model = self.model.unwrap_or(Basis::Cubic.into());
        let basis = match (model, self.groups) {
            (ModelRule::Given(basis), _) => basis,
            // Its sums serve every model that is compared.
            (ModelRule::Auto, Some(_)) => Basis::Poly3,
            (ModelRule::Auto, None) => {
                anyhow::bail!("`--partial` needs one model, or `--groups` for `merge --model auto`")
            }
            (ModelRule::Physics, _) => {
                anyhow::bail!("`--partial` is for polynomials in the readings: physics has no sums")
            }
        };
        let destination = OpenOutput::open(path, printer)?;
        // Whether R factors are wanted wherever sums could be had.
        let r_factors = match self.solver {
            SolverKind::Exact => false,
            SolverKind::Tsqr => true,
            _ => anyhow::bail!(
                "`--partial` keeps exact sums, or with `--solver tsqr` R factors: leave out `--solver`"
            ),
        };
        let options = PartialOptions {
            basis,
            intercept: !self.no_intercept,
            groups: self.groups,
            seed: self.cv_seed,
            r_factors,
            fresh: self.fresh,
            mapping: &mapping,
            read: self.mapping.read_options(),
        };
        let mut partial = partial::sum(&mut train, &options)?;
        partial.made_by = shellcal::PROGRAM.to_owned();
        partial.date = outputs::date()?;
        partial.columns = self.mapping.specified(&train);
        partial.sensor_serial = self.serial.clone();
        printer.remarks(absent_axes(partial.axes));
        destination.write(&partial)?;
        let (rows, model) = (partial.sums.rows(), partial.model);
        if printer.json() {
            return printer.document(&serde_json::json!({ "model": model.name(), "rows": rows }));
        }
        let kept = match &partial.sums {
            Sums::Exact(_) => "sums over",
            Sums::Factored(_) => "the R factor of",
        };
        let mut done = format!("{}: {kept} {rows} rows of {} files", model.name(), train.len());
        if let Some(groups) = &partial.groups {
            done += &format!(", in {} groups by {}", groups.groups.len(), groups.by.name());
        }
        if path.is_stdout() {
            printer.note(done);
            return Ok(());
        }
        printer.line(done)
    }
}
