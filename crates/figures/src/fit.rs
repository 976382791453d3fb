//! How well a calibration predicts: predicted against measured, and what is left over.
//!
//! The residual is predicted minus measured, so that a positive one means a prediction too high.

use super::density::{ColourScale, doublings, draw_cells};
use super::histogram::{Histogram2d, HistogramCell, ValueRange};
use super::palette;
use super::panel::{BOTTOM_MARGIN, LEFT_MARGIN, Panel};
use super::plateau::{LoadPlateau, draw_plateaus, plateaus};
use super::scale::{PlotAxis, Spacing, decimal};
use super::size::Size;
use super::svg::{Anchor, Canvas, Figure, Rect, Style, number, point};
use shell_data::wrench::{Axes, Axis, PerAxis};

/// Cells of the histogram of predicted against measured.
const AGREEMENT_BINS: usize = 256;
/// Cells of the histogram of residual against predicted. Finer along the residual, of which a part
/// is shown when a few rows lie far out.
const RESIDUAL_BINS: [usize; 2] = [128, 1024];

/// Predictions and measurements of any number of rows, reduced to what a figure needs (some 9 MB).
///
/// Ranges need not be known beforehand, and parts may be merged in any order.
#[derive(Clone, Debug)]
pub struct FitPlot {
    axes: PerAxis<AxisPlot>,
}

#[derive(Clone, Debug)]
struct AxisPlot {
    agreement: Histogram2d,
    residual: Histogram2d,
    squares: f64,
    /// Residuals of the block at hand; kept to be used again.
    differences: Vec<f64>,
}

impl Default for FitPlot {
    fn default() -> Self {
        Self::new()
    }
}

impl FitPlot {
    /// No rows yet.
    pub fn new() -> Self {
        Self {
            axes: std::array::from_fn(|_| AxisPlot {
                agreement: Histogram2d::new(AGREEMENT_BINS, AGREEMENT_BINS),
                residual: Histogram2d::new(RESIDUAL_BINS[0], RESIDUAL_BINS[1]),
                squares: 0.0,
                differences: Vec::new(),
            }),
        }
    }

    /// Adds a block of rows: six columns each, in the order of [`Axis::ALL`], N and N·m.
    ///
    /// Rows that are not finite are left out of the axis concerned.
    ///
    /// # Panics
    /// If there are not six columns of one length.
    pub fn add<P: AsRef<[f64]>, M: AsRef<[f64]>>(&mut self, predicted: &[P], measured: &[M]) {
        assert!(predicted.len() == 6 && measured.len() == 6, "one column per axis");
        for (axis, (predicted, measured)) in
            self.axes.iter_mut().zip(predicted.iter().zip(measured))
        {
            axis.add(predicted.as_ref(), measured.as_ref());
        }
    }

    /// Adds the rows of another.
    pub fn merge(&mut self, other: &Self) {
        for (axis, other) in self.axes.iter_mut().zip(&other.axes) {
            axis.agreement.merge(&other.agreement);
            axis.residual.merge(&other.residual);
            axis.squares += other.squares;
        }
    }

    /// Number of rows with a finite prediction and measurement, that of the axis with fewest.
    pub fn rows(&self) -> u64 {
        self.axes.iter().map(|axis| axis.residual.points).min().unwrap_or(0)
    }
}

impl AxisPlot {
    fn add(&mut self, predicted: &[f64], measured: &[f64]) {
        self.differences.clear();
        self.differences.extend(predicted.iter().zip(measured).map(|(p, m)| p - m));
        self.agreement.add(measured, predicted);
        self.residual.add(predicted, &self.differences);
        let finite = self.differences.iter().filter(|residual| residual.is_finite());
        self.squares += finite.map(|residual| residual * residual).sum::<f64>();
    }

    /// Root of the mean square residual, N or N·m.
    fn rms(&self) -> f64 {
        (self.squares / self.residual.points.max(1) as f64).sqrt()
    }
}

// All in CSS pixels. A4 portrait at 96 per inch is 794 by 1123.
const WIDTH: f64 = 900.0;
const TOP: f64 = 62.0;
/// Of a panel on a screen; cells are as fine as suits that.
const PLOT_WIDTH: f64 = 222.0;
/// Beside a panel.
const MARGINS: f64 = 78.0;
const RESIDUAL_HEIGHT: f64 = 130.0;
const PROFILE_WIDTH: f64 = 42.0;

