//! Axes with ranges and ticks; panels, which are pairs of axes with frame, grid and labels.

use super::canvas::{Figure, Pen, Rect, Style, number, point};
use super::palette;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Spacing {
    /// Equal differences have equal lengths.
    Linear,
    /// Equal ratios have equal lengths; values must be positive.
    Log,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ValueRange {
    pub(super) low: f64,
    pub(super) high: f64,
}

impl ValueRange {
    pub(super) const EMPTY: Self = Self { low: f64::INFINITY, high: f64::NEG_INFINITY };

    pub(super) fn over(values: impl IntoIterator<Item = f64>) -> Self {
        values.into_iter().fold(Self::EMPTY, Self::including)
    }

    pub(super) fn including(self, value: f64) -> Self {
        Self { low: self.low.min(value), high: self.high.max(value) }
    }

    pub(super) fn union(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct PlotAxis {
    quantity: String,
    unit: String,
    spacing: Spacing,
    pub(super) range: ValueRange,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Tick {
    pub(super) value: f64,
    /// Empty for a minor tick.
    pub(super) label: String,
}

impl PlotAxis {
    /// An axis over `low..=high`. Swaps reversed ends, widens an empty range, and replaces one that is not finite
    /// or, on a logarithmic axis, not positive.
    pub fn new(quantity: &str, unit: &str, spacing: Spacing, low: f64, high: f64) -> Self {
        let (low, high) = (low.min(high), high.max(low));
        // A range that is too short for ticks, or has a NaN end, is replaced by a range around its
        // lower end.
        let (low, high) = match spacing {
            Spacing::Log => match (if low > 0.0 { low } else { high / 1e6 }, high) {
                (low, high) if low > 1e-300 && high < 1e300 && high > low * 1.001 => (low, high),
                (low, _) if low > 1e-300 && low < 1e300 => (low / 2.0, low * 2.0),
                _ => (0.1, 10.0),
            },
            Spacing::Linear => {
                let largest = low.abs().max(high.abs());
                let is_long = high - low > (1e-12 * largest).max(1e-300);
                match (low, high) {
                    (low, high) if is_long && largest < 1e300 => (low, high),
                    (low, _) if low.abs() > 1e-300 && low.abs() < 1e300 => {
                        (low - 0.1 * low.abs(), low + 0.1 * low.abs())
                    }
                    _ => (-1.0, 1.0),
                }
            }
        };
        let range = ValueRange { low, high };
        Self { quantity: quantity.to_owned(), unit: unit.to_owned(), spacing, range }
    }

    pub(super) fn linear(quantity: &str, unit: &str, ValueRange { low, high }: ValueRange) -> Self {
        Self::new(quantity, unit, Spacing::Linear, low, high)
    }

    pub fn padded(mut self, share: f64) -> Self {
        let ValueRange { low, high } = self.range;
        let (low, high) = match self.spacing {
            Spacing::Linear => (low - share * (high - low), high + share * (high - low)),
            Spacing::Log => (low / (high / low).powf(share), high * (high / low).powf(share)),
        };
        self.range = ValueRange { low, high };
        self
    }

    /// The position of a value, 0 at the lower end and 1 at the upper.
    pub(super) fn position(&self, value: f64) -> f64 {
        let ValueRange { low, high } = self.range;
        match self.spacing {
            Spacing::Linear => (value - low) / (high - low),
            Spacing::Log => (value.ln() - low.ln()) / (high.ln() - low.ln()),
        }
    }

    /// Name and unit as one text, with the power of ten omitted from the labels.
    pub(super) fn title(&self) -> String {
        let power = self.power_of_ten();
        let factor = if power == 0 { String::new() } else { format!("10{}", superscript(power)) };
        match format!("{factor} {}", self.unit).trim() {
            "" => self.quantity.clone(),
            unit => format!("{} ({unit})", self.quantity),
        }
    }

    /// Ticks that divide the axis into at most `count` parts: multiples of 1, 2 or 5 times a power of ten; on a log
    /// axis the powers of ten.
    pub(super) fn ticks(&self, count: usize) -> Vec<Tick> {
        if self.spacing == Spacing::Log {
            return self.log_ticks(count);
        }
        let ValueRange { low, high } = self.range;
        let slack = 1e-9 * (high - low);
        let intervals = |step: f64| ((high + slack) / step).floor() - ((low - slack) / step).ceil();
        let step = round_steps((high - low) / (count + 1) as f64)
            .find(|&step| intervals(step) <= count.max(1) as f64)
            .expect("the widest step has one tick at most");
        let power = self.power_of_ten();
        let decimals = (f64::from(power) - step.log10() - 1e-9).ceil().clamp(0.0, 15.0) as usize;
        // Multiples of the step, not a running sum, so that rounding errors do not accumulate.
        let first = ((low - slack) / step).ceil();
        (0..)
            .map(|i| (first + f64::from(i)) * step)
            .take_while(|&value| value <= high + slack)
            .map(|value| Tick { value, label: decimal(value / 10f64.powi(power), decimals) })
            .collect()
    }

    fn log_ticks(&self, count: usize) -> Vec<Tick> {
        let ValueRange { low, high } = self.range;
        let (from, to) = (low.log10().floor() as i32, high.log10().ceil() as i32);
        let decades = high.log10() - low.log10();
        let every = (decades / count.max(1) as f64).ceil().max(1.0) as i32;
        let within = low * (1.0 - 1e-9)..=high * (1.0 + 1e-9);
        let digits = if every == 1 { 1..10 } else { 1..2 };
        let marks = (from..=to).flat_map(|power| digits.clone().map(move |digit| (digit, power)));
        let ticks = marks.map(|(digit, power)| {
            let is_labelled = match digit {
                1 => power.rem_euclid(every) == 0,
                2 | 5 => decades < 2.0,
                _ => false,
            };
            let label = if is_labelled { log_label(digit, power) } else { String::new() };
            Tick { value: f64::from(digit) * 10f64.powi(power), label }
        });
        ticks.filter(|tick| within.contains(&tick.value)).collect()
    }

    /// Power of ten, a multiple of three, omitted from the labels to keep them short.
    fn power_of_ten(&self) -> i32 {
        let largest = self.range.low.abs().max(self.range.high.abs());
        if self.spacing == Spacing::Log || (0.1..10_000.0).contains(&largest) {
            0
        } else {
            (largest.log10() / 3.0 - 1e-9).floor() as i32 * 3
        }
    }
}

fn round_steps(least: f64) -> impl Iterator<Item = f64> {
    let power = least.log10().floor() as i32;
    (power..)
        .flat_map(|power| [1.0, 2.0, 5.0].map(|digit| digit * 10f64.powi(power)))
        .filter(move |&step| step >= least * (1.0 - 1e-9))
}

pub(super) fn decimal(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let is_zero = text.bytes().all(|byte| matches!(byte, b'0' | b'.' | b'-'));
    if is_zero { text.replace('-', "") } else { text.replace('-', "\u{2212}") }
}

pub(super) fn log_label(digit: i32, power: i32) -> String {
    match (digit, power) {
        (digit, 0..=3) => (digit * 10i32.pow(power as u32)).to_string(),
        (digit, -2..=-1) => {
            decimal(f64::from(digit) * 10f64.powi(power), power.unsigned_abs() as usize)
        }
        (1, power) => format!("10{}", superscript(power)),
        (digit, power) => format!("{digit}·10{}", superscript(power)),
    }
}

fn superscript(number: i32) -> String {
    let digit = |c| match c {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        c => char::from_u32('⁰' as u32 + (c as u32 - '0' as u32)).expect("a superscript digit"),
    };
    number.to_string().chars().map(digit).collect()
}

#[derive(Clone, Debug)]
pub(super) struct Panel {
    pub(super) area: Rect,
    pub(super) x: PlotAxis,
    pub(super) y: PlotAxis,
}

pub(super) const LEFT_MARGIN: f64 = 60.0;
pub(super) const BOTTOM_MARGIN: f64 = 40.0;

pub(super) fn wide_area(width: f64, top: f64, height: f64) -> Rect {
    Rect { left: LEFT_MARGIN + 8.0, top, width: width - LEFT_MARGIN - 24.0, height }
}

const TICK: f64 = 4.0;
const TICK_PITCH: [f64; 2] = [44.0, 28.0];

impl Panel {
    pub(super) fn place(&self, x: f64, y: f64) -> (f64, f64) {
        (
            self.area.left + self.area.width * self.x.position(x),
            self.area.bottom() - self.area.height * self.y.position(y),
        )
    }

    pub(super) fn draw(&self, canvas: &mut Figure, data: impl FnOnce(&mut Figure)) {
        self.draw_grid(canvas);
        canvas.clipped(self.area, data);
        self.draw_frame(canvas);
    }

    /// Draws the grid lines, before the data. An axis without a name has none.
    pub(super) fn draw_grid(&self, canvas: &mut Figure) {
        let Rect { left, top, .. } = self.area;
        let [right, bottom] = [self.area.right(), self.area.bottom()].map(number);
        let mut path = String::new();
        for tick in self.x_ticks().iter().filter(|tick| !tick.label.is_empty()) {
            let (x, _) = self.place(tick.value, self.y.range.low);
            path += &format!("M{}V{bottom}", point(x, top));
        }
        for tick in self.y_ticks().iter().filter(|tick| !tick.label.is_empty()) {
            let (_, y) = self.place(self.x.range.low, tick.value);
            path += &format!("M{}H{right}", point(left, y));
        }
        canvas.stroke(path, palette::GRID, Pen::Round(1.0));
    }

    pub(super) fn draw_zero(&self, canvas: &mut Figure) {
        let (_, zero) = self.place(self.x.range.low, 0.0);
        canvas.line((self.area.left, zero), (self.area.right(), zero), palette::ZERO, 1.0);
    }

    pub(super) fn draw_frame(&self, canvas: &mut Figure) {
        canvas.frame(self.area, palette::INK);
        self.draw_x_labels(canvas);
        self.draw_y_labels(canvas);
    }

    /// Like [`Self::draw_frame`], for a column of panels whose last one labels the horizontal axis.
    pub(super) fn draw_stacked_frame(&self, canvas: &mut Figure, is_last: bool) {
        canvas.frame(self.area, palette::INK);
        self.draw_y_labels(canvas);
        if is_last {
            self.draw_x_labels(canvas);
        }
    }

    fn draw_x_labels(&self, canvas: &mut Figure) {
        let bottom = self.area.bottom();
        for tick in self.x_ticks() {
            let (x, _) = self.place(tick.value, self.y.range.low);
            let length = if tick.label.is_empty() { TICK / 2.0 } else { TICK };
            canvas.line((x, bottom), (x, bottom + length), palette::INK, 1.0);
            canvas.text((x, bottom + 16.0), &tick.label, Style::LABEL);
        }
        let middle = self.area.left + self.area.width / 2.0;
        canvas.text((middle, bottom + 33.0), &self.x.title(), Style::LABEL);
    }

    pub(super) fn draw_y_labels(&self, canvas: &mut Figure) {
        let left = self.area.left;
        for tick in self.y_ticks() {
            let (_, y) = self.place(self.x.range.low, tick.value);
            let length = if tick.label.is_empty() { TICK / 2.0 } else { TICK };
            canvas.line((left - length, y), (left, y), palette::INK, 1.0);
            canvas.text((left - 7.0, y + 4.0), &tick.label, Style::END);
        }
        let middle = self.area.top + self.area.height / 2.0;
        let style = Style { upright: true, ..Style::LABEL };
        canvas.text((left - LEFT_MARGIN + 14.0, middle), &self.y.title(), style);
    }

    fn x_ticks(&self) -> Vec<Tick> {
        match self.x.title().is_empty() {
            true => Vec::new(),
            false => self.x.ticks((self.area.width / TICK_PITCH[0]) as usize),
        }
    }

    fn y_ticks(&self) -> Vec<Tick> {
        self.y.ticks((self.area.height / TICK_PITCH[1]) as usize)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn labels(axis: &PlotAxis, count: usize) -> Vec<String> {
        axis.ticks(count).into_iter().map(|tick| tick.label).filter(|l| !l.is_empty()).collect()
    }

    fn linear(low: f64, high: f64) -> PlotAxis {
        PlotAxis::new("force", "N", Spacing::Linear, low, high)
    }

    #[test]
    fn ticks_stand_at_one_two_five() {
        assert_eq!(labels(&linear(-1.0, 1.0), 4), ["−1.0", "−0.5", "0.0", "0.5", "1.0"]);
        assert_eq!(labels(&linear(0.0, 7.3), 4), ["0", "2", "4", "6"]);
        assert_eq!(labels(&linear(0.0, 0.9), 5), ["0.0", "0.2", "0.4", "0.6", "0.8"]);
    }

    #[test]
    fn small_and_large_values_move_a_power_of_ten_into_the_title() {
        let axis = linear(-0.002, 0.002);
        assert_eq!(axis.title(), "force (10⁻³ N)");
        assert_eq!(labels(&axis, 4), ["−2", "−1", "0", "1", "2"]);
        assert_eq!(linear(0.0, 2e6).title(), "force (10⁶ N)");
        assert_eq!(linear(0.0, 2.0).title(), "force (N)");
        assert_eq!(PlotAxis::new("rows", "", Spacing::Linear, 0.0, 5.0).title(), "rows");
    }

    #[test]
    fn log_ticks_stand_at_powers_of_ten() {
        let axis = PlotAxis::new("rows", "", Spacing::Log, 1.0, 1e6);
        assert_eq!(labels(&axis, 6), ["1", "10", "100", "1000", "10⁴", "10⁵", "10⁶"]);
        assert_eq!(labels(&axis, 3), ["1", "100", "10⁴", "10⁶"]);
        let narrow = PlotAxis::new("time", "s", Spacing::Log, 0.04, 0.6);
        assert_eq!(labels(&narrow, 4), ["0.05", "0.1", "0.2", "0.5"]);
    }

    proptest! {
        #[test]
        fn any_range_gives_a_few_distinct_ticks_within_it(low: f64, high: f64, log: bool) {
            let spacing = if log { Spacing::Log } else { Spacing::Linear };
            let axis = PlotAxis::new("q", "", spacing, low, high);
            let ValueRange { low, high } = axis.range;
            prop_assert!(low < high && low.is_finite() && high.is_finite());
            let ticks = axis.ticks(5);
            prop_assert!(ticks.len() < 700);
            for tick in &ticks {
                let position = axis.position(tick.value);
                prop_assert!((-1e-6..=1.0 + 1e-6).contains(&position), "{:?} {}", tick, position);
            }
            if !log {
                prop_assert!((2..=7).contains(&ticks.len()), "{:?}", ticks);
                prop_assert!(ticks.windows(2).all(|pair| pair[0].label != pair[1].label), "{:?}", ticks);
            }
        }
    }
}
