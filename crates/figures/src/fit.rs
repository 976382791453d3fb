//! Predicted against measured values, and residuals (predicted minus measured).

use super::axes::{BOTTOM_MARGIN, LEFT_MARGIN, Panel, PlotAxis, ValueRange, decimal};
use super::canvas::{Figure, Pen, Rect, Size, Style, number, point};
use super::density::{ColourScale, PoseMean, doublings, draw_cells, draw_poses, poses};
use super::histogram::{Histogram2d, HistogramCell};
use super::palette;
use shell_data::wrench::{Axes, Axis, PerAxis};

/// Predictions and measurements reduced to the data of a figure (some 9 MB, whatever the number of
/// rows). Parts may be merged in any order.
#[derive(Clone, Debug, Default)]
pub struct FitPlot {
    name: RowsName,
    axes: PerAxis<AxisPlot>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RowsName {
    #[default]
    Training,
    HeldOut,
}

impl RowsName {
    fn words(self) -> &'static str {
        match self {
            Self::Training => "training rows",
            Self::HeldOut => "held-out rows",
        }
    }
}

#[derive(Clone, Debug, Default)]
struct AxisPlot {
    agreement: Histogram2d<256, 256>,
    /// Residual against predicted. Bins are finer along the residual: with rows far out, only part
    /// is shown.
    residual: Histogram2d<128, 1024>,
    squares: f64,
}

impl FitPlot {
    pub fn new(name: RowsName) -> Self {
        Self { name, ..Self::default() }
    }

    /// Adds six columns in the order of [`Axis::ALL`], N and N·m. Rows that are not finite are
    /// skipped for their axis.
    ///
    /// # Panics
    /// If there are not six columns of one length.
    pub fn add<P: AsRef<[f64]>, M: AsRef<[f64]>>(&mut self, predicted: &[P], measured: &[M]) {
        assert!(predicted.len() == 6 && measured.len() == 6, "one column per axis");
        for ((axis, predicted), measured) in self.axes.iter_mut().zip(predicted).zip(measured) {
            axis.add(predicted.as_ref(), measured.as_ref());
        }
    }

    pub fn merge(&mut self, other: &Self) {
        for (axis, other) in self.axes.iter_mut().zip(&other.axes) {
            axis.agreement.merge(&other.agreement);
            axis.residual.merge(&other.residual);
            axis.squares += other.squares;
        }
    }

    /// Number of rows with a finite prediction and measurement, for the axis with the fewest.
    pub fn rows(&self) -> u64 {
        self.axes.iter().map(|axis| axis.residual.points).min().unwrap_or(0)
    }
}

impl AxisPlot {
    fn add(&mut self, predicted: &[f64], measured: &[f64]) {
        let differences: Vec<f64> = predicted.iter().zip(measured).map(|(p, m)| p - m).collect();
        self.agreement.add(measured, predicted);
        self.residual.add(predicted, &differences);
        let finite = differences.iter().filter(|residual| residual.is_finite());
        self.squares += finite.map(|residual| residual * residual).sum::<f64>();
    }

    fn rms(&self) -> f64 {
        (self.squares / self.residual.points.max(1) as f64).sqrt()
    }
}

// Lengths in CSS pixels. A4 portrait at 96 per inch is 794 by 1123.
const WIDTH: f64 = 900.0;
const TOP: f64 = 62.0;
/// Width of a panel on a screen; the size of cells is chosen for it.
const PLOT_WIDTH: f64 = 222.0;
const MARGINS: f64 = 78.0;
const RESIDUAL_HEIGHT: f64 = 130.0;
const PROFILE_WIDTH: f64 = 42.0;

/// Height of the two panels of an axis, without the side of the upper one.
const BLOCK: f64 = 24.0 + BOTTOM_MARGIN + 14.0 + RESIDUAL_HEIGHT + BOTTOM_MARGIN + 14.0;

