//! Proposes the window of a trial, from entry to exit, from the drag alone, with a confidence.
//!
//! The model of the drag is zero, rising while the robot enters, constant, falling while it leaves, zero, plus an
//! offset. It rises and falls smoothly, since the nose of a rounded shell bends its first beam only slightly. All
//! pairs of entry and exit on a coarse grid are tried, with height and offset by least squares, and the best is
//! refined with halved steps. The drag is first averaged over a stride, which removes the shaking by the legs; so is the
//! model.
//!
//! The *confidence* is the share of the slow variation of the drag that this plateau explains (R²), low for a drag
//! that comes and goes, or is small against other variations. Standard errors come from non-linear least squares,
//! with the residuals' variance enlarged by their correlation time (Bartlett, J. R. Statist. Soc. B 8, 27, 1946).

mod plateau;

use plateau::{DragPlateau, MeanDrag, PlateauFit, refine, search, standard_errors};

const BINS: usize = 240;
/// The averaging time if the length of a stride is unknown, s.
const USUAL_STRIDE_S: f64 = 0.25;
const LEAST_CONFIDENCE: f64 = 0.5;
/// Confidence from which on a proposal can be used without inspection.
pub const GOOD_CONFIDENCE: f64 = 0.8;
/// Standard error of entry and exit up to which a proposal can be used without inspection, as a share of the window:
/// the mean drag is off by about as much.
const GOOD_SE: f64 = 0.1;
/// The minimum drag, in units of its standard error.
const LEAST_SIGNIFICANCE: f64 = 4.0;

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Proposal {
    /// Onset of sustained drag, s on the log's clock.
    pub t_enter_s: f64,
    pub t_exit_s: f64,
    pub t_enter_se_s: f64,
    pub t_exit_se_s: f64,
    /// Duration of the rise, and of the fall, s.
    pub ramp_s: f64,
    /// Drag on the plateau, relative to that outside the window, N.
    pub drag_n: f64,
    pub drag_se_n: f64,
    /// Drag outside the window, N: the residual of the tare.
    pub outside_n: f64,
    /// Share of the drag's slow variation that the plateau explains, 0 to 1.
    pub confidence: f64,
}

impl Proposal {
    pub fn is_good(&self) -> bool {
        let longest_se_s = self.t_enter_se_s.max(self.t_exit_se_s);
        self.confidence >= GOOD_CONFIDENCE
            && longest_se_s <= GOOD_SE * (self.t_exit_s - self.t_enter_s)
    }

    /// Adds to the standard errors the time within which the drag shows no difference, s.
    pub fn with_resolution(self, resolution_s: f64) -> Self {
        let [t_enter_se_s, t_exit_se_s] =
            [self.t_enter_se_s, self.t_exit_se_s].map(|se| se.hypot(resolution_s));
        Self { t_enter_se_s, t_exit_se_s, ..self }
    }

    pub fn drag_at(&self, time_s: f64) -> f64 {
        let ramp = self.ramp_s / (self.t_exit_s - self.t_enter_s);
        let plateau = DragPlateau { enter: self.t_enter_s, exit: self.t_exit_s, ramp };
        self.outside_n + self.drag_n * plateau.share(time_s)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NoWindow {
    #[error("{rows} rows of force over {duration_s:.3} s are too few to find a window in")]
    TooShort { rows: usize, duration_s: f64 },
    /// The drag is absent or not significant; the fields describe the best interval.
    #[error(
        "no sustained drag: the best interval, {t_enter_s:.2} s to {t_exit_s:.2} s, has {drag_n:.4} N{}",
        if drag_se_n.is_finite() { format!(" ± {drag_se_n:.4} N") } else { String::new() }
    )]
    NoDrag { t_enter_s: f64, t_exit_s: f64, drag_n: f64, drag_se_n: f64 },
    /// The drag is not one plateau. The fields describe the best interval, with the variation that it explains.
    #[error(
        "onset and end of the drag are unclear: {t_enter_s:.2} to {t_exit_s:.2} s explains {:.0} % of its \
         variation", 100.0 * confidence
    )]
    Unclear { t_enter_s: f64, t_exit_s: f64, confidence: f64 },
    #[error("the log {} within the drag: it holds no whole window", if *.0 { "starts" } else { "ends" })]
    Cut(bool),
}