/// How panels are arranged.
#[derive(Clone, Copy)]
struct PanelGrid {
    width: f64,
    /// Axes beside each other.
    columns: usize,
    /// Width of a panel, and height of predicted against measured.
    side: f64,
}

impl PanelGrid {
    fn new(size: Size) -> Self {
        let (width, columns) = (size.width(WIDTH), if size.is_narrow() { 2 } else { 3 });
        Self { width, columns, side: width / columns as f64 - MARGINS }
    }

    /// Of the two panels of an axis.
    fn block_height(self) -> f64 {
        24.0 + self.side + BOTTOM_MARGIN + 14.0 + RESIDUAL_HEIGHT + BOTTOM_MARGIN + 14.0
    }
}

/// Draws, for each of some axes, predicted against measured, residual against predicted, and the residual's
/// distribution.
///
/// With `test` rows the densities are those of the test rows, and the distribution of the training
/// rows is outlined beside that of the test rows; without, all are of the `train` rows.
pub fn fit_figure(
    size: Size,
    title: &str,
    axes: Axes,
    train: &FitPlot,
    test: Option<&FitPlot>,
) -> Figure {
    let grid = PanelGrid::new(size);
    let shown = test.unwrap_or(train);
    let bands = axes.count().div_ceil(grid.columns).max(1) as f64;
    let mut canvas = Canvas::sized(size, grid.width, TOP + bands * grid.block_height());
    canvas.text((16.0, 24.0), title, Style::TITLE.anchored(Anchor::Start));
    let rows = match test {
        None => format!("{} training rows", shown.rows()),
        Some(test) => {
            format!("{} test rows; outlined: {} training rows", test.rows(), train.rows())
        }
    };
    canvas.text((16.0, 42.0), &rows, Style::LABEL.anchored(Anchor::Start));

    let found = shown.axes.each_ref().map(|axis| plateaus(&axis.agreement.cells([0; 2])));
    if axes.of(&found).iter().any(|plateaus| !plateaus.is_empty()) {
        let text = "ring and bar: mean and standard deviation of a constant load";
        canvas.text((16.0, 56.0), text, Style::LABEL.anchored(Anchor::Start));
    }
    let agreement = shown.axes.each_ref().map(|axis| {
        let merge = doublings(&axis.agreement, AGREEMENT_BINS, PLOT_WIDTH);
        axis.agreement.cells([merge; 2])
    });
    let views = shown.axes.each_ref().map(ResidualView::new);
    let positions = || axes.iter().map(Axis::index);
    let cells = positions().flat_map(|axis| &views[axis].cells);
    let colours =
        ColourScale::for_cells(positions().flat_map(|axis| &agreement[axis]).chain(cells));
    let length = if size.is_narrow() { 90.0 } else { 180.0 };
    let bar = Rect { left: grid.width - 18.0 - length, top: 16.0, width: length, height: 11.0 };
    colours.draw_bar(&mut canvas, bar, "rows per cell");

    for (position, axis) in axes.iter().enumerate() {
        let i = axis.index();
        let left = (grid.side + MARGINS) * (position % grid.columns) as f64 + LEFT_MARGIN;
        let top = TOP + grid.block_height() * (position / grid.columns) as f64 + 24.0;
        let area = Rect { left, top, width: grid.side, height: grid.side };
        draw_agreement(&mut canvas, area, axis, &shown.axes[i], &agreement[i], &found[i], colours);
        let top_below = area.bottom() + BOTTOM_MARGIN + 14.0;
        let below = Rect { top: top_below, height: RESIDUAL_HEIGHT, ..area };
        let outline = test.map(|_| &train.axes[i]);
        draw_residual(&mut canvas, below, axis, &views[i], &found[i], outline, colours);
        let rms = |plot: &FitPlot| significant(plot.axes[i].rms());
        let text = match test {
            None => format!("RMS {} {}", rms(train), axis.unit()),
            Some(test) if size.is_narrow() => format!("RMS {} {}", rms(test), axis.unit()),
            Some(test) => format!("RMS {} {} (train {})", rms(test), axis.unit(), rms(train)),
        };
        canvas.text((area.right(), top - 9.0), &text, Style::LABEL.anchored(Anchor::End));
    }
    canvas.finish()
}

