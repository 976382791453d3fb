//! Exchange of calibrations with other programs: `shellcal import` and `export`.

use std::ffi::OsStr;
use std::path::Path;

use anyhow::{Context, bail, ensure};
use calibration_file::CalibrationFile;
use calibration_file::code::{Language, to_code};
use calibration_file::matrix::{self, ImportOptions};
use log_file::MomentUnit;

use super::choices::one_of;
use super::mapping::{EditedArg, MOMENT_UNITS};
use super::outputs;
use crate::files::{InputPath, OutputPath};
use crate::printer::Printer;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal import N_matrix.mat -o calibration.json
  shellcal import N_matrix.csv -o calibration.json --serial shell-7")]
pub(crate) struct ImportArgs {
    /// Matrix file
    #[arg(value_name = "FILE.csv|mat|cal")]
    matrix: InputPath,

    /// Write the calibration (JSON)
    #[arg(long, short, value_name = "CAL.json")]
    output: OutputPath,

    /// Variable in a MATLAB file [default: the only one, else N or C]
    #[arg(long, value_name = "NAME")]
    variable: Option<String>,

    /// Unit of moments [default: from the header, else mN·m]
    #[arg(long, value_name = "UNIT", value_parser = one_of(&MOMENT_UNITS))]
    moment_unit: Option<MomentUnit>,

    /// Serial number or label of the sensor, for the calibration file
    #[arg(long, value_name = "SERIAL")]
    serial: Option<String>,
}

impl ImportArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        let output = printer.files.create(&self.output)?;
        let options =
            ImportOptions { moment_unit: self.moment_unit, variable: self.variable.clone() };
        let (mut file, has_units) = CalibrationFile::import(&self.matrix, &options)?;
        file.origin.made_by = shellcal::PROGRAM.to_owned();
        file.origin.date = outputs::date()?;
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
        if !has_units && self.moment_unit.is_none() {
            printer.warning(
                "the matrix has no units: its moments are taken as mN·m; `--moment-unit` names another unit",
            );
        }
        if !model.intercept {
            printer.note("without an intercept wrenches are right only after a tare");
        }
        Ok(())
    }
}

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal export calibration.json shell_wrench.py     from shell_wrench import wrench
  shellcal export calibration.json shell_wrench.m      w = shell_wrench(readings)
  shellcal export calibration.json matrix.csv")]
pub(crate) struct ExportArgs {
    /// Calibration file
    #[arg(value_name = "CAL")]
    calibration: InputPath,

    /// A self-contained Python module or MATLAB function; or the coefficients for raw readings, moments in
    /// mN·m, as `fit --export-matrix` writes them
    #[arg(value_name = "FILE.py|m|csv")]
    output: OutputPath,

    #[command(flatten)]
    edited: EditedArg,
}

impl ExportArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        let file = self.edited.usable(&self.calibration, printer)?;
        let text = match self.output.extension().and_then(OsStr::to_str) {
            Some("py") => to_code(&file, Language::Python, identifier(&self.output)?),
            Some("m") => to_code(&file, Language::Matlab, identifier(&self.output)?),
            Some("csv") => {
                let polynomial = file.calibration.polynomial();
                let polynomial = polynomial
                    .context("a physics model has no matrix; export it as `.py` or `.m`")?;
                ensure!(
                    file.calibration.memory.is_none(),
                    "a matrix cannot have memory terms; export as `.py` or `.m`"
                );
                matrix::to_csv(polynomial, file.calibration.axes)
            }
            _ => bail!("`{}` ends in none of `.py`, `.m` and `.csv`", self.output.display()),
        };
        printer.files.write(&self.output, text.as_bytes())?;
        printer.note(
            "readings go in as counts, untared; the mean wrench of a rest is to be taken off",
        );
        Ok(())
    }
}

fn identifier(path: &Path) -> anyhow::Result<&str> {
    let stem = path.file_stem().and_then(OsStr::to_str).unwrap_or_default();
    let is_letter = |c: char| c.is_ascii_alphabetic();
    let is_fit =
        stem.starts_with(is_letter) && stem.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    ensure!(
        is_fit,
        "`{stem}` cannot be the name of a function: letters, digits and `_`, a letter first"
    );
    Ok(stem)
}
