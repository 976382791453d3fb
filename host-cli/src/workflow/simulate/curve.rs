//! Drag over position for figures: of the model, with its jumps where they are, and as measured.

use std::path::Path;

use beam_channel::{Model, Wall};

use super::csv_columns::{Table, TableError};
use crate::plot::ChannelCurve;

/// Positions of a curve, beside those of its jumps.
const POINTS: u32 = 1000;

/// On either side of a jump, as a share of the spacing.
const BESIDE: f64 = 1e-9;

/// The model's drag and contacts from `from_m` to `to_m`.
pub fn curve(model: &Model, label: String, from_m: f64, to_m: f64) -> ChannelCurve {
    let channel = model.setup().channel;
    let even = (0..=POINTS).map(|i| from_m + (to_m - from_m) * f64::from(i) / f64::from(POINTS));
    let mut positions: Vec<f64> = even.collect();
    for side in Wall::BOTH.into_iter().filter_map(|wall| model.side(wall)) {
        // More jumps than points do not show.
        for beam in 0..channel.beams.min(POINTS) {
            for place in [side.engagement_m(), side.release_m()] {
                let jump = model.base_m(beam) - place;
                positions.extend([-BESIDE, BESIDE].map(|share| jump + share * channel.pitch_m));
            }
        }
    }
    positions.retain(|x| (from_m..=to_m).contains(x));
    positions.sort_by(f64::total_cmp);
    positions.dedup();
    let totals = positions.into_iter().map(|x| (x, model.total(x)));
    let (mut drag, mut contacts) = (Vec::new(), Vec::new());
    for (x, total) in totals {
        drag.push((x, 0.0 - total.fx_n));
        contacts.push((x, 0.5 * f64::from(total.contacts[0] + total.contacts[1])));
    }
    ChannelCurve { label, drag, contacts, measured: false }
}

/// Reads a measured trace: positions in a column `x_m` and the drag in `drag_n`, or −`fx_n`.
/// Rows that lack either are left out.
///
/// # Errors
/// [`TableError`] naming file, line and column.
pub fn read_trace(path: &Path) -> Result<ChannelCurve, TableError> {
    let mut table = Table::open(path)?;
    let x = table.column(&["x_m"])?;
    let drag = table.column(&["drag_n", "fx_n"])?;
    let sign = if table.name(drag).eq_ignore_ascii_case("fx_n") { -1.0 } else { 1.0 };
    let mut points = Vec::new();
    while let Some(record) = table.next()? {
        if let (Some(x), Some(drag)) = (record.number(x)?, record.number(drag)?) {
            points.push((x, sign * drag));
        }
    }
    if points.is_empty() {
        let column = table.name(drag).to_owned();
        return Err(TableError::Empty { path: table.path().to_path_buf(), column });
    }
    let label = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    Ok(ChannelCurve { label, drag: points, contacts: Vec::new(), measured: true })
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

    #[test]
    fn a_measured_trace_may_have_forces_or_drags() {
        let file = tempfile::NamedTempFile::new().unwrap();
        for text in ["x_m,drag_n\n0.1,0.5\n0.2,\n", "t_s,fx_n,x_m\n0,-0.5,0.1\n"] {
            std::fs::write(file.path(), text).unwrap();
            assert_eq!(read_trace(file.path()).unwrap().drag, [(0.1, 0.5)]);
        }
        std::fs::write(file.path(), "x_m,fz_n\n").unwrap();
        let error = read_trace(file.path()).unwrap_err().to_string();
        assert!(error.ends_with("no column `drag_n` or `fx_n`; found `x_m`, `fz_n`"), "{error}");
    }
}
