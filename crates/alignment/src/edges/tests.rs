//! Signals with known truth.

use super::*;
use system_tests::random::Random;

const PERIOD_S: f64 = 1e-3;

fn times(count: usize, mut gap: impl FnMut(usize) -> f64) -> Vec<f64> {
    let mut at = 3.0;
    (0..count)
        .map(|i| {
            at += gap(i);
            at
        })
        .collect()
}

/// The edges in a reference that samples every ms: the middle between two of its samples.
fn seen(board_s: &[f64], offset_s: f64, skew: f64) -> Vec<f64> {
    let at = |t: &f64| t + offset_s + skew * t;
    board_s.iter().map(|t| ((at(t) / PERIOD_S).floor() + 0.5) * PERIOD_S).collect()
}

fn edges(reference_s: Vec<f64>, board_s: Vec<f64>) -> Edges {
    Edges { reference_s, board_s, resolution_s: PERIOD_S }
}

/// Errors divided by their stated standard errors, of the offset at the pivot and of the skew.
fn scores(clock: &ClockMap, offset_s: f64, skew: f64) -> [f64; 2] {
    let truth_s = offset_s + skew * clock.pivot_s;
    [(clock.offset_s - truth_s) / clock.offset_se_s, (clock.skew - skew) / clock.skew_se]
}

#[test]
fn one_edge_gives_the_offset_and_two_the_skew() {
    let board = vec![10.000_3];
    let (clock, found) = edges(seen(&board, -7.25, 0.0), board).clocks(None).unwrap();
    assert_eq!((found.matched, found.told_by_loads, clock.skew), (1, false, 0.0));
    // Anywhere within a sample: its standard deviation is the period over √12.
    assert!((clock.offset_s + 7.25).abs() <= PERIOD_S / 2.0);
    assert!((clock.offset_se_s - PERIOD_S / 12_f64.sqrt()).abs() < 1e-6);
    assert!((clock.skew_se - PRIOR_SKEW).abs() < 1e-12);

    let board = vec![10.0, 610.0];
    let (clock, found) = edges(seen(&board, -7.25, 3e-3), board).clocks(None).unwrap();
    assert_eq!(found.matched, 2);
    assert!(scores(&clock, -7.25, 3e-3).iter().all(|score| score.abs() < 3.0));
    // √2 standard deviations of an edge over ten minutes.
    assert!((clock.skew_se - PERIOD_S / 6_f64.sqrt() / 600.0).abs() < 1e-8);
}

#[test]
fn missing_and_extra_edges_are_left_unpaired() {
    let mut random = Random(11);
    let mut worst = 0.0_f64;
    let mut squares = [0.0; 2];
    let sessions = 400;
    for _ in 0..sessions {
        let skew = (random.unit() - 0.5) * 1e-2;
        let offset_s = (random.unit() - 0.5) * 1e3;
        let all = times(12, |_| 2.0 + 8.0 * random.unit());
        let mut reference = seen(&all, offset_s, skew);
        let mut board = all.clone();
        // Both sides have bounces and stray edges, and miss edges.
        reference.remove(random.next() as usize % 12);
        reference.remove(random.next() as usize % 11);
        board.remove(random.next() as usize % 12);
        reference.push(reference[4] + 4e-3);
        board.push(board[6] + 2.3e-3);
        board.push(all[0] + 50.0 * random.unit());
        reference.push(reference[0] + 50.0 * random.unit());
        let (clock, found) = edges(reference, board).clocks(None).unwrap();
        assert!((9..=11).contains(&found.matched), "{found:?}");
        for (sum, score) in squares.iter_mut().zip(scores(&clock, offset_s, skew)) {
            worst = worst.max(score.abs());
            *sum += score * score;
        }
    }
    // A bounce mistaken for its edge shows as an outlying pair; no pair is far off.
    assert!(worst < 5.0, "{worst}");
    // The RMS of 400 scores is at most 1 to within 4 of its standard deviations, or up to a half
    // less, as ten edges do not show their common error.
    for sum in squares {
        let rms = (sum / f64::from(sessions)).sqrt();
        let most = 1.0 + 4.0 / (2.0 * f64::from(sessions)).sqrt();
        assert!((0.5..most).contains(&rms), "{rms}");
    }
}

#[test]
fn a_signal_in_step_with_the_samples_keeps_a_constant_error() {
    // Each edge comes just after a sample of the reference.
    let board = times(20, |i| 1.0 + 0.05 * (i * i * 7 % 23) as f64);
    let reference: Vec<f64> = board.iter().map(|t| t + 5.0 + 0.49 * PERIOD_S).collect();
    let (clock, found) = edges(reference, board).clocks(None).unwrap();
    assert!(found.residual_s < 1e-9);
    let [offset, _] = scores(&clock, 5.0, 0.0);
    assert!(
        (1.5..2.0).contains(&offset),
        "half a sample is √3 standard deviations of one: {offset}"
    );
}

fn loads(offset_s: f64) -> Option<ClockMap> {
    Some(ClockMap {
        offset_s,
        skew: 0.0,
        pivot_s: 30.0,
        offset_se_s: 1e-4,
        skew_se: 1e-6,
        covariance_s: 0.0,
    })
}

#[test]
fn a_periodic_signal_is_resolved_by_loads_or_refused() {
    let all = times(60, |_| 1.0);
    let reference = seen(&all[..55], 100.0, 2e-5);
    let board = all[7..].to_vec();
    let unclear = edges(reference.clone(), board.clone()).clocks(None);
    assert!(matches!(unclear, Err(AlignError::EdgesUnclear { .. })), "{unclear:?}");
    // The loads only need to be accurate to a quarter of the period.
    let (clock, found) = edges(reference.clone(), board.clone()).clocks(loads(100.1)).unwrap();
    assert_eq!((found.matched, found.told_by_loads), (48, true));
    assert!(scores(&clock, 100.0, 2e-5).iter().all(|score| score.abs() < 4.0));
    let between = edges(reference, board).clocks(loads(100.5));
    assert!(matches!(between, Err(AlignError::EdgesUnclear { .. })), "{between:?}");
}

#[test]
fn unrelated_signals_are_refused() {
    let mut random = Random(5);
    let mut other = || times(9, |_| 1.0 + 30.0 * random.unit());
    let apart = edges(other(), other()).clocks(None);
    assert!(matches!(apart, Err(AlignError::EdgesUnclear { .. })), "{apart:?}");
    let many = edges(vec![0.0; 5_000], vec![1.0]).clocks(None);
    assert!(
        matches!(many, Err(AlignError::TooManyEdges { side: RecordingSide::Reference, .. })),
        "{many:?}"
    );
}

#[test]
fn edges_of_a_signal_lie_between_its_low_and_its_high_samples() {
    let time_s: Vec<f64> = (0..12).map(|i| f64::from(i) * 0.1).collect();
    // High from the start, noise in between, a slow rise, and an invalid sample.
    let values = [5.0, 0.1, 0.0, 4.9, 5.0, 2.4, 4.0, 0.0, 2.5, f64::NAN, 4.8, 5.0];
    let (edges, resolution_s) = rising_edges(&time_s, &values);
    assert_eq!(edges.len(), 2);
    assert!((edges[0] - 0.25).abs() < 1e-12 && (edges[1] - 0.85).abs() < 1e-12, "{edges:?}");
    assert!((resolution_s - (0.05_f64).sqrt()).abs() < 1e-12);
    assert_eq!(rising_edges(&time_s, &[3.0; 12]), (vec![], 0.0));
}
