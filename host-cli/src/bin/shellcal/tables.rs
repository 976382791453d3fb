//! Tables as text, as Markdown or as CSV.

use calibration::quality::fixed;
use comfy_table::{CellAlignment, ContentArrangement, LineStyle, Table, TableStyle};
use shell_data::escape::csv_field;
use shell_data::wrench::Axis;

/// The style of scientific papers: a rule below the header and no other lines.
const PLAIN: TableStyle =
    TableStyle::new().header_separator(LineStyle::none().fill('─').junction('─'));

/// Format of tables.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum TableForm {
    /// Aligned, to read
    #[default]
    Text,
    /// Markdown, to paste
    Markdown,
    /// CSV alone: all other lines go to the standard error
    Csv,
}

/// Number of decimals for forces in N and moments in N·m.
pub(crate) fn decimals(axis: Axis) -> usize {
    if axis.is_moment() { 6 } else { 4 }
}

pub(crate) fn axis_row(axis: Axis, values: [f64; 3]) -> Vec<String> {
    number_row(format!("{} ({})", axis.name(), axis.unit()), values, decimals(axis))
}

/// A row with a label and values with this number of decimals.
pub(crate) fn number_row(label: String, values: [f64; 3], decimals: usize) -> Vec<String> {
    [label].into_iter().chain(values.map(|value| fixed(value, decimals))).collect()
}

pub(crate) fn lines(form: TableForm, header: &[&str], rows: &[Vec<String>]) -> Vec<String> {
    match form {
        TableForm::Text => text(header, rows),
        TableForm::Markdown => {
            let framed = |cells: Vec<String>| format!("| {} |", cells.join(" | "));
            let escaped = |cell: &str| cell.replace('\\', "\\\\").replace('|', "\\|");
            let alignment = (0..header.len()).map(|at| if at == 0 { ":--" } else { "--:" });
            let mut lines: Vec<String> = whole(header, rows, escaped).map(framed).collect();
            lines.insert(1, framed(alignment.map(str::to_owned).collect()));
            lines
        }
        TableForm::Csv => {
            let field = |cell: &str| csv_field(cell).into_owned();
            whole(header, rows, field).map(|cells| cells.join(",")).collect()
        }
    }
}

fn text(header: &[&str], rows: &[Vec<String>]) -> Vec<String> {
    let mut table = Table::new();
    table.load_style(PLAIN);
    table.set_content_arrangement(ContentArrangement::Disabled);
    table.set_header(header.iter().copied());
    table.add_rows(rows);
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table.lines().map(|line| line.trim_end().to_owned()).collect()
}

/// Header and rows, each cell formatted by `cell`. Short rows are filled with empty cells, as in the text form.
fn whole(
    header: &[&str],
    rows: &[Vec<String>],
    cell: impl Fn(&str) -> String,
) -> impl Iterator<Item = Vec<String>> {
    let row = |row: &Vec<String>| {
        let at = |at: usize| cell(row.get(at).map_or("", String::as_str));
        (0..header.len().max(row.len())).map(at).collect()
    };
    let header: Vec<String> = header.iter().map(|name| cell(name)).collect();
    std::iter::once(header).chain(rows.iter().map(row).collect::<Vec<_>>())
}

/// A number of items, as `1 file` or `2 files`.
pub(crate) fn counted(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

pub(crate) const NOTHING: &str = "–";

pub(crate) fn or_dash(value: Option<f64>, decimals: usize) -> String {
    shown(value, |value| format!("{value:.decimals$}"))
}

pub(crate) fn shown<T>(value: Option<T>, text: impl FnOnce(T) -> String) -> String {
    value.map_or_else(|| NOTHING.to_owned(), text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markdown_keeps_bars_and_csv_commas() {
        let rows = [vec!["a|b".to_owned(), "1,5".to_owned()], vec!["\"c\"".to_owned()]];
        let expected = ["| name | x |", "| :-- | --: |", "| a\\|b | 1,5 |", "| \"c\" |  |"];
        assert_eq!(lines(TableForm::Markdown, &["name", "x"], &rows), expected);
        // Checked with an independent reader of RFC 4180.
        let text = lines(TableForm::Csv, &["name", "x"], &rows).join("\n");
        let mut reader = csv::Reader::from_reader(text.as_bytes());
        let read: Vec<Vec<String>> = reader
            .records()
            .map(|record| record.unwrap().iter().map(str::to_owned).collect())
            .collect();
        assert_eq!(read, [["a|b", "1,5"], ["\"c\"", ""]]);
    }
}