fn draw_agreement(
    canvas: &mut Canvas,
    area: Rect,
    axis: Axis,
    data: &AxisPlot,
    cells: &[HistogramCell],
    plateaus: &[LoadPlateau],
    colours: ColourScale,
) {
    let range =
        data.agreement.ranges().map_or(ValueRange { low: -1.0, high: 1.0 }, |[x, y]| x.union(y));
    let scale = |what: &str| {
        let quantity = format!("{what} {}", axis.name());
        PlotAxis::new(&quantity, axis.unit(), Spacing::Linear, range.low, range.high).padded(0.04)
    };
    let panel = Panel { area, x: scale("measured"), y: scale("predicted") };
    canvas.text((area.left, area.top - 9.0), axis.name(), Style::TITLE.anchored(Anchor::Start));
    panel.draw_grid(canvas);
    draw_cells(canvas, &panel, cells, colours);
    let means = plateaus.iter().map(|p| ((p.measured, p.predicted), p.sd));
    draw_plateaus(canvas, &panel, means);
    let (from, to) = panel.x.range;
    let ((x0, y0), (x1, y1)) = (panel.place(from, from), panel.place(to, to));
    canvas.dashes(&format!("M{}L{}", point(x0, y0), point(x1, y1)), palette::REFERENCE, 1.0);
    panel.draw_frame(canvas);
}

/// The part of the residuals that is shown.
struct ResidualView {
    predicted: ValueRange,
    residual: ValueRange,
    cells: Vec<HistogramCell>,
    profile: Vec<(ValueRange, u64)>,
    beyond: u64,
}

impl ResidualView {
    /// Everything, unless a few rows far out would flatten all others: then the middle 99.8 % and as
    /// much again on both sides, and the number of rows beyond.
    fn new(data: &AxisPlot) -> Self {
        let histogram = &data.residual;
        let empty = ValueRange { low: -1.0, high: 1.0 };
        let [predicted, all] = histogram.ranges().unwrap_or([empty; 2]);
        let marginal = histogram.marginal_y();
        let core = core(&marginal, histogram.points).unwrap_or(all);
        let reach = core.high.abs().max(core.low.abs()) * 2.0;
        let everything = all.high.abs().max(all.low.abs());
        let reach = if everything > 2.0 * reach { reach } else { everything };
        let residual = ValueRange { low: -reach, high: reach };
        let is_beyond = |range: &ValueRange| range.low > reach || range.high < -reach;
        let beyond = marginal.iter().filter(|(r, _)| is_beyond(r)).map(|&(_, count)| count).sum();

        // As many doublings as leave the cells about square on paper.
        let x_merge = doublings(histogram, RESIDUAL_BINS[0], PLOT_WIDTH - PROFILE_WIDTH);
        let bin = marginal.first().map_or(1.0, |(range, _)| range.high - range.low);
        let shown_bins = (2.0 * reach / bin).max(1.0);
        let wanted = f64::from(2u32.pow(7 - x_merge.min(7))) * 0.75;
        let y_merge = (shown_bins / wanted).log2().round().max(0.0) as u32;
        let cells = histogram.cells([x_merge, y_merge]);
        Self { predicted, residual, cells, profile: profile(&marginal, residual), beyond }
    }
}

/// The range that holds all but a thousandth of the points at each end.
fn core(marginal: &[(ValueRange, u64)], points: u64) -> Option<ValueRange> {
    let edge = points / 1000;
    let within = |mut passed: u64| {
        move |count: u64| {
            passed += count;
            passed > edge
        }
    };
    let mut from_below = within(0);
    let low = marginal.iter().find(|&&(_, count)| from_below(count))?.0.low;
    let mut from_above = within(0);
    let high = marginal.iter().rev().find(|&&(_, count)| from_above(count))?.0.high;
    Some(ValueRange { low, high })
}

/// The distribution over `shown` in some fifty equal bins: middle and share of the fullest.
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

