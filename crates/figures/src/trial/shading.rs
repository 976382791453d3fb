//! When the robot gets in, is in, and gets out.

use super::{Colour, Figure, LegendKey, Panel, ValueRange, number, palette, point};

/// The passage through a channel, s on the log's clock.
///
/// The window goes from first contact, as the robot's front comes to the channel, to last contact,
/// as its rear leaves it. The front then covers channel and robot in that time, and the robot gets
/// in, and out, in the share of it that its own length is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Passage {
    /// First contact, s.
    pub t_enter_s: f64,
    /// Last contact, s.
    pub t_exit_s: f64,
    /// How long the robot gets in, and out, s; `None` if its length is not known.
    pub entering_s: Option<f64>,
}

impl Passage {
    /// Of a robot and a channel of these lengths, m.
    pub fn new([t_enter_s, t_exit_s]: [f64; 2], robot_m: Option<f64>, channel_m: f64) -> Self {
        let share = |robot_m: f64| robot_m / (robot_m + channel_m);
        let entering_s = robot_m.map(|robot_m| share(robot_m) * (t_exit_s - t_enter_s));
        Self { t_enter_s, t_exit_s, entering_s }
    }

    /// The stretches in which the robot is partly and wholly within the channel, s. A robot longer
    /// than the channel is never wholly within it.
    pub fn stretches(&self) -> (Vec<[f64; 2]>, Option<[f64; 2]>) {
        let Self { t_enter_s, t_exit_s, entering_s } = *self;
        let Some(entering_s) = entering_s else {
            return (vec![[t_enter_s, t_exit_s]], None);
        };
        let (from, to) = (t_enter_s + entering_s, t_exit_s - entering_s);
        match from < to {
            true => (vec![[t_enter_s, from], [to, t_exit_s]], Some([from, to])),
            false => (vec![[t_enter_s, t_exit_s]], None),
        }
    }

    /// Fills the stretches, under everything else.
    pub(super) fn draw(&self, canvas: &mut Figure, panel: &Panel) {
        let (partly, wholly) = self.stretches();
        let mut fill = |[from, to]: [f64; 2], colour: Colour| {
            let ValueRange { low, high } = panel.x.range;
            let (from, to) = (from.max(low), to.min(high));
            if from < to {
                let [left, right] = [from, to].map(|time_s| panel.place(time_s, 0.0).0);
                let [right, top, bottom] = [right, panel.area.top, panel.area.bottom()].map(number);
                let corner = point(left, panel.area.top);
                canvas.fill(format!("M{corner}V{bottom}H{right}V{top}Z"), colour);
            }
        };
        partly.into_iter().for_each(|stretch| fill(stretch, palette::PARTLY_INSIDE));
        wholly.into_iter().for_each(|stretch| fill(stretch, palette::INSIDE));
    }

    /// What a legend says of the shading between two times, s.
    pub(super) fn keys(&self, ValueRange { low, high }: ValueRange) -> Vec<LegendKey<'static>> {
        let is_seen = |stretch: &[f64; 2]| stretch[0] < high && stretch[1] > low;
        let (partly, wholly) = self.stretches();
        let mut keys = Vec::new();
        if partly.iter().any(is_seen) {
            let both = self.entering_s.is_some();
            let name = if both { "entering, leaving" } else { "in the channel" };
            keys.push(LegendKey::Area(name, palette::PARTLY_INSIDE));
        }
        if wholly.iter().any(is_seen) {
            keys.push(LegendKey::Area("fully inside", palette::INSIDE));
        }
        keys
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_paper_s_robot_is_wholly_within_its_channel_for_the_middle_of_the_window() {
        // 18 cm of robot, 28 cm of channel, 46 cm of way.
        let passage = Passage::new([1.0, 5.6], Some(0.18), 0.28);
        let (partly, wholly) = passage.stretches();
        let near =
            |[a, b]: [f64; 2], [c, d]: [f64; 2]| (a - c).abs() < 1e-12 && (b - d).abs() < 1e-12;
        assert!(near(partly[0], [1.0, 2.8]) && near(partly[1], [3.8, 5.6]));
        assert!(near(wholly.unwrap(), [2.8, 3.8]));
    }

    #[test]
    fn a_robot_that_is_too_long_or_unknown_is_never_wholly_within() {
        for robot_m in [Some(0.4), None] {
            let (partly, wholly) = Passage::new([1.0, 2.0], robot_m, 0.28).stretches();
            assert_eq!((partly, wholly), (vec![[1.0, 2.0]], None));
        }
    }
}
