//! `shellcal import`: a calibration from a coefficient matrix.

use calibration_file::{CalibrationFile, matrix::ImportOptions};
use log_file::MomentUnit;

use super::choices::one_of;
use super::mapping::MOMENT_UNITS;
use super::origin;
use crate::files::{InputPath, OutputPath};
use crate::printer::Printer;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal import N_matrix.mat -o calibration.json
  shellcal import N_matrix.csv -o calibration.json --serial shell-7")]
pub(crate) struct ImportArgs {
    /// The matrix
    #[arg(value_name = "FILE.csv|mat")]
    matrix: InputPath,

    /// Write the calibration (JSON)
    #[arg(long, short, value_name = "CAL.json")]
    output: OutputPath,

    /// The variable of a MATLAB file [default: the only one, else N or C]
    #[arg(long, value_name = "NAME")]
    variable: Option<String>,

    /// The unit of moments [default: what the header says, else mN·m]
    #[arg(long, value_name = "UNIT", value_parser = one_of(&MOMENT_UNITS))]
    moment_unit: Option<MomentUnit>,

    /// The label of the sensor, for the calibration file
    #[arg(long, value_name = "SERIAL")]
    serial: Option<String>,
}

impl ImportArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        let output = printer.files.create(&self.output)?;
        let options =
            ImportOptions { moment_unit: self.moment_unit, variable: self.variable.clone() };
        let mut file = CalibrationFile::import(&self.matrix, &options)?;
        file.origin.made_by = shellcal::PROGRAM.to_owned();
        file.origin.date = origin::date()?;
        file.origin.sensor_serial.clone_from(&self.serial);
        output.commit_with(file.to_json().as_bytes())?;

        let polynomial = file.calibration.polynomial().expect("a matrix is one of a polynomial");
        let model = polynomial.model();
        let (channels, features) = (model.channels, model.term_count());
        let name = model.name();
        let imported = document! { model: &name, channels: channels, features: features };
        printer.finish(&imported, |printer| {
            printer.line(format!("{name}: {features} features of {channels} channels by 6 axes"))
        })?;
        if !model.intercept {
            printer.note("without an intercept wrenches are right only after a tare");
        }
        Ok(())
    }
}
