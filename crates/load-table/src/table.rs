//! Tables of loads as CSV, with commas, semicolons or tabs.

use std::collections::HashSet;

use csv::{ReaderBuilder, StringRecord, Trim, WriterBuilder};

use super::columns::{LoadColumn, errors, pull};
use super::load::HungLoad;
use shell_data::wrench::{Axis, PerAxis};

#[derive(Clone, Debug, Default, PartialEq)]
pub struct HungLoads {
    header: Vec<String>,
    cells: Vec<Vec<String>>,
    loads: Vec<HungLoad>,
}

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}{}: {message}", column.as_ref().map_or_else(String::new, |name| format!(", column `{name}`")))]
pub struct HungLoadError {
    /// Line number, from 1.
    pub line: usize,
    pub column: Option<String>,
    pub message: String,
}

impl HungLoads {
    /// Parses a table with a header; skips blank lines and lines that begin with `#`.
    ///
    /// # Errors
    /// [`HungLoadError`] with the line and the column.
    pub fn parse(text: &str) -> Result<Self, HungLoadError> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let mut lines = (1..).zip(text.lines()).filter(|(_, line)| {
            let line = line.trim();
            !line.is_empty() && !line.starts_with('#')
        });
        let fault = |line, column: Option<&str>, message: String| HungLoadError {
            line,
            column: column.map(str::to_owned),
            message,
        };
        let Some((header_line, first)) = lines.next() else {
            return Err(fault(1, None, "the table of loads is empty".to_owned()));
        };
        let separator = b";\t".iter().find(|s| first.as_bytes().contains(s));
        let separator = *separator.unwrap_or(&b',');
        let header = fields(first, separator).map_err(|why| fault(header_line, None, why))?;
        let mut columns = Vec::new();
        for name in &header {
            let column =
                LoadColumn::from_name(name).map_err(|why| fault(header_line, None, why))?;
            if columns.contains(&column) && column.0 != LoadColumn::Other {
                let message = "a second column for the same".to_owned();
                return Err(fault(header_line, Some(name), message));
            }
            columns.push(column);
        }
        let mut table = Self { header, ..Self::default() };
        let mut labels = HashSet::new();
        for (line, text) in lines {
            let mut cells = fields(text, separator).map_err(|why| fault(line, None, why))?;
            if cells.len() > columns.len() {
                let message = format!("{} fields, the header has {}", cells.len(), columns.len());
                return Err(fault(line, None, message));
            }
            cells.resize(columns.len(), String::new());
            let load = load(line, &columns, &cells).map_err(|(column, message)| {
                fault(line, column.map(|at| table.header[at].as_str()), message)
            })?;
            if !labels.insert(load.group.clone()) {
                let message = format!("a second load with the label `{}`", load.group);
                return Err(fault(line, None, message));
            }
            table.cells.push(cells);
            table.loads.push(load);
        }
        match table.loads.is_empty() {
            true => Err(fault(header_line, None, "the table has no loads".to_owned())),
            false => Ok(table),
        }
    }

    /// Creates a table of labelled wrenches, N and N·m.
    ///
    /// # Errors
    /// [`HungLoadError`] if there are none, a number is not finite, or a label is given twice.
    pub fn from_wrenches(
        wrenches: impl IntoIterator<Item = (String, PerAxis<f64>)>,
    ) -> Result<Self, HungLoadError> {
        let mut writer = WriterBuilder::new().from_writer(Vec::new());
        let header = ["group"].into_iter().chain(Axis::ALL.map(Axis::column));
        writer.write_record(header).expect("memory takes what is written");
        for (label, wrench) in wrenches {
            let cells = [label].into_iter().chain(wrench.map(|value| value.to_string()));
            writer.write_record(cells).expect("records of one length, into memory");
        }
        Self::parse(&text_of(writer))
    }

    /// Returns some of the lines with new labels.
    ///
    /// # Panics
    /// If an index is not below the number of lines.
    #[must_use]
    pub fn relabelled(&self, lines: impl IntoIterator<Item = (usize, String)>) -> Self {
        let group = self.header.iter().position(|name| is_group(name));
        let mut table = Self { header: self.header.clone(), ..Self::default() };
        if group.is_none() {
            table.header.insert(0, "group".to_owned());
        }
        for (line, label) in lines {
            let mut cells = self.cells[line].clone();
            match group {
                Some(at) => cells[at].clone_from(&label),
                None => cells.insert(0, label.clone()),
            }
            table.cells.push(cells);
            table.loads.push(HungLoad { group: label, ..self.loads[line].clone() });
        }
        table
    }

    pub fn loads(&self) -> &[HungLoad] {
        &self.loads
    }

    pub fn column(&self, name: &str) -> Option<impl Iterator<Item = &str>> {
        let at = self.header.iter().position(|known| known.eq_ignore_ascii_case(name))?;
        Some(self.cells.iter().map(move |cells| cells[at].as_str()))
    }

    /// Writes lines, in this order, as CSV that [`HungLoads::parse`] reads. Names of additional
    /// columns begin with `plan_`. Missing labels are added, so that lines keep them.
    ///
    /// # Panics
    /// If an index is not below the number of lines.
    pub fn to_csv(&self, lines: &[usize], more: &[(String, Vec<String>)]) -> String {
        let labelled = self.relabelled(lines.iter().map(|&at| (at, self.loads[at].group.clone())));
        let is_own = |at: &usize| !labelled.header[*at].to_lowercase().starts_with("plan_");
        let kept: Vec<usize> = (0..labelled.header.len()).filter(is_own).collect();
        let mut writer = WriterBuilder::new().from_writer(Vec::new());
        let header = kept.iter().map(|&at| labelled.header[at].as_str());
        let header = header.chain(more.iter().map(|(name, _)| name.as_str()));
        writer.write_record(header).expect("memory takes what is written");
        for (row, own) in labelled.cells.iter().enumerate() {
            let cells = kept.iter().map(|&at| own[at].as_str());
            let cells = cells.chain(more.iter().map(|(_, column)| column[row].as_str()));
            writer.write_record(cells).expect("records of one length, into memory");
        }
        text_of(writer)
    }
}

