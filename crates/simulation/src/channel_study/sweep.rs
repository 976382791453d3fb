//! A body on its way through a channel.

use beam_channel::{Model, Total, Wall};
use serde::Serialize;

/// Equally spaced positions of a body's middle, and when it is there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Course {
    /// The first position in m past the first beam.
    pub from_m: f64,
    /// From one position to the next in m.
    pub step_m: f64,
    /// Positions.
    pub count: usize,
    /// Speed in m/s, if time is asked for; it is 0 at the first position.
    pub speed_m_s: Option<f64>,
}

/// One position.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SweepRow {
    /// Time in s, of a course with a speed.
    pub t_s: Option<f64>,
    /// Position of the body's middle in m past the first beam.
    pub x_m: f64,
    /// Drag in N, `−F_drag` of the paper.
    pub drag_n: f64,
    /// Force to the left in N.
    pub fy_n: f64,
    /// Moment about the body's middle in N·m.
    pub mz_nm: f64,
    /// Beams of the left wall that touch.
    pub contacts_left: u32,
    /// Beams of the right wall that touch.
    pub contacts_right: u32,
}

/// One beam at one position.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct BeamRow {
    /// "left" or "right".
    pub wall: &'static str,
    /// Counted from 1, as in the paper.
    pub beam: u32,
    /// Where its base is, in m from the first.
    pub base_m: f64,
    /// Where on the ellipse it touches, in rad from the nose, positive towards the left.
    pub phi_rad: f64,
    /// Its deflection in rad.
    pub deflection_rad: f64,
    /// Forward force on the body in N.
    pub fx_n: f64,
    /// Force to the left in N.
    pub fy_n: f64,
    /// Moment about the body's middle in N·m.
    pub mz_nm: f64,
}

impl Course {
    /// Positions from `from_m` to `to_m`, both of them and every `step_m`.
    pub fn new(from_m: f64, to_m: f64, step_m: f64, speed_m_s: Option<f64>) -> Self {
        // A step that fits but for rounding does fit.
        let count = ((to_m - from_m) / step_m * (1.0 + 1e-12)).floor().max(0.0) as usize + 1;
        Self { from_m, step_m, count, speed_m_s }
    }

    /// The positions in order.
    pub fn positions(&self) -> impl Iterator<Item = f64> + '_ {
        (0..self.count).map(|i| self.from_m + self.step_m * i as f64)
    }

    /// When the body is at a position, in s.
    pub fn time_s(&self, x_m: f64) -> Option<f64> {
        self.speed_m_s.map(|speed| (x_m - self.from_m) / speed)
    }

    /// What the beams do to the body at every position.
    pub fn rows<'a>(&'a self, model: &'a Model) -> impl Iterator<Item = SweepRow> + 'a {
        self.positions().map(|x_m| {
            let Total { fx_n, fy_n, mz_nm, contacts: [contacts_left, contacts_right] } =
                model.total(x_m);
            // Not −0 where nothing touches.
            let drag_n = 0.0 - fx_n;
            SweepRow {
                t_s: self.time_s(x_m),
                x_m,
                drag_n,
                fy_n,
                mz_nm,
                contacts_left,
                contacts_right,
            }
        })
    }
}

/// Every beam that touches a body at `x_m`.
pub fn beam_rows(model: &Model, x_m: f64) -> impl Iterator<Item = BeamRow> + '_ {
    Wall::BOTH.into_iter().flat_map(move |wall| {
        model.beams(wall, x_m).filter_map(move |(beam, contact, force)| {
            let phi = model.side(wall)?.place_rad(&contact);
            let (wall_name, phi_rad) = match wall {
                Wall::Left => ("left", phi),
                Wall::Right => ("right", -phi),
            };
            Some(BeamRow {
                wall: wall_name,
                beam: beam + 1,
                base_m: model.base_m(beam),
                phi_rad,
                deflection_rad: force.deflection_rad,
                // Not −0 at the first touch.
                fx_n: force.fx_n + 0.0,
                fy_n: force.fy_n + 0.0,
                mz_nm: force.mz_nm + 0.0,
            })
        })
    })
}