/// Proposes entry and exit from the drag −Fx in N at `time_s` in s, tared and free of filter delay (unfiltered or
/// zero-phase). Skips values that are not finite. `stride_s` is the length of a stride, if known.
///
/// # Errors
/// [`NoWindow`] if there is no interval of drag, more than one, or one that the log cuts off.
///
/// # Panics
/// If the slices differ in length.
pub fn propose_window(
    time_s: &[f64],
    drag_n: &[f64],
    stride_s: Option<f64>,
) -> Result<Proposal, NoWindow> {
    assert_eq!(time_s.len(), drag_n.len(), "one force per time");
    let rows = time_s.iter().copied().zip(drag_n.iter().copied());
    let rows: Vec<(f64, f64)> = rows.filter(|row| row.0.is_finite() && row.1.is_finite()).collect();
    let [first, last] = [rows.first(), rows.last()].map(|row| row.map_or(0.0, |row| row.0));
    let duration_s = last - first;
    let stride_s = stride_s.filter(|s| s.is_finite() && *s > 0.0).unwrap_or(USUAL_STRIDE_S);
    let bin_s = duration_s / BINS as f64;
    if rows.len() < BINS || duration_s <= 4.0 * stride_s {
        return Err(NoWindow::TooShort { rows: rows.len(), duration_s });
    }
    let points = slow_points(&rows, first, bin_s, stride_s.max(bin_s));
    let fit = refine(&points, search(&points), [first, last], bin_s);
    let found = judge(&points, fit, [first, last], stride_s.max(2.0 * bin_s))?;
    // Flanks that are shorter than a bin look alike.
    Ok(found.with_resolution(0.5 * bin_s))
}

/// Mean drag over a stride around the middle of every bin, where there are rows.
fn slow_points(rows: &[(f64, f64)], first: f64, bin_s: f64, width_s: f64) -> Vec<MeanDrag> {
    let mut sums = Vec::with_capacity(rows.len() + 1);
    sums.push(0.0);
    for (_, drag) in rows {
        sums.push(sums[sums.len() - 1] + drag);
    }
    let mean_around = |bin: usize| {
        let middle = first + (bin as f64 + 0.5) * bin_s;
        let from = rows.partition_point(|row| row.0 < middle - 0.5 * width_s);
        let to = rows.partition_point(|row| row.0 < middle + 0.5 * width_s);
        let count = (to - from) as f64;
        (to > from).then(|| {
            let (from_s, to_s) = (rows[from].0, rows[to - 1].0);
            // Each row stands for the time halfway to its neighbours.
            let half_s = 0.5 * (to_s - from_s) / (count - 1.0).max(1.0);
            MeanDrag {
                from_s: from_s - half_s,
                to_s: to_s + half_s,
                drag_n: (sums[to] - sums[from]) / count,
            }
        })
    };
    (0..BINS).filter_map(mean_around).collect()
}

fn judge(
    points: &[MeanDrag],
    fit: PlateauFit,
    [first, last]: [f64; 2],
    margin_s: f64,
) -> Result<Proposal, NoWindow> {
    let PlateauFit { plateau, drag, outside, residual } = fit;
    let (t_enter_s, t_exit_s) = (plateau.enter, plateau.exit);
    let mean = points.iter().map(|point| point.drag_n).sum::<f64>() / points.len() as f64;
    let total: f64 = points.iter().map(|point| (point.drag_n - mean).powi(2)).sum();
    let confidence = if total > 0.0 { (1.0 - residual / total).clamp(0.0, 1.0) } else { 0.0 };
    let [drag_se_n, t_enter_se_s, t_exit_se_s] = standard_errors(points, &fit);
    if drag <= LEAST_SIGNIFICANCE * drag_se_n {
        return Err(NoWindow::NoDrag { t_enter_s, t_exit_s, drag_n: drag, drag_se_n });
    }
    if confidence < LEAST_CONFIDENCE {
        return Err(NoWindow::Unclear { t_enter_s, t_exit_s, confidence });
    }
    if t_enter_s - first < margin_s || last - t_exit_s < margin_s {
        return Err(NoWindow::Cut(t_enter_s - first < margin_s));
    }
    Ok(Proposal {
        t_enter_s,
        t_exit_s,
        t_enter_se_s,
        t_exit_se_s,
        ramp_s: plateau.ramp * (t_exit_s - t_enter_s),
        drag_n: drag,
        drag_se_n,
        outside_n: outside,
        confidence,
    })
}