fn is_group(name: &str) -> bool {
    LoadColumn::from_name(name) == Ok((LoadColumn::Group, 1.0))
}

fn text_of(writer: csv::Writer<Vec<u8>>) -> String {
    let bytes = writer.into_inner().expect("memory takes what is written");
    String::from_utf8(bytes).expect("cells are text")
}

fn fields(line: &str, separator: u8) -> Result<Vec<String>, String> {
    let mut csv = ReaderBuilder::new();
    csv.has_headers(false).delimiter(separator).trim(Trim::All);
    let mut reader = csv.from_reader(line.as_bytes());
    let mut record = StringRecord::new();
    reader.read_record(&mut record).map_err(|error| error.to_string())?;
    Ok(record.iter().map(str::to_owned).collect())
}

/// Parses a line's load, or returns the column at fault and a message.
fn load(
    line: usize,
    columns: &[(LoadColumn, f64)],
    cells: &[String],
) -> Result<HungLoad, (Option<usize>, String)> {
    let mut numbers: Vec<(LoadColumn, f64)> = Vec::new();
    let (mut group, mut mounting, mut word) = (None, None, None);
    for (at, ((column, unit), cell)) in columns.iter().zip(cells).enumerate() {
        if cell.is_empty() {
            continue;
        }
        match column {
            LoadColumn::Group => group = Some(cell.clone()),
            LoadColumn::Mounting => mounting = Some(cell.clone()),
            LoadColumn::Direction => word = Some(cell.as_str()),
            LoadColumn::Other => {}
            quantity => {
                let value = cell.replace('−', "-").parse::<f64>().ok().filter(|x| x.is_finite());
                let value = value.ok_or_else(|| (Some(at), format!("`{cell}` is not a number")))?;
                // Points in m and in mm are two columns of the same quantity.
                if numbers.iter().any(|(known, _)| known == quantity) {
                    return Err((Some(at), "given twice, in two units".to_owned()));
                }
                numbers.push((*quantity, unit * value));
            }
        }
    }
    let number =
        |wanted| numbers.iter().find(|(quantity, _)| *quantity == wanted).map(|(_, value)| *value);
    let pull = pull(number, word).map_err(|message| (None, message))?;
    let errors = errors(number, &pull).map_err(|message| (None, message))?;
    Ok(HungLoad { group: group.unwrap_or_else(|| line.to_string()), pull, errors, mounting, line })
}

#[cfg(test)]
mod tests {
    use super::super::load::Pull;
    use super::*;

    fn wrenches(text: &str) -> Vec<[f64; 6]> {
        HungLoads::parse(text).unwrap().loads().iter().map(HungLoad::wrench).collect()
    }

    #[track_caller]
    fn assert_close(found: &[f64], expected: &[f64]) {
        for (found, expected) in found.iter().zip(expected) {
            // A few roundings of numbers of order 1.
            assert!((found - expected).abs() < 1e-14, "{found:?} {expected:?}");
        }
    }

    #[test]
    fn every_way_to_give_a_direction_gives_the_same_wrench() {
        // Two newtons at (0, 30, 40) mm towards +x: Fx 2, My 0.08, Mz −0.06.
        let expected = [2.0, 0.0, 0.0, 0.0, 0.08, -0.06];
        for text in [
            "force_n,y_mm,z_mm,direction\n2,30,40,+x",
            "force_mn;y_cm;z_m;dx\n2000;3;0.04;17",
            "# a rig\n\nforce_n,y_mm,z_mm,azimuth_deg,elevation_deg\n\n2,30,40,0,0\n",
            // Nose down by 90°: gravity pulls along the sensor's x.
            "force_n\ty_mm\tz_mm\tpitch_deg\n2\t30\t40\t90",
            "force_n,y_mm,z_mm,ax,ay,az\n2,30,40,-9.81,0,0",
            "fx_n,my_nm,mz_nm\n2,0.08,-0.06",
        ] {
            assert_close(&wrenches(text)[0], &expected);
        }
    }

