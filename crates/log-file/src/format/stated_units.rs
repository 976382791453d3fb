//! Units that columns do not state themselves: from keys and counts in the head, and from columns of units.

use super::clock::ClockFields;
use super::column_name::plain;
use super::columns::Column;
use super::keys::Keys;
use super::meaning::{Meaning, StatedUnit};
use crate::parse::number::parse_field;
use shell_data::unit::{Scale, Unit};

/// Applies units and counts from keys to the loads and times whose columns state no unit.
pub(super) fn apply_keys(keys: &Keys, columns: &mut [Column]) {
    for column in columns {
        let is_measured = matches!(column.meaning, Meaning::Load(..) | Meaning::Time(_));
        if column.unit != StatedUnit::None || !is_measured {
            continue;
        }
        let unit = keys.unit(&column.name, column.meaning);
        if unit != StatedUnit::None {
            column.set_unit(unit);
        }
        let Meaning::Load(axis, _) = column.meaning else { continue };
        let at = usize::from(axis.is_moment());
        if let Some((counts, _)) = keys.counts[at]
            && !matches!(column.unit, StatedUnit::Unknown(_))
        {
            let symbol = column.unit.known().map_or_else(|| axis.unit(), |unit| &unit.symbol);
            let symbol = format!("{symbol}/{counts}");
            let scale = column.meaning.scale();
            let scale = Scale { per: scale.per * counts, ..scale };
            column.set_unit(StatedUnit::Known(Unit { symbol, scale }));
        }
    }
}

/// Returns true for loads in counts, as from a Net F/T box: whole numbers without a unit, beside an `rdt_sequence`.
pub(super) fn are_counts(rows: &[u8], separator: u8, columns: &[Column]) -> bool {
    let is_whole = |field: &[u8]| parse_field(field).is_ok_and(|number| number.fract() == 0.0);
    let mut loads =
        columns.iter().enumerate().filter(|(_, of)| matches!(of.meaning, Meaning::Load(..)));
    let is_count = |(at, column): (usize, &Column)| {
        let fields = ClockFields::new(rows, separator, at);
        column.unit == StatedUnit::None && fields.first().is_some() && fields.iter().all(is_whole)
    };
    columns.iter().any(|column| plain(&column.name).ends_with("rdtsequence")) && loads.all(is_count)
}

/// Finds columns that hold the same unit in every row; returns their names and units.
pub(super) fn unit_columns(
    rows: &[u8],
    separator: u8,
    columns: &[Column],
) -> Vec<(String, String)> {
    const NAMES: [&str; 8] = [
        "unit",
        "units",
        "forceunit",
        "forceunits",
        "torqueunit",
        "torqueunits",
        "momentunit",
        "einheit",
    ];
    let of_column = |(at, column): (usize, &Column)| {
        let is_called =
            column.meaning == Meaning::Other && NAMES.contains(&plain(&column.name).as_str());
        let fields = is_called.then(|| ClockFields::new(rows, separator, at))?;
        let unit = String::from_utf8_lossy(fields.first()?).trim().to_owned();
        let is_constant = fields.iter().all(|field| field.trim_ascii() == unit.as_bytes());
        let name = if plain(&column.name) == "einheit" { "unit" } else { &column.name };
        is_constant.then(|| (name.to_owned(), unit))
    };
    columns.iter().enumerate().filter_map(of_column).collect()
}
