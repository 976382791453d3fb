//! The columns of a Parquet file, from the tree of its schema.

use super::KIND;
use crate::budget;
use crate::error::TableError;
use crate::thrift::Value;

/// A column.
#[derive(Clone, Debug)]
pub(super) struct Leaf {
    /// Its path in the tree, joined by dots.
    pub(super) name: String,
    pub(super) kind: PhysicalType,
    /// How a value is stored.
    pub(super) physical: Physical,
    /// Its definition level where there is a value: how many of its path may be absent.
    pub(super) levels: u8,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Physical {
    Boolean,
    Int32,
    Int64,
    Int96,
    Float,
    Double,
    Bytes,
    Fixed(usize),
}

/// What the values of a column mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PhysicalType {
    /// A number as it is stored.
    Number,
    Unsigned,
    Half,
    Text,
    /// So many of its unit make a second.
    Time(i64),
    Days,
    /// What is not read.
    Opaque(&'static str),
}

impl PhysicalType {
    pub(super) fn opaque(self) -> Option<&'static str> {
        match self {
            Self::Opaque(what) => Some(what),
            _ => None,
        }
    }

    pub(super) fn is_read(self) -> bool {
        self.opaque().is_none()
    }
}

/// How deep the tree may be.
const DEPTH: u8 = 32;

const OPTIONAL: i64 = 1;
const REPEATED: i64 = 2;

/// What is above an element of the tree.
#[derive(Clone)]
struct Above {
    path: String,
    levels: u8,
    is_repeated: bool,
    depth: u8,
}

/// The columns that a footer describes.
pub(super) fn leaves(footer: &Value) -> Result<Vec<Leaf>, TableError> {
    let elements = footer.list(2).unwrap_or_default();
    let mut elements = elements.iter();
    let root = elements.next().ok_or_else(|| KIND.damaged("its footer has no schema"))?;
    let mut leaves = Vec::new();
    let above = Above { path: String::new(), levels: 0, is_repeated: false, depth: 0 };
    for _ in 0..root.whole(5).unwrap_or(0) {
        add(&mut elements, &above, &mut leaves)?;
    }
    Ok(leaves)
}

fn add<'a>(
    elements: &mut impl Iterator<Item = &'a Value>,
    above: &Above,
    leaves: &mut Vec<Leaf>,
) -> Result<(), TableError> {
    let element = elements.next().ok_or_else(|| KIND.damaged("its schema is cut off"))?;
    let name = element.text(4).unwrap_or_default();
    let repetition = element.whole(3).unwrap_or(0);
    let here = Above {
        path: if above.path.is_empty() { name } else { format!("{}.{name}", above.path) },
        levels: above.levels + u8::from(repetition == OPTIONAL),
        is_repeated: above.is_repeated || repetition == REPEATED,
        depth: above.depth + 1,
    };
    if here.depth > DEPTH {
        return Err(KIND.unsupported("structs within structs without end"));
    }
    let children = element.whole(5).unwrap_or(0);
    if children > 0 {
        return (0..children).try_for_each(|_| add(elements, &here, leaves));
    }
    budget::check_columns(KIND, leaves.len() + 1)?;
    let physical = match element.whole(1) {
        Some(0) => Physical::Boolean,
        Some(1) => Physical::Int32,
        Some(2) => Physical::Int64,
        Some(3) => Physical::Int96,
        Some(4) => Physical::Float,
        Some(5) => Physical::Double,
        Some(6) => Physical::Bytes,
        Some(7) => {
            let length = element.whole(2).and_then(|length| usize::try_from(length).ok());
            let length = length.filter(|length| (1..1 << 20).contains(length));
            Physical::Fixed(length.ok_or_else(|| KIND.damaged(format!("column `{}`", here.path)))?)
        }
        _ => return Err(KIND.damaged(format!("column `{}` has no type", here.path))),
    };
    let kind =
        if here.is_repeated { PhysicalType::Opaque("list") } else { kind(element, physical) };
    leaves.push(Leaf { name: here.path, kind, physical, levels: here.levels });
    Ok(())
}

fn kind(element: &Value, physical: Physical) -> PhysicalType {
    let logical = element.field(10);
    let has = |number| logical.is_some_and(|logical| logical.field(number).is_some());
    let converted = element.whole(6);
    if converted == Some(5) || has(5) {
        return PhysicalType::Opaque("decimal");
    }
    match physical {
        Physical::Boolean | Physical::Float | Physical::Double => PhysicalType::Number,
        Physical::Int96 => PhysicalType::Time(1_000_000_000),
        Physical::Bytes => match converted {
            Some(0 | 4 | 19) => PhysicalType::Text,
            _ if has(1) || has(4) || has(12) => PhysicalType::Text,
            // Some writers do not say that their bytes are text.
            None if logical.is_none() => PhysicalType::Text,
            _ => PhysicalType::Opaque("binary"),
        },
        Physical::Fixed(2) if has(15) => PhysicalType::Half,
        Physical::Fixed(_) => PhysicalType::Opaque("binary"),
        Physical::Int32 | Physical::Int64 => {
            let unit = logical.and_then(|it| it.field(8)).and_then(|it| it.field(2));
            let unit = unit.and_then(|unit| (1..=3).find(|&number| unit.field(number).is_some()));
            let unsigned = logical.and_then(|it| it.field(10)).and_then(|it| it.field(2));
            match converted {
                _ if has(6) => PhysicalType::Days,
                _ if has(7) => PhysicalType::Opaque("time of day"),
                _ if unit.is_some() => PhysicalType::Time(1000_i64.pow(unit.unwrap_or(1) as u32)),
                _ if unsigned == Some(&Value::Truth(false)) => PhysicalType::Unsigned,
                Some(6) => PhysicalType::Days,
                Some(7 | 8) => PhysicalType::Opaque("time of day"),
                Some(9) => PhysicalType::Time(1_000),
                Some(10) => PhysicalType::Time(1_000_000),
                Some(11..=14) => PhysicalType::Unsigned,
                _ => PhysicalType::Number,
            }
        }
    }
}
