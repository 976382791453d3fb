//! Reading numbers and bytes from a slice, which may end anywhere, and writing them.

#[derive(Clone, Copy, Debug)]
pub(crate) struct ByteReader<'a> {
    pub(crate) rest: &'a [u8],
}

macro_rules! little_endian {
    ($($name:ident: $type:ty),*) => {$(
        pub(crate) fn $name(&mut self) -> Option<$type> {
            let (bytes, rest) = self.rest.split_first_chunk()?;
            self.rest = rest;
            Some(<$type>::from_le_bytes(*bytes))
        }
    )*};
}

impl<'a> ByteReader<'a> {
    pub(crate) fn new(rest: &'a [u8]) -> Self {
        Self { rest }
    }

    pub(crate) fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (bytes, rest) = self.rest.split_at_checked(count)?;
        self.rest = rest;
        Some(bytes)
    }

    /// Takes a text that is preceded by its 32-bit length.
    pub(crate) fn text(&mut self) -> Option<&'a str> {
        let length = self.u32()?;
        str::from_utf8(self.take(usize::try_from(length).ok()?)?).ok()
    }

    /// Takes an integer in groups of seven bits, lowest first.
    pub(crate) fn varint(&mut self) -> Option<u64> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.u8()?;
            value |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                return Some(value);
            }
        }
        None
    }

    /// Takes a signed integer in zigzag encoding, in which small magnitudes are short.
    pub(crate) fn zigzag(&mut self) -> Option<i64> {
        let value = self.varint()?;
        Some((value >> 1) as i64 ^ -((value & 1) as i64))
    }

    little_endian!(u8: u8, u16: u16, u32: u32, u64: u64, i32: i32, i64: i64);
}

/// Bytes written one after the other; numbers are little-endian.
#[derive(Clone, Debug, Default)]
pub(crate) struct ByteWriter(pub(crate) Vec<u8>);

impl ByteWriter {
    pub(crate) fn bytes(mut self, bytes: &[u8]) -> Self {
        self.0.extend_from_slice(bytes);
        self
    }

    /// Writes bytes preceded by their 32-bit length.
    pub(crate) fn block(self, bytes: &[u8]) -> Self {
        self.u32(bytes.len() as u32).bytes(bytes)
    }

    pub(crate) fn text(self, text: &str) -> Self {
        self.block(text.as_bytes())
    }

    pub(crate) fn u16(self, number: u16) -> Self {
        self.bytes(&number.to_le_bytes())
    }

    pub(crate) fn u32(self, number: u32) -> Self {
        self.bytes(&number.to_le_bytes())
    }

    pub(crate) fn u64(self, number: u64) -> Self {
        self.bytes(&number.to_le_bytes())
    }
}

/// Appends an integer in groups of seven bits, lowest first.
pub(crate) fn push_varint(bytes: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}
