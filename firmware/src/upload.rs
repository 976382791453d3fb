//! A calibration on its way to the board, and as it is kept.

use shared_proto::{Calibration, Key, Refusal, crc32};

/// Where the key is in a record: behind the calibration and its CRC-32.
const KEY: usize = Calibration::SIZE + 4;

/// Length of a [`Record`], a multiple of the eight bytes that flash is written in.
pub const RECORD: usize = KEY + Key::LEN + 8;

/// What is kept in [`crate::Storage`]: a calibration and its CRC-32, the key that commands are signed
/// with and its CRC-32, little-endian, and four bytes to fill up.
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
    let (bytes, crc) = record.split_first_chunk::<{ Calibration::SIZE }>()?;
    let crc = u32::from_le_bytes(*crc.first_chunk()?);
    (crc32(bytes) == crc).then_some((Calibration::from_bytes(bytes)?, crc))
}

/// Pieces of a calibration, put together in order.
#[derive(Clone, Debug)]
pub(crate) struct Upload {
    record: Record,
    received: usize,
}

impl Upload {
    /// An upload of so many bytes with this CRC-32 begins.
    ///
    /// # Errors
    /// [`Refusal::WrongSize`] if that is not the size of a calibration.
    pub(crate) fn begin(size: u32, crc: u32) -> Result<Self, Refusal> {
        if usize::try_from(size) != Ok(Calibration::SIZE) {
            return Err(Refusal::WrongSize);
        }
        let mut record = [0xFF; RECORD];
        record[Calibration::SIZE..KEY].copy_from_slice(&crc.to_le_bytes());
        Ok(Self { record, received: 0 })
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
        let calibration = &mut self.record[..Calibration::SIZE];
        calibration.get_mut(start..end).ok_or(Refusal::WrongSize)?.copy_from_slice(data);
        self.received = self.received.max(end);
        Ok(())
    }

    /// The whole: the record to keep, the calibration in it and its CRC-32.
    ///
    /// # Errors
    /// [`Refusal::WrongSize`] if pieces are missing, [`Refusal::WrongCrc`] if the CRC-32 is not the one
    /// announced, [`Refusal::BadCalibration`] if the bytes are not a calibration.
    pub(crate) fn finish(&self) -> Result<(&Record, Calibration, u32), Refusal> {
        if self.received < Calibration::SIZE {
            return Err(Refusal::WrongSize);
        }
        let bytes = &self.record[..Calibration::SIZE];
        if crc32(bytes).to_le_bytes() != self.record[Calibration::SIZE..KEY] {
            return Err(Refusal::WrongCrc);
        }
        let (calibration, crc) = open(&self.record).ok_or(Refusal::BadCalibration)?;
        Ok((&self.record, calibration, crc))
    }
}
