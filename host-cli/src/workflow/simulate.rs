//! Measured trials and traces beside the model of the beam channel: drag over position for figures, of the model with its
//! jumps where they are, and as measured.

use std::path::{Path, PathBuf};

use beam_channel::{Model, Wall};
use csv::StringRecord;
use figures::ChannelCurve;
use serde::Serialize;
use shell_data::hint::quoted;

use super::WorkflowError;

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
/// [`WorkflowError`] naming file, line and column.
pub fn read_trace(
    path: &Path,
    passage: Option<SteadyPassage>,
) -> Result<ChannelCurve, WorkflowError> {
    let table = CsvTable::open(path)?;
    let positions: &[&str] = if passage.is_some() { &["x_m", "t_s"] } else { &["x_m"] };
    let (position, position_name) = table.column(positions)?;
    let (drag, drag_name) = table.column(&["drag_n", "fx_n"])?;
    let sign = if drag_name == "fx_n" { -1.0 } else { 1.0 };
    let mut points = Vec::new();
    for record in &table.records {
        let number = |column| table.number(record, column);
        if let (Some(position), Some(drag)) = (number(position)?, number(drag)?) {
            points.push((position, sign * drag));
        }
    }
    let Some(&(first, _)) = points.first() else { return Err(table.empty(drag)) };
    if let Some(SteadyPassage { speed_m_s, entry_s, entry_x_m }) = passage
        && position_name == "t_s"
    {
        let entry_s = entry_s.unwrap_or(first);
        for (position, _) in &mut points {
            *position = entry_x_m + speed_m_s * (*position - entry_s);
        }
    }
    let label = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    Ok(ChannelCurve { label, drag: points, contacts: Vec::new(), measured: true })
}

/// The trials of one condition.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MeasuredCondition {
    /// Its name in the table.
    #[serde(rename = "condition")]
    pub name: String,
    /// Trials with a drag.
    pub trials: usize,
    /// Trials without.
    pub without_drag: usize,
    /// Mean of the trials' mean drags in N.
    pub mean_drag_n: f64,
    /// Standard deviation between trials in N; none of a single trial.
    pub sd_drag_n: Option<f64>,
}

/// Reads a table of trials, one row each, with the columns `condition` and `drag_mean_n`, in the
/// order in which the conditions appear.
///
/// # Errors
/// [`WorkflowError`] naming file, line and column.
pub fn read_trials(path: &Path) -> Result<Vec<MeasuredCondition>, WorkflowError> {
    let table = CsvTable::open(path)?;
    let (condition, _) = table.column(&["condition"])?;
    let (drag, _) = table.column(&["drag_mean_n"])?;
    let mut groups: Vec<(String, Vec<f64>, usize)> = Vec::new();
    for record in &table.records {
        let name = record.get(condition).unwrap_or_default();
        let at = groups.iter().position(|group| group.0 == name).unwrap_or_else(|| {
            groups.push((name.to_owned(), Vec::new(), 0));
            groups.len() - 1
        });
        match table.number(record, drag)? {
            Some(drag) => groups[at].1.push(drag),
            None => groups[at].2 += 1,
        }
    }
    let conditions: Vec<MeasuredCondition> =
        groups.into_iter().filter_map(MeasuredCondition::new).collect();
    if conditions.is_empty() {
        return Err(table.empty(drag));
    }
    Ok(conditions)
}

impl MeasuredCondition {
    /// `None` if no trial has a drag.
    fn new((name, drags, without_drag): (String, Vec<f64>, usize)) -> Option<Self> {
        let trials = drags.len();
        let mean_drag_n = drags.iter().sum::<f64>() / trials as f64;
        let squares: f64 = drags.iter().map(|drag| (drag - mean_drag_n).powi(2)).sum();
        let sd_drag_n = (trials > 1).then(|| (squares / (trials as f64 - 1.0)).sqrt());
        (trials > 0).then_some(Self { name, trials, without_drag, mean_drag_n, sd_drag_n })
    }
}

