//! The part of FlatBuffers that Arrow's messages need: tables, whose fields may be absent, with
//! vectors, texts and structs in them. Every offset is checked.

/// A table in a buffer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Object<'a> {
    buffer: &'a [u8],
    at: usize,
}

fn bytes<const N: usize>(buffer: &[u8], at: usize) -> Option<[u8; N]> {
    buffer.get(at..)?.first_chunk().copied()
}

fn u32_at(buffer: &[u8], at: usize) -> Option<usize> {
    usize::try_from(u32::from_le_bytes(bytes(buffer, at)?)).ok()
}

impl<'a> Object<'a> {
    /// The table that a buffer holds.
    pub(crate) fn root(buffer: &'a [u8]) -> Option<Self> {
        Some(Self { buffer, at: u32_at(buffer, 0)? })
    }

    /// Where a field is; `None` where it is absent.
    fn field(&self, index: usize) -> Option<usize> {
        let back = i32::from_le_bytes(bytes(self.buffer, self.at)?);
        let table = isize::try_from(self.at).ok()?.checked_sub(isize::try_from(back).ok()?)?;
        let table = usize::try_from(table).ok()?;
        let length = usize::from(u16::from_le_bytes(bytes(self.buffer, table)?));
        let entry = 4 + 2 * index;
        if entry + 2 > length {
            return None;
        }
        let offset = usize::from(u16::from_le_bytes(bytes(self.buffer, table + entry)?));
        (offset != 0).then_some(self.at + offset)
    }

    /// What an offset in a field points to.
    fn target(&self, index: usize) -> Option<usize> {
        let at = self.field(index)?;
        at.checked_add(u32_at(self.buffer, at)?)
    }

    pub(crate) fn object(&self, index: usize) -> Option<Self> {
        Some(Self { buffer: self.buffer, at: self.target(index)? })
    }

    pub(crate) fn byte(&self, index: usize) -> Option<u8> {
        Some(u8::from_le_bytes(bytes(self.buffer, self.field(index)?)?))
    }

    pub(crate) fn short(&self, index: usize) -> Option<i16> {
        Some(i16::from_le_bytes(bytes(self.buffer, self.field(index)?)?))
    }

    pub(crate) fn int(&self, index: usize) -> Option<i32> {
        Some(i32::from_le_bytes(bytes(self.buffer, self.field(index)?)?))
    }

    pub(crate) fn long(&self, index: usize) -> Option<i64> {
        Some(i64::from_le_bytes(bytes(self.buffer, self.field(index)?)?))
    }

    pub(crate) fn text(&self, index: usize) -> Option<&'a str> {
        let at = self.target(index)?;
        let length = u32_at(self.buffer, at)?;
        str::from_utf8(self.buffer.get(at + 4..)?.get(..length)?).ok()
    }

    /// The tables in a vector; an absent one is empty.
    pub(crate) fn objects(&self, index: usize) -> Option<Vec<Self>> {
        let Some(at) = self.target(index) else { return Some(Vec::new()) };
        let count = u32_at(self.buffer, at)?;
        // Checked before memory is taken: every entry takes four bytes.
        self.buffer.get(at + 4..)?.get(..count.checked_mul(4)?)?;
        let object = |i: usize| {
            let place = at + 4 + 4 * i;
            Some(Self { buffer: self.buffer, at: place.checked_add(u32_at(self.buffer, place)?)? })
        };
        (0..count).map(object).collect()
    }

    /// The structs in a vector, of `N` long numbers each; an absent one is empty.
    pub(crate) fn structs<const N: usize>(&self, index: usize) -> Option<Vec<[i64; N]>> {
        let Some(at) = self.target(index) else { return Some(Vec::new()) };
        let count = u32_at(self.buffer, at)?;
        let (words, _) =
            self.buffer.get(at + 4..)?.get(..count.checked_mul(8 * N)?)?.as_chunks::<8>();
        let numbers: Vec<i64> = words.iter().map(|word| i64::from_le_bytes(*word)).collect();
        let (structs, _) = numbers.as_chunks::<N>();
        Some(structs.to_vec())
    }
}
