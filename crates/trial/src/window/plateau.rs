//! Plateaus of the drag, and the best fit of one with standard errors.

/// Initial values of the rise and the fall, each as a share of the window.
const RAMPS: [f64; 4] = [0.05, 0.15, 0.3, 0.45];
/// The shortest and the longest rise, as shares of the window.
const RAMP_LIMITS: [f64; 2] = [1e-3, 0.5];

/// The mean drag over the rows from `from_s` to `to_s`.
#[derive(Clone, Copy, Debug)]
pub(super) struct MeanDrag {
    pub(super) from_s: f64,
    pub(super) to_s: f64,
    pub(super) drag_n: f64,
}

impl MeanDrag {
    fn middle_s(&self) -> f64 {
        0.5 * (self.from_s + self.to_s)
    }
}

#[derive(Clone, Copy, Debug)]
pub(super) struct DragPlateau {
    pub(super) enter: f64,
    pub(super) exit: f64,
    /// Rise and fall, each as a share of the plateau.
    pub(super) ramp: f64,
}

impl DragPlateau {
    /// 0 outside, 1 on the plateau.
    pub(super) fn share(&self, time_s: f64) -> f64 {
        let length_s = self.exit - self.enter;
        let rising = (time_s - self.enter) / (self.ramp * length_s);
        let falling = (self.exit - time_s) / (self.ramp * length_s);
        let x = rising.min(falling).clamp(0.0, 1.0);
        x * x * (3.0 - 2.0 * x)
    }

    /// The mean of the share over the time of a point: the drag was averaged, so the model is too.
    fn mean_share(&self, over: &MeanDrag) -> f64 {
        let length_s = over.to_s - over.from_s;
        if length_s <= 0.0 {
            return self.share(over.from_s);
        }
        (self.share_until(over.to_s) - self.share_until(over.from_s)) / length_s
    }

    /// ∫ share dt up to `time_s`, s.
    fn share_until(&self, time_s: f64) -> f64 {
        let ramp_s = self.ramp * (self.exit - self.enter);
        // ∫ x²(3 − 2x) dx = x³ − x⁴/2 on a ramp, and 1 per unit of x after it.
        let ramp_until = |start_s: f64| {
            let x = (time_s - start_s) / ramp_s;
            let on_ramp = x.clamp(0.0, 1.0);
            ramp_s * (on_ramp.powi(3) * (1.0 - 0.5 * on_ramp) + (x - 1.0).max(0.0))
        };
        ramp_until(self.enter) - ramp_until(self.exit - ramp_s)
    }
}

#[derive(Clone, Copy, Debug)]
pub(super) struct PlateauFit {
    pub(super) plateau: DragPlateau,
    pub(super) drag: f64,
    pub(super) outside: f64,
    pub(super) residual: f64,
}

/// The best plateau on a coarse grid: every third point as entry and exit.
pub(super) fn search(points: &[MeanDrag]) -> PlateauFit {
    const STEP: usize = 3;
    let mut best: Option<PlateauFit> = None;
    for enter in (0..points.len()).step_by(STEP) {
        for exit in (enter + 2 * STEP..points.len()).step_by(STEP) {
            for ramp in RAMPS {
                let [enter, exit] = [enter, exit].map(|at| points[at].middle_s());
                let fit = fit(points, DragPlateau { enter, exit, ramp });
                // An interval with less drag than outside would fit as well, with a negative height.
                if fit.drag > 0.0 && best.is_none_or(|best| fit.residual < best.residual) {
                    best = Some(fit);
                }
            }
        }
    }
    let [enter, exit] = [0, points.len() - 1].map(|at| points[at].middle_s());
    let whole = DragPlateau { enter, exit, ramp: RAMPS[0] };
    best.unwrap_or_else(|| fit(points, whole))
}

/// Improves entry, exit and ramp by steps that are halved.
pub(super) fn refine(
    points: &[MeanDrag],
    mut best: PlateauFit,
    [first, last]: [f64; 2],
    bin_s: f64,
) -> PlateauFit {
    let [shortest, longest] = RAMP_LIMITS;
    let mut step = 2.0 * bin_s;
    while step > 0.01 * bin_s {
        let mut moved = false;
        for direction in [-1.0, 1.0] {
            let by = direction * step;
            let DragPlateau { enter, exit, ramp } = best.plateau;
            // The middles of rise and fall stay: they are known far better than the ramp.
            let (earlier, later) = ((enter - 0.5 * by).max(first), (exit + 0.5 * by).min(last));
            let longer = (ramp * (exit - enter) + by) / (later - earlier);
            let candidates = [
                DragPlateau { enter: (enter + by).max(first), ..best.plateau },
                DragPlateau { exit: (exit + by).min(last), ..best.plateau },
                DragPlateau { enter: earlier, exit: later, ramp: longer.clamp(shortest, longest) },
            ];
            for plateau in candidates {
                let fit = fit(points, plateau);
                let is_plateau = plateau.exit - plateau.enter > 2.0 * bin_s && fit.drag > 0.0;
                if is_plateau && fit.residual < best.residual * (1.0 - 1e-9) {
                    (best, moved) = (fit, true);
                }
            }
        }
        if !moved {
            step *= 0.5;
        }
    }
    best
}