fn draw_residual(
    canvas: &mut Canvas,
    whole: Rect,
    axis: Axis,
    view: &ResidualView,
    plateaus: &[LoadPlateau],
    outline: Option<&AxisPlot>,
    colours: ColourScale,
) {
    let name = axis.name();
    let linear = |quantity: &str, range: ValueRange| {
        PlotAxis::new(quantity, axis.unit(), Spacing::Linear, range.low, range.high)
    };
    let area = Rect { width: whole.width - PROFILE_WIDTH, ..whole };
    let x = linear(&format!("predicted {name}"), view.predicted).padded(0.04);
    let y = linear("residual", view.residual).padded(0.1);
    let panel = Panel { area, x, y };
    panel.draw_grid(canvas);
    draw_cells(canvas, &panel, &view.cells, colours);
    let means = plateaus.iter().map(|p| ((p.predicted, p.predicted - p.measured), p.sd));
    draw_plateaus(canvas, &panel, means);
    let ((x0, zero), (x1, _)) =
        (panel.place(panel.x.range.0, 0.0), panel.place(panel.x.range.1, 0.0));
    canvas.dashes(&format!("M{}L{}", point(x0, zero), point(x1, zero)), palette::REFERENCE, 1.0);
    panel.draw_frame(canvas);
    if view.beyond > 0 {
        let text = format!("{} beyond", view.beyond);
        let at = (area.right() - 6.0, area.bottom() - 6.0);
        canvas.text(at, &text, Style::LABEL.anchored(Anchor::End));
    }

    let side = Rect { left: area.right(), width: PROFILE_WIDTH, ..area };
    let steps = |profile: &[(ValueRange, u64)]| {
        let densest =
            profile.iter().map(|&(range, count)| density(range, count)).fold(0.0, f64::max);
        let mut path = format!("M{}", point(side.left, panel.place(0.0, profile.first()?.0.low).1));
        for &(range, count) in profile {
            let x = side.left + 0.92 * side.width * density(range, count) / densest;
            for edge in [range.low, range.high] {
                path += &format!("L{}", point(x, panel.place(0.0, edge).1));
            }
        }
        Some(path + &format!("H{}", number(side.left)))
    };
    canvas.clipped(side, |canvas| {
        if let Some(path) = steps(&view.profile) {
            canvas.fill(&format!("{path}Z"), palette::SERIES[5]);
        }
        let train = outline.map(|data| profile(&data.residual.marginal_y(), view.residual));
        if let Some(path) = train.and_then(|train| steps(&train)) {
            canvas.stroke(&path, palette::INK, 1.0);
        }
    });
    canvas.frame(side, palette::INK);
}

fn density(range: ValueRange, count: u64) -> f64 {
    count as f64 / (range.high - range.low)
}

/// Three significant digits.
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

    /// A wave with a residual of known size, without any random source.
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
        let mut plot = FitPlot::new();
        plot.add(&predicted, &measured);
        plot
    }

    #[test]
    fn the_picture_is_the_same_however_rows_are_split() {
        let whole = fit_figure(Size::Screen, "fit", Axes::ALL, &plot(0..5000), None);
        let mut merged = plot(3000..5000);
        merged.merge(&plot(0..3000));
        assert_eq!(fit_figure(Size::Screen, "fit", Axes::ALL, &merged, None), whole);
    }

    #[test]
    fn rms_is_that_of_predicted_minus_measured() {
        let plot = plot(0..5000);
        // 0.1·sin has the root mean square 0.1/√2; 5000 samples cover whole turns to within 1 %.
        for axis in &plot.axes {
            assert!((axis.rms() - 0.1 / 2f64.sqrt()).abs() < 1e-3, "{}", axis.rms());
        }
    }

    #[test]
    fn a_few_rows_far_out_are_counted_and_do_not_flatten_the_rest() {
        let mut plot = plot(0..5000);
        let far = vec![vec![50.0; 3]; 6];
        plot.add(&far, &vec![vec![0.0; 3]; 6]);
        let view = ResidualView::new(&plot.axes[0]);
        assert_eq!(view.beyond, 3);
        assert!(view.residual.high < 0.5, "{:?}", view.residual);
        assert!(fit_figure(Size::Screen, "fit", Axes::ALL, &plot, None).svg().contains("3 beyond"));
    }

    #[test]
    fn empty_constant_and_unfinished_data_still_draw() {
        let empty = FitPlot::new();
        assert!(
            fit_figure(Size::Screen, "fit", Axes::ALL, &empty, Some(&empty))
                .svg()
                .ends_with("</svg>\n")
        );
        let mut constant = FitPlot::new();
        constant.add(&vec![vec![1.0; 4]; 6], &vec![vec![1.0; 4]; 6]);
        constant.add(&vec![vec![f64::NAN; 2]; 6], &vec![vec![1.0; 2]; 6]);
        assert_eq!(constant.rows(), 4);
        let svg = fit_figure(Size::Screen, "fit", Axes::ALL, &constant, None).svg().to_owned();
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
    }

    #[test]
    fn three_significant_digits() {
        let written = [0.11834, 12.345, 123456.0, 0.00012345, 0.0, 1.5e-7].map(significant);
        assert_eq!(written, ["0.118", "12.3", "123456", "0.000123", "0", "1.50e-7"]);
    }
}