/// Draws, for each of `axes`, predicted against measured, residual against predicted, and the
/// distribution of residuals. Densities show the `test` rows, if any, with the distribution of the
/// training rows as an outline; otherwise all show the `train` rows.
pub fn fit_figure(
    size: Size,
    title: &str,
    axes: Axes,
    train: &FitPlot,
    test: Option<&FitPlot>,
) -> Figure {
    let (width, columns) = (size.width(WIDTH), if size.is_narrow() { 2 } else { 3 });
    let side = width / columns as f64 - MARGINS;
    let shown = test.unwrap_or(train);
    let bands = axes.count().div_ceil(columns).max(1) as f64;
    let mut canvas = Figure::titled(size, width, TOP + bands * (BLOCK + side), title);
    let rows = match test {
        None => format!("{} {}", shown.rows(), shown.name.words()),
        Some(test) => {
            format!("{} test rows; outlined: {} training rows", test.rows(), train.rows())
        }
    };
    canvas.text((16.0, 42.0), &rows, Style::START);

    let views: Vec<AxisView> = axes
        .iter()
        .map(|axis| {
            let outlined = test.map(|_| &train.axes[axis.index()]);
            AxisView::new(axis, &shown.axes[axis.index()], outlined)
        })
        .collect();
    if views.iter().any(|view| !view.poses.is_empty()) {
        let text = "ring and bar: mean and standard deviation of a constant load";
        canvas.text((16.0, 56.0), text, Style::START);
    }
    let cells = views.iter().flat_map(|view| view.agreement.iter().chain(&view.residuals));
    let colours = ColourScale::for_cells(cells);
    let length = if size.is_narrow() { 90.0 } else { 180.0 };
    let bar = Rect { left: width - 18.0 - length, top: 16.0, width: length, height: 11.0 };
    colours.draw_bar(&mut canvas, bar, "rows per cell");

    for (position, view) in views.iter().enumerate() {
        let left = (side + MARGINS) * (position % columns) as f64 + LEFT_MARGIN;
        let top = TOP + (BLOCK + side) * (position / columns) as f64 + 24.0;
        let area = Rect { left, top, width: side, height: side };
        view.draw_agreement(&mut canvas, area, colours);
        let top_below = area.bottom() + BOTTOM_MARGIN + 14.0;
        let below = Rect { top: top_below, height: RESIDUAL_HEIGHT, ..area };
        view.draw_residual(&mut canvas, below, colours);
        let rms = |plot: &FitPlot| significant(plot.axes[view.axis.index()].rms());
        let mut text = format!("RMS {} {}", rms(shown), view.axis.unit());
        if test.is_some() && !size.is_narrow() {
            text += &format!(" (train {})", rms(train));
        }
        canvas.text((area.right(), top - 9.0), &text, Style::END);
    }
    canvas
}

struct AxisView {
    axis: Axis,
    agreement: Vec<HistogramCell>,
    agreement_range: ValueRange,
    poses: Vec<PoseMean>,
    residuals: Vec<HistogramCell>,
    predicted_range: ValueRange,
    residual_range: ValueRange,
    beyond: u64,
    profile: Vec<(ValueRange, u64)>,
    outline: Vec<(ValueRange, u64)>,
}

impl AxisView {
    /// Shows all residuals, unless a few would flatten all others: then the middle 99.8 % and as
    /// much again on both sides, with the number of rows beyond.
    fn new(axis: Axis, data: &AxisPlot, outlined: Option<&AxisPlot>) -> Self {
        let [measured, predicted] = data.agreement.ranges();
        let merge = doublings(&data.agreement, PLOT_WIDTH);
        let histogram = &data.residual;
        let [predicted_range, all] = histogram.ranges();
        let marginal = histogram.marginal_y();
        let core = core(&marginal, histogram.points).unwrap_or(all);
        let reach = core.high.abs().max(core.low.abs()) * 2.0;
        let everything = all.high.abs().max(all.low.abs());
        let reach = if everything > 2.0 * reach { reach } else { everything };
        let residual_range = ValueRange { low: -reach, high: reach };
        let is_beyond = |range: &ValueRange| range.low > reach || range.high < -reach;

        // Double the cells until they are about square on paper.
        let x_merge = doublings(histogram, PLOT_WIDTH - PROFILE_WIDTH);
        let bin = marginal.first().map_or(1.0, |(range, _)| range.high - range.low);
        let shown_bins = (2.0 * reach / bin).max(1.0);
        let wanted = f64::from(2u32.pow(7 - x_merge.min(7))) * 0.75;
        let y_merge = (shown_bins / wanted).log2().round().max(0.0) as u32;
        let outline = outlined.map(|data| profile(&data.residual.marginal_y(), residual_range));
        Self {
            axis,
            agreement: data.agreement.cells([merge; 2]),
            agreement_range: measured.union(predicted),
            poses: poses(&data.agreement.cells([0; 2])),
            residuals: histogram.cells([x_merge, y_merge]),
            predicted_range,
            residual_range,
            beyond: marginal.iter().filter(|bin| is_beyond(&bin.0)).map(|bin| bin.1).sum(),
            profile: profile(&marginal, residual_range),
            outline: outline.unwrap_or_default(),
        }
    }

