//! The columns of a Parquet file, from the tree of its schema.

use super::KIND;
use crate::budget;
use crate::element::Element;
use crate::kind::TableError;
use crate::thrift::Value;

#[derive(Clone, Debug)]
pub(super) struct Leaf {
    /// Path in the schema tree, joined by dots.
    pub(super) name: String,
    pub(super) kind: LeafType,
    /// Definition level of a present value: the number of optional or repeated elements in the path.
    pub(super) levels: u8,
    pub(super) list: Option<ListLeaf>,
    /// A compression that is not supported.
    pub(super) packed: Option<&'static str>,
}

/// A list whose elements become columns of a table.
#[derive(Clone, Debug)]
pub(super) struct ListLeaf {
    name: String,
    /// Definition level at which the list has an element.
    pub(super) level: u8,
    /// Number of elements in each row.
    pub(super) length: usize,
}

impl Leaf {
    /// Returns the reason why the column cannot be read.
    pub(super) fn unread(&self) -> Option<String> {
        let packed = |how| format!("is compressed with {how}, not Snappy, Zstandard or gzip");
        let of_kind = |what| format!("holds values of type {what}");
        self.packed.map(packed).or_else(|| self.kind.opaque().map(of_kind))
    }

    pub(super) fn columns(&self) -> Vec<String> {
        match &self.list {
            None => vec![self.name.clone()],
            Some(list) => (1..=list.length).map(|at| format!("{}{at}", list.name)).collect(),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LeafType {
    Number(Element),
    Text,
    /// A day and the nanoseconds in it, in 96 bits.
    DayAndTime,
    Opaque(&'static str),
}

impl LeafType {
    /// Returns the number of bytes of a value, if it is constant.
    pub(super) fn size(self) -> Option<usize> {
        match self {
            Self::Number(element) => Some(element.size()),
            Self::DayAndTime => Some(12),
            Self::Text | Self::Opaque(_) => None,
        }
    }

    pub(super) fn is_time(self) -> bool {
        matches!(self, Self::DayAndTime | Self::Number(Element::Time { .. }))
    }

    pub(super) fn is_real(self) -> bool {
        matches!(self, Self::Number(Element::Half | Element::Single | Element::Double))
    }

    pub(super) fn opaque(self) -> Option<&'static str> {
        match self {
            Self::Opaque(what) => Some(what),
            _ => None,
        }
    }
}

const DEPTH: u8 = 32;

const OPTIONAL: i64 = 1;
const REPEATED: i64 = 2;

/// Properties of a tree element's ancestors.
#[derive(Clone)]
struct Above {
    path: String,
    levels: u8,
    /// Number of repeated elements in the path, and the innermost of them.
    repeated: u8,
    list: Option<ListLeaf>,
    depth: u8,
}

pub(super) fn leaves(footer: &Value) -> Result<Vec<Leaf>, TableError> {
    let elements = footer.list(2).unwrap_or_default();
    let mut elements = elements.iter();
    let root = elements.next().ok_or_else(|| KIND.damaged("its footer has no schema"))?;
    let mut leaves = Vec::new();
    let above = Above { path: String::new(), levels: 0, repeated: 0, list: None, depth: 0 };
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
    let path = if above.path.is_empty() { name } else { format!("{}.{name}", above.path) };
    let (is_repeated, is_optional) = (repetition == REPEATED, repetition == OPTIONAL);
    let level = above.levels + u8::from(is_optional || is_repeated);
    let is_own = above.path.is_empty();
    let list =
        ListLeaf { name: if is_own { path.clone() } else { above.path.clone() }, level, length: 0 };
    let here = Above {
        path,
        levels: level,
        repeated: above.repeated + u8::from(is_repeated),
        list: if is_repeated { Some(list) } else { above.list.clone() },
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
    let kind = kind(element, &here.path)?;
    let kind = if here.repeated > 1 { LeafType::Opaque("list of lists") } else { kind };
    leaves.push(Leaf { name: here.path, kind, levels: here.levels, list: here.list, packed: None });
    Ok(())
}

/// Determines the type of the column at `path` from its physical and logical types.
fn kind(element: &Value, path: &str) -> Result<LeafType, TableError> {
    let logical = element.field(10);
    let has = |number| logical.is_some_and(|logical| logical.field(number).is_some());
    let converted = element.whole(6);
    let kind = match element.whole(1) {
        Some(0) => LeafType::Number(Element::Truth),
        Some(1) => integer_kind(element, 4),
        Some(2) => integer_kind(element, 8),
        Some(3) => LeafType::DayAndTime,
        Some(4) => LeafType::Number(Element::Single),
        Some(5) => LeafType::Number(Element::Double),
        Some(6) => match converted {
            Some(0 | 4 | 19) => LeafType::Text,
            _ if has(1) || has(4) || has(12) => LeafType::Text,
            // Some writers do not mark their text as such.
            None if logical.is_none() => LeafType::Text,
            _ => LeafType::Opaque("binary"),
        },
        Some(7) => match element.whole(2) {
            Some(2) if has(15) => LeafType::Number(Element::Half),
            Some(1..0x10_0000) => LeafType::Opaque("binary"),
            _ => return Err(KIND.damaged(format!("column `{path}`"))),
        },
        _ => return Err(KIND.damaged(format!("column `{path}` has no type"))),
    };
    let is_decimal = converted == Some(5) || has(5);
    Ok(if is_decimal { LeafType::Opaque("decimal") } else { kind })
}

/// Determines the type of a column of integers with `size` bytes.
fn integer_kind(element: &Value, size: u8) -> LeafType {
    let time = |units, per_second| LeafType::Number(Element::Time { size, units, per_second });
    let logical = element.field(10);
    let of_logical = |number| logical.and_then(|logical| logical.field(number));
    let unit = of_logical(8).and_then(|it| it.field(2));
    let unit = unit.and_then(|unit| (1..=3).find(|&number| unit.field(number).is_some()));
    let is_signed = of_logical(10).and_then(|it| it.field(2));
    match (element.whole(6), unit) {
        _ if of_logical(6).is_some() => time(86_400, 1),
        _ if of_logical(7).is_some() => LeafType::Opaque("time of day"),
        (_, Some(unit)) => time(1, 1000_i64.pow(unit as u32)),
        _ if is_signed == Some(&Value::Truth(false)) => LeafType::Number(Element::Unsigned(size)),
        (Some(6), _) => time(86_400, 1),
        (Some(7 | 8), _) => LeafType::Opaque("time of day"),
        (Some(9), _) => time(1, 1_000),
        (Some(10), _) => time(1, 1_000_000),
        (Some(11..=14), _) => LeafType::Number(Element::Unsigned(size)),
        _ => LeafType::Number(Element::Signed(size)),
    }
}
