//! Options for the orientation and motion of a sensor, and for its payload.

use calibration::Calibration;
use calibration_file::payload_file::PayloadFile;
use clap::builder::TypedValueParser;
use forces::payload::{CarriedLoad, Lag};
use log_file::{Log, Mapping, ReadOptions, TimeUnit, parse_columns};
use shell_data::wrench::Axis;
use shellcal::workflow::convert::ConvertSummary;
use shellcal::workflow::payload::{
    MotionColumns, Orientation, RunMotion, find_motion_lag, read_motion,
};

use crate::cmd::choices::{number_in, one_of};
use crate::cmd::mapping::ColumnList;
use crate::cmd::quality::by_unit;
use crate::files::InputPath;
use crate::printer::Printer;

/// Columns with the orientation and motion of a sensor.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Motion")]
pub(in crate::cmd) struct MotionColumnArgs {
    /// Columns of orientation: 3 of gravity in the sensor's frame, 4 of a quaternion (x y z w) or 9 of a
    /// rotation matrix, row by row, to a frame whose z is up [default: by their names]
    #[arg(long, value_name = "COLUMNS", value_parser = parse_columns)]
    orientation: Option<ColumnList>,

    /// Kind of the columns of orientation [default: by their names and number]
    #[arg(long, value_name = "KIND", value_parser = orientation())]
    orientation_as: Option<Orientation>,

    /// Rotations are from the frame whose z is up to the sensor's
    #[arg(long)]
    inverse_orientation: bool,

    /// Columns of acceleration along x, y, z [default: by their names]
    #[arg(long, value_name = "COLUMNS", value_parser = parse_columns)]
    accelerations: Option<ColumnList>,

    /// Columns of angular velocity about x, y, z, rad/s unless their names say degrees [default: by their names]
    #[arg(long, value_name = "COLUMNS", value_parser = parse_columns)]
    angular_velocity: Option<ColumnList>,

    /// Gravity, m/s², if columns do not contain it [default: from the payload file, else 9.80665]
    #[arg(long, value_name = "M/S²", value_parser = number_in(0.1..=30.0, "expected m/s², from 0.1 to 30"))]
    gravity: Option<f64>,
}

fn orientation() -> impl TypedValueParser<Value = Orientation> {
    one_of(&[
        ("gravity", "gravity in the sensor's frame", Orientation::Gravity),
        ("matrix", "rotation matrix, row by row", Orientation::Matrix),
        ("quaternion-xyzw", "quaternion x y z w", Orientation::Quaternion),
        ("quaternion-wxyz", "quaternion w x y z", Orientation::QuaternionWxyz),
        ("rotation-vector", "axis times angle, rad", Orientation::RotationVector),
        ("rpy-rad", "roll, pitch, yaw, rad: Rz(yaw)·Ry(pitch)·Rx(roll)", Orientation::RollPitchYaw),
        ("rpy-deg", "the same in degrees", Orientation::RollPitchYawDegrees),
    ])
}

/// Motion of a sensor in a run.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Motion")]
pub(in crate::cmd) struct MotionArgs {
    /// Log of orientations or accelerations [default: columns of the log itself]
    #[arg(long, value_name = "LOG")]
    motion: Option<InputPath>,

    /// Lag of the clock of `--motion`, s [default: found from forces and accelerations]
    #[arg(long, value_name = "SECONDS", requires = "motion", allow_negative_numbers = true)]
    motion_lag: Option<f64>,

    #[command(flatten)]
    columns: MotionColumnArgs,
}

impl MotionColumnArgs {
    /// The columns; `gravity_m_s2` is used unless the user gives a value.
    pub(super) fn columns(&self, gravity_m_s2: f64) -> MotionColumns {
        MotionColumns {
            orientation: self.orientation.clone(),
            orientation_as: self.orientation_as,
            is_inverse: self.inverse_orientation,
            accelerations: self.accelerations.clone(),
            angular_velocity: self.angular_velocity.clone(),
            gravity_m_s2: self.gravity.unwrap_or(gravity_m_s2),
        }
    }
}

impl MotionArgs {
    pub(in crate::cmd) fn is_given(&self) -> bool {
        let of = &self.columns;
        let columns = [&of.orientation, &of.accelerations, &of.angular_velocity];
        self.motion.is_some() || columns.iter().any(|of| of.is_some())
    }