/// A table of which only some columns matter.
struct CsvTable {
    path: PathBuf,
    header: Vec<String>,
    records: Vec<StringRecord>,
}

impl CsvTable {
    fn open(path: &Path) -> Result<Self, WorkflowError> {
        let failed = |error: csv::Error| {
            let message = format!("cannot read `{}`: {error}", path.display());
            WorkflowError::refused(message, None)
        };
        let mut builder = csv::ReaderBuilder::new();
        builder.trim(csv::Trim::All).flexible(true);
        let mut reader = builder.from_path(path).map_err(failed)?;
        let header = reader.headers().map_err(failed)?;
        let header =
            header.iter().map(|name| name.trim_start_matches('\u{feff}').to_owned()).collect();
        let records = reader.into_records().collect::<Result<_, _>>().map_err(failed)?;
        Ok(Self { path: path.to_path_buf(), header, records })
    }

    /// The position and name of the first of `names` that is there.
    fn column<'n>(&self, names: &[&'n str]) -> Result<(usize, &'n str), WorkflowError> {
        let position = |name: &str| self.header.iter().position(|h| h.eq_ignore_ascii_case(name));
        names.iter().find_map(|name| Some((position(name)?, *name))).ok_or_else(|| {
            let (wanted, found) = (quoted(names, " or "), quoted(&self.header, ", "));
            self.unusable(format!(", line 1: no column {wanted}; found {found}"))
        })
    }

    /// `None` where nothing stands.
    fn number(&self, record: &StringRecord, column: usize) -> Result<Option<f64>, WorkflowError> {
        let text = record.get(column).unwrap_or_default();
        if text.is_empty() {
            return Ok(None);
        }
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(Some(value)),
            _ => {
                let line = record.position().map_or(0, csv::Position::line);
                let column = &self.header[column];
                let problem = format!("`{text}` in column `{column}` is not a finite number");
                Err(self.unusable(format!(", line {line}: {problem}")))
            }
        }
    }

    /// What is said of a table without a value in a column.
    fn empty(&self, column: usize) -> WorkflowError {
        self.unusable(format!(" has no rows with a value in column `{}`", self.header[column]))
    }

    fn unusable(&self, problem: String) -> WorkflowError {
        WorkflowError::refused(format!("`{}`{problem}", self.path.display()), None)
    }
}

#[cfg(test)]
mod tests {
    use beam_channel::Setup;

    use super::*;

    fn read(text: &str) -> Result<Vec<MeasuredCondition>, WorkflowError> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        read_trials(file.path())
    }

    #[test]
    fn trials_are_grouped_in_the_order_of_the_table() {
        let text = "file,condition,drag_mean_n,lift\n\
                    a,3 cm,0.12,1\nb,free,0.01,1\nc,3 cm,0.14,1\nd,3 cm,,1\n";
        let [deep, free] = &read(text).unwrap()[..] else { panic!("two conditions") };
        assert_eq!((deep.name.as_str(), deep.trials, deep.without_drag), ("3 cm", 2, 1));
        assert!((deep.mean_drag_n - 0.13).abs() < 1e-15);
        assert!((deep.sd_drag_n.unwrap() - 0.02 / 2_f64.sqrt()).abs() < 1e-15);
        assert_eq!((free.name.as_str(), free.sd_drag_n), ("free", None));
    }

    #[test]
    fn a_table_that_does_not_fit_is_named() {
        let error = |text| {
            let error = read(text).unwrap_err().to_string();
            error.split_once('`').unwrap().1.split_once('`').unwrap().1.to_owned()
        };
        let expected = ", line 1: no column `drag_mean_n`; found `condition`, `fx_n`";
        assert_eq!(error("condition,fx_n\n1 cm,2\n"), expected);
        let expected = ", line 3: `x` in column `drag_mean_n` is not a finite number";
        assert_eq!(error("condition,drag_mean_n\n1 cm,2\n1 cm,x\n"), expected);
        let expected = " has no rows with a value in column `drag_mean_n`";
        assert_eq!(error("condition,drag_mean_n\n1 cm,\n"), expected);
    }

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
