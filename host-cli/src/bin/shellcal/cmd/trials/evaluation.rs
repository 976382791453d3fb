//! The flags of every command that evaluates trials; `shellcal profile`.

use std::path::Path;

use calibration_file::CalibrationFile;
use forces::RowRule;
use log_file::{Mapping, ReadOptions};
use shellcal::workflow::batch::BatchOptions;
use trial::{Instrument, Profile, TraceExtent, TrialOptions, VELOCIROACH};

use crate::cmd::frames::{ForceArgs, describe_forces};
use crate::cmd::mapping::{EditedArg, MappingArgs};
use crate::files::{InputPath, read_text};
use crate::printer::Printer;

/// How trials are evaluated.
#[derive(Debug, clap::Args)]
pub(crate) struct EvaluationArgs {
    /// Calibration file; without one there are energies but no forces
    #[arg(long, short, value_name = "CAL")]
    pub(super) calibration: Option<InputPath>,

    #[command(flatten)]
    pub(super) edited: EditedArg,

    /// Robot profile, in TOML [default: the built-in `velociroach`; see `shellcal profile`]
    #[arg(long, value_name = "FILE")]
    profile: Option<InputPath>,

    /// Evaluate rows as the lab's notebooks did: each is a sample, the filter steps once a row and
    /// lags behind, the tare is taken over rows, and energy is summed up row by row
    #[arg(long)]
    by_row: bool,

    #[command(flatten)]
    forces: ForceArgs,

    /// The highest reading the converter can give, to tell saturation
    #[arg(long, value_name = "COUNTS", default_value_t = 4095.0)]
    full_scale: f64,

    #[command(flatten)]
    pub(super) mapping: MappingArgs,
}

/// What trials are evaluated with, read from its files.
#[derive(Debug)]
pub(crate) struct Equipment {
    pub(crate) profile: Profile,
    pub(crate) calibration: Option<CalibrationFile>,
    pub(crate) mapping: Mapping,
}

impl Equipment {
    pub(crate) fn instrument(&self) -> Instrument<'_> {
        let calibration = self.calibration.as_ref().map(|file| &file.calibration);
        Instrument { profile: &self.profile, calibration }
    }
}

impl EvaluationArgs {
    pub(crate) fn equipment(&self) -> anyhow::Result<Equipment> {
        let calibration =
            self.calibration.as_ref().map(|path| self.edited.read(path)).transpose()?;
        let profile = match &self.profile {
            None => Profile::velociroach(),
            Some(path) => Profile::parse(&read_text(path)?)
                .map_err(|problem| anyhow::anyhow!("{}:{problem}", path.display()))?,
        };
        let mapping = self.mapping.mapping_for(calibration.as_ref());
        Ok(Equipment { profile, calibration, mapping })
    }

    pub(crate) fn options(&self, equipment: &Equipment, trace: TraceExtent) -> TrialOptions {
        let rule = if self.by_row { RowRule::Rows } else { RowRule::Time };
        TrialOptions {
            forces: self.forces.options(rule),
            trace,
            full_scale: self.full_scale,
            unexplained: equipment.calibration.as_ref().and_then(CalibrationFile::unexplained),
        }
    }

    /// Those of all trials of a manifest.
    pub(crate) fn batch_options<'a>(
        &self,
        equipment: &'a Equipment,
        trace: TraceExtent,
    ) -> BatchOptions<'a> {
        BatchOptions {
            trial: self.options(equipment, trace),
            mapping: &equipment.mapping,
            read: self.read_options(),
            conditions: None,
            before: None,
            shard: None,
            progress: None,
        }
    }

    /// Says how forces are made, where there are any.
    pub(crate) fn note_forces(&self, printer: &Printer, options: &TrialOptions) {
        if self.calibration.is_some() {
            printer.note(describe_forces(&options.forces));
        }
    }

    pub(crate) fn read_options(&self) -> ReadOptions<'static> {
        ReadOptions { checksum: true, ..self.mapping.read_options() }
    }

    /// The files that results depend on beside manifest and logs, and what they are.
    pub(crate) fn files_by_role(&self) -> impl Iterator<Item = (&'static str, &Path)> {
        let calibration = self.calibration.iter().map(|path| ("calibration", path.as_path()));
        calibration.chain(self.profile.iter().map(|path| ("profile", path.as_path())))
    }
}

#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  shellcal profile > robot.toml")]
pub(crate) struct ProfileArgs {}

impl ProfileArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        printer.finish(&Profile::velociroach(), |printer| printer.line(VELOCIROACH.trim_end()))
    }
}
