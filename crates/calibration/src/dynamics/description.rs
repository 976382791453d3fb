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
                let by = time(lag.by.abs(), self.time_base);
                let error = self.lag_standard_error.map_or_else(String::new, |error| {
                    format!(" ± {}", time_in(error, lag.by.abs(), self.time_base))
                });
                let unit = unit(lag.by.abs(), self.time_base);
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
                let times = memory.time_constants.iter();
                let times: Vec<String> = times
                    .map(|&tau| {
                        format!("{} {}", time(tau, self.time_base), unit(tau, self.time_base))
                    })
                    .collect();
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

/// The unit that a time is told in.
fn unit(time: f64, base: TimeBase) -> &'static str {
    match base {
        TimeBase::Rows => "rows",
        TimeBase::Seconds if time < 1.0 => "ms",
        TimeBase::Seconds => "s",
    }
}

fn time(time: f64, base: TimeBase) -> String {
    time_in(time, time, base)
}

/// A time in the unit of another.
fn time_in(time: f64, like: f64, base: TimeBase) -> String {
    let factor = if unit(like, base) == "ms" { 1e3 } else { 1.0 };
    significant(factor * time, if time == like { 3 } else { 1 })
}
