//! The state of a live view.

use calibration::reading_ranges::ReadingRange;
use forces::RunningTare;
use serde::Serialize;
use shared_proto::CHANNELS;
use shell_data::wrench::{Axes, Axis};

use super::history::{History, LONGEST_S, LiveRow};

pub(crate) const WINDOWS_S: [f64; 6] = [1.0, 2.0, 5.0, 10.0, 20.0, LONGEST_S];

pub(crate) const MARKS: usize = 1000;

/// Block of time for noise and the channels' states, s.
const RECENT_S: f64 = 1.0;

/// Minimum scales of traces, N, N·m and counts, so that noise looks like noise.
const LEAST_FORCE: f64 = 0.05;
const LEAST_MOMENT: f64 = 0.001;
const LEAST_COUNTS: f64 = 20.0;

/// Columns of a trace. At three points each they fill 1,200 points, and a screen has room for 1,400.
const COLUMNS: usize = 400;

/// Steps in the range of a trace: finer than a screen's points, and shorter to transmit than values.
const LEVELS: f64 = 1000.0;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mark {
    pub number: u32,
    pub time_s: f64,
    /// Index of the newest frame at that time.
    pub index: i64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ChannelState {
    Fine,
    Outside,
    Saturated,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ChannelView {
    pub reading: f64,
    pub range: Option<(f64, f64)>,
    pub state: ChannelState,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TraceView<T = f64> {
    pub name: String,
    /// `N`, `N·m`, empty for counts.
    pub unit: &'static str,
    pub value: f64,
    /// Standard deviation over the last second.
    pub noise: f64,
    /// Values at the lower and the upper edge.
    pub range: (f64, f64),
    /// Minimum and maximum, the newest on the right.
    pub columns: Vec<Option<[T; 2]>>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Picture {
    pub time_s: Option<f64>,
    pub window_s: f64,
    pub is_paused: bool,
    pub is_taring: bool,
    /// Columns are in thousandths of the range.
    pub traces: Vec<TraceView<u16>>,
    /// Numbers and positions, from 0 on the left to 1.
    pub marks: Vec<(u32, f64)>,
    /// Empty if the board streams wrenches.
    pub channels: Vec<ChannelView>,
    /// Newest force along x, y and z, and the length of an arrow that reaches the edge, N.
    pub force: Option<([f64; 3], f64)>,
}

#[derive(Clone, Debug, Default)]
pub struct LiveDisplay {
    axes: Axes,
    ranges: Option<Vec<ReadingRange>>,
    history: History,
    frozen: Option<Box<History>>,
    window: usize,
    /// Zero that is subtracted for display: the mean of the rows after the tare's start.
    pub tare: RunningTare,
    pub marks: Vec<Mark>,
}

impl LiveDisplay {
    /// Creates an empty view, with the channels' `ranges` in the training data, an initial time
    /// span, and the available axes of the wrench.
    pub fn new(ranges: Option<Vec<ReadingRange>>, window_s: f64, axes: Axes) -> Self {
        let fits = |window: &f64| *window >= window_s;
        let window = WINDOWS_S.iter().position(fits).unwrap_or(WINDOWS_S.len() - 1);
        Self { ranges, axes, window, ..Self::default() }
    }

    pub fn push(&mut self, row: LiveRow) {
        if let Some(wrench) = row.wrench {
            self.tare.push(wrench);
        }
        self.history.push(row);
    }

    /// Pauses or resumes the display. Rows are taken in either state.
    pub fn toggle_pause(&mut self) {
        let running = self.frozen.is_none();
        self.frozen = running.then(|| Box::new(self.history.clone()));
    }

    pub fn is_paused(&self) -> bool {
        self.frozen.is_some()
    }

    pub fn zoom_in(&mut self) {
        self.window = self.window.saturating_sub(1);
    }

    pub fn zoom_out(&mut self) {
        self.window = (self.window + 1).min(WINDOWS_S.len() - 1);
    }

    pub fn window_s(&self) -> f64 {
        WINDOWS_S[self.window]
    }

    pub fn mark(&mut self) -> Option<Mark> {
        let newest = self.history.newest()?;
        let number = self.marks.last().map_or(1, |mark| mark.number + 1);
        let mark = Mark { number, time_s: newest.time_s, index: newest.index };
        if self.marks.len() == MARKS {
            self.marks.remove(0);
        }
        self.marks.push(mark);
        Some(mark)
    }

    pub fn time_s(&self) -> Option<f64> {
        self.shown().newest().map(|row| row.time_s)
    }

    /// Returns numbers of the displayed marks and their positions, from 0 on the left to 1.
    pub fn marks_shown(&self) -> Vec<(u32, f64)> {
        let Some(newest_s) = self.time_s() else { return Vec::new() };
        let position = |mark: &Mark| 1.0 - (newest_s - mark.time_s) / self.window_s();
        let positions = self.marks.iter().map(|mark| (mark.number, position(mark)));
        positions.filter(|(_, position)| (0.0..=1.0).contains(position)).collect()
    }

    /// Returns the traces: the available axes if forces are known, otherwise the eight readings.
    pub fn traces(&self, columns: usize) -> Vec<TraceView> {
        let Some(newest) = self.shown().newest() else { return Vec::new() };
        match (newest.wrench, newest.readings) {
            (Some(_), _) => self.axes.iter().map(|axis| self.axis(axis, columns)).collect(),
            (None, Some(_)) => (0..CHANNELS).map(|c| self.channel(c, columns)).collect(),
            (None, None) => Vec::new(),
        }
    }

    fn axis(&self, axis: Axis, columns: usize) -> TraceView {
        let at = axis.index();
        let zero = self.tare.zero[at];
        let value = |row: &LiveRow| row.wrench.map(|wrench| wrench[at] - zero);
        let least = if axis.is_moment() { LEAST_MOMENT } else { LEAST_FORCE };
        let columns = self.shown().columns(self.window_s(), columns, value);
        let bound = nice_bound(largest(&columns), least);
        self.trace(axis.name().to_owned(), axis.unit(), (-bound, bound), columns, value)
    }

    fn channel(&self, channel: usize, columns: usize) -> TraceView {
        let value = |row: &LiveRow| row.readings.map(|readings| readings[channel]);
        let columns = self.shown().columns(self.window_s(), columns, value);
        let ends = columns.iter().flatten();
        let (low, high) = ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), ends| {
            (low.min(ends[0]), high.max(ends[1]))
        });
        let range = nice_range(low, high, LEAST_COUNTS);
        self.trace(format!("s{}", channel + 1), "", range, columns, value)
    }

    fn trace(
        &self,
        name: String,
        unit: &'static str,
        range: (f64, f64),
        columns: Vec<Option<[f64; 2]>>,
        value: impl Fn(&LiveRow) -> Option<f64>,
    ) -> TraceView {
        let recent: Vec<f64> = self.shown().last(RECENT_S).filter_map(&value).collect();
        let count = recent.len().max(1) as f64;
        let mean = recent.iter().sum::<f64>() / count;
        let squares: f64 = recent.iter().map(|value| (value - mean).powi(2)).sum();
        let newest = self.shown().newest().and_then(&value).unwrap_or_default();
        let noise = (squares / (count - 1.0).max(1.0)).sqrt();
        TraceView { name, unit, value: newest, noise, range, columns }
    }

    pub fn channels(&self) -> Vec<ChannelView> {
        let Some(readings) = self.shown().newest().and_then(|row| row.readings) else {
            return Vec::new();
        };
        let masks = self.shown().last(RECENT_S).fold((0, 0), |(saturated, outside), row| {
            (saturated | row.saturated, outside | row.out_of_range)
        });
        let view = |(channel, reading): (usize, f64)| {
            let has = |mask: u8| mask >> channel & 1 == 1;
            let range = self.ranges.as_ref().and_then(|ranges| ranges.get(channel));
            ChannelView {
                reading,
                range: range.map(|range| (range.min, range.max)),
                state: match () {
                    () if has(masks.0) => ChannelState::Saturated,
                    () if has(masks.1) => ChannelState::Outside,
                    () => ChannelState::Fine,
                },
            }
        };
        readings.into_iter().enumerate().map(view).collect()
    }

    /// Returns the newest force, and the length of an arrow to the edge, N, if all three are known.
    pub fn force(&self) -> Option<([f64; 3], f64)> {
        let forces = [Axis::Fx, Axis::Fy, Axis::Fz].into_iter().collect();
        if !self.axes.contain(forces) {
            return None;
        }
        let zero = self.tare.zero;
        let value = |axis: usize| move |row: &LiveRow| Some(row.wrench?[axis] - zero[axis]);
        let newest = self.shown().newest()?;
        newest.wrench?;
        let of = |axis| largest(&self.shown().columns(self.window_s(), 1, value(axis)));
        let reach = nice_bound((0..3).map(of).fold(0.0, f64::max), LEAST_FORCE);
        let force = std::array::from_fn(|axis| value(axis)(newest).unwrap_or_default());
        Some((force, reach))
    }

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

    fn shown(&self) -> &History {
        self.frozen.as_deref().unwrap_or(&self.history)
    }
}

fn largest(columns: &[Option<[f64; 2]>]) -> f64 {
    let ends = columns.iter().flatten().flatten();
    ends.fold(0.0, |largest, value| largest.max(value.abs()))
}

fn levels(view: TraceView) -> TraceView<u16> {
    let TraceView { name, unit, value, noise, range, columns } = view;
    let (low, high) = range;
    let level = |value: f64| (LEVELS * (value - low) / (high - low)).round() as u16;
    let columns = columns.into_iter().map(|ends| ends.map(|ends| ends.map(level))).collect();
    TraceView { name, unit, value, noise, range, columns }
}

/// Returns the smallest of 1, 2 and 5 times a power of ten that is not below `largest` and `least`.
fn nice_bound(largest: f64, least: f64) -> f64 {
    let largest = largest.abs().max(least);
    if !largest.is_finite() || largest <= 0.0 {
        return least.max(f64::MIN_POSITIVE);
    }
    let decade = 10_f64.powf(largest.log10().floor());
    // A rounding error in the logarithm must not put the signal outside.
    let steps = [1.0, 2.0, 5.0, 10.0, 20.0].map(|step| step * decade);
    steps.into_iter().find(|&bound| bound >= largest * (1.0 - 1e-12)).unwrap_or(largest)
}

/// Returns a range of round numbers around `low` to `high`, at least `least` long.
fn nice_range(low: f64, high: f64, least: f64) -> (f64, f64) {
    if !(low.is_finite() && high.is_finite() && low <= high) {
        return (0.0, least);
    }
    let length = nice_bound((high - low).max(least), least);
    let step = length / 10.0;
    let start = ((low + high - length) / 2.0 / step).round() * step;
    // Rounding shifts the ends by up to half a step.
    match start <= low && high <= start + length {
        true => (start, start + length),
        false => (start - step, start + length + step),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn display() -> LiveDisplay {
        let mut display = LiveDisplay::new(None, 10.0, Axes::ALL);
        (0..=1000).for_each(|i| display.push(row(i)));
        display
    }

    fn row(index: i64) -> LiveRow {
        let time_s = index as f64 / 100.0;
        LiveRow {
            time_s,
            index,
            readings: Some([2000.0; CHANNELS]),
            wrench: Some([1.5 * (time_s * 3.0).sin(), 0.25, 0.0, 0.0, 0.0, 0.0]),
            ..LiveRow::default()
        }
    }

    #[test]
    fn a_trace_has_a_round_scale_and_the_noise_of_its_last_second() {
        let traces = display().traces(100);
        assert_eq!(traces.len(), 6);
        let fx = &traces[0];
        assert_eq!((fx.name.as_str(), fx.unit, fx.range), ("Fx", "N", (-2.0, 2.0)));
        assert!(fx.columns.iter().all(Option::is_some));
        // The standard deviation of 100 rows of the sine, by definition.
        let recent: Vec<f64> = (901..=1000).map(|i| row(i).wrench.unwrap()[0]).collect();
        let mean = recent.iter().sum::<f64>() / 100.0;
        let sd = (recent.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / 99.0).sqrt();
        // Sums of a hundred terms of 1 N.
        assert!((fx.noise - sd).abs() < 1e-13, "{} {sd}", fx.noise);
        assert_eq!(traces[1].value, 0.25);
    }

    #[test]
    fn a_tare_takes_the_mean_of_the_next_rows_and_changes_only_the_display() {
        let mut display = display();
        display.tare.begin();
        for index in 1001..1001 + forces::DEFAULT_TARE_FRAMES as i64 - 1 {
            display.push(row(index));
            assert!(display.tare.is_pending());
        }
        display.push(row(1050));
        assert!(!display.tare.is_pending());
        assert!(display.traces(10)[1].value.abs() < 1e-12, "a mean of 0.25");
        display.tare = RunningTare::default();
        assert_eq!(display.traces(10)[1].value, 0.25);
    }

    #[test]
    fn a_paused_picture_stands_still_while_rows_are_taken() {
        let mut display = display();
        display.toggle_pause();
        let before = (display.traces(50), display.time_s());
        (1001..3000).for_each(|i| display.push(row(i)));
        assert_eq!((display.traces(50), display.time_s()), before);
        display.toggle_pause();
        assert_eq!(display.time_s(), Some(29.99));
    }

    #[test]
    fn zoom_ends_at_the_oldest_row() {
        let mut display = display();
        (0..20).for_each(|_| display.zoom_out());
        assert_eq!(display.window_s(), LONGEST_S);
        (0..20).for_each(|_| display.zoom_in());
        assert_eq!(display.window_s(), 1.0);
    }

    #[test]
    fn a_mark_stands_where_it_was_made_and_moves_left() {
        let mut display = display();
        let mark = display.mark().unwrap();
        assert_eq!((mark.number, mark.index, mark.time_s), (1, 1000, 10.0));
        (1001..=1500).for_each(|i| display.push(row(i)));
        assert_eq!(display.marks_shown(), [(1, 0.5)]);
        assert_eq!(LiveDisplay::new(None, 0.0, Axes::ALL).mark(), None);
    }

    #[test]
    fn a_channel_is_as_bad_as_its_worst_row_of_the_last_second() {
        let ranges = Some(vec![ReadingRange { min: 1000.0, max: 3000.0 }; CHANNELS]);
        let mut display = LiveDisplay::new(ranges, 10.0, Axes::ALL);
        for index in 0..300 {
            let saturated = u8::from(index == 250) << 2;
            let out_of_range = u8::from(index == 10) << 4 | u8::from(index == 290) << 5;
            display.push(LiveRow { saturated, out_of_range, ..row(index) });
        }
        let states: Vec<_> = display.channels().iter().map(|channel| channel.state).collect();
        let mut expected = [ChannelState::Fine; CHANNELS];
        (expected[2], expected[5]) = (ChannelState::Saturated, ChannelState::Outside);
        assert_eq!(states, expected);
        assert_eq!(display.channels()[0].range, Some((1000.0, 3000.0)));
    }

    #[test]
    fn without_forces_readings_are_traced() {
        let mut display = LiveDisplay::new(None, 5.0, Axes::ALL);
        display.push(LiveRow { wrench: None, ..row(0) });
        let traces = display.traces(10);
        assert_eq!((traces.len(), traces[7].name.as_str()), (8, "s8"));
        assert!(traces[0].range.0 <= 2000.0 && 2000.0 <= traces[0].range.1);
        assert_eq!(display.force(), None);
    }

    #[test]
    fn levels_are_thousandths_of_the_range() {
        let mut display = LiveDisplay::new(None, 1.0, Axes::ALL);
        for index in 0..=100 {
            let fx = if index == 50 { -1.5 } else { 1.0 };
            let wrench = Some([fx, 0.0, 0.0, 0.0, 0.0, 0.0]);
            display.push(LiveRow {
                time_s: f64::from(index) / 100.0,
                wrench,
                ..LiveRow::default()
            });
        }
        let picture = display.picture();
        let fx = &picture.traces[0];
        assert_eq!((fx.range, fx.columns.len()), ((-2.0, 2.0), COLUMNS));
        // By hand: (1 + 2) / 4 and (-1.5 + 2) / 4.
        let found: Vec<_> = fx.columns.iter().flatten().collect();
        assert_eq!(found.iter().filter(|ends| ***ends == [125, 125]).count(), 1);
        assert!(found.iter().all(|ends| **ends == [750, 750] || **ends == [125, 125]));
        assert_eq!(fx.columns.last(), Some(&Some([750, 750])));
        let text = serde_json::to_string(&picture).unwrap();
        assert!(text.contains(r#""name":"Fx","unit":"N","value":1.0"#), "{text}");
        assert!(!text.contains('\n'));
    }

    #[test]
    fn bounds_are_round_and_contain_the_values() {
        let cases = [(0.0, 0.1), (0.03, 0.1), (0.11, 0.2), (0.2, 0.2), (3.1, 5.0), (70.0, 100.0)];
        for (largest, expected) in cases {
            let bound = nice_bound(largest, 0.1);
            assert!((bound - expected).abs() < 1e-12 * expected, "{largest}: {bound}");
        }
        assert_eq!(nice_bound(f64::NAN, 0.1), 0.1);
        assert!(nice_bound(1e-300, 1e-3) >= 1e-3);
    }

    #[test]
    fn ranges_hold_their_values_and_are_not_much_longer() {
        for (low, high) in
            [(1980.0, 2011.0), (0.0, 4095.0), (5.0, 5.0), (-3.0, 40.0), (99.9, 100.1)]
        {
            let (start, end) = nice_range(low, high, 20.0);
            assert!(start <= low && high <= end, "{low} {high}: {start} {end}");
            assert!(end - start <= 3.0 * (high - low).max(20.0), "{low} {high}: {start} {end}");
        }
        assert_eq!(nice_range(f64::NAN, 1.0, 20.0), (0.0, 20.0));
    }
}
