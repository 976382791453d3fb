//! Rows as text: an object of JSON a line, or CSV.
//!
//! The names are those of `record` and `convert`: `t_s`, `index`, `host_s`, `s1` … `s8`, `fx_n` … `mz_nm`,
//! `fx_se_n` … `mz_se_nm`, `flags`, and at the end `row`, the number of the row in this stream, and `lost`, how many
//! rows this reader has lost so far. Numbers have the fewest digits that read back as the same bits.

use board_link::recording::write_time;
use shared_proto::CHANNELS;
use shell_data::wrench::Axes;

use crate::rows::StreamRow;

/// How rows are written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StreamFormat {
    /// An object a line; what is not known is left out.
    #[default]
    JsonLines,
    /// Columns that the first row decides on, after a line that names them.
    Csv,
}

/// Writes rows.
#[derive(Clone, Debug)]
pub struct RowEncoder {
    format: StreamFormat,
    axes: Axes,
    readings: Vec<FieldPrefix>,
    wrench: Vec<FieldPrefix>,
    errors: Vec<FieldPrefix>,
}

/// A column: its name, and what stands before its values.
#[derive(Clone, Debug)]
struct FieldPrefix {
    name: String,
    before: String,
}

impl RowEncoder {
    /// For rows such as `first`, whose wrenches have these axes.
    pub fn new(format: StreamFormat, axes: Axes, first: &StreamRow) -> Self {
        let fields = |names: Vec<String>, there: bool| -> Vec<FieldPrefix> {
            let wanted = there || format == StreamFormat::JsonLines;
            let field = |name: String| match format {
                StreamFormat::JsonLines => FieldPrefix { before: format!(",\"{name}\":"), name },
                StreamFormat::Csv => FieldPrefix { before: ",".to_owned(), name },
            };
            names.into_iter().filter(|_| wanted).map(field).collect()
        };
        let readings = (1..=CHANNELS).map(|channel| format!("s{channel}")).collect();
        let wrench: Vec<String> = axes.columns().into_iter().map(str::to_owned).collect();
        let errors = wrench.iter().map(|name| name.replace('_', "_se_")).collect();
        Self {
            format,
            axes,
            readings: fields(readings, first.readings.is_some()),
            wrench: fields(wrench, first.wrench.is_some()),
            errors: fields(errors, first.standard_errors.is_some()),
        }
    }

    /// The line that names the columns, if there is one.
    pub fn header(&self) -> Option<Vec<u8>> {
        let fields = [&self.readings, &self.wrench, &self.errors].into_iter().flatten();
        let names: String = fields.map(|field| format!(",{}", field.name)).collect();
        let line = format!("t_s,index,host_s{names},flags,row,lost\n");
        (self.format == StreamFormat::Csv).then(|| line.into_bytes())
    }

    /// A row but for its end, which is [`end`](Self::end) of each reader.
    pub fn begin(&self, row: &StreamRow) -> Vec<u8> {
        let mut text = Vec::with_capacity(512);
        let [time, index, host] = match self.format {
            StreamFormat::JsonLines => ["{\"t_s\":", ",\"index\":", ",\"host_s\":"],
            StreamFormat::Csv => ["", ",", ","],
        };
        text.extend_from_slice(time.as_bytes());
        write_time(row.time_us, &mut text);
        text.extend_from_slice(format!("{index}{}{host}", row.index).as_bytes());
        write_time(row.host_us, &mut text);
        self.numbers(&self.readings, row.readings.as_ref().map(|it| it.to_vec()), &mut text);
        self.numbers(&self.wrench, row.wrench.map(|it| self.axes.of(&it)), &mut text);
        self.numbers(&self.errors, row.standard_errors.map(|it| self.axes.of(&it)), &mut text);
        match self.format {
            StreamFormat::JsonLines => {
                text.extend_from_slice(format!(",\"flags\":\"{}\"", row.flags).as_bytes());
            }
            StreamFormat::Csv => text.extend_from_slice(format!(",{}", row.flags).as_bytes()),
        }
        text
    }

    /// The end of a row: its number, and how many rows its reader has lost.
    pub fn end(&self, row: u64, lost: u64) -> Vec<u8> {
        match self.format {
            StreamFormat::JsonLines => format!(",\"row\":{row},\"lost\":{lost}}}\n"),
            StreamFormat::Csv => format!(",{row},{lost}\n"),
        }
        .into_bytes()
    }

    fn numbers(&self, fields: &[FieldPrefix], values: Option<Vec<f64>>, text: &mut Vec<u8>) {
        let is_csv = self.format == StreamFormat::Csv;
        if values.is_none() && !is_csv {
            return;
        }
        let mut digits = zmij::Buffer::new();
        for (at, field) in fields.iter().enumerate() {
            text.extend_from_slice(field.before.as_bytes());
            let value = values.as_ref().map(|values| values[at]).filter(|value| value.is_finite());
            match value {
                Some(value) => {
                    let digits = digits.format(value);
                    let digits = digits.strip_suffix(".0").unwrap_or(digits);
                    // An integer of JSON has no negative zero.
                    text.extend_from_slice(if digits == "-0" {
                        b"-0.0"
                    } else {
                        digits.as_bytes()
                    });
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
        }
    }

    fn text(format: StreamFormat, axes: Axes) -> String {
        let encoder = RowEncoder::new(format, axes, &row());
        let line = [encoder.header().unwrap_or_default(), encoder.begin(&row()), encoder.end(9, 2)];
        String::from_utf8(line.concat()).unwrap()
    }

    #[test]
    fn a_row_of_json_has_what_is_known() {
        let expected = "{\"t_s\":12.345678,\"index\":7,\"host_s\":1700000000.000001,\"s1\":1,\"s2\":2.5,\
            \"s3\":3,\"s4\":4,\"s5\":5,\"s6\":6,\"s7\":7,\"s8\":8,\"fx_n\":0.1,\"fy_n\":-0.0,\"fz_n\":1e-7,\
            \"mx_nm\":null,\"my_nm\":2,\"mz_nm\":3,\"flags\":\"s3:range mark1\",\"row\":9,\"lost\":2}\n";
        assert_eq!(text(StreamFormat::JsonLines, Axes::ALL), expected);
    }

    #[test]
    fn columns_of_csv_are_those_of_the_first_row() {
        let axes: Axes = [Axis::Fx, Axis::Mx].into_iter().collect();
        let expected = "t_s,index,host_s,s1,s2,s3,s4,s5,s6,s7,s8,fx_n,mx_nm,flags,row,lost\n\
            12.345678,7,1700000000.000001,1,2.5,3,4,5,6,7,8,0.1,,s3:range mark1,9,2\n";
        assert_eq!(text(StreamFormat::Csv, axes), expected);
    }
}
