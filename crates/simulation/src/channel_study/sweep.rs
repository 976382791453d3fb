//! Positions of a body along a channel, with the forces on it.

use beam_channel::{Model, Total};
use serde::Serialize;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Course {
    pub from_m: f64,
    pub step_m: f64,
    pub count: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SweepRow {
    /// Position of the body's middle, m past the first beam.
    pub x_m: f64,
    /// Drag, N: `−F_drag` of the paper.
    pub drag_n: f64,
    pub fy_n: f64,
    pub mz_nm: f64,
    pub contacts_left: u32,
    pub contacts_right: u32,
}

impl Course {
    /// Creates positions from `from_m` in steps; includes `to_m` if a step falls on it.
    pub fn new(from_m: f64, to_m: f64, step_m: f64) -> Self {
        // Count a last step that fits except for rounding.
        let count = ((to_m - from_m) / step_m * (1.0 + 1e-12)).floor().max(0.0) as usize + 1;
        Self { from_m, step_m, count }
    }

    pub fn positions(&self) -> impl Iterator<Item = f64> + '_ {
        (0..self.count).map(|i| self.from_m + self.step_m * i as f64)
    }

    pub fn rows<'a>(&'a self, model: &'a Model) -> impl Iterator<Item = SweepRow> + 'a {
        self.positions().map(|x_m| {
            let Total { fx_n, fy_n, mz_nm, contacts: [contacts_left, contacts_right] } =
                model.total(x_m);
            let drag_n = 0.0 - fx_n;
            SweepRow { x_m, drag_n, fy_n, mz_nm, contacts_left, contacts_right }
        })
    }
}
