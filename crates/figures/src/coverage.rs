//! Loads that a calibration was made from: forces against forces, moments against moments.

use super::axes::{BOTTOM_MARGIN, LEFT_MARGIN, Panel, PlotAxis, ValueRange};
use super::canvas::{Figure, Rect, Size, Style};
use super::palette;
use shell_data::wrench::{Axis, PerAxis};

const PAIRS: [[Axis; 2]; 4] =
    [[Axis::Fx, Axis::Fy], [Axis::Fx, Axis::Fz], [Axis::Mx, Axis::My], [Axis::Fz, Axis::Mz]];

const SIDE: f64 = 150.0;
const PITCH: f64 = 224.0;
const TOP: f64 = 56.0;
const POINT: f64 = 1.6;

/// Draws loads of training rows and, above them, test rows, N and N·m, in four views. Empty regions
/// were never calibrated.
pub fn coverage_figure(train: &[PerAxis<f64>], test: &[PerAxis<f64>]) -> Figure {
    let height = TOP + SIDE + BOTTOM_MARGIN + 8.0;
    let mut canvas = Figure::new(Size::Screen, PITCH * PAIRS.len() as f64, height);
    let mut left = LEFT_MARGIN;
    let sets =
        [("training rows", train, palette::series(0)), ("test rows", test, palette::series(1))];
    for (name, _, colour) in sets.into_iter().filter(|(_, loads, _)| !loads.is_empty()) {
        canvas.circle((left, 20.0), 4.0, colour);
        canvas.text((left + 10.0, 24.0), name, Style::START);
        left += 110.0;
    }
    for (at, pair) in PAIRS.into_iter().enumerate() {
        let axis = |axis: Axis| {
            let values = train.iter().chain(test).map(|load| load[axis.index()]);
            let range = ValueRange::over(values.filter(|value| value.is_finite()));
            PlotAxis::linear(axis.name(), axis.unit(), range).padded(0.05)
        };
        let area =
            Rect { left: LEFT_MARGIN + PITCH * at as f64, top: TOP, width: SIDE, height: SIDE };
        let panel = Panel { area, x: axis(pair[0]), y: axis(pair[1]) };
        panel.draw(&mut canvas, |canvas| {
            for (_, loads, colour) in sets {
                for load in loads {
                    let position = panel.place(load[pair[0].index()], load[pair[1].index()]);
                    if position.0.is_finite() && position.1.is_finite() {
                        canvas.circle(position, POINT, colour);
                    }
                }
            }
        });
    }
    canvas
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_load_is_drawn_once_in_every_view() {
        let train = [[1.0, 2.0, 3.0, 0.1, 0.2, 0.3], [-1.0, 0.0, 0.0, 0.0, 0.0, f64::NAN]];
        let svg = coverage_figure(&train, &[]).svg();
        // One load of the last view cannot be placed; the legend adds one circle.
        assert_eq!(svg.matches("<circle").count(), 8);
        assert!(
            svg.contains("training rows") && !svg.contains("test rows") && !svg.contains("NaN")
        );
        let svg = coverage_figure(&train, &train[..1]).svg();
        assert_eq!(svg.matches("<circle").count(), 8 + 5);
        assert!(coverage_figure(&[], &[]).svg().starts_with("<svg"));
    }
}
