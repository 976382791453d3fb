//! What was found of lag and memory, in words.

use std::fmt;

use super::{Dynamics, Gain};
use crate::memory::TimeBase;
use crate::quality::significant;
use shell_data::wrench::{Axis, PerAxis};

impl fmt::Display for Dynamics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.lag {
            Some(lag) => {
                let by = lag.by.abs();
                let (factor, unit) = unit(by, self.time_base);
                let error = self.lag_standard_error.map_or_else(String::new, |error| {
                    format!(" ± {}", significant(factor * error, 1))
                });
                let by = significant(factor * by, 3);
                let what = match lag.by > 0.0 {
                    true => "the reference lags behind the readings",
                    false => "the readings lag behind the reference",
                };
                write!(f, "{what} by {by}{error} {unit}, which the fit makes up for")?;
            }
            None => f.write_str("no lag between readings and reference")?,
        }
        match &self.memory {
            Some(memory) => {
                let time = |&tau: &f64| {
                    let (factor, unit) = unit(tau, self.time_base);
                    format!("{} {unit}", significant(factor * tau, 3))
                };
                let times: Vec<String> = memory.time_constants.iter().map(time).collect();
                write!(f, "; memory terms of {}", times.join(", "))?;
            }
            None => f.write_str("; no memory terms")?,
        }
        let Some(gain) = &self.gain else { return Ok(()) };
        if self.lag.is_none() && self.memory.is_none() {
            return f.write_str(" (none lowers the held-out error by more than a standard error)");
        }
        write!(f, ". Held-out errors: {}", gain.steps(self))
    }
}

impl Gain {
    /// `Fx 0.113 → 0.078 → 0.055 N, …`
    fn steps(&self, of: &Dynamics) -> String {
        let mut columns: Vec<&PerAxis<f64>> = vec![&self.plain];
        columns.extend(of.lag.map(|_| &self.with_lag));
        columns.extend(of.memory.as_ref().map(|_| &self.with_all));
        let axis = |axis: Axis| {
            let errors = columns.iter().map(|errors| significant(errors[axis.index()], 3));
            format!("{} {} {}", axis.name(), errors.collect::<Vec<_>>().join(" → "), axis.unit())
        };
        let varies = |axis: &&Axis| self.plain[axis.index()] > 0.0;
        Axis::ALL.iter().filter(varies).map(|of| axis(*of)).collect::<Vec<_>>().join(", ")
    }
}

/// The factor and the unit that times are printed with.
fn unit(time: f64, base: TimeBase) -> (f64, &'static str) {
    match base {
        TimeBase::Rows => (1.0, "rows"),
        TimeBase::Seconds if time < 1.0 => (1e3, "ms"),
        TimeBase::Seconds => (1.0, "s"),
    }
}
