//! A calibration on its way to the board, and as it is kept.

use shared_proto::{Calibration, Key, Refusal, crc32};

/// Where the bytes of the calibration are in a record, behind their number and their CRC-32.
const CALIBRATION: usize = 8;

/// Where the key is, behind the longest calibration.
const KEY: usize = CALIBRATION + Calibration::MAX_SIZE;

/// Length of a [`Record`], a multiple of the eight bytes that flash is written in.
pub const RECORD: usize = (KEY + Key::LEN + 4).next_multiple_of(8);

/// What is kept in [`crate::Storage`], little-endian: number of bytes of a calibration, their CRC-32, the bytes and
/// room for the longest; the key that commands are signed with and its CRC-32; bytes to fill up.
pub type Record = [u8; RECORD];

/// The key in a record, `None` if there is none.
pub(crate) fn key(record: &Record) -> Option<Key> {
    let (key, rest) = record.get(KEY..)?.split_first_chunk()?;
    let crc = u32::from_le_bytes(*rest.first_chunk()?);
    (crc32(key) == crc).then_some(*key).and_then(Key::new)
}

/// Puts a key into a record, or takes it out.
pub(crate) fn keep_key(record: &mut Record, key: Option<Key>) {
    let Some(place) = record.get_mut(KEY..KEY + Key::LEN + 4) else { return };
    place.fill(0xFF);
    if let (Some(key), Some((bytes, crc))) = (key, place.split_first_chunk_mut()) {
        *bytes = *key.bytes();
        crc.copy_from_slice(&crc32(bytes).to_le_bytes());
    }
}

/// The calibration in a record and its CRC-32, `None` if the record was never written or is
/// damaged.
pub(crate) fn open(record: &Record) -> Option<(Calibration, u32)> {
    let (size, rest) = record.split_first_chunk()?;
    let (crc, rest) = rest.split_first_chunk()?;
    let bytes = rest.get(..Calibration::MAX_SIZE)?;
    let bytes = bytes.get(..usize::try_from(u32::from_le_bytes(*size)).ok()?)?;
    let crc = u32::from_le_bytes(*crc);
    (crc32(bytes) == crc).then_some((Calibration::from_bytes(bytes)?, crc))
}

/// Pieces of a calibration, put together in order.
#[derive(Clone, Debug)]
pub(crate) struct Upload {
    record: Record,
    size: usize,
    received: usize,
}

impl Upload {
    /// An upload of so many bytes with this CRC-32 begins.
    ///
    /// # Errors
    /// [`Refusal::WrongSize`] if that is not the size of a calibration.
    pub(crate) fn begin(size: u32, crc: u32) -> Result<Self, Refusal> {
        let mut record = [0xFF; RECORD];
        let (head, _) = record.split_at_mut(CALIBRATION);
        head[..4].copy_from_slice(&size.to_le_bytes());
        head[4..].copy_from_slice(&crc.to_le_bytes());
        match usize::try_from(size) {
            Ok(size) if Calibration::is_size(size) => Ok(Self { record, size, received: 0 }),
            _ => Err(Refusal::WrongSize),
        }
    }

    /// The next piece. One that has been received before is taken again, for its answer may have
    /// been lost.
    ///
    /// # Errors
    /// [`Refusal::WrongOffset`] if a piece before it is missing; [`Refusal::WrongSize`] if it goes
    /// beyond the end.
    pub(crate) fn piece(&mut self, offset: u16, data: &[u8]) -> Result<(), Refusal> {
        let start = usize::from(offset);
        if start > self.received {
            return Err(Refusal::WrongOffset);
        }
        let end = start + data.len();
        if end > self.size {
            return Err(Refusal::WrongSize);
        }
        let place = self.record.get_mut(CALIBRATION + start..CALIBRATION + end);
        place.ok_or(Refusal::WrongSize)?.copy_from_slice(data);
        self.received = self.received.max(end);
        Ok(())
    }

    /// The whole: the record to keep, the calibration in it and its CRC-32.
    ///
    /// # Errors
    /// [`Refusal::WrongSize`] if pieces are missing, [`Refusal::WrongCrc`] if the CRC-32 is not the one
    /// announced, [`Refusal::BadCalibration`] if the bytes are not a calibration.
    pub(crate) fn finish(&self) -> Result<(&Record, Calibration, u32), Refusal> {
        if self.received < self.size {
            return Err(Refusal::WrongSize);
        }
        let bytes = self.record.get(CALIBRATION..CALIBRATION + self.size).unwrap_or_default();
        if self.record[4..CALIBRATION] != crc32(bytes).to_le_bytes() {
            return Err(Refusal::WrongCrc);
        }
        let (calibration, crc) = open(&self.record).ok_or(Refusal::BadCalibration)?;
        Ok((&self.record, calibration, crc))
    }
}
