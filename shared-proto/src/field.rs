//! Fields of a packet in wire format (little-endian, no padding), and bounded byte strings.

use core::ops::Deref;

/// Up to `N` bytes, stored inline; `N` is at most 65,535.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bytes<const N: usize> {
    /// Zeros after `len`.
    bytes: [u8; N],
    len: u16,
}

impl<const N: usize> Bytes<N> {
    /// Creates an empty string.
    pub const fn new() -> Self {
        const { assert!(N <= 65_535, "the length is kept in two bytes") };
        Self { bytes: [0; N], len: 0 }
    }

    /// Copies `slice`; `None` if it is longer than `N`.
    pub fn copy_of(slice: &[u8]) -> Option<Self> {
        let mut copy = Self::new();
        copy.try_extend(slice).then_some(copy)
    }

    pub(crate) fn push(&mut self, byte: u8) {
        self.extend(&[byte]);
    }

    /// Appends a slice if there is room for all of it.
    pub(crate) fn extend(&mut self, slice: &[u8]) {
        self.try_extend(slice);
    }

    /// Appends a slice, or returns false if there is no room for all of it.
    pub(crate) fn try_extend(&mut self, slice: &[u8]) -> bool {
        let len = usize::from(self.len);
        let Some(room) = self.bytes.get_mut(len..len + slice.len()) else { return false };
        room.copy_from_slice(slice);
        self.len += slice.len() as u16;
        true
    }

    pub(crate) fn remove_front(&mut self, count: usize) {
        let len = usize::from(self.len);
        let count = count.min(len);
        if let Some(bytes) = self.bytes.get_mut(..len) {
            bytes.copy_within(count.., 0);
            bytes[len - count..].fill(0);
        }
        self.len = (len - count) as u16;
    }

    pub(crate) fn as_mut_slice(&mut self) -> &mut [u8] {
        self.bytes.get_mut(..usize::from(self.len)).unwrap_or_default()
    }
}

impl<const N: usize> Default for Bytes<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Deref for Bytes<N> {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        self.bytes.get(..usize::from(self.len)).unwrap_or_default()
    }
}

pub(crate) trait Field: Sized {
    fn write<const N: usize>(&self, out: &mut Bytes<N>);

    fn read(body: &mut Reader<'_>) -> Option<Self>;
}

pub(crate) struct Reader<'a>(pub(crate) &'a [u8]);

impl<'a> Reader<'a> {
    pub(crate) fn array<const K: usize>(&mut self) -> Option<[u8; K]> {
        let (field, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*field)
    }

    pub(crate) fn get<F: Field>(&mut self) -> Option<F> {
        F::read(self)
    }

    pub(crate) fn end<T>(self, value: T) -> Option<T> {
        self.0.is_empty().then_some(value)
    }
}

macro_rules! numbers {
    ($($number:ty),+) => {
        $(impl Field for $number {
            fn write<const N: usize>(&self, out: &mut Bytes<N>) {
                out.extend(&self.to_le_bytes());
            }

            fn read(body: &mut Reader<'_>) -> Option<Self> {
                body.array().map(Self::from_le_bytes)
            }
        })+
    };
}

numbers!(u8, u16, i16, u32, f32);

impl<F: Field + Copy + Default, const K: usize> Field for [F; K] {
    fn write<const N: usize>(&self, out: &mut Bytes<N>) {
        self.iter().for_each(|field| field.write(out));
    }

    // Not unrolled, to save flash for loops over a calibration's numbers.
    #[cfg_attr(target_os = "none", inline(never))]
    fn read(body: &mut Reader<'_>) -> Option<Self> {
        let mut fields = [F::default(); K];
        for field in &mut fields {
            *field = F::read(body)?;
        }
        Some(fields)
    }
}

/// The remaining bytes; reading fails if there are too many.
impl<const K: usize> Field for Bytes<K> {
    fn write<const N: usize>(&self, out: &mut Bytes<N>) {
        out.extend(self);
    }

    fn read(body: &mut Reader<'_>) -> Option<Self> {
        Self::copy_of(core::mem::take(&mut body.0))
    }
}

/// Implements [`Field`] for a struct: its fields in this order.
macro_rules! fields {
    ($name:ident { $($field:ident),+ }) => {
        impl $crate::field::Field for $name {
            fn write<const N: usize>(&self, out: &mut $crate::field::Bytes<N>) {
                $(self.$field.write(out);)+
            }

            fn read(body: &mut $crate::field::Reader<'_>) -> Option<Self> {
                Some(Self { $($field: $crate::field::Field::read(body)?),+ })
            }
        }
    };
}

/// Defines an enum that is a field: the variant's code, a byte, and its fields in order. An unknown
/// code becomes the last variant, so that newer packets can be read in part.
macro_rules! coded {
    ($(#[$of_enum:meta])* pub enum $name:ident {
        $($(#[$of_variant:meta])* $variant:ident $(($value:ident: $type:ty))?
            $({ $($field:ident: $field_type:ty),+ })? = $code:literal,)+
        _ = $other:ident,
    }) => {
        $(#[$of_enum])*
        pub enum $name {
            $($(#[$of_variant])* $variant $(($type))?
                $({ $($field: $field_type),+ })?,)+
            /// A code that this version does not define.
            $other(u8),
        }

        impl $name {
            /// Returns the code on the wire.
            pub const fn code(&self) -> u8 {
                match self {
                    $(Self::$variant { .. } => $code,)+
                    Self::$other(code) => *code,
                }
            }

            /// Returns the variant of a code; `None` if it has fields.
            pub fn from_code(code: u8) -> Option<Self> {
                $crate::field::Reader(&[code]).get()
            }
        }

        impl $crate::field::Field for $name {
            fn write<const N: usize>(&self, out: &mut $crate::field::Bytes<N>) {
                out.push(self.code());
                match self {
                    $(Self::$variant $(($value))? $({ $($field),+ })? => {
                        $($value.write(out);)?
                        $($($field.write(out);)+)?
                    })+
                    Self::$other(_) => {}
                }
            }

            fn read(body: &mut $crate::field::Reader<'_>) -> Option<Self> {
                Some(match body.get()? {
                    $($code => {
                        $(let $value = body.get()?;)?
                        Self::$variant $(($value))? $({ $($field: body.get()?),+ })?
                    })+
                    code => Self::$other(code),
                })
            }
        }
    };
}

pub(crate) use {coded, fields};
