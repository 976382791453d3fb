//! FlatBuffers, written from the front: a table first, what it points to after it.

/// A buffer that is being written.
#[derive(Debug)]
pub(super) struct Builder {
    bytes: Vec<u8>,
}

/// Where an offset is still to be written.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pointer(usize);

/// A field of a table, by its number.
#[derive(Clone, Copy, Debug)]
pub(super) enum Field {
    Byte(u16, u8),
    Short(u16, i16),
    Long(u16, i64),
    /// What comes later.
    Pointer(u16),
}

impl Field {
    fn number(self) -> u16 {
        match self {
            Self::Byte(number, _)
            | Self::Short(number, _)
            | Self::Long(number, _)
            | Self::Pointer(number) => number,
        }
    }

    /// Pointers are zero until they are set.
    fn bytes(self) -> Vec<u8> {
        match self {
            Self::Byte(_, value) => vec![value],
            Self::Short(_, value) => value.to_le_bytes().to_vec(),
            Self::Long(_, value) => value.to_le_bytes().to_vec(),
            Self::Pointer(_) => vec![0; 4],
        }
    }
}

impl Builder {
    /// An empty buffer, and the pointer to its table.
    pub(super) fn new() -> (Self, Pointer) {
        (Self { bytes: vec![0; 4] }, Pointer(0))
    }

    /// The buffer, its length a multiple of eight.
    pub(super) fn finish(mut self) -> Vec<u8> {
        self.bytes.resize(self.bytes.len().next_multiple_of(8), 0);
        self.bytes
    }

    /// Fills up so that what comes `after` so many bytes stands at a multiple of eight.
    fn align(&mut self, after: usize) {
        let end = (self.bytes.len() + after).next_multiple_of(8);
        self.bytes.resize(end - after, 0);
    }

    /// Sets a pointer to what comes next.
    fn point(&mut self, pointer: Pointer) {
        let offset = (self.bytes.len() - pointer.0) as u32;
        self.bytes[pointer.0..pointer.0 + 4].copy_from_slice(&offset.to_le_bytes());
    }

    /// A table; gives its pointers in the order of `fields`.
    pub(super) fn table(&mut self, pointer: Pointer, fields: &[Field]) -> Vec<Pointer> {
        let count = fields.iter().map(|field| field.number() + 1).max().unwrap_or(0);
        let vtable_bytes = 4 + 2 * usize::from(count);
        // The longest fields come first, at multiples of eight after the offset of the vtable.
        let mut order: Vec<usize> = (0..fields.len()).collect();
        order.sort_unstable_by_key(|&at| (std::cmp::Reverse(fields[at].bytes().len()), at));
        let mut offsets = vec![0_u16; usize::from(count)];
        let mut content = Vec::new();
        let mut pointers = Vec::new();
        for at in order {
            let offset = 4 + content.len();
            offsets[usize::from(fields[at].number())] = offset as u16;
            if matches!(fields[at], Field::Pointer(_)) {
                pointers.push((at, offset));
            }
            content.extend(fields[at].bytes());
        }
        self.align(vtable_bytes + 4);
        let vtable = self.bytes.len();
        self.bytes.extend((vtable_bytes as u16).to_le_bytes());
        self.bytes.extend((4 + content.len() as u16).to_le_bytes());
        offsets.iter().for_each(|offset| self.bytes.extend(offset.to_le_bytes()));
        self.point(pointer);
        let table = self.bytes.len();
        self.bytes.extend(((table - vtable) as i32).to_le_bytes());
        self.bytes.extend(content);
        pointers.sort_unstable();
        pointers.into_iter().map(|(_, offset)| Pointer(table + offset)).collect()
    }

    pub(super) fn text(&mut self, pointer: Pointer, text: &str) {
        self.align(4);
        self.point(pointer);
        self.bytes.extend((text.len() as u32).to_le_bytes());
        self.bytes.extend(text.as_bytes());
        self.bytes.push(0);
    }

    /// A vector of pointers.
    pub(super) fn pointers(&mut self, pointer: Pointer, count: usize) -> Vec<Pointer> {
        self.align(4);
        self.point(pointer);
        self.bytes.extend((count as u32).to_le_bytes());
        let start = self.bytes.len();
        self.bytes.resize(start + 4 * count, 0);
        (0..count).map(|at| Pointer(start + 4 * at)).collect()
    }

    /// A vector of structs of long numbers.
    pub(super) fn structs<const N: usize>(&mut self, pointer: Pointer, structs: &[[i64; N]]) {
        self.align(4);
        self.point(pointer);
        self.bytes.extend((structs.len() as u32).to_le_bytes());
        structs.iter().flatten().for_each(|number| self.bytes.extend(number.to_le_bytes()));
    }
}