    pub(in crate::cmd) fn load(
        &self,
        file: &PayloadFile,
        log: &Log,
        calibration: &Calibration,
        read: &ReadOptions<'_>,
        time_unit: Option<TimeUnit>,
    ) -> anyhow::Result<CarriedLoad> {
        let PayloadFile { fit, accelerometer, .. } = file;
        let (payload, columns) = (fit.payload, self.columns.columns(fit.gravity_m_s2));
        let body = (&payload, accelerometer.as_ref());
        let Some(path) = &self.motion else {
            let RunMotion { motion, inertia, rescaled } = read_motion(log, &columns, body, read)?;
            return Ok(CarriedLoad { payload, motion, inertia, rescaled, lag: None });
        };
        // Options for the log's columns do not apply to another file, except for the clock.
        let other = Log::open(path, &Mapping { time_unit, ..Mapping::default() })?;
        let RunMotion { motion, inertia, rescaled } = read_motion(&other, &columns, body, read)?;
        let lag = match self.motion_lag {
            Some(_) => None,
            None => find_motion_lag(log, calibration, &payload, &motion, read)?,
        };
        let lag_s = self.motion_lag.or(lag.map(|lag| lag.taken_s())).unwrap_or(0.0);
        anyhow::ensure!(lag_s.is_finite(), "`--motion-lag` is `{lag_s}`, expected seconds");
        Ok(CarriedLoad { payload, motion: motion.earlier_by(lag_s), inertia, rescaled, lag })
    }

    pub(in crate::cmd) fn report(&self, printer: &Printer, log: &Log, summary: &ConvertSummary) {
        let Some(load) = &summary.load else { return };
        let path = log.path().display();
        printer.note(match load.has_inertia {
            true => "payload: weight and inertia taken off",
            false => "payload: weight taken off; inertia needs accelerations",
        });
        if let Some(force) = load.turning_n {
            printer.warning(format!(
                "`{path}`: inertia of rotation not removed ({:.3} N at 1 rad/s, {:.2} N at 5): give `gyro_x` \
                 … or orientations",
                force,
                25.0 * force
            ));
        }
        if let Some(factor) = load.rescaled {
            printer.warning(format!(
                "`{path}`: accelerations are in {}, unlike those of the poses, judging by gravity: \
                 multiplied by {factor:.5}",
                if factor > 1.0 { "multiples of g" } else { "m/s²" }
            ));
        }
        let lag = |lag: Lag| {
            let [lag, error] = [lag.lag_s, lag.standard_error_s].map(|seconds| 1e3 * seconds);
            format!("its clock is {lag:.2} ms late (standard error {error:.2} ms)")
        };
        match load.lag {
            Some(found) if found.is_certain() => printer.note(format!("motion: {}", lag(found))),
            Some(found) => printer.warning(format!(
                "`{path}`: contact makes the lag of the motion uncertain: {}, {}; set `--motion-lag`, from a \
                 free run",
                lag(found),
                if found.taken_s() == 0.0 { "so it is taken as 0" } else { "and this is taken" }
            )),
            None if self.motion.is_some() && self.motion_lag.is_none() => printer.warning(format!(
                "`{path}`: the lag between forces and motion is unclear and taken as 0; set `--motion-lag`"
            )),
            None => {}
        }
        if let Some([before, after]) = load.scatters_more() {
            printer.warning(format!(
                "`{path}`: forces scatter by {after:.3} N without the weight, by {before:.3} N with it"
            ));
            printer.note(
                "unless contact carried it: gravity points up, or see `--orientation-as`, `--inverse-orientation`",
            );
        }
        if load.rows_without_motion > 0 {
            printer.warning(format!(
                "`{path}`: {} rows are far from any sample of the motion: the nearest is held there",
                load.rows_without_motion
            ));
        }
        let text = |axis: Axis, sd| format!("{sd:.*}", if axis.is_moment() { 5 } else { 4 });
        let parts: Vec<String> = by_unit(&load.standard_deviation, text).collect();
        printer.note(format!("standard deviation: {}", parts.join(", ")));
    }
}
