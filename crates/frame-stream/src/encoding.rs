//! Rows as text: a JSON object per line, or CSV.
//!
//! The names are as in `record` and `convert`: `t_s`, `index`, `host_s`, `s1` … `s8`, `fx_n` …
//! `mz_nm`, `fx_se_n` … `mz_se_nm`, `flags`; then `row`, the row's number, and `lost`, the rows
//! that this reader has lost. Numbers have the fewest digits that read back to the same bits.

use board_link::recording::write_time;
use shared_proto::CHANNELS;
use shell_data::wrench::{Axes, PerAxis};

#[derive(Clone, Debug, PartialEq)]
pub struct StreamRow {
    /// Time on the board's clock, µs, as in a log.
    pub time_us: i64,
    pub index: i64,
    /// Arrival in µs since 1970 by this computer's clock.
    pub host_us: i64,
    /// Readings in steps of the 12-bit converter.
    pub readings: Option<[f64; CHANNELS]>,
    /// Wrench, N and N·m.
    pub wrench: Option<PerAxis<f64>>,
    pub standard_errors: Option<PerAxis<f64>>,
    /// Flags as in a log, plus `tared` and `markN`.
    pub flags: String,
    pub lost: bool,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StreamFormat {
    /// An object per line; unknown values are left out.
    #[default]
    JsonLines,
    /// A header line, then the columns of the first row.
    Csv,
}

#[derive(Clone, Debug)]
pub struct RowEncoder {
    format: StreamFormat,
    axes: Axes,
    /// Names of readings, wrench and standard errors; empty if not written.
    names: [Vec<String>; 3],
}

impl RowEncoder {
    pub fn new(format: StreamFormat, axes: Axes, first: &StreamRow) -> Self {
        let readings: Vec<_> = (1..=CHANNELS).map(|channel| format!("s{channel}")).collect();
        let wrench: Vec<_> = axes.columns().into_iter().map(str::to_owned).collect();
        let errors = wrench.iter().map(|name| name.replace('_', "_se_")).collect();
        let names = [
            (readings, first.readings.is_some()),
            (wrench, first.wrench.is_some()),
            (errors, first.standard_errors.is_some()),
        ]
        .map(|(names, is_there)| {
            let is_wanted = is_there || format == StreamFormat::JsonLines;
            if is_wanted { names } else { Vec::new() }
        });
        Self { format, axes, names }
    }

    pub fn header(&self) -> Option<Vec<u8>> {
        let names: String = self.names.iter().flatten().map(|name| format!(",{name}")).collect();
        let line = format!("t_s,index,host_s{names},flags,row,lost\n");
        (self.format == StreamFormat::Csv).then(|| line.into_bytes())
    }

    /// Returns a row without its [`end`](Self::end), which differs by reader.
    pub fn begin(&self, row: &StreamRow) -> Vec<u8> {
        let mut text = Vec::with_capacity(512);
        let [time, index, host, flags, end] = match self.format {
            StreamFormat::JsonLines => {
                ["{\"t_s\":", ",\"index\":", ",\"host_s\":", ",\"flags\":\"", "\""]
            }
            StreamFormat::Csv => ["", ",", ",", ",", ""],
        };
        text.extend_from_slice(time.as_bytes());
        write_time(row.time_us, &mut text);
        text.extend_from_slice(format!("{index}{}{host}", row.index).as_bytes());
        write_time(row.host_us, &mut text);
        let values = [
            row.readings.map(|readings| readings.to_vec()),
            row.wrench.map(|wrench| self.axes.of(&wrench)),
            row.standard_errors.map(|errors| self.axes.of(&errors)),
        ];
        for (names, values) in self.names.iter().zip(values) {
            self.write_numbers(names, values, &mut text);
        }
        text.extend_from_slice(format!("{flags}{}{end}", row.flags).as_bytes());
        text
    }

    /// Returns a row's number, and the number of rows that its reader has lost.
    pub fn end(&self, row: u64, lost: u64) -> Vec<u8> {
        match self.format {
            StreamFormat::JsonLines => format!(",\"row\":{row},\"lost\":{lost}}}\n"),
            StreamFormat::Csv => format!(",{row},{lost}\n"),
        }
        .into_bytes()
    }

    fn write_numbers(&self, names: &[String], values: Option<Vec<f64>>, text: &mut Vec<u8>) {
        let is_csv = self.format == StreamFormat::Csv;
        if values.is_none() && !is_csv {
            return;
        }
        let mut digits = zmij::Buffer::new();
        for (at, name) in names.iter().enumerate() {
            match is_csv {
                true => text.push(b','),
                false => text.extend_from_slice(format!(",\"{name}\":").as_bytes()),
            }
            let value = values.as_ref().map(|values| values[at]).filter(|value| value.is_finite());
            match value {
                Some(value) => {
                    let digits = digits.format(value);
                    let digits = digits.strip_suffix(".0").unwrap_or(digits);
                    // A JSON integer has no negative zero.
                    let digits = if digits == "-0" { "-0.0" } else { digits };
                    text.extend_from_slice(digits.as_bytes());
                }
                None if is_csv => {}
                None => text.extend_from_slice(b"null"),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use shell_data::wrench::Axis;

    use super::*;

    fn row() -> StreamRow {
        StreamRow {
            time_us: 12_345_678,
            index: 7,
            host_us: 1_700_000_000_000_001,
            readings: Some([1.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]),
            wrench: Some([0.1, -0.0, 1e-7, f64::NAN, 2.0, 3.0]),
            standard_errors: None,
            flags: "s3:range mark1".to_owned(),
            lost: false,
        }
    }

    fn text(format: StreamFormat, axes: Axes) -> String {
        let encoder = RowEncoder::new(format, axes, &row());
        let line = [encoder.header().unwrap_or_default(), encoder.begin(&row()), encoder.end(9, 2)];
        String::from_utf8(line.concat()).unwrap()
    }

    #[test]
    fn a_row_of_json_has_the_known_values_only() {
        let expected = "{\"t_s\":12.345678,\"index\":7,\"host_s\":1700000000.000001,\"s1\":1,\"s2\":2.5,\
            \"s3\":3,\"s4\":4,\"s5\":5,\"s6\":6,\"s7\":7,\"s8\":8,\"fx_n\":0.1,\"fy_n\":-0.0,\"fz_n\":1e-7,\
            \"mx_nm\":null,\"my_nm\":2,\"mz_nm\":3,\"flags\":\"s3:range mark1\",\"row\":9,\"lost\":2}\n";
        assert_eq!(text(StreamFormat::JsonLines, Axes::ALL), expected);
    }

    #[test]
    fn columns_of_csv_equal_those_of_the_first_row() {
        let axes: Axes = [Axis::Fx, Axis::Mx].into_iter().collect();
        let expected = "t_s,index,host_s,s1,s2,s3,s4,s5,s6,s7,s8,fx_n,mx_nm,flags,row,lost\n\
            12.345678,7,1700000000.000001,1,2.5,3,4,5,6,7,8,0.1,,s3:range mark1,9,2\n";
        assert_eq!(text(StreamFormat::Csv, axes), expected);
    }
}
