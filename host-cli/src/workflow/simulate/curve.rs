//! Drag over position for figures: of the model, with its jumps where they are, and as measured.

use std::path::Path;

use beam_channel::{Model, Wall};

use super::csv_columns::{CsvTable, CsvTableError};
use figures::ChannelCurve;

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
            for position in [side.engagement_m(), side.release_m()] {
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
    ChannelCurve { label, drag, contacts, measured: false }
}

/// Where a body of which only the time is known was: at a steady speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SteadyPassage {
    /// Its speed in m/s.
    pub speed_m_s: f64,
    /// When it was at `entry_x_m`, in s; the time of the first row if not known.
    pub entry_s: Option<f64>,
    /// Where it entered, in m past the first beam.
    pub entry_x_m: f64,
}

/// Reads a measured trace: the drag in a column `drag_n`, or −`fx_n`, and positions in `x_m` or, of a
/// body with a known passage, times in `t_s`. Rows that lack a value are left out.
///
/// # Errors
/// [`CsvTableError`] naming file, line and column.
pub fn read_trace(
    path: &Path,
    passage: Option<SteadyPassage>,
) -> Result<ChannelCurve, CsvTableError> {
    let mut table = CsvTable::open(path)?;
    let position = table.column(if passage.is_some() { &["x_m", "t_s"] } else { &["x_m"] })?;
    let drag = table.column(&["drag_n", "fx_n"])?;
    let sign = if table.name(drag).eq_ignore_ascii_case("fx_n") { -1.0 } else { 1.0 };
    let mut points = Vec::new();
    while let Some(record) = table.next()? {
        let number = |column| table.number(&record, column);
        if let (Some(position), Some(drag)) = (number(position)?, number(drag)?) {
            points.push((position, sign * drag));
        }
    }
    let Some(&(first, _)) = points.first() else { return Err(table.empty(drag)) };
    if let Some(SteadyPassage { speed_m_s, entry_s, entry_x_m }) = passage
        && table.name(position).eq_ignore_ascii_case("t_s")
    {
        let entry_s = entry_s.unwrap_or(first);
        for (position, _) in &mut points {
            *position = entry_x_m + speed_m_s * (*position - entry_s);
        }
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
            assert_eq!(read_trace(file.path(), None).unwrap().drag, [(0.1, 0.5)]);
        }
        std::fs::write(file.path(), "x_m,fz_n\n").unwrap();
        let error = read_trace(file.path(), None).unwrap_err().to_string();
        assert!(error.ends_with("no column `drag_n` or `fx_n`; found `x_m`, `fz_n`"), "{error}");
    }

    #[test]
    fn a_trace_over_time_is_placed_by_its_speed() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), "t_s,fx_n\n10,0\n12,-0.5\n").unwrap();
        let passage = SteadyPassage { speed_m_s: 0.25, entry_s: None, entry_x_m: -0.05 };
        let points = |passage| read_trace(file.path(), Some(passage)).unwrap().drag;
        assert_eq!(points(passage), [(-0.05, 0.0), (0.45, 0.5)]);
        let later = SteadyPassage { entry_s: Some(12.0), ..passage };
        assert_eq!(points(later), [(-0.55, 0.0), (-0.05, 0.5)]);
        assert!(read_trace(file.path(), None).is_err());
    }
}