#[cfg(test)]
mod tests {
    use system_tests::random::Random;

    use super::*;
    use simulation::virtual_robot::{ChannelForces, TrialSettings, VirtualTrial};

    /// Time and true drag of a trial at 100 Hz, with deterministic noise.
    fn trial(name: &str, seed: u64) -> (VirtualTrial, Vec<f64>, Vec<f64>) {
        let settings = TrialSettings::new(ChannelForces::named(name).unwrap(), seed);
        let trial = VirtualTrial::new(settings).unwrap();
        let end_s = trial.times_s[trial.times_s.len() - 1];
        let time_s: Vec<f64> = (0..(end_s * 100.0) as u32).map(|i| 0.01 * f64::from(i)).collect();
        let mut random = Random(seed);
        let drag_n = time_s
            .iter()
            .map(|&t| 0.006 - trial.wrench_at(t)[0] + 0.04 * random.normal())
            .collect();
        (trial, time_s, drag_n)
    }

    #[test]
    fn entry_and_exit_are_found_where_the_drag_is_large() {
        for seed in 0..25 {
            for name in ["2 cm", "3 cm"] {
                let (trial, time_s, drag_n) = trial(name, seed);
                let proposal = propose_window(&time_s, &drag_n, Some(1.0 / 13.0)).unwrap();
                let [enter_s, exit_s] = trial.window_s;
                // The drag rises in 2.3 s and sways by 10 to 20 % about that: some tenths of a second.
                let (early, late) = (proposal.t_enter_s - enter_s, proposal.t_exit_s - exit_s);
                assert!(
                    early.abs() < 0.7 && late.abs() < 0.7,
                    "{name} {seed}: {proposal:?} {early} {late}"
                );
                assert!(proposal.confidence > 0.7, "{proposal:?}");
                assert!((proposal.outside_n - 0.006).abs() < 0.02);
            }
        }
    }

    #[test]
    fn free_running_has_no_window() {
        for seed in 0..25 {
            let (_, time_s, drag_n) = trial("free", seed);
            let found = propose_window(&time_s, &drag_n, Some(1.0 / 13.0));
            assert!(
                matches!(found, Err(NoWindow::NoDrag { .. } | NoWindow::Unclear { .. })),
                "{seed}: {found:?}"
            );
        }
    }

    #[test]
    fn a_plateau_without_noise_is_found_exactly() {
        let plateau = DragPlateau { enter: 2.345, exit: 7.654, ramp: 0.21 };
        let time_s: Vec<f64> = (0..10_000).map(|i| 1e-3 * f64::from(i)).collect();
        let drag_n: Vec<f64> = time_s.iter().map(|&t| 0.02 + 0.3 * plateau.share(t)).collect();
        let found = propose_window(&time_s, &drag_n, Some(0.04)).unwrap();
        // Steps end at a hundredth of a bin of 42 ms; averaging rounds the corners.
        assert!((found.t_enter_s - 2.345).abs() < 2e-3, "{found:?}");
        assert!((found.t_exit_s - 7.654).abs() < 2e-3);
        assert!((found.drag_n - 0.3).abs() < 1e-4 && (found.outside_n - 0.02).abs() < 1e-4);
        assert!(found.confidence > 0.9999);
    }

