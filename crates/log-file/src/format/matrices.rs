//! Columns of matrices: `a1`, `a2`, … of a matrix `a` in a MATLAB or HDF5 file.

use super::mapping::{ColumnRef, LogFormat, Mapping};
use super::meaning::{Meaning, meaning_of};

/// The names of the columns of a matrix `name`, as far as there are any.
pub(crate) fn columns_of(names: &[String], name: &str) -> Vec<String> {
    let numbered = (1..).map(|number| format!("{name}{number}"));
    numbered.take_while(|column| names.contains(column)).collect()
}

/// `mapping` for a file of matrices, with what their shapes leave no doubt about where nothing is specified
/// and no name tells: of two matrices the one of six columns is the wrench, the other the readings.
pub(crate) fn by_shape(names: &[String], mapping: &Mapping) -> Mapping {
    let mut mapping = mapping.for_columns(names);
    // `a1` is the first column of `a`, not `a11` that of `a1`.
    let first = names.iter().filter_map(|name| name.strip_suffix('1'));
    let first = first.filter(|name| !names.iter().any(|other| other == name));
    let matrices: Vec<Vec<String>> =
        first.map(|name| columns_of(names, name)).filter(|columns| columns.len() > 1).collect();
    let has_meaning = |name: &String| {
        !matches!(meaning_of(name, LogFormat::Csv), Meaning::Other | Meaning::Time(_))
    };
    let is_specified = mapping.sensors.is_some() || mapping.wrench.is_some();
    if is_specified || names.iter().any(has_meaning) {
        return mapping;
    }
    let references = |columns: &[String]| -> Vec<ColumnRef> {
        columns.iter().cloned().map(ColumnRef::Name).collect()
    };
    if let [one, other] = matrices.as_slice()
        && let (wrench, readings) = if one.len() == 6 { (one, other) } else { (other, one) }
        && readings.len() != 6
        && let Ok(wrench) = <[ColumnRef; 6]>::try_from(references(wrench))
    {
        mapping.wrench = Some(wrench.map(Some));
        mapping.sensors = Some(references(readings));
    }
    mapping
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(matrices: &[(&str, usize)]) -> Option<(usize, String)> {
        let columns = matrices.iter().flat_map(|&(name, count)| match count {
            1 => vec![name.to_owned()],
            count => (1..=count).map(|column| format!("{name}{column}")).collect(),
        });
        let mapping = by_shape(&columns.collect::<Vec<_>>(), &Mapping::default());
        let wrench = mapping.wrench?[5].clone()?;
        Some((mapping.sensors?.len(), wrench.to_string()))
    }

    #[test]
    fn the_matrix_of_six_columns_is_the_wrench_where_there_is_one_other() {
        let expected = |channels| Some((channels, "ft6".to_owned()));
        assert_eq!(found(&[("cells", 12), ("ft", 6)]), expected(12));
        assert_eq!(found(&[("clock", 1), ("ft", 6), ("cells", 8)]), expected(8));
        assert_eq!(found(&[("cells", 6), ("ft", 6)]), None);
        assert_eq!(found(&[("cells", 12), ("ft", 6), ("joints", 7)]), None);
        assert_eq!(found(&[("ft", 6)]), None);
        // Names that are known go before shapes.
        assert_eq!(found(&[("s", 12), ("joints", 6)]), None);
    }
}