    fn draw_agreement(&self, canvas: &mut Figure, area: Rect, colours: ColourScale) {
        let (name, unit) = (self.axis.name(), self.axis.unit());
        let [x, y] = ["measured", "predicted"].map(|what| {
            PlotAxis::linear(&format!("{what} {name}"), unit, self.agreement_range).padded(0.04)
        });
        let panel = Panel { area, x, y };
        canvas.title((area.left, area.top - 9.0), name);
        let means = self.poses.iter().map(|p| ((p.measured, p.predicted), p.sd));
        let ValueRange { low, high } = panel.x.range;
        let identity = [(low, low), (high, high)];
        draw_density(canvas, &panel, (&self.agreement, colours), means, identity);
    }

    fn draw_residual(&self, canvas: &mut Figure, whole: Rect, colours: ColourScale) {
        let (name, unit) = (format!("predicted {}", self.axis.name()), self.axis.unit());
        let area = Rect { width: whole.width - PROFILE_WIDTH, ..whole };
        let x = PlotAxis::linear(&name, unit, self.predicted_range).padded(0.04);
        let y = PlotAxis::linear("residual", unit, self.residual_range).padded(0.1);
        let panel = Panel { area, x, y };
        let means = self.poses.iter().map(|p| ((p.predicted, p.predicted - p.measured), p.sd));
        let zero = [(panel.x.range.low, 0.0), (panel.x.range.high, 0.0)];
        draw_density(canvas, &panel, (&self.residuals, colours), means, zero);
        if self.beyond > 0 {
            let at = (area.right() - 6.0, area.bottom() - 6.0);
            canvas.text(at, &format!("{} beyond", self.beyond), Style::END);
        }
        let side = Rect { left: area.right(), width: PROFILE_WIDTH, ..area };
        canvas.clipped(side, |canvas| {
            if let Some(path) = steps(&self.profile, &panel, side) {
                canvas.fill(path + "Z", palette::series(5));
            }
            if let Some(path) = steps(&self.outline, &panel, side) {
                canvas.stroke(path, palette::INK, Pen::Round(1.0));
            }
        });
        canvas.frame(side, palette::INK);
    }
}

fn draw_density(
    canvas: &mut Figure,
    panel: &Panel,
    (cells, colours): (&[HistogramCell], ColourScale),
    means: impl Iterator<Item = ((f64, f64), f64)>,
    reference: [(f64, f64); 2],
) {
    panel.draw_grid(canvas);
    draw_cells(canvas, panel, cells, colours);
    draw_poses(canvas, panel, means);
    let ends = reference.map(|(x, y)| panel.place(x, y)).map(|(x, y)| point(x, y));
    canvas.stroke(format!("M{}", ends.join("L")), palette::REFERENCE, Pen::Dashed(1.0));
    panel.draw_frame(canvas);
}

/// The outline of a distribution at the side of a panel; `None` without values.
fn steps(profile: &[(ValueRange, u64)], panel: &Panel, side: Rect) -> Option<String> {
    let density = |&(range, count): &(ValueRange, u64)| count as f64 / (range.high - range.low);
    let densest = profile.iter().map(density).fold(0.0, f64::max);
    let height = |value: f64| panel.place(0.0, value).1;
    let mut path = format!("M{}", point(side.left, height(profile.first()?.0.low)));
    for bin in profile {
        let x = side.left + 0.92 * side.width * density(bin) / densest;
        for edge in [bin.0.low, bin.0.high] {
            path += &format!("L{}", point(x, height(edge)));
        }
    }
    Some(path + &format!("H{}", number(side.left)))
}

