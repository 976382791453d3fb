//! Upload of a calibration, and its format in storage.

use shared_proto::{Calibration, Refusal, crc32};

/// Offset of the calibration in a record, after its length and CRC-32.
const CALIBRATION: usize = 8;

/// Length of a record, a multiple of the eight bytes that flash is written in.
pub const RECORD: usize = (CALIBRATION + Calibration::MAX_SIZE).next_multiple_of(8);

/// Content of [`crate::Storage`], little-endian: length of a calibration in bytes, its CRC-32, room
/// for the longest calibration, padding.
pub type Record = [u8; RECORD];

pub(crate) fn kept_crc(record: &Record) -> Option<u32> {
    let crc = u32::from_le_bytes(*record[4..].first_chunk()?);
    (crc32(kept_bytes(record)?) == crc).then_some(crc)
}

pub(crate) fn open(record: &Record) -> Option<Calibration> {
    Calibration::from_bytes(kept_bytes(record)?)
}

fn kept_bytes(record: &Record) -> Option<&[u8]> {
    let (size, _) = record.split_first_chunk()?;
    let size = usize::try_from(u32::from_le_bytes(*size)).ok()?;
    record.get(CALIBRATION..CALIBRATION.checked_add(size)?)
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Upload {
    size: usize,
    received: usize,
}

impl Upload {
    /// Begins an upload; refuses a size that no calibration has.
    pub(crate) fn begin(size: u32, crc: u32, record: &mut Record) -> Result<Self, Refusal> {
        let known = usize::try_from(size).ok().filter(|&size| Calibration::is_size(size));
        let upload = Self { size: known.ok_or(Refusal::WrongSize)?, received: 0 };
        record.fill(0xFF);
        let (head, _) = record.split_at_mut(CALIBRATION);
        head[..4].copy_from_slice(&size.to_le_bytes());
        head[4..].copy_from_slice(&crc.to_le_bytes());
        Ok(upload)
    }

    /// Adds the next piece, or accepts one again whose answer may have been lost.
    ///
    /// # Errors
    /// [`Refusal::WrongOffset`] without an earlier piece; [`Refusal::WrongSize`] beyond the size.
    pub(crate) fn piece(
        &mut self,
        offset: u16,
        data: &[u8],
        record: &mut Record,
    ) -> Result<(), Refusal> {
        let start = usize::from(offset);
        if start > self.received {
            return Err(Refusal::WrongOffset);
        }
        let end = start + data.len();
        if end > self.size {
            return Err(Refusal::WrongSize);
        }
        let position = record.get_mut(CALIBRATION + start..CALIBRATION + end);
        position.ok_or(Refusal::WrongSize)?.copy_from_slice(data);
        self.received = self.received.max(end);
        Ok(())
    }

    /// Returns the CRC-32 of a complete and valid calibration.
    ///
    /// # Errors
    /// [`Refusal::WrongSize`] if pieces are missing, [`Refusal::WrongCrc`] if the CRC-32 is not the
    /// announced one, [`Refusal::BadCalibration`] if the bytes are not a calibration.
    pub(crate) fn finish(&self, record: &Record) -> Result<u32, Refusal> {
        if self.received < self.size {
            return Err(Refusal::WrongSize);
        }
        let crc = kept_crc(record).ok_or(Refusal::WrongCrc)?;
        if open(record).is_none() { Err(Refusal::BadCalibration) } else { Ok(crc) }
    }
}
