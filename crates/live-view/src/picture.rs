//! A live view at one moment, as a browser is told it.

use serde::Serialize;

use super::model::{ChannelView, LiveModel, TraceView};

/// Columns of a trace: what a screen of 1,400 points has room for at three points each.
const COLUMNS: usize = 400;

/// Steps of a trace from its lower to its upper edge: finer than the points that a trace is high, and shorter to
/// write than the values.
const LEVELS: f64 = 1000.0;

/// A live view at one moment.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Picture {
    /// The time of the newest row, s.
    pub time_s: Option<f64>,
    /// The span of time that is shown, s.
    pub window_s: f64,
    /// Whether it stands still.
    pub is_paused: bool,
    /// Whether a tare is being taken.
    pub is_taring: bool,
    /// The traces; their columns are in thousandths of the range.
    pub traces: Vec<TraceView<u16>>,
    /// Numbers of marks, and where they stand, 0 on the left to 1.
    pub marks: Vec<(u32, f64)>,
    /// The channels; none where the board streams wrenches.
    pub channels: Vec<ChannelView>,
    /// The newest force along x, y and z, and the length of an arrow that reaches the edge, N.
    pub force: Option<([f64; 3], f64)>,
}

impl LiveModel {
    /// What is shown now.
    pub fn picture(&self) -> Picture {
        Picture {
            time_s: self.time_s(),
            window_s: self.window_s(),
            is_paused: self.is_paused(),
            is_taring: self.tare.is_pending(),
            traces: self.traces(COLUMNS).into_iter().map(levels).collect(),
            marks: self.marks_shown(),
            channels: self.channels(),
            force: self.force(),
        }
    }
}

/// A trace with its columns in levels of its range.
fn levels(view: TraceView) -> TraceView<u16> {
    let TraceView { name, unit, value, noise, range, columns } = view;
    let (low, high) = range;
    let level = |value: f64| (LEVELS * (value - low) / (high - low)).round() as u16;
    let columns = columns.into_iter().map(|ends| ends.map(|ends| ends.map(level))).collect();
    TraceView { name, unit, value, noise, range, columns }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::LiveRow;
    use shell_data::wrench::Axes;

    #[test]
    fn levels_are_thousandths_of_the_range() {
        let mut model = LiveModel::new(None, 1.0, Axes::ALL);
        for index in 0..=100 {
            let fx = if index == 50 { -1.5 } else { 1.0 };
            let wrench = Some([fx, 0.0, 0.0, 0.0, 0.0, 0.0]);
            model.push(LiveRow { time_s: f64::from(index) / 100.0, wrench, ..LiveRow::default() });
        }
        let picture = model.picture();
        let fx = &picture.traces[0];
        assert_eq!((fx.range, fx.columns.len()), ((-2.0, 2.0), COLUMNS));
        // By hand: (1 + 2) / 4 and (-1.5 + 2) / 4.
        let found: Vec<_> = fx.columns.iter().flatten().collect();
        assert_eq!(found.iter().filter(|ends| ***ends == [125, 125]).count(), 1);
        assert!(found.iter().all(|ends| **ends == [750, 750] || **ends == [125, 125]));
        assert_eq!(fx.columns.last(), Some(&Some([750, 750])));
        let text = serde_json::to_string(&picture).unwrap();
        assert!(text.contains(r#""name":"Fx","unit":"N","value":1.0"#), "{text}");
        // One event is one line.
        assert!(!text.contains('\n'));
    }
}
