//! Plateaus of the drag, and the one that fits a drag best.

/// Rising and falling, each as a share of the window: tried at first.
const RAMPS: [f64; 4] = [0.05, 0.15, 0.3, 0.45];

/// A plateau in a channel, times in s.
#[derive(Clone, Copy, Debug)]
pub(super) struct DragPlateau {
    pub(super) enter: f64,
    pub(super) exit: f64,
    /// Rising and falling, each as a share of the plateau.
    pub(super) ramp: f64,
}

impl DragPlateau {
    /// 0 outside, 1 on the level part.
    pub(super) fn share(&self, time_s: f64) -> f64 {
        let length_s = self.exit - self.enter;
        let rising = (time_s - self.enter) / (self.ramp * length_s);
        let falling = (self.exit - time_s) / (self.ramp * length_s);
        let x = rising.min(falling).clamp(0.0, 1.0);
        x * x * (3.0 - 2.0 * x)
    }
}

/// Level and constant that fit best, and what they leave.
#[derive(Clone, Copy, Debug)]
pub(super) struct PlateauFit {
    pub(super) plateau: DragPlateau,
    pub(super) drag: f64,
    pub(super) outside: f64,
    pub(super) residual: f64,
}

/// The best plateau on a coarse grid: every third point as entry and exit.
pub(super) fn search(points: &[(f64, f64)]) -> PlateauFit {
    const STEP: usize = 3;
    let mut best: Option<PlateauFit> = None;
    for enter in (0..points.len()).step_by(STEP) {
        for exit in (enter + 2 * STEP..points.len()).step_by(STEP) {
            for ramp in RAMPS {
                let fit =
                    fit(points, DragPlateau { enter: points[enter].0, exit: points[exit].0, ramp });
                // A stretch of less drag than outside fits as well, upside down.
                if fit.drag > 0.0 && best.is_none_or(|best| fit.residual < best.residual) {
                    best = Some(fit);
                }
            }
        }
    }
    let whole =
        DragPlateau { enter: points[0].0, exit: points[points.len() - 1].0, ramp: RAMPS[0] };
    best.unwrap_or_else(|| fit(points, whole))
}

/// Moves entry, exit and ramp by steps that are halved as long as that makes the fit better.
pub(super) fn refine(
    points: &[(f64, f64)],
    mut best: PlateauFit,
    [first, last]: [f64; 2],
    bin_s: f64,
) -> PlateauFit {
    let mut step = 2.0 * bin_s;
    while step > 0.01 * bin_s {
        let mut moved = false;
        for direction in [-1.0, 1.0] {
            let by = direction * step;
            let DragPlateau { enter, exit, ramp } = best.plateau;
            let candidates = [
                DragPlateau { enter: (enter + by).max(first), ..best.plateau },
                DragPlateau { exit: (exit + by).min(last), ..best.plateau },
                DragPlateau { ramp: (ramp + by / (exit - enter)).clamp(0.02, 0.5), ..best.plateau },
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

/// Level and constant by least squares: a line over the share of the drag that is there.
fn fit(points: &[(f64, f64)], plateau: DragPlateau) -> PlateauFit {
    let n = points.len() as f64;
    let [mut x, mut y, mut xx, mut xy, mut yy] = [0.0; 5];
    for &(time_s, drag) in points {
        let share = plateau.share(time_s);
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
