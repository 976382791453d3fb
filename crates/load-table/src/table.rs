//! Tables of loads as CSV, with commas, semicolons or tabs.

use std::collections::HashSet;

use csv::{ReaderBuilder, StringRecord, Trim, WriterBuilder};

use super::columns::{Fault, Line, LoadColumn};
use super::load::HungLoad;
use shell_data::Scale;
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
            let cells = fields(text, separator).map_err(|why| fault(line, None, why))?;
            if cells.len() != columns.len() {
                let message = format!("{} fields, the header has {}", cells.len(), columns.len());
                return Err(fault(line, None, message));
            }
            let label = (table.loads.len() + 1).to_string();
            let load = load((line, label), &columns, &cells).map_err(|(column, message)| {
                let at = columns.iter().rposition(|(known, _)| Some(*known) == column);
                fault(line, at.map(|at| table.header[at].as_str()), message)
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

    /// Returns the loads whose labels are none of these.
    #[must_use]
    pub fn without(&self, labels: &[String]) -> Self {
        let is_kept = |at: &usize| !labels.contains(&self.loads[*at].group);
        let kept: Vec<usize> = (0..self.loads.len()).filter(is_kept).collect();
        Self {
            header: self.header.clone(),
            cells: kept.iter().map(|&at| self.cells[at].clone()).collect(),
            loads: kept.iter().map(|&at| self.loads[at].clone()).collect(),
        }
    }

    pub fn loads(&self) -> &[HungLoad] {
        &self.loads
    }

    /// Returns true if the table has a column of labels; otherwise loads are numbered from 1.
    pub fn has_labels(&self) -> bool {
        self.header.iter().any(|name| is_group(name))
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
    LoadColumn::from_name(name) == Ok((LoadColumn::Group, Scale::ONE))
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

/// Parses a line's load, with its label if the line states none.
fn load(
    (number, label): (usize, String),
    columns: &[(LoadColumn, Scale)],
    cells: &[String],
) -> Result<HungLoad, Fault> {
    let mut line = Line { columns, numbers: Vec::new(), word: None };
    let (mut group, mut mounting) = (None, None);
    for ((column, scale), cell) in columns.iter().zip(cells) {
        if cell.is_empty() {
            continue;
        }
        match column {
            LoadColumn::Group => group = Some(cell.clone()),
            LoadColumn::Mounting => mounting = Some(cell.clone()),
            LoadColumn::Direction => line.word = Some(cell.as_str()),
            LoadColumn::Other => {}
            quantity => {
                let value = parse_number(cell).map_err(|why| (Some(*column), why))?;
                // Points in m and in mm are two columns of the same quantity.
                if line.numbers.iter().any(|(known, _)| known == quantity) {
                    return Err((Some(*column), "given twice, in two units".to_owned()));
                }
                line.numbers.push((*quantity, scale.to_si(value)));
            }
        }
    }
    let pull = line.pull()?;
    let errors = line.errors(&pull)?;
    Ok(HungLoad { group: group.unwrap_or(label), pull, errors, mounting, line: number })
}

/// Parses a number with a decimal point or a decimal comma.
fn parse_number(cell: &str) -> Result<f64, String> {
    let plain = cell.replace('−', "-");
    if let Some((whole, decimals)) = plain.split_once(',')
        && decimals.len() == 3
        && !whole.trim_start_matches('-').starts_with('0')
    {
        return Err(format!(
            "`{cell}` is `{whole}.{decimals}` or `{whole}{decimals}`: write one of these"
        ));
    }
    let value = plain.replacen(',', ".", 1).parse::<f64>().ok().filter(|x| x.is_finite());
    value.ok_or_else(|| format!("`{cell}` is not a number"))
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
            "force_n,x_mm,y_mm,z_mm,direction\n2,0,30,40,+x",
            "force_mn;x_m;y_cm;z_m;dx;dy;dz\n2000;0;3;0,04;17;0;0",
            "# a rig\n\nForce [N],x_m,Y (mm),z mm,azimuth_deg,elevation_deg\n\n2,0,30,40,0,0\n",
            // Nose down by 90°: gravity pulls along the sensor's x.
            "force_n\tx_m\ty_mm\tz_mm\troll_deg\tpitch_deg\n2\t0\t30\t40\t0\t90",
            "force_n,x_m,y_mm,z_mm,ax,ay,az\n2,0,30,40,-9.81,0,0",
            "fx_n,fy_n,fz_n,mx_nm,my_mNm,mz_nm\n2,0,0,0,80,-0.06",
        ] {
            assert_close(&wrenches(text)[0], &expected);
        }
    }

    #[test]
    fn masses_hang_down_and_a_turned_sensor_sees_them_aside() {
        let rows = wrenches(
            "mass_g,x_m,y_m,z_m,roll_deg,pitch_deg\n1000,0,0,0,0,0\n1000,0,0,0,90,0\n1000,0,0,0,0,-90\n",
        );
        assert_close(&rows[0][..3], &[0.0, 0.0, -9.80665]);
        assert_close(&rows[1][..3], &[0.0, -9.80665, 0.0]);
        assert_close(&rows[2][..3], &[-9.80665, 0.0, 0.0]);
    }

    #[test]
    fn errors_are_those_that_are_stated_and_otherwise_the_usual_ones() {
        let table = "mass_kg,x_m,y_m,z_m,mass_error_g,angle_error_deg,lever_error_mm\n\
                     1,0,0,0,10,,\n2,0,0,0,,3,0\n";
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
            ("x_mm,x_mm\n1,1", "line 1, column `x_mm`: a second column for the same"),
            ("mass_kg,x_m,x_mm\n1,1,1", "line 2, column `x_mm`: given twice, in two units"),
            ("mass_kg\n0\n#\none", "line 4, column `mass_kg`: `one` is not a number"),
            ("mass_kg,x_mm\n1,2,3", "line 2: 3 fields, the header has 2"),
            ("mass_kg,x_mm\n0", "line 2: 1 fields, the header has 2"),
            ("mass_kg,force_n\n1,2", "line 2: both a mass and a force"),
            ("x_mm\n2", "line 2: no mass, no force and no wrench"),
            ("force_n\n-2", "line 2: a load below zero: turn its direction around"),
            ("force_n,pose\n0,a\n0,a", "line 3: a second load with the label `a`"),
            ("force_n,angle_error_deg\n0,-1", "line 2: an error below zero"),
            (
                "mass_g,mass_error_g,force_error_n\n0,1,1",
                "line 2: the error of a mass and that of a force",
            ),
            (
                "mass_g;x_m\n1,500;0",
                "line 2, column `mass_g`: `1,500` is `1.500` or `1500`: write one of these",
            ),
        ] {
            assert_eq!(HungLoads::parse(text).unwrap_err().to_string(), message, "{text}");
        }
    }

    #[test]
    fn a_missing_number_is_not_taken_for_zero() {
        let missing = "a load needs this number: write it, also where it is 0";
        for (header, line, message) in [
            (
                "",
                "",
                "line 2: a load needs a column `z_mm` or `z_cm` or `z_m` or `z_in` or `z_ft`: \
             write it, also where it is 0",
            ),
            (",z_mm", ",", &format!("line 2, column `z_mm`: {missing}")),
            (
                ",z_mm,dx",
                ",1,",
                "line 2, column `dx`: no direction of this load: write it, also if it is down",
            ),
            (",z_mm,dx,dy,dz", ",1,1,,0", &format!("line 2, column `dy`: {missing}")),
            (
                ",z_mm,azimuth_deg,elevation_deg",
                ",1,90,",
                &format!("line 2, column `elevation_deg`: {missing}"),
            ),
            (
                ",z_mm,yaw_deg,roll_deg,pitch_deg",
                ",1,9,,2",
                &format!("line 2, column `roll_deg`: {missing}"),
            ),
            (",z_mm,dx,dy,dz", ",1,0,0,0", "line 2: a direction of length 0"),
            (",z_mm,dx,dy,dz,direction", ",1,0,0,1,up", "line 2: more than one direction"),
        ] {
            let text = format!("force_n,x_mm,y_mm{header}\n2,1,1{line}\n");
            assert_eq!(HungLoads::parse(&text).unwrap_err().to_string(), message, "{text}");
        }
        let wrench = "fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm\n1,2,3,4,5,";
        let error = HungLoads::parse(wrench).unwrap_err();
        assert_eq!(error.to_string(), format!("line 2, column `mz_nm`: {missing}"));
        // An empty hook needs no point, and weights hang down without a column of directions.
        let table = "mass_g,x_mm,y_mm,z_mm\n0,,,\n1000,0,0,0\n";
        assert_close(&wrenches(table)[1][..3], &[0.0, 0.0, -9.80665]);
    }

    #[test]
    fn names_without_a_known_unit_are_told_all_units_of_the_same_quantity() {
        for (name, message) in [
            ("x", "`x` needs a unit: write `x_mm` or `x_cm` or `x_m` or `x_in` or `x_ft`"),
            (
                "X (deg)",
                "`X (deg)` needs a unit: write `x_mm` or `x_cm` or `x_m` or `x_in` or `x_ft`",
            ),
            (
                "mass",
                "`mass` needs a unit: write `mass_kg` or `mass_g` or `mass_mg` or `mass_lb` or `mass_oz`",
            ),
            (
                "azimuth",
                "`azimuth` needs a unit: write `azimuth_rad` or `azimuth_mrad` or `azimuth_deg` or `azimuth_rev`",
            ),
            ("ax_g", "unknown column `ax_g`: write `ax`, which has no unit"),
            ("directoin", "unknown column `directoin`, did you mean `direction`?"),
            (
                "mas_kg",
                "unknown column `mas_kg`, did you mean one of `mass_kg` or `mass_g` or `mass_mg` or `mass_lb` or `mass_oz`?",
            ),
            (
                "date",
                "unknown column `date`; a column that is only copied is named `notes` or `notes_date`",
            ),
        ] {
            let error = HungLoads::parse(&format!("{name}\n1\n")).unwrap_err().to_string();
            assert_eq!(error, format!("line 1: {message}"));
        }
        // A pound is 0.45359237 kg and an inch 0.0254 m.
        let table = "Mass [lb],x (in),y_ft,z_mm,notes_date\n1,1,0,0,today\n";
        assert_close(
            &wrenches(table)[0],
            &[0.0, 0.0, -4.448_221_615_260_5, 0.0, 0.0254 * 4.448_221_615_260_5, 0.0],
        );
    }

    #[test]
    fn a_written_table_reads_back_in_the_new_order() {
        let table = HungLoads::parse(
            "mass_kg,x_m,y_m,z_m,notes,plan_gain\n1,0,0,0,\"a, b\",7\n2,0,0,0,,7\n",
        )
        .unwrap();
        let text = table.to_csv(&[1, 0], &[("plan_gain".to_owned(), vec!["3".to_owned(); 2])]);
        assert_eq!(
            text,
            "group,mass_kg,x_m,y_m,z_m,notes,plan_gain\n2,2,0,0,0,,3\n1,1,0,0,0,\"a, b\",3\n"
        );
        let again = HungLoads::parse(&text).unwrap();
        let masses = again.loads().iter().map(|load| match load.pull {
            Pull::Force { mass_kg, .. } => mass_kg,
            Pull::Wrench(_) => None,
        });
        assert_eq!(masses.collect::<Vec<_>>(), [Some(2.0), Some(1.0)]);
        assert_eq!(again.loads()[0].group, "2");
    }

    #[test]
    fn loads_read_as_a_person_says_them() {
        let of_force = "mass_kg,force_n,x_mm,y_mm,z_mm,direction,azimuth_deg,elevation_deg\n\
                        0.5,,30,0,0,down,,\n,2,0,0,0,-x,,\n,1.25,0,0,0,,45,0\n,0,,,,,,\n";
        let of_wrench = "fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm\n-1.5,0,0,0,0.02,0\n";
        let [table, wrench] = [of_force, of_wrench].map(|text| HungLoads::parse(text).unwrap());
        let loads = table.loads().iter().chain(wrench.loads());
        let said: Vec<String> = loads.map(HungLoad::to_string).collect();
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
