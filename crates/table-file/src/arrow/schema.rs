//! The fields of a schema, and what their values are.

use super::KIND;
use crate::budget;
use crate::element::Element;
use crate::error::TableError;
use crate::flatbuffer::Object;

/// How deep types may be nested.
const DEPTH: usize = 32;

/// A field of the schema.
#[derive(Clone, Debug)]
pub(super) struct Field {
    pub(super) name: String,
    pub(super) kind: Kind,
    pub(super) children: Vec<Field>,
    /// Where its values are indices, of which type, into which dictionary.
    pub(super) dictionary: Option<(i64, Element)>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Null,
    Number(Element),
    Truth,
    /// Text by offsets of this type.
    Text(Element),
    TextView,
    /// So many of its unit make a second; of this type.
    Time(i64, Element),
    /// Days of 32 bits.
    Days,
    Struct,
    /// What is not read, with so many buffers of its own.
    Opaque(&'static str, usize),
}

/// The fields of a schema.
pub(super) fn fields(schema: &Object<'_>) -> Result<Vec<Field>, TableError> {
    if schema.short(0).unwrap_or(0) != 0 {
        return Err(KIND.unsupported("numbers with the highest byte first"));
    }
    let mut left = budget::COLUMNS;
    let fields = schema.objects(1).and_then(|fields| {
        fields.into_iter().map(|it| field(it, DEPTH, &mut left)).collect::<Option<Vec<_>>>()
    });
    fields.ok_or_else(|| KIND.damaged("its schema"))
}

/// `left` is how many more fields there may be.
fn field(object: Object<'_>, depth: usize, left: &mut usize) -> Option<Field> {
    let depth = depth.checked_sub(1)?;
    *left = left.checked_sub(1)?;
    let name = object.text(0).unwrap_or_default().to_owned();
    let kind = kind(&object)?;
    let children = object.objects(5)?;
    let children = children.into_iter().map(|it| field(it, depth, left)).collect::<Option<_>>()?;
    let dictionary = match object.object(4) {
        None => None,
        Some(encoding) => {
            // Indices are of 32 bits where nothing is said.
            let index =
                encoding.object(1).map_or(Some(Element::Signed(4)), |index| integer(&index));
            Some((encoding.long(0).unwrap_or(0), index?))
        }
    };
    Some(Field { name, kind, children, dictionary })
}

fn integer(object: &Object<'_>) -> Option<Element> {
    let size = match object.int(0)? {
        8 => 1,
        16 => 2,
        32 => 4,
        64 => 8,
        _ => return None,
    };
    let is_signed = object.byte(1).unwrap_or(0) != 0;
    Some(if is_signed { Element::Signed(size) } else { Element::Unsigned(size) })
}

fn kind(field: &Object<'_>) -> Option<Kind> {
    let details = field.object(3);
    let short = |index| details.and_then(|details| details.short(index)).unwrap_or(0);
    let (int32, int64) = (Element::Signed(4), Element::Signed(8));
    Some(match field.byte(2)? {
        1 => Kind::Null,
        2 => Kind::Number(integer(&details?)?),
        3 => Kind::Number(match short(0) {
            0 => Element::Half,
            1 => Element::Single,
            _ => Element::Double,
        }),
        4 => Kind::Opaque("binary", 3),
        5 => Kind::Text(int32),
        6 => Kind::Truth,
        7 => Kind::Opaque("decimal", 2),
        8 => match details.and_then(|details| details.short(0)) {
            Some(0) => Kind::Days,
            _ => Kind::Time(1_000, int64),
        },
        9 => Kind::Opaque("time of day", 2),
        10 => {
            Kind::Time(1000_i64.pow(u32::try_from(short(0)).ok().filter(|unit| *unit < 4)?), int64)
        }
        11 => Kind::Opaque("interval", 2),
        12 | 17 => Kind::Opaque("list", 2),
        13 => Kind::Struct,
        14 => Kind::Opaque("union", if short(0) == 0 { 1 } else { 2 }),
        15 => Kind::Opaque("binary", 2),
        16 => Kind::Opaque("list", 1),
        18 => Kind::Opaque("duration", 2),
        19 => Kind::Opaque("binary", 3),
        20 => Kind::Text(int64),
        21 => Kind::Opaque("list", 2),
        22 => Kind::Opaque("run-end encoded", 0),
        23 | 24 => Kind::TextView,
        _ => return None,
    })
}

/// The names of the columns that a field makes.
pub(super) fn leaves(field: &Field, before: &str, names: &mut Vec<String>) {
    let name = format!("{before}{}", field.name);
    match field.kind {
        Kind::Struct => {
            field.children.iter().for_each(|child| leaves(child, &format!("{name}."), names))
        }
        _ => names.push(name),
    }
}
