//! The current of a photointerrupter as a function of the distance of its reflector.
//!
//! The part is the Sharp GP2S60 (data sheet D3-A02101EN, 3 October 2005). Its text gives the
//! optimal sensing distance, 0.7 mm, and tests the part at 0.5 mm; the curve of relative collector
//! current against distance is a drawing without numbers. The nodes below put the maximum on the
//! optimum and follow the typical shape of reflective couplers: a steep rise while emitter and
//! detector begin to see the same spot, a broad maximum, then a fall that turns into the inverse
//! square of the distance. Every node but the maximum is nominal, to some ±10 %: a calibration is
//! fitted, never derived from here.
//!
//! A shape-preserving cubic joins the nodes (PCHIP: Fritsch & Butland, SIAM J. Sci. Stat. Comput. 5, 300, 1984), with a
//! continuous slope and no overshoot. It needs only the four basic operations, so its bits are the same everywhere.

/// Distance in mm and relative collector current, 1 at the optimum.
const NODES: [(f64, f64); 14] = [
    (0.0, 0.04),
    (0.2, 0.36),
    (0.4, 0.80),
    (0.55, 0.96),
    (0.7, 1.00),
    (0.85, 0.90),
    (1.0, 0.74),
    (1.25, 0.52),
    (1.5, 0.37),
    (2.0, 0.21),
    (2.5, 0.135),
    (3.0, 0.094),
    (4.0, 0.053),
    (5.0, 0.034),
];

/// Slopes at the nodes, per mm.
const SLOPES: [f64; NODES.len()] = {
    let mut slopes = [0.0; NODES.len()];
    slopes[0] = secant(0);
    let mut i = 1;
    while i + 1 < NODES.len() {
        let (before, after) = (secant(i - 1), secant(i));
        if before * after > 0.0 {
            let (left, right) = (NODES[i].0 - NODES[i - 1].0, NODES[i + 1].0 - NODES[i].0);
            let (near, far) = (2.0 * right + left, right + 2.0 * left);
            slopes[i] = (near + far) / (near / before + far / after);
        }
        i += 1;
    }
    // The last slope is zero: the curve is constant beyond the table.
    slopes
};

const fn secant(i: usize) -> f64 {
    (NODES[i + 1].1 - NODES[i].1) / (NODES[i + 1].0 - NODES[i].0)
}

/// Current at a reflector `distance_m` away, relative to that at the optimum (0.7 mm). Constant
/// outside the table: a reflector cannot come nearer than contact, and beyond 5 mm there is hardly
/// any light. Value and slope are continuous above 0.
pub(super) fn current_at(distance_m: f64) -> f64 {
    let (first, last) = (NODES[0], NODES[NODES.len() - 1]);
    let x = (distance_m * 1e3).clamp(first.0, last.0);
    let right = NODES[1..NODES.len() - 1].iter().take_while(|node| node.0 < x).count() + 1;
    let ((x0, y0), (x1, y1)) = (NODES[right - 1], NODES[right]);
    let (width, t) = (x1 - x0, (x - x0) / (x1 - x0));
    let (m0, m1) = (width * SLOPES[right - 1], width * SLOPES[right]);
    let rise = y1 - y0;
    y0 + t * (m0 + t * (3.0 * rise - 2.0 * m0 - m1 + t * (m0 + m1 - 2.0 * rise)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curve_passes_through_its_nodes() {
        for (distance_mm, relative) in NODES {
            // The distance is rounded twice, and the slope is at most 2.3 per mm.
            assert!((current_at(distance_mm * 1e-3) - relative).abs() < 1e-14);
        }
    }

    #[test]
    fn curve_has_its_maximum_at_the_optimum_of_the_data_sheet() {
        let best = (0..=5000)
            .max_by(|&a, &b| current_at(a as f64 * 1e-6).total_cmp(&current_at(b as f64 * 1e-6)));
        assert_eq!(best, Some(700));
    }

    #[test]
    fn curve_is_positive_rises_to_the_optimum_and_falls_beyond_it() {
        let values: Vec<f64> = (0..=5000).map(|um| current_at(um as f64 * 1e-6)).collect();
        assert!(values.iter().all(|&v| v > 0.0));
        assert!(values[..=700].is_sorted());
        assert!(values[700..].is_sorted_by(|a, b| a >= b));
    }

    #[test]
    fn slope_is_continuous_at_the_nodes() {
        let step = 1e-10;
        for (distance_mm, _) in &NODES[1..] {
            let x = distance_mm * 1e-3;
            let before = (current_at(x) - current_at(x - step)) / step;
            let after = (current_at(x + step) - current_at(x)) / step;
            // Curvature below 2e8 per m² moves a secant over 1e-10 m by 0.02; rounding is less.
            assert!((before - after).abs() < 0.05, "{distance_mm}: {before} {after}");
        }
    }

    #[test]
    fn curve_is_level_outside_the_table() {
        assert_eq!(current_at(-1.0), NODES[0].1);
        assert_eq!(current_at(1.0), NODES[NODES.len() - 1].1);
    }
}
