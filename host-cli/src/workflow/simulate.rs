//! The model of the beam channel for figures: drag over position, with its jumps in the right places.

use beam_channel::{Model, Wall};
use figures::ChannelCurve;

/// Evenly spaced positions of a curve; those of its jumps are added.
const POINTS: u32 = 1000;

/// Distance of the points on either side of a jump, as a share of the spacing.
const BESIDE: f64 = 1e-9;

/// Drag and contacts of the model from `from_m` to `to_m`.
pub fn curve(model: &Model, label: String, from_m: f64, to_m: f64) -> ChannelCurve {
    let channel = model.setup().channel;
    let even = (0..=POINTS).map(|i| from_m + (to_m - from_m) * f64::from(i) / f64::from(POINTS));
    let mut positions: Vec<f64> = even.collect();
    for side in Wall::BOTH.into_iter().filter_map(|wall| model.side(wall)) {
        // A curve cannot show more jumps than it has points.
        for beam in 0..channel.beams.min(POINTS) {
            for position in [side.engagement_m, side.release_m()] {
                let jump = model.base_m(beam) - position;
                positions.extend([-BESIDE, BESIDE].map(|share| jump + share * channel.pitch_m));
            }
        }
    }
    positions.retain(|x| (from_m..=to_m).contains(x));
    positions.sort_unstable_by(f64::total_cmp);
    positions.dedup();
    let totals = positions.into_iter().map(|x| (x, model.total(x)));
    let (mut drag, mut contacts) = (Vec::new(), Vec::new());
    for (x, total) in totals {
        drag.push((x, 0.0 - total.fx_n));
        contacts.push((x, 0.5 * f64::from(total.contacts[0] + total.contacts[1])));
    }
    ChannelCurve { label, drag, contacts }
}

#[cfg(test)]
mod tests {
    use beam_channel::Setup;

    use super::*;

    #[test]
    fn a_curve_has_both_ends_of_every_jump() {
        let model = Model::new(&Setup::default()).unwrap();
        let [first, last] = model.extent_m().unwrap();
        let trace = curve(&model, String::new(), first - 0.01, last + 0.01);
        assert!(trace.drag.is_sorted_by(|a, b| a.0 < b.0));
        let up = trace.contacts.windows(2).filter(|pair| pair[1].1 > pair[0].1).count();
        let down = trace.contacts.windows(2).filter(|pair| pair[1].1 < pair[0].1).count();
        assert_eq!((up, down), (11, 11), "every beam is touched and slips off");
        let steep = |pair: &&[(f64, f64)]| {
            (pair[1].1 - pair[0].1).abs() > 1e-3 && pair[1].0 - pair[0].0 < 1e-9
        };
        assert_eq!(trace.drag.windows(2).filter(steep).count(), 11, "the drag jumps at releases");
    }
}