    #[test]
    fn a_sharp_plateau_is_found_whatever_the_length_of_a_stride() {
        // Drag from 6 to 14 s, with noise of 1/150 of it, at 100 Hz.
        let mut random = Random(1);
        let time_s: Vec<f64> = (0..2000).map(|i| 0.01 * f64::from(i)).collect();
        let drag_at = |t: f64| if (6.0..14.0).contains(&t) { 0.3 } else { 0.0 };
        let drag_n: Vec<f64> =
            time_s.iter().map(|&t| drag_at(t) + 0.002 * random.normal()).collect();
        for stride_s in [None, Some(2.0), Some(1.0), Some(0.5), Some(0.2), Some(1.0 / 13.0)] {
            let found = propose_window(&time_s, &drag_n, stride_s).unwrap();
            let off = [found.t_enter_s - 6.0, found.t_exit_s - 14.0];
            // Bins are 83 ms long: half of one is the standard error, as the noise is small.
            assert!(off.iter().all(|off| off.abs() < 0.083), "{stride_s:?} {found:?}");
            assert!((found.t_enter_se_s - 0.042).abs() < 0.002, "{stride_s:?} {found:?}");
        }
    }

    #[test]
    fn a_window_whose_end_is_in_a_gap_is_not_good() {
        // No rows from 4.0 to 8.5 s, where the drag ends at 8 s.
        let mut random = Random(2);
        let time_s = (0..1000).map(|i| 0.01 * f64::from(i)).filter(|t| !(4.0..8.5).contains(t));
        let time_s: Vec<f64> = time_s.collect();
        let drag_at = |t: f64| if (2.0..8.0).contains(&t) { 0.3 } else { 0.0 };
        let drag_n: Vec<f64> =
            time_s.iter().map(|&t| drag_at(t) + 0.02 * random.normal()).collect();
        let found = propose_window(&time_s, &drag_n, None);
        assert!(found.is_err() || !found.unwrap().is_good(), "{found:?}");
    }

    #[test]
    fn two_plateaus_are_not_taken_for_one() {
        let share = |t: f64, enter| DragPlateau { enter, exit: enter + 2.0, ramp: 0.1 }.share(t);
        let time_s: Vec<f64> = (0..12_000).map(|i| 1e-3 * f64::from(i)).collect();
        let drag_n: Vec<f64> =
            time_s.iter().map(|&t| 0.2 * (share(t, 1.0) + share(t, 8.0))).collect();
        let found = propose_window(&time_s, &drag_n, None);
        assert!(
            matches!(found, Err(NoWindow::Unclear { .. } | NoWindow::NoDrag { .. })),
            "{found:?}"
        );
    }

    #[test]
    fn a_log_that_ends_within_the_drag_holds_no_window() {
        let plateau = DragPlateau { enter: 3.0, exit: 30.0, ramp: 0.03 };
        let time_s: Vec<f64> = (0..10_000).map(|i| 1e-3 * f64::from(i)).collect();
        let drag_n: Vec<f64> = time_s.iter().map(|&t| 0.3 * plateau.share(t)).collect();
        assert_eq!(propose_window(&time_s, &drag_n, None), Err(NoWindow::Cut(false)));
        let upside_down: Vec<f64> = drag_n.iter().map(|drag| -drag).collect();
        assert!(propose_window(&time_s, &upside_down, None).is_err());
    }

    #[test]
    fn empty_and_zero_logs_have_no_window() {
        assert!(matches!(propose_window(&[], &[], None), Err(NoWindow::TooShort { .. })));
        let time_s: Vec<f64> = (0..1000).map(|i| 0.01 * f64::from(i)).collect();
        assert!(matches!(
            propose_window(&time_s, &vec![0.0; 1000], None),
            Err(NoWindow::NoDrag { .. })
        ));
        assert!(matches!(
            propose_window(&time_s, &vec![f64::NAN; 1000], None),
            Err(NoWindow::TooShort { .. })
        ));
    }
}