/// The range of all points except a thousandth at each end.
fn core(marginal: &[(ValueRange, u64)], points: u64) -> Option<ValueRange> {
    let edge = points / 1000;
    let is_past_edge = || {
        let mut passed = 0;
        move |bin: &&(ValueRange, u64)| {
            passed += bin.1;
            passed > edge
        }
    };
    let low = marginal.iter().find(is_past_edge())?.0.low;
    let high = marginal.iter().rev().find(is_past_edge())?.0.high;
    Some(ValueRange { low, high })
}

/// The counts over `shown` in at most 64 bins, each with its range; only the last may be narrower.
fn profile(marginal: &[(ValueRange, u64)], shown: ValueRange) -> Vec<(ValueRange, u64)> {
    let inside: Vec<_> =
        marginal.iter().filter(|(r, _)| r.high > shown.low && r.low < shown.high).collect();
    let merged = inside.len().div_ceil(64).next_power_of_two();
    let sum = |bins: &[&(ValueRange, u64)]| {
        let range = ValueRange { low: bins[0].0.low, high: bins[bins.len() - 1].0.high };
        (range, bins.iter().map(|bin| bin.1).sum())
    };
    inside.chunks(merged).map(sum).collect()
}

fn significant(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return decimal(value, 0);
    }
    match value.log10().floor() as i32 {
        power @ -4..=5 => decimal(value, (2 - power).max(0) as usize),
        _ => format!("{value:.2e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(range: std::ops::Range<u32>) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
        let column = |axis: u32, error: f64| {
            let value = move |i: u32| {
                let wave = (f64::from(i) * 0.01).sin() * f64::from(axis + 1);
                wave + error * (f64::from(i * (axis + 7)) * 1.7).sin()
            };
            range.clone().map(value).collect::<Vec<_>>()
        };
        ((0..6).map(|a| column(a, 0.1)).collect(), (0..6).map(|a| column(a, 0.0)).collect())
    }

    fn plot(range: std::ops::Range<u32>) -> FitPlot {
        let (predicted, measured) = rows(range);
        let mut plot = FitPlot::default();
        plot.add(&predicted, &measured);
        plot
    }

    #[test]
    fn the_picture_is_the_same_for_any_blocks() {
        let whole = fit_figure(Size::Screen, "fit", Axes::ALL, &plot(0..5000), None);
        let mut merged = plot(3000..5000);
        merged.merge(&plot(0..3000));
        assert_eq!(fit_figure(Size::Screen, "fit", Axes::ALL, &merged, None), whole);
    }

    #[test]
    fn rms_equals_that_of_predicted_minus_measured() {
        let plot = plot(0..5000);
        // 0.1·sin has a root mean square of 0.1/√2; 5000 samples cover whole turns to within 1 %.
        for axis in &plot.axes {
            assert!((axis.rms() - 0.1 / 2f64.sqrt()).abs() < 1e-3, "{}", axis.rms());
        }
    }

    #[test]
    fn a_few_rows_far_out_are_counted_and_do_not_flatten_the_rest() {
        let mut plot = plot(0..5000);
        let far = vec![vec![50.0; 3]; 6];
        plot.add(&far, &vec![vec![0.0; 3]; 6]);
        let view = AxisView::new(Axis::Fx, &plot.axes[0], None);
        assert_eq!(view.beyond, 3);
        assert!(view.residual_range.high < 0.5, "{:?}", view.residual_range);
        assert!(fit_figure(Size::Screen, "fit", Axes::ALL, &plot, None).svg().contains("3 beyond"));
    }

    #[test]
    fn empty_constant_and_unfinished_data_are_drawn() {
        let empty = FitPlot::default();
        assert!(
            fit_figure(Size::Screen, "fit", Axes::ALL, &empty, Some(&empty))
                .svg()
                .ends_with("</svg>\n")
        );
        let mut constant = FitPlot::default();
        constant.add(&vec![vec![1.0; 4]; 6], &vec![vec![1.0; 4]; 6]);
        constant.add(&vec![vec![f64::NAN; 2]; 6], &vec![vec![1.0; 2]; 6]);
        assert_eq!(constant.rows(), 4);
        let svg = fit_figure(Size::Screen, "fit", Axes::ALL, &constant, None).svg();
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
    }

    #[test]
    fn labels_have_three_significant_digits() {
        let written = [0.11834, 12.345, 123456.0, 0.00012345, 0.0, 1.5e-7].map(significant);
        assert_eq!(written, ["0.118", "12.3", "123456", "0.000123", "0", "1.50e-7"]);
    }
}