/// Fits height and offset by least squares: the drag is a line over the plateau's share.
fn fit(points: &[MeanDrag], plateau: DragPlateau) -> PlateauFit {
    let n = points.len() as f64;
    let [mut x, mut y, mut xx, mut xy, mut yy] = [0.0; 5];
    for point in points {
        let (share, drag) = (plateau.mean_share(point), point.drag_n);
        x += share;
        y += drag;
        xx += share * share;
        xy += share * drag;
        yy += drag * drag;
    }
    let (sxx, sxy, syy) = (xx - x * x / n, xy - x * y / n, yy - y * y / n);
    let drag = if sxx > 1e-9 * n { sxy / sxx } else { 0.0 };
    PlateauFit { plateau, drag, outside: (y - drag * x) / n, residual: (syy - drag * sxy).max(0.0) }
}

/// Standard errors of height, entry and exit; infinite if the data do not determine them.
pub(super) fn standard_errors(points: &[MeanDrag], fit: &PlateauFit) -> [f64; 3] {
    const UNKNOWNS: usize = 5;
    let n = points.len();
    let model =
        |plateau: DragPlateau, point: &MeanDrag| fit.outside + fit.drag * plateau.mean_share(point);
    let residuals: Vec<f64> =
        points.iter().map(|point| point.drag_n - model(fit.plateau, point)).collect();
    let DragPlateau { enter, exit, ramp } = fit.plateau;
    let step_s = 1e-3 * (exit - enter);
    // The averaging hides a change of the ramp that is much shorter: its slope is over a longer one.
    let averaged_s = points.iter().map(|point| point.to_s - point.from_s).fold(0.0, f64::max);
    let ramp_step = (averaged_s / (exit - enter)).max(1e-3);
    let slope = |low: DragPlateau, high: DragPlateau, step: f64, point: &MeanDrag| {
        (model(high, point) - model(low, point)) / step
    };
    let at = |enter, exit, ramp| DragPlateau { enter, exit, ramp };
    let mut normal = [[0.0; UNKNOWNS]; UNKNOWNS];
    for point in points {
        let [enters, exits] = [enter, exit].map(|s| [s - step_s, s + step_s]);
        let row = [
            fit.plateau.mean_share(point),
            slope(at(enters[0], exit, ramp), at(enters[1], exit, ramp), 2.0 * step_s, point),
            slope(at(enter, exits[0], ramp), at(enter, exits[1], ramp), 2.0 * step_s, point),
            slope(fit.plateau, at(enter, exit, ramp + ramp_step), ramp_step, point),
            1.0,
        ];
        for i in 0..UNKNOWNS {
            for j in 0..UNKNOWNS {
                normal[i][j] += row[i] * row[j];
            }
        }
    }
    let variance = residuals.iter().map(|r| r * r).sum::<f64>() / (n - UNKNOWNS) as f64;
    let scale = variance * correlation_length(&residuals);
    std::array::from_fn(|i| {
        inverse_diagonal(&normal, i).map_or(f64::INFINITY, |d| (scale * d).sqrt())
    })
}

/// Number of neighbours that count as one point: 1 + 2 Σ ρₖ over the lags up to the first that is not positive.
fn correlation_length(residuals: &[f64]) -> f64 {
    let product =
        |lag: usize| -> f64 { residuals.iter().zip(&residuals[lag..]).map(|(a, b)| a * b).sum() };
    let variance = product(0);
    if variance <= 0.0 {
        return 1.0;
    }
    let lags = (1..residuals.len() / 4).map(|lag| product(lag) / variance);
    1.0 + 2.0 * lags.take_while(|&correlation| correlation > 0.0).sum::<f64>()
}

/// A diagonal element of the inverse, by elimination with the unit vector; `None` if singular.
fn inverse_diagonal<const N: usize>(matrix: &[[f64; N]; N], index: usize) -> Option<f64> {
    let mut left = *matrix;
    let mut right = [0.0; N];
    right[index] = 1.0;
    for k in 0..N {
        let pivot = left[k][k];
        if pivot.is_nan() || pivot <= 1e-12 * matrix[k][k] || pivot <= 0.0 {
            return None;
        }
        for i in (0..N).filter(|&i| i != k) {
            let factor = left[i][k] / pivot;
            let above = left[k];
            for (value, above) in left[i].iter_mut().zip(above).skip(k) {
                *value -= factor * above;
            }
            right[i] -= factor * right[k];
        }
    }
    Some(right[index] / left[index][index])
}