    #[test]
    fn masses_hang_down_and_a_turned_sensor_sees_them_aside() {
        let rows = wrenches("mass_g,roll_deg,pitch_deg\n1000,0,0\n1000,90,0\n1000,0,-90\n");
        assert_close(&rows[0][..3], &[0.0, 0.0, -9.80665]);
        assert_close(&rows[1][..3], &[0.0, -9.80665, 0.0]);
        assert_close(&rows[2][..3], &[-9.80665, 0.0, 0.0]);
    }

    #[test]
    fn errors_are_those_that_are_stated_and_otherwise_the_usual_ones() {
        let table = "mass_kg,mass_error_g,angle_error_deg,lever_error_mm\n1,10,,\n2,,3,0\n";
        let table = HungLoads::parse(table).unwrap();
        let [first, second] = table.loads() else { panic!("two loads") };
        assert_close(&[first.errors.force_n, first.errors.lever_m], &[0.0980665, 1e-3]);
        assert_close(
            &[first.errors.angle_rad, second.errors.angle_rad],
            &[1_f64.to_radians(), 3_f64.to_radians()],
        );
        assert_close(
            &[second.errors.force_n, second.errors.lever_m],
            &[0.002 * 2.0 * 9.80665, 0.0],
        );
    }

    #[test]
    fn faults_name_line_and_column() {
        for (text, message) in [
            ("", "line 1: the table of loads is empty"),
            ("mass_kg\n", "line 1: the table has no loads"),
            ("mas_kg\n1", "line 1: unknown column `mas_kg`, did you mean `mass_kg`?"),
            ("x_mm,x_mm\n1,1", "line 1, column `x_mm`: a second column for the same"),
            ("mass_kg,x_m,x_mm\n1,1,1", "line 2, column `x_mm`: given twice, in two units"),
            ("mass_kg\n1\n#\none", "line 4, column `mass_kg`: `one` is not a number"),
            ("mass_kg,x_mm\n1,2,3", "line 2: 3 fields, the header has 2"),
            ("mass_kg,force_n\n1,2", "line 2: both a mass and a force"),
            ("x_mm\n2", "line 2: no mass, no force and no wrench"),
            ("force_n\n-2", "line 2: a load below zero: turn its direction around"),
            ("force_n,dx,roll_deg\n2,1,5", "line 2: more than one direction"),
            ("force_n,dx\n2,0", "line 2: a direction of length 0"),
            ("force_n,pose\n2,a\n3,a", "line 3: a second load with the label `a`"),
            ("force_n,angle_error_deg\n2,-1", "line 2: an error below zero"),
            (
                "mass_g,mass_error_g,force_error_n\n2,1,1",
                "line 2: the error of a mass and that of a force",
            ),
        ] {
            assert_eq!(HungLoads::parse(text).unwrap_err().to_string(), message, "{text}");
        }
    }

    #[test]
    fn a_written_table_reads_back_in_the_new_order() {
        let table = HungLoads::parse("mass_kg,notes,plan_gain\n1,\"a, b\",7\n2,,7\n").unwrap();
        let text = table.to_csv(&[1, 0], &[("plan_gain".to_owned(), vec!["3".to_owned(); 2])]);
        assert_eq!(text, "group,mass_kg,notes,plan_gain\n3,2,,3\n2,1,\"a, b\",3\n");
        let again = HungLoads::parse(&text).unwrap();
        let masses = again.loads().iter().map(|load| match load.pull {
            Pull::Force { mass_kg, .. } => mass_kg,
            Pull::Wrench(_) => None,
        });
        assert_eq!(masses.collect::<Vec<_>>(), [Some(2.0), Some(1.0)]);
        assert_eq!(again.loads()[0].group, "3");
    }

    #[test]
    fn loads_read_as_a_person_says_them() {
        let table = "mass_kg,force_n,x_mm,direction,azimuth_deg,fx_n,my_nm\n0.5,,30,down,,,\n,2,,-x,,,\n\
                     ,1.25,,,45,,\n,0,,,,,\n,,,,,-1.5,0.02\n";
        let table = HungLoads::parse(table).unwrap();
        let said: Vec<String> = table.loads().iter().map(HungLoad::to_string).collect();
        assert_eq!(
            said,
            [
                "0.5 kg at (30, 0, 0) mm, down",
                "2 N at (0, 0, 0) mm, towards −x",
                "1.25 N at (0, 0, 0) mm, azimuth 45.0°, elevation 0.0°",
                "no load",
                "Fx −1.5 N, My +0.02 N·m",
            ]
        );
    }
}
