//! Values per axis in JSON documents, which hold the calibrated [`Axes`] only.
//!
//! Use `#[serde(with = "by_axis")]` for a field, `by_axis::matrix` for a matrix, `by_axis::option` for an option. Serde
//! cannot pass a document's axes to its fields, so [`among`] sets them for the current thread.

use std::cell::Cell;

use serde::de::{Deserialize, Deserializer, Error};
use serde::ser::{Serialize, Serializer};

use crate::wrench::{Axes, Axis, PerAxis};

thread_local! {
    static AXES: Cell<Axes> = const { Cell::new(Axes::ALL) };
}

/// Runs `act`, which reads or writes a document with these axes on this thread. Outside of `act`, documents have all
/// six axes.
pub fn among<T>(axes: Axes, act: impl FnOnce() -> T) -> T {
    let _outside = Outside(AXES.replace(axes));
    act()
}

/// The previous axes, restored even after a panic.
struct Outside(Axes);

impl Drop for Outside {
    fn drop(&mut self) {
        AXES.set(self.0);
    }
}

pub fn axes() -> Axes {
    AXES.get()
}

/// Serializes the axes as the names of their columns.
impl Serialize for Axes {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.columns().serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Axes {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let columns: Vec<String> = Vec::deserialize(deserializer)?;
        let axes: Self = Axis::ALL
            .into_iter()
            .filter(|axis| columns.iter().any(|it| it == axis.column()))
            .collect();
        if axes.is_empty() || axes.columns() != columns {
            let (found, all) = (columns.join("`, `"), Self::ALL.columns().join("`, `"));
            let text = format!("`axes` has `{found}`, expected some of `{all}`, in this order");
            return Err(D::Error::custom(text));
        }
        Ok(axes)
    }
}

/// A value that is serialized for the given axes only.
#[derive(Clone, Copy, Debug)]
pub struct Among<T>(pub Axes, pub T);

impl<T: Serialize> Serialize for Among<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        among(self.0, || self.1.serialize(serializer))
    }
}

/// One value per axis; axes that the document lacks have the default value.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Row<T>(pub PerAxis<T>);

impl<T: Serialize> Serialize for Row<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(axes().iter().map(|axis| &self.0[axis.index()]))
    }
}

impl<'de, T: Deserialize<'de> + Clone + Default> Deserialize<'de> for Row<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let values: Vec<T> = Vec::deserialize(deserializer)?;
        let (found, axes) = (values.len(), axes());
        let row = axes.spread(values, &T::default()).map(Self);
        row.ok_or_else(|| Error::custom(format!("`{found}` values for `{}` axes", axes.count())))
    }
}

pub fn serialize<T: Serialize, S: Serializer>(
    values: &PerAxis<T>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    Row(values.each_ref()).serialize(serializer)
}

/// # Errors
/// Errors of the deserializer, and a number of values that differs from the number of axes.
pub fn deserialize<'de, T: Deserialize<'de> + Clone + Default, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<PerAxis<T>, D::Error> {
    Row::deserialize(deserializer).map(|row| row.0)
}

/// A matrix with a row and a column per axis.
pub mod matrix {
    use super::{Deserialize, Deserializer, PerAxis, Row, Serialize, Serializer};

    pub fn serialize<S: Serializer>(
        rows: &PerAxis<PerAxis<f64>>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        Row(rows.map(Row)).serialize(serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<PerAxis<PerAxis<f64>>, D::Error> {
        Row::<Row<f64>>::deserialize(deserializer).map(|rows| rows.0.map(|row| row.0))
    }
}

pub mod option {
    use super::{Deserialize, Deserializer, PerAxis, Row, Serialize, Serializer};

    pub fn serialize<T: Serialize, S: Serializer>(
        values: &Option<PerAxis<T>>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        values.as_ref().map(|values| Row(values.each_ref())).serialize(serializer)
    }

    pub fn deserialize<'de, T: Deserialize<'de> + Clone + Default, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Option<PerAxis<T>>, D::Error> {
        Ok(Option::<Row<T>>::deserialize(deserializer)?.map(|row| row.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_values_of_present_axes_are_written_and_read() {
        let axes: Axes = [Axis::Fz, Axis::Mx].into_iter().collect();
        let row = Row([1, 2, 3, 4, 5, 6]);
        let text = serde_json::to_string(&Among(axes, row)).unwrap();
        assert_eq!(text, "[3,4]");
        let read = |text: &str| among(axes, || serde_json::from_str::<Row<u8>>(text));
        assert_eq!(read(&text).unwrap(), Row([0, 0, 3, 4, 0, 0]));
        assert!(read("[3]").unwrap_err().to_string().starts_with("`1` values for `2` axes"));
        assert_eq!(serde_json::to_string(&axes).unwrap(), "[\"fz_n\",\"mx_nm\"]");
        // Outside of `among` a document has all six axes, even after a panic.
        std::panic::catch_unwind(|| among(axes, || panic!("within"))).unwrap_err();
        assert_eq!(serde_json::to_string(&row).unwrap(), "[1,2,3,4,5,6]");
    }
}
