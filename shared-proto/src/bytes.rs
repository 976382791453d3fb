//! Byte strings of bounded length.

use core::fmt;
use core::ops::Deref;

/// Up to `N` bytes in place; `N` is at most 65,535.
#[derive(Clone, Copy)]
pub struct Bytes<const N: usize> {
    bytes: [u8; N],
    len: u16,
}

impl<const N: usize> Bytes<N> {
    /// No bytes.
    pub const fn new() -> Self {
        const { assert!(N <= 65_535, "the length is kept in two bytes") };
        Self { bytes: [0; N], len: 0 }
    }

    /// A copy of `slice`, `None` if it is longer than `N`.
    pub fn copy_of(slice: &[u8]) -> Option<Self> {
        let mut copy = Self::new();
        copy.try_extend(slice).then_some(copy)
    }

    /// Appends one byte if there is room.
    pub(crate) fn push(&mut self, byte: u8) {
        self.extend(&[byte]);
    }

    /// Appends a slice if there is room for all of it.
    pub(crate) fn extend(&mut self, slice: &[u8]) {
        self.try_extend(slice);
    }

    /// Appends a slice; false, and nothing done, if there is no room for all of it.
    pub(crate) fn try_extend(&mut self, slice: &[u8]) -> bool {
        let len = usize::from(self.len);
        let Some(room) = self.bytes.get_mut(len..len + slice.len()) else { return false };
        room.copy_from_slice(slice);
        self.len += slice.len() as u16;
        true
    }

    pub(crate) fn clear(&mut self) {
        self.len = 0;
    }

    /// Removes the first `count` bytes, or all of them.
    pub(crate) fn remove_front(&mut self, count: usize) {
        let len = usize::from(self.len);
        let count = count.min(len);
        if let Some(bytes) = self.bytes.get_mut(..len) {
            bytes.copy_within(count.., 0);
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

impl<const N: usize> PartialEq for Bytes<N> {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl<const N: usize> Eq for Bytes<N> {}

impl<const N: usize> fmt::Debug for Bytes<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:02x?}", &**self)
    }
}
